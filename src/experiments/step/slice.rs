//! Which instructions made a pixel: followed from its bytes back to what they were made of.

use std::collections::HashSet;

use super::model::{Element, Operation, Place};
use crate::kernels::step::Step;

/// A byte of a place; of masks and flags a bit.
type Unit = (Place, u64);

fn units(element: &Element) -> impl Iterator<Item = Unit> + use<> {
    let Element { place, at, .. } = *element;
    let (first, end) = match place {
        Place::Mask(_) | Place::Flags => (at, element.end()),
        _ => (at / 8, element.end().div_ceil(8)),
    };
    (first..end).map(move |unit| (place, unit))
}

/// What an instruction has to do with a pixel.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Part {
    /// The operations that the pixel is made of, by their places among the instruction's.
    pub made: Vec<usize>,
    /// Whether it looks at memory that the pixel is made of.
    pub looks: bool,
}

impl Part {
    /// Whether it has anything to do with it.
    pub fn any(&self) -> bool {
        self.looks || !self.made.is_empty()
    }
}

/// What each of `steps`, with its operations, has to do with the elements `of`, which are there in the end. Data is followed,
/// and what selects it; addresses and jumps are not.
pub fn slice(steps: &[(Step, Vec<Operation>)], of: impl IntoIterator<Item = Element>) -> Vec<Part> {
    let mut needed: HashSet<Unit> = of.into_iter().flat_map(|element| units(&element).collect::<Vec<_>>()).collect();
    let mut found = vec![Part::default(); steps.len()];
    for ((step, operations), part) in steps.iter().zip(&mut found).rev() {
        part.looks = step.touched.is_some_and(|touched| {
            let bytes = touched.address..touched.address + u64::from(touched.bytes);
            bytes.into_iter().any(|byte| needed.contains(&(Place::Memory, byte)))
        });
        let is_needed = |operation: &Operation| units(&operation.to).any(|unit| needed.contains(&unit));
        part.made = (0..operations.len()).filter(|&index| is_needed(&operations[index])).collect();
        for &index in &part.made {
            for unit in units(&operations[index].to) {
                needed.remove(&unit);
            }
        }
        for &index in &part.made {
            needed.extend(operations[index].sources().flat_map(units));
        }
    }
    found
}
