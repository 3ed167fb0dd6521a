//! The checked-in limits of every engine on every family, and how results are compared with them.

use std::fmt::Write;

use serde::{Deserialize, Serialize};

use super::{Stability, WorstFigure};

/// The limits of every engine on every family. `c` and `paper` have limits too, which show how far
/// the paper's formulas hold. Engines with the same limits share a line.
const CHECKED_IN: &str = include_str!("limits.csv");

#[derive(Clone, Copy, Debug)]
pub struct Measure {
    /// The measure's column in `limits.csv`.
    column: &'static str,
    words: &'static str,
    /// A limit below this value need not be tightened.
    small: f64,
    /// The least limit for a figure that is not 0: it allows one pixel of a small picture, or the
    /// rounding of f64.
    least: f64,
    /// A bound that the documentation promises. A proposed limit does not exceed it, unless the
    /// measured figure does.
    promised: f64,
}

/// The measures, in the order of [`MeasureValues`] and of the columns: errors at the worst level, then
/// shares of that level's rays.
pub const MEASURES: [Measure; 7] = [
    Measure { column: "max_ulp", words: "the error of t in ulp", small: 0.1, least: 0.0, promised: f64::INFINITY },
    Measure {
        column: "max_bound_share",
        words: "the error of t over its bound",
        small: 0.1,
        least: 0.0,
        promised: 1.0,
    },
    Measure { column: "max_angle", words: "the angle of a normal", small: 1e-6, least: 1e-15, promised: f64::INFINITY },
    Measure { column: "max_wrong_share", words: "the share of wrong hits", small: FEW, least: FEW, promised: 1.0 },
    Measure { column: "max_hole_share", words: "the share of holes", small: FEW, least: FEW, promised: 1.0 },
    Measure {
        column: "max_off_by_1_share",
        words: "the share of pixels off by a level, which estimates do not explain,",
        small: MANY,
        least: MANY,
        promised: 1.0,
    },
    Measure {
        column: "max_off_by_2_share",
        words: "the share of pixels off by two levels",
        small: FEW,
        least: FEW,
        promised: 1.0,
    },
];
const FEW: f64 = 1e-3;
/// The share of the rays that may be off by one level. f32 rounds to another level where the true
/// value is close to the border between two. Larger errors, of estimated roots, differ between CPUs
/// and are not counted here:
/// [`Contender::levels_by_estimates`](super::super::accuracy::Contender::levels_by_estimates)
/// bounds them on every CPU.
const MANY: f64 = 0.1;
/// A number for each of [`MEASURES`].
pub type MeasureValues = [f64; MEASURES.len()];

/// A proposed limit is the measured figure times this factor, since another seed may be a little
/// worse.
const ROOM: f64 = 1.5;
/// A limit above the measured figure times this factor could be tightened.
const LOOSE: f64 = 4.0;

/// The limits of some engines on one family.
#[derive(Clone, Debug, PartialEq)]
struct Limit {
    family: String,
    /// The names of the engines, separated by spaces.
    engines: String,
    precision: String,
    most: MeasureValues,
}

/// All limits.
#[derive(Clone, Debug, PartialEq)]
pub struct Limits(Vec<Limit>);

/// A limit that a result exceeds.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub struct Broken {
    /// The measured figure and the limit, in words.
    pub why: String,
    /// The case that is the worst by this measure.
    pub case: usize,
}

/// The header line of a file of limits.
pub fn header() -> String {
    ["family", "engine", "precision"].into_iter().chain(MEASURES.iter().map(|m| m.column)).collect::<Vec<_>>().join(",")
}

impl Limits {
    /// The checked-in limits.
    ///
    /// # Panics
    /// If [`Limits::parse`] refuses the file, which a test would have found.
    pub fn checked_in() -> Self {
        Self::parse(CHECKED_IN).unwrap_or_else(|error| panic!("limits.csv: {error}"))
    }

