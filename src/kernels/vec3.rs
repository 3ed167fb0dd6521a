//! The paper's vector operations on packets: a table of them per ISA, and safe calls.

use super::checked::{self, Fault};
use super::isa::Isa;

/// An operation on packets of vectors, in f32: LANES x, then LANES y, then LANES z; a packet of scalars is LANES of them.
#[derive(Clone, Copy)]
pub struct PacketOp {
    /// The operation's name, as in [`AosKernels`](super::AosKernels).
    pub name: &'static str,
    /// Vectors in a packet.
    pub lanes: usize,
    /// Numbers of `b` for each vector: 3, 1 for scalars, 0 where it is not read.
    pub b_numbers: usize,
    /// Numbers of the result for each vector: 3, or 1 for scalars.
    pub out_numbers: usize,
    code: unsafe extern "sysv64" fn(out: *mut f32, a: *const f32, b: *const f32, n: usize),
}

impl PacketOp {
    /// Writes the results for all packets of `a` and `b` to `out`.
    ///
    /// # Panics
    /// Where the lengths are not those of the same number of whole packets.
    #[inline]
    pub fn call(&self, out: &mut [f32], a: &[f32], b: &[f32]) {
        let packets = self.packets(out, a, b);
        // SAFETY: packets() proves that all three have so many packets; the kernel asks for no alignment, reads and writes
        // those packets alone, and any bits are f32. The table it came from was handed out by a function that had checked
        // the CPU.
        unsafe { (self.code)(out.as_mut_ptr(), a.as_ptr(), b.as_ptr(), packets) }
    }

    /// As [`PacketOp::call`], with a look at whether the kernel keeps the calling convention.
    pub fn call_checked(&self, out: &mut [f32], a: &[f32], b: &[f32]) -> Result<(), Vec<Fault>> {
        let packets = self.packets(out, a, b);
        let args = [out.as_mut_ptr() as u64, a.as_ptr() as u64, b.as_ptr() as u64, packets as u64, 0, 0];
        // SAFETY: as in call; these are the four arguments of its signature.
        unsafe { checked::call(self.code as *const (), args) }
    }

    /// Where its code is.
    pub fn address(&self) -> usize {
        self.code as usize
    }

    fn packets(&self, out: &[f32], a: &[f32], b: &[f32]) -> usize {
        let packets = a.len() / (3 * self.lanes);
        let vectors = packets * self.lanes;
        let fits =
            a.len() == 3 * vectors && b.len() == self.b_numbers * vectors && out.len() == self.out_numbers * vectors;
        assert!(fits, "{} takes whole packets of {}, as many in each", self.name, self.lanes);
        packets
    }
}

macro_rules! packet_ops {
    ($($static:ident = $isa:literal, $lanes:literal;)*) => {
        $(static $static: [PacketOp; 7] = [
            packet_ops!(@op $isa, $lanes, "add", 3, 3),
            packet_ops!(@op $isa, $lanes, "sub", 3, 3),
            packet_ops!(@op $isa, $lanes, "scale", 1, 3),
            packet_ops!(@op $isa, $lanes, "dot", 3, 1),
            packet_ops!(@op $isa, $lanes, "norm", 0, 1),
            packet_ops!(@op $isa, $lanes, "cross", 3, 3),
            packet_ops!(@op $isa, $lanes, "normalise", 0, 3),
        ];)*
    };
    (@op $isa:literal, $lanes:literal, $name:literal, $b:literal, $out:literal) => {{
        unsafe extern "sysv64" {
            #[link_name = concat!("rayo_", $isa, "_", $name, "3")]
            fn kernel(out: *mut f32, a: *const f32, b: *const f32, n: usize);
        }
        PacketOp { name: $name, lanes: $lanes, b_numbers: $b, out_numbers: $out, code: kernel }
    }};
}

packet_ops! {
    SSE41 = "sse41", 4;
    AVX2 = "avx2", 8;
    AVX512 = "avx512", 16;
}

/// The packet operations of an ISA. None where the CPU or the operating system does not run it.
pub fn packet_ops(isa: Isa) -> Option<&'static [PacketOp]> {
    isa.usable().then_some(match isa {
        Isa::Sse41 => &SSE41,
        Isa::Avx2 => &AVX2,
        Isa::Avx512 => &AVX512,
    })
}
