//! The executed instructions as a tree: kernels, the macros in them, and instructions.

use std::collections::HashMap;

use super::Item;
use super::describe::{Origin, Value, same_register};
use super::shadow::ShadowedStep;
use crate::measure::source::{Call, Macro, Parameter, Unit};
use rayo::internals::kernels::step::State;

/// A node of the tree.
#[derive(Clone, Debug)]
pub enum Node {
    Kernel {
        symbol: String,
        /// The first sentence of the comment above the macro that makes the kernel.
        says: &'static str,
        /// What the kernel executed.
        children: Vec<Node>,
    },
    Macro {
        name: &'static str,
        /// The first sentence of the comment above the macro.
        says: &'static str,
        /// The source file of the macro.
        file: &'static str,
        /// The line of the call, in the source file of the enclosing macro or kernel.
        line: usize,
        comment: &'static str,
        /// The arguments of the call.
        arguments: Vec<Argument>,
        instructions: usize,
        /// What the macro executed.
        children: Vec<Node>,
    },
    /// Instructions that a row executes once, not for each pixel.
    Once {
        instructions: usize,
        /// The instructions and macros among these.
        children: Vec<Node>,
    },
    /// An instruction, by its index among the lines of the document.
    Step(usize),
    /// This number of padding instructions before an alignment.
    Padding(usize),
    /// Instructions that make other pixels.
    Others {
        /// The number of rounds of a loop, or of calls of a kernel.
        rounds: usize,
        instructions: usize,
    },
}

/// An argument of a macro.
#[derive(Clone, Debug)]
pub struct Argument {
    pub name: &'static str,
    /// The direction of the parameter: `in`, `out`, `in/out` or `clobbered`.
    pub kind: &'static str,
    /// The contents of a register before the macro and after it: the value in the shown lane or,
    /// for a single vector, all elements.
    pub values: Option<[Vec<Value>; 2]>,
}

/// The index that stands for [`Node::Once`] among indices of macro calls.
const ONCE: usize = usize::MAX;

/// A leaf of the tree, with the macro calls around it.
struct Leaf {
    node: Node,
    calls: Vec<usize>,
    /// The index of the leaf's step.
    step: Option<usize>,
    /// Whether the row executes the leaf once, not for each pixel.
    once: bool,
}

/// The trees of the shown items of each kernel call. `line_of` maps the index of a step to the
/// index of its line.
pub fn grow(
    unit: &'static Unit,
    calls: &[Vec<Item>],
    steps: &[ShadowedStep<'_>],
    line_of: &HashMap<usize, usize>,
    lane: Option<usize>,
) -> Vec<Node> {
    let grower = Grower { unit, steps, lane };
    calls.iter().map(|items| grower.kernel(items, line_of)).collect()
}

struct Grower<'a> {
    unit: &'static Unit,
    steps: &'a [ShadowedStep<'a>],
    lane: Option<usize>,
}

