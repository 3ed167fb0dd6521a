//! The repository: the rules that its sources keep.

mod architecture;
mod nasm_errors;
mod pages;
