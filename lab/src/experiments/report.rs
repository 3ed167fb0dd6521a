//! The results of all experiments on one machine as one document, written and read back.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::accuracy::AccuracyReport;
use super::complexity::Complexity;
use super::document::Experiment;
use super::gallery::ScenePictures;
use super::ops;
use super::roofline::Roofline;
use super::stability::StabilityReport;
use super::threads::OnThreads;
use crate::measure::Machine;
use crate::measure::Name;
use rayo::internals::plan::{Kept, Report as PlanReport, Switch};
use rayo::internals::scene::{brief, shown, text_within};

/// The number of the schema of the documents that this program reads and writes.
pub const SCHEMA: u64 = 1;

/// The stages of a report, in the order in which they are measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    Experiment,
    Ops,
    Roofline,
    Accuracy,
    Stability,
    Complexity,
    Threads,
    Plans,
    Gallery,
    Ray,
}

impl Stage {
    /// All stages, in their order.
    pub const ALL: [Stage; 10] = {
        use Stage::*;
        [Experiment, Ops, Roofline, Accuracy, Stability, Complexity, Threads, Plans, Gallery, Ray]
    };

    pub fn name(self) -> String {
        format!("{self:?}").to_lowercase()
    }
}

/// All results of a machine. The field names are those of the JSON document; what was not measured
/// is null.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Results {
    pub machine: Machine,
    /// Whether it was a quick run, with few rounds and small pictures.
    #[serde(default)]
    pub quick: bool,
    /// For each stage that is missing or incomplete, by name, the reason.
    #[serde(default)]
    pub missing: BTreeMap<String, String>,
    /// The seconds that each stage took, by its name.
    #[serde(default)]
    pub seconds: BTreeMap<String, f64>,
    /// C compared with SIMD, and the ladder.
    pub experiment: Option<Experiment>,
    /// Instructions of each operation.
    pub ops: Option<ops::Report>,
    /// Peak arithmetic and store rates, and how close the kernels come to them.
    pub roofline: Option<Roofline>,
    /// Error against run time.
    pub accuracy: Option<AccuracyReport>,
    /// Errors on ill-conditioned and extreme scenes.
    pub stability: Option<StabilityReport>,
    /// How times grow with pixels, objects and lights.
    pub complexity: Option<Complexity>,
    /// How times fall with threads.
    pub threads: Option<Vec<OnThreads>>,
    /// What the plans of some scenes omit.
    pub plans: Option<Vec<Planned>>,
    /// The pictures of some scenes by every engine.
    pub gallery: Option<Vec<ScenePictures>>,
    /// One ray, as `rayo step` prints it.
    pub ray: Option<RayListing>,
}

/// What the plan of a scene omits, and what each omission gains.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Planned {
    pub scene: String,
    pub engine: Name,
    pub output: Name,
    pub width: u32,
    pub height: u32,
    pub kept: Kept,
    /// Median TSC cycles per pixel as planned.
    pub cycles_per_pixel: f64,
    /// The time with `--keep-all`, divided by that of the plan.
    pub keep_all: Option<f64>,
    pub left_out: Vec<Left>,
}

/// One omission of a plan.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Left {
    pub what: String,
    pub count: u64,
    pub unit: String,
    pub reason: String,
    /// The picture's time without this omission, divided by that of the plan; null if no code does
    /// the omitted work.
    pub worth: Option<f64>,
    /// Whether the omitted work needs other arithmetic, so that `keep_all` does not include it.
    #[serde(default)]
    pub other_arithmetic: bool,
}

impl Left {
    /// The omissions of a plan, each with its gain.
    pub fn of(report: &PlanReport, worth: &[Option<f64>]) -> Vec<Left> {
        let line = |(line, worth): (&rayo::internals::plan::LeftOut, &Option<f64>)| Left {
            what: line.what.into(),
            count: line.count,
            unit: line.unit.into(),
            reason: line.reason.into(),
            worth: *worth,
            other_arithmetic: line.switch == Switch::Arithmetic,
        };
        report.left_out.iter().zip(worth).map(line).collect()
    }
}

/// A ray, as `rayo step` describes it.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct RayListing {
    /// The command that prints this text.
    pub command: String,
    pub text: String,
}

/// Why there are no results.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The directory has no document that this program writes.
    #[error(
        "{}: no results are here: name a directory that `rayo report`, `experiment`, `accuracy` or `stability` wrote, or one \
         that holds those of several", shown(.0)
    )]
    Nothing(PathBuf),
    #[error("cannot read {}: {error}", shown(path))]
    Io { path: PathBuf, error: io::Error },
    #[error("{} is cut short, or no results: {}", shown(path), brief(&error.to_string()))]
    Json { path: PathBuf, error: serde_json::Error },
    /// A document lacks something that every run writes.
    #[error("{} is not whole: {what}", shown(path))]
    Gap { path: PathBuf, what: String },
    /// A document has another schema.
    #[error(
        "{} has results of schema {found}, and this program reads schema {SCHEMA}: measure anew, or use the program that wrote it",
        shown(path), found = brief(found)
    )]
    Schema { path: PathBuf, found: String },
    /// The documents come from two machines.
    #[error("{}: these results are of another machine than others in the same directory: give each machine a directory", shown(.0))]
    Machines(PathBuf),
}

