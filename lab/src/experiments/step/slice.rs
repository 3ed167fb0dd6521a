//! Finds the instructions that made a pixel, by following its bytes backwards.

use std::collections::HashSet;
use std::ops::Range;

use super::model::{Element, Operation, Place, What};
use super::shadow::{ShadowedStep, StepError};

/// The unit of dependence: a byte of a place or, in masks and flags, a bit.
type Unit = (Place, u64);

fn units(element: &Element) -> impl DoubleEndedIterator<Item = Unit> + use<> {
    let Element { place, at, .. } = *element;
    let (first, end) = match place {
        Place::Mask(_) | Place::Flags => (at, element.end()),
        _ => (at / 8, element.end().div_ceil(8)),
    };
    (first..end).map(move |unit| (place, unit))
}

/// An operation on whose result a pixel depends.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NeededResult {
    /// The operation's index among those of the instruction.
    pub operation: usize,
    /// The units of its element from the first to the last that is needed: bytes of the place or,
    /// in masks, bits.
    pub units: Range<u64>,
}

/// What an instruction contributes to a pixel.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Contribution {
    /// The operations on whose results the pixel depends.
    pub made: Vec<NeededResult>,
    /// Whether the instruction reads memory on which the pixel depends.
    pub looks: bool,
}

impl Contribution {
    /// Whether the instruction contributes anything.
    pub fn any(&self) -> bool {
        self.looks || !self.made.is_empty()
    }
}

/// What each of `steps` contributes to the final values of the elements `of`. Dependences through
/// data and selections are followed; those through addresses and jumps are not.
pub fn slice(steps: &[ShadowedStep<'_>], of: impl IntoIterator<Item = Element>) -> Vec<Contribution> {
    let mut needed: HashSet<Unit> = of.into_iter().flat_map(|element| units(&element).collect::<Vec<_>>()).collect();
    let mut found = vec![Contribution::default(); steps.len()];
    for (ShadowedStep { error: StepError { operations, .. }, .. }, part) in steps.iter().zip(&mut found).rev() {
        let reads = operations.iter().flat_map(Operation::sources).filter(|source| source.place == Place::Memory);
        part.looks = reads.flat_map(units).any(|unit| needed.contains(&unit));
        for (index, operation) in operations.iter().enumerate() {
            let mut of_it = units(&operation.to).filter(|unit| needed.contains(unit)).map(|(_, at)| at);
            if let Some(first) = of_it.next() {
                part.made.push(NeededResult { operation: index, units: first..of_it.next_back().unwrap_or(first) + 1 });
            }
        }
        for made in &part.made {
            for unit in units(&operations[made.operation].to) {
                needed.remove(&unit);
            }
        }
        for NeededResult { operation, units: of_it } in &part.made {
            let Operation { to, what, from, by, .. } = &operations[*operation];
            match (what, &from[..]) {
                // Of a copy's source the same part is needed as of its destination.
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
