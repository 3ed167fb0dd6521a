//! The tables of `rayo accuracy`: each scene row by row, all scenes together, and everything as CSV.

use std::fmt::Write as _;

use crate::cli::table::Table;
use crate::experiments::accuracy::plain::AgainstPlain;
use crate::experiments::accuracy::summary::{Reason, Summary, summaries};
use crate::experiments::accuracy::{Document, Row};

/// A number in three digits; – where there is none.
pub(super) fn number(x: Option<f64>) -> String {
    match x {
        None => "–".into(),
        Some(0.0) => "0".into(),
        Some(x) if x.is_infinite() => "∞".into(),
        Some(x) if x.abs() >= 999.5 || x.abs() < 0.01 => format!("{x:.1e}"),
        Some(x) if x.abs() >= 99.5 => format!("{x:.0}"),
        Some(x) if x.abs() >= 9.95 => format!("{x:.1}"),
        Some(x) => format!("{x:.2}"),
    }
}

/// One scene: every row, those of the front marked.
fn scene_table(rows: &[&Row]) -> String {
    let mut table = Table::new(
        4,
        [
            "engine",
            "precision",
            "option",
            "output",
            "wrong hits",
            "in margin",
            "wrong object",
            "max ulp",
            "rms ulp",
            "99.9 % ulp",
            "of bound",
            "angle",
            "max colour",
            "rms colour",
            "off by 1",
            "off by 2",
            "PSNR",
            "ns/ray",
            "median",
            "spread",
            "cycles/ray",
            "set-up µs",
            "front",
        ],
    );
    for row in rows {
        let errors = &row.errors;
        table.row(vec![
            row.engine.into(),
            row.precision.into(),
            row.option.unwrap_or("").into(),
            row.output.into(),
            errors.wrong_hits.to_string(),
            errors.wrong_hits_inside.to_string(),
            errors.wrong_objects.to_string(),
            number(errors.max_ulp),
            number(errors.rms_ulp),
            number(errors.p999_ulp),
            number(errors.bound_share),
            number(errors.max_angle),
            number(errors.max_colour),
            number(errors.rms_colour),
            errors.off_by_1.to_string(),
            errors.off_by_2.to_string(),
            errors.psnr.map_or("∞".into(), |psnr| format!("{psnr:.1}")),
            number(Some(row.ns_per_ray)),
            number(Some(row.ns_per_ray_median)),
            format!("{:.0} %", 100.0 * row.spread),
            number(row.cycles_per_ray),
            format!("{:.1}", row.setup_ns / 1e3),
            if row.front { "*" } else { "" }.into(),
        ]);
    }
    table.text()
}

/// Who over all scenes.
pub(super) fn summary_table(summaries: &[Summary]) -> String {
    let mut table = Table::new(
        4,
        [
            "engine",
            "precision",
            "option",
            "output",
            "wrong hits",
            "wrong object",
            "max ulp",
            "of bound",
            "off by 2",
            "max colour",
            "ns/ray",
            "fronts",
        ],
    );
    for summary in summaries {
        table.row(vec![
            summary.engine.into(),
            summary.precision.into(),
            summary.option.unwrap_or("").into(),
            summary.output.into(),
            summary.wrong_hits.to_string(),
            summary.wrong_objects.to_string(),
            number(summary.max_ulp),
            number(summary.bound_share),
            summary.off_by_2.to_string(),
            number(summary.max_colour),
            number(Some(summary.ns_per_ray)),
            format!("{} of {}", summary.fronts, summary.scenes),
        ]);
    }
    table.text()
}

/// What robust formulas take by what plain ones do.
pub(super) fn plain_table(pairs: &[AgainstPlain]) -> String {
    let mut table =
        Table::new(2, ["scene", "instructions", "plain, ns/ray", "robust, ns/ray", "robust / plain", "95 %"]);
    for AgainstPlain { scene, engine, robust_ns_per_ray, plain_ns_per_ray, ratio, .. } in pairs {
        table.row(vec![
            scene.clone(),
            (*engine).into(),
            number(Some(*plain_ns_per_ray)),
            number(Some(*robust_ns_per_ray)),
            format!("{:.3}", ratio.value),
            format!("{:.3} to {:.3}", ratio.low, ratio.high),
        ]);
    }
    table.text()
}

