//! The packed types that Rust, C and NASM share. layout.inc has their offsets, which records.rs
//! asserts.

/// Types that consist only of numbers: every bit pattern is a value, and there is no padding.
///
/// # Safety
/// Both must be true, so that kernels may write any bits and safe code may read them.
pub unsafe trait Plain: Copy + 'static {
    /// The value whose bits are all 0.
    const ZERO: Self;
}

/// The bytes of values, in the machine's byte order.
pub fn bytes<T: Plain>(values: &[T]) -> &[u8] {
    // SAFETY: no byte of a plain type is padding, and any address is aligned for bytes.
    unsafe { std::slice::from_raw_parts(values.as_ptr().cast(), size_of_val(values)) }
}

/// A vector of three numbers in one 128-bit register: x, y, z, and a `w` that is 0 wherever the
/// paper's macros expect a vector.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(16))]
pub struct Vec4 {
    /// First lane.
    pub x: f32,
    /// Second lane.
    pub y: f32,
    /// Third lane.
    pub z: f32,
    /// Fourth lane.
    pub w: f32,
}

/// The rays of an image in f32, lines 1 to 4 of Algorithm 1, and the colour that its pixels begin
/// with.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Frame {
    /// The light of a ray that hits nothing. The ladder's variants of Algorithm 1 ignore it and use
    /// black, and ignore `first` and use 0.
    pub background: Vec4,
    /// The side of a pixel on the film.
    pub step: f32,
    /// Half of the film's width.
    pub half_width: f32,
    /// Half of the film's height.
    pub half_height: f32,
    /// The focal distance.
    pub focal: f32,
    /// The column of a row's first pixel.
    pub first: u64,
    /// The number of pixels in a row.
    pub width: u64,
}

/// A point light.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(16))]
pub struct Light {
    /// The light's position.
    pub position: Vec4,
    /// I_L = intensity x colour, finite.
    pub radiance: Vec4,
}

/// A sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(16))]
pub struct PaperSphere {
    pub centre: Vec4,
    pub colour: Vec4,
    pub radius: f32,
    /// Unused; makes the size a multiple of 16.
    pub padding: [f32; 3],
}

/// A triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(16))]
pub struct PaperTriangle {
    /// First vertex.
    pub v1: Vec4,
    /// Second vertex.
    pub v2: Vec4,
    /// Third vertex.
    pub v3: Vec4,
    pub colour: Vec4,
}

/// What the Lambert term needs to know about a hit.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(16))]
pub struct Surface {
    /// P, the point hit.
    pub point: Vec4,
    /// N, of length 1.
    pub normal: Vec4,
    /// C, the colour.
    pub colour: Vec4,
}

/// The lights and objects of a scene, in the scene's order.
#[derive(Clone, Copy, Debug)]
pub struct Objects<'a> {
    pub lights: &'a [Light],
    /// All spheres; they come before the triangles.
    pub spheres: &'a [PaperSphere],
    pub triangles: &'a [PaperTriangle],
}

impl Vec4 {
    /// A vector of three numbers, with w = 0.
    pub fn new(x: f32, y: f32, z: f32) -> Self {
        Vec4 { x, y, z, w: 0.0 }
    }

    /// The four lanes.
    pub fn lanes(self) -> [f32; 4] {
        [self.x, self.y, self.z, self.w]
    }
}

impl From<[f32; 4]> for Vec4 {
    fn from([x, y, z, w]: [f32; 4]) -> Self {
        Vec4 { x, y, z, w }
    }
}

impl From<glam::Vec3> for Vec4 {
    fn from(v: glam::Vec3) -> Self {
        Vec4::new(v.x, v.y, v.z)
    }
}

macro_rules! plain {
    ($($type:ty = $zero:expr),* $(,)?) => {
        $(
            // SAFETY: the type consists of numbers that leave no padding, as the offsets asserted
            // in records.rs show.
            unsafe impl Plain for $type {
                const ZERO: Self = $zero;
            }
        )*
    };
}

const ORIGIN: Vec4 = Vec4 { x: 0.0, y: 0.0, z: 0.0, w: 0.0 };

plain! {
    f32 = 0.0,
    f64 = 0.0,
    u32 = 0,
    u8 = 0,
    [u8; 4] = [0; 4],
    [u8; 3] = [0; 3],
    [f32; 3] = [0.0; 3],
    [u32; 3] = [0; 3],
    glam::Vec3 = glam::Vec3::ZERO,
    Vec4 = ORIGIN,
    Frame = Frame { background: ORIGIN, step: 0.0, half_width: 0.0, half_height: 0.0, focal: 0.0, first: 0, width: 0 },
    Light = Light { position: ORIGIN, radiance: ORIGIN },
    PaperSphere = PaperSphere { centre: ORIGIN, colour: ORIGIN, radius: 0.0, padding: [0.0; 3] },
    PaperTriangle = PaperTriangle { v1: ORIGIN, v2: ORIGIN, v3: ORIGIN, colour: ORIGIN },
    Surface = Surface { point: ORIGIN, normal: ORIGIN, colour: ORIGIN },
}
