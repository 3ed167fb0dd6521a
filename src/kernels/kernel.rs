//! A kernel and its calls, checked and not: an entry of `kinds!` defines the arguments of a kind and their registers.

use std::cell::{Cell, RefCell};
use std::convert::Infallible;
use std::marker::PhantomData;

use super::checked::{self, Code, Fault, Registers};

/// A kind of kernels, as `kinds!` defines it.
pub trait Kind {
    /// The type of the kind's functions in Rust, if there may be any.
    type Function: Copy;
}

/// A kind without arguments.
impl Kind for () {
    type Function = Infallible;
}

/// A kind on elements, defined by other types.
impl<E> Kind for PhantomData<E> {
    type Function = Infallible;
}

/// A kernel of the kind `K`: foreign code, or a function in Rust.
pub struct Kernel<K: Kind> {
    way: Way<Code, K::Function>,
    symbol: &'static str,
}

impl<K: Kind> Clone for Kernel<K> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<K: Kind> Copy for Kernel<K> {}

/// The implementation of a kernel: code that reads registers, or a function.
#[derive(Clone, Copy)]
pub(super) enum Way<C, B> {
    Code(C),
    Rust(B),
}

thread_local! {
    /// Whether this thread's calls are checked, and if so whether denormal numbers are switched off in them.
    static CHECKED: Cell<Option<bool>> = const { Cell::new(None) };
    /// The rules that each checked call has broken.
    static FOUND: RefCell<Vec<(&'static str, Vec<Fault>)>> = const { RefCell::new(Vec::new()) };
}

impl<K: Kind> Kernel<K> {
    /// # Safety
    /// `code` takes what `kinds!` defines for `K`, and is handed out only if the CPU supports it.
    pub(super) const unsafe fn new(code: Code, symbol: &'static str) -> Self {
        Kernel { way: Way::Code(code), symbol }
    }

    pub(super) const fn in_rust(function: K::Function, symbol: &'static str) -> Self {
        Kernel { way: Way::Rust(function), symbol }
    }

    /// The symbol of its code.
    pub fn symbol(&self) -> &'static str {
        self.symbol
    }

    /// Its symbol, as the only one of a table.
    pub(super) fn symbols(&self) -> Vec<&'static str> {
        vec![self.symbol]
    }

    /// Its implementation, ready to be called.
    ///
    /// # Safety
    /// Code is called with registers that hold the arguments of its kind.
    #[inline]
    pub(super) unsafe fn way(&self) -> Way<impl FnOnce(Registers) -> u64, K::Function> {
        match self.way {
            // SAFETY: as here.
            Way::Code(code) => Way::Code(move |registers| unsafe { enter(code, self.symbol, registers) }),
            Way::Rust(function) => Way::Rust(function),
        }
    }
}

impl<K: Kind<Function = Infallible>> Kernel<K> {
    fn code(&self) -> Code {
        let way = self.way;
        let Way::Code(code) = way;
        code
    }

    pub fn address(&self) -> usize {
        self.code() as usize
    }

    /// Calls it, and returns the result.
    ///
    /// # Safety
    /// The registers hold the arguments of its kind.
    #[inline]
    pub(super) unsafe fn enter(&self, registers: Registers) -> u64 {
        // SAFETY: as here.
        unsafe { enter(self.code(), self.symbol, registers) }
    }
}

/// Calls a kernel, and returns the result.
///
/// # Safety
/// The registers hold the arguments of its kind.
#[inline]
unsafe fn enter(code: Code, symbol: &'static str, registers: Registers) -> u64 {
    if let Some(without_denormals) = CHECKED.get() {
        // SAFETY: as here.
        return unsafe { enter_checked(code, symbol, registers, without_denormals) };
    }
    let [a, b, c, d, e, f] = registers;
    // SAFETY: its kind is what it takes, by the contract of new(), and the CPU runs it.
    unsafe { code(a, b, c, d, e, f) }
}

/// As [`enter`], out of line, for a rare case.
///
/// # Safety
/// As that of [`enter`].
#[cold]
#[inline(never)]
unsafe fn enter_checked(code: Code, symbol: &'static str, registers: Registers, without_denormals: bool) -> u64 {
    // SAFETY: as in enter.
    let (result, found) = unsafe { checked::call(code, registers, without_denormals) };
    FOUND.with_borrow_mut(|of_calls| of_calls.push((symbol, found)));
    result
}

