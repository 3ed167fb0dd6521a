//! The program `rayo`.

use std::process::ExitCode;

#[global_allocator]
static MEMORY: rayo::kernels::memory::Memory = rayo::kernels::memory::Memory;

fn main() -> ExitCode {
    rayo::cli::main()
}
