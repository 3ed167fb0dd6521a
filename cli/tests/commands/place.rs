//! A folder with a scene in which commands are run, and assertions about the results.

use crate::program::Run;
use rayo::Picture;
use rayo::internals::render::{Engine, read};
use std::fs;
use std::path::Path;
use tempfile::TempDir;

/// A sphere and a triangle in 16 x 12 pixels, which every engine sees.
pub const SCENE: &str = "picture.png 16 12 1  1 1 1 1 1 5 5 0  1 1 1 0.5 0 0 0 5  1 0 0 1 -9 -9 9 9 -9 9 0 9 9\n";

/// A working directory, and the environment variables to run the program with.
pub struct Place {
    pub directory: TempDir,
    pub variables: Vec<(&'static str, &'static str)>,
}

impl Place {
    /// A new directory with a scene in the file scene.in.
    pub fn new() -> Self {
        let place = Place { directory: tempfile::tempdir().unwrap(), variables: Vec::new() };
        place.write("scene.in", SCENE);
        place
    }

    pub fn path(&self, name: &str) -> std::path::PathBuf {
        self.directory.path().join(name)
    }

    pub fn write(&self, name: &str, content: &str) {
        fs::write(self.path(name), content).unwrap();
    }

    pub fn command(&self) -> assert_cmd::Command {
        let mut command = assert_cmd::Command::new(assert_cmd::cargo::cargo_bin!("rayo"));
        for variable in ["NO_COLOR", "CLICOLOR", "CLICOLOR_FORCE", "RAYO_ENGINE"] {
            command.env_remove(variable);
        }
        command.envs(self.variables.iter().copied()).env("COLUMNS", "120").current_dir(&self.directory);
        command
    }

    /// Runs the program with arguments that are separated by single spaces.
    pub fn run(&self, arguments: &str) -> Run {
        Run::of(self.command().args(arguments.split(' ').filter(|it| !it.is_empty())).output().unwrap())
    }

    /// Runs a line of the shell in which the program is called rayo.
    #[cfg(unix)]
    pub fn shell(&self, line: &str) -> std::process::Output {
        let mut command = std::process::Command::new("sh");
        command.args(["-c", &format!("rayo() {{ exec \"$0\" \"$@\"; }}; {line}")]);
        command.arg(assert_cmd::cargo::cargo_bin!("rayo")).current_dir(&self.directory).output().unwrap()
    }

    /// Runs the program and asserts that it fails with `status` and exactly this message.
    #[track_caller]
    pub fn refuses(&self, arguments: &str, status: i32, message: &str) {
        let run = self.run(arguments);
        let shown = format!("rayo {arguments}\n{}", run.stderr);
        assert_eq!((run.status, run.stdout.as_str()), (status, ""), "{shown}");
        assert_eq!(run.stderr.trim_end(), message, "rayo {arguments}");
    }

    /// The names in the directory, sorted.
    pub fn files(&self) -> Vec<String> {
        let entries = fs::read_dir(&self.directory).unwrap();
        let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    pub fn picture(&self, name: &str) -> Picture {
        read(&self.path(name)).unwrap()
    }
}

pub fn is_png(path: &Path) -> bool {
    fs::read(path).unwrap().starts_with(b"\x89PNG\r\n\x1a\n")
}

pub fn size(picture: &Picture) -> (u32, u32) {
    (picture.width, picture.height)
}

/// The engines that this machine can run, as errors list them.
pub fn engines(are_listed: fn(&&Engine) -> bool) -> String {
    let names = Engine::ALL.iter().filter(are_listed).map(|engine| engine.name());
    names.chain(["auto"]).collect::<Vec<_>>().join(", ")
}

/// clap's message for an invalid value.
pub fn invalid(value: &str, option: &str, expected: &str) -> String {
    format!("error: invalid value '{value}' for '{option}': {expected}\n\nFor more information, try '--help'.")
}

/// Runs the program with this standard output; returns its status and its messages.
pub fn run_into(stdout: impl Into<std::process::Stdio>, place: &Place, arguments: &str) -> (Option<i32>, String) {
    let mut command = std::process::Command::new(assert_cmd::cargo::cargo_bin!("rayo"));
    command.args(arguments.split(' ')).current_dir(&place.directory).stdout(stdout);
    let output = command.stderr(std::process::Stdio::piped()).spawn().unwrap().wait_with_output().unwrap();
    (output.status.code(), String::from_utf8(output.stderr).unwrap())
}
