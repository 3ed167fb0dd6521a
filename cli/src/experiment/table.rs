//! The tables of the experiment, in Markdown that is readable as plain text, and as CSV.

use std::path::Path;

use crate::essay::{filled, part};
use crate::table::{self, Column, Table};
use rayo::internals::plan::with_digit_groups;
use rayo::internals::render::PixelFormat;
use rayo::internals::scene::shown;
use rayo_lab::experiments::document::{Conditions, Experiment};
use rayo_lab::experiments::jumps::{self, BOUND, Bandwidth, Finding, Jumps};
use rayo_lab::experiments::ladder::{AgainstCompiler, Explanation, Rung, SIZE};
use rayo_lab::experiments::speedup::{BASELINE, CONTROL, PAPER, PaperRow, Timing, paper_mean_ratio, paper_row};
use rayo_lab::measure::OFF_BY_MAD;
use rayo_lab::measure::statistics::Estimate;

/// The prose of the page.
pub(super) const EXPLANATION: &str = include_str!("explanation.md");

fn cores_in_words(cores: usize) -> String {
    if cores == 1 { "1 core".into() } else { format!("{cores} cores") }
}

fn interval(estimate: &Estimate) -> String {
    format!("{:.3} [{:.3}, {:.3}]", estimate.value, estimate.low, estimate.high)
}

/// The text above the table: what was measured on which machine, and how reliable it is.
pub(super) fn preamble(document: &Experiment) -> String {
    let unknown = || "unknown".to_owned();
    let facts: String = document.machine.facts().map(|(name, value)| format!("- {name}: {value}\n")).collect();
    let Conditions { core, runs, timed_share, taken_share, .. } = &document.conditions;
    let core = core.map_or("not pinned".into(), |core| format!("pinned to core {core}"));
    let sum = |of: fn(&Timing) -> usize| document.table.rows.iter().map(of).sum::<usize>();
    let (migrated, off, all) = (sum(|row| row.migrations), sum(|row| row.off), sum(|row| row.samples.len()));
    let Estimate { value, low, high } = document.table.control_overall;
    let percent = |share: &Option<f64>| share.map_or_else(unknown, |share| format!("{:.0} %", 100.0 * share));
    let (timed, taken) = (percent(timed_share), percent(taken_share));
    let mut text = format!(
        "{facts}\n\
        Runs: {runs} of each size, each in a process of its own, {core}, interleaved; of {all} pictures {migrated} migrated to \
        another core and {off} were off by more than {OFF_BY_MAD} MAD; all are kept\n\
        Timed: {timed} of the run time; other programs had the core in {taken} of it\n\n\
        Noise floor: {floor:.2} %. `{CONTROL}` against itself is {value:.4} [{low:.4}, {high:.4}] over all sizes, and \
        at most {floor:.2} % from 1 at any size: no ratio closer to 1 than that counts as a difference\n",
        floor = 100.0 * document.table.noise_floor,
    );
    let taken = sum(|row| row.taken);
    if taken > 0 {
        text += &format!(
            "Of {all} pairs with `{BASELINE}`, others had the core in {taken}, each time that they were tried; figures leave \
            these out where at least half of the pairs remain\n"
        );
    }
    if *runs == 1 {
        text += "One run has no spread: the intervals below are points\n";
    }
    text
}

/// The speedup C/SIMD over all sizes, beside the paper's.
pub(super) fn headline(document: &Experiment) -> String {
    let ratios = PAPER.map(|row| row.ratio());
    let (low, high) = ratios.iter().fold((f64::INFINITY, 0.0), |(low, high), r| (r.min(low), r.max(high)));
    format!(
        "C/SIMD over all sizes: {} (median of the pairs; 95 % interval over runs, widened by the noise floor); the paper's: {:.2}, from {low:.2} to {high:.2}\n",
        interval(&document.table.c_by_simd),
        paper_mean_ratio(),
    )
}

fn size(row: &Timing) -> String {
    format!("{}×{}", row.width, row.height)
}

fn cycles(mean: f64) -> String {
    with_digit_groups(mean.round() as u64, ' ')
}

fn ratio_interval(row: &Timing) -> String {
    format!("[{:.3}, {:.3}]", row.ratio_low, row.ratio_high)
}

