//! One operation on given vectors, by the kernels that tests and counts call.

use super::WatchError;
use crate::kernels::{self, Isa, OpRef, PacketOp, Vec4};
use crate::render::Engine;
use crate::scene::brief;

/// More than any operation executes.
pub const MOST: usize = 1000;

pub struct Operation {
    of: Of,
    a: [f32; 3],
    b: [f32; 3],
}

enum Of {
    Paper(OpRef),
    Packet(&'static PacketOp<f32>),
}

impl Operation {
    pub fn new(name: &str, engine: Engine, isa: Isa, a: Vec<f32>, b: Option<Vec<f32>>) -> Result<Self, WatchError> {
        let error = |what: String| Err(WatchError::Operation(what));
        let unusable = || WatchError::Prepare(crate::render::EngineError::Unusable(engine));
        // Those that take vectors and nothing else.
        let ops = kernels::packet_ops::<f32>(isa).ok_or_else(unusable)?.iter().filter(|op| op.shape.record == 0);
        let Some(op) = ops.clone().find(|op| op.name == name) else {
            let list = ops.map(|op| op.name).collect::<Vec<_>>().join(", ");
            return error(format!(
                "there is no operation `{}` on vectors alone; there are: {list}; what takes objects is seen with a scene",
                brief(name)
            ));
        };
        let Ok(a) = <[f32; 3]>::try_from(a) else {
            // What else is missing is told at once.
            let second = ["", " and a number: --b 0.5", "", " and a second one: --b 4,5,6"][op.shape.b_numbers];
            return error(format!("`{name}` takes a vector of three numbers: --a 1,2,3{second}"));
        };
        let b = match (b.as_deref(), op.shape.b_numbers) {
            (Some(&[x, y, z]), 3) => [x, y, z],
            (Some(&[factor]), 1) => [factor; 3],
            (None, 0) => [0.0; 3],
            (_, 3) => return error(format!("`{name}` takes a second vector of three numbers: --b 4,5,6")),
            (_, 1) => return error(format!("`{name}` takes a number to scale by: --b 0.5")),
            _ => return error(format!("`{name}` takes one vector, and no --b")),
        };
        let of = if engine == Engine::Paper {
            let kernels = kernels::paper().ok_or_else(unusable)?;
            Of::Paper(kernels.ops().find(|(known, _)| *known == name).expect("the names are its own").1)
        } else {
            Of::Packet(op)
        };
        Ok(Operation { of, a, b })
    }

    /// The result: three numbers, or one.
    pub fn call(&self) -> Vec<f32> {
        let vector = |[x, y, z]: [f32; 3]| Vec4::new(x, y, z);
        let (a, b) = (vector(self.a), vector(self.b));
        let of = |v: Vec4| vec![v.x, v.y, v.z];
        match self.of {
            Of::Paper(OpRef::Vector(op)) => of(op.call(&a, &b)),
            Of::Paper(OpRef::Scale(op)) => of(op.call(&a, &self.b[0])),
            Of::Paper(OpRef::Scalar(op)) => vec![op.call(&a, &b)],
            Of::Paper(_) => unreachable!("operations on vectors alone"),
            Of::Packet(op) => {
                // All lanes have the same vector, each of its elements in a packet of its own.
                let packet = |vector: [f32; 3], numbers: usize| -> Vec<f32> {
                    vector[..numbers].iter().flat_map(|&v| vec![v; op.lanes]).collect()
                };
                let mut out = vec![0.0; op.shape.out_numbers * op.lanes];
                op.call(&mut out, &packet(self.a, 3), &packet(self.b, op.shape.b_numbers));
                out.into_iter().step_by(op.lanes).collect()
            }
        }
    }
}
