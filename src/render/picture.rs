//! A picture held in memory: the content of an image file that has been read.

/// A rectangle of pixels, rows from the top, each from the left.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width * height` pixels, row after row from the top.
    pub pixels: Pixels,
}

/// The pixels of a [`Picture`], with channels in the order red, green, blue.
#[derive(Debug, Clone, PartialEq)]
pub enum Pixels {
    /// Levels from 0 to 255.
    Rgb8(Vec<[u8; 3]>),
    /// Linear values, not clamped. Files of other programs may contain NaN and infinities.
    Rgb32F(Vec<[f32; 3]>),
}

impl Picture {
    /// Makes a picture of `pixels`, whose rows are ordered from the top.
    ///
    /// # Panics
    /// If there are not exactly `width * height` pixels.
    pub fn new(width: u32, height: u32, pixels: Pixels) -> Self {
        let picture = Picture { width, height, pixels };
        picture.check();
        picture
    }

    /// Checks the number of pixels, which the public fields do not guarantee.
    ///
    /// # Panics
    /// If there are not `width * height` pixels.
    pub fn check(&self) {
        let expected = u64::from(self.width) * u64::from(self.height);
        assert_eq!(self.pixels.len() as u64, expected, "a picture of {}x{}", self.width, self.height);
    }
}

impl Pixels {
    /// The number of pixels.
    pub fn len(&self) -> usize {
        match self {
            Pixels::Rgb8(pixels) => pixels.len(),
            Pixels::Rgb32F(pixels) => pixels.len(),
        }
    }

    /// Whether there are no pixels.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}
