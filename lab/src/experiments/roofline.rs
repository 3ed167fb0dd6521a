//! The roofline: how close the kernels come to the limits of the core and of its caches.

pub mod plot;

use serde::{Deserialize, Serialize};

use super::accuracy::subjects::shipped;
use super::in_size;
use super::jumps::{Bandwidth, bandwidth};
use super::lab::{Bench, Case, LabError, Progress, Timed};
use super::ladder::SIZE;
use crate::measure::Name;
use crate::measure::instructions::{Instruction, decode};
use crate::measure::source::Unit;
use crate::measure::statistics::minimum;
use crate::measure::{Clock, Work, interleave};
use rayo::internals::kernels::Cache;
use rayo::internals::kernels::{self, Isa, Vec4, code_at, step};
use rayo::internals::render::{Engine, Film, PixelFormat, Purpose};
use rayo::internals::scene::Scene;

/// The scenes; each gives a point per engine.
const SCENES: [&str; 2] = ["sphere", "tetrahedron"];
/// The size of the picture in which instructions are counted by single-stepping.
const COUNTED: (u32, u32) = (32, 24);
/// An upper bound on the instructions that a picture of that size takes.
const MOST: usize = 1 << 20;
const RUNS: usize = 15;
/// How many rounds of multiplications are timed at once: about 50 microseconds of them.
const ROUNDS: u64 = 10_000;

/// The peak arithmetic of an instruction set.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Peak {
    pub isa: Name,
    /// Multiplications and additions of f32 per TSC cycle.
    pub flops_per_cycle: f64,
}

/// An engine's kernels on a scene: a point of the figure.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Point {
    pub scene: Name,
    pub engine: Name,
    pub output: Name,
    /// Arithmetic operations executed per pixel. In each lane an addition, a product, a quotient or
    /// a root counts as one.
    pub flops_per_pixel: f64,
    /// The bytes that the picture has per pixel.
    pub bytes_per_pixel: f64,
    /// TSC cycles per pixel in the fastest run.
    pub cycles_per_pixel: f64,
}

#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Roofline {
    pub peaks: Vec<Peak>,
    /// How fast each level of memory takes the widest stores.
    pub roofs: Vec<Bandwidth>,
    /// A point per engine and scene; empty where instructions cannot be counted.
    pub points: Vec<Point>,
    /// Why instructions cannot be counted.
    pub uncounted: Option<String>,
}

/// How many times [`run`] calls `proceed`.
pub const WORK: u64 = 3;

/// Measures the limits and the points. None if `proceed` returns false.
///
/// # Errors
/// If there is no memory for a picture.
pub fn run(caches: &[Cache], clock: &mut dyn Clock, proceed: &mut Progress<'_>) -> Result<Option<Roofline>, LabError> {
    let mut roofline = Roofline { peaks: peaks(clock), ..Roofline::default() };
    if !proceed(1) {
        return Ok(None);
    }
    // Filling with zeros calls the C library's `memset`, which uses the CPU's widest stores.
    roofline.roofs = bandwidth(caches, RUNS, clock, |pixels, _| pixels.fill(Vec4::default()))?;
    if !proceed(1) {
        return Ok(None);
    }
    for name in SCENES {
        let scene = shipped(name);
        match points(name, &scene, clock) {
            Ok(points) => roofline.points.extend(points),
            Err(LabError::Uncounted(reason)) => roofline.uncounted = Some(reason.to_string()),
            Err(error) => return Err(error),
        }
    }
    Ok(proceed(1).then_some(roofline))
}

fn usable() -> impl Iterator<Item = Isa> {
    Isa::ALL.into_iter().filter(|isa| isa.usable())
}

/// Measures the peak rate of fused multiplications and additions, with enough independent ones in
/// flight to fill the core's pipes.
fn peaks(clock: &mut dyn Clock) -> Vec<Peak> {
    let of = |isa: Isa| {
        let chain = kernels::chains_of_packets(isa)?.muladd;
        let operations = chain.run(1) * ROUNDS;
        let mut work: [Work<'_>; 1] = [Box::new(|| {
            chain.run(ROUNDS);
        })];
        let runs = interleave(clock, &mut work, 0..RUNS, &mut || true)?;
        let flops = 2.0 * (isa.lanes() as u64 * operations) as f64;
        Some(Peak { isa: isa.name().into(), flops_per_cycle: flops / minimum(&runs[0].ticks) })
    };
    usable().filter_map(of).collect()
}

