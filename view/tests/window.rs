//! The window on a virtual display: its pictures are those of `rayo render`, to the last bit.

#![cfg(target_os = "linux")]

#[path = "../../tests/common/extent.rs"]
mod extent;

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::{Duration, Instant};

use rayo::{Engine, Film, PixelFormat, Scene};

/// How long a test waits for the program, on the slowest of machines.
const DEADLINE: Duration = Duration::from_secs(120);

/// A process that is killed when its test ends.
struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A virtual display, and the folder of the file that has its pixels.
struct Display {
    server: Process,
    name: String,
    pixels: tempfile::TempDir,
}

impl Display {
    /// Starts a display under a number that is free. Where the programs for it are not installed,
    /// says that `check` is not run, and returns None.
    fn start(check: &str) -> Option<Display> {
        if let Some(missing) = ["Xvfb", "xdotool"].into_iter().find(|program| !is_installed(program)) {
            extent::not_run(missing, check);
            return None;
        }
        let pixels = tempfile::tempdir().unwrap();
        let mut command = Command::new("Xvfb");
        command.args(["-displayfd", "1", "-noreset", "-screen", "0", "1000x800x24", "-fbdir"]).arg(pixels.path());
        let mut server = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let number = lines_of(&mut server).recv_timeout(DEADLINE).expect("the number of the display");
        Some(Display { server: Process(server), name: format!(":{}", number.trim()), pixels })
    }

    /// The program, started on a scene of the repository.
    fn view(&self, arguments: &[&str]) -> View<'_> {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rayo-view"));
        command.args(arguments).arg("--log").env("DISPLAY", &self.name).env_remove("WAYLAND_DISPLAY");
        command.current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap());
        let mut program = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let lines = lines_of(&mut program);
        View { display: self, program: Process(program), lines }
    }

    fn xdotool(&self, arguments: &[&str]) -> String {
        let output = Command::new("xdotool").args(arguments).env("DISPLAY", &self.name).output().unwrap();
        assert!(output.status.success(), "{arguments:?}: {output:?}");
        String::from_utf8(output.stdout).unwrap()
    }

    /// The pixels of the upper left corner of the screen, row by row. The file has the format XWD:
    /// a header of 32-bit fields, a table of colours in 12 bytes each, and the rows of pixels.
    fn pixels(&self, [width, height]: [usize; 2]) -> Vec<u32> {
        let dump = fs::read(self.pixels.path().join("Xvfb_screen0")).unwrap();
        let field = |at: usize| u32::from_be_bytes(dump[4 * at..][..4].try_into().unwrap()) as usize;
        let header_bytes = field(0);
        let byte_order = field(7);
        let bits_per_pixel = field(11);
        let row_bytes = field(12);
        let colours = field(19);
        assert_eq!((byte_order, bits_per_pixel), (0, 32), "little endian, in 32 bits");
        let rows = dump[header_bytes + 12 * colours..].chunks_exact(row_bytes).take(height);
        let pixel = |bytes: &[u8]| u32::from_le_bytes(bytes.try_into().unwrap()) & 0xff_ffff;
        rows.flat_map(|row| row.chunks_exact(4).take(width).map(pixel)).collect()
    }
}

/// Whether the path has a program of this name.
fn is_installed(program: &str) -> bool {
    let paths = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&paths).any(|folder| folder.join(program).is_file())
}

/// The lines of a program's output, as they come.
fn lines_of(program: &mut Child) -> Receiver<String> {
    let (sender, lines) = channel();
    let output = BufReader::new(program.stdout.take().expect("it is piped"));
    thread::spawn(move || output.lines().map_while(Result::ok).try_for_each(|line| sender.send(line)));
    lines
}

/// The program, in whose window something is shown.
struct View<'a> {
    display: &'a Display,
    program: Process,
    lines: Receiver<String>,
}

impl View<'_> {
    /// Waits for a line that begins with `beginning`; returns it and the lines before it.
    fn wait_for(&self, beginning: &str) -> Vec<String> {
        let mut lines = Vec::new();
        let start = Instant::now();
        while !lines.last().is_some_and(|line: &String| line.starts_with(beginning)) {
            let left = DEADLINE.saturating_sub(start.elapsed());
            let line = self.lines.recv_timeout(left);
            lines.push(line.unwrap_or_else(|_| panic!("no line `{beginning}` after {lines:#?}")));
        }
        lines
    }

    /// Gives the window the focus, so that it gets the keys that are pressed.
    fn focus(&self) {
        let id = self.display.xdotool(&["search", "--sync", "--pid", &self.program.0.id().to_string()]);
        self.display.xdotool(&["windowfocus", id.lines().last().unwrap()]);
        self.wait_for("focused true");
    }

    fn key(&self, key: &str) {
        self.display.xdotool(&["key", key]);
        self.wait_for("key");
    }

    /// Waits until the window shows the picture of `scene` by `engine`; `what` names it if it never
    /// does.
    fn shows(&self, scene: &Scene, engine: Engine, what: &str) {
        let camera = scene.camera;
        let tracer = engine.prepare(None, scene).unwrap();
        let mut film = Film::new(PixelFormat::Rgb8, camera.pixels() as usize).unwrap();
        tracer.rows(0..camera.height(), film.as_mut());
        let level = |pixel: usize| {
            let [red, green, blue] = film.colour(pixel).levels();
            u32::from_be_bytes([0, red, green, blue])
        };
        let expected: Vec<_> = (0..film.len()).map(level).collect();
        let start = Instant::now();
        let mut differ = usize::MAX;
        while start.elapsed() < DEADLINE {
            let shown = self.display.pixels([camera.width() as usize, camera.height() as usize]);
            differ = shown.iter().zip(&expected).filter(|(shown, expected)| shown != expected).count();
            if differ == 0 {
                return;
            }
            thread::sleep(Duration::from_millis(20));
        }
        panic!("{what}: {differ} pixels differ");
    }

    /// Waits for its end; returns its exit status and what it wrote to standard error.
    fn end(mut self) -> (Option<i32>, String) {
        let mut text = String::new();
        std::io::Read::read_to_string(self.program.0.stderr.as_mut().expect("it is piped"), &mut text).unwrap();
        (self.program.0.wait().unwrap().code(), text)
    }
}

