//! Writing a scene as text in the paper's format; reading it restores the scene to the last bit.

use std::fmt::{self, Write};

use glam::Vec3;

use super::token::is_space;
use super::{Scene, Sphere, Triangle};

impl Scene {
    /// The scene in the paper's format, with a comment above each section.
    ///
    /// [`parse`](super::parse()) restores the same scene, bit by bit, if it is one that `parse`
    /// could have made. The format has no place for a film diagonal other than 1 and for shadows
    /// (comments give them), nor for white space and comment marks in the image name: `_` replaces
    /// them, and an empty name is written as `image`.
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
        if self.shadows {
            writeln!(out, "\n# (with shadows, which are not part of this format)")?;
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
        writeln!(out, "\n# triangles: how many, then of each  {parts}\n{}", self.triangle_count())?;
        for Triangle { colour, vertices: [a, b, c] } in self.all_triangles() {
            writeln!(out, "{}  {}  {}  {}", Triple(colour), Triple(a), Triple(b), Triple(c))?;
        }
        Ok(())
    }
}

/// The shortest decimal that is read as the same f32, with an exponent in place of many zeros.
pub(super) struct Decimal(pub(super) f32);

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

/// The name as one token without comment marks.
fn writable(name: &str) -> String {
    if name.is_empty() {
        return "image".to_owned();
    }
    let blank = |c: char| c == '#' || u8::try_from(c).is_ok_and(is_space);
    name.replace(blank, "_").replace("//", "/_")
}