/// The subdirectories that commands write to by default, and "" for the directory itself.
const PLACES: [&str; 6] = ["", "report", "experiment", "accuracy", "stability", "complexity"];
const FILES: [&str; 2] = ["results.json", "complexity.json"];

/// The largest file that is read, in bytes; the results of a whole report take some 10 MB.
const MOST: u64 = 256 << 20;

impl Results {
    /// Reads the results in a directory: those of a report, or those of single experiments, in it
    /// or in its subdirectories.
    ///
    /// # Errors
    /// If there are none, or if some are incomplete, of another schema, or of different machines.
    pub fn read(directory: &Path) -> Result<Self, ReadError> {
        let mut results: Option<Results> = None;
        for (place, file) in PLACES.iter().flat_map(|place| FILES.map(|file| (place, file))) {
            let path = directory.join(place).join(file);
            let text = match text_within(&path, MOST, "too many for results") {
                Ok(text) => text,
                Err(error) if [io::ErrorKind::NotFound, io::ErrorKind::NotADirectory].contains(&error.kind()) => {
                    continue;
                }
                Err(error) => return Err(ReadError::Io { path, error }),
            };
            let found = Results::of(&text, &path)?;
            results = Some(match results {
                None => found,
                Some(results) if results.machine.cpu() == found.machine.cpu() => results.and(found),
                Some(_) => return Err(ReadError::Machines(path)),
            });
        }
        results.ok_or_else(|| ReadError::Nothing(directory.into()))
    }

    fn of(text: &str, path: &Path) -> Result<Self, ReadError> {
        let no_document = |error| ReadError::Json { path: path.into(), error };
        let document: Value = serde_json::from_str(text).map_err(no_document)?;
        let schema = &document["schema"];
        if schema.as_u64() != Some(SCHEMA) {
            let found = if schema.is_null() { "no number".to_owned() } else { schema.to_string() };
            return Err(ReadError::Schema { path: path.into(), found });
        }
        // A key that only one experiment's document has tells which experiment it is of.
        let parts = [
            ("verdicts", "experiment"),
            ("cells", "stability"),
            ("off_every_front", "accuracy"),
            ("slopes", "complexity"),
        ];
        let part = parts.into_iter().find(|(field, _)| document.get(field).is_some());
        let (machine, quick) = (&document["machine"], document["quick"] == true);
        // The document is embedded as text, so that errors give its line numbers.
        let whole = match part {
            Some((_, part)) => format!(r#"{{"machine": {machine}, "quick": {quick}, "{part}": {text}}}"#),
            None => text.into(),
        };
        let results: Results = serde_json::from_str(&whole).map_err(no_document)?;
        if let Some(what) = results.experiment.as_ref().and_then(Experiment::gap) {
            return Err(ReadError::Gap { path: path.into(), what });
        }
        Ok(results)
    }

    /// Merges two results. If both have a part, it is taken from the first.
    fn and(self, other: Results) -> Results {
        Results {
            machine: self.machine,
            quick: self.quick || other.quick,
            missing: self.missing.into_iter().chain(other.missing).collect(),
            seconds: self.seconds.into_iter().chain(other.seconds).collect(),
            experiment: self.experiment.or(other.experiment),
            ops: self.ops.or(other.ops),
            roofline: self.roofline.or(other.roofline),
            accuracy: self.accuracy.or(other.accuracy),
            stability: self.stability.or(other.stability),
            complexity: self.complexity.or(other.complexity),
            threads: self.threads.or(other.threads),
            plans: self.plans.or(other.plans),
            gallery: self.gallery.or(other.gallery),
            ray: self.ray.or(other.ray),
        }
    }

    /// The names of the parts that were stopped before their end.
    pub fn cut_short(&self) -> Vec<String> {
        let parts = [
            (Stage::Experiment, self.experiment.as_ref().map(|part| part.conditions.complete)),
            (Stage::Accuracy, self.accuracy.as_ref().map(|part| part.complete)),
            (Stage::Stability, self.stability.as_ref().map(|part| part.complete)),
            (Stage::Complexity, self.complexity.as_ref().map(|part| part.complete)),
        ];
        parts.into_iter().filter(|(_, complete)| *complete == Some(false)).map(|(stage, _)| stage.name()).collect()
    }
}
