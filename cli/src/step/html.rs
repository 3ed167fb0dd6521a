//! The page of `rayo step --html`: a single file with a folding tree, through which the arrow keys
//! step.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::text;
use rayo_lab::experiments::step::{Change, Line, Node, Value, Watched};

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");

/// The page; with `error`, the errors against exact values are shown.
pub fn page(watched: &Watched, scene: &str, error: bool) -> String {
    let title = format!("{} - rayo step", text::title(watched));
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                header {
                    h1 { (text::title(watched)) }
                    p { (scene) }
                    pre { (text::outcome(watched)) }
                    p.hint { "Arrow keys step from instruction to instruction; Enter opens and closes the macro around it." }
                }
                main {
                    section.tree aria-label="instructions" { @for node in &watched.tree { (tree(node, watched, error)) } }
                    aside aria-label="registers" {
                        h2 { "Registers" }
                        table { tbody id="registers" {} }
                    }
                }
                footer {
                    h2 { "What it took" }
                    pre { (text::work(watched)) @if error { (text::dearest(watched, None)) } }
                }
                script { (PreEscaped(SCRIPT)) }
            }
        }
    }
    .into_string()
}

fn tree(node: &Node, watched: &Watched, error: bool) -> Markup {
    let children = |children: &[Node]| html! { @for child in children { (tree(child, watched, error)) } };
    html! {
        @match node {
            Node::Kernel { symbol, says, children: of } => {
                details.kernel open { summary { b { (symbol) } " " span.says { (says) } } (children(of)) }
            }
            Node::Macro { name, says, file, line, comment, arguments, instructions, children: of } => {
                details.macro open {
                    summary {
                        span.line { (line) } b { (name) } span.values { (text::values(arguments)) }
                        span.count { (text::count(*instructions)) }
                        @if !comment.is_empty() { span.comment { "; " (comment) } }
                    }
                    p.says { (says) " " code { (file) } }
                    (children(of))
                }
            }
            Node::Once { instructions, children: of } => {
                details { summary { "once for the row " span.count { (text::count(*instructions)) } } (children(of)) }
            }
            Node::Step(at) => { (step(&watched.steps[*at], error)) }
            Node::Padding(count) => { p.others { (text::padding(*count)) } }
            Node::Others { rounds, instructions } => { p.others { (text::others(*rounds, *instructions)) } }
        }
    }
}

fn step(line: &Line, error: bool) -> Markup {
    let Line {
        line: number, source, text, file, changed, compared, branch, comment, unknown, overturned, made, ..
    } = line;
    let changes: Vec<_> =
        changed.iter().map(|c| [&c.register, &c.name, &text::elements(&c.after)].map(String::clone)).collect();
    let data = serde_json::to_string(&changes).unwrap_or_default();
    html! {
        div.step.aside[!made && branch.is_none()] tabindex="-1" data-changes=(data) title={ (text) " (" (file) ")" } {
            span.line { (number) }
            code.source { (source) }
            span.changed {
                @for change in changed { (changed_to(change)) }
                @if let Some(compared) = compared { span { (compared) } }
                @if let Some(branch) = branch {
                    b { @if branch.taken { "taken " } @else { "not taken " } } (branch.why)
                }
            }
            @if error {
                @for lost in changed.iter().filter_map(text::lost) {
                    span.comment { (lost.error) @if let Some(cancelled) = lost.cancelled { "; " strong.unknown { (cancelled) } } }
                }
            }
            @if *overturned { strong.unknown { (text::OVERTURNED) } }
            @if !comment.is_empty() { span.comment { "; " (comment) } }
            @if let Some(unknown) = unknown { strong.unknown { "the model: " (unknown) } }
        }
    }
}

fn changed_to(change: &Change) -> Markup {
    let Change { name, before, after, .. } = change;
    let elements = |values: &[Value]| text::elements(values);
    html! { span { b { (name) } " " span.before { (elements(before)) } " → " (elements(after)) } " " }
}
