//! Develops linear light: averages samples, fills a background, applies exposure and sRGB.

use std::ops::{Add, Range};
use std::sync::Mutex;

use super::edges::Edges;
use super::film::{rgba_to_bgra, with_pixels};
use super::{Counted, FilmMut, Found, Pixel, PixelFormat, Tracer, UNPOISONED, assert_rows, existing};
use crate::kernels::{StandardFloats, Vec4};
use crate::scene::srgb::encode;
use crate::scene::{Camera, CameraError};

/// The number of samples that are traced at a time, unless a single row has more.
const MOST_TOGETHER: usize = 1 << 20;

/// How many rows of tiles of the plain picture are searched for edges at a time.
const TILES_TOGETHER: u32 = 2;

/// What is done to linear light after tracing; by default nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Development {
    /// The samples per side: a pixel is the mean of `samples` x `samples` rays through the centres
    /// of equal squares.
    pub samples: u32,
    /// The light of a ray that hits nothing: linear red, green, blue. It is averaged and exposed
    /// like any other light.
    pub background: [f32; 3],
    /// The exposure in stops: light is multiplied by 2 to this power.
    pub exposure: f64,
    /// Whether 8-bit levels are encoded by the sRGB curve (IEC 61966-2-1), rounded to the nearest,
    /// instead of linearly. Floats stay linear.
    pub srgb: bool,
}

impl Default for Development {
    fn default() -> Self {
        Development { samples: 1, background: [0.0; 3], exposure: 0.0, srgb: false }
    }
}

impl Development {
    /// The camera with which the scene is to be traced, whose pixels are the samples.
    ///
    /// # Errors
    /// If there are more samples than a picture may have pixels.
    pub fn camera(&self, camera: &Camera) -> Result<Camera, CameraError> {
        let of = |side: u32| side.saturating_mul(self.samples);
        camera.sized(of(camera.width()), of(camera.height()))
    }
}

/// A tracer of developed pixels. It drives another tracer, whose camera has a pixel for every
/// sample, and computes each pixel from its samples.
pub struct Developed<'a> {
    tracer: &'a dyn Tracer,
    /// The picture with one sample per pixel, if only edges get more samples.
    plain: Option<Box<Developed<'a>>>,
    width: usize,
    height: u32,
    development: Development,
    /// Buffers for samples that no thread uses now.
    spare: Mutex<Vec<Vec<Vec4>>>,
}

impl<'a> Developed<'a> {
    /// A tracer of `camera`'s picture; `tracer` must trace [`Development::camera`] in
    /// [`PixelFormat::F32x4`].
    ///
    /// # Panics
    /// If `camera` has so many pixels that [`Development::camera`] fails.
    pub fn new(tracer: &'a dyn Tracer, camera: &Camera, development: Development) -> Self {
        development.camera(camera).expect("a pixel has a sample, and a picture no more of them than it may have");
        let (width, height) = (camera.width() as usize, camera.height());
        Developed { tracer, plain: None, width, height, development, spare: Mutex::default() }
    }

    /// Omits the samples of pixels that are not at an edge, which then show what `plain` traces, a
    /// tracer with the picture's own camera. A pixel is at an edge if it differs by more than four
    /// levels from the mean of two opposite neighbours. A detail that no ray of `plain` hits
    /// therefore has no edge.
    pub fn along_edges(self, plain: &'a dyn Tracer) -> Self {
        let development = Development { samples: 1, ..self.development };
        let (width, height) = (self.width, self.height);
        let plain = Developed { tracer: plain, plain: None, width, height, development, spare: Mutex::default() };
        Developed { plain: Some(plain.into()), ..self }
    }

    /// The rows of samples that belong to rows of pixels.
    fn samples(&self, rows: Range<u32>) -> Range<u32> {
        rows.start * self.development.samples..rows.end * self.development.samples
    }