    /// Reads a table with the columns of [`header`].
    ///
    /// # Errors
    /// If a line is wrong; the message names it.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (header, mut lines) = (header(), text.lines());
        if lines.next() != Some(&header) {
            return Err(format!("the first line must be {header}"));
        }
        let limits = lines.enumerate().map(|(i, line)| {
            let wrong = || format!("line {}: `{line}` does not have the columns {header}", i + 2);
            let [family, engine, precision, numbers @ ..] = &line.split(',').collect::<Vec<_>>()[..] else {
                return Err(wrong());
            };
            let numbers = numbers.iter().map(|number| number.parse::<f64>()).collect::<Result<Vec<_>, _>>();
            let most = numbers.ok().and_then(|numbers| MeasureValues::try_from(numbers).ok()).ok_or_else(wrong)?;
            let [family, engines, precision] = [family, engine, precision].map(|name| (*name).to_owned());
            Ok(Limit { family, engines, precision, most })
        });
        limits.collect::<Result<Vec<_>, _>>().map(Limits)
    }

    /// The limit that applies to a row. The packets in Rust have those of the kernels without FMA,
    /// whose twins they are.
    fn of(&self, row: &Stability) -> Option<&Limit> {
        let engine = if row.engine == "portable" { "sse41" } else { &row.engine };
        let is_of = |limit: &&Limit| {
            (&*limit.family, &*limit.precision) == (&row.family, &row.precision)
                && limit.engines.split(' ').any(|name| name == engine)
        };
        self.0.iter().find(is_of)
    }

    /// The limits that a row exceeds.
    pub fn broken(&self, row: &Stability) -> Vec<Broken> {
        let Some(limit) = self.of(row) else {
            return vec![Broken { why: "there is no limit for it".into(), case: row.worst_case }];
        };
        let checks = MEASURES.iter().zip(row.worst_by).zip(limit.most);
        let above = checks.filter(|((_, worst), most)| worst.figure > *most || worst.figure.is_nan());
        let why = |((measure, worst), most): ((&Measure, WorstFigure), f64)| {
            let WorstFigure { figure, case, of_case } = worst;
            // The figure that `replay`'s command will show, which runs this case alone.
            let [found, alone] = [figure, of_case].map(two_digits);
            let alone = if alone == found { String::new() } else { format!(" ({alone} of case {case} alone)") };
            Broken { why: format!("{} is {found}{alone}, above {most}", measure.words), case }
        };
        above.map(why).collect()
    }

    /// Which limits of a row could be tightened, in words.
    pub fn tighter(&self, row: &Stability) -> Option<String> {
        let limit = self.of(row)?;
        let checks = MEASURES.iter().zip(row.worst_by).zip(limit.most);
        let loose = checks.filter(|((measure, worst), most)| *most > measure.small && *most > LOOSE * worst.figure);
        let loose: Vec<_> = loose
            .map(|((measure, worst), most)| format!("{} {most} ({} found)", measure.column, two_digits(worst.figure)))
            .collect();
        let Stability { family, engine, precision, .. } = row;
        (!loose.is_empty()).then(|| format!("{family} {engine} {precision}: {}", loose.join(", ")))
    }
}

/// A table of limits that these rows keep with some room, to be checked in.
pub fn table(rows: &[Stability]) -> String {
    let mut text = header() + "\n";
    for row in rows {
        let Stability { family, engine, precision, .. } = row;
        let limit = |(measure, worst): (&Measure, WorstFigure)| {
            let (Measure { least, promised, .. }, found) = (*measure, worst.figure);
            let room = if found > 0.0 { (ROOM * found).max(least) } else { 0.0 };
            two_digits(if found <= promised { room.min(promised) } else { room })
        };
        let numbers: Vec<_> = MEASURES.iter().zip(row.worst_by).map(limit).collect();
        writeln!(text, "{family},{engine},{precision},{}", numbers.join(",")).expect("a string takes any text");
    }
    text
}

