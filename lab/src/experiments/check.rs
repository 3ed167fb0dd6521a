//! Compares kernels with their twins, on seeded inputs, before they are counted or timed.

pub mod inputs;
pub mod twins;

use std::fmt::{self, Debug};

use crate::measure::crash;
use inputs::{Argument, Input, Numbers, cases};
use rayo::internals::kernels::harness::lanes::{Number, Packet};
use rayo::internals::kernels::{
    AosKernels, Chain, CheckedCall, Crashed, Examined, Isa, Op, OpRef, PacketElement, PacketOp, Plain, Vec4, examine,
    packet_ops,
};
use rayo::internals::reference::aos::{Form, Lanes};
use rayo::internals::scene::Rng;

/// The seed of the inputs that the program uses.
const SEED: u64 = 1;
/// How many inputs the program tries from each source of numbers, of single vectors and of packets.
const CASES: u32 = 200;

/// A kernel that failed its check, and is not counted or timed.
#[derive(Clone, Debug, PartialEq)]
pub struct Failed {
    /// The symbol of the function that was called.
    pub symbol: String,
    /// The arguments of the call.
    pub arguments: Vec<Argument>,
    pub what: What,
}

/// How a kernel failed.
#[derive(Clone, Debug, PartialEq)]
pub enum What {
    /// Its result differs from its twin's. The list has every number of both.
    Result(Vec<ResultLane>),
    /// It broke rules of the calling convention.
    Convention(CheckedCall),
    Crash(Box<Crashed>),
}

/// A number of a result beside the expected one, with all of their digits.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ResultLane {
    pub expected: String,
    pub got: String,
    /// Whether both have the same bits, or both are NaN.
    pub same: bool,
}

impl std::error::Error for Failed {}

impl fmt::Display for Failed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Failed { symbol, arguments, what } = self;
        match what {
            What::Result(_) => write!(f, "{symbol} is wrong: it does not return what its twin does")?,
            What::Convention(_) => write!(f, "{symbol} breaks the calling convention")?,
            What::Crash(_) => write!(f, "{what}")?,
        }
        for Argument { name, numbers } in arguments {
            write!(f, "\n  {name:<11} {}", numbers.join(", "))?;
        }
        match what {
            What::Crash(_) => Ok(()),
            _ => write!(f, "\n{what}"),
        }
    }
}

impl fmt::Display for What {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lines: Vec<_> = match self {
            What::Result(lanes) => lanes.iter().enumerate().map(|(index, lane)| lane.in_words(index)).collect(),
            What::Convention(call) => call.broken.iter().map(|rule| format!("  broken      {rule}")).collect(),
            What::Crash(crashed) => vec![crash::describe(&crashed.crash, Some(crashed.symbol))],
        };
        f.write_str(&lines.join("\n"))
    }
}

impl ResultLane {
    fn in_words(&self, index: usize) -> String {
        let ResultLane { expected, got, same } = self;
        let verdict = if *same { "the same" } else { "WRONG" };
        format!("  lane {index}      expected {expected}, got {got}: {verdict}")
    }
}

/// Whether two results have the same bits, or both are NaN: 0 and -0 differ.
pub fn same<E: PacketElement>(a: E, b: E) -> bool {
    let (a, b) = (a.to_f64(), b.to_f64());
    a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan()
}

/// Compares a result with that of the twin.
fn compare<E: PacketElement + Debug>(got: &[E], expected: &[E]) -> Result<(), What> {
    if got.len() == expected.len() && got.iter().zip(expected).all(|(got, expected)| same(*got, *expected)) {
        return Ok(());
    }
    let lane = |(got, expected): (&E, &E)| ResultLane {
        expected: format!("{expected:?}"),
        got: format!("{got:?}"),
        same: same(*got, *expected),
    };
    Err(What::Result(got.iter().zip(expected).map(lane).collect()))
}

/// The result of an examined call, if the kernel kept every rule of the calling convention.
pub fn kept<R>(examined: Examined<R>) -> Result<R, What> {
    if let Some(call) = examined.broken.into_iter().next() {
        return Err(What::Convention(call));
    }
    examined.result.map_err(What::Crash)
}

