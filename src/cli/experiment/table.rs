//! The tables of the experiment, in Markdown that reads well as it is, and as CSV.

use std::fmt::Write as _;
use std::path::Path;

use crate::cli::table::Table;
use crate::experiments::document::{Conditions, Document};
use crate::experiments::jumps::Jumps;
use crate::experiments::ladder::{AgainstCompiler, Explanation, SIZE};
use crate::experiments::speedup::{BASELINE, CONTROL, PAPER, Row, paper_mean_ratio, paper_row};
use crate::measure::statistics::Estimate;
use crate::measure::{Machine, OFF_BY_MAD};
use crate::plan::grouped;

fn counted(cores: usize) -> String {
    if cores == 1 { "1 core".into() } else { format!("{cores} cores") }
}

fn interval(estimate: &Estimate) -> String {
    format!("{:.3} [{:.3}, {:.3}]", estimate.value, estimate.low, estimate.high)
}

/// What was measured where, and how far it can be trusted: what stands above the table.
pub(super) fn preamble(document: &Document) -> String {
    let Machine { cpu, cores, tsc_hz, tsc_invariant, nasm, cc, cflags, rustc, version, .. } = &document.machine;
    let unknown = || "unknown".to_owned();
    let clock = tsc_hz.map_or_else(unknown, |hz| format!("{:.3} GHz", hz / 1e9));
    let promise = if *tsc_invariant { "invariant" } else { "not known to be invariant" };
    let Conditions { core, runs, timed_share, taken_share, .. } = &document.conditions;
    let core = core.map_or("not pinned".into(), |core| format!("pinned to core {core}"));
    let (migrated, off, all) = document.odd_runs();
    let Estimate { value, low, high } = document.control_overall;
    let percent = |share: &Option<f64>| share.map_or_else(unknown, |share| format!("{:.0} %", 100.0 * share));
    let (timed, taken) = (percent(timed_share), percent(taken_share));
    let mut text = format!(
        "rayo {version}\n\
        CPU: {cpu}, {cores}; {core}; time stamps {clock}, {promise}\n\
        C: {cc}; {cflags}\n\
        NASM: {nasm}; Rust: {rustc}\n\
        Runs: {runs} of each size, each in a process of its own, interleaved; of {all} pictures {migrated} migrated to \
        another core and {off} were off by more than {OFF_BY_MAD} MAD; all are kept\n\
        Timed: {timed} of the run time; other programs had the core in {taken} of it\n\n\
        Noise floor: {floor:.2} %. `{CONTROL}` against itself is {value:.4} [{low:.4}, {high:.4}] over all sizes, and at \
        a size at most {floor:.2} % from 1: no ratio closer to 1 than that is called a difference\n",
        cpu = cpu.clone().unwrap_or_else(unknown),
        cores = counted(*cores),
        cc = cc.unwrap_or("none"),
        cflags = cflags.unwrap_or("none"),
        nasm = nasm.unwrap_or("none"),
        floor = 100.0 * document.noise_floor,
    );
    let (taken, all) = document.taken_runs();
    if taken > 0 {
        text += &format!(
            "Of {all} pairs with `{BASELINE}`, others had the core in {taken}, each time that they were tried; they are in no \
            figure where half of the pairs are left\n"
        );
    }
    if *runs == 1 {
        text += "One run has no spread: the intervals below are points\n";
    }
    text
}

/// C/SIMD over all sizes, beside the paper's.
pub(super) fn headline(document: &Document) -> String {
    let ratios = PAPER.map(|row| row.ratio());
    let (low, high) = ratios.iter().fold((f64::INFINITY, 0.0), |(low, high), r| (r.min(low), r.max(high)));
    format!(
        "C/SIMD over all sizes: {} (median of the pairs; 95 % interval over runs, wider by the noise floor); the paper's: {:.2}, from {low:.2} to {high:.2}\n",
        interval(&document.c_by_simd),
        paper_mean_ratio(),
    )
}

fn size(row: &Row) -> String {
    format!("{}×{}", row.width, row.height)
}

