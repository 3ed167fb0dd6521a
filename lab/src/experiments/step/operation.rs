//! One operation on given vectors, by the kernels that tests and counts also call.

use super::WatchError;
use crate::experiments::check::inputs::Input;
use crate::experiments::check::{self, Failed, twins};
use rayo::internals::kernels::{self, Isa, OpRef, PacketOp, Vec4};
use rayo::internals::reference::aos::Form;
use rayo::internals::render::{Engine, EngineError};
use rayo::internals::scene::brief;

/// An upper bound on the instructions that one operation executes.
pub const MOST: usize = 1000;

pub struct Operation {
    of: Implementation,
    a: [f32; 3],
    b: [f32; 3],
}

enum Implementation {
    Paper(&'static str, OpRef),
    Packet(Isa, &'static PacketOp<f32>),
}

impl Implementation {
    fn name(&self) -> &'static str {
        match self {
            Implementation::Paper(name, _) => name,
            Implementation::Packet(_, op) => op.name,
        }
    }

    /// How many numbers the second operand has.
    fn b_numbers(&self) -> usize {
        match self {
            Implementation::Packet(_, op) => op.shape.b_numbers,
            Implementation::Paper(_, OpRef::Scale(_)) => 1,
            // Whether a single-vector operation reads b is taken from its packet form.
            Implementation::Paper(name, _) => {
                let on_packets =
                    kernels::packet_ops::<f32>(Isa::Sse41).into_iter().flatten().find(|op| op.name == *name);
                on_packets.map_or(3, |op| op.shape.b_numbers)
            }
        }
    }
}

/// The operations of an engine whose operands are all vectors or numbers.
fn on_vectors(engine: Engine, isa: Isa) -> Option<Vec<Implementation>> {
    if engine == Engine::Paper {
        let is_on_vectors = |op: &OpRef| matches!(op, OpRef::Vector(_) | OpRef::Scale(_) | OpRef::Scalar(_));
        let ops = kernels::paper()?.ops().filter(|(_, op)| is_on_vectors(op));
        return Some(ops.map(|(name, op)| Implementation::Paper(name, op)).collect());
    }
    let ops = kernels::packet_ops::<f32>(isa)?.iter().filter(|op| op.shape.record == 0);
    Some(ops.map(|op| Implementation::Packet(isa, op)).collect())
}

impl Operation {
    pub fn new(name: &str, engine: Engine, isa: Isa, a: Vec<f32>, b: Option<Vec<f32>>) -> Result<Self, WatchError> {
        let error = |what: String| Err(WatchError::Operation(what));
        let mut ops = on_vectors(engine, isa).ok_or(WatchError::Prepare(EngineError::Unusable(engine)))?;
        let Some(place) = ops.iter().position(|op| op.name() == name) else {
            let on_paper = on_vectors(Engine::Paper, Isa::Sse41).unwrap_or_default();
            if on_paper.iter().any(|op| op.name() == name) {
                return error(format!(
                    "`{name}` has no form on packets: --engine paper steps through the one that it has"
                ));
            }
            let list = ops.iter().map(Implementation::name).collect::<Vec<_>>().join(", ");
            return error(format!(
                "there is no operation `{}` on vectors alone; there are: {list}; what takes objects is seen with a scene",
                brief(name)
            ));
        };
        let of = ops.swap_remove(place);
        let Ok(a) = <[f32; 3]>::try_from(a) else {
            // The message also names the second operand if it is missing, so that one attempt shows
            // all that is needed.
            let second = ["", " and a number: --b 0.5", "", " and a second one: --b 4,5,6"][of.b_numbers()];
            return error(format!("`{name}` takes a vector of three numbers: --a 1,2,3{second}"));
        };
        let b = match (b.as_deref(), of.b_numbers()) {
            (Some(&[x, y, z]), 3) => [x, y, z],
            (Some(&[factor]), 1) => [factor; 3],
            (None, 0) => [0.0; 3],
            (_, 3) => return error(format!("`{name}` takes a second vector of three numbers: --b 4,5,6")),
            (_, 1) => return error(format!("`{name}` takes a number to scale by: --b 0.5")),
            _ => return error(format!("`{name}` takes one vector, and no --b")),
        };
        Ok(Operation { of, a, b })
    }

    /// Calls the operation and returns its result: three numbers, or one.
    pub fn call(&self) -> Vec<f32> {
        let vector = |[x, y, z]: [f32; 3]| Vec4::new(x, y, z);
        let (a, b) = (vector(self.a), vector(self.b));
        let of = |v: Vec4| vec![v.x, v.y, v.z];
        match self.of {
            Implementation::Paper(_, OpRef::Vector(op)) => of(op.call(&a, &b)),
            Implementation::Paper(_, OpRef::Scale(op)) => of(op.call(&a, &self.b[0])),
            Implementation::Paper(_, OpRef::Scalar(op)) => vec![op.call(&a, &b)],
            Implementation::Paper(..) => unreachable!("operations on vectors alone"),
            Implementation::Packet(_, op) => {
                // All lanes hold the same vector; each of its components is a packet.
                let packet = |vector: [f32; 3], numbers: usize| -> Vec<f32> {
                    vector[..numbers].iter().flat_map(|&v| vec![v; op.lanes]).collect()
                };
                let mut out = vec![0.0; op.shape.out_numbers * op.lanes];
                op.call(&mut out, &packet(self.a, 3), &packet(self.b, op.shape.b_numbers));
                out.into_iter().step_by(op.lanes).collect()
            }
        }
    }

    /// Compares the operation's result on these vectors with its twin's.
    ///
    /// # Errors
    /// If the result is wrong, a rule of the calling convention is broken, or the kernel crashes.
    pub fn check(&self) -> Result<(), Box<Failed>> {
        let vector = |[x, y, z]: [f32; 3]| Vec4::new(x, y, z);
        match self.of {
            Implementation::Paper(name, op) => {
                let (a, b) = (vector(self.a), vector(self.b));
                let input = match op {
                    OpRef::Scale(_) => Input::Scale(a, self.b[0]),
                    _ => Input::Vectors(a, b),
                };
                check::one(op, &input, &|input| twins::of_macros(Form::Paper, name, input)).map(drop)
            }
            Implementation::Packet(isa, op) => check::one_on_packets(op, isa, &self.a, &self.b[..op.shape.b_numbers]),
        }
    }
}
