//! Several files as a table: a line each, the best first.

use super::Outcome;
use crate::table::Table;
use rayo_lab::experiments::bring::verdict::Verdict;

/// The table: what holds comes before what does not, and within each the fewest cycles, then the
/// fewest instructions.
pub fn text(outcomes: &[Outcome]) -> String {
    let head = ["file", "verdict", "result", "ulp", "instructions", "latency", "one every", "what does not hold"];
    let mut table = Table::new(3, head);
    let mut sorted: Vec<_> = outcomes.iter().collect();
    sorted.sort_by(|a, b| order(a).partial_cmp(&order(b)).expect("no figure is NaN"));
    for outcome in sorted {
        table.row(row(outcome));
    }
    table.text()
}

/// What a line is sorted by.
fn order(outcome: &Outcome) -> (u8, f64, usize, &str) {
    match outcome {
        Outcome::Judged(verdict) => {
            let latency = verdict.figures.latency.unwrap_or(f64::INFINITY);
            let instructions = verdict.instructions.function.unwrap_or(usize::MAX);
            (u8::from(!verdict.holds), latency, instructions, &verdict.file)
        }
        Outcome::Unusable { file, .. } => (2, f64::INFINITY, usize::MAX, file),
    }
}

fn row(outcome: &Outcome) -> Vec<String> {
    match outcome {
        Outcome::Judged(verdict) => judged(verdict),
        Outcome::Unusable { file, unusable, .. } => {
            let mut cells = vec![String::new(); 8];
            cells[0] = file.clone();
            cells[1] = "unusable".into();
            cells[7] = unusable.lines().next().unwrap_or_default().to_owned();
            cells
        }
    }
}

fn judged(verdict: &Verdict) -> Vec<String> {
    let or_dash = |cell: Option<String>| cell.unwrap_or("-".into());
    let result = match (&verdict.result.same_bits, verdict.result.holds) {
        (Some(_), _) => "same bits",
        (None, Some(true)) => "another order",
        (None, Some(false)) => "wrong",
        (None, None) => "none",
    };
    vec![
        verdict.file.clone(),
        if verdict.holds { "holds" } else { "fails" }.into(),
        result.into(),
        or_dash(verdict.result.max_ulp.map(|ulp| if ulp < 1e6 { format!("{ulp:.2}") } else { format!("{ulp:.0e}") })),
        or_dash(verdict.instructions.function.map(|count| count.to_string())),
        or_dash(verdict.figures.latency.map(|cycles| format!("{cycles:.1}"))),
        or_dash(verdict.figures.throughput.map(|cycles| format!("{cycles:.1}"))),
        verdict.broken.join("; "),
    ]
}
