//! The state of the window, as plain data: the camera, the engine, and which picture is due next.

use std::time::{Duration, Instant};

use rayo::glam::DVec2;
use rayo::{Camera, Cancel, Engine, Keep, Precision, Scene, View};

use crate::orbit::Orbit;

/// The time that a picture may take while the camera moves: one that takes longer is drawn coarser.
const BUDGET: Duration = Duration::from_millis(80);

/// How long the camera has to rest before its picture is refined.
const REST: Duration = Duration::from_millis(120);

/// The least time from one picture to the next: nothing here waits for the screen's own refresh.
const SHORTEST_FRAME: Duration = Duration::from_micros(1_000_000 / 120);

/// The side of a pixel of the coarsest picture, in pixels of the window.
const COARSEST: u32 = 64;

/// The angle by which an arrow key turns the camera, in radians.
const KEY_TURN: f64 = std::f64::consts::TAU / 72.0;

/// The length of a drag that turns the camera by a radian, in pixels.
const PIXELS_OF_A_RADIAN: f64 = 300.0;

/// The factor of the distance for a notch of the wheel, or for a key.
const NOTCH: f64 = 1.15;

/// The angle from picture to picture of a camera that goes round by itself, in radians.
const STEP_ROUND: f64 = std::f64::consts::TAU / 360.0;

/// The engine that traces, and its options.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tracing {
    /// The engine.
    pub engine: Engine,
    /// Its precision.
    pub precision: Precision,
    /// Whether objects cast shadows.
    pub shadows: bool,
    /// Whether no work is omitted.
    pub keeps_all: bool,
    /// The number of threads.
    pub threads: usize,
}

impl Tracing {
    /// The omissions that are not to be made.
    pub fn keep(&self) -> Keep {
        if self.keeps_all { Keep::all() } else { Keep::NOTHING }
    }
}

/// A picture that is wanted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wish {
    /// Where the camera is.
    pub view: View,
    /// The width and the height of the picture in the window.
    pub size: [u32; 2],
    /// The side of a pixel of the picture in pixels of the window.
    pub coarseness: u32,
    /// The engine that traces it, and its options.
    pub tracing: Tracing,
}

impl Wish {
    /// The camera of the picture, for a scene with the camera `scene_camera`.
    pub fn camera(&self, scene_camera: &Camera) -> Camera {
        let [width, height] = self.size.map(|side| side.div_ceil(self.coarseness));
        scene_camera.sized_by_height(width, height).expect("a window is no larger than a picture may be")
    }

    /// The number of its pixels.
    fn pixels(&self) -> f64 {
        self.size.map(|side| f64::from(side.div_ceil(self.coarseness))).iter().product()
    }
}

/// How long a picture took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Times {
    /// Moving the scene to the camera.
    pub moved: Duration,
    /// Planning it.
    pub planned: Duration,
    /// Tracing it.
    pub traced: Duration,
}

impl Times {
    /// The time before the first ray.
    pub fn set_up(&self) -> Duration {
        self.moved + self.planned
    }

    /// The whole time.
    pub fn total(&self) -> Duration {
        self.set_up() + self.traced
    }
}

/// A picture that is shown, and how long it took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shown {
    /// What was wanted.
    pub wish: Wish,
    /// How long it took.
    pub times: Times,
}

/// A picture that is being traced.
struct InFlight {
    wish: Wish,
    cancel: Cancel,
}

/// What a key does, independent of which key it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Takes the engine of this number, from 1.
    Engine(usize),
    /// Takes the engine's next precision.
    Precision,
    /// Switches shadows on or off.
    Shadows,
    /// Switches all omissions of work off or on.
    KeepAll,
    /// Takes the next number of threads.
    Threads,
    /// Starts or stops a camera that goes round by itself.
    GoRound,
    /// Brings the camera back to where it began.
    Home,
    /// Turns the camera to the left.
    Left,
    /// Turns the camera to the right.
    Right,
    /// Turns the camera upwards.
    Up,
    /// Turns the camera downwards.
    Down,
    /// Brings the camera nearer.
    Nearer,
    /// Takes the camera farther away.
    Farther,
}