/// The paper's table beside the measured one.
pub fn paper_table(document: &Experiment) -> Table {
    /// The times of C and SIMD at one size.
    struct Pair<'a>(&'a Timing, &'a Timing);
    let columns: [Column<Pair<'_>>; 8] = [
        ("w×h", |Pair(c, _)| size(c)),
        ("pixels", |Pair(c, _)| c.pixels.to_string()),
        ("C, mean cycles", |Pair(c, _)| cycles(c.cycles_mean)),
        ("SIMD, mean cycles", |Pair(_, simd)| cycles(simd.cycles_mean)),
        ("C/SIMD", |Pair(c, simd)| format!("{:.2}", c.cycles_mean / simd.cycles_mean)),
        ("paper's C/SIMD", |Pair(c, _)| {
            paper_row(c.width, c.height).map_or("-".into(), |row| format!("{:.2}", row.ratio()))
        }),
        ("C/SIMD by pairs", |Pair(_, simd)| format!("{:.3}", simd.ratio_to_c)),
        ("95 % interval", |Pair(_, simd)| ratio_interval(simd)),
    ];
    let pairs = document.sizes().map(|rows| {
        let find = |name| rows.iter().find(|row| row.is(name)).expect("it is measured at every size");
        Pair(find(BASELINE), find(CONTROL))
    });
    Table::of(1, &columns, &pairs.collect::<Vec<_>>())
}

fn contestant(row: &Timing) -> String {
    if row.is(&row.engine) { row.engine.to_string() } else { format!("{} {}", row.engine, row.output) }
}

/// The cycles per pixel of every engine, and its speedup over `c`.
pub fn engine_table(document: &Experiment) -> Table {
    let first = document.sizes().next().unwrap_or_default();
    let mut table = Table::new(1, ["w×h".to_owned()].into_iter().chain(first.iter().map(contestant)));
    for rows in document.sizes() {
        let cell = |row: &Timing| {
            // A difference within the noise is shown as none.
            let same = !row.is(BASELINE) && (row.ratio_to_c - 1.0).abs() <= document.table.noise_floor;
            let ratio = if same { "≈1".into() } else { format!("{:.2}", row.ratio_to_c) };
            format!("{:.2} ({ratio})", row.cycles_per_pixel())
        };
        table.row([size(&rows[0])].into_iter().chain(rows.iter().map(cell)).collect());
    }
    table
}

/// Mean, median, minimum and ratio of all measurements.
pub(super) fn full_table(document: &Experiment) -> String {
    let columns: [Column<Timing>; 9] = [
        ("w×h", size),
        ("engine", contestant),
        ("mean", |row| cycles(row.cycles_mean)),
        ("median", |row| cycles(row.cycles_median)),
        ("minimum", |row| cycles(row.cycles_min)),
        ("ratio to c", |row| format!("{:.3}", row.ratio_to_c)),
        ("95 % interval", ratio_interval),
        ("migrated", |row| row.migrations.to_string()),
        ("off", |row| row.off.to_string()),
    ];
    Table::of(2, &columns, &document.table.rows).text()
}

/// The ladder, and the comparison of packet engines with the compiler.
fn ladder(document: &Experiment) -> String {
    let (width, height) = SIZE;
    let heading = "rungs in brackets are asides, on which the next rung does not build";
    let mut parts = vec![format!("The ladder, {width}×{height}; {heading}:\n"), ladder_table(document).text()];
    parts.push(against_compiler(document));
    if let Some(reason) = &document.uncounted {
        parts.push(format!("Instructions are not counted: {reason}\n"));
    }
    parts.join("\n")
}

/// The table of the ladder, with a row for each rung.
pub fn ladder_table(document: &Experiment) -> Table {
    let columns: [Column<Rung>; 8] = [
        ("rung", |rung| if rung.aside { format!("({})", rung.rung) } else { rung.rung.clone() }),
        ("what is different", |rung| rung.change.clone()),
        ("cycles/pixel", |rung| format!("{:.2}", rung.cycles_per_pixel)),
        ("instructions/pixel", |rung| rung.instructions_per_pixel.map_or("n/a".into(), |count| format!("{count:.1}"))),
        ("gain", |rung| format!("{:.2}", rung.gain)),
        ("95 % interval", |rung| format!("[{:.2}, {:.2}]", rung.gain_low, rung.gain_high)),
        ("over", |rung| rung.over.clone().unwrap_or("-".into())),
        ("over the first", |rung| format!("{:.2}", rung.gain_total)),
    ];
    Table::of(2, &columns, &document.ladder)
}

