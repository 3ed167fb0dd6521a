//! A flag by which one thread stops the planning and tracing of another.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Stops planning and tracing that is under way in another thread. It, or a clone of it, is given
/// to planning as [`Purpose::cancel`](crate::Purpose::cancel), and to tracing by
/// [`Frame::stopped_by`](crate::Frame::stopped_by).
///
/// ```
/// # use rayo::{Cancel, Engine, EngineError, Plan, Purpose, Scene};
/// let cancel = Cancel::default();
/// // Another thread has a clone, and calls this meanwhile.
/// let clone = cancel.clone();
/// clone.cancel();
/// let scene = Scene::new(Default::default());
/// let purpose = Purpose { cancel: Some(&cancel), ..Purpose::default() };
/// let plan = Plan::new(Engine::fastest(), &scene, purpose);
/// assert_eq!(plan.err(), Some(EngineError::Cancelled));
/// ```
#[derive(Clone, Debug, Default)]
pub struct Cancel(Arc<AtomicBool>);

impl Cancel {
    /// Stops all planning and tracing that was given this flag or a clone of it, now or later.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether [`cancel`](Self::cancel) was called on this flag or on a clone.
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