impl Command {
    /// The command of a letter, a digit or a space.
    pub fn of_character(character: char) -> Option<Command> {
        Some(match character {
            '1'..='9' => Command::Engine(character as usize - '0' as usize),
            'p' => Command::Precision,
            's' => Command::Shadows,
            'k' => Command::KeepAll,
            't' => Command::Threads,
            ' ' => Command::GoRound,
            '+' | '=' => Command::Nearer,
            '-' => Command::Farther,
            'h' => Command::Home,
            _ => return None,
        })
    }
}

/// Everything that a user can change, and what follows for the next picture.
pub struct State {
    /// The scene's lights without its objects: enough to ask an engine whether it takes the scene.
    lights_alone: Scene,
    /// The number of objects of the scene.
    objects: usize,
    most_threads: usize,
    orbit: Orbit,
    tracing: Tracing,
    size: [u32; 2],
    goes_round: bool,
    /// Whether what is shown is no longer what is wanted.
    is_stale: bool,
    /// When the user last changed what is wanted.
    changed: Instant,
    /// When the last picture was begun.
    last_wish: Option<Instant>,
    in_flight: Option<InFlight>,
    shown: Option<Shown>,
    /// The last picture of each way to trace, and how long it took.
    known: Vec<Shown>,
    /// When the pictures of the last second were shown.
    recent: Vec<Instant>,
    /// The message below the picture, until the next command.
    message: Option<String>,
    /// Cancels pictures that are being written to files.
    written: Cancel,
}

impl State {
    /// The state of a window of `size` that shows the scene `world`, traced by `tracing`. None if
    /// the scene's view has no direction.
    pub fn new(world: &Scene, tracing: Tracing, size: [u32; 2], most_threads: usize) -> Option<State> {
        Some(State {
            lights_alone: Scene { lights: world.lights.clone(), ..Scene::new(world.camera) },
            objects: world.spheres.len() + world.triangle_count(),
            most_threads,
            orbit: Orbit::around(world)?,
            tracing,
            size,
            goes_round: false,
            is_stale: true,
            changed: Instant::now(),
            last_wish: None,
            in_flight: None,
            shown: None,
            known: Vec::new(),
            recent: Vec::new(),
            message: None,
            written: Cancel::default(),
        })
    }

    /// The message below the picture, if there is one.
    pub fn message(&self) -> Option<&str> {
        self.message.as_deref()
    }

    /// Shows a message below the picture.
    pub fn tell(&mut self, message: impl Into<String>) {
        self.message = Some(message.into());
    }

    /// Does what a key asks for.
    pub fn obey(&mut self, command: Command, now: Instant) {
        self.message = None;
        match command {
            Command::Engine(number) => self.take_engine(number, now),
            Command::Precision => {
                let all = self.tracing.engine.precisions();
                let current = all.iter().position(|precision| *precision == self.tracing.precision);
                let next = current.map_or(0, |index| index + 1) % all.len();
                self.trace_by(Tracing { precision: all[next], ..self.tracing }, now);
            }
            Command::Shadows => self.trace_by(Tracing { shadows: !self.tracing.shadows, ..self.tracing }, now),
            Command::KeepAll => self.trace_by(Tracing { keeps_all: !self.tracing.keeps_all, ..self.tracing }, now),
            Command::Threads => {
                let doubled = 2 * self.tracing.threads;
                let threads =
                    if self.tracing.threads == self.most_threads { 1 } else { doubled.min(self.most_threads) };
                self.trace_by(Tracing { threads, ..self.tracing }, now);
            }
            Command::GoRound => {
                self.goes_round = !self.goes_round;
                self.recent.clear();
            }
            Command::Home => self.move_camera(now, Orbit::go_home),
            Command::Left => self.move_camera(now, |orbit| orbit.turn(-KEY_TURN, 0.0)),
            Command::Right => self.move_camera(now, |orbit| orbit.turn(KEY_TURN, 0.0)),
            Command::Up => self.move_camera(now, |orbit| orbit.turn(0.0, KEY_TURN)),
            Command::Down => self.move_camera(now, |orbit| orbit.turn(0.0, -KEY_TURN)),
            Command::Nearer => self.wheel(1.0, now),
            Command::Farther => self.wheel(-1.0, now),
        }
    }