/// The comparison of packet engines with the compiler's vectorisation.
fn against_compiler(document: &Experiment) -> String {
    let line = |against: &AgainstCompiler| {
        let AgainstCompiler { engine, compiled, ratio, low, high } = against;
        format!("`{engine}` is {ratio:.2} [{low:.2}, {high:.2}] times as fast as `{compiled}`\n")
    };
    let lines: String = document.against_compiler.iter().map(line).collect();
    if lines.is_empty() {
        lines
    } else {
        format!("Packets against compiled code for the same instructions:\n\n{lines}")
    }
}

/// The share of each cause in the speedup.
fn explanation(document: &Experiment) -> String {
    let mut text = String::new();
    for Explanation { from, to, factor, shares } in &document.explanations {
        let shares: Vec<_> = shares
            .iter()
            .map(|share| {
                // Adding 0 turns -0 into 0.
                let percent = (100.0 * share.share).round() + 0.0;
                format!("{} {percent:.0} % (times {:.2})", share.cause, share.factor)
            })
            .collect();
        text += &format!("From `{from}` to `{to}`, times {factor:.2}: {}.\n", shares.join(", "));
    }
    if !text.is_empty() {
        text += "Shares are on a logarithmic scale, on which factors add up.\n";
    }
    text
}

/// The table of the sweep that explains the two jumps in the paper's figure 2.
fn jumps_table(jumps: &Jumps) -> String {
    let columns: [Column<jumps::PictureTime>; 9] = [
        ("w×h", |row| format!("{}×{}", row.width, row.height)),
        ("engine", |row| row.engine.to_string()),
        ("framebuffer", |row| if row.touched { "touched" } else { "untouched" }.into()),
        ("cycles/pixel", |row| format!("{:.2}", row.cycles_per_pixel)),
        ("core clock/TSC", |row| format!("{:.3}", row.clock_per_tick)),
        ("taken by others", |row| row.taken_share.map_or("n/a".into(), |share| format!("{:.0} %", 100.0 * share))),
        ("core cycles/pixel", |row| format!("{:.2}", row.core_cycles_per_pixel)),
        ("page faults", |row| format!("{:.0}", row.page_faults)),
        ("bytes/cycle", |row| format!("{:.3}", row.bytes_per_cycle)),
    ];
    let mut text = Table::of(3, &columns, &jumps.rows).text();
    for level in &jumps.bandwidth {
        let Bandwidth { level, bytes, bytes_per_cycle } = level;
        text += &format!("{level} takes {bytes_per_cycle:.1} bytes a cycle ({} KiB)\n", bytes >> 10);
    }
    text
}

/// What this machine shows of the two jumps, and what it cannot show.
fn jumps_text(jumps: &Jumps) -> String {
    let levels = jumps.bandwidth.iter().map(|level| format!("{} {:.1}", level.level, level.bytes_per_cycle));
    let levels = levels.collect::<Vec<_>>().join(", ");
    let mut text = format!("Bytes that plain stores write per TSC cycle: {levels}.\n");
    for finding in jumps.findings() {
        let Finding { engine, change, clock_change, core_change, bandwidth_share, cycles_per_fault, .. } = finding;
        let percent = |share: Option<f64>| share.map_or("unknown".into(), |share| format!("{:.1} %", 100.0 * share));
        text += &format!(
            "`{engine}` in a touched framebuffer: between the sizes, TSC cycles per pixel differ by {}, the core's \
            clock by {}, and cycles of that clock per pixel by {}. It writes with up to {} of the bandwidth of \
            the slowest level of memory{}. An untouched framebuffer costs {:.1} cycles a pixel more{}.\n",
            percent(Some(change)),
            percent(Some(clock_change)),
            percent(Some(core_change)),
            percent(bandwidth_share),
            if bandwidth_share.is_some_and(|share| share <= BOUND) { ", and so is not bound by it" } else { "" },
            finding.fault_cycles_per_pixel,
            cycles_per_fault.map_or_else(String::new, |cycles| format!(", {cycles:.0} a page fault")),
        );
    }
    // By what factor the cycles per pixel grow from the previous row of the paper's table to this
    // one.
    let jump = |row: usize, of: fn(&PaperRow) -> f64| {
        let by_pixel = |row: &PaperRow| of(row) / row.pixels() as f64;
        format!("{:.2}", by_pixel(&PAPER[row]) / by_pixel(&PAPER[row - 1]))
    };
    text + &filled(part(EXPLANATION, "the paper's jumps"), |what| match what {
        "C, first" => jump(5, |row| row.c),
        "SIMD, first" => jump(5, |row| row.simd),
        "C, second" => jump(8, |row| row.c),
        "SIMD, second" => jump(8, |row| row.simd),
        "bytes" => format!("{:.3}", (PixelFormat::F32x4.bytes() as u64 * PAPER[8].pixels()) as f64 / PAPER[8].c),
        _ => unreachable!("no figure `{what}`"),
    })
}

