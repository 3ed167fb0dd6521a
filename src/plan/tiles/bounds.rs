//! The bounds of all objects in the picture, computed on several threads.

use std::cmp::Reverse;

use super::bins::Bins;
use super::forms::{Form, LONG, near_of_sphere};
use super::place::{Picture, covered, range};
use crate::kernels::{Bounded, Bounds, BoundsView, CHUNK, Candidate, Extremes, ObjectList, SphereView};
use crate::plan::Team;
use crate::plan::frustum::Frustum;
use crate::plan::omission::{Keep, Omission};
use crate::scene::Grid;

/// A thread that plans fewer objects costs more than it gains.
const FEWEST_PER_THREAD: usize = 1 << 14;

/// The number of objects processed together: few enough to keep their bounds in a core's cache, and enough for a tile
/// to find some side by side. It grows with the number of tiles, each of which has a list in every piece.
const PIECE: usize = 1 << 15;

/// A tile has to look into each piece. So there are at most this many, unless they would exceed `LARGE_PIECE`.
const MOST_PIECES: usize = 32;
const LARGE_PIECE: usize = 1 << 17;

/// With several threads there are this many pieces for each, unless they would be too small.
const PIECES_PER_THREAD: usize = 4;
const FEWEST_IN_PIECE: usize = 1 << 13;

/// Of at most this many objects, those with short bounds too are tested for being
/// [steep](super::forms::Forms::steep_tiles).
const MOST_LOOKED_AT: usize = 1 << 12;

/// Kernels count objects in f32, which has every integer up to this.
const MOST_COUNTED: usize = 1 << 24;

/// The view of the kernel that computes bounds of triangles in a picture.
pub(super) fn bounds_view(grid: &Grid<f64>, scale: f64, picture: Picture) -> BoundsView<f32> {
    let [all_columns, all_rows] = picture.whole();
    let (width, height) = (f64::from(picture.width), f64::from(picture.height));
    let to_pixels = grid.focal / grid.step;
    // Several roundings of numbers up to the picture's size, each of a relative 2^-24. Where a film is so wide that f32
    // has not all digits of its distance, bounds are the whole picture.
    let is_normal = to_pixels >= f32::MIN_POSITIVE.into();
    let margin = if is_normal { (width + height) / f64::from(1 << 20) } else { f64::INFINITY };
    let view = BoundsView {
        to_pixels,
        column: grid.half_width / grid.step - 0.5,
        row: grid.half_height / grid.step - 0.5,
        low: 1.0 - margin,
        high: 1.0 + margin,
        width,
        height,
        // A few more roundings than the kernels' own.
        most: scale * grid.focal * (1.0 + 1.0 / f64::from(1 << 20)),
        all_columns: 0.0,
        all_rows: 0.0,
        // Bounds below this contain at most two columns and two rows. An edge there is a sum of two products whose
        // factors are below 3, each off by the margin.
        reach: 2.0 - 4.0 * margin,
        outside: -13.0 * margin,
    };
    BoundsView { all_columns: f32::from_bits(all_columns), all_rows: f32::from_bits(all_rows), ..view.round::<f32>() }
}

/// The view that sets spheres up, with this value of white, and computes their bounds in a picture. Lights are within
/// `far` radii.
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

/// Finds the objects of a kind, and bins them into tiles.
pub(super) struct Planning<'a, T: Bounded> {
    pub(super) kernel: &'a Bounds<T>,
    pub(super) view: T::View,
    pub(super) picture: Picture,
    pub(super) widening: &'a Widening,
    /// Why no ray passes within the bounds of an object.
    pub(super) unseen: fn(&Frustum, &T) -> Omission,
    /// Among objects with these extremes, an upper bound of 1/t up to this proves one [narrow](Form::Narrow).
    pub(super) surely_narrow: &'a (dyn Fn(&Extremes) -> f32 + Sync),
    /// The form of an object.
    pub(super) form: &'a (dyn Fn(&T, &mut Candidate) -> Form + Sync),
    /// Adds the tiles where an object with these bounds is [steep](super::forms::Forms::steep_tiles).
    pub(super) steep: &'a (dyn Fn(&T, &Candidate, &mut Vec<Candidate>) + Sync),
    /// An object in more tiles than this is large; None: all are, and in all tiles.
    pub(super) most_tiles: Option<usize>,
    /// Up to this many are sorted by distance; more stay in the scene's order.
    pub(super) most_sorted: usize,
    /// Whether it is for kernels in f32: objects beyond f32 are in none of their tiles, even if they are kept.
    pub(super) in_f32: bool,
}

