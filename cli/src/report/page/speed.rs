//! The sections about speed: relative to the machine's limits, and as pictures and scenes grow.

use maud::html;

use super::{Section, absent, explained, figure, partly, section, words};
use crate::table::{Column, Table};
use rayo_lab::experiments::complexity::{Slope, plot};
use rayo_lab::experiments::report::{Results, Stage};
use rayo_lab::experiments::roofline::{self, Point, Roofline};
use rayo_lab::experiments::svg::PlotError;
use rayo_lab::experiments::threads::OnThreads;

pub fn roofline(results: &Results) -> Result<Section, PlotError> {
    section(results, Stage::Roofline, "How near the machine's limits", "roofline", &results.roofline, |roofline| {
        let label = "Operations on numbers per cycle against operations per byte written.";
        Ok(html! {
            (figure(|screen| roofline::plot::figure(roofline, screen), label)?)
            @if let Some(reason) = &roofline.uncounted { p.absent { "No kernel is on it: " (words(reason)) "." } }
            details { summary { "The same in figures" } (points(roofline).html()) (limits(roofline).html()) }
        })
    })
}

fn points(roofline: &Roofline) -> Table {
    let columns: [Column<Point>; 6] = [
        ("scene", |point| point.scene.to_string()),
        ("engine", |point| point.engine.to_string()),
        ("operations a pixel", |point| format!("{:.1}", point.flops_per_pixel)),
        ("cycles a pixel", |point| format!("{:.3}", point.cycles_per_pixel)),
        ("operations a cycle", |point| format!("{:.1}", point.flops_per_pixel / point.cycles_per_pixel)),
        ("bytes a cycle", |point| format!("{:.1}", point.bytes_per_pixel / point.cycles_per_pixel)),
    ];
    Table::of(2, &columns, &roofline.points)
}

fn limits(roofline: &Roofline) -> Table {
    let mut table = Table::new(1, ["limit", "per TSC cycle"]);
    for peak in &roofline.peaks {
        table.row(vec![format!("{}, multiplications and additions", peak.isa), format!("{:.1}", peak.flops_per_cycle)]);
    }
    for roof in &roofline.roofs {
        table.row(vec![format!("bytes into {}", roof.level), format!("{:.1}", roof.bytes_per_cycle)]);
    }
    table
}

/// The section of how time grows with pixels, objects, lights and threads.
pub fn scaling(results: &Results) -> Result<Section, PlotError> {
    let content = html! {
        @match &results.complexity {
            None => { (absent(results, Stage::Complexity)) }
            Some(document) => {
                (explained("scaling"))
                (partly(results, Stage::Complexity))
                (figure(|screen| plot::figure(&document.rows, screen), "Cycles per pixel against pixels, objects and lights.")?)
                @if !document.slopes.is_empty() { details { summary { "What one more costs" } (slopes(&document.slopes).html()) } }
            }
        }
        h3 { "Threads" }
        @match &results.threads {
            None => { (absent(results, Stage::Threads)) }
            Some(rows) => { (threads(rows).html()) }
        }
    };
    Ok(Section { title: "As pictures and scenes grow", id: "scaling", content })
}

fn slopes(slopes: &[Slope]) -> Table {
    let columns: [Column<Slope>; 6] = [
        ("one more", |slope| slope.axis.name().trim_end_matches('s').into()),
        ("scene", |slope| format!("{}{}", slope.scene, if slope.keep_all { ", by brute force" } else { "" })),
        ("engine", |slope| format!("{}, {}", slope.engine, slope.output)),
        ("between", |slope| format!("{} and {}", slope.from, slope.to)),
        ("cycles", |slope| format!("{:.3}", slope.line.slope)),
        ("residual", |slope| format!("{:.1} %", 100.0 * slope.line.residual)),
    ];
    Table::of(3, &columns, slopes)
}

fn threads(rows: &[OnThreads]) -> Table {
    let columns: [Column<OnThreads>; 5] = [
        ("scene", |row| row.scene.to_string()),
        ("engine", |row| row.engine.to_string()),
        ("threads", |row| row.threads.to_string()),
        ("million cycles a picture", |row| format!("{:.2}", row.cycles_median / 1e6)),
        ("times as fast as one", |row| format!("{:.2}", row.speedup)),
    ];
    Table::of(2, &columns, rows)
}