/// The result of `work`, if every kernel that it called kept every rule of the calling convention.
///
/// # Errors
/// The first kernel that broke one.
pub fn kernels_in<R>(work: impl FnOnce() -> R) -> Result<R, Box<Failed>> {
    kept(examine(work)).map_err(|what| {
        let symbol = match &what {
            What::Convention(call) => call.symbol.into(),
            What::Crash(crashed) => crashed.symbol.into(),
            What::Result(_) => String::new(),
        };
        Box::new(Failed { symbol, arguments: Vec::new(), what })
    })
}

/// Makes a checked call of `op`. Each argument has an allocation of its own, so that a guard page
/// can stand beside it.
fn call_alone<A: Plain, B: Plain, O: Plain>(op: Op<A, B, O>, a: &A, b: &B) -> Result<O, What> {
    let (a, b, mut out) = (vec![*a], vec![*b], vec![O::ZERO]);
    kept(examine(|| op.call_into(&mut out[0], &a[0], &b[0])))?;
    Ok(out[0])
}

/// Makes a checked call of `op`, and returns its result; a scalar is in the first lane.
///
/// # Errors
/// A broken rule, or a crash.
///
/// # Panics
/// If `input` belongs to another kind of operation.
pub fn call(op: OpRef, input: &Input) -> Result<Lanes, What> {
    let vector = |result: Vec4| result.lanes();
    let scalar = |x: f32| [x, 0.0, 0.0, 0.0];
    match (op, input) {
        (OpRef::Vector(op), Input::Vectors(a, b)) => call_alone(op, a, b).map(vector),
        (OpRef::Scale(op), Input::Scale(a, b)) => call_alone(op, a, b).map(vector),
        (OpRef::Lambert(op), Input::Lambert(a, b)) => call_alone(op, a, b).map(vector),
        (OpRef::Scalar(op), Input::Vectors(a, b)) => call_alone(op, a, b).map(scalar),
        (OpRef::Sphere(op), Input::Sphere(a, b)) => call_alone(op, a, b).map(scalar),
        (OpRef::Triangle(op), Input::Triangle(a, b)) => call_alone(op, a, b).map(scalar),
        _ => panic!("{input:?} is not what the operation takes"),
    }
}

/// Makes one checked call of `op`, compares its result with the twin's, and returns the twin's.
///
/// # Errors
/// A lane that differs, a broken rule of the calling convention, or a crash.
pub fn one(op: OpRef, input: &Input, twin: &dyn Fn(&Input) -> Lanes) -> Result<Lanes, Box<Failed>> {
    let expected = twin(input);
    // A scalar result is in the first lane; the kernel does not write the others.
    let numbers = if matches!(op, OpRef::Scalar(_) | OpRef::Sphere(_) | OpRef::Triangle(_)) { 1 } else { 4 };
    let result = call(op, input).and_then(|got| compare(&got[..numbers], &expected[..numbers]));
    match result {
        Ok(()) => Ok(expected),
        Err(what) => Err(Box::new(Failed { symbol: op.symbol().into(), arguments: input.arguments(), what })),
    }
}

/// Compares `op` with its twin on inputs of every kind.
///
/// # Errors
/// The first input on which it failed.
pub fn operation(op: OpRef, twin: &dyn Fn(&Input) -> Lanes) -> Result<(), Box<Failed>> {
    cases(op, CASES, SEED).try_for_each(|case| one(op, &case.input, twin).map(drop))
}

/// Checks the single-vector macro `name` in that form against its twin; does nothing if there is no
/// such macro.
pub fn macros(form: Form, name: &str, kernels: &AosKernels) -> Result<(), Box<Failed>> {
    let op = kernels.ops().find(|(known, _)| *known == name);
    op.map_or(Ok(()), |(_, op)| operation(op, &|input| twins::of_macros(form, name, input)))
}

/// Checks the operation `name` on packets of an ISA; does nothing if there is none, or if this CPU
/// lacks the ISA.
pub fn packets<E: PacketElement + Number + Debug>(isa: Isa, name: &str) -> Result<(), Box<Failed>> {
    let Some(op) = packet_ops::<E>(isa).into_iter().flatten().find(|op| op.name == name) else { return Ok(()) };
    operation_on_packets(op, isa, CASES, SEED)
}