/// A number in decimal with two significant digits, rounded up.
fn two_digits(x: f64) -> String {
    if x == 0.0 || !x.is_finite() {
        return x.to_string();
    }
    let unit = 10f64.powi(x.log10().floor() as i32 - 1);
    // A number that has two digits, up to binary rounding, is not rounded up to the next one.
    let [up, near] = [(x / unit).ceil() * unit, x].map(|x| format!("{x:.1e}").parse::<f64>().unwrap_or(x));
    let rounded = if near >= x { near } else { up };
    if (1e-4..1e7).contains(&rounded) { rounded.to_string() } else { format!("{rounded:e}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiments::stability::replay;
    use crate::families::FAMILIES;

    /// The index of wrong hits in [`MEASURES`].
    const WRONG: usize = 3;

    /// A row whose largest error of t is `worst`, in case 7, and whose share of wrong hits is
    /// `wrong_share`, worst in case 5.
    fn row(worst: f64, wrong_share: f64) -> Stability {
        let of_case = |figure, case| WorstFigure { figure, case, of_case: figure };
        let mut worst_by = [of_case(0.0, 3); MEASURES.len()];
        worst_by[..2].copy_from_slice(&[of_case(worst, 7), of_case(0.5, 7)]);
        // One of three cases has all of the wrong hits.
        worst_by[WRONG] = WorstFigure { of_case: 3.0 * wrong_share, ..of_case(wrong_share, 5) };
        Stability {
            family: "S1".into(),
            engine: "avx2".into(),
            precision: "single".into(),
            worst: Some(worst),
            bound: Some(0.5),
            worst_case: 7,
            worst_by,
            ..Stability::default()
        }
    }

    fn limits() -> Limits {
        Limits::parse(&format!("{}\nS1,avx2,single,8,1,0,0,0,0,0\n", header())).unwrap()
    }

    #[test]
    fn row_beyond_its_limits_names_the_limit_and_the_case() {
        assert!(limits().broken(&row(8.0, 0.0)).is_empty());
        let broken = limits().broken(&row(8.5, 0.25));
        assert_eq!(broken.iter().map(|broken| broken.case).collect::<Vec<_>>(), [7, 5]);
        assert_eq!(broken[0].why, "the error of t in ulp is 8.5, above 8");
        assert_eq!(broken[1].why, "the share of wrong hits is 0.25 (0.75 of case 5 alone), above 0");
        assert_eq!(limits().broken(&row(f64::NAN, 0.0)).len(), 1, "what is no number keeps no limit");
        assert_eq!(limits().broken(&Stability { engine: "sse41".into(), ..row(1.0, 0.0) }).len(), 1);
        let row = row(8.5, 0.25);
        let replay = replay(&row.family, &row.engine, 5, 3, true);
        assert_eq!(replay, "rayo stability --family S1 --engine avx2 --seed 3 --case 5 --quick");
    }

    #[test]
    fn a_limit_far_from_what_is_found_could_be_tightened() {
        assert_eq!(limits().tighter(&row(7.0, 0.0)), None);
        assert!(limits().tighter(&row(1.0, 0.0)).unwrap().contains("max_ulp 8 (1 found)"));
        let loose = Limits::parse(&format!("{}\nS1,avx2,single,8,1,1e-7,0.5,0,0,0.0005\n", header())).unwrap();
        assert_eq!(loose.tighter(&row(7.0, 0.1)).unwrap(), "S1 avx2 single: max_wrong_share 0.5 (0.1 found)");
    }

    #[test]
    fn table_of_rows_has_no_room_beyond_the_promised() {
        for worst in [0.0, 1.0, 3.3, 1234.5, 1e-7] {
            let row = row(worst, worst / 2000.0);
            let limits = Limits::parse(&table(std::slice::from_ref(&row))).unwrap();
            assert!(limits.broken(&row).is_empty(), "{limits:?}");
        }
        for (found, limit) in [(0.5, 0.75), (0.9, 1.0), (2.0, 3.0)] {
            let mut row = row(1.0, 1e-6);
            row.worst_by[1].figure = found;
            let limits = Limits::parse(&table(&[row])).unwrap();
            assert_eq!((limits.0[0].most[1], limits.0[0].most[WRONG]), (limit, FEW));
        }
        let digits = [1.2301, 0.77, 8.5, 1.0, 2.4e-8, 6.5e14, 0.0].map(two_digits);
        assert_eq!(digits, ["1.3", "0.77", "8.5", "1", "2.4e-8", "6.5e14", "0"]);
    }

    #[test]
    fn a_wrong_line_is_named() {
        assert!(Limits::parse("no").is_err());
        for numbers in ["8,1,0", "8,1,0,0,0,0,x", "8,1,0,0,0,0,0,0"] {
            assert!(Limits::parse(&format!("{}\nS1,avx2,single,{numbers}", header())).unwrap_err().contains("line 2"));
        }
    }

    #[test]
    fn engines_have_limits_and_robust_ones_none_to_spare() {
        let limits = Limits::checked_in();
        for family in FAMILIES {
            let packets = ["sse41", "avx2", "avx512"].into_iter();
            let packets = packets.flat_map(|engine| ["single", "fast", "double"].map(|precision| (engine, precision)));
            let scalar = [("reference", "double"), ("rust", "single"), ("c", "single"), ("paper", "single")];
            let has_shadows = |engine: &str| engine.parse().is_ok_and(rayo::internals::render::Engine::has_shadows);
            for (engine, precision) in packets.chain(scalar).filter(|of| has_shadows(of.0) || !family.has_shadows()) {
                let row = Stability {
                    family: family.id.into(),
                    engine: engine.into(),
                    precision: precision.into(),
                    ..row(0.0, 0.0)
                };
                let limit = limits.of(&row).unwrap_or_else(|| panic!("{} {engine} {precision}", family.id));
                let [_, bound, angle, wrong, holes, off_by_1, off_by_2] = limit.most;
                if ["rust", "c", "paper"].contains(&engine) {
                    continue;
                }
                assert_eq!((wrong, holes, off_by_2), (0.0, 0.0, 0.0), "{limit:?}");
                assert!(bound <= 1.0, "{limit:?}");
                assert!(family.id != "S1" || angle <= 1e-5, "{limit:?}");
                // The reference writes only floats, and rounding these to f32 can cost a level.
                assert!(precision != "double" || engine == "reference" || off_by_1 == 0.0, "{limit:?}");
            }
        }
    }
}
