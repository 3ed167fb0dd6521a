//! The interfaces of encoders, which encode parts of a picture, and of joiners, which write the
//! parts to a file.

use std::borrow::Cow;
use std::io;

/// Encodes parts of a picture, which are whole rows, independently of each other: in any order, and
/// from any thread or process.
pub(super) trait Encode: Send + Sync {
    /// The number of rows in every part but the last. None if parts may be cut anywhere, since the
    /// file does not depend on it.
    fn part_rows(&self) -> Option<u32> {
        None
    }

    /// Encodes rows of R, G, B; called for 8-bit formats.
    fn rgb8<'a>(&self, _rows: &'a [[u8; 3]]) -> io::Result<Cow<'a, [u8]>> {
        unreachable!("not an 8-bit format")
    }

    /// Encodes rows of R, G, B; called for float formats.
    fn f32x3<'a>(&self, _rows: &'a [[f32; 3]]) -> io::Result<Cow<'a, [u8]>> {
        unreachable!("not a float format")
    }
}

/// Joins the parts to a file. It is given them in order from the top, and no more than the picture
/// has.
pub(super) trait Join: Send {
    /// Writes the next part.
    fn append(&mut self, part: Cow<'_, [u8]>) -> io::Result<()>;

    /// Writes the end of the file after the last part.
    fn finish(self: Box<Self>) -> io::Result<()> {
        Ok(())
    }
}