/// Compares an operation on packets with its twin, on zero to three packets, `count` times for each
/// source of numbers.
///
/// # Errors
/// The first vector whose result is wrong.
pub fn operation_on_packets<E: PacketElement + Number + Debug>(
    op: &PacketOp<E>,
    isa: Isa,
    count: u32,
    seed: u64,
) -> Result<(), Box<Failed>> {
    let mut rng = Rng::new(seed);
    for numbers in Numbers::ALL {
        for case in 0..count as usize {
            let mut next = || E::from_f64(numbers.next(&mut rng).into());
            let record: Vec<E> = (0..op.shape.record).map(|_| next()).collect();
            some_packets(op, isa, case % 4, &record, next)?;
        }
    }
    Ok(())
}

/// Compares an operation on packets, one that takes no record, with its twin, on a packet that has
/// the same vector in each lane.
///
/// # Errors
/// If the result is wrong, a rule of the calling convention is broken, or the kernel crashes.
pub fn one_on_packets<E: PacketElement + Number + Debug>(
    op: &PacketOp<E>,
    isa: Isa,
    a: &[E],
    b: &[E],
) -> Result<(), Box<Failed>> {
    let mut numbers = a.iter().chain(b).flat_map(|number| vec![*number; op.lanes]);
    some_packets(op, isa, 1, &[], || numbers.next().unwrap_or(E::ZERO))
}

/// Makes a checked call of `op` on a number of packets whose elements are `numbers`, with a record
/// if it takes one, and compares each vector's result with the twin's.
fn some_packets<E: PacketElement + Number + Debug>(
    op: &PacketOp<E>,
    isa: Isa,
    packets: usize,
    record: &[E],
    mut numbers: impl FnMut() -> E,
) -> Result<(), Box<Failed>> {
    let (shape, lanes, vectors) = (op.shape, op.lanes, packets * op.lanes);
    let mut many = |count: usize| (0..count).map(|_| numbers()).collect::<Vec<_>>();
    let a = many(3 * vectors);
    let mut b = many(shape.b_numbers * vectors);
    b.extend(record);
    let mut out = many(shape.out_numbers * vectors);
    let called = kept(examine(|| op.call(&mut out, &a, &b)));
    // The `count` numbers of one vector, which packets hold `lanes` apart.
    let of = |numbers: &[E], count: usize, vector: usize| -> Vec<E> {
        (0..count).map(|i| numbers[(vector / lanes * count + i) * lanes + vector % lanes]).collect()
    };
    let operands = |vector: usize| {
        let own = if record.is_empty() { of(&b, shape.b_numbers, vector) } else { record.to_vec() };
        (of(&a, 3, vector), own)
    };
    let failed = |vector: usize, what: What| {
        // With no packets there is no vector to name in an error.
        let (a, b) = if vectors > 0 { operands(vector) } else { Default::default() };
        let arguments = vec![Argument::new("a", &a), Argument::new("b", &b)];
        Box::new(Failed { symbol: op.symbol().into(), arguments, what })
    };
    called.map_err(|what| failed(0, what))?;
    for vector in 0..vectors {
        let (a, b) = operands(vector);
        let expected = twin_on_packets(op, isa, &a, &b);
        compare(&of(&out, shape.out_numbers, vector), &expected).map_err(|what| failed(vector, what))?;
    }
    Ok(())
}

/// What the twin of an operation on packets gives for one vector, rounded as that ISA rounds: fused
/// or not.
pub fn twin_on_packets<E: PacketElement + Number>(op: &PacketOp<E>, isa: Isa, a: &[E], b: &[E]) -> Vec<E> {
    let a = a.try_into().expect("a vector has three numbers");
    match isa {
        Isa::Sse41 => twins::of_packets::<Packet<E, 1, false>>(op.name, a, b),
        Isa::Avx2 | Isa::Avx512 => twins::of_packets::<Packet<E, 1, true>>(op.name, a, b),
    }
}

/// Checks that a chain of operations, which is to be timed, keeps the calling convention. Its
/// result needs no check: it is made by the operation's macro, which is checked by itself.
///
/// # Errors
/// A broken rule, or a crash.
pub fn chain(chain: Chain) -> Result<(), Box<Failed>> {
    kernels_in(|| chain.run(2)).map(drop)
}
