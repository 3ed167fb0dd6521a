//! `rayo experiment --complexity`: its tables and files.

use std::process::ExitCode;
use std::sync::atomic::Ordering;

use super::ExperimentArgs;
use super::run::{Prepared, interrupted, prepare};
use super::table::EXPLANATION;
use crate::essay::{filled, part};
use crate::measuring::{bar, create_directory, failure, write_results};
use crate::table::{self, Column, Table};
use crate::{Failure, print_result, say};
use rayo::internals::render::Engine;
use rayo::internals::scene::shown;
use rayo_lab::experiments::complexity::{
    self, Complexity, Growth, Growths, LINES, Settings, Slope, ZEROS, lines, plot,
};
use rayo_lab::experiments::svg::Screen;
use rayo_lab::experiments::sweeps::Axis;
use rayo_lab::measure::Clock;

/// Measures every line of the figures, one after the other. Calls `proceed` after each picture, and
/// ends when that returns false.
pub fn measure(
    settings: &Settings,
    clock: &mut impl Clock,
    mut proceed: impl FnMut(u64) -> bool,
) -> Result<Growths, Failure> {
    let mut rows = Vec::new();
    for line in 0..LINES {
        let measured = complexity::measure(settings, line, clock, &mut proceed).map_err(failure)?;
        rows.extend(measured.rows);
        if !measured.complete {
            return Ok(Growths { rows, complete: false });
        }
    }
    Ok(Growths { rows, complete: true })
}

pub(super) fn run(args: &ExperimentArgs) -> Result<ExitCode, Failure> {
    let engines = args.settings()?.engines;
    let settings = Settings::new(args.quick, args.runs.map(|runs| runs as usize), &engines);
    if settings.engines.is_empty() {
        let none = "--complexity is for packet engines, and none is among these: name sse41, avx2 or avx512";
        return Err(Failure::input(none));
    }
    let is_left_out = |name: &&String| name.parse().is_ok_and(|engine: Engine| !settings.engines.contains(&engine));
    let left_out: Vec<_> = args.engines.iter().flatten().filter(is_left_out).map(String::as_str).collect();
    if !left_out.is_empty() {
        say(&format!("note: --complexity is for packet engines, and leaves out {}", left_out.join(", ")));
    }
    let Prepared { mut clock, stop, machine, .. } = prepare()?;
    create_directory(&args.out)?;
    let bar = bar(settings.work());
    let proceed = |work| {
        bar.inc(work);
        !stop.load(Ordering::Relaxed)
    };
    let Growths { rows, complete } = measure(&settings, &mut clock, proceed)?;
    bar.finish_and_clear();
    if rows.is_empty() {
        return Err(Failure::stopped("stopped before the first picture was finished: there is nothing to show"));
    }
    let document = Complexity::new(machine, &settings, complete, rows);
    let figure = plot::figure(&document.rows, Screen::Wide).map_err(Failure::output)?;
    let texts = [("complexity.md", page(&document)), ("complexity.csv", csv(&document)), ("complexity.svg", figure)];
    write_results(&args.out, "complexity.json", &document, texts)?;
    let files = format!("\nThe files are in {}\n", shown(&args.out));
    print_result(args.json, &document, || tables(&document) + &files)?;
    if document.complete {
        return Ok(ExitCode::SUCCESS);
    }
    Err(interrupted(&format!("{} pictures", document.rows.len()), &args.out))
}

/// The page docs/results/complexity.md.
fn page(document: &Complexity) -> String {
    let Complexity { machine, runs, .. } = document;
    let megahertz = machine.tsc_hz.map_or("?".into(), |hz| format!("{:.0}", hz / 1e6));
    let caches: Vec<_> =
        machine.caches.iter().map(|cache| format!("L{} {} KiB", cache.level, cache.bytes >> 10)).collect();
    let figures = [
        ("CPU", machine.cpu()),
        ("megahertz", megahertz),
        ("caches", caches.join(", ")),
        ("assembler", machine.nasm.as_deref().unwrap_or("?").into()),
        ("compiler", machine.rustc.to_string()),
        ("runs", runs.to_string()),
    ];
    prose("complexity", &figures) + &tables(document)
}

/// A part of the explanation with its figures filled in.
fn prose(name: &str, figures: &[(&str, String)]) -> String {
    filled(part(EXPLANATION, name), |what| {
        let figure = figures.iter().find(|(of, _)| *of == what);
        figure.unwrap_or_else(|| unreachable!("no figure `{what}`")).1.clone()
    })
}

fn tables(document: &Complexity) -> String {
    [pixels(document), objects(document), lights(document)].concat()
}

/// A number with three digits: 12.3, 1.23, 0.123.
fn digits(x: f64) -> String {
    match x {
        x if x >= 100.0 => format!("{x:.0}"),
        x if x >= 10.0 => format!("{x:.1}"),
        x => format!("{x:.2}"),
    }
}

fn of_axis(document: &Complexity, axis: Axis) -> Vec<Vec<&Growth>> {
    lines(&document.rows).into_iter().filter(|line| line[0].axis == axis).collect()
}

