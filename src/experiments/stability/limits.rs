//! The limits that are checked in, engine by engine and family by family, and what it means to keep them.

use std::fmt::Write;

use super::Row;

/// `limits.csv`: what every engine may do on every family. `c` and `paper` are in it too: their limits say where the
/// paper's formulas stop.
const CHECKED_IN: &str = include_str!("limits.csv");
/// The columns of `limits.csv`.
pub const HEADER: &str = "family,engine,precision,max_ulp,max_bound_share,max_wrong_share,max_off_by_2_share";
/// A limit is so many times what was measured, since another seed may be a little worse.
const ROOM: f64 = 1.5;
/// A limit so many times what was measured could be tightened.
const LOOSE: f64 = 4.0;
/// No ulp or share of a bound below this is worth a tighter limit.
const SMALL: f64 = 0.1;

/// What one engine may do on one family.
#[derive(Clone, Debug, PartialEq)]
pub struct Limit {
    family: String,
    engine: String,
    precision: String,
    /// Of t; infinite where no bound can be given.
    max_ulp: f64,
    max_bound_share: f64,
    /// Of the worst level's rays.
    max_wrong_share: f64,
    max_off_by_2_share: f64,
}

/// All limits.
#[derive(Clone, Debug, PartialEq)]
pub struct Limits(Vec<Limit>);

impl Limits {
    /// Those that are checked in.
    ///
    /// # Panics
    /// Where the file is not as [`Limits::parse`] needs it, which a test would have found.
    pub fn checked_in() -> Self {
        Self::parse(CHECKED_IN).unwrap_or_else(|error| panic!("limits.csv: {error}"))
    }

    /// Reads a table with the columns of [`HEADER`].
    ///
    /// # Errors
    /// Says which line is wrong.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut lines = text.lines();
        if lines.next() != Some(HEADER) {
            return Err(format!("the first line must be {HEADER}"));
        }
        let limits = lines.enumerate().map(|(i, line)| {
            let wrong = || format!("line {}: `{line}` has not the columns {HEADER}", i + 2);
            let [family, engine, precision, numbers @ ..] = &line.split(',').collect::<Vec<_>>()[..] else {
                return Err(wrong());
            };
            let numbers = numbers.iter().map(|number| number.parse::<f64>()).collect::<Result<Vec<_>, _>>();
            let numbers = numbers.map_err(|_| wrong())?;
            let [max_ulp, max_bound_share, max_wrong_share, max_off_by_2_share] = numbers[..] else {
                return Err(wrong());
            };
            let [family, engine, precision] = [family, engine, precision].map(|name| (*name).to_owned());
            let limit =
                Limit { family, engine, precision, max_ulp, max_bound_share, max_wrong_share, max_off_by_2_share };
            Ok(limit)
        });
        limits.collect::<Result<Vec<_>, _>>().map(Limits)
    }

    fn of(&self, row: &Row) -> Option<&Limit> {
        self.0
            .iter()
            .find(|limit| limit.family == row.family && limit.engine == row.engine && limit.precision == row.precision)
    }

    /// The limits that a row does not keep, in words.
    pub fn broken(&self, row: &Row) -> Vec<String> {
        let Some(limit) = self.of(row) else { return vec!["there is no limit in limits.csv".into()] };
        let checks = [
            ("the error of t in ulp", row.worst.unwrap_or(0.0), limit.max_ulp),
            ("the error of t over its bound", row.bound.unwrap_or(0.0), limit.max_bound_share),
            ("the share of wrong hits", row.wrong_share, limit.max_wrong_share),
            ("the share of pixels off by two levels", row.off_by_2_share, limit.max_off_by_2_share),
        ];
        let above = checks.into_iter().filter(|(_, found, limit)| found > limit || found.is_nan());
        above.map(|(what, found, limit)| format!("{what} is {found:.3}, above {limit}")).collect()
    }

    /// The limits of a row that could be tightened, in words.
    pub fn tighter(&self, row: &Row) -> Option<String> {
        let limit = self.of(row)?;
        let checks = [
            ("max_ulp", row.worst.unwrap_or(0.0), limit.max_ulp),
            ("max_bound_share", row.bound.unwrap_or(0.0), limit.max_bound_share),
            ("max_wrong_share", row.wrong_share, limit.max_wrong_share),
            ("max_off_by_2_share", row.off_by_2_share, limit.max_off_by_2_share),
        ];
        let loose = |(name, found, limit): &(&str, f64, f64)| {
            *limit > LOOSE * found && (*limit > SMALL || name.ends_with("_share") && *found == 0.0 && *limit > 1e-4)
        };
        let loose = checks.iter().filter(|check| loose(check));
        let loose: Vec<_> = loose.map(|(name, found, limit)| format!("{name} {limit} ({found:.3} found)")).collect();
        let Row { family, engine, precision, .. } = row;
        (!loose.is_empty()).then(|| format!("{family} {engine} {precision}: {}", loose.join(", ")))
    }
}