    /// Develops the pixels of all rows, or only those at `edges`. Returns the sum of the tracer's
    /// counts of hits.
    fn develop<P: Pixel>(&self, rows: Range<u32>, edges: Option<&Edges>, out: &mut [P]) -> Option<Counted> {
        let _floats = StandardFloats::set();
        assert_rows(&rows, [self.width as u32, self.height], out.len());
        let Development { samples, background, exposure, .. } = self.development;
        // Clamped, because infinity times 0 would make a black pixel NaN.
        let scale = exposure.exp2().min(f64::MAX) / f64::from(samples * samples);
        // If nothing has to be developed, a pixel is its only sample.
        let as_it_is = scale == 1.0 && samples == 1 && !self.is_encoded::<P>();
        let across = self.width * samples as usize;
        let of_row = across * samples as usize;
        let together = (self.together() as usize).min(MOST_TOGETHER / of_row).clamp(1, rows.len().max(1));
        let mut light = self.spare.lock().expect(UNPOISONED).pop().unwrap_or_default();
        light.resize(light.len().max(of_row * together), Vec4::from([0.0; 4]));
        let [x, y, z] = background;
        let background = Vec4::new(x, y, z);
        // The background, which most pixels without a hit show, is converted only once.
        let rest = P::of_linear(&background);
        let level = |light: &Vec4| if *light == background { rest } else { P::of_linear(light) };
        let wanted = |rows: Range<u32>, columns: Range<u32>| {
            let Some(edges) = edges else { return rows };
            let of = |range: Range<u32>| range.start / samples..range.end.div_ceil(samples);
            let at_edges = edges.within(of(rows.clone()), of(columns));
            rows.start.max(at_edges.start * samples)..rows.end.min(at_edges.end * samples)
        };
        let mut counted = Some(Counted::default());
        for (first, out) in rows.clone().step_by(together).zip(out.chunks_mut(together * self.width)) {
            let some = first..rows.end.min(first + together as u32);
            if edges.is_some_and(|edges| edges.within(some.clone(), 0..u32::MAX).is_empty()) {
                continue;
            }
            let light = &mut light[..of_row * some.len()];
            let of_some = self.tracer.light(self.samples(some.clone()), &wanted, background, light);
            counted = counted.zip(of_some).map(|(sum, of_some)| sum + of_some);
            for ((row, out), light) in some.zip(out.chunks_mut(self.width)).zip(light.chunks(of_row)) {
                let pixel = |column| self.pixel(scale, sum(light, across, column, samples as usize));
                match edges {
                    Some(edges) => {
                        edges.row(row).iter().for_each(|column| out[*column as usize] = pixel(*column as usize))
                    }
                    None if as_it_is => out.iter_mut().zip(light).for_each(|(out, light)| *out = level(light)),
                    None => out.iter_mut().enumerate().for_each(|(column, out)| *out = pixel(column)),
                }
            }
        }
        self.spare.lock().expect(UNPOISONED).push(light);
        counted
    }

    /// Makes a pixel from the sum of its samples.
    fn pixel<P: Pixel>(&self, scale: f64, sum: [f64; 3]) -> P {
        let light = sum.map(|sum| sum * scale);
        P::of_colour(if self.is_encoded::<P>() { light.map(nearest_level) } else { light }.into())
    }

    /// Whether pixels of this format are encoded by the sRGB curve; only 8-bit levels ever are.
    fn is_encoded<P: Pixel>(&self) -> bool {
        self.development.srgb && P::FORMAT.is_8bit()
    }

    /// The edges in these rows, and the levels of the plain picture: from the row above these rows
    /// to the row below them, where these exist.
    fn edges(&self, plain: &Developed<'_>, rows: Range<u32>) -> (Edges, Vec<[u8; 4]>) {
        let known = rows.start.saturating_sub(1)..self.height.min(rows.end + 1);
        let mut levels = vec![[0; 4]; known.len() * self.width];
        plain.rows(known.clone(), FilmMut::Rgba8(&mut levels));
        let edges = Edges::of(&levels, known.clone(), rows.clone(), self.width);
        levels.drain(..(rows.start - known.start) as usize * self.width);
        levels.truncate(rows.len() * self.width);
        (edges, levels)
    }

    /// Traces the plain picture, and pixels at its edges with all samples.
    fn rows_refined_at_edges(&self, plain: &Developed<'_>, rows: Range<u32>, mut out: FilmMut<'_>) {
        assert_rows(&rows, [self.width as u32, self.height], out.len());
        if rows.is_empty() {
            return;
        }
        let (edges, levels) = self.edges(plain, rows.clone());
        match &mut out {
            FilmMut::Rgba8(out) => out.copy_from_slice(&levels),
            FilmMut::Rgb8(out) => out.iter_mut().zip(levels).for_each(|(out, [r, g, b, _])| *out = [r, g, b]),
            FilmMut::Bgra8(out) => rgba_to_bgra(&levels, out),
            FilmMut::F32x3(out) => plain.rows(rows.clone(), Pixel::film(out)),
            FilmMut::F32x4(out) => plain.rows(rows.clone(), Pixel::film(out)),
        }
        with_pixels!(FilmMut(out) = out => _ = self.develop(rows, Some(&edges), out));
    }

