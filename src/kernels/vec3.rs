//! The arguments of operations on packets of vectors, and chains of operations to measure their
//! latency and throughput.

use std::marker::PhantomData;

use super::kernel::{Kernel, Way, function, kinds, reads, writes};
use super::records::Element;

/// The operands of an operation on packets beside its vectors, and its result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Elements of `b` for each vector: 3, 1 for scalars, 0 if there are none.
    pub b_numbers: usize,
    /// Elements of `b` that all vectors share: those of a record.
    pub record: usize,
    /// Elements of the result for each vector: 3, or 1 for scalars.
    pub out_numbers: usize,
}

/// An operation on packets of vectors: LANES x, then LANES y, then LANES z; a packet of scalars is
/// LANES of them. It is not `Copy`, since the owner of a copy could change the lengths that the
/// kernel relies on.
pub struct PacketOp<E> {
    /// The operation's name, as in [`AosKernels`](super::AosKernels).
    pub name: &'static str,
    /// Vectors in a packet.
    pub lanes: usize,
    /// The shapes of `b` and the result.
    pub shape: Shape,
    /// Takes (out, a, b, packets), according to `lanes` and `shape`.
    pub(super) kernel: Kernel<PhantomData<E>>,
}

/// The code of an operation on packets: to be read, also where the CPU lacks its instructions.
pub struct PacketOpCode {
    pub name: &'static str,
    pub symbol: &'static str,
    pub address: usize,
    /// See [`PacketOp::lanes`].
    pub lanes: usize,
    /// See [`PacketOp::shape`].
    pub shape: Shape,
}

impl<E: Element> PacketOp<E> {
    /// What is known of its code.
    pub fn code(&self) -> PacketOpCode {
        PacketOpCode {
            name: self.name,
            symbol: self.symbol(),
            address: self.address(),
            lanes: self.lanes,
            shape: self.shape,
        }
    }

    /// The symbol of its code.
    pub fn symbol(&self) -> &'static str {
        self.kernel.symbol()
    }

    pub fn address(&self) -> usize {
        self.kernel.address()
    }

    /// Writes the results for all packets of `a` and for `b` to `out`.
    ///
    /// # Panics
    /// If the lengths are not those of the same number of whole packets, and of a record if there
    /// is one.
    #[inline]
    pub fn call(&self, out: &mut [E], a: &[E], b: &[E]) {
        let packets = a.len() / (3 * self.lanes);
        let vectors = packets * self.lanes;
        let Shape { b_numbers, record, out_numbers } = self.shape;
        let fits =
            a.len() == 3 * vectors && b.len() == b_numbers * vectors + record && out.len() == out_numbers * vectors;
        assert!(fits, "{} takes whole packets of {}, as many in each", self.name, self.lanes);
        // SAFETY: all three have this many packets and `b` a record; the kernel asks for no
        // alignment, reads and writes only those, and any bits are elements.
        unsafe { self.kernel.enter([writes(out), reads(a), reads(b), packets as u64, 0, 0]) };
    }
}

kinds! {
    /// A loop of operations.
    Chain

    /// Runs it for this many rounds, at least one, and returns the number of operations.
    fn run(rounds: u64) -> u64; |way| {
        let Way::Code(enter) = way;
        // It reads only its own constants.
        let rounds = rounds.max(1);
        rounds * enter([rounds, 0, 0, 0, 0, 0])
    }
}

/// The two chains of an operation.
pub struct Chains {
    pub op: &'static str,
    /// Each operation needs the previous result, led back by as many feedbacks.
    pub latency: Chain,
    /// The operations are independent; each loads its operands.
    pub throughput: Chain,
}

/// Chains of the operations on packets of f32.
pub struct PacketChains {
    pub chains: &'static [Chains],
    /// Their feedback alone.
    pub feedback: Chain,
    /// Multiply-adds of packets that are independent of each other.
    pub muladd: Chain,
}
