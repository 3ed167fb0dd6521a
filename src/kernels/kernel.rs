//! Kernels and calls of them, checked or direct. An entry of `kinds!` defines the arguments of a
//! kind of kernels and the registers that hold them.

use std::cell::{Cell, RefCell};
use std::convert::Infallible;
use std::marker::PhantomData;
use std::panic::{self, AssertUnwindSafe};

use super::checked::{self, Code, Fault, Registers};
use super::crash::Crash;

/// A kind of kernels, which `kinds!` defines.
pub trait Kind {
    /// The type of functions in Rust of this kind; uninhabited if it has none.
    type Function: Copy;
}

/// The kind of kernels without arguments.
impl Kind for () {
    type Function = Infallible;
}

/// The kind of kernels on elements whose arguments another type defines.
impl<E> Kind for PhantomData<E> {
    type Function = Infallible;
}

/// A kernel of the kind `K`: foreign code or a function in Rust.
pub struct Kernel<K: Kind> {
    way: Callee<Code, K::Function>,
    symbol: &'static str,
}

impl<K: Kind> Clone for Kernel<K> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<K: Kind> Copy for Kernel<K> {}

/// The implementation of a kernel: code that takes registers, or a function in Rust.
#[derive(Clone, Copy)]
pub(super) enum Callee<C, B> {
    Code(C),
    Rust(B),
}

/// A function that calls a kernel with these registers and returns its result.
#[cfg(all(feature = "lab", target_os = "linux", target_arch = "x86_64"))]
pub(super) type Call = unsafe fn(Code, Registers) -> u64;

/// How a thread calls foreign code.
#[derive(Clone, Copy)]
enum Calls {
    Direct,
    /// Through the code in checked.asm, optionally with subnormal numbers switched off.
    Checked {
        without_denormals: bool,
    },
    /// Through a given function.
    #[cfg(all(feature = "lab", target_os = "linux", target_arch = "x86_64"))]
    Through(Call),
}

thread_local! {
    /// How this thread calls foreign code.
    static HOW: Cell<Calls> = const { Cell::new(Calls::Direct) };
    /// The number of checked calls that returned.
    static CALLS: Cell<u64> = const { Cell::new(0) };
    /// The first of these calls that broke a rule.
    static BROKEN: RefCell<Vec<CheckedCall>> = const { RefCell::new(Vec::new()) };
}

/// How many calls that broke a rule are kept.
const MOST_BROKEN: usize = 1000;

/// A checked call in which a kernel broke a rule.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CheckedCall {
    pub symbol: &'static str,
    pub broken: Vec<Fault>,
}

/// A kernel that crashed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crashed {
    pub symbol: &'static str,
    pub crash: Crash,
}

/// The outcome of work in which every call of a kernel was checked.
#[derive(Clone, Debug)]
pub struct Examined<R> {
    /// What the work returned; an error if a kernel crashed, which ended the work.
    pub result: Result<R, Box<Crashed>>,
    /// The number of calls that returned.
    pub calls: u64,
    /// The calls in which a kernel broke a rule, in order; only the first ones, if there are many.
    pub broken: Vec<CheckedCall>,
}

impl<R> Examined<R> {
    fn expect_result(self) -> R {
        self.result.unwrap_or_else(|crashed| panic!("{} crashed: {:x?}", crashed.symbol, crashed.crash))
    }
}

impl<K: Kind> Kernel<K> {
    /// # Safety
    /// `code` takes the arguments that `kinds!` defines for `K`, and is only handed out if the CPU
    /// supports it.
    pub(super) const unsafe fn new(code: Code, symbol: &'static str) -> Self {
        Kernel { way: Callee::Code(code), symbol }
    }

    pub(super) const fn in_rust(function: K::Function, symbol: &'static str) -> Self {
        Kernel { way: Callee::Rust(function), symbol }
    }