/// The paper's table beside ours.
pub(super) fn paper_table(document: &Document) -> String {
    let mut table = Table::new(
        1,
        [
            "w×h",
            "pixels",
            "C, mean cycles",
            "SIMD, mean cycles",
            "C/SIMD",
            "paper's C/SIMD",
            "C/SIMD by pairs",
            "95 % interval",
        ],
    );
    for rows in document.sizes() {
        let find = |name| rows.iter().find(|row: &&Row| row.is(name)).expect("it is measured at every size");
        let (c, simd) = (find(BASELINE), find(CONTROL));
        let paper = paper_row(c.width, c.height).map_or("-".into(), |row| format!("{:.2}", row.ratio()));
        table.row(vec![
            size(c),
            c.pixels.to_string(),
            grouped(c.cycles_mean.round() as u64, ' '),
            grouped(simd.cycles_mean.round() as u64, ' '),
            format!("{:.2}", c.cycles_mean / simd.cycles_mean),
            paper,
            format!("{:.3}", simd.ratio_to_c),
            format!("[{:.3}, {:.3}]", simd.ratio_low, simd.ratio_high),
        ]);
    }
    table.text()
}

fn contestant(row: &Row) -> String {
    if row.is(row.engine) { row.engine.into() } else { format!("{} {}", row.engine, row.output) }
}

/// Cycles per pixel of every engine, and how many times as fast as `c` that is.
pub(super) fn engine_table(document: &Document) -> String {
    let Some(first) = document.sizes().next() else { return String::new() };
    let mut table = Table::new(1, ["w×h".to_owned()].into_iter().chain(first.iter().map(contestant)));
    for rows in document.sizes() {
        let cell = |row: &Row| {
            // What noise could have made is not shown as a difference.
            let same = !row.is(BASELINE) && (row.ratio_to_c - 1.0).abs() <= document.noise_floor;
            let ratio = if same { "≈1".into() } else { format!("{:.2}", row.ratio_to_c) };
            format!("{:.2} ({ratio})", row.cycles_per_pixel())
        };
        table.row([size(&rows[0])].into_iter().chain(rows.iter().map(cell)).collect());
    }
    table.text()
}

/// Mean, median, minimum and ratio of everything that was measured.
pub(super) fn full_table(document: &Document) -> String {
    let mut table =
        Table::new(2, ["w×h", "engine", "mean", "median", "minimum", "ratio to c", "95 % interval", "migrated", "off"]);
    for row in &document.rows {
        table.row(vec![
            size(row),
            contestant(row),
            grouped(row.cycles_mean.round() as u64, ' '),
            grouped(row.cycles_median.round() as u64, ' '),
            grouped(row.cycles_min.round() as u64, ' '),
            format!("{:.3}", row.ratio_to_c),
            format!("[{:.3}, {:.3}]", row.ratio_low, row.ratio_high),
            row.migrations.to_string(),
            row.off.to_string(),
        ]);
    }
    table.text()
}

/// The ladder, and what it is held against.
fn ladder(document: &Document) -> String {
    let (width, height) = SIZE;
    let heading = "an aside in brackets, which the next rung does not build on";
    let mut parts = vec![format!("The ladder, {width}×{height}; {heading}:\n"), ladder_table(document)];
    parts.push(against_compiler(document));
    if let Some(reason) = &document.uncounted {
        parts.push(format!("Instructions are not counted: {reason}\n"));
    }
    parts.join("\n")
}

/// The ladder, a rung a line.
fn ladder_table(document: &Document) -> String {
    let mut table = Table::new(
        2,
        [
            "rung",
            "what is different",
            "cycles/pixel",
            "instructions/pixel",
            "gain",
            "95 % interval",
            "over",
            "over the first",
        ],
    );
    for rung in &document.ladder {
        table.row(vec![
            if rung.aside { format!("({})", rung.rung) } else { rung.rung.clone() },
            rung.change.clone(),
            format!("{:.2}", rung.cycles_per_pixel),
            rung.instructions_per_pixel.map_or("n/a".into(), |count| format!("{count:.1}")),
            format!("{:.2}", rung.gain),
            format!("[{:.2}, {:.2}]", rung.gain_low, rung.gain_high),
            rung.over.clone().unwrap_or("-".into()),
            format!("{:.2}", rung.gain_total),
        ]);
    }
    table.text()
}

