//! The window: events become commands, and films are copied and presented. Nothing is traced here.

use std::num::NonZeroU32;
use std::rc::Rc;
use std::sync::mpsc::{Receiver, Sender};
use std::time::Instant;

use rayo::{Camera, Film};
use softbuffer::{Context, Surface};
use winit::application::ApplicationHandler;
use winit::dpi::{PhysicalPosition, PhysicalSize};
use winit::event::{ElementState, MouseButton, MouseScrollDelta, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, OwnedDisplayHandle};
use winit::keyboard::{Key, NamedKey};
use winit::window::{Window, WindowId};

use crate::commands::{Source, camera_in_toml};
use crate::line;
use crate::state::{Command, State, Wish};
use crate::worker::{Reply, Request};

/// The second line below the picture where there is no message.
const HELP: &str =
    "1-8 engines, p precision, s shadows, k keep all, t threads, space round, w write, c camera, h home, q quit";

/// The number of lines below the picture: the figures, and a message.
const LINES: u32 = 2;

/// The longest way of the pointer, in pixels, that is a click and no drag.
const CLICK: f64 = 3.0;

/// The pixels of a touchpad that scroll as far as a notch of a wheel.
const PIXELS_OF_A_NOTCH: f64 = 40.0;

/// An open window, and the memory that it presents.
struct Opened {
    window: Rc<Window>,
    surface: Surface<OwnedDisplayHandle, Rc<Window>>,
    size: PhysicalSize<u32>,
}

/// A button of the mouse that is held down.
#[derive(Clone, Copy)]
struct Held {
    button: MouseButton,
    /// Where it went down.
    from: PhysicalPosition<f64>,
    /// Whether the pointer has moved farther than a click allows.
    drags: bool,
}

/// The application: the state, the channels to the worker, the window, and the film that it shows.
pub struct App<'a> {
    source: &'a Source,
    scene_camera: Camera,
    state: State,
    requests: Sender<Request>,
    replies: Receiver<Reply>,
    context: Context<OwnedDisplayHandle>,
    opened: Option<Opened>,
    /// The film that is shown, and the picture on it.
    film: Option<(Wish, Film)>,
    /// The film that was shown before, whose memory the next picture takes.
    spare: Option<Film>,
    pointer: PhysicalPosition<f64>,
    held: Option<Held>,
    is_hidden: bool,
    logs: bool,
    /// The number of pictures that were drawn.
    pictures: u64,
    /// Why the program ends, if not because the window was closed.
    failure: Option<String>,
}

impl<'a> App<'a> {
    /// An application whose window is not open yet; if it `logs`, it prints a line for each event
    /// and each picture.
    pub fn new(
        source: &'a Source,
        scene_camera: Camera,
        state: State,
        requests: Sender<Request>,
        replies: Receiver<Reply>,
        context: Context<OwnedDisplayHandle>,
        logs: bool,
    ) -> Self {
        App {
            source,
            scene_camera,
            state,
            requests,
            replies,
            context,
            opened: None,
            film: None,
            spare: None,
            pointer: PhysicalPosition::default(),
            held: None,
            is_hidden: false,
            logs,
            pictures: 0,
            failure: None,
        }
    }

    /// Cancels what is being traced; returns why the program ends, if not because the window was
    /// closed.
    pub fn end(mut self) -> Option<String> {
        self.state.end();
        self.failure
    }

    fn log(&self, line: impl FnOnce() -> String) {
        if self.logs {
            println!("{}", line());
        }
    }

    /// The side of a pixel of the letters, in pixels of the window.
    fn scale(&self) -> u32 {
        self.opened.as_ref().map_or(1, |opened| opened.window.scale_factor().round().max(1.0) as u32)
    }

    fn open(&mut self, event_loop: &ActiveEventLoop) -> Result<(), Box<dyn std::error::Error>> {
        let [width, height] = self.state.finest().size;
        let size = PhysicalSize::new(width, height + line::height_of(LINES, 1));
        let attributes = Window::default_attributes()
            .with_title(format!("rayo: {}", self.source.path))
            .with_inner_size(size)
            .with_min_inner_size(PhysicalSize::new(1, 1));
        let window = Rc::new(event_loop.create_window(attributes)?);
        let surface = Surface::new(&self.context, Rc::clone(&window))?;
        let size = window.inner_size();
        self.opened = Some(Opened { window, surface, size: PhysicalSize::default() });
        self.resize(size)?;
        Ok(())
    }

    /// Takes another size of the window: the picture has what the lines of text leave.
    fn resize(&mut self, size: PhysicalSize<u32>) -> Result<(), softbuffer::SoftBufferError> {
        let below = line::height_of(LINES, self.scale());
        let Some(opened) = &mut self.opened else { return Ok(()) };
        opened.size = size;
        if let (Some(width), Some(height)) = (NonZeroU32::new(size.width), NonZeroU32::new(size.height)) {
            opened.surface.resize(width, height)?;
        }
        self.state.resize([size.width, size.height.saturating_sub(below)], Instant::now());
        self.log(|| format!("size {}x{}", size.width, size.height));
        Ok(())
    }

