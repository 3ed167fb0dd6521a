//! The sections about accuracy: error against run time, and the map of ill-conditioned and extreme
//! scenes.

use std::collections::BTreeMap;

use maud::{Markup, html};

use super::{Section, figure, section, small_figure};
use rayo_lab::experiments::accuracy::plot;
use rayo_lab::experiments::report::{Results, Stage};
use rayo_lab::experiments::stability::plot::{SHADES, shade};
use rayo_lab::experiments::stability::{Cell, StabilityReport};
use rayo_lab::experiments::svg::{PlotError, Screen};
use rayo_lab::families::family;

/// The section of error against run time: one large panel, the others folded.
pub fn accuracy(results: &Results) -> Result<Section, PlotError> {
    section(results, Stage::Accuracy, "Error against run time", "accuracy", &results.accuracy, |document| {
        let panels = plot::panels(&document.rows);
        // Start with the far spheres, which show most: the paper's formula loses its digits there.
        let chosen = panels.iter().position(|(title, _)| title.starts_with("S1")).unwrap_or(0);
        Ok(html! {
            @if let Some(panel) = panels.get(chosen) { (figure(|screen| plot::one_figure(panel, screen), &label(&panel.0))?) }
            @for (_, panel) in panels.iter().enumerate().filter(|(place, _)| *place != chosen) {
                details {
                    summary { (panel.0) }
                    (small_figure(&plot::one_figure(panel, Screen::Narrow)?, &label(&panel.0)))
                }
            }
        })
    })
}

fn label(scene: &str) -> String {
    format!("Error of a linear colour against nanoseconds a ray: {scene}.")
}

/// The section of the map: a row for each family, a column for each engine. A family unfolds to a
/// row for each value of its parameter.
pub fn stability(results: &Results) -> Result<Section, PlotError> {
    section(results, Stage::Stability, "Stiff and extreme scenes", "stability", &results.stability, |document| {
        Ok(html! {
            ul.legend { @for (place, (label, _)) in SHADES.iter().enumerate() { li { span.swatch.(shade_class(place)) {} (label) } } }
            (map(document))
        })
    })
}

/// The shade of most cells; cells without a class have it by the style sheet.
const USUAL: usize = 1;

fn shade_class(shade: usize) -> String {
    format!("s{shade}")
}

/// The engines and precisions of a document, in their order: the columns of its maps.
fn contenders(document: &StabilityReport) -> Vec<(&str, &str)> {
    let mut contenders = Vec::new();
    for cell in &document.cells {
        if !contenders.contains(&cell.contender()) {
            contenders.push(cell.contender());
        }
    }
    contenders
}

/// The rules by which each column of the maps tells its cells their engine, in the variable
/// `--engine`: thousands of cells share it.
pub fn style_of_columns(document: &StabilityReport) -> String {
    let contenders = contenders(document);
    // The first child of a row is its heading.
    let rule = |((engine, _), child): (&(&str, &str), usize)| {
        format!(".map td:nth-child({child}) {{ --engine: '{}'; }}\n", bare(engine))
    };
    contenders.iter().zip(2..).map(rule).collect()
}

fn map(document: &StabilityReport) -> Markup {
    let contenders = contenders(document);
    let families: Vec<&[Cell]> = document.cells.chunk_by(|a, b| a.family == b.family).collect();
    let head = |first: &str| {
        html! {
            thead { tr { th.left scope="col" { (first) } @for (engine, precision) in &contenders {
                th scope="col" { span { (engine) " " (precision) } }
            } } }
        }
    };
    html! {
        div.scroll tabindex="0" {
            table.map {
                (head("family"))
                tbody {
                    @for cells in &families {
                        tr style=(command(&cells[0].family, document)) {
                            th.left scope="row" { a href={ "#family-" (cells[0].family) } { (cells[0].family) } }
                            @for contender in &contenders { (worst(cells, *contender)) }
                        }
                    }
                }
            }
        }
        @for cells in &families {
            details id={ "family-" (cells[0].family) } style=(command(&cells[0].family, document)) {
                summary {
                    b { (cells[0].family) }
                    @if let Some(family) = family(&cells[0].family) { ": " (family.name) " - " (family.parameter) }
                }
                @if let Some(family) = family(&cells[0].family) { p { "Correct: " (family.correct) "." } }
                div.scroll {
                    table.map {
                        (head("value"))
                        tbody {
                            @for level in levels(cells) {
                                tr {
                                    th.left scope="row" { (level[0].value) }
                                    @for contender in &contenders {
                                        @match level.iter().find(|cell| cell.contender() == *contender) {
                                            Some(cell) => { (shown(cell, true)) }
                                            None => { td {} }
                                        }
                                    }
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// The letters and digits of a name, which may come from a file: quotes would end a CSS string.
fn bare(name: &str) -> String {
    name.chars().filter(char::is_ascii_alphanumeric).collect()
}

/// The cells of each value of the parameter, in ascending order.
fn levels(cells: &[Cell]) -> Vec<Vec<&Cell>> {
    let mut levels: BTreeMap<usize, Vec<&Cell>> = BTreeMap::new();
    for cell in cells {
        levels.entry(cell.level).or_default().push(cell);
    }
    levels.into_values().collect()
}

fn worst(cells: &[Cell], contender: (&str, &str)) -> Markup {
    let own = cells.iter().filter(|cell| cell.contender() == contender);
    let badness = |cell: &&Cell| (shade(cell), cell.wrong_hits.max(cell.off_by_2), cell.bound_share.unwrap_or(0.0));
    let worst = own.max_by(|a, b| badness(a).partial_cmp(&badness(b)).unwrap_or(std::cmp::Ordering::Equal));
    worst.map_or_else(|| html! { td {} }, |cell| shown(cell, false))
}

/// The command that repeats a cell of the family, as two CSS variables: the text before the engine,
/// and the text after the case number. The style sheet assembles the command for the cell with the
/// focus or pointer, so that the page does not repeat it for thousands of cells.
fn command(family: &str, document: &StabilityReport) -> String {
    let family = bare(family);
    let quick = if document.quick { " --quick" } else { "" };
    let seed = document.seed;
    format!("--before:'rayo stability --family {family} --engine ';--after:' --seed {seed}{quick}'")
}

/// A cell: its figure, and the case number for the command that repeats it.
fn shown(cell: &Cell, focus: bool) -> Markup {
    let shade = shade(cell);
    let wrong = cell.wrong_hits.max(cell.off_by_2) as f64 / cell.rays.max(1) as f64;
    let figure = match (shade, cell.bound_share) {
        (4.., _) if wrong < 1e-3 => format!("{:.0e}", wrong),
        (4.., _) => format!("{:.1} %", 100.0 * wrong),
        (_, Some(share)) if share < 100.0 => format!("{share:.2}"),
        (_, Some(share)) => format!("{share:.0e}"),
        (_, None) => "-".to_owned(),
    };
    html! {
        td class=[(shade != USUAL).then(|| shade_class(shade))] data-case=(cell.worst_case)
            tabindex=[focus.then_some("0")] { (figure) }
    }
}
