//! The commands that need the feature `lab`, which measure and prove, and those for shells and manuals.

use std::process::ExitCode;

use clap::Subcommand;

use super::party::Party;
use super::{Failure, accuracy, experiment, for_one_process, ops, plan, report, shell, stability, step};

#[derive(Debug, Subcommand)]
pub enum Command {
    Plan(plan::PlanArgs),
    Accuracy(accuracy::AccuracyArgs),
    Experiment(experiment::ExperimentArgs),
    Ops(ops::OpsArgs),
    Report(report::ReportArgs),
    Stability(stability::StabilityArgs),
    Step(step::StepArgs),
    Completions(shell::CompletionsArgs),
    Man(shell::ManArgs),
}

impl Command {
    pub fn run(&self, party: &Party) -> Result<ExitCode, Failure> {
        match self {
            Command::Accuracy(args) => accuracy::run(args, party),
            Command::Experiment(args) => experiment::run(args, party),
            Command::Stability(args) => stability::run(args, party),
            _ if !party.is_alone() => Err(for_one_process()),
            Command::Plan(args) => plan::run(args),
            Command::Ops(args) => ops::run(args),
            Command::Report(args) => report::run(args),
            Command::Step(args) => step::run(args),
            Command::Completions(args) => shell::completions(args),
            Command::Man(args) => shell::man(args),
        }
    }
}