/// The sentences why those stay that are on no front, one after those that it is of.
pub(super) fn reasons(reasons: &[Reason]) -> String {
    // An engine with its option, and in which precisions and outputs.
    type Who = (String, Vec<String>);
    let mut of: Vec<(&str, Vec<Who>)> = Vec::new();
    for Reason { engine, precision, option, output, reason } in reasons {
        let option = option.map_or(String::new(), |option| format!(" with `{option}`"));
        let (who, what) = (format!("`{engine}`{option}"), format!("{precision} {output}"));
        let i = of.iter().position(|(other, _)| other == reason).unwrap_or_else(|| {
            of.push((*reason, Vec::new()));
            of.len() - 1
        });
        match of[i].1.iter_mut().find(|(other, _)| *other == who) {
            Some((_, all)) => all.push(what),
            None => of[i].1.push((who, vec![what])),
        }
    }
    let who = |(who, what): &Who| format!("{who} ({})", what.join(", "));
    of.iter()
        .map(|(sentence, all)| format!("- {}: {sentence}\n", all.iter().map(who).collect::<Vec<_>>().join("; ")))
        .collect()
}

/// What is printed: each scene if there are few, and all of them together.
pub(super) fn text(document: &Document, each: bool) -> String {
    let mut text = String::new();
    let scenes = document.rows.chunk_by(|a, b| a.scene == b.scene);
    let mut count = 0;
    for rows in scenes {
        count += 1;
        if each {
            let Row { scene, width, height, errors, .. } = &rows[0];
            writeln!(text, "{scene}, {width}×{height}, {} of {} rays hit:\n", errors.hits, errors.rays)
                .expect("a String takes all");
            text += &scene_table(&rows.iter().collect::<Vec<_>>());
            text += "\n";
        }
    }
    if !each || count > 1 {
        text += "All scenes; ns/ray is the geometric mean:\n\n";
        text += &summary_table(&summaries(&document.rows));
        text += "\n";
    }
    text += "Wrong hits and objects, errors of t and of colours: outside of the margin, within which either answer is \
             right. * is on the front of its scene and output: nothing beats it in both error and time.\n";
    if !document.against_plain.is_empty() {
        text +=
            "\nRobust packets in single precision against the paper's plain formulas, a ray in each lane, by gcc:\n\n";
        text += &plain_table(&document.against_plain);
    }
    if !document.off_every_front.is_empty() {
        text += "\nOn no front here, and why it stays:\n";
        text += &reasons(&document.off_every_front);
    }
    text
}

/// A line per row.
pub(super) fn csv(document: &Document) -> String {
    let mut text = String::from(
        "scene,family,stiffness,width,height,engine,precision,option,output,rays,hits,in_margin,wrong_hits,wrong_hits_inside,\
         wrong_objects,wrong_objects_inside,max_ulp,rms_ulp,p999_ulp,bound_share,max_angle,rms_angle,max_colour,\
         rms_colour,off_by_1,off_by_2,max_level,psnr,ns_per_ray,ns_per_ray_median,spread,cycles_per_ray,\
         cycles_per_ray_median,setup_ns,runs,error,front\n",
    );
    let cell = |x: Option<f64>| x.map_or_else(String::new, |x| format!("{x:e}"));
    for row in &document.rows {
        let e = &row.errors;
        let counts = |counts: &[usize]| counts.iter().map(|n| format!(",{n}")).collect::<String>();
        let cells = |cells: &[Option<f64>]| cells.iter().map(|x| format!(",{}", cell(*x))).collect::<String>();
        let name = format!("\"{}\"", row.scene.replace('"', "\"\""));
        let stiffness = row.stiffness.map_or_else(String::new, |stiffness| stiffness.to_string());
        write!(
            text,
            "{name},{},{stiffness},{},{},{},{},{},{}",
            row.family.unwrap_or(""),
            row.width,
            row.height,
            row.engine,
            row.precision,
            row.option.unwrap_or(""),
            row.output
        )
        .expect("a String takes all");
        text += &counts(&[
            e.rays,
            e.hits,
            e.in_margin,
            e.wrong_hits,
            e.wrong_hits_inside,
            e.wrong_objects,
            e.wrong_objects_inside,
        ]);
        text += &cells(&[
            e.max_ulp,
            e.rms_ulp,
            e.p999_ulp,
            e.bound_share,
            e.max_angle,
            e.rms_angle,
            e.max_colour,
            e.rms_colour,
        ]);
        text += &counts(&[e.off_by_1, e.off_by_2, e.max_level.into()]);
        text += &cells(&[
            e.psnr,
            Some(row.ns_per_ray),
            Some(row.ns_per_ray_median),
            Some(row.spread),
            row.cycles_per_ray,
            row.cycles_per_ray_median,
            Some(row.setup_ns),
        ]);
        writeln!(text, ",{},{},{}", row.runs, cell(Some(row.error)), row.front).expect("a String takes all");
    }
    text
}
