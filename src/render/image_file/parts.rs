//! The interfaces of encoders of parts of a picture, and of joiners, which write the file.

use std::borrow::Cow;
use std::io;

/// Encodes parts of a picture, which are whole rows, independently: in any order, and from any
/// thread or process.
pub(super) trait Encode: Send + Sync {
    /// The number of rows in a part but the last; None if the file does not depend on where parts
    /// are cut.
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

/// Joins the parts to a file. It gets them in order from the top, and never more than the picture
/// has.
pub(super) trait Join: Send {
    /// Writes the next part.
    fn append(&mut self, part: Cow<'_, [u8]>) -> io::Result<()>;

    /// Writes the end of the file after the last part.
    fn finish(self: Box<Self>) -> io::Result<()> {
        Ok(())
    }
}
