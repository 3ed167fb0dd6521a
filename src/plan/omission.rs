//! Omissions: which work is left out, by name, the reason of each, and the set of those that are not to be made.

/// Work that a picture does not need, decided once, before the first ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Omission {
    /// Objects with no point in front of the camera.
    Behind,
    /// Objects beside, above or below all rays: frustum culling.
    Outside,
    /// Objects whose bounds contain no pixel's centre.
    Between,
    /// Triangles of no area.
    NoArea,
    /// Triangles whose plane passes through the camera.
    EdgeOn,
    /// Lights of no intensity or no colour.
    DarkLights,
    /// Tiles that no object's bounds meet.
    EmptyTiles,
    /// Objects in tiles that their bounds do not meet.
    OtherTiles,
    /// The set-up of objects behind the hierarchical depth of nearer ones in their tile: occlusion culling.
    Occluded,
    /// Tests of rays that cannot hit an object.
    Misses,
    /// The search for the nearest hit if there is only one object.
    Search,
    /// The shading of hits that are not the nearest.
    Hidden,
    /// The shading of a tile's objects that are nearest at none of its pixels.
    Unseen,
    /// The second and third channel if all three are equal.
    Channels,
    /// The loop over lights, and the point and the normal, if one light reaches a sphere.
    Loop,
    /// A picture in floats on the way to 8 bits.
    FloatImage,
    /// The code for spheres, in a scene with none visible.
    SphereCode,
    /// The code for triangles, in a scene with none visible.
    TriangleCode,
    /// Terms that are the same for every ray.
    Constants,
}

/// How a picture can be made without an omission.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Switch {
    /// The same picture with more work: `--keep-all` makes it.
    Work,
    /// Other arithmetic, and so a picture that may differ in its last bit; done only to see what the omission is worth.
    Arithmetic,
    /// Not at all: there is no code for it.
    None,
}

impl Omission {
    /// All of them, in the order of reports.
    pub const ALL: [Omission; 19] = [
        Omission::Behind,
        Omission::Outside,
        Omission::NoArea,
        Omission::EdgeOn,
        Omission::Between,
        Omission::DarkLights,
        Omission::SphereCode,
        Omission::TriangleCode,
        Omission::EmptyTiles,
        Omission::OtherTiles,
        Omission::Occluded,
        Omission::Misses,
        Omission::Search,
        Omission::Hidden,
        Omission::Unseen,
        Omission::Constants,
        Omission::Loop,
        Omission::Channels,
        Omission::FloatImage,
    ];