    /// Turns the camera with the scene under the pointer, which moved by so many pixels.
    pub fn drag(&mut self, across: f64, down: f64, now: Instant) {
        self.move_camera(now, |orbit| orbit.turn(-across / PIXELS_OF_A_RADIAN, down / PIXELS_OF_A_RADIAN));
    }

    /// Shifts the camera with the scene under the pointer, which moved by so many pixels.
    pub fn drag_across(&mut self, across: f64, down: f64, now: Instant) {
        let height = f64::from(self.size[1].max(1));
        self.move_camera(now, |orbit| orbit.shift(DVec2::new(-across, down) / height));
    }

    /// Brings the camera nearer by so many notches of the wheel.
    pub fn wheel(&mut self, notches: f64, now: Instant) {
        self.move_camera(now, |orbit| orbit.zoom(NOTCH.powf(-notches.clamp(-20.0, 20.0))));
    }

    /// Takes another size for the picture. Nothing is traced while it has no pixels.
    pub fn resize(&mut self, size: [u32; 2], now: Instant) {
        if size != self.size {
            self.size = size;
            self.change(now);
        }
    }

    /// The picture to trace now, if one is due, and what cancels it.
    pub fn next_wish(&mut self, now: Instant) -> Option<(Wish, Cancel)> {
        if self.in_flight.is_some() || self.due(now)? > now {
            return None;
        }
        let coarseness = if self.is_stale || self.goes_round {
            if self.goes_round {
                self.orbit.turn(STEP_ROUND, 0.0);
            }
            self.coarseness_in_time()
        } else {
            self.shown?.wish.coarseness / 2
        };
        self.is_stale = false;
        self.last_wish = Some(now);
        let wish = Wish { view: self.orbit.view(), size: self.size, coarseness, tracing: self.tracing };
        let cancel = Cancel::default();
        self.in_flight = Some(InFlight { wish, cancel: cancel.clone() });
        Some((wish, cancel))
    }

    /// When the next picture is to be traced if nothing changes before. None: never.
    pub fn due(&self, now: Instant) -> Option<Instant> {
        if self.in_flight.is_some() || self.size.contains(&0) {
            return None;
        }
        if self.is_stale || self.goes_round {
            return Some(self.last_wish.map_or(now, |last| last + SHORTEST_FRAME));
        }
        let is_coarse = self.shown.is_some_and(|shown| shown.wish.coarseness > 1);
        is_coarse.then(|| self.changed + REST)
    }

    /// Ends the picture in flight: `times` says how long it took; None that it was cancelled, or
    /// could not be traced.
    pub fn arrived(&mut self, times: Option<Times>, now: Instant) {
        let Some(InFlight { wish, .. }) = self.in_flight.take() else { return };
        let Some(times) = times else { return };
        let shown = Shown { wish, times };
        self.shown = Some(shown);
        self.known.retain(|known| known.wish.tracing != wish.tracing);
        self.known.push(shown);
        self.recent.push(now);
        self.recent.retain(|shown| now.duration_since(*shown) <= Duration::from_secs(1));
    }

    /// The picture at its finest: the one that is written, named and printed.
    pub fn finest(&self) -> Wish {
        Wish { view: self.orbit.view(), size: self.size, coarseness: 1, tracing: self.tracing }
    }

    /// Where the camera is.
    pub fn orbit(&self) -> Orbit {
        self.orbit
    }

    /// Cancels the picture that is being traced; it is still wanted, and becomes due again.
    pub fn stop(&mut self) {
        if let Some(InFlight { cancel, .. }) = &self.in_flight {
            cancel.cancel();
        }
    }

    /// Cancels the picture that is being traced, since one is to be written; returns what cancels
    /// that.
    pub fn begin_to_write(&mut self) -> Cancel {
        self.stop();
        self.tell("writing ...");
        self.written.clone()
    }

    /// Cancels all that is being traced or written.
    pub fn end(&mut self) {
        self.stop();
        self.written.cancel();
    }

