//! From linear light to what a picture shows: samples averaged, a background, exposure, and the sRGB curve.

use std::ops::Range;

use super::film::with_pixels;
use super::{FilmMut, Found, Pixel, PixelFormat, Tracer};
use crate::kernels::Vec4;
use crate::scene::{Camera, CameraError};

/// Samples that are traced at once take no more memory than so many pixels do, unless those of one row do.
const MOST_TOGETHER: usize = 1 << 20;

/// What is made of linear light after it was traced. By default nothing is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Development {
    /// A pixel is the mean of so many times so many samples, whose rays go through the middles of equal squares of it.
    pub samples: u32,
    /// Where a ray hits nothing: linear red, green, blue. It is light as any other, averaged and exposed.
    pub background: [f32; 3],
    /// In stops: light is multiplied by 2 to the power of this.
    pub exposure: f64,
    /// Whether levels are those of the sRGB curve (IEC 61966-2-1), to the nearest, and not linear.
    pub srgb: bool,
}

impl Default for Development {
    fn default() -> Self {
        Development { samples: 1, background: [0.0; 3], exposure: 0.0, srgb: false }
    }
}

impl Development {
    /// The camera that the scene is to be traced with: that of the samples.
    ///
    /// # Errors
    /// More samples than a picture may have pixels.
    pub fn camera(&self, camera: &Camera) -> Result<Camera, CameraError> {
        let of = |side: u32| side.saturating_mul(self.samples);
        camera.sized(of(camera.width()), of(camera.height()))
    }
}

/// A tracer of the samples' picture, developed.
pub struct Developed<'a> {
    tracer: &'a dyn Tracer,
    /// Pixels in a row.
    width: usize,
    development: Development,
}

impl<'a> Developed<'a> {
    /// The picture of `camera`, of what `tracer` traces with [`Development::camera`] in [`PixelFormat::F32x4`].
    pub fn new(tracer: &'a dyn Tracer, camera: &Camera, development: Development) -> Self {
        Developed { tracer, width: camera.width() as usize, development }
    }

    /// The samples' rows.
    fn samples(&self, rows: Range<u32>) -> Range<u32> {
        rows.start * self.development.samples..rows.end * self.development.samples
    }

    /// With how the tracer does so; what that says of hits, in sum.
    fn develop<P: Pixel>(
        &self,
        rows: Range<u32>,
        out: &mut [P],
        trace: impl Fn(Range<u32>, FilmMut<'_>) -> Option<u64>,
    ) -> Option<u64> {
        assert_eq!(out.len(), rows.len() * self.width, "the film must have the size of the rows");
        let Development { samples, background, exposure, .. } = self.development;
        let scale = exposure.exp2() / f64::from(samples * samples);
        let across = self.width * samples as usize;
        let of_row = across * samples as usize;
        let together = (self.rows_together() as usize).min(MOST_TOGETHER / of_row).clamp(1, rows.len().max(1));
        let mut light = vec![Vec4::from([0.0; 4]); of_row * together];
        let mut sums = vec![[0.0; 4]; self.width];
        let mut hits = Some(0);
        for (first, out) in rows.clone().step_by(together).zip(out.chunks_mut(together * self.width)) {
            let some = first..rows.end.min(first + together as u32);
            let light = &mut light[..of_row * some.len()];
            let of_some = trace(self.samples(some.clone()), FilmMut::F32x4(light));
            hits = hits.zip(of_some).map(|(hits, of_some)| hits + of_some);
            if background != [0.0; 3] {
                let [x, y, z] = background;
                let missed = self.tracer.hits(self.samples(some)).into_iter().zip(&mut *light);
                let missed = missed.filter(|(hit, _)| hit.is_none());
                missed.for_each(|(_, light)| *light = Vec4::from([x, y, z, 0.0]));
            }
            for (out, light) in out.chunks_mut(self.width).zip(light.chunks(of_row)) {
                sums.fill([0.0; 4]);
                light.chunks_exact(across).for_each(|row| add_samples(row, samples as usize, &mut sums));
                out.iter_mut().zip(&sums).for_each(|(out, [r, g, b, _])| *out = self.pixel(scale, [*r, *g, *b]));
            }
        }
        hits
    }

    /// Of the sum of a pixel's samples.
    fn pixel<P: Pixel>(&self, scale: f64, sum: [f64; 3]) -> P {
        let light = sum.map(|sum| sum * scale);
        P::of_colour(if self.development.srgb { light.map(nearest_level) } else { light }.into())
    }
}

/// Adds a row of samples, so many for each pixel, to the sums of theirs.
fn add_samples(row: &[Vec4], samples: usize, sums: &mut [[f64; 4]]) {
    for (sum, samples) in sums.iter_mut().zip(row.chunks_exact(samples)) {
        for light in samples {
            for (sum, light) in sum.iter_mut().zip(light.lanes()) {
                *sum += f64::from(light);
            }
        }
    }
}

/// What has as its level the one nearest to that of linear light on the sRGB curve.
fn nearest_level(linear: f64) -> f64 {
    let v = linear.clamp(0.0, 1.0);
    let encoded = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    encoded + 0.5 / 255.0
}

impl Tracer for Developed<'_> {
    fn writes(&self, _: PixelFormat) -> bool {
        true
    }

