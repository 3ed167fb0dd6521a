//! What the window shows, as text: commands of `rayo` for the same picture, and the camera in TOML.

use std::path::Path;

use rayo::glam::DVec3;
use rayo::{Camera, Engine, Isa, View};

use crate::state::{Tracing, Wish};

/// What commands of `rayo` need to know of the scene's file.
pub struct Source {
    /// The file, as it was given to the program.
    pub path: String,
    /// How the names of the files begin that pictures are written to.
    pub stem: String,
    /// The view that the file has.
    pub view: View,
    /// Whether its file has shadows.
    pub shadows: bool,
    /// The index of the light that moves with the camera, if there is one.
    pub carried_light: Option<usize>,
    /// The options for a file alone, as arguments of `rayo`, each after a space.
    pub model: String,
}

impl Source {
    /// The arguments of `rayo` for a picture: the file, and what differs from what it says.
    fn arguments(&self, scene_camera: &Camera, wish: &Wish) -> String {
        let camera = wish.camera(scene_camera);
        let mut arguments = quoted(&self.path);
        arguments += &self.model;
        let [width, height] = wish.size;
        arguments += &format!(" --size {width}x{height} --film {} --focal {}", camera.film(), camera.focal());
        if wish.tracing.shadows && !self.shadows {
            arguments += " --shadows";
        }
        // The view of a mesh alone depends on the shape of the picture, so that the file does not
        // fix it.
        if wish.view != self.view || self.carried_light.is_some() || !self.model.is_empty() {
            let View { position, look_at, up } = wish.view;
            for (name, point) in [("position", position), ("look-at", look_at), ("up", up)] {
                arguments += &format!(" --{name} {}", numbers(point, ","));
            }
        }
        arguments
    }

    /// The command that writes the picture to `path`.
    pub fn render_command(&self, scene_camera: &Camera, wish: &Wish, path: &Path) -> String {
        let Tracing { engine, precision, keeps_all, .. } = wish.tracing;
        let arguments = self.arguments(scene_camera, wish);
        let keep_all = if keeps_all { " --keep-all" } else { "" };
        let path = quoted(&path.display().to_string());
        format!("rayo render {arguments} --engine {engine} --precision {precision}{keep_all} -o {path}")
    }

    /// The command that follows the ray of a pixel, with the engine of the picture if `rayo step`
    /// takes it.
    pub fn step_command(&self, scene_camera: &Camera, wish: &Wish, [column, row]: [u32; 2]) -> String {
        let Tracing { engine, precision, .. } = wish.tracing;
        let arguments = self.arguments(scene_camera, wish);
        let has_steps = matches!(engine, Engine::Paper | Engine::Packet(Isa::Sse41 | Isa::Avx2 | Isa::Avx512));
        let engine =
            if has_steps { format!("--engine {engine} --precision {precision}") } else { "--engine auto".into() };
        format!("rayo step {arguments} --pixel {column},{row} {engine}")
    }
}

/// The camera of a picture as the tables `[image]` and `[camera]` of a scene in TOML.
pub fn camera_in_toml(scene_camera: &Camera, wish: &Wish) -> String {
    let camera = wish.camera(scene_camera);
    let [width, height] = wish.size;
    let mut text = format!("[image]\nwidth = {width}\nheight = {height}\n\n");
    text += &format!("[camera]\nfocal = {}\nfilm = {}\n", camera.focal(), camera.film());
    let View { position, look_at, up } = wish.view;
    for (name, point) in [("position", position), ("look_at", look_at), ("up", up)] {
        text += &format!("{name} = [{}]\n", numbers(point, ", "));
    }
    text
}

/// The coordinates with as many digits as it takes to read the same numbers again.
fn numbers(point: DVec3, between: &str) -> String {
    point.to_array().map(|number| number.to_string()).join(between)
}

/// A word as a POSIX shell takes it: quoted, unless all its characters are plain.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "/._-+,:=@%".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.into()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use rayo::Precision;

    use super::*;

    fn source(path: &str) -> Source {
        Source {
            path: path.into(),
            stem: "x".into(),
            view: View::default(),
            shadows: false,
            carried_light: None,
            model: String::new(),
        }
    }

    fn wish(view: View) -> Wish {
        let tracing = Tracing {
            engine: Engine::Reference,
            precision: Precision::Double,
            shadows: true,
            keeps_all: true,
            threads: 2,
        };
        Wish { view, size: [1280, 720], coarseness: 1, tracing }
    }

    #[test]
    fn a_command_says_all_that_differs_from_the_file() {
        let scene_camera = Camera::new(1280, 720, 2.0, 1.5).unwrap();
        let command = source("a scene.in").render_command(&scene_camera, &wish(View::default()), Path::new("x.png"));
        let arguments = "'a scene.in' --size 1280x720 --film 1.5 --focal 2 --shadows";
        assert_eq!(
            command,
            format!("rayo render {arguments} --engine reference --precision double --keep-all -o x.png")
        );
        let away = View { position: DVec3::new(0.5, -1.0, 1e-7), look_at: DVec3::Z, up: DVec3::Y };
        let command = source("it's.in").step_command(&scene_camera, &wish(away), [7, 9]);
        let moved = "--position 0.5,-1,0.0000001 --look-at 0,0,1 --up 0,1,0";
        let expected = format!(r"rayo step 'it'\''s.in' --size 1280x720 --film 1.5 --focal 2 --shadows {moved}");
        assert_eq!(command, format!("{expected} --pixel 7,9 --engine auto"));
    }

    #[test]
    fn the_camera_in_toml_is_that_of_the_picture() {
        let scene_camera = Camera::new(640, 360, 1.0, 1.5).unwrap();
        let view = View { position: DVec3::new(1.0, 2.0, -3.5), look_at: DVec3::ZERO, up: DVec3::Y };
        let text = camera_in_toml(&scene_camera, &wish(view));
        let scene = format!("{text}\n[[sphere]]\ncentre = [0, 0, 0]\nradius = 1\n")
            .replace("[image]\n", "[image]\nfile = \"x.png\"\n");
        let read = rayo::parse_toml(scene.as_bytes(), "a camera", Path::new("")).unwrap().scene;
        assert_eq!((read.view, read.camera), (view, Camera::new(1280, 720, 1.0, 1.5).unwrap()));
    }
}