/// The packet engines against the compiler.
fn against_compiler(document: &Document) -> String {
    let line = |against: &AgainstCompiler| {
        let AgainstCompiler { engine, compiled, ratio, low, high } = against;
        format!("`{engine}` is {ratio:.2} [{low:.2}, {high:.2}] times as fast as `{compiled}`\n")
    };
    let lines: String = document.against_compiler.iter().map(line).collect();
    if lines.is_empty() {
        lines
    } else {
        format!("Packets against the best C, compiled for their instructions:\n\n{lines}")
    }
}

/// Which share of the factor is what.
fn explanation(document: &Document) -> String {
    let mut text = String::new();
    for Explanation { from, to, factor, shares } in &document.explanations {
        let shares: Vec<_> = shares
            .iter()
            .map(|share| {
                // Not -0.
                let percent = (100.0 * share.share).round() + 0.0;
                format!("{} {percent:.0} % (times {:.2})", share.cause, share.factor)
            })
            .collect();
        writeln!(text, "From `{from}` to `{to}`, times {factor:.2}: {}.", shares.join(", "))
            .expect("a String takes all");
    }
    if !text.is_empty() {
        text += "Shares are on a logarithmic scale, on which factors add up.\n";
    }
    text
}

/// The sweep behind the two jumps.
fn jumps_table(jumps: &Jumps) -> String {
    let mut table = Table::new(
        3,
        [
            "w×h",
            "engine",
            "framebuffer",
            "cycles/pixel",
            "core clock/TSC",
            "taken by others",
            "core cycles/pixel",
            "page faults",
            "bytes/cycle",
        ],
    );
    for row in &jumps.rows {
        table.row(vec![
            format!("{}×{}", row.width, row.height),
            row.engine.into(),
            if row.touched { "touched" } else { "untouched" }.into(),
            format!("{:.2}", row.cycles_per_pixel),
            format!("{:.3}", row.clock_per_tick),
            row.taken_share.map_or("n/a".into(), |share| format!("{:.0} %", 100.0 * share)),
            format!("{:.2}", row.core_cycles_per_pixel),
            format!("{:.0}", row.page_faults),
            format!("{:.3}", row.bytes_per_cycle),
        ]);
    }
    let mut text = table.text();
    for level in &jumps.bandwidth {
        writeln!(text, "{} takes {:.1} bytes a cycle ({} KiB)", level.level, level.bytes_per_cycle, level.bytes >> 10)
            .expect("a String takes all");
    }
    text
}

/// The claims as a list: their figures are too long for a table.
fn verdicts(document: &Document) -> String {
    document
        .verdicts
        .iter()
        .map(|claim| format!("- {}: {}\n  {}\n", claim.claim, claim.verdict, claim.figure))
        .collect()
}

/// What this run cannot tell, and why: above all figures and below them.
fn disturbed(document: &Document) -> Option<String> {
    let reasons: String = document.disturbed.iter().map(|reason| format!("- {reason}\n")).collect();
    (!reasons.is_empty())
        .then(|| format!("Not all of it can be judged here; run it again on a quiet machine:\n\n{reasons}"))
}

/// What is printed: the result in some ten lines, with `full` all tables too, the ladder where somebody climbed it, and
/// where the files are.
pub(super) fn printed(document: &Document, full: bool, directory: &Path) -> String {
    let mut parts: Vec<_> = disturbed(document).into_iter().chain([summary(document)]).collect();
    if full {
        parts.push(text(document));
    } else if !document.ladder.is_empty() {
        parts.push(ladder(document));
    }
    // Of the whole text it is the end already.
    parts.extend(disturbed(document).filter(|_| !full));
    let tables = if full { "" } else { "; --full prints the tables" };
    parts.push(format!("The files are in {}: table.md has all of it{tables}\n", directory.display()));
    parts.join("\n")
}

/// The factor, and a verdict on each claim, whose figure is in the tables.
fn summary(document: &Document) -> String {
    let Estimate { value, low, high } = document.c_by_simd;
    let Machine { cpu, cores, .. } = &document.machine;
    let mut text = format!(
        "C takes {value:.2} [{low:.2}, {high:.2}] times the cycles of SIMD; in the paper {:.2}\n\
        {}, {}; noise floor {:.2} %\n",
        paper_mean_ratio(),
        cpu.as_deref().unwrap_or("unknown CPU"),
        counted(*cores),
        100.0 * document.noise_floor,
    );
    if !document.conditions.complete {
        text += "Stopped early: only what was finished is here\n";
    }
    for claim in &document.verdicts {
        writeln!(text, "- {}: {}", claim.claim, claim.verdict).expect("a String takes all");
    }
    text
}