    /// The symbol of the kernel's code.
    pub fn symbol(&self) -> &'static str {
        self.symbol
    }

    /// The symbols of the kernel as a table: this single one.
    pub(super) fn symbols(&self) -> Vec<&'static str> {
        vec![self.symbol]
    }

    /// The implementation of the kernel, ready to be called.
    ///
    /// # Safety
    /// Code is called with registers that hold the arguments of the kernel's kind.
    #[inline]
    pub(super) unsafe fn way(&self) -> Callee<impl FnOnce(Registers) -> u64, K::Function> {
        match self.way {
            // SAFETY: the caller keeps this function's contract, which is that of enter().
            Callee::Code(code) => Callee::Code(move |registers| unsafe { enter(code, self.symbol, registers) }),
            Callee::Rust(function) => Callee::Rust(function),
        }
    }
}

impl<K: Kind<Function = Infallible>> Kernel<K> {
    fn code(&self) -> Code {
        let way = self.way;
        let Callee::Code(code) = way;
        code
    }

    pub fn address(&self) -> usize {
        self.code() as usize
    }

    /// Calls the kernel, and returns its result.
    ///
    /// # Safety
    /// The registers hold the arguments of the kernel's kind.
    #[inline]
    pub(super) unsafe fn enter(&self, registers: Registers) -> u64 {
        // SAFETY: the caller keeps this function's contract, which is that of enter().
        unsafe { enter(self.code(), self.symbol, registers) }
    }
}

/// Calls a kernel's code, and returns its result.
///
/// # Safety
/// The registers hold the arguments of the kernel's kind.
#[inline]
unsafe fn enter(code: Code, symbol: &'static str, registers: Registers) -> u64 {
    match HOW.get() {
        Calls::Direct => {
            let [a, b, c, d, e, f] = registers;
            // SAFETY: by the contract of new() the code takes arguments of its kind, and the CPU
            // runs it.
            unsafe { code(a, b, c, d, e, f) }
        }
        // SAFETY: the caller keeps this function's contract.
        Calls::Checked { without_denormals } => unsafe { enter_checked(code, symbol, registers, without_denormals) },
        #[cfg(all(feature = "lab", target_os = "linux", target_arch = "x86_64"))]
        // SAFETY: the caller keeps this function's contract.
        Calls::Through(call) => unsafe { call(code, registers) },
    }
}

/// As [`enter`], out of line since it is rare. If the kernel crashes, the stack unwinds from here
/// to [`examine`].
///
/// # Safety
/// That of [`enter`].
#[cold]
#[inline(never)]
unsafe fn enter_checked(code: Code, symbol: &'static str, registers: Registers, without_denormals: bool) -> u64 {
    // SAFETY: the caller keeps this function's contract.
    match unsafe { checked::call(code, registers, without_denormals) } {
        Ok(checked::Returned { result, faults: broken }) => {
            CALLS.set(CALLS.get() + 1);
            if !broken.is_empty() {
                BROKEN.with_borrow_mut(|calls| {
                    if calls.len() < MOST_BROKEN {
                        calls.push(CheckedCall { symbol, broken });
                    }
                });
            }
            result
        }
        Err(crash) => panic::resume_unwind(Box::new(Crashed { symbol, crash: *crash })),
    }
}

/// Runs `work`, and checks all calls of foreign code that this thread makes in it.
///
/// # Panics
/// If a kernel breaks the calling convention.
pub fn checked<R>(work: impl FnOnce() -> R) -> R {
    unbroken(examine(work))
}

/// As `checked`, with subnormal numbers switched off during these calls, as results and as
/// operands (FTZ and DAZ of MXCSR). It serves to show that nothing depends on them.
pub fn without_denormals<R>(work: impl FnOnce() -> R) -> R {
    unbroken(checking(true, work))
}

/// The rules that foreign code breaks when this thread calls it in `work`.
///
/// # Panics
/// If `work` calls no foreign code.
pub fn faults(work: impl FnOnce()) -> Vec<Fault> {
    let examined = examine(work);
    let broken: Vec<_> = examined.broken.iter().flat_map(|call| &call.broken).copied().collect();
    assert!(examined.calls > 0 || examined.result.is_err(), "a call that has something to do");
    examined.expect_result();
    broken
}

