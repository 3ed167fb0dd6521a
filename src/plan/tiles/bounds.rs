//! Finds the bounds of all objects in the picture, with several threads, and enters the objects in
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

/// The number of objects per thread below which another thread costs more than it gains.
const FEWEST_PER_THREAD: usize = 1 << 14;

/// The number of objects in a piece: few enough for their bounds to stay in a core's cache until
/// they are entered in bins, and enough for a tile to have several objects of a piece side by side.
/// With many tiles a piece is larger, since each tile has a list in every piece.
const PIECE: usize = 1 << 15;

/// The number of pieces, since a tile has to look into each. There are only more if a piece would
/// otherwise exceed `LARGE_PIECE`.
const MOST_PIECES: usize = 32;
const LARGE_PIECE: usize = 1 << 17;

/// With several threads there are this many pieces for each thread, unless a piece would have fewer
/// than `FEWEST_IN_PIECE` objects.
const PIECES_PER_THREAD: usize = 4;
const FEWEST_IN_PIECE: usize = 1 << 13;

/// If there are at most this many objects, all are tested for tiles in which they are
/// [steep](super::forms::Forms::steep_tiles), and not only those with long bounds.
const MOST_LOOKED_AT: usize = 1 << 12;

/// Kernels hold the indices of objects in f32, which has every integer up to this.
const MOST_COUNTED: usize = 1 << 24;

/// A triangle's box in the picture is widened by this share of the sum of the picture's width and
/// height, in pixels. The rounding errors of a projection are less than a sixth of that, as
/// `proofs/box-of-triangle.g` proves (docs/no-hit-is-lost.md).
pub const BOX_MARGIN: f64 = 1.0 / (1 << 20) as f64;

/// The view for the kernel that computes the bounds of triangles in a picture.
pub(super) fn bounds_view(grid: &Grid<f64>, scale: f64, picture: Picture) -> BoundsView<f32> {
    let [all_columns, all_rows] = picture.whole();
    let (width, height) = (f64::from(picture.width), f64::from(picture.height));
    let to_pixels = grid.focal / grid.step;
    // If the film is so wide that the focal distance in pixels is subnormal, all bounds are the
    // whole picture.
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
        // The factor exceeds the kernel's own rounding errors.
        most: scale * grid.focal * (1.0 + 1.0 / f64::from(1 << 20)),
        all_columns: 0.0,
        all_rows: 0.0,
        // Bounds whose sides are shorter than `reach` contain at most two columns and two rows. An
        // edge is there the difference of two products, whose factors are below 3 and have errors
        // of a margin. The difference has an error of 12 margins, or 13 with the products of these
        // errors.
        reach: 2.0 - 4.0 * margin,
        outside: -13.0 * margin,
    };
    BoundsView { all_columns: f32::from_bits(all_columns), all_rows: f32::from_bits(all_rows), ..view.round::<f32>() }
}

/// The view for the kernels that set up spheres, with this value of white, and that compute their
/// bounds in a picture. Lights are within `far` radii.
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

/// How the objects of one kind are found in the picture and entered in bins.
pub(super) struct Planning<'a, T: Bounded> {
    pub(super) kernel: &'a Bounds<T>,
    pub(super) view: T::View,
    pub(super) picture: Picture,
    pub(super) widening: &'a Widening,
    /// Gives the reason why no ray passes within the bounds of an object.
    pub(super) unseen: fn(&Frustum, &T) -> Omission,
    /// For objects with these extremes, gives an upper bound of 1/t: an object whose own upper
    /// bound is not above it is certainly [narrow](Form::Narrow).
    pub(super) surely_narrow: &'a (dyn Fn(&Extremes) -> f32 + Sync),
    /// Gives the form of an object.
    pub(super) form: &'a (dyn Fn(&T, &mut Candidate) -> Form + Sync),
    /// Adds the tiles in which f32 cannot hold an object's 1/t; see
    /// [steep](super::forms::Forms::steep_tiles).
    pub(super) steep: &'a (dyn Fn(&T, &Candidate, &mut WideTiles) + Sync),
    /// An object in more tiles than this is large. None: all objects are large, and are in all
    /// tiles.
    pub(super) most_tiles: Option<usize>,
    /// If a piece has at most this many candidates, they are sorted by distance; otherwise they
    /// stay in the scene's order.
    pub(super) most_sorted: usize,
    /// Whether the plan is for kernels in f32, so that tiles that need f64 have to be found. If
    /// omissions are switched off, wide objects are in no bin of this plan, and the plan for f64
    /// has bins of its own.
    pub(super) in_f32: bool,
}

