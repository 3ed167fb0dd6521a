//! The repository: the rules that its sources keep, and its documents, kept true.

#[cfg(feature = "cli")]
#[path = "../common/extent.rs"]
mod extent;
#[cfg(feature = "cli")]
#[path = "../common/program.rs"]
mod program;

mod architecture;
#[cfg(feature = "cli")]
mod docs;
