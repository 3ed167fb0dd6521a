//! Shared by the tests of engines: the engines that run on this machine, and the comparison of
//! their pictures with the reference's.

#![allow(dead_code, reason = "no test of those that share it uses all of it")]

use rayo::internals::plan::Keep;
use rayo::internals::render::reference::ReferenceTracer;
use rayo::internals::render::{Engine, Film, Frame, PixelFormat, Plan, Precision, Purpose, Settings, Tracer, level};
use rayo::internals::scene::{Camera, Object, Scene};
use rayon::prelude::*;

/// An engine with one of its precisions.
#[derive(Clone, Copy)]
pub struct Contender {
    pub engine: Engine,
    pub precision: Precision,
}

impl std::fmt::Display for Contender {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} in {}", self.engine, self.precision)
    }
}

impl Contender {
    pub fn prepare<'a>(&self, scene: &'a Scene) -> Box<dyn Tracer + 'a> {
        self.engine.prepare(Some(self.precision), scene).unwrap()
    }

    /// The engine's plan of a scene for a purpose, in this precision.
    pub fn plan<'a>(&self, scene: &'a Scene, purpose: Purpose) -> Plan<'a> {
        let purpose = Purpose { precision: Some(self.precision), ..purpose };
        Plan::new(self.engine, scene, purpose).expect("an engine that runs here, and a scene that is one")
    }

    /// Every bit of the picture in a format, with the omissions in `keep` not made. For three
    /// channels the fourth number is 0.
    pub fn bits(&self, scene: &Scene, format: PixelFormat, keep: Keep) -> Vec<[u32; 4]> {
        let tracer = self.plan(scene, Purpose { format: Some(format), keep, ..Purpose::default() }).into_tracer();
        match film(tracer.as_ref(), scene.camera, 1, format) {
            Film::F32x4(pixels) => pixels.into_iter().map(|pixel| pixel.lanes().map(f32::to_bits)).collect(),
            Film::F32x3(pixels) => pixels.into_iter().map(|[r, g, b]| [r, g, b, 0.0].map(f32::to_bits)).collect(),
            Film::Rgba8(pixels) => pixels.into_iter().map(|pixel| pixel.map(u32::from)).collect(),
            Film::Rgb8(pixels) => pixels.into_iter().map(|[r, g, b]| [r, g, b, 0].map(u32::from)).collect(),
            Film::Bgra8(pixels) => pixels.into_iter().map(|pixel| pixel.to_le_bytes().map(u32::from)).collect(),
        }
    }

    /// Asserts that the pictures with the omissions in `keep` not made equal the planned ones in
    /// every bit, for floats in three channels and bytes in four.
    pub fn check_kept(&self, scene: &Scene, keep: Keep, what: &str) {
        for format in [PixelFormat::F32x3, PixelFormat::Rgba8] {
            let [planned, kept] = [Keep::NOTHING, keep].map(|keep| self.bits(scene, format, keep));
            if let Some(at) = planned.iter().zip(&kept).position(|(a, b)| a != b) {
                let (row, col) = (at / scene.camera.width() as usize, at % scene.camera.width() as usize);
                let (format, planned, kept) = (format.name(), planned[at], kept[at]);
                panic!(
                    "{what}: {self} as {format} at row {row}, column {col}: {planned:x?}, but {kept:x?} with more work"
                );
            }
        }
    }

    /// The picture in linear floats, traced by this thread alone.
    pub fn floats(&self, scene: &Scene) -> Vec<[f32; 4]> {
        let tracer = self.prepare(scene);
        let Film::F32x4(film) = film(tracer.as_ref(), scene.camera, 1, PixelFormat::F32x4) else { unreachable!() };
        film.into_iter().map(|pixel| pixel.lanes()).collect()
    }

    /// The picture as in an 8-bit file: the engine's own bytes if it writes bytes, otherwise the
    /// levels of its floats.
    pub fn bytes(&self, scene: &Scene) -> Vec<[u8; 3]> {
        let film = film(self.prepare(scene).as_ref(), scene.camera, 1, self.engine.format_for(true));
        (0..film.len()).map(|pixel| film.colour(pixel).levels()).collect()
    }

    /// The largest relative error of the light that a surface reflects, in floats or, if the engine
    /// writes them itself, in bytes. It is a few rounding errors; or, in `fast` and in the bytes of
    /// `single`, that of two estimates (of a root and of a reciprocal root), each with an error up
    /// to 1.5 x 2^-12, as SSE's rsqrtps has.
    #[allow(dead_code, reason = "not every test that shares this asks for it")]
    pub fn shade_error(&self, format: PixelFormat) -> f32 {
        match (self.precision.name(), format) {
            ("fast", _) | ("single", PixelFormat::Rgb8) => 2.0 * 1.5 / 4096.0,
            _ => 1e-5,
        }
    }

    /// Whether the engine evaluates eq. 5 literally in f32: |c|^2 - r^2 cancels for spheres that
    /// are small for their distance. `c` and `paper` do so because the paper does, `rust` because a
    /// plain program does.
    pub fn cancels(&self) -> bool {
        ["rust", "c", "paper"].contains(&self.engine.name())
    }
}

