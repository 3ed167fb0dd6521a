//! The pinhole camera of Algorithm 1: image size, focal distance and film, and the grid of rays that follows.

use std::ops::{Add, Div, Mul, Sub};

/// The longest side of an image, in pixels.
pub const MAX_SIDE: u32 = 1_000_000;
/// The most pixels of an image.
pub const MAX_PIXELS: u64 = 1 << 31;

/// A pinhole at the origin looking along +z, and the film behind (here: in front of) it.
///
/// Built by [`Camera::new`], which checks the limits; every field can then be trusted.
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
    /// A side is 0 or longer than [`MAX_SIDE`].
    #[error("each side of an image must be from 1 to {MAX_SIDE} pixels, not {0}x{1}")]
    Side(u32, u32),
    /// More than [`MAX_PIXELS`].
    #[error("an image of {0}x{1} has more than {MAX_PIXELS} pixels")]
    Pixels(u32, u32),
    /// Not a finite number greater than 0.
    #[error("the focal distance must be a finite number greater than 0, not {0}")]
    Focal(f32),
    /// Not a finite number greater than 0.
    #[error("the film diagonal must be a finite number greater than 0, not {0}")]
    Film(f32),
}

/// The camera of a mesh alone: 800 x 600 pixels, focal distance 1, film 1.
impl Default for Camera {
    fn default() -> Self {
        Camera { width: 800, height: 600, focal: 1.0, film: 1.0 }
    }
}

impl Camera {
    /// A camera of `width` x `height` pixels at focal distance `focal` from a film whose diagonal is `film`
    /// (Algorithm 1: 1).
    pub fn new(width: u32, height: u32, focal: f32, film: f32) -> Result<Self, CameraError> {
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

    /// The same camera with another number of pixels.
    ///
    /// # Errors
    /// As [`Camera::new`].
    pub fn sized(&self, width: u32, height: u32) -> Result<Self, CameraError> {
        Camera::new(width, height, self.focal, self.film)
    }

    /// Pixels in a row.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Pixels, at most [`MAX_PIXELS`].
    pub fn pixels(&self) -> u64 {
        u64::from(self.width) * u64::from(self.height)
    }

    /// The distance from the pinhole to the film.
    pub fn focal(&self) -> f32 {
        self.focal
    }

    /// The diagonal of the film, in the units of the focal distance.
    pub fn film(&self) -> f32 {
        self.film
    }

    /// Lines 1 to 4 of Algorithm 1, computed in the precision `T`.
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

/// A number of a camera's grid, f32 or f64.
pub trait Real:
    Copy + From<f32> + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// Rounded to nearest, exact up to 2^24.
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

/// The rays of a camera in the precision `T`: a grid of points on the film at distance `focal`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid<T> {
    /// The side of a pixel on the film.
    pub step: T,
    /// Half of the film's width.
    pub half_width: T,
    /// Half of the film's height.
    pub half_height: T,
    /// The z of every ray.
    pub focal: T,
}

impl Grid<f64> {
    /// The same rays, scaled by `factor`.
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
