//! Finds the bounds of all objects in the picture, on several threads, and enters the objects in
//! bins.

use std::cmp::Reverse;

use super::bins::{Bins, WideTiles};
use super::forms::{Form, LONG, near_of_sphere};
use super::place::{Picture, covered, range};
use crate::kernels::{
    Bounded, Bounds, BoundsView, CHUNK, Candidate, CandidatesFound, Extremes, ObjectList, SphereView,
};
use crate::plan::frustum::Frustum;
use crate::plan::omission::{Keep, Omission};
use crate::plan::{Halved, PlanOptions, Team, compact};
use crate::scene::Grid;

/// A thread that plans fewer objects costs more than it gains.
const FEWEST_PER_THREAD: usize = 1 << 14;

/// The number of objects in a piece: so few that their bounds stay in a core's cache until they are
/// binned, and so many that a tile finds several of its objects side by side. With many tiles a
/// piece is larger, since each tile has a list in every piece.
const PIECE: usize = 1 << 15;

/// The most pieces, since a tile has to look into each; there are more only where one would exceed
/// `LARGE_PIECE`.
const MOST_PIECES: usize = 32;
const LARGE_PIECE: usize = 1 << 17;

/// With several threads there are this many pieces for each, unless these would have fewer than
/// `FEWEST_IN_PIECE` objects.
const PIECES_PER_THREAD: usize = 4;
const FEWEST_IN_PIECE: usize = 1 << 13;

/// If there are at most this many objects, all are tested for tiles where they are
/// [steep](super::forms::Forms::steep_tiles), and not only those with long bounds.
const MOST_LOOKED_AT: usize = 1 << 12;

/// Kernels keep the indices of objects in f32, which has every integer up to this.
const MOST_COUNTED: usize = 1 << 24;

/// A triangle's box in the picture is widened by this part of the picture's width and height
/// together, in pixels. The roundings of a projection are less than a sixth of that:
/// `proofs/box-of-triangle.g` (docs/no-hit-is-lost.md).
pub const BOX_MARGIN: f64 = 1.0 / (1 << 20) as f64;

/// The view of the kernel that computes bounds of triangles in a picture.
pub(super) fn bounds_view(grid: &Grid<f64>, scale: f64, picture: Picture) -> BoundsView<f32> {
    let [all_columns, all_rows] = picture.whole();
    let (width, height) = (f64::from(picture.width), f64::from(picture.height));
    let to_pixels = grid.focal / grid.step;
    // If the film is so wide that the focal distance in pixels is denormal, bounds are the whole
    // picture.
    let is_normal = to_pixels >= f32::MIN_POSITIVE.into();
    let margin = if is_normal { (width + height) * BOX_MARGIN } else { f64::INFINITY };
    let view = BoundsView {
        to_pixels,
        column: grid.half_width / grid.step - 0.5,
        row: grid.half_height / grid.step - 0.5,
        low: 1.0 - margin,
        high: 1.0 + margin,
        width,
        height,
        // More than the kernel's own roundings make of it.
        most: scale * grid.focal * (1.0 + 1.0 / f64::from(1 << 20)),
        all_columns: 0.0,
        all_rows: 0.0,
        // Bounds with shorter sides contain at most two columns and two rows. An edge there is the
        // difference of two products, whose factors are below 3 and off by a margin: together by 12
        // margins, and 13 with the products of these errors.
        reach: 2.0 - 4.0 * margin,
        outside: -13.0 * margin,
    };
    BoundsView { all_columns: f32::from_bits(all_columns), all_rows: f32::from_bits(all_rows), ..view.round::<f32>() }
}

/// The view that sets spheres up, with this value of white, and computes their bounds in a picture.
/// Lights are within `far` radii.
pub(super) fn sphere_view(grid: &Grid<f64>, scale: f64, picture: Picture, far: f64, white: f64) -> SphereView<f64> {
    let Grid { step, half_width, half_height, focal } = *grid;
    SphereView {
        step,
        half_width,
        half_height,
        focal,
        scale,
        width: picture.width.into(),
        height: picture.height.into(),
        most: near_of_sphere(scale * focal),
        far,
        white,
    }
}

