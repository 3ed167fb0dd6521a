//! The page of `rayo report`: a single file, readable without scripts, made from the results alone.

mod many;
mod paper;
mod scenes;
mod speed;
mod truth;

use std::io::Write;

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use flate2::Compression;
use flate2::write::GzEncoder;
use maud::{DOCTYPE, Markup, PreEscaped, html};
use serde_json::Value;

use crate::essay::part;
use crate::table::words;
use crate::{Failure, json};
use rayo::internals::kernels::Isa;
use rayo::internals::plan::with_digit_groups;
use rayo::internals::scene::printable;
use rayo_lab::experiments::report::{Results, Stage};
use rayo_lab::experiments::speedup::{BASELINE, PAPER};
use rayo_lab::experiments::svg::{PlotError, Screen};
use rayo_lab::measure::Machine;
use rayo_lab::measure::statistics::{Estimate, maximum, minimum};

const STYLE: &str = include_str!("page.css");
/// The most pictures of a set that the page lets the reader switch between.
const MOST_FLIPPED: usize = 3;
const EXPLANATION: &str = include_str!("explanation.md");

/// The style sheet. A line that contains `(N)` becomes a rule for each number of a picture in a
/// set.
fn style() -> String {
    let rules = |line: &str| {
        let times = if line.contains("(N)") { MOST_FLIPPED } else { 1 };
        (1..=times).map(|n| line.replace("(N)", &format!("({n})")) + "\n").collect::<String>()
    };
    STYLE.lines().map(rules).collect()
}

/// A section of the page: its title, its fragment identifier, and its content.
struct Section {
    title: &'static str,
    id: &'static str,
    content: Markup,
}

/// The page of one machine, or the comparison of several.
pub fn page(machines: &[Results]) -> Result<String, Failure> {
    let sections = match machines {
        [results] => of_one(results)?,
        _ => many::sections(machines)?,
    };
    let title = match machines {
        [results] => results.machine.cpu(),
        _ => format!("{} machines", machines.len()),
    };
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { "rayo report - " (title) }
                style {
                    (PreEscaped(style()))
                    @if let [Results { stability: Some(document), .. }] = machines {
                        (PreEscaped(truth::style_of_columns(document)))
                    }
                }
            }
            body {
                a.skip href="#content" { "Skip to the content" }
                header {
                    h1 { "Vectorised ray tracing, measured" }
                    @if let Some(answer) = answer(machines) { p.answer { (words(&answer)) } }
                    p { "The experiment of " cite { "Trazado de rayos vectorizado" } " and what follows from it, on " b { (title) } "." }
                    @for results in machines {
                        @if let Some(note) = note(results) { p.note { (note) } }
                    }
                    nav aria-label="Contents" {
                        ul { @for section in &sections { li { a href={ "#" (section.id) } { (section.title) } } } }
                    }
                }
                main id="content" {
                    @for section in &sections {
                        section id=(section.id) aria-labelledby={ (section.id) "-title" } {
                            h2 id={ (section.id) "-title" } { (section.title) }
                            (section.content)
                        }
                    }
                }
            }
        }
    };
    // Results from elsewhere may contain characters that a page must not have.
    Ok(page.into_string().lines().map(|line| printable(line) + "\n").collect())
}

fn of_one(results: &Results) -> Result<Vec<Section>, Failure> {
    let mut sections = vec![paper::verdicts(results)];
    sections.push(Section { title: "Machine and build", id: "machine", content: machine(&results.machine) });
    let rest = [
        paper::experiment(results),
        paper::ladder(results),
        paper::operations(results),
        speed::roofline(results),
        speed::scaling(results),
        truth::accuracy(results),
        truth::stability(results),
        scenes::plans(results),
        scenes::gallery(results),
        scenes::ray(results),
    ];
    for section in rest {
        sections.push(section.map_err(Failure::output)?);
    }
    sections.push(Section { title: "Run it again", id: "again", content: again(results)? });
    Ok(sections)
}

/// The answer to the paper's question: the speedup here, the paper's, and the largest cause.
fn answer(machines: &[Results]) -> Option<String> {
    let experiments: Vec<_> = machines.iter().filter_map(|results| results.experiment.as_ref()).collect();
    let ratios = PAPER.map(|row| row.ratio());
    let papers = format!("{:.1} to {:.1}", minimum(&ratios), maximum(&ratios));
    let [experiment] = &experiments[..] else {
        let ratios: Vec<_> = experiments.iter().map(|experiment| experiment.table.c_by_simd.value).collect();
        let (low, high) = (minimum(&ratios), maximum(&ratios));
        let told = || format!("C/SIMD is {low:.1} to {high:.1} on these machines; the paper has {papers}.");
        return (!ratios.is_empty()).then(told);
    };
    let Estimate { value, low, high } = experiment.table.c_by_simd;
    let mut answer = format!("C/SIMD is {value:.1} [{low:.1}, {high:.1}] here; the paper has {papers}");
    let whole = experiment.explanations.iter().find(|explanation| explanation.from == BASELINE);
    let most = whole.and_then(|whole| whole.shares.iter().max_by(|a, b| a.share.total_cmp(&b.share)));
    if let Some(most) = most {
        let cause = match &*most.cause {
            "pow" => "a `pow` where a root would do",
            "lanes" => "the lanes",
            cause => cause,
        };
        answer += &format!("; {:.0} % of it, by logarithm, is {cause}", 100.0 * most.share);
    }
    Some(answer + ".")
}

