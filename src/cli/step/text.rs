//! The tree of `rayo step` in lines of text.

use crate::experiments::step::{Argument, Change, Line, Node, Value, Watched};
use crate::measure::instructions::Mix;

/// How it is told.
pub struct How {
    /// Macros deeper than this are one line each.
    pub depth: Option<usize>,
    /// The one macro that is told of.
    pub only: Option<String>,
    /// Whether there are colours.
    pub colour: bool,
}

impl How {
    fn styled(&self, code: &str, text: &str) -> String {
        if self.colour && !text.is_empty() { format!("\u{1b}[{code}m{text}\u{1b}[0m") } else { text.into() }
    }

    fn dim(&self, text: &str) -> String {
        self.styled("2", text)
    }

    fn bold(&self, text: &str) -> String {
        self.styled("1", text)
    }

    fn green(&self, text: &str) -> String {
        self.styled("32", text)
    }

    fn red(&self, text: &str) -> String {
        self.styled("31", text)
    }
}

/// Columns of the instruction's text.
const SOURCE: usize = 44;

/// All of it.
pub fn text(watched: &Watched, how: &How) -> String {
    let mut out = String::new();
    head(&mut out, watched, how);
    nodes(&mut out, &watched.tree, watched, how, 0, how.only.is_none());
    end(&mut out, watched);
    out
}

fn head(out: &mut String, watched: &Watched, how: &How) {
    let Watched { engine, precision, pixel, lane, lanes, .. } = watched;
    let of = match pixel {
        Some([x, y]) => format!("pixel {x},{y} by {engine} in {precision}"),
        None => format!("one operation by {engine}"),
    };
    let lane = lane.map_or(String::new(), |lane| format!(", lane {lane} of {lanes}"));
    *out += &format!("{}\n", how.bold(&(of + &lane)));
}

fn nodes(out: &mut String, of: &[Node], watched: &Watched, how: &How, depth: usize, told: bool) {
    let indent = "  ".repeat(depth);
    for node in of {
        match node {
            Node::Kernel { symbol, says, children } => {
                if told {
                    let says = if says.is_empty() { String::new() } else { format!(" - {says}") };
                    *out += &format!("\n{}{}\n", how.bold(symbol), how.dim(&says));
                }
                nodes(out, children, watched, how, depth + 1, told);
            }
            Node::Macro { name, says, file, line, comment, arguments, instructions, children } => {
                let wanted = told || how.only.as_deref() == Some(name);
                // The kernel is the first level.
                let folded = how.depth.is_some_and(|most| depth > most);
                if wanted {
                    let count = if *instructions == 1 {
                        "1 instruction".into()
                    } else {
                        format!("{instructions} instructions")
                    };
                    if folded {
                        let values = values(arguments);
                        *out += &format!("{indent}{line:>4}  {}{values}  {}\n", how.bold(name), how.dim(&count));
                        continue;
                    }
                    let mark = if comment.is_empty() { String::new() } else { format!("  ; {comment}") };
                    *out += &format!("{indent}{line:>4}  {}{}\n", how.bold(name), how.dim(&mark));
                    let says = if says.is_empty() { String::new() } else { format!("{says} ") };
                    *out += &format!("{indent}      {}\n", how.dim(&format!("{says}({file}, {count})")));
                }
                nodes(out, children, watched, how, depth + 1, wanted);
            }
            Node::Step(at) if told => {
                *out += &indent;
                step(out, &watched.steps[*at], how);
            }
            Node::Others { rounds, instructions } if told => {
                let rounds = if *rounds == 1 { "one round".into() } else { format!("{rounds} rounds") };
                *out += &how.dim(&format!("{indent}      … {rounds} for other pixels or without effect on this one: {instructions} instructions\n"));
            }
            Node::Step(_) | Node::Others { .. } => {}
        }
    }
}

fn step(out: &mut String, line: &Line, how: &How) {
    let Line { line: number, source, text, changed, branch, comment, unknown, made, .. } = line;
    let source = if source.is_empty() { text } else { source };
    let padded = format!("{source:<SOURCE$}");
    let padded = if *made || branch.is_some() { padded } else { how.dim(&padded) };
    let mut told: Vec<_> = changed.iter().map(|change| changes(change, how)).collect();
    if let Some(branch) = branch {
        let taken = if branch.taken { "taken" } else { "not taken" };
        told.push(format!("{}, {}", how.green(taken), branch.why));
    }
    let comment = if comment.is_empty() { String::new() } else { how.dim(&format!("  ; {comment}")) };
    *out += &format!("{number:>4}  {padded}  {}{comment}", told.join("; "));
    out.truncate(out.trim_end().len());
    *out += "\n";
    if let Some(unknown) = unknown {
        *out += &format!("      {}\n", how.red(&format!("the model: {unknown}")));
    }
}

/// One element alone, more in brackets.
fn elements(values: &[Value]) -> String {
    match values {
        [value] => value.to_string(),
        values => format!("({})", values.iter().map(Value::to_string).collect::<Vec<_>>().join(", ")),
    }
}

fn changes(change: &Change, how: &How) -> String {
    let Change { name, before, after, .. } = change;
    let (before, after) = (elements(before), elements(after));
    format!("{} {} {} {}", how.bold(name), how.dim(&before), how.dim("→"), after)
}

/// What went into a macro, and what came out.
fn values(arguments: &[Argument]) -> String {
    let mut told = String::new();
    for Argument { name, kind, values, .. } in arguments {
        let Some([before, after]) = values else { continue };
        told += &match *kind {
            "in" => format!("  {name} {}", elements(before)),
            "out" => format!("  {name} → {}", elements(after)),
            kind if kind.starts_with("in/out") => format!("  {name} {} → {}", elements(before), elements(after)),
            _ => continue,
        };
    }
    told
}

fn end(out: &mut String, watched: &Watched) {
    let Watched { instructions, unknown, bits_compared, hit, colour, result, kinds, .. } = watched;
    *out += "\n";
    let vector = |v: &[f64; 3]| format!("({}, {}, {})", v[0], v[1], v[2]);
    if colour.is_some() {
        *out += &match hit {
            Some(hit) => {
                let normal = hit.normal.as_ref().map_or(String::new(), |n| format!(", N = {}", vector(n)));
                format!("hits {} at t = {}, P = {}{normal}\n", hit.object, hit.t, vector(&hit.point))
            }
            None => "hits nothing\n".into(),
        };
    }
    if let Some([r, g, b]) = colour {
        *out += &format!("colour ({r}, {g}, {b}), linear\n");
    }
    if let Some(result) = result {
        let values: Vec<_> = result.iter().map(f32::to_string).collect();
        *out += &format!("result ({})\n", values.join(", "));
    }
    let Mix { arithmetic, shuffle, load, store, branch, r#move, other, .. } = kinds;
    let kinds = [
        (arithmetic, "arithmetic"),
        (shuffle, "shuffles"),
        (load, "loads"),
        (store, "stores"),
        (branch, "jumps"),
        (r#move, "moves"),
        (other, "others"),
    ];
    let kinds: Vec<_> = kinds.iter().filter(|(count, _)| **count > 0).map(|(n, name)| format!("{n} {name}")).collect();
    *out += &format!("{instructions} instructions: {}\n", kinds.join(", "));
    *out += &format!(
        "the model of the instructions against the CPU: {bits_compared} bits compared, {unknown} unknown or wrong\n"
    );
}