    /// Draws the film and the lines of text into the window.
    fn present(&mut self) -> Result<(), softbuffer::SoftBufferError> {
        let scale = self.scale();
        let lines = [self.state.figures(), self.state.message().unwrap_or(HELP).to_owned()];
        let Some(Opened { window, surface, size }) = &mut self.opened else { return Ok(()) };
        let (width, height) = (size.width as usize, size.height as usize);
        if width == 0 || height == 0 {
            return Ok(());
        }
        let mut buffer = surface.buffer_mut()?;
        if buffer.len() != width * height {
            // The size has changed, and the event that says so is yet to come.
            return Ok(());
        }
        let below = (line::height_of(LINES, scale) as usize).min(height) * width;
        let (picture, rows) = buffer.split_at_mut(width * height - below);
        match &self.film {
            Some((wish, Film::Bgra8(pixels))) => copy(wish, pixels, width, picture),
            _ => picture.fill(0),
        }
        line::draw(&lines.each_ref().map(String::as_str), scale, width, rows);
        window.pre_present_notify();
        buffer.present()
    }

    /// Requests the picture that is due, and has the event loop wake up for the next one.
    fn proceed(&mut self, event_loop: &ActiveEventLoop) {
        let now = Instant::now();
        // Nothing is traced for a window that cannot be seen.
        if self.is_hidden {
            return event_loop.set_control_flow(ControlFlow::Wait);
        }
        if let Some((wish, cancel)) = self.state.next_wish(now) {
            let spare = self.spare.take();
            self.ask(Request::Draw { wish, cancel, spare });
        }
        event_loop.set_control_flow(self.state.due(now).map_or(ControlFlow::Wait, ControlFlow::WaitUntil));
    }

    /// Sends a request to the worker, which ends before the window only by a panic.
    fn ask(&mut self, request: Request) {
        if self.requests.send(request).is_err() {
            self.failure = Some("the thread that traces has ended".into());
        }
    }

    /// Takes the replies of the worker.
    fn take_replies(&mut self) {
        while let Ok(reply) = self.replies.try_recv() {
            let now = Instant::now();
            match reply {
                Reply::Drawn { wish, film, times } => {
                    self.state.arrived(Some(times), now);
                    self.spare = self.film.replace((wish, film)).map(|(_, film)| film);
                    self.pictures += 1;
                    self.log(|| format!("picture {}: {}", self.pictures, self.state.figures()));
                }
                Reply::Stopped => self.state.arrived(None, now),
                Reply::Failed(why) => {
                    self.state.arrived(None, now);
                    self.log(|| format!("failed: {why}"));
                    self.state.tell(why);
                }
                Reply::Told { line, printed } => {
                    println!("{printed}");
                    self.state.tell(line);
                }
            }
            self.redraw();
        }
        if self.state.rests() {
            self.log(|| format!("rests at picture {}", self.pictures));
        }
    }

    /// Has the picture written to a file. The one that is being traced is cancelled, since the
    /// worker would finish it first.
    fn write(&mut self) {
        let wish = self.state.finest();
        let cancel = self.state.begin_to_write();
        self.ask(Request::Write { wish, cancel });
    }

    fn redraw(&self) {
        if let Some(opened) = &self.opened {
            opened.window.request_redraw();
        }
    }

    fn key(&mut self, event_loop: &ActiveEventLoop, key: Key<&str>) {
        let command = match key {
            Key::Named(NamedKey::Escape) | Key::Character("q") => return event_loop.exit(),
            Key::Character("w") => return self.write(),
            Key::Character("c") => {
                print!("{}", camera_in_toml(&self.scene_camera, &self.state.finest()));
                return self.state.tell("printed the camera in TOML");
            }
            Key::Named(NamedKey::Space) => Some(Command::GoRound),
            Key::Named(NamedKey::Home) => Some(Command::Home),
            Key::Named(NamedKey::ArrowLeft) => Some(Command::Left),
            Key::Named(NamedKey::ArrowRight) => Some(Command::Right),
            Key::Named(NamedKey::ArrowUp) => Some(Command::Up),
            Key::Named(NamedKey::ArrowDown) => Some(Command::Down),
            Key::Named(NamedKey::PageUp) => Some(Command::Nearer),
            Key::Named(NamedKey::PageDown) => Some(Command::Farther),
            Key::Character(text) => text.chars().next().and_then(Command::of_character),
            _ => None,
        };
        if let Some(command) = command {
            self.state.obey(command, Instant::now());
            self.log(|| format!("key {command:?}: {}", self.state.message().unwrap_or("done")));
        }
    }

    fn pointer_moved(&mut self, to: PhysicalPosition<f64>) {
        let (across, down) = (to.x - self.pointer.x, to.y - self.pointer.y);
        self.pointer = to;
        let Some(held) = &mut self.held else { return };
        let was_dragging = held.drags;
        held.drags |= (to.x - held.from.x).hypot(to.y - held.from.y) > CLICK;
        if !held.drags {
            return;
        }
        // The first step of a drag makes up for the moves that were still within a click.
        let (across, down) = if was_dragging { (across, down) } else { (to.x - held.from.x, to.y - held.from.y) };
        match held.button {
            MouseButton::Left => self.state.drag(across, down, Instant::now()),
            _ => self.state.drag_across(across, down, Instant::now()),
        }
        self.redraw();
    }