/// A table with a row for each count and a column for each line of the figure.
fn counts<'a>(
    head: &str,
    lines: &[Vec<&'a Growth>],
    name: impl Fn(&Growth) -> String,
    cell: impl Fn(&'a Growth) -> String,
) -> String {
    let mut counts: Vec<_> = lines.iter().flatten().map(|row| row.count).collect();
    counts.sort_unstable();
    counts.dedup();
    let mut table = Table::new(0, [head.to_owned()].into_iter().chain(lines.iter().map(|line| name(line[0]))));
    for count in counts {
        let cell = |line: &Vec<&'a Growth>| {
            line.iter().find(|row| row.count == count).map_or_else(String::new, |row| cell(row))
        };
        table.row([count.to_string()].into_iter().chain(lines.iter().map(cell)).collect());
    }
    table.text()
}

/// The sphere in every picture size, and by how much the time per pixel changes.
fn pixels(document: &Complexity) -> String {
    let lines = of_axis(document, Axis::Pixels);
    if lines.is_empty() {
        return String::new();
    }
    let name = |row: &Growth| format!("{}, {}", row.engine, row.output);
    let costs = counts("pixels", &lines, name, |row| digits(row.cycles_per_pixel()));
    let mut text = prose("pixels", &[("zeros", ZEROS.into()), ("costs", costs)]);
    for line in &lines {
        let costs = || line.iter().map(|row| row.cycles_per_pixel());
        let (low, high) = (costs().fold(f64::INFINITY, f64::min), costs().fold(0.0, f64::max));
        let spread = 100.0 * (high - low) / (high + low);
        let line = name(line[0]);
        text += &format!("- {line}: from {} to {}, ±{spread:.0} % about their middle\n", digits(low), digits(high));
    }
    text + "\n"
}

/// The times with more and more spheres, triangles, and triangles of meshes.
fn objects(document: &Complexity) -> String {
    let lines = of_axis(document, Axis::Objects);
    let Some(first) = lines.first() else { return String::new() };
    let Growth { engine, width, height, output, .. } = first[0];
    let name = |row: &Growth| format!("{}{}", row.scene, if row.keep_all { ", brute force" } else { "" });
    let planned: Vec<_> = lines.iter().filter(|line| !line[0].keep_all).cloned().collect();
    let setup = |row: &Growth| digits(row.setup_cycles.unwrap_or(f64::NAN) / row.pixels());
    let figures = [
        ("engine", engine.to_string()),
        ("size", format!("{width}×{height}")),
        ("output", output.to_string()),
        ("costs", counts("objects", &lines, name, |row| digits(row.cycles_per_pixel()))),
        ("set-up", counts("objects", &planned, name, setup)),
    ];
    let mut text = prose("objects", &figures);
    for slope in document.slopes.iter().filter(|slope| slope.axis == Axis::Objects) {
        let by = if slope.keep_all { ", by brute force" } else { "" };
        let Slope { scene, from, to, line, .. } = slope;
        let (slope, residual) = (digits(line.slope), 100.0 * line.residual);
        text += &format!(
            "- {scene}{by}: from {from} to {to} objects, one more costs {slope} cycles (residual {residual:.1} %)\n"
        );
    }
    text + "\n"
}

/// The sphere under more and more lights.
fn lights(document: &Complexity) -> String {
    let lines = of_axis(document, Axis::Lights);
    let Some(first) = lines.first() else { return String::new() };
    let Growth { width, height, output, .. } = first[0];
    let figures = [
        ("size", format!("{width}×{height}")),
        ("output", output.to_string()),
        ("costs", counts("lights", &lines, |row| row.engine.to_string(), |row| digits(row.cycles_per_pixel()))),
    ];
    let mut text = prose("lights", &figures);
    for slope in document.slopes.iter().filter(|slope| slope.axis == Axis::Lights) {
        let Slope { engine, line, .. } = slope;
        let (slope, residual) = (digits(line.slope / first[0].pixels()), 100.0 * line.residual);
        text += &format!(
            "- {engine}: one more light costs {slope} cycles per pixel of the picture (residual {residual:.1} %)\n"
        );
    }
    text
}

/// A CSV line for each engine in each picture.
fn csv(document: &Complexity) -> String {
    let columns: [Column<Growth>; 11] = [
        ("axis", |row| row.axis.name().into()),
        ("scene", |row| row.scene.to_string()),
        ("count", |row| row.count.to_string()),
        ("width", |row| row.width.to_string()),
        ("height", |row| row.height.to_string()),
        ("engine", |row| row.engine.to_string()),
        ("output", |row| row.output.to_string()),
        ("keep_all", |row| row.keep_all.to_string()),
        ("setup_cycles", |row| row.setup_cycles.map_or_else(String::new, |cycles| cycles.to_string())),
        ("cycles_median", |row| row.cycles_median.to_string()),
        ("cycles_min", |row| row.cycles_min.to_string()),
    ];
    table::csv(&columns, &document.rows)
}