    /// Whether the finest picture is shown, so that nothing is left to trace.
    pub fn rests(&self) -> bool {
        let is_fine = self.shown.is_some_and(|shown| shown.wish == self.finest());
        is_fine && self.in_flight.is_none() && !self.goes_round
    }

    /// Frames per second: while the camera goes round, those that were shown; otherwise the inverse
    /// of the time that the last picture took.
    pub fn frames_per_second(&self) -> f64 {
        if let (true, [first, .., last]) = (self.goes_round, &self.recent[..]) {
            return (self.recent.len() - 1) as f64 / last.duration_since(*first).as_secs_f64();
        }
        self.shown.map_or(0.0, |shown| 1.0 / shown.times.total().as_secs_f64())
    }

    /// The line of figures below the picture.
    pub fn figures(&self) -> String {
        let Some(Shown { wish, times }) = self.shown else { return "...".into() };
        let Tracing { engine, precision, shadows, keeps_all, threads } = wish.tracing;
        let mut line = format!("{engine} {precision} t{threads}");
        if shadows {
            line += " shadows";
        }
        if keeps_all {
            line += " keep-all";
        }
        let [width, height] = wish.size;
        line += &format!(" {width}x{height}");
        if wish.coarseness > 1 {
            line += &format!("/{}", wish.coarseness);
        }
        let milliseconds = |time: Duration| 1e3 * time.as_secs_f64();
        line += &format!(" | set-up {:.2} ms", milliseconds(times.set_up()));
        line += &format!(" trace {:.2} ms", milliseconds(times.traced));
        line += &format!(" | {:.1} frames/s", self.frames_per_second());
        line + &format!(" {:.1} Mrays/s", wish.pixels() / times.traced.as_secs_f64() / 1e6)
    }

    fn take_engine(&mut self, number: usize, now: Instant) {
        let Some(engine) = Engine::ALL.get(number - 1).copied() else {
            return self.tell(format!("there are the engines 1 to {}", Engine::ALL.len()));
        };
        let of_engine = |precision: &Precision| engine.precisions().contains(precision);
        let precision = Some(self.tracing.precision).filter(of_engine).unwrap_or(engine.precision());
        self.trace_by(Tracing { engine, precision, ..self.tracing }, now);
    }

    /// Traces by `tracing` from now on, if its engine takes the scene; otherwise shows why it does
    /// not.
    fn trace_by(&mut self, tracing: Tracing, now: Instant) {
        self.lights_alone.shadows = tracing.shadows;
        match tracing.engine.takes(&self.lights_alone, Some(tracing.precision)) {
            Ok(()) => {
                self.tracing = tracing;
                self.change(now);
            }
            Err(error) => self.tell(error.to_string()),
        }
    }

    fn move_camera(&mut self, now: Instant, movement: impl FnOnce(&mut Orbit)) {
        movement(&mut self.orbit);
        self.message = None;
        self.change(now);
    }

    /// Marks what is shown as stale. The picture in flight goes on if it is coarse enough to be
    /// ready in time: if each step of a moving camera cancelled it, nothing would be shown.
    fn change(&mut self, now: Instant) {
        self.is_stale = true;
        self.changed = now;
        let coarseness = self.coarseness_in_time();
        if let Some(InFlight { wish, cancel }) = &self.in_flight {
            let is_in_time = wish.coarseness >= coarseness && wish.tracing == self.tracing && wish.size == self.size;
            if !is_in_time {
                cancel.cancel();
            }
        }
    }

    /// The finest coarseness with which a picture is traced within [`BUDGET`], as far as is known.
    fn coarseness_in_time(&self) -> u32 {
        let known = self.known.iter().find(|known| known.wish.tracing == self.tracing);
        let (set_up, seconds_of_a_pixel) = match known {
            Some(Shown { wish, times }) => (times.set_up(), times.traced.as_secs_f64() / wish.pixels()),
            None => (Duration::ZERO, self.guessed_seconds_of_a_pixel()),
        };
        // Even where set-up takes most of the budget, tracing has half of it.
        let budget = BUDGET.saturating_sub(set_up).max(BUDGET / 2).as_secs_f64();
        let in_time = |coarseness: &u32| {
            let wish = Wish { coarseness: *coarseness, ..self.finest() };
            wish.pixels() * seconds_of_a_pixel <= budget
        };
        let mut all = (0..=COARSEST.ilog2()).map(|power| 1 << power);
        all.find(in_time).unwrap_or(COARSEST)
    }

