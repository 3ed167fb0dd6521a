//! `rayo info`: the machine, the engines of this build, and the compilers and commit of the build.

use std::process::ExitCode;

use clap::Args;
use serde::Serialize;

use super::{Failure, print_result};
use rayo::internals::kernels::Isa;
use rayo::internals::render::Engine;
use rayo_lab::measure::Machine;

/// Show the machine, the engines that it runs, and what they were built with
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

/// The information; the field names are those of the JSON document.
#[derive(Serialize)]
struct Info {
    #[serde(flatten)]
    machine: Machine,
    isa: Vec<IsaInfo>,
    /// The engines that this machine can run.
    engines: Vec<&'static str>,
    auto: &'static str,
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
            machine: Machine::this(),
            isa: isa.collect(),
            engines: engines.collect(),
            auto: Engine::fastest().name(),
        }
    }

    fn text(&self) -> String {
        let isa = self.isa.iter().map(|isa| match (isa.built, isa.usable) {
            (true, true) => isa.name.to_owned(),
            (true, false) => format!("{} (not on this CPU)", isa.name),
            (false, _) => format!("{} (not in this build)", isa.name),
        });
        let lines = [
            ("ISA", isa.collect::<Vec<_>>().join(", ")),
            ("engines", self.engines.join(", ")),
            ("auto", self.auto.to_owned()),
        ];
        self.machine.facts().chain(lines).map(|(name, value)| format!("{name:<12} {value}\n")).collect()
    }
}

/// Prints the information.
pub fn run(args: &InfoArgs) -> Result<ExitCode, Failure> {
    let info = Info::new();
    print_result(args.json, &info, || info.text())?;
    Ok(ExitCode::SUCCESS)
}
