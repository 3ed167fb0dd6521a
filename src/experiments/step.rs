//! One ray through a kernel, instruction by instruction.

pub mod model;
pub mod shadow;
