//! The operations to be proved: the paper's and those on packets, from the tables of kernels.

use super::symbol::{Carrier, ScalarSymbol, Symbol};
use super::{Call, InputNumber, ResultNumber, Subject};
use crate::experiments::check::twins::{self, Operands};
use crate::experiments::step::model::Number;
use rayo::internals::kernels::{
    self, Isa, Light, OpRef, PacketElement, PacketOpCode, PaperSphere, PaperTriangle, Surface, Vec4,
};
use rayo::internals::reference::aos::{self, Form};
use rayo::internals::render::Precision;

/// The addresses of the result and of the first and second operand in the machine's memory.
pub const OUT: u64 = 0x1_0000_0000;
pub const A: u64 = 0x2_0000_0000;
pub const B: u64 = 0x3_0000_0000;

/// The numbers of the general registers that hold the first four arguments of a function.
pub const ARGUMENT_REGISTERS: [usize; 4] = [7, 6, 2, 1];

/// All operations: the paper's in both forms, and those on packets for all instruction sets, in
/// both precisions.
pub fn all() -> Vec<Subject> {
    let mut all = Vec::new();
    for (form, table) in [(Form::Paper, kernels::paper()), (Form::Best, kernels::aos())] {
        all.extend(table.into_iter().flat_map(|table| table.ops()).map(|(name, op)| of_macros(form, name, op)));
    }
    for isa in Isa::ALL {
        all.extend(kernels::packet_op_codes::<f32>(isa).into_iter().map(|code| of_packets::<f32>(isa, code)));
        all.extend(kernels::packet_op_codes::<f64>(isa).into_iter().map(|code| of_packets::<f64>(isa, code)));
    }
    all
}

/// The macros of asm/include that an operation consists of: on single vectors, and on packets.
fn macros_of(operation: &str) -> [&'static [&'static str]; 2] {
    match operation {
        "add" => [&["VEC_ADD"], &["ADD3"]],
        "sub" => [&["VEC_SUB"], &["SUB3"]],
        "scale" => [&["VEC_SCALE"], &["SCALE3"]],
        "dot" => [&["VEC_DOT", "VEC_SUM"], &["DOT3"]],
        "norm" => [&["VEC_NORM"], &["NORM3"]],
        "cross" => [&["VEC_CROSS"], &["CROSS3"]],
        "normalise" => [&["VEC_NORMALISE"], &["NORMALISE3"]],
        "sphere" => [&["SPHERE_HIT"], &["SPHERE_HIT3"]],
        "triangle" => [&["TRIANGLE_HIT", "PLANE_NORMAL", "SAME_SIDE"], &["TRIANGLE_HIT3"]],
        "lambert" | "lambert2" => [&["LAMBERT"], &["LAMBERT3"]],
        _ => panic!("the operation `{operation}` needs its macros in lab/src/experiments/prove/operations.rs"),
    }
}

/// The four numbers from `first` on.
fn vector<S: Copy>(numbers: &[S], first: usize) -> [S; 4] {
    numbers[first..first + 4].try_into().expect("four")
}

/// The operands of an operation, made of the numbers in `a` and in `b`.
fn operands<S: Copy>(op: OpRef, a: &[S], b: &[S]) -> Operands<S> {
    match op {
        OpRef::Vector(_) | OpRef::Scalar(_) => Operands::Vectors(vector(a, 0), vector(b, 0)),
        OpRef::Scale(_) => Operands::Scale(vector(a, 0), b[0]),
        OpRef::Sphere(_) => {
            let sphere = aos::Sphere { centre: vector(b, 0), colour: vector(b, 4), radius: b[8] };
            Operands::Sphere(vector(a, 0), sphere)
        }
        OpRef::Triangle(_) => {
            let vertices = [0, 4, 8].map(|first| vector(b, first));
            Operands::Triangle(vector(a, 0), aos::Triangle { vertices, colour: vector(b, 12) })
        }
        OpRef::Lambert(_) => {
            let surface = aos::Surface { point: vector(a, 0), normal: vector(a, 4), colour: vector(a, 8) };
            Operands::Lambert(surface, aos::Light { position: vector(b, 0), radiance: vector(b, 4) })
        }
    }
}