/// How the objects of a kind are found in the picture, and entered in bins.
pub(super) struct Planning<'a, T: Bounded> {
    pub(super) kernel: &'a Bounds<T>,
    pub(super) view: T::View,
    pub(super) picture: Picture,
    pub(super) widening: &'a Widening,
    /// Why no ray passes within the bounds of an object.
    pub(super) unseen: fn(&Frustum, &T) -> Omission,
    /// For objects with these extremes: one whose upper bound of 1/t is not above the result is
    /// certainly [narrow](Form::Narrow).
    pub(super) surely_narrow: &'a (dyn Fn(&Extremes) -> f32 + Sync),
    /// The form of an object.
    pub(super) form: &'a (dyn Fn(&T, &mut Candidate) -> Form + Sync),
    /// Adds the tiles in which f32 does not hold an object's 1/t; see
    /// [steep](super::forms::Forms::steep_tiles).
    pub(super) steep: &'a (dyn Fn(&T, &Candidate, &mut WideTiles) + Sync),
    /// An object in more tiles than this is large. None: all objects are large, and in all tiles.
    pub(super) most_tiles: Option<usize>,
    /// If a piece has at most so many candidates they are sorted by distance; otherwise they stay
    /// in the scene's order.
    pub(super) most_sorted: usize,
    /// Whether the plan is for kernels in f32, so that it looks for tiles that need f64. If
    /// omissions are kept, wide objects are then in no bin, and the plan for f64 has bins of its
    /// own.
    pub(super) in_f32: bool,
}

impl<T: Bounded + Sync> Planning<'_, T>
where
    T::View: Sync,
{
    /// Enters all `objects` in bins, piece by piece, so that their bounds are still cached when
    /// they are binned. Threads take pieces as they become free, and reuse their lists and memory
    /// from piece to piece; the result does not depend on which thread took which.
    pub(super) fn plan(&self, objects: T::Many<'_>, options: PlanOptions<'_>) -> Planned {
        let bins = || Bins::new(self.picture, self.most_tiles);
        let team = Team::up_to(if objects.len() > FEWEST_PER_THREAD { options.threads } else { 1 });
        let threads = team.threads().min(objects.len().div_ceil(FEWEST_PER_THREAD)).max(1);
        let share = if threads > 1 { objects.len().div_ceil(PIECES_PER_THREAD * threads) } else { usize::MAX };
        let most = objects.len().div_ceil(MOST_PIECES).clamp(PIECE, LARGE_PIECE);
        let piece = share.clamp(FEWEST_IN_PIECE, most).max(bins().tiles()).next_multiple_of(CHUNK);
        let long = if objects.len() <= MOST_LOOKED_AT { 0 } else { LONG };
        let pieces = objects.len().div_ceil(piece);
        let nothing = || Planned { bins: bins(), wide: WideTiles::none_of(self.picture), extremes: None };
        let begin = || {
            let room = vec![Candidate::default(); objects.len().min(piece).next_multiple_of(CHUNK)];
            (nothing(), room)
        };
        let add = |(planned, room): &mut (Planned, Vec<Candidate>), number: usize| {
            if options.is_cancelled() {
                return;
            }
            let start = number * piece;
            let of_piece = objects.part(start..objects.len().min(start + piece));
            let PieceFound { candidates, extremes } = self.find(start as u32, of_piece, long, room, &mut planned.wide);
            // Assumes that the other threads take as many pieces as this one.
            let taken = (1 + planned.bins.pieces()) * piece;
            let left = (objects.len() / threads).saturating_sub(taken) as f64 / of_piece.len() as f64;
            planned.bins.add(number, candidates, left);
            planned.extremes = planned.extremes.into_iter().chain(extremes).reduce(Extremes::and);
        };
        let planned = team.share_with(0..pieces, Halved::whole, begin, add).into_iter().map(|(planned, _)| planned);
        planned.reduce(Planned::and).unwrap_or_else(nothing)
    }

    /// Finds the candidates of a piece, in `room`, and adds to `wide` the tiles in which f64 is
    /// needed.
    fn find<'a>(
        &self,
        first_id: u32,
        objects: T::Many<'_>,
        long: usize,
        room: &'a mut [Candidate],
        wide: &mut WideTiles,
    ) -> PieceFound<'a> {
        let all = self.widening.keep != Keep::NOTHING;
        let first = if first_id as usize + objects.len() <= MOST_COUNTED { first_id } else { 0 };
        let Some(found) = self.kernel.call(&self.view, objects, first, all, room) else {
            return PieceFound { candidates: &[], extremes: None };
        };
        let CandidatesFound { mut count, extremes } = found;
        if first < first_id {
            room[..count].iter_mut().for_each(|candidate| candidate.id += first_id);
        }
        let object_of = |candidate: &Candidate| objects.get((candidate.id - first_id) as usize);
        count = self.sort_out_wide(object_of, &extremes, &mut room[..count], wide);
        let candidates = &mut room[..count];
        if self.in_f32 && extremes.longest >= long as f32 {
            // An object that is kept although it has no pixel has no tile.
            let is_long = |candidate: &&Candidate| {
                let sides = [range(candidate.columns).len(), range(candidate.rows).len()];
                !sides.contains(&0) && sides.iter().any(|side| *side >= long)
            };
            for candidate in candidates.iter().filter(is_long) {
                (self.steep)(&object_of(candidate), candidate, wide);
            }
        }
        if candidates.len() <= self.most_sorted {
            // Not negative, and so ordered by their bits.
            candidates.sort_unstable_by_key(|candidate| Reverse((candidate.most.to_bits(), candidate.id)));
        }
        if all {
            count = self.widen_all(object_of, candidates);
        }
        PieceFound { candidates: &candidates[..count], extremes: Some(extremes) }
    }

    /// Examines the candidates that may need f64, adds the bounds of those that do to `wide`, and
    /// compacts the others, in order, to the front; returns how many these are.
    fn sort_out_wide(
        &self,
        object_of: impl Fn(&Candidate) -> T,
        extremes: &Extremes,
        candidates: &mut [Candidate],
        wide: &mut WideTiles,
    ) -> usize {
        let all = self.widening.keep != Keep::NOTHING;
        let narrow = (self.surely_narrow)(extremes);
        // False for a NaN, which is then examined.
        let is_sure = |near: f32| near <= narrow;
        if is_sure(extremes.nearest) {
            return candidates.len();
        }
        compact(candidates, |candidate| {
            if is_sure(candidate.most) {
                return true;
            }
            let object = object_of(candidate);
            let is_wide = (self.form)(&object, candidate) == Form::Wide && self.in_f32;
            let unseen = || (self.unseen)(&self.widening.frustum, &object);
            // Bounds of an object across the camera's plane are the whole picture, wherever it is.
            if candidate.most >= Candidate::ANY && matches!(unseen(), Omission::Behind | Omission::Outside) {
                (candidate.columns, candidate.rows) = (0, 0);
            }
            let has_pixels = covered(candidate.columns, candidate.rows) > 0;
            if is_wide && has_pixels {
                wide.add_all_of(candidate);
            }
            // Without `keep` wide objects stay in the list: no tile that has one is traced in f32,
            // and so the plan for f64 can share the bins.
            if all { !is_wide } else { has_pixels }
        })
    }

    /// Widens the bounds of candidates as the kept omissions ask for, and compacts those with
    /// pixels, in order, to the front; returns how many these are.
    fn widen_all(&self, object_of: impl Fn(&Candidate) -> T, candidates: &mut [Candidate]) -> usize {
        compact(candidates, |candidate| {
            let Candidate { mut columns, mut rows, .. } = *candidate;
            let unseen = || (self.unseen)(&self.widening.frustum, &object_of(candidate));
            self.widening.widen(&mut columns, &mut rows, unseen);
            (candidate.columns, candidate.rows) = (columns, rows);
            covered(columns, rows) > 0
        })
    }
}