/// The verdicts on the claims, as a list, since their figures are too long for a table.
fn verdicts(document: &Experiment) -> String {
    document
        .verdicts
        .iter()
        .map(|claim| format!("- {}: {}\n  {}\n", claim.claim, claim.verdict, claim.figure))
        .collect()
}

/// The disturbances that made some results unreliable. The text shows them both above and below all
/// figures.
fn disturbed(document: &Experiment) -> Option<String> {
    let reasons: String = document.disturbed.iter().map(|reason| format!("- {reason}\n")).collect();
    (!reasons.is_empty())
        .then(|| format!("Not all of it can be judged here; run it again on a quiet machine:\n\n{reasons}"))
}

/// The printed text: the result in about ten lines, with `full` also all tables, the ladder if it
/// was measured, and where the files are.
pub(super) fn printed(document: &Experiment, full: bool, directory: &Path) -> String {
    let mut parts: Vec<_> = disturbed(document).into_iter().chain([summary(document)]).collect();
    if full {
        parts.push(text(document));
    } else if !document.ladder.is_empty() {
        parts.push(ladder(document));
    }
    // The full text ends with them already.
    parts.extend(disturbed(document).filter(|_| !full));
    let tables = if full { "" } else { "; --full prints the tables" };
    parts.push(format!("The files are in {}: table.md has all of it{tables}\n", shown(directory)));
    parts.join("\n")
}

/// The speedup, and a verdict on each claim, without the figures, which are in the tables.
pub fn summary(document: &Experiment) -> String {
    let Estimate { value, low, high } = document.table.c_by_simd;
    let mut text = format!(
        "C takes {value:.2} [{low:.2}, {high:.2}] times the cycles of SIMD; in the paper {:.2}\n\
        {}, {}; noise floor {:.2} %\n",
        paper_mean_ratio(),
        document.machine.cpu(),
        cores_in_words(document.machine.cores),
        100.0 * document.table.noise_floor,
    );
    if !document.conditions.complete {
        text += "Stopped early: only what was finished is here\n";
    }
    for claim in &document.verdicts {
        text += &format!("- {}: {}\n", claim.claim, claim.verdict);
    }
    text
}

/// The whole page, which is written to a file; `--full` prints all of it except the summary.
pub(super) fn text(document: &Experiment) -> String {
    let mut parts = vec![preamble(document)];
    if !document.conditions.complete {
        parts.push("Stopped early: only what was finished is here\n".into());
    }
    parts.extend(disturbed(document));
    parts.push(paper_table(document).text());
    parts.push(headline(document));
    parts.push("Median cycles per pixel (times as fast as `c`; ≈1 within the noise floor):\n".into());
    parts.push(engine_table(document).text());
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
        parts.push(jumps_text(jumps));
    }
    if !document.verdicts.is_empty() {
        parts.push("The paper's claims:\n".into());
        parts.push(verdicts(document));
    }
    parts.extend(disturbed(document));
    parts.join("\n")
}