/// Every engine that this machine can run, in each of its precisions.
pub fn contenders() -> Vec<Contender> {
    let names = ["single", "fast", "double"];
    let precisions: Vec<Precision> = names.iter().filter_map(|name| name.parse().ok()).collect();
    let scene = rayo::internals::scene::many(1, 1, 0);
    let mut contenders = Vec::new();
    for &engine in Engine::ALL.iter().filter(|engine| engine.usable()) {
        let has = |precision: &&Precision| engine.prepare(Some(**precision), &scene).is_ok();
        let of_engine = precisions.iter().filter(has).map(|&precision| Contender { engine, precision });
        let before = contenders.len();
        contenders.extend(of_engine);
        assert!(contenders.len() > before, "{engine} has no precision");
    }
    contenders
}

/// The contenders with packet engines.
pub fn packets() -> Vec<Contender> {
    contenders().into_iter().filter(|contender| contender.engine.is_packet()).collect()
}

/// Asserts that the pictures of every packet engine equal those by brute force.
pub fn check_by_force(scene: &Scene, what: &str) {
    packets().iter().for_each(|contender| contender.check_kept(scene, Keep::all(), what));
}

/// Pairs of packet engines that round in the same way and so make the same floats: for each
/// precision without estimates, neighbours in the order of engines.
pub fn twins() -> Vec<[Contender; 2]> {
    let arithmetic = |c: &Contender| Some((c.engine.packets()?.single.fused, c.precision.name()));
    let all: Vec<_> = contenders().into_iter().filter(|c| c.precision != Precision::Fast).collect();
    let twin = |(i, one): (usize, &Contender)| {
        let mut later = all[i + 1..].iter().filter(|other| arithmetic(other) == arithmetic(one));
        arithmetic(one).and_then(|_| later.next()).map(|other| [*one, *other])
    };
    all.iter().enumerate().filter_map(twin).collect()
}

/// The whole picture, traced into a film.
pub fn film(tracer: &dyn Tracer, camera: Camera, threads: usize, format: PixelFormat) -> Film {
    let frame = Frame::new(tracer, camera, Settings { threads }).unwrap();
    let mut film = frame.film(format, camera.height()).unwrap();
    frame.trace(0..camera.height(), film.as_mut(), &|_| {}).unwrap();
    film
}

/// The 8-bit levels of linear floats.
pub fn levels([r, g, b, _]: [f32; 4]) -> [u8; 3] {
    [r, g, b].map(|v| level(v.into()))
}

/// The largest difference of a channel.
pub fn difference(a: [u8; 3], b: [u8; 3]) -> u8 {
    a.iter().zip(b).map(|(a, b)| a.abs_diff(b)).max().unwrap()
}

