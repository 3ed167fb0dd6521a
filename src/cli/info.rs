//! `rayo info`: the CPU, the engines of this build, and what they were built with.

use std::process::ExitCode;

use clap::Args;
use serde::Serialize;

use super::{Failure, print_result};
use crate::kernels::Isa;
use crate::measure::{cpu_name, tsc_hz, tsc_invariant};
use crate::render::Engine;

/// Show the CPU, the engines that it runs, and the versions that they were built with
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  rayo info
  rayo info --json
  rayo info --json > machine.json")]
pub struct InfoArgs {
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

/// What there is to tell; the names are those of the JSON document.
#[derive(Serialize)]
struct Info {
    version: &'static str,
    cpu: Option<String>,
    tsc_hz: Option<f64>,
    tsc_invariant: Option<bool>,
    isa: Vec<IsaInfo>,
    /// Those that this machine runs.
    engines: Vec<&'static str>,
    auto: &'static str,
    nasm: Option<&'static str>,
    cc: Option<&'static str>,
    cflags: Option<&'static str>,
    rustc: &'static str,
}

#[derive(Serialize)]
struct IsaInfo {
    name: &'static str,
    built: bool,
    usable: bool,
}

impl Info {
    fn new() -> Self {
        let isa = Isa::ALL.iter().map(|isa| IsaInfo { name: isa.name(), built: isa.built(), usable: isa.usable() });
        let engines = Engine::ALL.iter().filter(|engine| engine.usable()).map(|engine| engine.name());
        Info {
            version: env!("CARGO_PKG_VERSION"),
            cpu: cpu_name(),
            tsc_hz: tsc_hz().map(f64::round),
            tsc_invariant: tsc_invariant(),
            isa: isa.collect(),
            engines: engines.collect(),
            auto: Engine::fastest().name(),
            nasm: option_env!("RAYO_NASM"),
            cc: option_env!("RAYO_CC"),
            cflags: option_env!("RAYO_CFLAGS"),
            rustc: env!("RAYO_RUSTC"),
        }
    }

    fn text(&self) -> String {
        let of = |text: Option<&str>, what| text.map_or(format!("none (built without {what})"), str::to_owned);
        let clock = match (self.tsc_hz, self.tsc_invariant) {
            (Some(hz), Some(true)) => format!("{:.3} GHz, invariant", hz / 1e9),
            (Some(hz), _) => format!("{:.3} GHz, not known to be invariant", hz / 1e9),
            (None, _) => "none".into(),
        };
        let isa = self.isa.iter().map(|isa| match (isa.built, isa.usable) {
            (true, true) => isa.name.to_owned(),
            (true, false) => format!("{} (not on this CPU)", isa.name),
            (false, _) => format!("{} (not in this build)", isa.name),
        });
        let lines = [
            ("version", self.version.to_owned()),
            ("CPU", self.cpu.clone().unwrap_or_else(|| "unknown".into())),
            ("time stamps", clock),
            ("ISA", isa.collect::<Vec<_>>().join(", ")),
            ("engines", self.engines.join(", ")),
            ("auto", self.auto.to_owned()),
            ("NASM", of(self.nasm, "assembly")),
            ("C compiler", of(self.cc, "C")),
            ("C flags", of(self.cflags, "C")),
            ("Rust", self.rustc.to_owned()),
        ];
        lines.map(|(name, value)| format!("{name:<12} {value}\n")).concat()
    }
}

/// Prints what there is to tell.
pub fn run(args: &InfoArgs) -> Result<ExitCode, Failure> {
    let info = Info::new();
    print_result(args.json, &info, || info.text())?;
    Ok(ExitCode::SUCCESS)
}
