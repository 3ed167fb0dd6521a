//! A kernel and its calls, checked and not: an entry of `kinds!` says what a kind takes, and how that gets into registers.

use std::cell::Cell;
use std::marker::PhantomData;

use super::checked::{self, Code, Fault, Registers};

/// A kernel of the kind `K`.
pub struct Kernel<K> {
    code: Code,
    symbol: &'static str,
    kind: PhantomData<fn(K)>,
}

impl<K> Clone for Kernel<K> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<K> Copy for Kernel<K> {}

thread_local! {
    /// Whether this thread's calls are checked, with denormal numbers switched off in them: see [`without_denormals`].
    static WITHOUT_DENORMALS: Cell<bool> = const { Cell::new(false) };
}

impl<K> Kernel<K> {
    /// # Safety
    /// `code` takes what `kinds!` says of `K`, and is handed out only where the CPU runs it.
    pub(super) const unsafe fn new(code: Code, symbol: &'static str) -> Self {
        Kernel { code, symbol, kind: PhantomData }
    }

    /// The symbol of its code.
    pub fn symbol(&self) -> &'static str {
        self.symbol
    }

    /// Where its code is.
    pub fn address(&self) -> usize {
        self.code as usize
    }

    /// Its symbol, as the only one of a table.
    pub(super) fn symbols(&self) -> Vec<&'static str> {
        vec![self.symbol]
    }

    /// Calls it, and gives the result.
    ///
    /// # Safety
    /// The registers hold what its kind takes.
    #[inline]
    pub(super) unsafe fn enter(&self, registers: Registers) -> u64 {
        if WITHOUT_DENORMALS.get() {
            // SAFETY: as here.
            return unsafe { enter_without_denormals(self.code, self.symbol, registers) };
        }
        let [a, b, c, d, e, f] = registers;
        // SAFETY: its kind is what it takes, by the contract of new(), and the CPU runs it.
        unsafe { (self.code)(a, b, c, d, e, f) }
    }

    /// As [`Kernel::enter`], with a look at whether it keeps the calling convention.
    ///
    /// # Safety
    /// As that of [`Kernel::enter`].
    pub(super) unsafe fn enter_checked(&self, registers: Registers) -> (u64, Result<(), Vec<Fault>>) {
        // SAFETY: as in enter.
        unsafe { checked::call(self.code, registers, WITHOUT_DENORMALS.get()) }
    }
}

/// As [`Kernel::enter`], of any kind: one copy of what is hardly ever done.
///
/// # Safety
/// As that of [`Kernel::enter`].
#[cold]
#[inline(never)]
unsafe fn enter_without_denormals(code: Code, symbol: &'static str, registers: Registers) -> u64 {
    // SAFETY: as in enter.
    let (result, kept) = unsafe { checked::call(code, registers, true) };
    assert_eq!(kept, Ok(()), "{symbol}");
    result
}

/// Does `work` with all kernels that this thread calls in it checked, and with denormal numbers switched off in them, in and out
/// (DAZ and FTZ of MXCSR): to show that nothing depends on these.
pub fn without_denormals<R>(work: impl FnOnce() -> R) -> R {
    /// Puts back what was, after a panic too.
    struct Restore(bool);
    impl Drop for Restore {
        fn drop(&mut self) {
            WITHOUT_DENORMALS.set(self.0);
        }
    }
    let _restore = Restore(WITHOUT_DENORMALS.replace(true));
    work()
}

/// The kernel of that symbol, of the kind that its place asks for: in assembly (`rayo_asm`), or in C (`rayo_c`).
macro_rules! kernel {
    ($built:ident, $symbol:expr) => {{
        #[cfg($built)]
        convention! { foreign {
            #[link_name = $symbol]
            fn kernel(a: u64, b: u64, c: u64, d: u64, e: u64, f: u64) -> u64;
        } }
        #[cfg(not($built))]
        use $crate::kernels::checked::absent as kernel;
        // SAFETY: the signature above the function in asm/ or src/kernels/c is that of the kind; and what hands the table out
        // has asked the build and the CPU.
        unsafe { $crate::kernels::kernel::Kernel::new(kernel, $symbol) }
    }};
    ($symbol:expr) => {
        kernel!(rayo_asm, $symbol)
    };
}

/// The address of what a kernel reads.
pub(super) fn reads<T: ?Sized>(from: *const T) -> u64 {
    from.cast::<()>() as u64
}

/// The address of what a kernel writes, or reads and writes.
pub(super) fn writes<T: ?Sized>(to: *mut T) -> u64 {
    to.cast::<()>() as u64
}

/// Defines kinds of kernels: what each takes in Rust, and `|enter|`, how it is called with that. A block must prove that what
/// it enters with is what kernels of the kind ask for: addresses, alignment and lengths. It may do without the call where there
/// is nothing to do.
macro_rules! kinds {
    ($(
        $(#[$doc:meta])*
        $kind:ident $(<$($parameter:ident $(: $bound:ident)?),+>)?

        $(#[$call_doc:meta])*
        fn $call:ident($($argument:ident: $type:ty),* $(,)?) $(-> $result:ty)?; |$enter:ident| $block:block
    )*) => {
        /// What tells kinds of kernels apart.
        mod kind {
            $(pub struct $kind $(<$($parameter),+>(std::marker::PhantomData<fn($($parameter),+)>))?;)*
        }

        $(
            $(#[$doc])*
            pub type $kind $(<$($parameter),+>)? = $crate::kernels::kernel::Kernel<kind::$kind $(<$($parameter),+>)?>;

            impl $(<$($parameter $(: $bound)?),+>)? $kind $(<$($parameter),+>)? {
                fn with(
                    $($argument: $type,)*
                    $enter: impl FnOnce($crate::kernels::checked::Registers) -> u64,
                ) $(-> $result)? $block

                $(#[$call_doc])*
                #[inline]
                pub fn $call(&self, $($argument: $type),*) $(-> $result)? {
                    // SAFETY: the block above proves what the kernel asks of its arguments.
                    Self::with($($argument,)* |registers| unsafe { self.enter(registers) })
                }

                /// The same call, with a look at whether the kernel keeps the calling convention.
                ///
                /// # Panics
                /// As the call that is not checked; and where there is nothing to do, so that nothing would be checked.
                pub fn call_checked(
                    &self,
                    $($argument: $type),*
                ) -> Result<(), Vec<$crate::kernels::checked::Fault>> {
                    let mut kept = None;
                    Self::with($($argument,)* |registers| {
                        // SAFETY: as in the call that is not checked.
                        let (result, found) = unsafe { self.enter_checked(registers) };
                        kept = Some(found);
                        result
                    });
                    kept.expect("a call that has something to do")
                }
            }
        )*
    };
}

pub(super) use {kernel, kinds};
