//! A scene as text, in the paper's format and in TOML, such that reading it gives the same scene to the last bit.

use std::fmt::{self, Display, Write};

use glam::{DVec3, Vec3};

use super::parse::is_space;
use super::{Camera, Light, Scene, Setting, Sphere, Triangle};

impl Scene {
    /// The scene in the paper's format, with a comment above each section.
    ///
    /// [`parse`](super::parse()) gives back the same scene, bit by bit, if it is one that `parse` could have made. The
    /// format has no place for a film diagonal other than 1 (a comment tells it), nor for white space and comment
    /// marks in the image name: `_` replaces them, and an empty name is written as `image`.
    pub fn to_text(&self) -> String {
        let mut text = String::new();
        self.write(&mut text).expect("a String takes all that is written to it");
        text
    }

    fn write(&self, out: &mut String) -> fmt::Result {
        let camera = &self.camera;
        writeln!(out, "# image name\n{}", writable(&self.name))?;
        writeln!(out, "\n# width and height\n{} {}", camera.width(), camera.height())?;
        writeln!(out, "\n# focal distance\n{}", Decimal(camera.focal()))?;
        if camera.film() != 1.0 {
            writeln!(out, "# (for a film diagonal of {}, which is not part of this format)", Decimal(camera.film()))?;
        }

        writeln!(out, "\n# lights: how many, then of each  intensity  r g b  x y z\n{}", self.lights.len())?;
        for light in &self.lights {
            writeln!(out, "{}  {}  {}", Decimal(light.intensity), Triple(light.colour), Triple(light.position))?;
        }
        writeln!(out, "\n# spheres: how many, then of each  radius  r g b  x y z\n{}", self.spheres.len())?;
        for Sphere { radius, colour, centre } in &self.spheres {
            writeln!(out, "{}  {}  {}", Decimal(*radius), Triple(*colour), Triple(*centre))?;
        }
        let parts = "r g b  x1 y1 z1  x2 y2 z2  x3 y3 z3";
        writeln!(out, "\n# triangles: how many, then of each  {parts}\n{}", self.triangles.len())?;
        for Triangle { colour, vertices: [a, b, c] } in &self.triangles {
            writeln!(out, "{}  {}  {}  {}", Triple(*colour), Triple(*a), Triple(*b), Triple(*c))?;
        }
        Ok(())
    }
}

impl Scene {
    /// The scene in TOML: its camera at rest, so that every number is the scene's own.
    ///
    /// [`parse_toml`](super::parse_toml()) gives back the same scene, bit by bit, if its name is not empty.
    pub fn to_toml(&self) -> String {
        let mut text = String::new();
        self.write_toml(&mut text).expect("a String takes all that is written to it");
        text
    }

    fn write_toml(&self, out: &mut String) -> fmt::Result {
        write_image(out, &self.name, &self.camera)?;
        write_lens(out, &self.camera)?;
        for light in &self.lights {
            write_light(out, light)?;
        }
        for Sphere { radius, colour, centre } in &self.spheres {
            writeln!(out, "\n[[sphere]]\ncentre = {}\nradius = {}", Array(*centre), Decimal(*radius))?;
            writeln!(out, "colour = {}", Array(*colour))?;
        }
        for Triangle { colour, vertices: [a, b, c] } in &self.triangles {
            writeln!(out, "\n[[triangle]]\nvertices = [{}, {}, {}]", Array(*a), Array(*b), Array(*c))?;
            writeln!(out, "colour = {}", Array(*colour))?;
        }
        Ok(())
    }
}

impl Setting {
    /// The scene of a mesh file in TOML, which names the file; `name` is that of the picture.
    ///
    /// Reading it gives the scene that [`Setting::scene`] makes of the same mesh in white.
    pub fn to_toml(&self, file: &str, name: &str, camera: &Camera) -> String {
        let mut text = String::new();
        self.write_toml(&mut text, file, name, camera).expect("a String takes all that is written to it");
        text
    }

    fn write_toml(&self, out: &mut String, file: &str, name: &str, camera: &Camera) -> fmt::Result {
        let Setting { placement, view, light } = self;
        write_image(out, name, camera)?;
        write_lens(out, camera)?;
        for (key, point) in [("position", view.position), ("look_at", view.look_at), ("up", view.up)] {
            writeln!(out, "{key} = {}", Array(point))?;
        }
        writeln!(out, "\n[[light]]\nposition = {}\ncolour = [1, 1, 1]\nintensity = 1", Array(*light))?;
        writeln!(out, "\n[[mesh]]\nfile = {}\ncolour = [1, 1, 1]", quoted(file))?;
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

fn write_light(out: &mut String, light: &Light) -> fmt::Result {
    writeln!(out, "\n[[light]]\nposition = {}", Array(light.position))?;
    writeln!(out, "colour = {}\nintensity = {}", Array(light.colour), Decimal(light.intensity))
}

/// A string in TOML; JSON's are the same but for one character.
fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string().replace('\u{7f}', "\\u007f")
}

/// Three numbers in TOML.
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

/// The shortest decimal that is read as the same f32, with an exponent where the zeros would be many.
struct Decimal(f32);

struct Triple(Vec3);

impl fmt::Display for Decimal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Decimal(number) = *self;
        if number == 0.0 || (1e-5..1e9).contains(&number.abs()) {
            write!(f, "{number}")
        } else {
            write!(f, "{number:e}")
        }
    }
}

impl fmt::Display for Triple {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Triple(Vec3 { x, y, z }) = *self;
        write!(f, "{} {} {}", Decimal(x), Decimal(y), Decimal(z))
    }
}

/// The name as one token that holds no comment.
fn writable(name: &str) -> String {
    if name.is_empty() {
        return "image".to_owned();
    }
    let blank = |c: char| c == '#' || u8::try_from(c).is_ok_and(is_space);
    name.replace(blank, "_").replace("//", "/_")
}
