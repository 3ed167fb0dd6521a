//! What was executed, in its parts: calls of kernels, loops and their rounds, out of the order of addresses alone.

use std::ops::Range;

use crate::kernels::step::Visit;

/// Instructions in the order of their execution.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Part {
    /// One after another, by their numbers.
    Row(Range<usize>),
    /// A loop: the parts of each of its rounds.
    Loop(Vec<Vec<Part>>),
}

impl Part {
    /// The numbers of its instructions.
    pub fn range(&self) -> Range<usize> {
        match self {
            Part::Row(range) => range.clone(),
            Part::Loop(rounds) => {
                let mut parts = rounds.iter().flatten();
                let first = parts.next().expect("a loop has rounds, which have instructions").range();
                first.start..parts.next_back().map_or(first.end, |last| last.range().end)
            }
        }
    }
}

/// The numbers of the instructions of some parts.
pub fn range_of(parts: &[Part]) -> Range<usize> {
    match parts {
        [] => 0..0,
        [first, .., last] => first.range().start..last.range().end,
        [only] => only.range(),
    }
}

/// A loop in the code: from its first instruction to the last that jumps back to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Loop {
    head: u64,
    tail: u64,
}

impl Loop {
    fn contains(self, address: u64) -> bool {
        (self.head..=self.tail).contains(&address)
    }

    fn is_within(self, other: Loop) -> bool {
        self != other && other.contains(self.head) && other.contains(self.tail)
    }
}

/// The parts of the instructions `range` of `visits`, which one call of a kernel executed.
pub fn parts_of_call(visits: &[Visit], range: Range<usize>) -> Vec<Part> {
    let mut loops: Vec<Loop> = Vec::new();
    for pair in visits[range.clone()].windows(2) {
        let (from, to) = (pair[0].rip, pair[1].rip);
        if to <= from {
            match loops.iter_mut().find(|known| known.head == to) {
                Some(known) => known.tail = known.tail.max(from),
                None => loops.push(Loop { head: to, tail: from }),
            }
        }
    }
    // The outer before the inner.
    loops.sort_by_key(|l| std::cmp::Reverse(l.tail - l.head));
    parts(visits, range, &loops)
}

fn parts(visits: &[Visit], range: Range<usize>, loops: &[Loop]) -> Vec<Part> {
    let mut found = Vec::new();
    let mut at = range.start;
    while at < range.end {
        let of = |number: usize| loops.iter().copied().find(|l| l.contains(visits[number].rip));
        let this = of(at);
        let end = (at + 1..range.end).find(|&number| of(number) != this).unwrap_or(range.end);
        found.push(match this {
            None => Part::Row(at..end),
            Some(this) => {
                let inner: Vec<_> = loops.iter().copied().filter(|l| l.is_within(this)).collect();
                let mut starts = vec![at];
                starts.extend((at + 1..end).filter(|&n| visits[n].rip == this.head && visits[n - 1].rip >= this.head));
                starts.push(end);
                Part::Loop(starts.windows(2).map(|round| parts(visits, round[0]..round[1], &inner)).collect())
            }
        });
        at = end;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn visits(addresses: &[u64]) -> Vec<Visit> {
        addresses.iter().map(|&rip| Visit { rip, address: 0, bytes: 0 }).collect()
    }

    #[test]
    fn loops_within_loops_are_told_apart() {
        let visits = visits(&[1, 2, 3, 4, 3, 4, 5, 2, 3, 4, 5, 6]);
        let inner = |rounds: &[Range<usize>]| Part::Loop(rounds.iter().map(|r| vec![Part::Row(r.clone())]).collect());
        let expected = vec![
            Part::Row(0..1),
            Part::Loop(vec![
                vec![Part::Row(1..2), inner(&[2..4, 4..6]), Part::Row(6..7)],
                vec![Part::Row(7..8), inner(&[8..10]), Part::Row(10..11)],
            ]),
            Part::Row(11..12),
        ];
        assert_eq!(parts_of_call(&visits, 0..12), expected);
    }

    #[test]
    fn what_jumps_nowhere_back_is_a_row() {
        assert_eq!(parts_of_call(&visits(&[1, 2, 5, 6]), 0..4), [Part::Row(0..4)]);
    }
}
