//! The times and counts of a picture, as `--stats` and `--json` print them.

use std::ops::Range;
use std::time::Duration;

use serde::Serialize;

use crate::engine::Tracing;
use rayo::internals::render::{Counted, Stats};

/// The statistics; the field names are those of the JSON document.
#[derive(Serialize)]
pub(super) struct Report {
    engine: &'static str,
    precision: &'static str,
    width: u32,
    height: u32,
    threads: usize,
    rays: u64,
    hits: u64,
    parse_ns: u64,
    setup_ns: u64,
    trace_ns: u64,
    trace_cycles: Option<u64>,
    encode_ns: u64,
    write_ns: u64,
}

impl Report {
    pub(super) fn of(
        tracing: Tracing,
        (width, rows): (u32, &Range<u32>),
        [parse, setup]: [Duration; 2],
        stats: &Stats,
    ) -> Self {
        let ns = |time: Duration| time.as_nanos() as u64;
        let Counted { rays, hits } = stats.counted.unwrap_or_default();
        Report {
            engine: tracing.engine.name(),
            precision: tracing.precision.unwrap_or(tracing.engine.precision()).name(),
            width,
            height: rows.len() as u32,
            threads: tracing.settings().threads,
            rays,
            hits,
            parse_ns: ns(parse),
            setup_ns: ns(setup),
            trace_ns: ns(stats.trace),
            trace_cycles: stats.trace_cycles,
            encode_ns: ns(stats.encode),
            write_ns: ns(stats.write),
        }
    }

    pub(super) fn text(&self) -> String {
        let share = 100.0 * self.hits as f64 / self.rays as f64;
        let cycles =
            self.trace_cycles.map(|cycles| format!(", {:.2} cycles per ray", cycles as f64 / self.rays as f64));
        let threads = if self.threads == 1 { "1 thread".into() } else { format!("{} threads", self.threads) };
        let time = |ns: u64| format!("{:>10.3} ms", ns as f64 / 1e6);
        let lines = [
            ("engine", format!("{}, {}, {threads}", self.engine, self.precision)),
            (
                "rays",
                format!("{} ({}x{}), {} of them hit ({share:.1} %)", self.rays, self.width, self.height, self.hits),
            ),
            ("parse", time(self.parse_ns)),
            ("set-up", time(self.setup_ns)),
            ("trace", time(self.trace_ns) + &cycles.unwrap_or_default()),
            ("encode", time(self.encode_ns)),
            ("write", time(self.write_ns)),
        ];
        lines.map(|(name, value)| format!("{name:<8} {value}\n")).concat()
    }
}