/// The CSV, with a line for each engine and size.
pub(super) fn csv(document: &Experiment) -> String {
    let columns: [Column<Timing>; 17] = [
        ("width", |row| row.width.to_string()),
        ("height", |row| row.height.to_string()),
        ("pixels", |row| row.pixels.to_string()),
        ("engine", |row| row.engine.to_string()),
        ("precision", |row| row.precision.to_string()),
        ("output", |row| row.output.to_string()),
        ("threads", |row| row.threads.to_string()),
        ("cycles_mean", |row| format!("{:.2}", row.cycles_mean)),
        ("cycles_median", |row| format!("{:.2}", row.cycles_median)),
        ("cycles_min", |row| format!("{:.2}", row.cycles_min)),
        ("cycles_per_pixel", |row| format!("{:.4}", row.cycles_per_pixel())),
        ("ratio_to_c", |row| format!("{:.4}", row.ratio_to_c)),
        ("ratio_low", |row| format!("{:.4}", row.ratio_low)),
        ("ratio_high", |row| format!("{:.4}", row.ratio_high)),
        ("paper_ratio", |row| {
            let paper = paper_row(row.width, row.height).filter(|_| row.is(CONTROL));
            paper.map_or_else(String::new, |paper| format!("{:.4}", paper.ratio()))
        }),
        ("migrations", |row| row.migrations.to_string()),
        ("off", |row| row.off.to_string()),
    ];
    table::csv(&columns, &document.table.rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rayo::internals::kernels::Cache;
    use rayo_lab::experiments::claims::Claim;
    use rayo_lab::experiments::ladder::CauseShare;
    use rayo_lab::experiments::speedup::{self, Settings, Speedup};
    use rayo_lab::experiments::verdict::Verdict;
    use rayo_lab::measure::Machine;

    /// Two sizes and three engines on an invented machine.
    fn document() -> Experiment {
        let engines = [BASELINE, CONTROL, "rust"].map(|name| name.parse().unwrap()).to_vec();
        let settings = Settings { sizes: vec![0, 19], runs: 3, engines };
        let runs = speedup::scripted_runs(&settings, &[47_000_000, 7_400_000, 7_500_000, 5_000_000]);
        let measured = Speedup::of(&settings, &runs).unwrap();
        let machine = Machine {
            cpu: Some("a CPU".into()),
            cores: 4,
            caches: vec![Cache { level: 1, bytes: 32 << 10 }],
            os: "an operating system".into(),
            tsc_hz: Some(2e9),
            tsc_invariant: true,
            version: "1.2.3".into(),
            microarchitecture: Some("a core".into()),
            family: Some(7),
            model: Some(8),
            commit: Some("0123456789ab".into()),
            nasm: Some("an assembler".into()),
            cc: Some("a compiler".into()),
            cflags: Some("-O3".into()),
            rustc: "another compiler".into(),
            ..Machine::default()
        };
        let conditions = Conditions {
            core: Some(1),
            runs: 3,
            complete: true,
            seconds: 10.0,
            timed_share: Some(0.912),
            taken_share: Some(0.01),
        };
        let mut document = Experiment { table: measured, machine, conditions, ..Experiment::default() };
        let rung = |rung: &str, over: Option<&str>, cycles: f64, gain: f64| Rung {
            rung: rung.into(),
            change: "a change".into(),
            over: over.map(Into::into),
            cycles_per_pixel: cycles,
            instructions_per_pixel: over.map(|_| 123.4),
            gain,
            gain_low: 0.9 * gain,
            gain_high: 1.1 * gain,
            gain_total: gain,
            ..Rung::default()
        };
        document.ladder =
            vec![rung("low", None, 80.0, 1.0), Rung { aside: true, ..rung("high", Some("low"), 20.0, 4.0) }];
        document.against_compiler =
            vec![AgainstCompiler { engine: "high".into(), compiled: "low".into(), ratio: 4.0, low: 3.6, high: 4.4 }];
        let share = |cause: &'static str, factor, share| CauseShare { cause: cause.into(), factor, share };
        document.explanations = vec![Explanation {
            from: "low".into(),
            to: "high".into(),
            factor: 4.0,
            shares: vec![share("one thing", 4.0, 1.0), share("nothing", 1.0, -0.0)],
        }];
        document.verdicts =
            vec![Claim { claim: "All is well".into(), verdict: Verdict::NotTestable, figure: "no figure".into() }];
        document
    }

    /// Compares a text with the file of that name in cli/tests/snapshots.
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
    fn printed_text_begins_with_the_result_and_ends_with_files() {
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
        assert!(lines[1].starts_with("a CPU (a core, family 7 model 8), 4 cores; noise floor "), "{}", lines[1]);
        assert_eq!(lines[2..10], ["- All is well: not testable here"; 8]);
        assert_eq!(lines[10..], ["", &format!("{files}; --full prints the tables")]);
        let full = super::printed(&document, true, Path::new("some/where"));
        assert!(full.starts_with(lines[0]) && full.contains(&text(&document)) && full.ends_with(&format!("{files}\n")));
        // One core is one core.
        document.machine.cores = 1;
        assert!(super::printed(&document, true, Path::new("x")).contains(" model 8), 1 core; "));
    }

    #[test]
    fn csv_has_a_line_for_each_engine_and_size() {
        let csv = csv(&document());
        snapshot("experiment_csv", &csv);
        let cells = |line: &str| line.split(',').count();
        assert!(csv.lines().all(|line| cells(line) == cells(csv.lines().next().unwrap())));
    }

    #[test]
    fn unjudged_claims_are_told_above_and_below_the_figures() {
        let mut document = document();
        document.disturbed = vec!["others had the core".into()];
        document.table.rows[0].taken = 2;
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