/// The points of all engines in assembly on a scene.
fn points(name: &'static str, scene: &Scene, clock: &mut dyn Clock) -> Result<Vec<Point>, LabError> {
    let of_assembly = |engine: &&Engine| engine.usable() && matches!(engine, Engine::Packet(_) | Engine::Paper);
    let engines: Vec<Engine> = Engine::ALL.iter().filter(of_assembly).copied().collect();
    let (small, large) = (in_size(scene, COUNTED.0, COUNTED.1), in_size(scene, SIZE.0, SIZE.1));
    let mut flops = Vec::new();
    for engine in &engines {
        flops.push(flops_of(*engine, &small)? / small.camera.pixels() as f64);
    }
    let case = |engine: &Engine| Case::of(Timed::Tracing, &large, *engine, Purpose::default(), PixelFormat::F32x4);
    let cases = engines.iter().map(case).collect::<Result<Vec<_>, _>>()?;
    let runs = Bench::default().time(clock, &cases, 0..RUNS, &mut || true)?.expect("nobody stops it");
    let point = |((engine, flops_per_pixel), runs): ((&Engine, f64), crate::measure::Runs)| Point {
        scene: name.into(),
        engine: engine.name().into(),
        output: PixelFormat::F32x4.name().into(),
        flops_per_pixel,
        bytes_per_pixel: PixelFormat::F32x4.bytes() as f64,
        cycles_per_pixel: minimum(&runs.ticks) / large.camera.pixels() as f64,
    };
    Ok(engines.iter().zip(flops).zip(runs).map(point).collect())
}

/// The arithmetic operations that an engine executes for a whole picture, by single-stepping.
fn flops_of(engine: Engine, scene: &Scene) -> Result<f64, LabError> {
    let isa = match engine {
        Engine::Packet(isa) => isa,
        _ => Isa::Sse41,
    };
    let unit = Unit::of(isa).ok_or(step::Unavailable::Platform)?;
    let tracer = engine.prepare(None, scene)?;
    let mut film = Film::new(PixelFormat::F32x4, scene.camera.pixels() as usize)?;
    let trace = || tracer.rows(0..scene.camera.height(), film.as_mut());
    let visits = step::visits(std::slice::from_ref(&unit.code), MOST, trace)?.visits;
    let code = code_at(unit.code.start).and_then(|code| code.get(..unit.code.len()));
    let code = code.ok_or(step::Unavailable::Platform)?;
    let of: Vec<(usize, u32)> = decode(code, 0).map(|instruction| (instruction.offset, flops(&instruction))).collect();
    let at = |rip: u64| {
        let place = of.binary_search_by_key(&(rip as usize - unit.code.start), |(offset, _)| *offset);
        place.map_or(0, |place| of[place].1)
    };
    Ok(visits.iter().map(|visit| f64::from(at(visit.rip))).sum())
}

/// The number of f32 or f64 operations of one instruction, over all its lanes.
fn flops(instruction: &Instruction) -> u32 {
    let (mnemonic, operands) = instruction.text.split_once(' ').unwrap_or((&instruction.text, ""));
    let name = mnemonic.strip_prefix('v').unwrap_or(mnemonic);
    let bytes = if operands.contains("zmm") {
        64
    } else if operands.contains("ymm") {
        32
    } else {
        16
    };
    let Some((operation, kind)) = name.split_at_checked(name.len().saturating_sub(2)) else { return 0 };
    let lanes = match kind {
        "ss" | "sd" => 1,
        "ps" => bytes / 4,
        "pd" => bytes / 8,
        _ => return 0,
    };
    match operation.trim_end_matches(|c: char| c.is_ascii_digit()) {
        "add" | "sub" | "mul" | "div" | "sqrt" | "rsqrt" | "rcp" | "hadd" | "addsub" => lanes,
        "fmadd" | "fmsub" | "fnmadd" | "fnmsub" => 2 * lanes,
        // A dot product of four elements has four products and three additions.
        "dp" => 2 * lanes - 1,
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn operations_are_counted_in_all_lanes() {
        for (bytes, expected) in [
            (&[0x0f, 0x59, 0xc1][..], 4),                // mulps xmm0, xmm1
            (&[0xf3, 0x0f, 0x58, 0xc1], 1),              // addss xmm0, xmm1
            (&[0xc4, 0xe2, 0x75, 0xa8, 0xc2], 16),       // vfmadd213ps ymm0, ymm1, ymm2
            (&[0x62, 0xf1, 0xf5, 0x48, 0x5e, 0xc2], 8),  // vdivpd zmm0, zmm1, zmm2
            (&[0x0f, 0x54, 0xc1], 0),                    // andps xmm0, xmm1
            (&[0x66, 0x0f, 0x3a, 0x40, 0xc1, 0x71], 7),  // dpps xmm0, xmm1, 0x71
            (&[0x62, 0xf2, 0x7d, 0x48, 0x4e, 0xc1], 16), // vrsqrt14ps zmm0, zmm1
            (&[0xc3], 0),                                // ret
        ] {
            let instruction = decode(bytes, 0).next().unwrap();
            assert_eq!(flops(&instruction), expected, "{}", instruction.text);
        }
    }
}
