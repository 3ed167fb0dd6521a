//! The pinhole camera of Algorithm 1 in the paper: image size, focal distance and film, and the
//! grid of primary rays that they define.

use std::ops::{Add, Div, Mul, Sub};

use crate::kernels::StandardFloats;

/// The longest side of an image, in pixels.
pub const MAX_SIDE: u32 = 65_535;
/// The most pixels of an image.
pub const MAX_PIXELS: u64 = 1 << 31;

/// A pinhole at the origin looking along +z, and its film. A real film is behind the pinhole;
/// here it is in front, at z = focal distance.
///
/// Only [`Camera::new`] builds one, and it checks the limits, so every camera is valid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    width: u32,
    height: u32,
    focal: f32,
    film: f32,
}

/// Why there is no such camera.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum CameraError {
    /// A side is 0 or longer than [`MAX_SIDE`]: the width and the height.
    #[error("each side of an image must be from 1 to {MAX_SIDE} pixels, not {0}x{1}")]
    Side(u32, u32),
    /// More than [`MAX_PIXELS`] pixels: the width and the height.
    #[error("an image of {0}x{1} has more than {MAX_PIXELS} pixels")]
    Pixels(u32, u32),
    /// A focal distance that is not a finite number greater than 0.
    #[error("the focal distance must be a finite number greater than 0, not {0}")]
    Focal(f32),
    /// A diagonal of the film that is not a finite number greater than 0.
    #[error("the film diagonal must be a finite number greater than 0, not {0}")]
    Film(f32),
    /// A field of view that is not between 0 and 180 degrees.
    #[error("the field of view must be greater than 0 and less than 180 degrees, not {0}")]
    FieldOfView(f64),
}

/// The camera of a scene that is a mesh file without a camera: 800 x 600 pixels, focal distance
/// 1, film diagonal 1.
impl Default for Camera {
    fn default() -> Self {
        Camera { width: 800, height: 600, focal: 1.0, film: 1.0 }
    }
}

impl Camera {
    /// A camera of `width` x `height` pixels at focal distance `focal` from a film whose diagonal
    /// is `film` (Algorithm 1: 1).
    pub fn new(width: u32, height: u32, focal: f32, film: f32) -> Result<Self, CameraError> {
        let _floats = StandardFloats::set();
        let positive = |x: f32| x.is_finite() && x > 0.0;
        if !(1..=MAX_SIDE).contains(&width) || !(1..=MAX_SIDE).contains(&height) {
            Err(CameraError::Side(width, height))
        } else if u64::from(width) * u64::from(height) > MAX_PIXELS {
            Err(CameraError::Pixels(width, height))
        } else if !positive(focal) {
            Err(CameraError::Focal(focal))
        } else if !positive(film) {
            Err(CameraError::Film(film))
        } else {
            Ok(Camera { width, height, focal, film })
        }
    }

    /// This camera with another number of pixels and the same diagonal of the film.
    ///
    /// # Errors
    /// As [`Camera::new`].
    pub fn sized(&self, width: u32, height: u32) -> Result<Self, CameraError> {
        Camera::new(width, height, self.focal, self.film)
    }

    /// This camera with another number of pixels and a film whose height stays the same, so
    /// that the vertical field of view stays as it was: a wider picture shows more at its sides.
    /// [`sized`](Self::sized) keeps the diagonal instead, so a wider picture shows less at the top
    /// and bottom.
    ///
    /// ```
    /// # use rayo::Camera;
    /// # fn main() -> Result<(), rayo::CameraError> {
    /// let camera = Camera::new(400, 300, 1.0, 1.0)?;
    /// // 4:3 has diagonals of 5/3 of its height, 16:9 of sqrt(337)/9.
    /// let wide = camera.sized_by_height(1280, 720)?;
    /// assert!((wide.film() - 0.6 * 337_f32.sqrt() / 9.0).abs() < 1e-6);
    /// assert_eq!(camera.sized_by_height(800, 600)?.film(), 1.0);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// As [`Camera::new`].
    pub fn sized_by_height(&self, width: u32, height: u32) -> Result<Self, CameraError> {
        let _floats = StandardFloats::set();
        // The diagonals of the two films, as multiples of their heights.
        let [before, after] = [(self.width, self.height), (width, height)]
            .map(|(width, height)| (f64::from(width) / f64::from(height)).hypot(1.0));
        Camera::new(width, height, self.focal, (f64::from(self.film) * (after / before)) as f32)
    }