/// The picture of the reference, with the object at each pixel.
pub struct Truth {
    scene: Scene,
    objects: Vec<Option<Object>>,
    bytes: Vec<[u8; 3]>,
}

/// The share of silhouette pixels on which an engine may differ from the reference by more than a
/// level.
///
/// A ray within the rounding error of an outline may fall on either side of it. For spheres
/// hundreds of radii away, as in `many.in`, eq. 5 in f32 shifts the outline by hundredths of a
/// pixel; no other form does.
fn silhouette_share(contender: &Contender) -> f64 {
    if contender.cancels() { 0.005 } else { 0.001 }
}

/// The differences of a picture from the reference's.
pub struct Agreement {
    /// The number of pixels at which one of the four neighbours shows another object.
    pub silhouette: usize,
    /// How many of these differ by more than a level.
    pub differing: usize,
    /// The largest difference at other pixels.
    pub worst: u8,
}

impl Truth {
    pub fn new(scene: &Scene) -> Self {
        let camera = scene.camera;
        let tracer = ReferenceTracer::new(scene);
        let pixels = (0..camera.height()).into_par_iter().flat_map_iter(|row| {
            let tracer = &tracer;
            (0..camera.width()).map(move |col| tracer.hit(row, col).map(|hit| hit.object))
        });
        let objects = pixels.collect();
        let Film::Rgb8(bytes) = film(&tracer, camera, 2, PixelFormat::Rgb8) else { unreachable!() };
        Truth { scene: scene.clone(), objects, bytes }
    }

    /// The object that is visible at a pixel.
    pub fn object(&self, row: u32, col: u32) -> Option<Object> {
        self.objects[(row * self.scene.camera.width() + col) as usize]
    }

    /// Whether one of a pixel's four neighbours shows another object.
    pub fn at_silhouette(&self, row: u32, col: u32) -> bool {
        let camera = &self.scene.camera;
        let rows = row.saturating_sub(1)..=(row + 1).min(camera.height() - 1);
        let cols = col.saturating_sub(1)..=(col + 1).min(camera.width() - 1);
        let seen = self.object(row, col);
        rows.into_iter().any(|row| self.object(row, col) != seen)
            || cols.into_iter().any(|col| self.object(row, col) != seen)
    }

    /// Compares a picture by `contender` with the reference's: each pixel away from silhouettes,
    /// and the number of differing pixels at silhouettes. The error says where they disagree.
    pub fn compare(&self, contender: &Contender, bytes: &[[u8; 3]]) -> Result<Agreement, String> {
        let width = self.scene.camera.width();
        let mut agreement = Agreement { silhouette: 0, differing: 0, worst: 0 };
        assert_eq!(bytes.len(), self.bytes.len());
        for (i, (&ours, &truth)) in bytes.iter().zip(&self.bytes).enumerate() {
            let (row, col) = (i as u32 / width, i as u32 % width);
            let difference = difference(ours, truth);
            if self.at_silhouette(row, col) {
                agreement.silhouette += 1;
                agreement.differing += usize::from(difference > 1);
            } else if difference > 1 {
                let object = self.object(row, col);
                return Err(format!(
                    "{contender}: {ours:?} where the reference has {truth:?}, at row {row}, column {col}: {object:?}"
                ));
            } else {
                agreement.worst = agreement.worst.max(difference);
            }
        }
        let Agreement { silhouette, differing, .. } = agreement;
        // Tolerate a single pixel: a small picture may have one such ray by chance.
        if differing > 1 && differing as f64 > silhouette_share(contender) * silhouette as f64 {
            return Err(format!("{contender} differs on {differing} of {silhouette} silhouette pixels"));
        }
        Ok(agreement)
    }

    /// Compares the picture that `contender` makes with the reference's.
    ///
    /// # Panics
    /// If they disagree; `what` names the scene.
    pub fn check(&self, contender: &Contender, what: &str) -> Agreement {
        let agreement = self.compare(contender, &contender.bytes(&self.scene));
        agreement.unwrap_or_else(|error| panic!("{what}: {error}"))
    }
}
