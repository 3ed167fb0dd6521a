//! The assembler, the compilers and the flags that built this library, as recorded by build.rs.

/// The assembler of the kernels; None in a build without assembly.
pub const NASM: Option<&str> = option_env!("RAYO_NASM");
/// The C compiler of the baseline; None in a build without C.
pub const CC: Option<&str> = option_env!("RAYO_CC");
/// The flags of the C compiler.
pub const CFLAGS: Option<&str> = option_env!("RAYO_CFLAGS");
/// The Rust compiler.
pub const RUSTC: &str = env!("RAYO_RUSTC");