impl Grower<'_> {
    fn kernel(&self, items: &[Item], line_of: &HashMap<usize, usize>) -> Node {
        if let [Item::Others { rounds, instructions }] = *items {
            return Node::Others { rounds, instructions };
        }
        let unit = self.unit;
        let mut leaves: Vec<Leaf> = Vec::new();
        let mut symbol = "";
        for item in items {
            // Neither padding nor skipped rounds have a source line. Both are placed in the same
            // macros as the leaf before them.
            let (calls, once) = leaves.last().map_or((Vec::new(), false), |leaf| (leaf.calls.clone(), leaf.once));
            leaves.push(match *item {
                Item::Step(at) | Item::Once(at) => {
                    let (rip, once) = (self.steps[at].step.before.rip, matches!(item, Item::Once(_)));
                    symbol = unit.function(rip as usize).map_or(symbol, |function| function.symbol);
                    let (node, calls) = match unit.line(rip as usize) {
                        Some(_) => (Node::Step(line_of[&at]), Origin::of(unit, rip).calls),
                        None => (Node::Padding(1), calls),
                    };
                    Leaf { node, calls, step: Some(at), once }
                }
                Item::Others { rounds, instructions } => {
                    Leaf { node: Node::Others { rounds, instructions }, calls, step: None, once }
                }
            });
        }
        // Macro calls that enclose all leaves make up the kernel itself.
        let mut depth = leaves.first().map_or(0, |leaf| leaf.calls.len());
        for leaf in &leaves {
            let same = leaves[0].calls.iter().zip(&leaf.calls).take_while(|(a, b)| a == b).count();
            depth = depth.min(same);
        }
        leaves.iter_mut().filter(|leaf| leaf.once).for_each(|leaf| leaf.calls.insert(depth, ONCE));
        let kernel = leaves.first().and_then(|leaf| leaf.calls.get(depth.checked_sub(1)?));
        let says = kernel.map_or("", |&call| unit.macros[unit.calls[call].of].says);
        Node::Kernel { symbol: symbol.into(), says, children: self.nodes(&leaves, depth) }
    }

    fn nodes(&self, leaves: &[Leaf], depth: usize) -> Vec<Node> {
        let together = |a: &Leaf, b: &Leaf| a.calls.len() > depth && a.calls.get(depth) == b.calls.get(depth);
        let group = |group: &[Leaf]| match group {
            [leaf] if leaf.calls.len() <= depth => leaf.node.clone(),
            group if group[0].calls[depth] == ONCE => Node::Once {
                instructions: group.iter().filter(|leaf| leaf.step.is_some()).count(),
                children: self.nodes(group, depth + 1),
            },
            group => self.called(group, group[0].calls[depth], depth),
        };
        let mut nodes: Vec<Node> = Vec::new();
        for node in leaves.chunk_by(together).map(group) {
            match (nodes.last_mut(), node) {
                (Some(Node::Padding(count)), Node::Padding(more)) => *count += more,
                (_, node) => nodes.push(node),
            }
        }
        nodes
    }

    fn called(&self, leaves: &[Leaf], call: usize, depth: usize) -> Node {
        let Call { of, line, comment, arguments, .. } = &self.unit.calls[call];
        let Macro { name, file, says, parameters } = &self.unit.macros[*of];
        let (line, comment) = (*line, *comment);
        let mut steps = leaves.iter().filter_map(|leaf| leaf.step).map(|at| &self.steps[at].step);
        let first = steps.next();
        let last = steps.next_back().or(first);
        let states = first.zip(last).map(|(first, last)| [first.before, last.after]);
        let argument = |(parameter, &is): (&Parameter, &&'static str)| Argument {
            name: parameter.name,
            kind: parameter.kind,
            values: states.and_then(|states| self.values(is, parameter.says, states)),
        };
        let arguments = parameters.iter().zip(arguments).map(argument).collect();
        let instructions = leaves.iter().filter(|leaf| leaf.step.is_some()).count();
        let children = self.nodes(leaves, depth + 1);
        Node::Macro { name, says, file, line, comment, arguments, instructions, children }
    }

    /// The elements of a register in two states, before and after; `says` is the description of its
    /// parameter.
    fn values(&self, register: &str, says: &str, states: [&State; 2]) -> Option<[Vec<Value>; 2]> {
        let vector = (0..32).find(|number| same_register(register, &format!("xmm{number}")))?;
        let elements = match self.lane {
            Some(lane) => lane..lane + 1,
            None if says.starts_with("scalar") => 0..1,
            None => 0..3,
        };
        let value = |state: &State| -> Vec<Value> {
            let bytes = &state.vectors[vector];
            let float = |lane: usize| f32::from_le_bytes(bytes[4 * lane..4 * lane + 4].try_into().expect("four bytes"));
            elements.clone().map(|lane| Value::Single(float(lane))).collect()
        };
        Some(states.map(value))
    }
}