/// All of it, as one text: what is written, and but for the summary printed with `--full`.
pub(super) fn text(document: &Document) -> String {
    let mut parts = vec![preamble(document)];
    if !document.conditions.complete {
        parts.push("Stopped early: only what was finished is here\n".into());
    }
    parts.extend(disturbed(document));
    parts.push(paper_table(document));
    parts.push(headline(document));
    parts.push("Median cycles per pixel (times as fast as `c`; ≈1 within the noise floor):\n".into());
    parts.push(engine_table(document));
    parts.push("All figures, in TSC cycles of a picture:\n".into());
    parts.push(full_table(document));
    if !document.ladder.is_empty() {
        parts.push(ladder(document));
    }
    if !document.explanations.is_empty() {
        parts.push(explanation(document));
    }
    if let Some(jumps) = &document.jumps {
        parts.push("The two jumps:\n".into());
        parts.push(jumps_table(jumps));
        parts.push(jumps.text());
    }
    if !document.verdicts.is_empty() {
        parts.push("The paper's claims:\n".into());
        parts.push(verdicts(document));
    }
    parts.extend(disturbed(document));
    parts.join("\n")
}

/// A line per engine and size.
pub(super) fn csv(document: &Document) -> String {
    let mut text = String::from(
        "width,height,pixels,engine,precision,output,threads,cycles_mean,cycles_median,cycles_min,\
        cycles_per_pixel,ratio_to_c,ratio_low,ratio_high,paper_ratio,migrations,off\n",
    );
    for row in &document.rows {
        let paper = paper_row(row.width, row.height).filter(|_| row.is(CONTROL));
        let paper = paper.map_or_else(String::new, |paper| format!("{:.4}", paper.ratio()));
        writeln!(
            text,
            "{},{},{},{},{},{},{},{:.2},{:.2},{:.2},{:.4},{:.4},{:.4},{:.4},{paper},{},{}",
            row.width,
            row.height,
            row.pixels,
            row.engine,
            row.precision,
            row.output,
            row.threads,
            row.cycles_mean,
            row.cycles_median,
            row.cycles_min,
            row.cycles_per_pixel(),
            row.ratio_to_c,
            row.ratio_low,
            row.ratio_high,
            row.migrations,
            row.off,
        )
        .expect("a String takes all");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiments::claims::{Claim, Verdict};
    use crate::experiments::ladder::{Rung, Share};
    use crate::experiments::speedup::{self, Settings, Speedup};
    use crate::measure::Cache;

    /// Two sizes of three engines on a machine that is nobody's.
    fn document() -> Document {
        let engines = [BASELINE, CONTROL, "rust"].map(|name| name.parse().unwrap()).to_vec();
        let settings = Settings { sizes: vec![0, 19], runs: 3, engines };
        let runs = speedup::scripted_runs(&settings, &[47_000_000, 7_400_000, 7_500_000, 5_000_000]);
        let measured = Speedup::of(&settings, &runs).unwrap();
        let machine = Machine {
            cpu: Some("a CPU".into()),
            cores: 4,
            caches: vec![Cache { level: 1, bytes: 32 << 10 }],
            os: "an operating system",
            tsc_hz: Some(2e9),
            tsc_invariant: true,
            version: "1.2.3",
            nasm: Some("an assembler"),
            cc: Some("a compiler"),
            cflags: Some("-O3"),
            rustc: "another compiler",
        };
        let conditions = Conditions {
            core: Some(1),
            runs: 3,
            complete: true,
            seconds: 10.0,
            timed_share: Some(0.912),
            taken_share: Some(0.01),
        };
        let mut document = Document::new(measured, machine, conditions);
        let rung = |rung: &str, over: Option<&str>, cycles: f64, gain: f64| Rung {
            rung: rung.into(),
            change: "a change".into(),
            flags: "-O3",
            over: over.map(Into::into),
            aside: false,
            threads: 1,
            cycles_per_pixel: cycles,
            instructions_per_pixel: over.map(|_| 123.4),
            gain,
            gain_low: 0.9 * gain,
            gain_high: 1.1 * gain,
            gain_total: gain,
            samples: vec![cycles],
            taken: vec![false],
            samples_per_run: 1,
        };
        document.ladder =
            vec![rung("low", None, 80.0, 1.0), Rung { aside: true, ..rung("high", Some("low"), 20.0, 4.0) }];
        document.against_compiler =
            vec![AgainstCompiler { engine: "high", compiled: "low", ratio: 4.0, low: 3.6, high: 4.4 }];
        let share = |cause, factor, share| Share { cause, factor, share };
        document.explanations = vec![Explanation {
            from: "low",
            to: "high",
            factor: 4.0,
            shares: vec![share("one thing", 4.0, 1.0), share("nothing", 1.0, -0.0)],
        }];
        document.verdicts =
            vec![Claim { claim: "All is well", verdict: Verdict::NotTestable, figure: "no figure".into() }];
        document
    }

    /// Held against the file of that name in tests/snapshots.
    fn snapshot(name: &str, text: &str) {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/snapshots");
        insta::with_settings!({ snapshot_path => path, prepend_module_to_snapshot => false, omit_expression => true }, {
            insta::assert_snapshot!(name, text);
        });
    }

    #[test]
    fn the_text_is_laid_out_as_agreed() {
        snapshot("experiment_text", &text(&document()));
    }

    #[test]
    fn what_is_printed_begins_with_the_result_and_ends_with_where_the_files_are() {
        let mut document = document();
        document.ladder.clear();
        document.verdicts = vec![document.verdicts[0].clone(); 8];
        let files = "The files are in some/where: table.md has all of it";
        let printed = printed(&document, false, Path::new("some/where"));
        let lines: Vec<_> = printed.lines().collect();
        assert!(
            lines[0].starts_with("C takes 6.35 [") && lines[0].ends_with(" the cycles of SIMD; in the paper 6.34"),
            "{}",
            lines[0]
        );
        assert!(lines[1].starts_with("a CPU, 4 cores; noise floor "), "{}", lines[1]);
        assert_eq!(lines[2..10], ["- All is well: not testable here"; 8]);
        assert_eq!(lines[10..], ["", &format!("{files}; --full prints the tables")]);
        let full = super::printed(&document, true, Path::new("some/where"));
        assert!(full.starts_with(lines[0]) && full.contains(&text(&document)) && full.ends_with(&format!("{files}\n")));
        // One core is one core.
        document.machine.cores = 1;
        assert!(super::printed(&document, true, Path::new("x")).contains("CPU: a CPU, 1 core; "));
    }

    #[test]
    fn the_csv_has_a_line_for_each_engine_and_size_and_as_many_cells_in_each() {
        let csv = csv(&document());
        snapshot("experiment_csv", &csv);
        let cells = |line: &str| line.split(',').count();
        assert!(csv.lines().all(|line| cells(line) == cells(csv.lines().next().unwrap())));
    }

    #[test]
    fn what_cannot_be_judged_is_said_above_all_figures_and_below_them() {
        let mut document = document();
        document.disturbed = vec!["others had the core".into()];
        document.rows[0].taken = 2;
        let text = text(&document);
        let said: Vec<_> = text.match_indices("\n- others had the core\n").map(|(at, _)| at).collect();
        assert!(
            said.len() == 2 && said[0] < text.find("| w×h").unwrap() && text.ends_with("- others had the core\n"),
            "{text}"
        );
        assert!(text.contains("Of 18 pairs with `c`, others had the core in 2,"), "{text}");
        for full in [false, true] {
            let printed = printed(&document, full, Path::new("x"));
            assert!(printed.starts_with("Not all of it can be judged here"), "{printed}");
            assert!(printed.matches("\n- others had the core\n").count() == if full { 3 } else { 2 }, "{printed}");
        }
    }

    #[test]
    fn a_run_that_was_stopped_says_so_above_its_table() {
        let mut document = document();
        document.conditions.complete = false;
        let text = text(&document);
        let (warning, table) = (text.find("Stopped early").unwrap(), text.find("| w×h").unwrap());
        assert!(warning < table);
    }
}