    /// A guess for the first picture. Packets look at few objects. The others look at all of them,
    /// and where there are shadows once more for each light.
    fn guessed_seconds_of_a_pixel(&self) -> f64 {
        const OF_A_PACKET: f64 = 20e-9;
        const OF_AN_OBJECT: f64 = 5e-9;
        let Tracing { engine, shadows, keeps_all, threads, .. } = self.tracing;
        if engine.is_packet() && !keeps_all {
            return OF_A_PACKET;
        }
        let rays = if shadows { 1 + self.lights_alone.lights.len() } else { 1 };
        OF_A_PACKET + OF_AN_OBJECT * (rays * self.objects) as f64 / threads as f64
    }
}

#[cfg(test)]
mod tests {
    use rayo::glam::Vec3;
    use rayo::{Light, Sphere};

    use super::*;

    impl State {
        fn tracing(&self) -> Tracing {
            self.tracing
        }
    }

    fn tracing() -> Tracing {
        let engine = Engine::fastest();
        Tracing { engine, precision: engine.precision(), shadows: false, keeps_all: false, threads: 1 }
    }

    fn state() -> State {
        let world = Scene {
            spheres: vec![Sphere { radius: 1.0, colour: Vec3::ONE, centre: Vec3::new(0.0, 0.0, 10.0) }],
            lights: vec![Light { intensity: 1.0, colour: Vec3::ONE, position: Vec3::ZERO }],
            ..Scene::new(Camera::default())
        };
        State::new(&world, tracing(), [640, 480], 4).unwrap()
    }

    fn took(milliseconds: u64) -> Option<Times> {
        Some(Times { traced: Duration::from_millis(milliseconds), ..Times::default() })
    }

    /// The number of an engine's key.
    fn key_of(engine: Engine) -> Command {
        Command::Engine(1 + Engine::ALL.iter().position(|one| *one == engine).unwrap())
    }

    #[test]
    fn one_picture_is_traced_at_a_time_and_none_when_all_is_shown() {
        let (mut state, now) = (state(), Instant::now());
        let (wish, _) = state.next_wish(now).unwrap();
        assert_eq!((wish.view, wish.size, wish.coarseness), (View::default(), [640, 480], 1));
        assert!(state.next_wish(now).is_none() && !state.rests());
        state.arrived(took(2), now);
        assert!(state.next_wish(now + Duration::from_secs(9)).is_none() && state.rests());
    }

    #[test]
    fn slow_engine_draws_coarser_until_the_camera_rests() {
        let (mut state, mut now) = (state(), Instant::now());
        let _ = state.next_wish(now);
        state.arrived(took(2000), now);
        now += Duration::from_secs(1);
        state.drag(30.0, 0.0, now);
        let (moving, _) = state.next_wish(now).unwrap();
        // A sixteenth of 2 s is beyond the budget, a 64th is within it.
        assert_eq!(moving.coarseness, 8);
        state.arrived(took(31), now);
        assert!(state.next_wish(now).is_none(), "it waits for the camera to rest");
        now += REST;
        for coarseness in [4, 2, 1] {
            assert_eq!(state.next_wish(now).unwrap().0, Wish { coarseness, ..moving });
            state.arrived(took(2000 / u64::from(coarseness * coarseness)), now);
        }
        assert!(state.rests());
    }

    #[test]
    fn moving_camera_stops_fine_pictures_alone() {
        let (mut state, mut now) = (state(), Instant::now());
        let _ = state.next_wish(now);
        state.arrived(took(2000), now);
        state.wheel(1.0, now);
        let (_, coarse) = state.next_wish(now + SHORTEST_FRAME).unwrap();
        state.wheel(1.0, now);
        assert!(!coarse.is_cancelled());
        state.arrived(took(31), now);
        now += 2 * SHORTEST_FRAME;
        let _ = state.next_wish(now).unwrap();
        state.arrived(took(31), now);
        let (_, fine) = state.next_wish(now + REST).unwrap();
        state.drag(1.0, 1.0, now + REST);
        assert!(fine.is_cancelled());
        // Another engine is never waited for.
        state.arrived(None, now + REST);
        let (_, other) = state.next_wish(now + 2 * REST).unwrap();
        state.obey(key_of(Engine::Rust), now);
        assert!(other.is_cancelled());
    }