fn unbroken<R>(examined: Examined<R>) -> R {
    assert_eq!(examined.broken, []);
    examined.expect_result()
}

/// Runs `work`, checks all calls of foreign code that this thread makes in it, and returns the
/// outcome.
pub fn examine<R>(work: impl FnOnce() -> R) -> Examined<R> {
    checking(false, work)
}

/// Runs `work`, in which this thread calls all kernels through `call`.
///
/// # Safety
/// `call` calls the kernel with the registers that it is given, and returns its result.
#[cfg(all(feature = "lab", target_os = "linux", target_arch = "x86_64"))]
pub(super) unsafe fn calling_through(call: Call, work: impl FnOnce()) {
    let _restore = Restore(HOW.replace(Calls::Through(call)));
    work();
}

/// Restores how this thread calls kernels, also after a panic.
struct Restore(Calls);

impl Drop for Restore {
    fn drop(&mut self) {
        HOW.set(self.0);
    }
}

fn checking<R>(without_denormals: bool, work: impl FnOnce() -> R) -> Examined<R> {
    let _restore = Restore(HOW.replace(Calls::Checked { without_denormals }));
    CALLS.set(0);
    BROKEN.take();
    // Unwinding is safe: a kernel only writes plain values, and what it has not written keeps its
    // value.
    let result = panic::catch_unwind(AssertUnwindSafe(work)).or_else(|reason| match reason.downcast::<Crashed>() {
        Ok(crashed) => Err(crashed),
        Err(other) => panic::resume_unwind(other),
    });
    Examined { result, calls: CALLS.get(), broken: BROKEN.take() }
}

/// The kernel with that symbol, of the kind that its use requires: in assembly (`rayo_asm`) or in C
/// (`rayo_c`).
macro_rules! kernel {
    ($built:ident, $symbol:expr) => {{
        #[cfg($built)]
        convention! { foreign {
            #[link_name = $symbol]
            fn kernel(a: u64, b: u64, c: u64, d: u64, e: u64, f: u64) -> u64;
        } }
        #[cfg(not($built))]
        use $crate::kernels::checked::absent as kernel;
        // SAFETY: the signature above the function in asm/ or src/kernels/c is that of the kind;
        // the functions that hand out the table check the build and the CPU.
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

/// Defines kinds of kernels. An entry has the arguments of the kind in Rust; the arguments of its
/// functions in Rust, if it has any; and a block that calls `|way|`, the code or the function, with
/// them. The block must prove that the arguments of code are what kernels of the kind require:
/// addresses, alignment and lengths. It may skip the call if there is nothing to do.
macro_rules! kinds {
    ($(
        $(#[$doc:meta])*
        $kind:ident $(<$($parameter:ident $(: $bound:ident)?),+>)? $(as $function:ty;)?

        $(#[$call_doc:meta])*
        fn $call:ident($($argument:ident: $type:ty),* $(,)?) $(-> $result:ty)?; |$way:ident| $block:block
    )*) => {
        /// A type for each kind of kernels, to tell them apart.
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
                    $way: $crate::kernels::kernel::Callee<
                        impl FnOnce($crate::kernels::checked::Registers) -> u64,
                        function!($($function)?),
                    >,
                ) $(-> $result)? $block

                $(#[$call_doc])*
                #[inline]
                pub fn $call(&self, $($argument: $type),*) $(-> $result)? {
                    // SAFETY: the block above proves what the code requires of its arguments.
                    Self::with($($argument,)* unsafe { self.way() })
                }
            }
        )*
    };
}

/// The type of a kind's functions in Rust; uninhabited if it has none.
macro_rules! function {
    () => {
        std::convert::Infallible
    };
    ($function:ty) => {
        $function
    };
}

pub(super) use {function, kernel, kinds};
