//! Which instructions made a pixel: traced back from its bytes.

use std::collections::HashSet;
use std::ops::Range;

use super::model::{Element, Operation, Place, What};
use super::shadow::StepError;
use crate::kernels::step::Step;

/// A byte of a place; of masks and flags a bit.
type Unit = (Place, u64);

fn units(element: &Element) -> impl DoubleEndedIterator<Item = Unit> + use<> {
    let Element { place, at, .. } = *element;
    let (first, end) = match place {
        Place::Mask(_) | Place::Flags => (at, element.end()),
        _ => (at / 8, element.end().div_ceil(8)),
    };
    (first..end).map(move |unit| (place, unit))
}

/// An operation that a pixel is made of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Made {
    /// Its place among the instruction's.
    pub operation: usize,
    /// The part of its element, from the first unit to the last that are needed: bytes of the place, of masks bits.
    pub units: Range<u64>,
}

/// What an instruction has to do with a pixel.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Part {
    /// What the pixel is made of.
    pub made: Vec<Made>,
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
pub fn slice(steps: &[(Step, StepError)], of: impl IntoIterator<Item = Element>) -> Vec<Part> {
    let mut needed: HashSet<Unit> = of.into_iter().flat_map(|element| units(&element).collect::<Vec<_>>()).collect();
    let mut found = vec![Part::default(); steps.len()];
    for ((_, StepError { operations, .. }), part) in steps.iter().zip(&mut found).rev() {
        let reads = operations.iter().flat_map(Operation::sources).filter(|source| source.place == Place::Memory);
        part.looks = reads.flat_map(units).any(|unit| needed.contains(&unit));
        for (index, operation) in operations.iter().enumerate() {
            let mut of_it = units(&operation.to).filter(|unit| needed.contains(unit)).map(|(_, at)| at);
            if let Some(first) = of_it.next() {
                part.made.push(Made { operation: index, units: first..of_it.next_back().unwrap_or(first) + 1 });
            }
        }
        for made in &part.made {
            for unit in units(&operations[made.operation].to) {
                needed.remove(&unit);
            }
        }
        for Made { operation, units: of_it } in &part.made {
            let Operation { to, what, from, by } = &operations[*operation];
            match (what, &from[..]) {
                // Of what is copied, the same part.
                (What::Copy, [source]) if source.bits == to.bits && to.bits >= 8 && source.at % 8 == to.at % 8 => {
                    let skipped = of_it.start - to.at / 8;
                    let first = source.at / 8 + skipped;
                    needed.extend((first..first + (of_it.end - of_it.start)).map(|unit| (source.place, unit)));
                    needed.extend(by.iter().flat_map(units));
                }
                _ => needed.extend(from.iter().chain(by).flat_map(units)),
            }
        }
    }
    found
}
