//! Chains of the paper's operations, dependent and independent, by which to measure how long one takes.

use super::isa::Isa;

/// A loop of operations.
#[derive(Clone, Copy)]
pub struct Chain {
    code: unsafe extern "sysv64" fn(rounds: u64) -> u64,
}

impl Chain {
    /// Runs it for so many rounds, at least one, and says how many operations that were.
    #[inline]
    pub fn run(self, rounds: u64) -> u64 {
        let rounds = rounds.max(1);
        // SAFETY: it reads constants of its own alone, and runs on what chains_of_paper(), chains_of_aos() and
        // chains_of_packets() have checked or, for FEEDBACK, every x86-64 CPU has: SSE.
        rounds * unsafe { (self.code)(rounds) }
    }
}

/// The two chains of an operation.
pub struct Chains {
    /// The operation.
    pub op: &'static str,
    /// Each operation needs the result of the one before, led back by as many feedbacks.
    pub latency: Chain,
    /// No operation needs another; each loads its operands.
    pub throughput: Chain,
}

macro_rules! chains {
    ($($static:ident: $($op:literal $latency:ident $throughput:ident),* $(,)?;)*) => {
        unsafe extern "sysv64" {
            $($(fn $latency(rounds: u64) -> u64; fn $throughput(rounds: u64) -> u64;)*)*
            fn rayo_feedback_latency(rounds: u64) -> u64;
        }
        $(static $static: &[Chains] = &[$(
            Chains { op: $op, latency: Chain { code: $latency }, throughput: Chain { code: $throughput } }
        ),*];)*
    };
}

chains! {
    PAPER:
        "add" rayo_paper_add_latency rayo_paper_add_throughput,
        "sub" rayo_paper_sub_latency rayo_paper_sub_throughput,
        "scale" rayo_paper_scale_latency rayo_paper_scale_throughput,
        "dot" rayo_paper_dot_latency rayo_paper_dot_throughput,
        "norm" rayo_paper_norm_latency rayo_paper_norm_throughput,
        "cross" rayo_paper_cross_latency rayo_paper_cross_throughput,
        "normalise" rayo_paper_normalise_latency rayo_paper_normalise_throughput,
        "sphere" rayo_paper_sphere_latency rayo_paper_sphere_throughput,
        "triangle" rayo_paper_triangle_latency rayo_paper_triangle_throughput,
        "lambert" rayo_paper_lambert_latency rayo_paper_lambert_throughput;
    AOS:
        "add" rayo_aos_add_latency rayo_aos_add_throughput,
        "sub" rayo_aos_sub_latency rayo_aos_sub_throughput,
        "scale" rayo_aos_scale_latency rayo_aos_scale_throughput,
        "dot" rayo_aos_dot_latency rayo_aos_dot_throughput,
        "norm" rayo_aos_norm_latency rayo_aos_norm_throughput,
        "cross" rayo_aos_cross_latency rayo_aos_cross_throughput,
        "normalise" rayo_aos_normalise_latency rayo_aos_normalise_throughput,
        "sphere" rayo_aos_sphere_latency rayo_aos_sphere_throughput,
        "triangle" rayo_aos_triangle_latency rayo_aos_triangle_throughput,
        "lambert" rayo_aos_lambert_latency rayo_aos_lambert_throughput;
}

/// Chains of the operations on packets of f32.
pub struct PacketChains {
    /// Of each operation.
    pub chains: [Chains; 10],
    /// What leads a result back to an operand in them, alone.
    pub feedback: Chain,
}

macro_rules! packet_chains {
    ($($static:ident = $isa:literal;)*) => {
        $(static $static: PacketChains = PacketChains {
            chains: packet_chains!(@ops $isa: "add" "sub" "scale" "dot" "norm" "cross" "normalise" "sphere" "triangle" "lambert"),
            feedback: packet_chains!(@chain $isa, "feedback_latency"),
        };)*
    };
    (@ops $isa:literal: $($op:literal)*) => {
        [$(Chains {
            op: $op,
            latency: packet_chains!(@chain $isa, concat!($op, "3_latency")),
            throughput: packet_chains!(@chain $isa, concat!($op, "3_throughput")),
        }),*]
    };
    (@chain $isa:literal, $name:expr) => {{
        unsafe extern "sysv64" {
            #[link_name = concat!("rayo_", $isa, "_single_", $name)]
            fn chain(rounds: u64) -> u64;
        }
        Chain { code: chain }
    }};
}

packet_chains! {
    SSE41 = "sse41";
    AVX2 = "avx2";
    AVX512 = "avx512";
}

/// Chains of the operations on packets. None where the CPU or the operating system does not run the ISA.
pub fn chains_of_packets(isa: Isa) -> Option<&'static PacketChains> {
    isa.usable().then_some(match isa {
        Isa::Sse41 => &SSE41,
        Isa::Avx2 => &AVX2,
        Isa::Avx512 => &AVX512,
    })
}

/// What leads a result back to an operand in the chains of latency of one vector, alone.
pub static FEEDBACK: Chain = Chain { code: rayo_feedback_latency };

/// Chains of the forms that the paper counts. None where the CPU lacks SSE4.1.
pub fn chains_of_paper() -> Option<&'static [Chains]> {
    Isa::Sse41.usable().then_some(PAPER)
}

/// Chains of the best forms. None where the CPU lacks SSE4.1.
pub fn chains_of_aos() -> Option<&'static [Chains]> {
    Isa::Sse41.usable().then_some(AOS)
}
