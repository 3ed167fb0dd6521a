//! Writing a scene, or a mesh and its setting, as text in TOML; reading it restores the scene to
//! the last bit.

use std::fmt::{self, Display, Write};

use glam::{DVec3, Vec3};

use super::setting::WorldLight;
use super::write::Decimal;
use super::{Camera, Scene, Setting, Sphere, Triangle};

impl Scene {
    /// The scene in TOML, with the camera in its default view, so that every number is the scene's
    /// own.
    ///
    /// [`parse_toml`](super::parse_toml()) restores the same scene, bit by bit, if its name is not
    /// empty.
    pub fn to_toml(&self) -> String {
        let mut text = String::new();
        self.write_toml(&mut text).expect("a String takes all that is written to it");
        text
    }

    fn write_toml(&self, out: &mut String) -> fmt::Result {
        write_image(out, &self.name, &self.camera)?;
        if self.shadows {
            writeln!(out, "shadows = true")?;
        }
        write_lens(out, &self.camera)?;
        for light in &self.lights {
            writeln!(out, "\n[[light]]\nposition = {}", Array(light.position))?;
            writeln!(out, "colour = {}\nintensity = {}", Array(light.colour), Decimal(light.intensity))?;
        }
        for Sphere { radius, colour, centre } in &self.spheres {
            writeln!(out, "\n[[sphere]]\ncentre = {}\nradius = {}", Array(*centre), Decimal(*radius))?;
            writeln!(out, "colour = {}", Array(*colour))?;
        }
        for Triangle { colour, vertices: [a, b, c] } in self.all_triangles() {
            writeln!(out, "\n[[triangle]]\nvertices = [{}, {}, {}]", Array(a), Array(b), Array(c))?;
            writeln!(out, "colour = {}", Array(colour))?;
        }
        Ok(())
    }
}

impl Setting {
    /// The scene of a mesh file in TOML. The text refers to the mesh by the path `file`; `name` is
    /// the name of the picture.
    ///
    /// Reading the text gives the scene that [`Setting::scene`] returns for the same mesh.
    pub fn to_toml(&self, file: &str, name: &str) -> String {
        let mut text = String::new();
        self.write_toml(&mut text, file, name).expect("a String takes all that is written to it");
        text
    }

    fn write_toml(&self, out: &mut String, file: &str, name: &str) -> fmt::Result {
        let Setting { placement, view, camera, colour, .. } = self;
        write_image(out, name, camera)?;
        if self.shadows {
            writeln!(out, "shadows = true")?;
        }
        write_lens(out, camera)?;
        for (key, point) in [("position", view.position), ("look_at", view.look_at), ("up", view.up)] {
            writeln!(out, "{key} = {}", Array(point))?;
        }
        for WorldLight { intensity, colour, position } in &self.lights {
            writeln!(out, "\n[[light]]\nposition = {}\ncolour = {}", Array(*position), Array(*colour))?;
            writeln!(out, "intensity = {}", Decimal(*intensity))?;
        }
        writeln!(out, "\n[[mesh]]\nfile = {}\ncolour = {}", quoted(file), Array(*colour))?;
        writeln!(out, "scale = {}  # files are right-handed: -1 makes z point away", Array(placement.scale))?;
        for (key, point) in [("rotate", placement.rotate), ("translate", placement.translate)] {
            writeln!(out, "{key} = {}", Array(point))?;
        }
        Ok(())
    }
}

fn write_image(out: &mut String, name: &str, camera: &Camera) -> fmt::Result {
    writeln!(out, "[image]\nfile = {}", quoted(name))?;
    writeln!(out, "width = {}\nheight = {}", camera.width(), camera.height())
}

fn write_lens(out: &mut String, camera: &Camera) -> fmt::Result {
    writeln!(out, "\n[camera]\nfocal = {}\nfilm = {}", Decimal(camera.focal()), Decimal(camera.film()))
}

/// A string in TOML. JSON escapes the same characters, except U+007F.
fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string().replace('\u{7f}', "\\u007f")
}

/// Three numbers as a TOML array.
struct Array<T>(T);

impl Display for Array<Vec3> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.0.to_array().map(Decimal);
        write!(f, "[{x}, {y}, {z}]")
    }
}

impl Display for Array<DVec3> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.0.to_array();
        write!(f, "[{x}, {y}, {z}]")
    }
}