impl<T: Bounded + Sync> Planning<'_, T>
where
    T::View: Sync,
{
    /// The tiles that all `objects` may be in. Objects are processed piece by piece, so that their bounds are still
    /// cached when they are binned. Threads take pieces as they become free, and reuse their lists and memory from one
    /// to the next; the result does not depend on which thread took which.
    pub(super) fn plan(&self, objects: T::Many<'_>, threads: usize) -> Planned {
        let bins = || Bins::new(self.picture, self.most_tiles);
        let team = Team::up_to(if objects.len() > FEWEST_PER_THREAD { threads } else { 1 });
        let threads = team.threads().min(objects.len().div_ceil(FEWEST_PER_THREAD)).max(1);
        let share = if threads > 1 { objects.len().div_ceil(PIECES_PER_THREAD * threads) } else { usize::MAX };
        let most = objects.len().div_ceil(MOST_PIECES).clamp(PIECE, LARGE_PIECE);
        let piece = share.clamp(FEWEST_IN_PIECE, most).max(bins().tiles()).next_multiple_of(CHUNK);
        let long = if objects.len() <= MOST_LOOKED_AT { 0 } else { LONG };
        let pieces = objects.len().div_ceil(piece);
        let begin = || {
            let room = vec![Candidate::default(); objects.len().min(piece).next_multiple_of(CHUNK)];
            (Planned { bins: bins(), wide: Vec::new(), extremes: None }, room)
        };
        let add = |(planned, room): &mut (Planned, Vec<Candidate>), number: usize| {
            let start = number * piece;
            let of_piece = objects.part(start..objects.len().min(start + piece));
            let (candidates, extremes) = self.find(start as u32, of_piece, long, room, &mut planned.wide);
            // As many as the others take.
            let taken = (1 + planned.bins.pieces()) * piece;
            let left = (objects.len() / threads).saturating_sub(taken) as f64 / of_piece.len() as f64;
            planned.bins.add(number, candidates, left);
            planned.extremes = planned.extremes.into_iter().chain(extremes).reduce(Extremes::and);
        };
        let planned =
            team.share_with(0..pieces, |piece| (piece, None), begin, add).into_iter().map(|(planned, _)| planned);
        planned.reduce(Planned::and).unwrap_or_else(|| Planned { bins: bins(), wide: Vec::new(), extremes: None })
    }

    /// Finds the objects of a piece that may be visible, in `room`, and adds to `wide` where f64 is needed.
    fn find<'a>(
        &self,
        first_id: u32,
        objects: T::Many<'_>,
        long: usize,
        room: &'a mut [Candidate],
        wide: &mut Vec<Candidate>,
    ) -> (&'a [Candidate], Option<Extremes>) {
        let all = self.widening.keep != Keep::NOTHING;
        let first = if first_id as usize + objects.len() <= MOST_COUNTED { first_id } else { 0 };
        let (count, extremes) = self.kernel.call(&self.view, objects, first, all, room).unzip();
        let mut count = count.unwrap_or(0);
        if first < first_id {
            room[..count].iter_mut().for_each(|candidate| candidate.id += first_id);
        }
        let narrow = extremes.map_or(-1.0, |extremes| (self.surely_narrow)(&extremes));
        // A NaN compares false.
        let is_sure = |near: f32| near <= narrow;
        if extremes.is_some_and(|extremes| !is_sure(extremes.nearest)) {
            let mut left = 0;
            for i in 0..count {
                let candidate = &mut room[i];
                let mut is_kept = true;
                if !is_sure(candidate.most) {
                    let object = objects.get((candidate.id - first_id) as usize);
                    let is_wide = (self.form)(&object, candidate) == Form::Wide && self.in_f32;
                    // An object across the camera's plane has the whole picture for its bounds, wherever it is.
                    let unseen = || (self.unseen)(&self.widening.frustum, &object);
                    if candidate.most >= Candidate::ANY && matches!(unseen(), Omission::Behind | Omission::Outside) {
                        (candidate.columns, candidate.rows) = (0, 0);
                    }
                    let has_pixels = covered(candidate.columns, candidate.rows) > 0;
                    wide.extend((is_wide && has_pixels).then_some(*candidate));
                    // Without `keep`, no tile of theirs is traced in f32, and both plans can share one list.
                    is_kept = if all { !is_wide } else { has_pixels };
                }
                room[left] = room[i];
                left += usize::from(is_kept);
            }
            count = left;
        }
        let candidates = &mut room[..count];
        if self.in_f32 && extremes.is_some_and(|extremes| extremes.longest >= long as f32) {
            // An object that is kept without a pixel has no tile either.
            let is_long = |candidate: &&Candidate| {
                let sides = [range(candidate.columns).len(), range(candidate.rows).len()];
                !sides.contains(&0) && sides.iter().any(|side| *side >= long)
            };
            for candidate in candidates.iter().filter(is_long) {
                (self.steep)(&objects.get((candidate.id - first_id) as usize), candidate, wide);
            }
        }
        if candidates.len() <= self.most_sorted {
            // Not negative, and so ordered by their bits.
            candidates.sort_unstable_by_key(|candidate| Reverse((candidate.most.to_bits(), candidate.id)));
        }
        let mut count = candidates.len();
        if all {
            let mut left = 0;
            for i in 0..count {
                let Candidate { id, columns, rows, .. } = &mut candidates[i];
                let object = || objects.get((*id - first_id) as usize);
                self.widening.widen(columns, rows, || (self.unseen)(&self.widening.frustum, &object()));
                let has_pixels = covered(*columns, *rows) > 0;
                candidates[left] = candidates[i];
                left += usize::from(has_pixels);
            }
            count = left;
        }
        (&candidates[..count], extremes)
    }
}

/// The plan of some objects.
pub(super) struct Planned {
    pub(super) bins: Bins,
    /// The objects traced in f64, within their true bounds, and the tiles where others are.
    pub(super) wide: Vec<Candidate>,
    /// None if there are no objects.
    pub(super) extremes: Option<Extremes>,
}

impl Planned {
    /// This plan with that of other objects of the same kind.
    fn and(mut self, next: Self) -> Self {
        self.bins = self.bins.and(next.bins);
        self.wide.extend(next.wide);
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
    /// Widens the bounds of an object; it may be `unseen` for a reason that is to be kept.
    fn widen(&self, columns: &mut u32, rows: &mut u32, unseen: impl Fn() -> Omission) {
        let keep = self.keep;
        if keep.has(Omission::Misses) || keep != Keep::NOTHING && covered(*columns, *rows) == 0 && keep.has(unseen()) {
            [*columns, *rows] = self.whole;
        }
    }
}