fn scene(name: &str) -> Scene {
    rayo::read(&PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../scenes").join(name)).unwrap()
}

#[test]
fn every_engine_shows_what_it_renders() {
    let Some(display) = Display::start("the pictures of rayo-view in a window") else { return };
    let scene = scene("sphere.in");
    let camera = scene.camera.sized_by_height(400, 300).unwrap();
    let scene = Scene { camera, ..scene };
    let view = display.view(&["scenes/sphere.in", "--size", "400x300"]);
    view.wait_for("rests");
    view.shows(&scene, Engine::fastest(), "at the beginning");
    view.focus();
    for (number, engine) in (1..).zip(Engine::ALL).filter(|(_, engine)| engine.usable()) {
        view.key(&number.to_string());
        view.shows(&scene, *engine, engine.name());
    }
    display.xdotool(&["key", "q"]);
    assert_eq!(view.end(), (Some(0), String::new()));
}

#[test]
fn moved_camera_is_printed_and_renders_the_same() {
    let Some(display) = Display::start("the pictures of rayo-view from elsewhere") else { return };
    let view = display.view(&["scenes/island.toml", "--size", "160x90", "--engine", "portable"]);
    view.wait_for("rests");
    view.focus();
    for key in ["Left", "Left", "Up", "Prior", "s"] {
        view.key(key);
    }
    display.xdotool(&["key", "c"]);
    let printed = view.wait_for("up = ");
    let start = printed.iter().position(|line| line == "[image]").unwrap();
    let text = printed[start..].join("\n").replace("[image]", "[image]\nfile = \"x.png\"");
    let camera = rayo::parse_toml((text + "\n").as_bytes(), "what was printed", Path::new("")).unwrap().scene;
    let mut seen = scene("island.toml").seen_from(camera.view).unwrap();
    seen.camera = camera.camera;
    seen.shadows = true;
    view.shows(&seen, Engine::Portable, "from elsewhere");
    display.xdotool(&["mousemove", "80", "75", "click", "1"]);
    let told = view.wait_for("rayo step");
    assert!(told.iter().any(|line| line.starts_with("pixel 80,75: ") && line.contains("distance")), "{told:?}");
    assert!(told.last().unwrap().contains(" --position "), "{told:?}");
    display.xdotool(&["key", "Escape"]);
    assert_eq!(view.end(), (Some(0), String::new()));
}

#[test]
fn a_display_that_goes_away_ends_the_program_without_a_panic() {
    let Some(mut display) = Display::start("rayo-view without its display") else { return };
    let view = display.view(&["scenes/sphere.in", "--size", "80x60"]);
    view.wait_for("rests");
    let (program, lines) = (view.program, view.lines);
    display.server.0.kill().unwrap();
    let (status, text) = View { display: &display, program, lines }.end();
    assert!(status.is_some_and(|status| status != 0 && status != 101), "{status:?}: {text}");
    assert!(!text.contains("panicked"), "{text}");
}

#[test]
fn a_display_that_is_not_there_is_told_in_a_sentence() {
    let nowhere = error_with(&[]);
    assert!(nowhere.contains("there is no display"), "{nowhere}");
    let wayland = error_with(&[("WAYLAND_DISPLAY", "wayland-0")]);
    assert!(wayland.contains("X11 alone"), "{wayland}");
    let absent = error_with(&[("DISPLAY", ":12345")]);
    // The library for keys is required before the display is opened, and may not be installed.
    assert!(absent.contains("the display :12345") || absent.contains("libxkbcommon-x11"), "{absent}");
}

/// The only line that the program writes to standard error where it finds no display by these
/// variables alone.
fn error_with(variables: &[(&str, &str)]) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_rayo-view"));
    command.arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenes/sphere.in"));
    command.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET");
    let output = command.envs(variables.iter().copied()).output().unwrap();
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{error}");
    assert!(error.starts_with("error: ") && error.lines().count() == 1, "{error}");
    error
}
