//! Scratch memory kept from one picture to the next.
//!
//! A small picture, such as a frame of a preview, takes less time to trace than the system takes to
//! provide scratch memory.

use std::any::Any;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The scratch memory that is kept from all pictures.
pub(super) static KEPT: Kept = Kept(Mutex::new(Vec::new()));

/// Scratch memory of any type.
pub(super) struct Kept(Mutex<Vec<Box<dyn Any + Send>>>);

impl Kept {
    /// The number of pieces that are kept: enough for a few threads.
    const MOST: usize = 4;

    fn lock(&self) -> MutexGuard<'_, Vec<Box<dyn Any + Send>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes a piece of memory of this type, if one is kept.
    pub(super) fn take<T: Any>(&self) -> Option<T> {
        let mut kept = self.lock();
        let index = kept.iter().position(|memory| memory.is::<T>())?;
        kept.swap_remove(index).downcast().ok().map(|memory| *memory)
    }

    /// Keeps a piece of memory, unless [`MOST`](Self::MOST) pieces are kept already.
    pub(super) fn give<T: Any + Send>(&self, memory: T) {
        let mut kept = self.lock();
        if kept.len() < Self::MOST {
            kept.push(Box::new(memory));
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::Kept;

    #[test]
    fn memory_comes_back_by_its_type_and_little_of_it_is_kept() {
        let kept = Kept(Mutex::default());
        (0..9_u8).for_each(|i| kept.give(i));
        (0..9_u16).for_each(|i| kept.give(i));
        let bytes: Vec<u8> = std::iter::from_fn(|| kept.take()).collect();
        assert_eq!(bytes.len(), Kept::MOST);
        assert_eq!(kept.take::<u16>(), None);
        kept.give(7_u16);
        assert_eq!((kept.take::<u8>(), kept.take::<u16>()), (None, Some(7)));
    }
}
