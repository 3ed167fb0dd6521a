//! What a user's function is to compute: its arguments, and what its result has to be.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::bounded::Bounded;
use super::expression::Expression;
use crate::experiments::check::inputs::{Argument, Case, Input, Numbers, cases};
use crate::experiments::check::twins::{Operands, of_macros_on};
use rayo::internals::kernels::{self, ALL_OPERATIONS, OpRef, bytes};
use rayo::internals::reference::aos::{self, Form, Scalar};
use rayo::internals::scene::{Rng, brief};

/// The type of an argument, or of a result: numbers of f32 in a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Type {
    F32,
    Vec4,
    Sphere,
    Triangle,
    Surface,
    Light,
}

impl Type {
    pub const ALL: [Type; 6] = [Type::F32, Type::Vec4, Type::Sphere, Type::Triangle, Type::Surface, Type::Light];

    pub fn name(self) -> &'static str {
        match self {
            Type::F32 => "f32",
            Type::Vec4 => "vec4",
            Type::Sphere => "sphere",
            Type::Triangle => "triangle",
            Type::Surface => "surface",
            Type::Light => "light",
        }
    }

    /// How many numbers it has, padding included.
    pub fn numbers(self) -> usize {
        match self {
            Type::F32 => 1,
            Type::Vec4 => 4,
            Type::Sphere | Type::Surface => 12,
            Type::Triangle => 16,
            Type::Light => 8,
        }
    }

    pub fn bytes(self) -> usize {
        self.numbers() * size_of::<f32>()
    }

    pub fn align(self) -> usize {
        if self == Type::F32 { size_of::<f32>() } else { 16 }
    }

    /// Its fields: the name of each, the number that it begins with, and its type.
    pub fn fields(self) -> &'static [(&'static str, usize, Type)] {
        match self {
            Type::F32 => &[],
            Type::Vec4 => &[("x", 0, Type::F32), ("y", 1, Type::F32), ("z", 2, Type::F32), ("w", 3, Type::F32)],
            Type::Sphere => &[("centre", 0, Type::Vec4), ("colour", 4, Type::Vec4), ("radius", 8, Type::F32)],
            Type::Triangle => {
                &[("v1", 0, Type::Vec4), ("v2", 4, Type::Vec4), ("v3", 8, Type::Vec4), ("colour", 12, Type::Vec4)]
            }
            Type::Surface => &[("point", 0, Type::Vec4), ("normal", 4, Type::Vec4), ("colour", 8, Type::Vec4)],
            Type::Light => &[("position", 0, Type::Vec4), ("radiance", 4, Type::Vec4)],
        }
    }

    /// The numbers that are a fourth lane.
    pub fn fourth_lanes(self) -> Vec<usize> {
        match self {
            Type::F32 => Vec::new(),
            Type::Vec4 => vec![3],
            _ => {
                let vectors = self.fields().iter().filter(|(.., kind)| *kind == Type::Vec4);
                vectors.map(|(_, first, _)| first + 3).collect()
            }
        }
    }
}

impl FromStr for Type {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Type::ALL
            .into_iter()
            .find(|kind| kind.name() == text.trim())
            .ok_or_else(|| format!("expected one of {}, found `{}`", Type::ALL.map(Type::name).join(", "), brief(text)))
    }
}

impl fmt::Display for Type {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The name of Algorithm 1 among the operations.
pub const TRACE: &str = "trace";

/// What the results have to be.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub enum Truth {
    /// An operation of `rayo ops`, by its name.
    Operation(String),
    /// A formula of the user's.
    Formula(Expression),
}

/// What a function is to compute.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Wanted {
    pub truth: Truth,
    /// One argument or two.
    pub takes: Vec<Type>,
    pub gives: Type,
}

/// The numbers of the arguments.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    pub arguments: Vec<Vec<f32>>,
}

/// An input, and what kind of numbers it is made of.
#[derive(Clone, Debug)]
pub struct Trial {
    pub sample: Sample,
    /// Whether infinities, NaN, denormal numbers or extreme exponents are among them.
    pub is_odd: bool,
    /// Whether a fourth lane is not 0.
    pub has_w: bool,
}

