//! The options for engine and precision, shared by all commands that trace with one engine.

use std::env;
use std::ffi::OsString;
use std::str::FromStr;

use clap::Args;

use super::Failure;
use rayo::internals::kernels::sys::cores;
use rayo::internals::plan::{Keep, Team};
use rayo::internals::render::{Engine, EngineError, PixelFormat, Plan, Precision, Purpose, Settings};
use rayo::internals::scene::Scene;

/// The environment variable that is the default of `--engine`.
pub(super) const VARIABLE: &str = "RAYO_ENGINE";

/// Who traces, in what numbers.
#[derive(Debug, Args)]
pub struct EngineArgs {
    /// The engine: reference, rust, c, paper, portable, sse41, avx2, avx512, or auto for the
    /// fastest that this CPU runs
    #[arg(long, value_name = "ENGINE", env = VARIABLE, default_value = "auto")]
    engine: OsString,
    /// The precision: single, fast (with estimates that only affect the shade) or double. Default:
    /// the engine's own
    #[arg(long)]
    precision: Option<String>,
}

impl EngineArgs {
    /// Whether the fastest engine is to be chosen. An empty environment variable counts as unset.
    pub(super) fn is_auto(&self) -> bool {
        let is_none = self.engine.is_empty() && env::var_os(VARIABLE).is_some_and(|value| value.is_empty());
        is_none || self.engine == "auto"
    }

    /// The engine, which this CPU can run, and the precision that was asked for, if any.
    pub(super) fn chosen(&self) -> Result<(Engine, Option<Precision>), Failure> {
        let EngineArgs { engine, precision } = self;
        let usable = |engine: Engine| engine.usable().then_some(engine).ok_or(EngineError::Unusable(engine));
        let engine = if self.is_auto() { "auto".as_ref() } else { engine.as_os_str() };
        let chosen = Engine::from_str(&engine.to_string_lossy()).and_then(usable).map_err(|error| {
            // Name the environment variable in the error: the user may have set it long ago and
            // forgotten it.
            let from_variable = env::var_os(VARIABLE).is_some_and(|value| value == *engine);
            Failure::input(if from_variable { format!("{VARIABLE}: {error}") } else { error.to_string() })
        })?;
        let precision = precision.as_deref().map(Precision::from_str).transpose().map_err(Failure::input)?;
        Ok((chosen, precision))
    }
}

/// The engine and the settings that pictures are traced with.
#[derive(Clone, Copy)]
pub(super) struct Tracing {
    pub engine: Engine,
    pub precision: Option<Precision>,
    pub keep: Keep,
    /// None means one thread for each core, or as many as the system allows.
    pub threads: Option<usize>,
}

impl Tracing {
    /// The plan of a scene for one pixel format, or for any, of which a frame traces bands of rows.
    pub(super) fn plan(self, scene: &Scene, format: Option<PixelFormat>) -> Result<Plan<'_>, Failure> {
        let Tracing { engine, precision, keep, .. } = self;
        let threads = self.threads.unwrap_or_else(cores);
        Plan::new(engine, scene, Purpose { precision, format, keep, threads, in_bands: true, cancel: None })
            .map_err(Failure::input)
    }

    /// The settings of a frame. Starts the threads, to learn how many the system allows.
    pub(super) fn settings(self) -> Settings {
        Settings { threads: self.threads.unwrap_or_else(|| Team::up_to(cores()).threads()) }
    }
}