    fn button(&mut self, button: MouseButton, state: ElementState) {
        if state == ElementState::Pressed {
            self.held = Some(Held { button, from: self.pointer, drags: false });
            return;
        }
        let Some(held) = self.held.take_if(|held| held.button == button) else { return };
        let wish = self.state.finest();
        let [column, row] = [self.pointer.x, self.pointer.y].map(|at| at as u32);
        let is_in_picture = column < wish.size[0] && row < wish.size[1];
        if button == MouseButton::Left && !held.drags && is_in_picture {
            self.state.stop();
            self.ask(Request::Name { wish, pixel: [column, row] });
        }
    }

    fn event(&mut self, event_loop: &ActiveEventLoop, event: WindowEvent) -> Result<(), softbuffer::SoftBufferError> {
        match event {
            WindowEvent::CloseRequested => event_loop.exit(),
            WindowEvent::Resized(size) => self.resize(size)?,
            WindowEvent::ScaleFactorChanged { .. } => {
                if let Some(size) = self.opened.as_ref().map(|opened| opened.window.inner_size()) {
                    self.resize(size)?;
                }
            }
            WindowEvent::Occluded(is_hidden) => {
                self.is_hidden = is_hidden;
                self.log(|| format!("hidden {is_hidden}"));
            }
            WindowEvent::Focused(is_focused) => self.log(|| format!("focused {is_focused}")),
            WindowEvent::KeyboardInput { event, .. } if event.state == ElementState::Pressed => {
                self.key(event_loop, event.logical_key.as_ref());
                self.redraw();
            }
            WindowEvent::CursorMoved { position, .. } => self.pointer_moved(position),
            WindowEvent::MouseInput { state, button, .. } => self.button(button, state),
            WindowEvent::MouseWheel { delta, .. } => {
                let notches = match delta {
                    MouseScrollDelta::LineDelta(_, lines) => lines.into(),
                    MouseScrollDelta::PixelDelta(pixels) => pixels.y / PIXELS_OF_A_NOTCH,
                };
                self.state.wheel(notches, Instant::now());
                self.redraw();
            }
            WindowEvent::RedrawRequested => self.present()?,
            _ => {}
        }
        Ok(())
    }
}

/// Copies a picture to the upper rows of a window of `width` pixels, where each of its pixels is a
/// square.
fn copy(wish: &Wish, pixels: &[u32], width: usize, picture: &mut [u32]) {
    let side = wish.coarseness as usize;
    let across = (wish.size[0] as usize).div_ceil(side);
    for (row, out) in picture.chunks_exact_mut(width).enumerate() {
        // A picture traced before the window grew leaves the rest of it black.
        let from = pixels.chunks_exact(across).nth(row / side).unwrap_or(&[]);
        if side == 1 && from.len() == out.len() {
            out.copy_from_slice(from);
            continue;
        }
        let mut filled = 0;
        for (out, pixel) in out.chunks_mut(side).zip(from) {
            out.fill(*pixel);
            filled += out.len();
        }
        out[filled..].fill(0);
    }
}

impl ApplicationHandler for App<'_> {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.opened.is_none() && self.open(event_loop).is_err() {
            self.failure = Some(crate::display::cannot_be_opened());
            event_loop.exit();
        }
    }

    fn user_event(&mut self, _: &ActiveEventLoop, (): ()) {
        self.take_replies();
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        if self.event(event_loop, event).is_err() {
            self.failure = Some("the display takes no more pictures".into());
        }
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        if self.failure.is_some() {
            return event_loop.exit();
        }
        self.proceed(event_loop);
    }
}

#[cfg(test)]
mod tests {
    use rayo::{Engine, Precision, View};

    use super::*;
    use crate::state::Tracing;

    #[test]
    fn pixels_of_coarse_pictures_are_squares_and_cut_at_the_edges() {
        let tracing = Tracing {
            engine: Engine::Reference,
            precision: Precision::Double,
            shadows: false,
            keeps_all: false,
            threads: 1,
        };
        let wish = Wish { view: View::default(), size: [5, 3], coarseness: 2, tracing };
        let mut picture = [9; 15];
        copy(&wish, &[1, 2, 3, 4, 5, 6], 5, &mut picture);
        assert_eq!(picture, [1, 1, 2, 2, 3, 1, 1, 2, 2, 3, 4, 4, 5, 5, 6]);
        // A window that has grown since.
        let mut larger = [9; 28];
        copy(&wish, &[1, 2, 3, 4, 5, 6], 7, &mut larger);
        assert_eq!(larger[..7], [1, 1, 2, 2, 3, 3, 0]);
        assert_eq!(larger[21..], [4, 4, 5, 5, 6, 6, 0]);
    }
}