impl Wanted {
    /// The operation of that name; None if there is none.
    pub fn operation(name: &str) -> Option<Self> {
        let known = ALL_OPERATIONS.into_iter().find(|known| *known == name)?;
        let two = |b| vec![Type::Vec4, b];
        let (takes, gives) = match known {
            "add" | "sub" | "cross" => (two(Type::Vec4), Type::Vec4),
            "scale" => (two(Type::F32), Type::Vec4),
            "dot" => (two(Type::Vec4), Type::F32),
            "norm" => (vec![Type::Vec4], Type::F32),
            "normalise" => (vec![Type::Vec4], Type::Vec4),
            "sphere" => (two(Type::Sphere), Type::F32),
            "triangle" => (two(Type::Triangle), Type::F32),
            "lambert" | "lambert2" => (vec![Type::Surface, Type::Light], Type::Vec4),
            _ => return None,
        };
        Some(Wanted { truth: Truth::Operation(known.into()), takes, gives })
    }

    /// The whole of Algorithm 1, which takes scenes in place of these types.
    pub fn tracer() -> Self {
        Wanted { truth: Truth::Operation(TRACE.into()), takes: Vec::new(), gives: Type::Vec4 }
    }

    pub fn is_tracer(&self) -> bool {
        self.name() == TRACE
    }

    /// Its name: of the operation, or the formula itself.
    pub fn name(&self) -> &str {
        match &self.truth {
            Truth::Operation(name) => name,
            Truth::Formula(formula) => formula.text(),
        }
    }

    /// The same operation of our own tables, in C or in assembly: whichever this build has.
    pub fn ours(&self) -> Option<OpRef> {
        let Truth::Operation(name) = &self.truth else { return None };
        let tables = [kernels::paper(), kernels::c()].into_iter().flatten();
        tables.flat_map(|table| table.ops()).find(|(known, _)| known == name).map(|(_, op)| op)
    }

    /// The results by the forms of our twins, or by the formula as it is written: each with its
    /// name, the first of them the one that is expected.
    pub fn expected(&self, sample: &Sample) -> Vec<(&'static str, Vec<f32>)> {
        match &self.truth {
            Truth::Operation(name) => [("paper", Form::Paper), ("aos", Form::Best)]
                .map(|(form_name, form)| (form_name, self.by_twin(form, name, &sample.arguments)))
                .into(),
            Truth::Formula(formula) => vec![("the formula as it is written", formula.evaluate(&sample.arguments))],
        }
    }

    /// The exact results, with the bounds of any order of the operations.
    pub fn bounded(&self, sample: &Sample) -> Vec<Bounded> {
        let bounded = |numbers: &Vec<f32>| numbers.iter().map(|number| Bounded::from(*number)).collect();
        let arguments: Vec<Vec<Bounded>> = sample.arguments.iter().map(bounded).collect();
        match &self.truth {
            Truth::Operation(name) => self.by_twin(Form::Paper, name, &arguments),
            Truth::Formula(formula) => formula.evaluate(&arguments),
        }
    }

    fn by_twin<S: Scalar>(&self, form: Form, name: &str, arguments: &[Vec<S>]) -> Vec<S> {
        of_macros_on(form, name, &operands(&self.takes, arguments))[..self.gives.numbers()].to_vec()
    }

    /// Inputs of every kind, some `count` of them, those with small integers first.
    pub fn trials(&self, count: u32, seed: u64) -> Vec<Trial> {
        match self.ours() {
            Some(op) => cases(op, count.div_ceil(18), seed).map(|case| self.trial_of(&case)).collect(),
            None => self.random_trials(count, seed),
        }
    }

    fn trial_of(&self, case: &Case) -> Trial {
        let mut arguments = numbers_of(&case.input);
        arguments.truncate(self.takes.len());
        self.trial(Sample { arguments }, case.numbers.unwrap_or(Numbers::Ordinary))
    }