    /// The omitted work, as a count of it reads.
    pub fn what(self) -> &'static str {
        match self {
            Omission::Behind => "objects behind the camera",
            Omission::Outside => "objects outside the frustum",
            Omission::Between => "objects between rays",
            Omission::NoArea => "triangles of no area",
            Omission::EdgeOn => "triangles seen edge on",
            Omission::DarkLights => "dark lights",
            Omission::SphereCode => "code for spheres",
            Omission::TriangleCode => "code for triangles",
            Omission::EmptyTiles => "tiles with nothing in them",
            Omission::OtherTiles => "objects in other tiles",
            Omission::Occluded => "set-up of hidden objects",
            Omission::Misses => "tests of rays that miss",
            Omission::Search => "searches for the nearest",
            Omission::Hidden => "shading of hidden hits",
            Omission::Unseen => "shading of what is not seen",
            Omission::Constants => "constant terms",
            Omission::Loop => "loops over lights",
            Omission::Channels => "equal channels",
            Omission::FloatImage => "float image",
        }
    }

    /// Why nothing is lost by it.
    pub fn reason(self) -> &'static str {
        match self {
            Omission::Behind => "no ray looks back, and no point of them is in front of the camera",
            Omission::Outside => "they are beside, above or below every ray of the picture",
            Omission::Between => "they are in the picture, but pass between its rays",
            Omission::NoArea => "their corners are on one line, so no ray hits them",
            Omission::EdgeOn => "their plane passes through the camera, so no ray hits them",
            Omission::DarkLights => "intensity times colour is 0",
            Omission::SphereCode => "the picture has no sphere",
            Omission::TriangleCode => "the picture has no triangle",
            Omission::EmptyTiles => "no object's bounds meet them: they are filled with black",
            Omission::OtherTiles => "an object is looked at in those tiles alone that its bounds meet",
            Omission::Occluded => {
                "no point of them is as near as the farthest pixel that the nearer half of their tile leaves"
            }
            Omission::Misses => "an object's outline bounds the pixels of each row that can see it",
            Omission::Search => "one object is alone in the pixel",
            Omission::Hidden => "the nearest hit of each pixel is known before any is shaded",
            Omission::Unseen => {
                "set up in a tile, they are nearest at none of its pixels, which is known before any is shaded"
            }
            Omission::Constants => {
                "every ray leaves the origin: c.c - r^2, planes and edges do not depend on it, more terms only on its row"
            }
            Omission::Loop => {
                "one light, no brighter than white, reaches the sphere: its cosine in closed form, without point, normal and clamp"
            }
            Omission::Channels => "one light reaches the sphere, and its red, green and blue are equal on it",
            Omission::FloatImage => "the file has 8 bits: colours become levels in registers",
        }
    }

    /// The unit of its count.
    pub fn unit(self) -> &'static str {
        match self {
            Omission::Behind | Omission::Outside | Omission::Between | Omission::Constants => "objects",
            Omission::NoArea | Omission::EdgeOn => "triangles",
            Omission::DarkLights => "lights",
            Omission::SphereCode | Omission::TriangleCode => "kinds",
            Omission::EmptyTiles => "tiles",
            Omission::OtherTiles | Omission::Unseen => "objects of tiles",
            Omission::Occluded => "objects of tiles",
            Omission::Misses => "rays against objects",
            Omission::Search | Omission::FloatImage => "pixels",
            Omission::Hidden => "hits",
            Omission::Loop | Omission::Channels => "objects",
        }
    }

    /// How a picture can be made without it.
    pub fn switch(self) -> Switch {
        match self {
            Omission::Loop | Omission::FloatImage => Switch::Arithmetic,
            Omission::NoArea
            | Omission::EdgeOn
            | Omission::DarkLights
            | Omission::SphereCode
            | Omission::TriangleCode
            | Omission::Search
            | Omission::Constants => Switch::None,
            _ => Switch::Work,
        }
    }
}

/// The omissions that are not to be made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Keep(u32);

impl Keep {
    /// All omissions are made.
    pub const NOTHING: Keep = Keep(0);

    /// No omission is made that keeps the arithmetic: brute force, with the same bytes.
    pub fn all() -> Keep {
        let work = Omission::ALL.into_iter().filter(|omission| omission.switch() == Switch::Work);
        work.fold(Keep::NOTHING, Keep::and)
    }

    /// One alone is not made.
    pub const fn only(omission: Omission) -> Keep {
        Keep(1 << omission as u32)
    }

    /// One more is not made.
    pub fn and(self, omission: Omission) -> Keep {
        Keep(self.0 | Keep::only(omission).0)
    }

    /// Whether the work of `omission` is to be done.
    pub const fn has(self, omission: Omission) -> bool {
        self.0 & Keep::only(omission).0 != 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_omission_is_listed_once_and_has_a_bit_of_its_own() {
        for (i, omission) in Omission::ALL.into_iter().enumerate() {
            assert_eq!(Omission::ALL.iter().position(|other| *other == omission), Some(i));
            let others = Omission::ALL.into_iter().filter(|other| Keep::only(omission).has(*other));
            assert!(others.eq([omission]), "{omission:?}");
            assert_eq!(Keep::all().has(omission), omission.switch() == Switch::Work, "{omission:?}");
        }
        assert_eq!(Omission::ALL.into_iter().max().unwrap() as usize + 1, Omission::ALL.len());
    }
}