/// How many numbers the first operand, the second operand and the result have.
fn sizes(op: OpRef) -> [usize; 3] {
    match op {
        OpRef::Vector(_) => [4, 4, 4],
        OpRef::Scale(_) => [4, 1, 4],
        OpRef::Scalar(_) => [4, 4, 1],
        OpRef::Sphere(_) => [4, size_of::<PaperSphere>() / 4, 1],
        OpRef::Triangle(_) => [4, size_of::<PaperTriangle>() / 4, 1],
        OpRef::Lambert(_) => [size_of::<Surface>() / 4, size_of::<Light>() / 4, 4],
    }
}

/// Calls an operation on operands that are made of these numbers.
fn call(op: OpRef, a: &[f32], b: &[f32]) -> Vec<f32> {
    let at = |numbers: &[f32], first| Vec4::from(vector(numbers, first));
    match op {
        OpRef::Vector(op) => op.call(&at(a, 0), &at(b, 0)).lanes().to_vec(),
        OpRef::Scale(op) => op.call(&at(a, 0), &b[0]).lanes().to_vec(),
        OpRef::Scalar(op) => vec![op.call(&at(a, 0), &at(b, 0))],
        OpRef::Sphere(op) => {
            let sphere = PaperSphere { centre: at(b, 0), colour: at(b, 4), radius: b[8], padding: [0.0; 3] };
            vec![op.call(&at(a, 0), &sphere)]
        }
        OpRef::Triangle(op) => {
            let triangle = PaperTriangle { v1: at(b, 0), v2: at(b, 4), v3: at(b, 8), colour: at(b, 12) };
            vec![op.call(&at(a, 0), &triangle)]
        }
        OpRef::Lambert(op) => {
            let surface = Surface { point: at(a, 0), normal: at(a, 4), colour: at(a, 8) };
            op.call(&surface, &Light { position: at(b, 0), radiance: at(b, 4) }).lanes().to_vec()
        }
    }
}

/// One of the paper's operations, in one form.
pub fn of_macros(form: Form, name: &'static str, op: OpRef) -> Subject {
    let [a_count, b_count, out_count] = sizes(op);
    let names = |operand: &str, count: usize| (0..count).map(|i| format!("{operand}{i}")).collect::<Vec<_>>();
    let (a, b) = (names("a", a_count), names("b", b_count));
    let mut inputs = Vec::new();
    for (base, names) in [(A, &a), (B, &b)] {
        for (i, name) in names.iter().enumerate() {
            let address = base + 4 * i as u64;
            inputs.push(InputNumber { address, format: Number::Single, name: name.clone() });
        }
    }
    let (a_of_twin, b_of_twin) = (a.clone(), b.clone());
    let twin = move |_| {
        let symbols = |names: &[String]| names.iter().map(|name| ScalarSymbol::named(name)).collect::<Vec<_>>();
        let operands = operands(op, &symbols(&a_of_twin), &symbols(&b_of_twin));
        twins::of_macros_on(form, name, &operands)[..out_count].iter().map(|symbol| symbol.0).collect()
    };
    let call = move |given: &dyn Fn(&str) -> u64| {
        let numbers = |names: &[String]| names.iter().map(|name| f32::of_bits(given(name))).collect::<Vec<_>>();
        call(op, &numbers(&a), &numbers(&b)).into_iter().map(Carrier::bits).collect()
    };
    let result = |i: u64| ResultNumber { address: OUT + 4 * i, format: Number::Single };
    Subject {
        name,
        form: if form == Form::Paper { "paper" } else { "aos" },
        isa: Isa::Sse41,
        precision: Precision::Single,
        macros: macros_of(name)[0],
        symbol: op.symbol(),
        address: op.address(),
        registers: vec![(ARGUMENT_REGISTERS[0], OUT), (ARGUMENT_REGISTERS[1], A), (ARGUMENT_REGISTERS[2], B)],
        inputs,
        results: vec![(0..out_count as u64).map(result).collect()],
        twin: Box::new(twin),
        call: Some(Box::new(call)),
    }
}