    fn trial(&self, sample: Sample, numbers: Numbers) -> Trial {
        let has_w = sample
            .arguments
            .iter()
            .zip(&self.takes)
            .any(|(argument, kind)| kind.fourth_lanes().into_iter().any(|lane| argument[lane].to_bits() != 0));
        let is_odd = !matches!(numbers, Numbers::Ordinary | Numbers::Integers | Numbers::Magnitudes);
        Trial { sample, is_odd, has_w }
    }

    fn random_trials(&self, count: u32, seed: u64) -> Vec<Trial> {
        let mut rng = Rng::new(seed);
        let sources = Numbers::ALL.into_iter().flat_map(|numbers| [(numbers, false), (numbers, true)]);
        let each = count.div_ceil(2 * Numbers::ALL.len() as u32);
        let mut trials = Vec::new();
        for (numbers, any_w) in sources.flat_map(|source| (0..each).map(move |_| source)) {
            let arguments = self.takes.iter().map(|kind| random(*kind, numbers, any_w, &mut rng)).collect();
            trials.push(self.trial(Sample { arguments }, numbers));
        }
        trials
    }

    /// The arguments by name, as far as they matter.
    pub fn arguments(&self, sample: &Sample) -> Vec<Argument> {
        let mut told = Vec::new();
        for (index, (kind, numbers)) in self.takes.iter().zip(&sample.arguments).enumerate() {
            match kind {
                Type::F32 | Type::Vec4 => told.push(Argument::new(["a", "b"][index], numbers)),
                _ => told.extend(
                    kind.fields()
                        .iter()
                        .filter(|(name, ..)| *name != "padding")
                        .map(|(name, first, field)| Argument::new(name, &numbers[*first..first + field.numbers()])),
                ),
            }
        }
        told
    }
}

fn random(kind: Type, numbers: Numbers, any_w: bool, rng: &mut Rng) -> Vec<f32> {
    let mut values: Vec<_> = (0..kind.numbers()).map(|_| numbers.next(rng)).collect();
    if !any_w {
        kind.fourth_lanes().into_iter().for_each(|lane| values[lane] = 0.0);
    }
    values
}

/// The numbers of an operation's arguments as they lie in memory.
fn numbers_of(input: &Input) -> Vec<Vec<f32>> {
    fn numbers<T: kernels::Plain>(value: T) -> Vec<f32> {
        let values = [value];
        let words = bytes(&values).chunks_exact(4).map(|word| word.try_into().expect("a chunk of four"));
        words.map(f32::from_ne_bytes).collect()
    }
    match *input {
        Input::Vectors(a, b) => vec![numbers(a), numbers(b)],
        Input::Scale(a, b) => vec![numbers(a), numbers(b)],
        Input::Sphere(a, b) => vec![numbers(a), numbers(b)],
        Input::Triangle(a, b) => vec![numbers(a), numbers(b)],
        Input::Lambert(a, b) => vec![numbers(a), numbers(b)],
    }
}

/// The operands of a twin, of the numbers of its arguments.
fn operands<S: Scalar>(takes: &[Type], arguments: &[Vec<S>]) -> Operands<S> {
    let lanes = |argument: usize, first: usize| -> aos::Lanes<S> {
        arguments[argument][first..first + 4].try_into().expect("four numbers")
    };
    match takes {
        [Type::Vec4] => Operands::Vectors(lanes(0, 0), [S::from(0.0); 4]),
        [Type::Vec4, Type::F32] => Operands::Scale(lanes(0, 0), arguments[1][0]),
        [Type::Vec4, Type::Sphere] => Operands::Sphere(
            lanes(0, 0),
            aos::Sphere { centre: lanes(1, 0), colour: lanes(1, 4), radius: arguments[1][8] },
        ),
        [Type::Vec4, Type::Triangle] => {
            let vertices = [0, 4, 8].map(|first| lanes(1, first));
            Operands::Triangle(lanes(0, 0), aos::Triangle { vertices, colour: lanes(1, 12) })
        }
        [Type::Surface, Type::Light] => Operands::Lambert(
            aos::Surface { point: lanes(0, 0), normal: lanes(0, 4), colour: lanes(0, 8) },
            aos::Light { position: lanes(1, 0), radiance: lanes(1, 4) },
        ),
        _ => Operands::Vectors(lanes(0, 0), lanes(1, 0)),
    }
}
