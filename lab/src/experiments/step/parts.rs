//! Divides executed instructions into calls, loops and rounds, given only their addresses.

use std::collections::HashSet;
use std::ops::Range;

use rayo::internals::kernels::step::Visit;

/// A stretch of executed instructions, in the order of execution.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Stretch {
    /// Instructions outside of loops: the range of their numbers.
    Straight(Range<usize>),
    /// A loop: for each of its rounds, what the round consists of.
    Loop(Vec<Vec<Stretch>>),
}

impl Stretch {
    /// The range of numbers of its instructions.
    pub fn range(&self) -> Range<usize> {
        match self {
            Stretch::Straight(range) => range.clone(),
            Stretch::Loop(rounds) => {
                let mut parts = rounds.iter().flatten();
                let first = parts.next().expect("a loop has rounds, which have instructions").range();
                first.start..parts.next_back().map_or(first.end, |last| last.range().end)
            }
        }
    }
}

/// The range of numbers of the instructions in consecutive stretches.
pub fn range_of(parts: &[Stretch]) -> Range<usize> {
    match parts {
        [] => 0..0,
        [first, .., last] => first.range().start..last.range().end,
        [only] => only.range(),
    }
}

/// A loop in the code: from its first instruction to the last one that jumps back to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Loop {
    head: u64,
    tail: u64,
}

impl Loop {
    fn contains(self, address: u64) -> bool {
        (self.head..=self.tail).contains(&address)
    }
}

/// Divides one call of a kernel, which executed the instructions `range` of `visits`.
pub fn parts_of_call(visits: &[Visit], range: Range<usize>) -> Vec<Stretch> {
    let mut loops: Vec<Loop> = Vec::new();
    let (mut seen, mut no_heads) = (HashSet::new(), HashSet::new());
    for number in range.start..range.end.saturating_sub(1) {
        let (from, to) = (visits[number].rip, visits[number + 1].rip);
        seen.insert(from);
        if to > from || no_heads.contains(&to) {
            continue;
        }
        match loops.iter_mut().find(|known| known.head == to) {
            Some(known) => known.tail = known.tail.max(from),
            None if seen.contains(&to)
                || comes_again(&visits[number + 1..range.end], Loop { head: to, tail: from }) =>
            {
                loops.push(Loop { head: to, tail: from });
            }
            // Not a loop: a jump back from an out-of-line block.
            None => {
                no_heads.insert(to);
            }
        }
    }
    // Outer loops come before inner ones.
    loops.sort_by_key(|l| std::cmp::Reverse(l.tail - l.head));
    parts(visits, range, &loops)
}

/// Whether the last instruction of a candidate loop is executed before anything outside of it. If
/// so, the candidate is a loop that was entered at its test, which is at its end.
fn comes_again(visits: &[Visit], of: Loop) -> bool {
    let outside = |visit: &&Visit| !of.contains(visit.rip) || visit.rip == of.tail;
    visits.iter().find(outside).is_some_and(|visit| visit.rip == of.tail)
}

fn parts(visits: &[Visit], range: Range<usize>, loops: &[Loop]) -> Vec<Stretch> {
    let mut found = Vec::new();
    let mut at = range.start;
    let of = |number: usize| loops.iter().position(|l| l.contains(visits[number].rip));
    while at < range.end {
        let this = of(at);
        let Some(this) = this else {
            let end = (at + 1..range.end).find(|&number| of(number).is_some()).unwrap_or(range.end);
            found.push(Stretch::Straight(at..end));
            at = end;
            continue;
        };
        let (this, inner) = (loops[this], &loops[this + 1..]);
        // A loop may jump to out-of-line blocks and back, so that it lasts until its last
        // instruction was executed for the last time.
        let end = (at..range.end).rfind(|&number| this.contains(visits[number].rip)).map_or(range.end, |last| last + 1);
        let mut starts = vec![at];
        starts.extend((at + 1..end).filter(|&number| visits[number].rip == this.head));
        starts.push(end);
        found.push(Stretch::Loop(starts.windows(2).map(|round| parts(visits, round[0]..round[1], inner)).collect()));
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
        let inner =
            |rounds: [Range<usize>; 2]| Stretch::Loop(rounds.map(|round| vec![Stretch::Straight(round)]).to_vec());
        let expected = vec![
            Stretch::Straight(0..1),
            Stretch::Loop(vec![
                vec![Stretch::Straight(1..2), inner([2..4, 4..6]), Stretch::Straight(6..7)],
                vec![
                    Stretch::Straight(7..8),
                    Stretch::Loop(vec![vec![Stretch::Straight(8..10)]]),
                    Stretch::Straight(10..11),
                ],
            ]),
            Stretch::Straight(11..12),
        ];
        assert_eq!(parts_of_call(&visits, 0..12), expected);
    }

    #[test]
    fn jump_back_from_code_aside_is_no_loop() {
        // Block 8 is out of line and jumps back to 3; the loop is 2 to 4.
        let aside = parts_of_call(&visits(&[1, 2, 8, 3, 4, 2, 8, 3, 4, 2, 3, 4, 5]), 0..13);
        let rounds = [1..5, 5..9, 9..12].map(|round| vec![Stretch::Straight(round)]).to_vec();
        assert_eq!(aside, [Stretch::Straight(0..1), Stretch::Loop(rounds), Stretch::Straight(12..13)]);
        // 1 jumps to 4, the loop's test at its end.
        let entered = parts_of_call(&visits(&[1, 4, 2, 3, 4, 2, 3, 4, 5]), 0..9);
        let rounds = vec![vec![Stretch::Straight(1..2)], vec![Stretch::Straight(2..5)], vec![Stretch::Straight(5..8)]];
        assert_eq!(entered, [Stretch::Straight(0..1), Stretch::Loop(rounds), Stretch::Straight(8..9)]);
    }

    #[test]
    fn what_jumps_nowhere_back_is_a_row() {
        assert_eq!(parts_of_call(&visits(&[1, 2, 5, 6]), 0..4), [Stretch::Straight(0..4)]);
    }
}
