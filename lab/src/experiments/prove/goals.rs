//! Bounds of rounding errors that need more than counting, as goals for Gappa and Sollya.
//!
//! The goals are files in `proofs`. In place of the constants that it is about a file has names,
//! such as `$error`; the constants of the source are filled in for them, so that proof and code
//! cannot drift apart. Where a goal holds over a set that is no box, it has a case for each of the
//! boxes that cover the set.

use super::rounding::Bound;
use rayo::internals::kernels::harness::set_up::PRODUCT_ROUNDING;
use rayo::internals::plan::{BOX_MARGIN, EDGE_ROUNDINGS, INVERSE_ROUNDINGS, STEEPEST};

/// Into how many parts the boxes that cover a set divide it along each axis.
const PARTS: u32 = 8;

/// The width of the largest picture, and its height.
const LARGEST_SIDE: f64 = 65535.0;

/// Half the width of a tile, in pixels: the largest coordinate from its middle.
const HALF_TILE: f64 = 32.0;

/// A goal of a prover.
pub struct Goal {
    pub bound: Bound,
    /// The value of the bound's unit in the numbers of the file.
    unit: f64,
    /// The file in `proofs`, and its text.
    pub file: &'static str,
    template: &'static str,
    /// For each case what replaces the names in the file other than `$error`.
    cases: Vec<Vec<(&'static str, f64)>>,
}

impl Goal {
    /// The text of every case, which claims an error of at most `needed` in the bound's unit.
    pub fn texts(&self, needed: f64) -> Vec<String> {
        let error = ("$error", needed * self.unit);
        let fill = |case: &Vec<(&str, f64)>| {
            let values = case.iter().chain([&error]);
            values.fold(self.template.to_owned(), |text, (name, value)| text.replace(name, &format!("{value:e}")))
        };
        self.cases.iter().map(fill).collect()
    }
}

/// The upper corners of boxes at the origin that cover the simplex x_i >= 0, sum x_i <= 1. The unit
/// cube is cut into [`PARTS`] parts per axis; these are the boxes that no other box contains.
fn cover<const AXES: usize>() -> Vec<[f64; AXES]> {
    let mut corners = vec![[1; AXES]];
    for axis in 0..AXES {
        let with_length = |corner: &[u32; AXES], length| {
            let mut corner = *corner;
            corner[axis] = length;
            corner
        };
        corners = corners.iter().flat_map(|corner| (1..=PARTS).map(move |n| with_length(corner, n))).collect();
    }
    corners.retain(|corner| corner.iter().map(|n| n - 1).sum::<u32>() == PARTS - 1);
    corners.into_iter().map(|corner| corner.map(|n| f64::from(n) / f64::from(PARTS))).collect()
}

/// The cases of an edge over a tile. Its coefficients satisfy |E0| + 32 |EX| + 32 |EY| <= 2^24 /
/// EDGE_ROUNDINGS, since set-up divides them by EDGE_ROUNDINGS u times this sum, with u = 2^-24.
fn cases_of_edge() -> Vec<Vec<(&'static str, f64)>> {
    let most = f64::from(1 << 24) / EDGE_ROUNDINGS;
    let case = |[first, across, down]: [f64; 3]| {
        vec![("$E0", first * most), ("$EX", across * most / HALF_TILE), ("$EY", down * most / HALF_TILE)]
    };
    cover().into_iter().map(case).collect()
}

/// The cases of 1/t over a tile, where 1/t is from 1 to 2. Its greatest changes across and down
/// have a common limit.
fn cases_of_inverse() -> Vec<Vec<(&'static str, f64)>> {
    let [of_itself, of_across, of_down] = INVERSE_ROUNDINGS;
    let most = STEEPEST - of_itself;
    let case = |[across, down]: [f64; 2]| {
        vec![("$TX", across * most / of_across / HALF_TILE), ("$TY", down * most / of_down / HALF_TILE)]
    };
    cover().into_iter().map(case).collect()
}

/// A goal with a single case and no names but `$error`.
macro_rules! goal {
    ($file:literal, $unit:expr, $bound:expr) => {
        goal!($file, $unit, $bound, vec![vec![]])
    };
    ($file:literal, $unit:expr, $bound:expr, $cases:expr) => {
        Goal {
            bound: $bound,
            unit: $unit,
            file: $file,
            template: include_str!(concat!("../../../../proofs/", $file)),
            cases: $cases,
        }
    };
}

/// Every goal, with the least bound that is proved.
pub fn goals() -> Vec<Goal> {
    let u = f64::from(f32::EPSILON) / 2.0;
    let w = f64::EPSILON / 2.0;
    let by_gappa = |name, source, constant, needed, unit| Bound::new(name, source, constant, needed, unit, "gappa");
    let tiles = "src/plan/tiles.rs";
    let forms = "src/plan/tiles/forms.rs";
    let margin = 2.0 * LARGEST_SIDE * BOX_MARGIN;
    let of_box = by_gappa("box of a triangle", "src/plan/tiles/bounds.rs", margin, 0.0196, "pixels");
    let [needed, constant] = [3.0 * (1.0 + 2.0 * w), PRODUCT_ROUNDING / w];
    let of_product = by_gappa("product of two sides", "src/kernels/portable/set_up.rs", constant, needed, "w");
    let of_edge = by_gappa("divided edge over a tile", tiles, 1.0, 0.66, "1");
    let of_fused_edge = by_gappa("divided edge over a tile, with FMA", tiles, 1.0, 0.46, "1");
    let of_inverse = by_gappa("1/t over a tile", forms, STEEPEST, STEEPEST, "u");
    let of_fused_inverse = by_gappa("1/t over a tile, with FMA", forms, STEEPEST, 14.0, "u");
    let of_root = Bound::new("1 / sqrt a of AVX-512", "asm/include/packet.inc", 1.0, 0.63, "2^-40", "sollya");
    vec![
        goal!("box-of-triangle.g", 1.0, of_box),
        goal!("product-of-sides.g", w, of_product),
        goal!("edge-apart.g", 1.0, of_edge, cases_of_edge()),
        goal!("edge-fused.g", 1.0, of_fused_edge, cases_of_edge()),
        goal!("inverse-apart.g", u, of_inverse, cases_of_inverse()),
        goal!("inverse-fused.g", u, of_fused_inverse, cases_of_inverse()),
        goal!("inverse-root.sollya", 2f64.powi(-40), of_root),
    ]
}