/// Does `work` with all foreign code that this thread calls in it checked.
///
/// # Panics
/// If some breaks the calling convention.
pub fn checked<R>(work: impl FnOnce() -> R) -> R {
    unbroken(checking(false, work))
}

/// The same, with denormal numbers switched off in that code, as results and operands (FTZ and DAZ of MXCSR): to show that
/// nothing depends on them.
pub fn without_denormals<R>(work: impl FnOnce() -> R) -> R {
    unbroken(checking(true, work))
}

/// The rules that foreign code breaks which this thread calls in `work`.
///
/// # Panics
/// If it calls none.
pub fn faults(work: impl FnOnce()) -> Vec<Fault> {
    let ((), of_calls) = checking(false, work);
    assert!(!of_calls.is_empty(), "a call that has something to do");
    of_calls.into_iter().flat_map(|(_, faults)| faults).collect()
}

fn unbroken<R>((result, mut of_calls): (R, Vec<(&'static str, Vec<Fault>)>)) -> R {
    of_calls.retain(|(_, faults)| !faults.is_empty());
    assert_eq!(of_calls, []);
    result
}

fn checking<R>(without_denormals: bool, work: impl FnOnce() -> R) -> (R, Vec<(&'static str, Vec<Fault>)>) {
    /// Restores the setting, after a panic too.
    struct Restore(Option<bool>);
    impl Drop for Restore {
        fn drop(&mut self) {
            CHECKED.set(self.0);
        }
    }
    let _restore = Restore(CHECKED.replace(Some(without_denormals)));
    FOUND.take();
    (work(), FOUND.take())
}

/// The kernel with that symbol, of the kind that its place requires: in assembly (`rayo_asm`), or in C (`rayo_c`).
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

/// The address of an argument that a kernel reads.
pub(super) fn reads<T: ?Sized>(from: *const T) -> u64 {
    from.cast::<()>() as u64
}

/// The address of an argument that a kernel writes, or reads and writes.
pub(super) fn writes<T: ?Sized>(to: *mut T) -> u64 {
    to.cast::<()>() as u64
}

/// Defines kinds of kernels: the arguments of each in Rust; those of a function in Rust, if there may be one; and
/// `|way|`, how code or a function is called with them. A block must prove that the arguments of code are what kernels
/// of the kind require: addresses, alignment and lengths. It may skip the call if there is nothing to do.
macro_rules! kinds {
    ($(
        $(#[$doc:meta])*
        $kind:ident $(<$($parameter:ident $(: $bound:ident)?),+>)? $(as $function:ty;)?

        $(#[$call_doc:meta])*
        fn $call:ident($($argument:ident: $type:ty),* $(,)?) $(-> $result:ty)?; |$way:ident| $block:block
    )*) => {
        /// Tells kinds of kernels apart.
        mod kind {
            $(pub struct $kind $(<$($parameter),+>(std::marker::PhantomData<fn($($parameter),+)>))?;)*
        }

        $(
            impl $(<$($parameter $(: $bound)?),+>)? $crate::kernels::kernel::Kind for kind::$kind $(<$($parameter),+>)? {
                type Function = function!($($function)?);
            }
        )*

        $(
            $(#[$doc])*
            pub type $kind $(<$($parameter),+>)? = $crate::kernels::kernel::Kernel<kind::$kind $(<$($parameter),+>)?>;

            impl $(<$($parameter $(: $bound)?),+>)? $kind $(<$($parameter),+>)? {
                fn with(
                    $($argument: $type,)*
                    $way: $crate::kernels::kernel::Way<
                        impl FnOnce($crate::kernels::checked::Registers) -> u64,
                        function!($($function)?),
                    >,
                ) $(-> $result)? $block

                $(#[$call_doc])*
                #[inline]
                pub fn $call(&self, $($argument: $type),*) $(-> $result)? {
                    // SAFETY: the block above proves what code asks of its arguments.
                    Self::with($($argument,)* unsafe { self.way() })
                }
            }
        )*
    };
}

/// The function of a kind in Rust, which may have none.
macro_rules! function {
    () => {
        std::convert::Infallible
    };
    ($function:ty) => {
        $function
    };
}

pub(super) use {function, kernel, kinds};