/// A note that concerns the results as a whole, if one is needed.
fn note(results: &Results) -> Option<String> {
    let cut = results.cut_short();
    let quick = results.quick.then(|| "few runs and small pictures (--quick)".to_owned());
    let cut = (!cut.is_empty()).then(|| format!("ended before the end: {}", cut.join(", ")));
    let notes: Vec<_> = quick.into_iter().chain(cut).collect();
    (!notes.is_empty()).then(|| format!("{}: {}.", results.machine.cpu(), notes.join("; ")))
}

/// The paragraphs of a text, with code between backticks.
fn prose(text: &str) -> Markup {
    html! { @for paragraph in text.trim().split("\n\n") { p { (words(paragraph)) } } }
}

/// The paragraphs of a part of the explanation.
fn explained(name: &str) -> Markup {
    prose(part(EXPLANATION, name))
}

/// A figure, in a wide and a narrow form, with a description for screen readers.
fn figure(svg: impl Fn(Screen) -> Result<String, PlotError>, label: &str) -> Result<Markup, PlotError> {
    let (wide, narrow) = (svg(Screen::Wide)?, svg(Screen::Narrow)?);
    Ok(html! {
        figure {
            @for (screen, svg) in [("wide", wide), ("narrow", narrow)] {
                div.plot.(screen) role="img" aria-label=(label) { (PreEscaped(svg)) }
            }
            figcaption { (label) }
        }
    })
}

/// A small figure with a single form for all screens, and its description for screen readers.
fn small_figure(svg: &str, label: &str) -> Markup {
    html! {
        figure.small {
            div.plot role="img" aria-label=(label) { (PreEscaped(svg)) }
            figcaption { (label) }
        }
    }
}

/// The section of one stage: its explanation, a note of what is missing, and its `content`; or the
/// reason why it has no results.
fn section<T>(
    results: &Results,
    stage: Stage,
    title: &'static str,
    id: &'static str,
    of: &Option<T>,
    content: impl FnOnce(&T) -> Result<Markup, PlotError>,
) -> Result<Section, PlotError> {
    let content = match of {
        None => absent(results, stage),
        Some(of) => html! { (explained(id)) (partly(results, stage)) (content(of)?) },
    };
    Ok(Section { title, id, content })
}

/// A count with its unit in the singular or plural; `unit` is the plural: "1 kind", "1 234 rays
/// against objects".
fn counted(count: u64, unit: &str) -> String {
    let number = with_digit_groups(count, ' ');
    match unit.split_once(' ') {
        _ if count != 1 => format!("{number} {unit}"),
        Some((first, rest)) => format!("{number} {} {rest}", first.trim_end_matches('s')),
        None => format!("{number} {}", unit.trim_end_matches('s')),
    }
}

/// Why a stage has no results.
fn absent(results: &Results, stage: Stage) -> Markup {
    let reason = results.missing.get(&stage.name()).map_or("not among these results", String::as_str);
    html! { p.absent { "Not measured: " (words(reason)) "." } }
}

/// What a stage lacks, if it is incomplete.
fn partly(results: &Results, stage: Stage) -> Markup {
    html! {
        @if let Some(reason) = results.missing.get(&stage.name()) { p.absent { "Not all of it: " (words(reason)) "." } }
    }
}

fn machine(machine: &Machine) -> Markup {
    html! { dl.facts { @for (name, value) in machine.facts() { dt { (name) } dd { (value) } } } }
}

/// The packet engines that the report lacks because the CPU cannot run them.
fn engines_absent(has: impl Fn(&str) -> bool) -> Markup {
    let absent: Vec<_> = Isa::ALL.iter().map(|isa| isa.name()).filter(|name| !has(name)).collect();
    html! { @if !absent.is_empty() { p.absent { "This CPU does not run " (absent.join(" and ")) "." } } }
}

fn again(results: &Results) -> Result<Markup, Failure> {
    let command = if results.quick { "rayo report --quick" } else { "rayo report" };
    // Without the pictures, which are on the page already.
    let figures = Results { gallery: None, ..results.clone() };
    let mut figures: Value = serde_json::from_str(&json(&figures)?).map_err(Failure::output)?;
    round(&mut figures);
    let mut packed = GzEncoder::new(Vec::new(), Compression::best());
    packed.write_all(figures.to_string().as_bytes()).map_err(Failure::output)?;
    let packed = packed.finish().map_err(Failure::output)?;
    let address = format!("data:application/gzip;base64,{}", BASE64_STANDARD.encode(packed));
    let seconds: f64 = results.seconds.values().sum();
    Ok(html! {
        p { code { (command) } " measures all of this anew"
            @if seconds > 0.0 { "; it took " (format!("{seconds:.0}")) " seconds" }
            ". Each part has a command of its own, with more detail: "
            code { "rayo experiment --ladder" } ", " code { "rayo ops --asm" } ", " code { "rayo accuracy" } ", "
            code { "rayo stability" } ", " code { "rayo experiment --complexity" } ", " code { "rayo plan --measure" } ", "
            code { "rayo step" } "."
        }
        p { code { "rayo report --from DIR --from DIR" } " sets the results of several machines side by side." }
        p {
            a href=(address) download="results.json.gz" { "All figures of this page: results.json.gz" }
            " (to four digits; results.json beside the page has all digits)"
        }
    })
}

/// Rounds every non-integer number to four digits, to keep the page small.
fn round(of: &mut Value) {
    match of {
        Value::Array(items) => items.iter_mut().for_each(round),
        Value::Object(fields) => fields.values_mut().for_each(round),
        Value::Number(number) if number.is_f64() => {
            let rounded = number.as_f64().and_then(|value| format!("{value:.3e}").parse::<f64>().ok());
            *of = rounded.map_or(Value::Null, Value::from);
        }
        _ => {}
    }
}