/// An operation on one packet, each lane of which has inputs of its own, and a record for all
/// lanes.
pub fn of_packets<E: PacketElement + Carrier>(isa: Isa, code: PacketOpCode) -> Subject {
    let PacketOpCode { name, symbol, address, lanes, shape } = code;
    let bytes = size_of::<E>();
    let at = |base: u64, i: usize, lane: usize| base + ((i * lanes + lane) * bytes) as u64;
    let input = |address: u64, name: String| InputNumber { address, format: E::FORMAT, name };
    let mut inputs = Vec::new();
    for lane in 0..lanes {
        inputs.extend((0..3).map(|i| input(at(A, i, lane), format!("a{i}@{lane}"))));
        inputs.extend((0..shape.b_numbers).map(|i| input(at(B, i, lane), format!("b{i}@{lane}"))));
    }
    inputs.extend((0..shape.record).map(|i| input(B + (i * bytes) as u64, format!("b{i}"))));
    let result = |i: usize, lane: usize| ResultNumber { address: at(OUT, i, lane), format: E::FORMAT };
    let results = (0..lanes).map(|lane| (0..shape.out_numbers).map(|i| result(i, lane)).collect());
    let twin = move |lane: usize| {
        let a = [0, 1, 2].map(|i| E::named(&format!("a{i}@{lane}")));
        let mut b: Vec<E> = (0..shape.b_numbers).map(|i| E::named(&format!("b{i}@{lane}"))).collect();
        b.extend((0..shape.record).map(|i| E::named(&format!("b{i}"))));
        let found = match isa {
            Isa::Sse41 => twins::of_packets::<Symbol<E, false>>(name, a, &b),
            Isa::Avx2 | Isa::Avx512 => twins::of_packets::<Symbol<E, true>>(name, a, &b),
        };
        found.into_iter().map(E::node).collect()
    };
    Subject {
        name,
        form: "packets",
        isa,
        precision: if bytes == 4 { Precision::Single } else { Precision::Double },
        macros: macros_of(name)[1],
        symbol,
        address,
        registers: vec![
            (ARGUMENT_REGISTERS[0], OUT),
            (ARGUMENT_REGISTERS[1], A),
            (ARGUMENT_REGISTERS[2], B),
            (ARGUMENT_REGISTERS[3], 1),
        ],
        inputs,
        results: results.collect(),
        twin: Box::new(twin),
        call: kernels::packet_ops::<E>(isa).and_then(|ops| call_packets(ops, name)),
    }
}

/// Calls an operation on one packet. The results are in the order of its lanes.
fn call_packets<E: PacketElement + Carrier>(ops: &'static [kernels::PacketOp<E>], name: &str) -> Option<Call> {
    let op = ops.iter().find(|op| op.name == name)?;
    let (lanes, shape) = (op.lanes, op.shape);
    Some(Box::new(move |given| {
        let packet = |operand: &str, count: usize| -> Vec<E> {
            let names = (0..count).flat_map(|i| (0..lanes).map(move |lane| (i, lane)));
            names.map(|(i, lane)| E::of_bits(given(&format!("{operand}{i}@{lane}")))).collect()
        };
        let (a, mut b) = (packet("a", 3), packet("b", shape.b_numbers));
        b.extend((0..shape.record).map(|i| E::of_bits(given(&format!("b{i}")))));
        let mut out = vec![<E as kernels::Plain>::ZERO; shape.out_numbers * lanes];
        op.call(&mut out, &a, &b);
        let of_lane = |lane| (0..shape.out_numbers).map(move |i| i * lanes + lane);
        (0..lanes).flat_map(of_lane).map(|at| out[at].bits()).collect()
    }))
}