    #[test]
    fn every_engine_has_a_key_and_one_that_cannot_trace_says_why() {
        for engine in Engine::ALL {
            let mut state = state();
            let before = state.tracing();
            state.obey(key_of(*engine), Instant::now());
            if engine.usable() {
                assert_eq!(state.tracing().engine, *engine);
                assert!(engine.precisions().contains(&state.tracing().precision) && state.message().is_none());
            } else {
                assert_eq!(state.tracing(), before);
                assert!(state.message().unwrap().contains(engine.name()), "{:?}", state.message());
            }
            // The engines of the paper have no shadows.
            let taken = state.tracing();
            state.obey(Command::Shadows, Instant::now());
            assert_eq!(state.tracing().shadows, taken.engine.has_shadows());
            assert_eq!(state.message().is_none(), taken.engine.has_shadows());
        }
        let mut state = state();
        state.obey(Command::Engine(9), Instant::now());
        assert!(state.message().unwrap().starts_with("there are the engines 1 to "));
    }

    #[test]
    fn precisions_and_threads_come_round_and_the_rest_is_switched() {
        let (mut state, now) = (state(), Instant::now());
        let first = state.tracing();
        for precision in first.engine.precisions().iter().cycle().skip(1).take(5) {
            state.obey(Command::Precision, now);
            assert_eq!(state.tracing().precision, *precision);
        }
        let threads: Vec<_> = (0..4)
            .map(|_| {
                state.obey(Command::Threads, now);
                state.tracing().threads
            })
            .collect();
        assert_eq!(threads, [2, 4, 1, 2]);
        state.obey(Command::KeepAll, now);
        assert!(state.tracing().keeps_all);
        state.obey(Command::KeepAll, now);
        assert!(!state.tracing().keeps_all);
    }

    #[test]
    fn window_without_pixels_waits_and_a_resized_one_retraces() {
        let (mut state, now) = (state(), Instant::now());
        state.resize([0, 480], now);
        assert!(state.next_wish(now).is_none() && state.due(now).is_none());
        state.resize([320, 200], now);
        assert_eq!(state.next_wish(now).unwrap().0.size, [320, 200]);
    }

    #[test]
    fn a_camera_that_goes_round_is_capped_and_stops_where_it_is() {
        let (mut state, mut now) = (state(), Instant::now());
        state.obey(Command::GoRound, now);
        let (first, _) = state.next_wish(now).unwrap();
        state.arrived(took(1), now);
        assert!(state.next_wish(now).is_none(), "no sooner than the cap");
        now += SHORTEST_FRAME;
        let (second, _) = state.next_wish(now).unwrap();
        assert_ne!(first.view, second.view);
        state.arrived(took(1), now);
        assert!((state.frames_per_second() - 120.0).abs() < 1.0, "{}", state.frames_per_second());
        state.obey(Command::GoRound, now);
        assert!(state.rests() && state.next_wish(now + REST).is_none());
        state.obey(Command::Home, now);
        assert_eq!(state.next_wish(now + REST).unwrap().0.view, View::default());
    }

    #[test]
    fn the_line_of_figures_names_all_that_a_picture_depends_on() {
        let (mut state, now) = (state(), Instant::now());
        assert_eq!(state.figures(), "...");
        let _ = state.next_wish(now);
        let times = Times { moved: Duration::from_millis(1), planned: Duration::from_millis(3), ..took(6).unwrap() };
        state.arrived(Some(times), now);
        let Tracing { engine, precision, .. } = tracing();
        let expected = "640x480 | set-up 4.00 ms trace 6.00 ms | 100.0 frames/s 51.2 Mrays/s";
        assert_eq!(state.figures(), format!("{engine} {precision} t1 {expected}"));
    }
}