/// What is found of a piece of the objects.
struct PieceFound<'a> {
    candidates: &'a [Candidate],
    /// None without objects.
    extremes: Option<Extremes>,
}

/// The plan of some objects.
pub(super) struct Planned {
    pub(super) bins: Bins,
    /// The tiles that need f64: those of wide objects, and those in which others are steep.
    pub(super) wide: WideTiles,
    /// None if there are no objects.
    pub(super) extremes: Option<Extremes>,
}

impl Planned {
    /// This plan with that of other objects of the same kind.
    fn and(mut self, next: Self) -> Self {
        self.bins = self.bins.and(next.bins);
        self.wide = self.wide.and(next.wide);
        self.extremes = self.extremes.into_iter().chain(next.extremes).reduce(Extremes::and);
        self
    }
}

/// Gives the whole picture to objects that are not to be culled.
pub(super) struct Widening {
    pub(super) keep: Keep,
    pub(super) frustum: Frustum,
    pub(super) whole: [u32; 2],
}

impl Widening {
    /// Gives an object the whole picture for its bounds, if misses are to be tested, or if it has
    /// no pixel for a reason, `unseen`, for which nothing is to be omitted.
    fn widen(&self, columns: &mut u32, rows: &mut u32, unseen: impl Fn() -> Omission) {
        let keep = self.keep;
        if keep.has(Omission::Misses) || keep != Keep::NOTHING && covered(*columns, *rows) == 0 && keep.has(unseen()) {
            [*columns, *rows] = self.whole;
        }
    }
}
