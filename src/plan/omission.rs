//! Omissions: the names of the kinds of work that are left out, the reasons for them, and the set
//! of those that are switched off.

/// How the work of an omission can be done all the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Switch {
    /// By `--keep-all`, which makes the same picture with more work.
    Work,
    /// By other arithmetic, which may change the last bit of the picture. It is only done to
    /// measure what the omission gains.
    Arithmetic,
    /// Not at all: there is no code that does it.
    None,
}

/// Makes the enum and its functions from an entry for each omission: how the work can be done all
/// the same, the unit in which it is counted, the omitted work, and the reason.
macro_rules! omissions {
    ($($(#[$doc:meta])* $name:ident: $switch:ident, $unit:literal, $what:literal, $reason:literal;)*) => {
        /// A kind of work that a picture does not need, as decided before the first ray.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub enum Omission {
            $($(#[$doc])* $name,)*
        }

        impl Omission {
            /// All omissions, in the order of reports.
            pub const ALL: [Omission; [$($what),*].len()] = [$(Omission::$name),*];

            /// The omitted work, in words that follow a count.
            pub fn what(self) -> &'static str {
                match self { $(Omission::$name => $what,)* }
            }

            /// Why the picture does not need the work.
            pub fn reason(self) -> &'static str {
                match self { $(Omission::$name => $reason,)* }
            }

            /// The unit in which the omitted work is counted.
            pub fn unit(self) -> &'static str {
                match self { $(Omission::$name => $unit,)* }
            }

            /// How the work can be done all the same.
            pub fn switch(self) -> Switch {
                match self { $(Omission::$name => Switch::$switch,)* }
            }
        }
    };
}

omissions! {
    /// Objects with no point in front of the camera.
    Behind: Work, "objects", "objects behind the camera",
        "no ray looks back, and no point of them is in front of the camera";
    /// Objects beside, above or below all rays: frustum culling.
    Outside: Work, "objects", "objects outside the frustum", "they are beside, above or below every ray of the picture";
    /// Triangles of no area.
    NoArea: None, "triangles", "triangles of no area", "their corners are on one line, so no ray hits them";
    /// Triangles whose plane passes through the camera.
    EdgeOn: None, "triangles", "triangles seen edge on", "their plane passes through the camera, so no ray hits them";
    /// Objects whose bounds contain no pixel's centre.
    Between: Work, "objects", "objects between rays", "they are in the picture, but pass between its rays";
    /// Lights of no intensity or no colour.
    DarkLights: None, "lights", "dark lights", "intensity times colour is 0";
    /// The code for spheres, in a scene with none visible.
    SphereCode: None, "kinds", "code for spheres", "the picture has no sphere";
    /// The code for triangles, in a scene with none visible.
    TriangleCode: None, "kinds", "code for triangles", "the picture has no triangle";
    /// Tiles that no object's bounds meet.
    EmptyTiles: Work, "tiles", "tiles with nothing in them", "no object's bounds meet them: they are filled with black";
    /// Objects in tiles that their bounds do not meet.
    OtherTiles: Work, "objects of tiles", "objects in other tiles",
        "an object is considered only in the tiles that its bounds meet";
    /// The set-up of objects behind the hierarchical depth of nearer ones in their tile: occlusion
    /// culling.
    Occluded: Work, "objects of tiles", "set-up of hidden objects",
        "nearer objects of the tile are in front of them at every pixel that they may cover";
    /// Tests of rays that cannot hit an object.
    Misses: Work, "rays against objects", "tests of rays that miss",
        "an object's outline bounds the pixels of each row that can see it";
    /// The search for the nearest hit if there is only one object.
    Search: None, "pixels", "searches for the nearest", "one object is alone in the pixel";
    /// The shading of hits that are not the nearest.
    Hidden: Work, "pixels", "shading of hidden hits", "the nearest hit of each pixel is known before any is shaded";
    /// The shading of a tile's objects that are nearest at none of its pixels.
    Unseen: Work, "objects of tiles", "shading of what is not seen",
        "they are the nearest object at no pixel of the tile, which is known before any pixel is shaded";
    /// Shadow tests of points whose surface faces away from the light.
    Averted: None, "points and lights", "shadows of what faces away", "the law of shading has no light there to be hidden";
    /// Shadow tests against objects that are in no cell between the tile and the light.
    OtherCells: Work, "points against objects", "objects in other cells",
        "a point is tested only against objects that may lie between its tile and the light";
    /// Shadow tests in a scene of one object.
    Unhidden: None, "lights", "lights that nothing hides", "one object is alone, and hides no light from itself";
    /// Terms that are the same for every ray.
    Constants: None, "objects", "constant terms",
        "every ray leaves the origin: c.c - r^2, planes and edges do not depend on the ray, other terms only on \
         its row";
    /// The loop over lights, and the point and the normal, if one light reaches a sphere.
    Loop: Arithmetic, "objects", "loops over lights",
        "one light, no brighter than white, reaches the sphere: its cosine in closed form, without point, \
         normal and clamp";
    /// The second and third channel if all three are equal.
    Channels: Work, "objects", "equal channels",
        "one light reaches the sphere, and the red, green and blue that it adds are equal";
    /// A picture in floats on the way to 8 bits.
    FloatImage: Arithmetic, "pixels", "float image", "the file has 8 bits: colours become levels in registers";
}

/// The omissions that are switched off: their work is done although the picture does not need it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Keep(u32);

impl Keep {
    /// The empty set: every omission is made.
    pub const NOTHING: Keep = Keep(0);

    /// All omissions that are switched by [`Switch::Work`], which change no arithmetic: brute
    /// force, with the same bytes.
    pub fn all() -> Keep {
        let work = Omission::ALL.into_iter().filter(|omission| omission.switch() == Switch::Work);
        work.fold(Keep::NOTHING, Keep::and)
    }

    /// The set of one omission.
    pub const fn only(omission: Omission) -> Keep {
        Keep(1 << omission as u32)
    }

    /// The set with one more omission.
    pub fn and(self, omission: Omission) -> Keep {
        Keep(self.0 | Keep::only(omission).0)
    }

    /// Whether the set has this omission, so that its work is to be done.
    pub const fn has(self, omission: Omission) -> bool {
        self.0 & Keep::only(omission).0 != 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_omission_has_a_bit_of_its_own() {
        for (i, omission) in Omission::ALL.into_iter().enumerate() {
            assert_eq!(omission as usize, i);
            let others = Omission::ALL.into_iter().filter(|other| Keep::only(omission).has(*other));
            assert!(others.eq([omission]), "{omission:?}");
            assert_eq!(Keep::all().has(omission), omission.switch() == Switch::Work, "{omission:?}");
        }
    }
}