    /// How many rows of pixels have samples that are whole rows of tiles, if the rows start at a
    /// multiple of that number.
    fn together(&self) -> u32 {
        let samples = self.development.samples;
        let of_tracer = self.tracer.rows_together().clamp(1, self.height * samples);
        (1..of_tracer).find(|rows| (rows * samples).is_multiple_of(of_tracer)).unwrap_or(of_tracer)
    }
}

/// The sum of the light of a pixel's `samples` x `samples` samples. A row of `light` has `across`
/// samples.
fn sum(light: &[Vec4], across: usize, column: usize, samples: usize) -> [f64; 3] {
    let mut sum = [0.0; 4];
    for row in light.chunks_exact(across) {
        for light in &row[column * samples..][..samples] {
            for (sum, light) in sum.iter_mut().zip(light.lanes()) {
                *sum += f64::from(light);
            }
        }
    }
    let [r, g, b, _] = sum;
    [r, g, b]
}

/// Encodes linear light by the sRGB curve and adds half a level, so that truncating the result
/// rounds to the nearest level.
fn nearest_level(linear: f64) -> f64 {
    encode(linear.clamp(0.0, 1.0)) + 0.5 / 255.0
}

impl Tracer for Developed<'_> {
    fn writes(&self, _: PixelFormat) -> bool {
        true
    }

    fn rows_together(&self) -> u32 {
        match &self.plain {
            // Several rows of tiles at a time: for each piece the plain picture's tiles above and
            // below it have to be traced too.
            Some(plain) => (TILES_TOGETHER * plain.together()).next_multiple_of(self.together()),
            None => self.together(),
        }
    }

    fn rows(&self, rows: Range<u32>, out: FilmMut<'_>) {
        match &self.plain {
            Some(plain) => self.rows_refined_at_edges(plain, rows, out),
            None if self.development == Development::default() && self.tracer.writes(out.format()) => {
                self.tracer.rows(rows, out);
            }
            None => with_pixels!(FilmMut(out) = out => _ = self.develop(rows, None, out)),
        }
    }

    /// Returns the hit of the sample in the middle of each pixel, or next to it.
    fn hits(&self, rows: Range<u32>) -> Vec<Option<Found>> {
        let samples = self.development.samples;
        let middle = |row| {
            let row = row * samples + samples / 2;
            self.tracer.hits(row..row + 1).into_iter().skip(samples as usize / 2).step_by(samples as usize)
        };
        existing(rows, self.height).flat_map(middle).collect()
    }

    /// Counts all samples.
    fn count(&self, rows: Range<u32>) -> Counted {
        let rows = existing(rows, self.height);
        let Some(plain) = self.plain.as_ref().filter(|_| !rows.is_empty()) else {
            return self.tracer.count(self.samples(rows));
        };
        let ((edges, _), samples) = (self.edges(plain, rows.clone()), self.development.samples);
        let at_edges = rows.clone().filter(|row| !edges.row(*row).is_empty()).map(|row| {
            let hits = self.tracer.hits(self.samples(row..row + 1));
            let lines = hits.chunks(self.width * samples as usize);
            let of_pixel = |line: &[Option<Found>], column: u32| {
                line[(column * samples) as usize..][..samples as usize].iter().flatten().count() as u64
            };
            let of_line = |line| edges.row(row).iter().map(move |column| of_pixel(line, *column)).sum::<u64>();
            Counted { rays: 0, hits: lines.map(of_line).sum() }
        });
        let rays = edges.count() * u64::from(samples * samples);
        at_edges.fold(plain.tracer.count(rows.clone()) + Counted { rays, hits: 0 }, Counted::add)
    }

    /// Counts all samples. Along edges the tracer's own counts would not do, since some samples are
    /// traced needlessly and others not at all.
    fn counted_rows(&self, rows: Range<u32>, out: FilmMut<'_>) -> Option<Counted> {
        if self.plain.is_some() {
            self.rows(rows, out);
            return None;
        }
        with_pixels!(FilmMut(out) = out => self.develop(rows, None, out))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::{Engine, Film, Wanted, level};
    use crate::scene::{MAX_SIDE, Scene, many};

    fn light(scene: &Scene, development: Development, rows: Range<u32>) -> Vec<[f32; 3]> {
        let traced = Scene { camera: development.camera(&scene.camera).unwrap(), ..scene.clone() };
        let tracer = Engine::Rust.prepare(None, &traced).unwrap();
        let developed = Developed::new(tracer.as_ref(), &scene.camera, development);
        let mut film = Film::new(PixelFormat::F32x3, scene.camera.width() as usize * rows.len()).unwrap();
        developed.rows(rows, film.as_mut());
        let Film::F32x3(pixels) = film else { unreachable!() };
        pixels
    }

    fn scene() -> Scene {
        let scene = many(20, 20, 3);
        Scene { camera: scene.camera.sized(48, 36).unwrap(), ..scene }
    }

    #[test]
    #[should_panic(expected = "a pixel has a sample")]
    fn pixels_without_samples_are_refused() {
        let scene = scene();
        let tracer = Engine::Rust.prepare(None, &scene).unwrap();
        Developed::new(tracer.as_ref(), &scene.camera, Development { samples: 0, ..Development::default() });
    }

    #[test]
    fn a_pixel_is_the_mean_of_its_samples() {
        let scene = scene();
        let fine = Scene { camera: scene.camera.sized(3 * 48, 3 * 36).unwrap(), ..scene.clone() };
        let (mean, samples) = (
            light(&scene, Development { samples: 3, ..Development::default() }, 0..36),
            light(&fine, Development::default(), 0..3 * 36),
        );
        for (i, pixel) in mean.iter().enumerate() {
            let (x, y) = (3 * (i % 48), 3 * (i / 48));
            for channel in 0..3 {
                let own = (0..9).map(|s| f64::from(samples[(y + s / 3) * 144 + x + s % 3][channel]));
                assert_eq!(pixel[channel], (own.sum::<f64>() / 9.0) as f32, "pixel {i}");
            }
        }
    }

    #[test]
    fn along_edges_a_pixel_has_all_its_samples_and_elsewhere_one() {
        let scene = scene();
        let development =
            Development { samples: 3, background: [0.1, 0.0, 0.3], exposure: 0.5, ..Development::default() };
        let one = Development { samples: 1, ..development };
        let traced = Scene { camera: development.camera(&scene.camera).unwrap(), ..scene.clone() };
        for engine in Engine::ALL.iter().filter(|engine| engine.usable()) {
            let [samples, plain] = [&traced, &scene].map(|scene| engine.prepare(None, scene).unwrap());
            let all = Developed::new(samples.as_ref(), &scene.camera, development);
            let one = Developed::new(plain.as_ref(), &scene.camera, one);
            let along = Developed::new(samples.as_ref(), &scene.camera, development).along_edges(plain.as_ref());
            for format in PixelFormat::ALL {
                let picture = |tracer: &dyn Tracer, rows: Range<u32>| {
                    let mut film = Film::new(format, 48 * rows.len()).unwrap();
                    tracer.rows(rows, film.as_mut());
                    (0..film.len()).map(|pixel| film.colour(pixel)).collect::<Vec<_>>()
                };
                let [all, one, whole] = [&all, &one, &along].map(|tracer| picture(tracer, 0..36));
                let (edges, _) = along.edges(along.plain.as_ref().unwrap(), 0..36);
                assert!((1..36 * 48).contains(&edges.count()), "{engine}: {} pixels", edges.count());
                for (i, pixel) in whole.iter().enumerate() {
                    let at_edge = edges.row(i as u32 / 48).contains(&(i as u32 % 48));
                    assert_eq!(*pixel, if at_edge { all[i] } else { one[i] }, "{engine}, {}: {i}", format.name());
                }
                assert_eq!(picture(&along, 7..20), whole[7 * 48..20 * 48]);
            }
            let counted = along.count(0..36);
            let (edges, _) = along.edges(along.plain.as_ref().unwrap(), 0..36);
            assert_eq!(counted.rays, 48 * 36 + 9 * edges.count());
            assert!(counted.hits > one.count(0..36).hits && counted.hits < all.count(0..36).hits);
            assert_eq!(along.count(0..17) + along.count(17..36), counted);
        }
    }

    #[test]
    fn engines_that_trace_ray_by_ray_trace_what_is_wanted_alone() {
        let (scene, canary) = (scene(), Vec4::from([f32::NAN; 4]));
        for engine in Engine::ALL.iter().filter(|engine| engine.usable() && !engine.is_packet()) {
            let tracer = engine.prepare(None, &scene).unwrap();
            let light = |wanted: &Wanted<'_>| {
                let mut out = vec![canary; 48 * 36];
                tracer.light(0..36, wanted, Vec4::new(0.5, 1.0, 2.0), &mut out);
                out
            };
            let is_wanted = |row: u32, column: u32| (row * column) % 5 < 2;
            let of_one = |rows: Range<u32>, mut columns: Range<u32>| {
                if columns.any(|column| is_wanted(rows.start, column)) { rows } else { rows.end..rows.end }
            };
            for (i, (some, all)) in light(&of_one).into_iter().zip(light(&|rows, _| rows)).enumerate() {
                let (row, column) = (i as u32 / 48, i as u32 % 48);
                let fine = if is_wanted(row, column) { some == all } else { some.x.is_nan() };
                assert!(fine, "{engine}: {some:?} at row {row}, column {column}");
            }
        }
    }

    #[test]
    fn background_is_kept_and_exposure_doubles_with_each_stop() {
        let development = Development { background: [0.25, 0.5, 1.0], exposure: 2.0, ..Development::default() };
        let mut seen = [0, 0];
        // Many objects, in light and in the dark; few objects; one of each kind; and
        // the longest rows.
        let lots =
            [(20, true, 77, 36), (20, false, 77, 36), (3, true, 77, 36), (1, true, 77, 36), (2, true, MAX_SIDE, 2)];
        for (objects, lit, width, height) in lots {
            let scene = many(objects, objects, 3);
            let lights = if lit { scene.lights } else { Vec::new() };
            let scene = Scene { camera: scene.camera.sized(width, height).unwrap(), lights, ..scene };
            let all = Engine::ALL.iter().filter(|engine| engine.usable());
            for (engine, precision) in all.flat_map(|engine| engine.precisions().iter().map(move |p| (*engine, *p))) {
                let own = engine.prepare(Some(precision), &scene).unwrap();
                let hits = own.hits(0..height);
                let picture = |background: [f32; 3]| {
                    let mut out = vec![[f32::NAN; 3]; hits.len()];
                    let development = Development { background, ..development };
                    Developed::new(own.as_ref(), &scene.camera, development).rows(0..height, FilmMut::F32x3(&mut out));
                    out
                };
                let (black, over) = (picture([0.0; 3]), picture(development.background));
                for (hit, (black, over)) in hits.iter().zip(black.into_iter().zip(over)) {
                    // An object that no light reaches is black, not background.
                    assert_eq!(over, if hit.is_some() { black } else { [1.0, 2.0, 4.0] }, "{engine}, {objects}");
                    seen[usize::from(hit.is_some())] += 1;
                }
            }
        }
        assert!(seen.iter().all(|pixels| *pixels > 1000), "{seen:?}");
    }

    #[test]
    fn levels_are_nearest_to_the_curve() {
        for (linear, expected) in
            [(0.0, 0), (0.001, 3), (0.003_130_8, 10), (0.18, 118), (0.5, 188), (1.0, 255), (9.0, 255)]
        {
            assert_eq!(level(nearest_level(linear)), expected, "{linear}");
        }
    }

    #[test]
    fn floats_are_linear_with_srgb_too() {
        for samples in [1, 2] {
            let linear = Development { samples, background: [0.25, 0.5, 1.0], ..Development::default() };
            let encoded = Development { srgb: true, ..linear };
            let [linear, encoded] = [linear, encoded].map(|development| light(&scene(), development, 0..36));
            assert_eq!(linear, encoded, "{samples} x {samples} samples");
        }
    }

    #[test]
    fn empty_rows_and_absurd_exposures_are_developed() {
        let scene = scene();
        let development = Development { samples: 2, ..Development::default() };
        let traced = Scene { camera: development.camera(&scene.camera).unwrap(), ..scene.clone() };
        let [tracer, plain] = [&traced, &scene].map(|scene| Engine::Rust.prepare(None, scene).unwrap());
        let edges = Developed::new(tracer.as_ref(), &scene.camera, development).along_edges(plain.as_ref());
        #[expect(clippy::reversed_empty_ranges)]
        for rows in [3..3, 5..3, u32::MAX..0] {
            edges.rows(rows.clone(), FilmMut::Rgba8(&mut []));
            assert_eq!(edges.count(rows), Counted::default());
        }
        for exposure in [2000.0, f64::INFINITY] {
            let pixels = light(&scene, Development { exposure, ..Development::default() }, 0..36);
            assert!(pixels.iter().flatten().all(|light| [0.0, f32::MAX].contains(light)));
            assert!(pixels.contains(&[0.0; 3]) && pixels.contains(&[f32::MAX; 3]));
        }
    }
}