    fn rows_together(&self) -> u32 {
        let (of_tracer, samples) = (self.tracer.rows_together(), self.development.samples);
        (1..of_tracer).find(|rows| (rows * samples).is_multiple_of(of_tracer)).unwrap_or(of_tracer)
    }

    fn rows(&self, rows: Range<u32>, out: FilmMut<'_>) {
        let trace = |rows, out: FilmMut<'_>| {
            self.tracer.rows(rows, out);
            None
        };
        with_pixels!(FilmMut(out) = out => self.develop(rows, out, trace));
    }

    /// Of each pixel the sample in the middle, or next to it.
    fn hits(&self, rows: Range<u32>) -> Vec<Option<Found>> {
        let samples = self.development.samples;
        let middle = |row| {
            let row = row * samples + samples / 2;
            self.tracer.hits(row..row + 1).into_iter().skip(samples as usize / 2).step_by(samples as usize)
        };
        rows.flat_map(middle).collect()
    }

    /// Of all samples.
    fn count_hits(&self, rows: Range<u32>) -> u64 {
        self.tracer.count_hits(self.samples(rows))
    }

    /// Of all samples.
    fn counted_rows(&self, rows: Range<u32>, out: FilmMut<'_>) -> Option<u64> {
        let trace = |rows, out: FilmMut<'_>| self.tracer.counted_rows(rows, out);
        with_pixels!(FilmMut(out) = out => self.develop(rows, out, trace))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::{Engine, Film, level};
    use crate::scene::{Scene, many};

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
    fn by_default_nothing_changes_and_rows_are_the_same_alone_and_together() {
        let scene = scene();
        let tracer = Engine::Rust.prepare(None, &scene).unwrap();
        let mut film = Film::new(PixelFormat::F32x4, 48 * 36).unwrap();
        tracer.rows(0..36, film.as_mut());
        let Film::F32x4(pixels) = film else { unreachable!() };
        let own: Vec<_> = pixels.iter().map(<[f32; 3]>::of_linear).collect();
        assert_eq!(own, light(&scene, Development::default(), 0..36));
        let development = Development { samples: 2, background: [0.25, 0.5, 1.0], exposure: -1.0, srgb: false };
        let whole = light(&scene, development, 0..36);
        assert_eq!(light(&scene, development, 7..20), whole[7 * 48..20 * 48]);
    }

    #[test]
    fn the_background_is_where_no_ray_hits_and_exposure_doubles_with_each_stop() {
        let scene = Scene { lights: Vec::new(), ..scene() };
        let background = Development { background: [0.25, 0.5, 1.0], exposure: 2.0, ..Development::default() };
        let hits = Engine::Rust.prepare(None, &scene).unwrap().hits(0..36);
        let pixels = light(&scene, background, 0..36);
        // An object that no light reaches is black, and no background.
        assert!(hits.iter().any(Option::is_some) && hits.iter().any(Option::is_none));
        for (hit, pixel) in hits.iter().zip(pixels) {
            assert_eq!(pixel, if hit.is_some() { [0.0; 3] } else { [1.0, 2.0, 4.0] });
        }
    }

    #[test]
    fn levels_are_nearest_to_the_curve() {
        for (linear, expected) in
            [(0.0, 0), (0.001, 3), (0.003_130_8, 10), (0.18, 118), (0.5, 188), (1.0, 255), (9.0, 255)]
        {
            assert_eq!(level(nearest_level(linear)), expected, "{linear}");
        }
    }
}