/// The table of limits that these rows would just keep, with some room.
pub fn table(rows: &[Row]) -> String {
    let mut text = format!("{HEADER}\n");
    for row in rows {
        let Row { family, engine, precision, .. } = row;
        let numbers = [row.worst.unwrap_or(0.0), row.bound.unwrap_or(0.0), row.wrong_share, row.off_by_2_share];
        let numbers = numbers.map(|number| two_digits(ROOM * number));
        writeln!(text, "{family},{engine},{precision},{}", numbers.join(",")).expect("a string takes any text");
    }
    text
}

/// Two digits, rounded up.
fn two_digits(x: f64) -> String {
    if x == 0.0 || !x.is_finite() {
        return x.to_string();
    }
    let unit = 10f64.powi(x.log10().floor() as i32 - 1);
    let rounded: f64 = format!("{:e}", (x / unit).ceil() * unit).parse().unwrap_or(x);
    // What binary digits left behind.
    format!("{rounded:.1e}").parse::<f64>().map_or_else(|_| rounded.to_string(), |rounded| rounded.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::families::FAMILIES;

    fn row(worst: f64, wrong_share: f64) -> Row {
        Row {
            family: "S1",
            engine: "avx2",
            precision: "single",
            worst: Some(worst),
            bound: Some(0.5),
            wrong_hits: 0,
            wrong_share,
            holes: 0,
            off_by_1: 0,
            off_by_2: 0,
            off_by_2_share: 0.0,
            breaks_at: None,
            slowdown: None,
            holds: true,
            broken: Vec::new(),
            worst_case: 7,
        }
    }

    fn limits() -> Limits {
        Limits::parse(&format!("{HEADER}\nS1,avx2,single,8,1,0,0\n")).unwrap()
    }

    #[test]
    fn a_row_within_its_limits_holds_and_one_beyond_says_which_it_breaks() {
        assert!(limits().broken(&row(8.0, 0.0)).is_empty());
        assert_eq!(limits().broken(&row(8.5, 0.25)).len(), 2);
        assert!(limits().broken(&row(9.0, 0.0))[0].contains("9.000, above 8"));
        assert_eq!(limits().broken(&row(f64::NAN, 0.0)).len(), 1, "what is no number keeps no limit");
        assert_eq!(limits().broken(&Row { engine: "sse41", ..row(1.0, 0.0) }).len(), 1);
    }

    #[test]
    fn a_limit_far_from_what_is_found_could_be_tightened() {
        assert_eq!(limits().tighter(&row(7.0, 0.0)), None);
        assert!(limits().tighter(&row(1.0, 0.0)).unwrap().contains("max_ulp 8 (1.000 found)"));
    }

    #[test]
    fn the_table_of_some_rows_is_kept_by_them() {
        for worst in [0.0, 1.0, 3.3, 1234.5, 1e-7] {
            let row = Row { off_by_2_share: 0.0123, ..row(worst, worst / 2000.0) };
            let limits = Limits::parse(&table(std::slice::from_ref(&row))).unwrap();
            assert!(limits.broken(&row).is_empty(), "{limits:?}");
        }
        assert_eq!(two_digits(1.2301), "1.3");
    }

    #[test]
    fn a_wrong_line_is_named() {
        assert!(Limits::parse("no").is_err());
        assert!(Limits::parse(&format!("{HEADER}\nS1,avx2,single,8,1,0")).unwrap_err().contains("line 2"));
    }

    #[test]
    fn every_engine_has_limits_on_every_family_and_the_packets_no_room_for_wrong_hits() {
        let limits = Limits::checked_in();
        for family in FAMILIES {
            let packets = ["sse41", "avx2", "avx512"].into_iter();
            let packets = packets.flat_map(|engine| ["single", "fast", "double"].map(|precision| (engine, precision)));
            let scalar = [("reference", "double"), ("rust", "single"), ("c", "single"), ("paper", "single")];
            for (engine, precision) in packets.chain(scalar) {
                let row = Row { family: family.id, engine, precision, ..row(0.0, 0.0) };
                let limit = limits.of(&row).unwrap_or_else(|| panic!("{} {engine} {precision}", family.id));
                if !["rust", "c", "paper"].contains(&engine) {
                    assert_eq!((limit.max_wrong_share, limit.max_off_by_2_share), (0.0, 0.0), "{limit:?}");
                }
            }
        }
    }
}
