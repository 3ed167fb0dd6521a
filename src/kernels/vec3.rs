//! The paper's operations on packets: a table of them per ISA and element type, and safe calls.

use super::checked::{self, Fault};
use super::isa::Isa;
use super::spans::{Element, Lit, SphereHit, TriangleHit};

/// What an operation on packets takes beside its vectors, and what it gives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Numbers of `b` for each vector: 3, 1 for scalars, 0 where there are none.
    pub b_numbers: usize,
    /// Numbers of `b` that are there once: those of a record.
    pub record: usize,
    /// Numbers of the result for each vector: 3, or 1 for scalars.
    pub out_numbers: usize,
}

/// An operation on packets of vectors: LANES x, then LANES y, then LANES z; a packet of scalars is LANES of them.
#[derive(Clone, Copy)]
pub struct PacketOp<E> {
    /// The operation's name, as in [`AosKernels`](super::AosKernels).
    pub name: &'static str,
    /// Vectors in a packet.
    pub lanes: usize,
    /// Of what `b` and the result are made.
    pub shape: Shape,
    /// The symbol of its code.
    pub symbol: &'static str,
    code: unsafe extern "sysv64" fn(out: *mut E, a: *const E, b: *const E, n: usize),
}

impl<E: Element> PacketOp<E> {
    /// Writes the results for all packets of `a` and for `b` to `out`.
    ///
    /// # Panics
    /// Where the lengths are not those of the same number of whole packets, and of a record where there is one.
    #[inline]
    pub fn call(&self, out: &mut [E], a: &[E], b: &[E]) {
        let packets = self.packets(out, a, b);
        // SAFETY: packets() proves that all three have so many packets and `b` a record; the kernel asks for no alignment,
        // reads and writes those alone, and any bits are elements. The table it came from was handed out by a function that
        // had checked the CPU.
        unsafe { (self.code)(out.as_mut_ptr(), a.as_ptr(), b.as_ptr(), packets) }
    }

    /// As [`PacketOp::call`], with a look at whether the kernel keeps the calling convention.
    pub fn call_checked(&self, out: &mut [E], a: &[E], b: &[E]) -> Result<(), Vec<Fault>> {
        let packets = self.packets(out, a, b);
        let args = [out.as_mut_ptr() as u64, a.as_ptr() as u64, b.as_ptr() as u64, packets as u64, 0, 0];
        // SAFETY: as in call; these are the four arguments of its signature.
        unsafe { checked::call(self.code as *const (), args) }
    }

    /// Where its code is.
    pub fn address(&self) -> usize {
        self.code as usize
    }

    fn packets(&self, out: &[E], a: &[E], b: &[E]) -> usize {
        let packets = a.len() / (3 * self.lanes);
        let vectors = packets * self.lanes;
        let Shape { b_numbers, record, out_numbers } = self.shape;
        let fits =
            a.len() == 3 * vectors && b.len() == b_numbers * vectors + record && out.len() == out_numbers * vectors;
        assert!(fits, "{} takes whole packets of {}, as many in each", self.name, self.lanes);
        packets
    }
}

/// Operations in a table.
const OPS: usize = 10;

/// Numbers of a record.
const fn numbers<R>() -> usize {
    size_of::<R>() / size_of::<f32>()
}

macro_rules! packet_ops {
    ($($static:ident: $element:ty = $prefix:literal, $lanes:literal;)*) => {
        $(static $static: [PacketOp<$element>; OPS] = [
            packet_ops!(@op $element, $prefix, $lanes, "add", 3, 0, 3),
            packet_ops!(@op $element, $prefix, $lanes, "sub", 3, 0, 3),
            packet_ops!(@op $element, $prefix, $lanes, "scale", 1, 0, 3),
            packet_ops!(@op $element, $prefix, $lanes, "dot", 3, 0, 1),
            packet_ops!(@op $element, $prefix, $lanes, "norm", 0, 0, 1),
            packet_ops!(@op $element, $prefix, $lanes, "cross", 3, 0, 3),
            packet_ops!(@op $element, $prefix, $lanes, "normalise", 0, 0, 3),
            packet_ops!(@op $element, $prefix, $lanes, "sphere", 0, numbers::<SphereHit<f32>>(), 1),
            packet_ops!(@op $element, $prefix, $lanes, "triangle", 0, numbers::<TriangleHit<f32>>(), 1),
            packet_ops!(@op $element, $prefix, $lanes, "lambert", 0, numbers::<Lit<f32>>(), 3),
        ];)*
    };
    (@op $element:ty, $prefix:literal, $lanes:literal, $name:literal, $b:literal, $record:expr, $out:literal) => {{
        unsafe extern "sysv64" {
            #[link_name = concat!("rayo_", $prefix, "_", $name, "3")]
            fn kernel(out: *mut $element, a: *const $element, b: *const $element, n: usize);
        }
        PacketOp {
            name: $name,
            lanes: $lanes,
            shape: Shape { b_numbers: $b, record: $record, out_numbers: $out },
            symbol: concat!("rayo_", $prefix, "_", $name, "3"),
            code: kernel,
        }
    }};
}

packet_ops! {
    SSE41_SINGLE: f32 = "sse41_single", 4;
    SSE41_DOUBLE: f64 = "sse41_double", 2;
    AVX2_SINGLE: f32 = "avx2_single", 8;
    AVX2_DOUBLE: f64 = "avx2_double", 4;
    AVX512_SINGLE: f32 = "avx512_single", 16;
    AVX512_DOUBLE: f64 = "avx512_double", 8;
}

/// An element type that has operations on packets.
pub trait PacketElement: Element {
    /// Those of an ISA, whether this CPU runs it or not.
    #[doc(hidden)]
    fn table(isa: Isa) -> &'static [PacketOp<Self>];
}

impl PacketElement for f32 {
    fn table(isa: Isa) -> &'static [PacketOp<f32>] {
        match isa {
            Isa::Sse41 => &SSE41_SINGLE,
            Isa::Avx2 => &AVX2_SINGLE,
            Isa::Avx512 => &AVX512_SINGLE,
        }
    }
}

impl PacketElement for f64 {
    fn table(isa: Isa) -> &'static [PacketOp<f64>] {
        match isa {
            Isa::Sse41 => &SSE41_DOUBLE,
            Isa::Avx2 => &AVX2_DOUBLE,
            Isa::Avx512 => &AVX512_DOUBLE,
        }
    }
}

/// The packet operations of an ISA. None where the CPU or the operating system does not run it.
pub fn packet_ops<E: PacketElement>(isa: Isa) -> Option<&'static [PacketOp<E>]> {
    isa.usable().then(|| E::table(isa))
}

/// The symbols of all packet operations in this build, whether this CPU runs them or not.
pub fn packet_op_symbols() -> impl Iterator<Item = &'static str> {
    fn of<E: PacketElement>(isa: Isa) -> impl Iterator<Item = &'static str> {
        E::table(isa).iter().map(|op| op.symbol)
    }
    Isa::ALL.into_iter().flat_map(|isa| of::<f32>(isa).chain(of::<f64>(isa)))
}