    /// This camera with the diagonal of the film chosen such that the vertical field of view is
    /// `degrees`.
    ///
    /// # Errors
    /// If the angle is not between 0 and 180 degrees, and as [`Camera::new`].
    pub fn with_field_of_view(&self, degrees: f64) -> Result<Self, CameraError> {
        let _floats = StandardFloats::set();
        if !(degrees > 0.0 && degrees < 180.0) {
            return Err(CameraError::FieldOfView(degrees));
        }
        let height = 2.0 * f64::from(self.focal) * (degrees / 2.0).to_radians().tan();
        let diagonal = height * (f64::from(self.width) / f64::from(self.height)).hypot(1.0);
        Camera::new(self.width, self.height, self.focal, diagonal as f32)
    }

    /// Pixels in a row.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows of pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The number of pixels, at most [`MAX_PIXELS`].
    pub fn pixels(&self) -> u64 {
        u64::from(self.width) * u64::from(self.height)
    }

    /// The distance from the pinhole to the film.
    pub fn focal(&self) -> f32 {
        self.focal
    }

    /// The diagonal of the film, in the same unit of length as the focal distance.
    pub fn film(&self) -> f32 {
        self.film
    }

    /// Lines 1 to 4 of Algorithm 1, computed in the precision `T`.
    #[doc(hidden)]
    pub fn grid<T: Real>(&self) -> Grid<T> {
        let (width, height) = (T::from_u32(self.width), T::from_u32(self.height));
        let relation = width / height;
        let film_height = T::from(self.film) / (relation * relation + 1.0.into()).sqrt();
        let film_width = relation * film_height;
        Grid {
            step: film_width / width,
            half_width: film_width * T::from(0.5),
            half_height: film_height * T::from(0.5),
            focal: T::from(self.focal),
        }
    }
}

/// A floating-point type in which a camera's grid can be computed: f32 or f64.
pub trait Real:
    Copy + From<f32> + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// The integer rounded to nearest; exact up to 2^24 in both types.
    fn from_u32(x: u32) -> Self;
    fn sqrt(self) -> Self;
}

macro_rules! real {
    ($($t:ident)*) => {$(
        impl Real for $t {
            fn from_u32(x: u32) -> $t {
                x as $t
            }
            fn sqrt(self) -> $t {
                self.sqrt()
            }
        }
    )*};
}
real!(f32 f64);

/// The primary rays of a camera in the precision `T`: they go through the centres of a grid of
/// pixels on the film, which is at distance `focal`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid<T> {
    /// The side of a pixel on the film.
    pub step: T,
    /// Half of the film's width.
    pub half_width: T,
    /// Half of the film's height.
    pub half_height: T,
    /// The z component of every ray.
    pub focal: T,
}

impl Grid<f64> {
    /// The same rays with directions `factor` times as long.
    pub fn scaled(&self, factor: f64) -> Self {
        Grid {
            step: factor * self.step,
            half_width: factor * self.half_width,
            half_height: factor * self.half_height,
            focal: factor * self.focal,
        }
    }
}

impl<T: Real> Grid<T> {
    /// r_d of a pixel, not normalised: (step (col + 1/2) - W/2, H/2 - step (row + 1/2), f).
    pub fn ray(&self, row: u32, col: u32) -> [T; 3] {
        let centre = |i: u32| T::from_u32(i) + T::from(0.5);
        [self.step * centre(col) - self.half_width, self.half_height - self.step * centre(row), self.focal]
    }
}