impl<T: Bounded + Sync> Planning<'_, T>
where
    T::View: Sync,
{
    /// Enters all `objects` in bins, piece by piece, so that their bounds are still in the cache
    /// when they are entered. Threads take pieces as they become free, and reuse their lists and
    /// memory from piece to piece. The result does not depend on which thread took which piece.
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
            // This assumes that the other threads take as many pieces as this one.
            let taken = (1 + planned.bins.pieces()) * piece;
            let left = (objects.len() / threads).saturating_sub(taken) as f64 / of_piece.len() as f64;
            planned.bins.add(number, candidates, left);
            planned.extremes = planned.extremes.into_iter().chain(extremes).reduce(Extremes::and);
        };
        let planned = team.share_with(0..pieces, Halved::whole, begin, add).into_iter().map(|(planned, _)| planned);
        planned.reduce(Planned::and).unwrap_or_else(nothing)
    }

    /// Finds the candidates of a piece, which are stored in `room`, and adds the tiles that need
    /// f64 to `wide`.
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
            // An object that is kept although it has no pixel is in no tile.
            let is_long = |candidate: &&Candidate| {
                let sides = [range(candidate.columns).len(), range(candidate.rows).len()];
                !sides.contains(&0) && sides.iter().any(|side| *side >= long)
            };
            for candidate in candidates.iter().filter(is_long) {
                (self.steep)(&object_of(candidate), candidate, wide);
            }
        }
        if candidates.len() <= self.most_sorted {
            // These numbers are not negative, so that their bits have their order.
            candidates.sort_unstable_by_key(|candidate| Reverse((candidate.most.to_bits(), candidate.id)));
        }
        if all {
            count = self.widen_all(object_of, candidates);
        }
        PieceFound { candidates: &candidates[..count], extremes: Some(extremes) }
    }

    /// Examines the candidates that may need f64, and adds the tiles of those that do to `wide`.
    /// Moves the others to the front, in order, and returns their number.
    fn sort_out_wide(
        &self,
        object_of: impl Fn(&Candidate) -> T,
        extremes: &Extremes,
        candidates: &mut [Candidate],
        wide: &mut WideTiles,
    ) -> usize {
        let all = self.widening.keep != Keep::NOTHING;
        let narrow = (self.surely_narrow)(extremes);
        // False for a NaN, so that the candidate is examined.
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
            // The bounds of an object that crosses the camera's plane are the whole picture,
            // wherever the object is.
            if candidate.most >= Candidate::ANY && matches!(unseen(), Omission::Behind | Omission::Outside) {
                (candidate.columns, candidate.rows) = (0, 0);
            }
            let has_pixels = covered(candidate.columns, candidate.rows) > 0;
            if is_wide && has_pixels {
                wide.add_all_of(candidate);
            }
            // If no omission is switched off, wide objects stay in the list: no tile that has one
            // is traced in f32, so that the plan for f64 can share the bins.
            if all { !is_wide } else { has_pixels }
        })
    }

    /// Widens the bounds of candidates as switched-off omissions require. Moves candidates that
    /// have pixels to the front, in order, and returns their number.
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

/// What is found in a piece of the objects.
struct PieceFound<'a> {
    candidates: &'a [Candidate],
    /// The extremes of the objects; None if there are none.
    extremes: Option<Extremes>,
}

/// The plan of some objects of one kind.
pub(super) struct Planned {
    pub(super) bins: Bins,
    /// The tiles that need f64: those of wide objects, and those in which an object is steep.
    pub(super) wide: WideTiles,
    /// The extremes of the objects; None if there are none.
    pub(super) extremes: Option<Extremes>,
}

impl Planned {
    /// The plan of these objects and of others of the same kind.
    fn and(mut self, next: Self) -> Self {
        self.bins = self.bins.and(next.bins);
        self.wide = self.wide.and(next.wide);
        self.extremes = self.extremes.into_iter().chain(next.extremes).reduce(Extremes::and);
        self
    }
}

/// Gives objects that are not to be culled the whole picture for their bounds.
pub(super) struct Widening {
    pub(super) keep: Keep,
    pub(super) frustum: Frustum,
    pub(super) whole: [u32; 2],
}

impl Widening {
    /// Widens an object's bounds to the whole picture, if misses are to be tested, or if the object
    /// has no pixel for a reason, `unseen`, whose omission is switched off.
    fn widen(&self, columns: &mut u32, rows: &mut u32, unseen: impl Fn() -> Omission) {
        let keep = self.keep;
        if keep.has(Omission::Misses) || keep != Keep::NOTHING && covered(*columns, *rows) == 0 && keep.has(unseen()) {
            [*columns, *rows] = self.whole;
        }
    }
}
