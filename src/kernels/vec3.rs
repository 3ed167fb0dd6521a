//! The arguments of operations on packets of vectors, and chains of operations by which latency and
//! throughput are measured.

use std::marker::PhantomData;

use super::kernel::{Callee, Kernel, function, kinds, reads, writes};
use super::records::Element;

/// The number of operands that an operation on packets has beside its vectors, and of its results.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// The elements of `b` per vector: 3; 1 for scalars; 0 if there are none.
    pub b_numbers: usize,
    /// The elements of `b` that all vectors share, which make up a record.
    pub record: usize,
    /// The elements of the result per vector: 3, or 1 for scalars.
    pub out_numbers: usize,
}

/// An operation on packets of vectors. A packet of vectors is LANES x, then LANES y, then LANES z;
/// a packet of scalars is LANES of them. The type is not `Copy`, since the owner of a copy could
/// change the lengths that the kernel relies on.
pub struct PacketOp<E> {
    /// The operation's name, as in [`AosKernels`](super::AosKernels).
    pub name: &'static str,
    /// The number of vectors in a packet.
    pub lanes: usize,
    /// The number of elements that `b` and the result have.
    pub shape: Shape,
    /// The kernel, which takes (out, a, b, packets), in accordance with `lanes` and `shape`.
    pub(super) kernel: Kernel<PhantomData<E>>,
}

/// The code of an operation on packets, which can be read even if the CPU lacks its instructions.
pub struct PacketOpCode {
    pub name: &'static str,
    pub symbol: &'static str,
    pub address: usize,
    /// The number of vectors in a packet.
    pub lanes: usize,
    /// The number of elements that `b` and the result have.
    pub shape: Shape,
}

impl<E: Element> PacketOp<E> {
    /// The code of the operation.
    pub fn code(&self) -> PacketOpCode {
        PacketOpCode {
            name: self.name,
            symbol: self.symbol(),
            address: self.address(),
            lanes: self.lanes,
            shape: self.shape,
        }
    }

    /// The symbol by which the linker knows the operation, such as `rayo_paper_dot`.
    pub fn symbol(&self) -> &'static str {
        self.kernel.symbol()
    }

    pub fn address(&self) -> usize {
        self.kernel.address()
    }

    /// Writes the results for all packets of `a`, with `b`, to `out`.
    ///
    /// # Panics
    /// If the lengths are not those of the same number of whole packets, and of a record if the
    /// operation takes one.
    #[inline]
    pub fn call(&self, out: &mut [E], a: &[E], b: &[E]) {
        let packets = a.len() / (3 * self.lanes);
        let vectors = packets * self.lanes;
        let Shape { b_numbers, record, out_numbers } = self.shape;
        let fits =
            a.len() == 3 * vectors && b.len() == b_numbers * vectors + record && out.len() == out_numbers * vectors;
        assert!(fits, "{} takes whole packets of {}, as many in each", self.name, self.lanes);
        // SAFETY: all three slices have this number of packets, and `b` has the record. The kernel
        // requires no alignment, only reads and writes these slices, and any bits are elements.
        unsafe { self.kernel.enter([writes(out), reads(a), reads(b), packets as u64, 0, 0]) };
    }
}

kinds! {
    /// A loop that executes an operation over and over.
    Chain

    /// Runs the loop for this many rounds, at least one. Returns the number of operations executed.
    fn run(rounds: u64) -> u64; |way| {
        let Callee::Code(enter) = way;
        // The kernel only reads its own constants.
        let rounds = rounds.max(1);
        rounds * enter([rounds, 0, 0, 0, 0, 0])
    }
}

/// The two chains by which an operation is timed.
pub struct Chains {
    pub op: &'static str,
    /// Each operation needs the previous result, which a feedback turns into its operand.
    pub latency: Chain,
    /// The operations are independent; each loads its operands.
    pub throughput: Chain,
}

/// Chains of all operations on packets of f32.
pub struct PacketChains {
    pub chains: &'static [Chains],
    /// The feedback of the latency chains by itself.
    pub feedback: Chain,
    /// Multiply-adds of packets that are independent of each other.
    pub muladd: Chain,
}
