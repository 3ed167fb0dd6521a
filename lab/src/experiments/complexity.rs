//! How the packets' time grows with pixels, objects and lights, and the cost of one more of each.

pub mod plot;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::in_size;
use super::lab::{Bench, Case, LabError, Progress, Timed};
use super::speedup;
use super::sweeps::Axis;
use crate::measure::Name;
use crate::measure::statistics::{Line, fit_line, median, minimum};
use crate::measure::{Clock, Machine, Runs};
use rayo::internals::kernels::Vec4;
use rayo::internals::plan::Keep;
use rayo::internals::render::{Engine, FilmMut, PixelFormat, Purpose};
use rayo::internals::scene::mesh::shapes;
use rayo::internals::scene::{Camera, Light, MeshFormat, Rng, Scene, Setting, Sphere, Triangle, many};

/// Pictures of 0.1 to 100 million pixels, each 4:3.
const SIZES: [(u32, u32); 11] = [
    (365, 273),
    (516, 387),
    (730, 547),
    (1155, 866),
    (1632, 1224),
    (2309, 1732),
    (3652, 2739),
    (5164, 3873),
    (6532, 4899),
    (8165, 6124),
    (11547, 8660),
];
/// One to ten million objects; each count is about √10 times the one before.
const OBJECTS: [u64; 15] =
    [1, 3, 10, 32, 100, 316, 1_000, 3_162, 10_000, 31_623, 100_000, 316_228, 1_000_000, 3_162_278, 10_000_000];
/// The largest number of objects that is also traced by brute force.
const MOST_BY_FORCE: u64 = 1_000;
/// One to 64 lights.
const LIGHTS: [u64; 7] = [1, 2, 4, 8, 16, 32, 64];
/// The size of the pictures in which objects or lights vary.
const SIZE: (u32, u32) = (1632, 1224);
const QUICK_SIZE: (u32, u32) = (204, 153);
/// The limits of a quick run: at most so many pixels, and at most so many objects.
const QUICK_PIXELS: u64 = 1_000_000;
const QUICK_OBJECTS: u64 = 10_000;
/// The number of runs of every picture.
pub const RUNS: usize = 9;
/// The number of runs of every picture in a quick run.
pub const QUICK_RUNS: usize = 2;
const SEED: u64 = 7;
/// How far the mesh's vertices may be from a sphere, as a share of its radius.
const BUMPS: f64 = 0.3;

/// The name of the contestant that only fills the film with zeros, by ordinary stores.
pub const ZEROS: &str = "zeros";

#[derive(Clone, Debug)]
pub struct Settings {
    /// Whether to measure only small pictures and few objects.
    pub quick: bool,
    pub runs: usize,
    /// The packet engines, slowest first. Only the last one, the fastest, traces the scenes of many
    /// objects.
    pub engines: Vec<Engine>,
}

impl Settings {
    /// The packet engines among `engines`, which must be usable.
    pub fn new(quick: bool, runs: Option<usize>, engines: &[Engine]) -> Self {
        let packets = Engine::ALL.iter().copied().filter(|engine| engine.is_packet());
        let runs = runs.unwrap_or(if quick { QUICK_RUNS } else { RUNS });
        Settings { quick, runs, engines: packets.filter(|engine| engines.contains(engine)).collect() }
    }

    fn size(&self) -> (u32, u32) {
        if self.quick { QUICK_SIZE } else { SIZE }
    }

    fn sizes(&self) -> impl Iterator<Item = (u32, u32)> + use<> {
        let most = if self.quick { QUICK_PIXELS } else { u64::MAX };
        SIZES.into_iter().filter(move |(width, height)| u64::from(*width) * u64::from(*height) <= most)
    }

    fn objects(&self) -> impl Iterator<Item = u64> + use<> {
        let most = if self.quick { QUICK_OBJECTS } else { u64::MAX };
        OBJECTS.into_iter().filter(move |count| *count <= most)
    }

    /// How many lines of the figure a whole run measures; after each, [`measure`] calls `proceed`
    /// with work 1.
    pub fn work(&self) -> u64 {
        let pixels = self.sizes().count() * OUTPUTS.len();
        (pixels + self.objects().count() * SCENES.len() + LIGHTS.len()) as u64
    }
}

/// The pixel formats in which pictures of growing size are written.
const OUTPUTS: [PixelFormat; 4] = [PixelFormat::F32x4, PixelFormat::F32x3, PixelFormat::Rgba8, PixelFormat::Rgb8];

/// A scene of a growing number of objects.
#[derive(Clone, Copy)]
struct GrowingScene {
    name: &'static str,
    /// Makes the scene with a given number of objects.
    make: fn(u64, Camera) -> Scene,
}

/// The scenes whose number of objects grows.
const SCENES: [GrowingScene; 5] = [
    GrowingScene { name: "spheres", make: spheres },
    GrowingScene { name: "triangles", make: triangles },
    GrowingScene { name: "mesh", make: mesh },
    GrowingScene { name: "layers", make: layers },
    GrowingScene { name: "crowd", make: crowd },
];

/// The time of one contestant for one picture. The field names are those of the JSON document.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Growth {
    pub axis: Axis,
    pub scene: Name,
    /// The number of pixels, objects or lights, whichever the axis varies.
    pub count: u64,
    pub width: u32,
    pub height: u32,
    /// The engine, or [`ZEROS`].
    pub engine: Name,
    pub output: Name,
    pub keep_all: bool,
    /// Median TSC cycles of the set-up, from the parsed scene to the first ray. None for rows whose
    /// times do not include it.
    pub setup_cycles: Option<f64>,
    /// Median TSC cycles of the picture.
    pub cycles_median: f64,
    /// Minimum TSC cycles of the picture.
    pub cycles_min: f64,
    /// TSC cycles of every run.
    pub samples: Vec<f64>,
}

impl Growth {
    pub fn pixels(&self) -> f64 {
        f64::from(self.width) * f64::from(self.height)
    }

    /// Median TSC cycles per pixel.
    pub fn cycles_per_pixel(&self) -> f64 {
        self.cycles_median / self.pixels()
    }

    fn is_of(&self, other: &Growth) -> bool {
        self.axis == other.axis
            && self.scene == other.scene
            && self.engine == other.engine
            && self.output == other.output
            && self.keep_all == other.keep_all
    }
}

/// What one more pixel, object or light costs. The field names are those of the JSON document.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Slope {
    pub axis: Axis,
    pub scene: Name,
    pub engine: Name,
    pub output: Name,
    pub keep_all: bool,
    /// The smallest count among the points that the line is fitted to.
    pub from: u64,
    /// The largest count among them.
    pub to: u64,
    /// The straight line through the fastest pictures; its slope is in TSC cycles per pixel, object
    /// or light.
    pub line: Line,
}

/// All that was measured, on which machine and with which settings; `docs/complexity.schema.json`
/// is its schema.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Complexity {
    pub machine: Machine,
    pub runs: usize,
    pub complete: bool,
    pub rows: Vec<Growth>,
    pub slopes: Vec<Slope>,
}

impl Complexity {
    /// Makes the document from the measured rows.
    pub fn new(machine: Machine, settings: &Settings, complete: bool, rows: Vec<Growth>) -> Self {
        Complexity { machine, runs: settings.runs, complete, slopes: slopes(&rows), rows }
    }
}

/// `count` spheres scattered over the picture.
fn spheres(count: u64, camera: Camera) -> Scene {
    with_camera_and_one_light(many(count as usize, 0, SEED), camera)
}

/// `count` triangles scattered over the picture.
fn triangles(count: u64, camera: Camera) -> Scene {
    with_camera_and_one_light(many(0, count as usize, SEED), camera)
}

fn with_camera_and_one_light(mut scene: Scene, camera: Camera) -> Scene {
    scene.camera = camera;
    scene.lights.truncate(1);
    scene
}

/// A closed, bumpy mesh of about `count` triangles that fills the picture's height.
pub(super) fn mesh(count: u64, camera: Camera) -> Scene {
    let mesh = shapes::icosphere(count, BUMPS, SEED);
    let setting = Setting::of(&mesh, MeshFormat::Obj, &camera);
    let scene = setting.and_then(|setting| setting.scene(mesh, "mesh.png".into()));
    scene.expect("the shapes are of ordinary size")
}

/// `count` triangles that each fill the picture and are parallel to it, in no order of depth.
fn layers(count: u64, camera: Camera) -> Scene {
    let mut rng = Rng::new(SEED);
    let mut layer = |_| {
        let depth = rng.between(100.0, 300.0);
        // A triangle's edges are about as far from the axis as its depth, and the corners of the
        // picture are at half of that distance, so that the triangle fills the picture.
        let corners = [(2.0, 0.0), (-1.0, 1.75), (-1.0, -1.75)];
        let vertices = corners.map(|(x, y)| depth * Vec3::new(x, y, 1.0));
        Triangle { colour: Vec3::ONE, vertices }
    };
    let triangles = (0..count).map(&mut layer).collect();
    Scene { triangles, ..with_camera_and_one_light(many(0, 0, SEED), camera) }
}

/// `count` spheres on all sides of the camera, none of which contains it.
fn crowd(count: u64, camera: Camera) -> Scene {
    const REACH: f32 = 300.0;
    let mut rng = Rng::new(SEED);
    let most = 400.0 / (count as f32).cbrt();
    let mut sphere = |_| loop {
        let centre = Vec3::from_array([(); 3].map(|()| rng.between(-REACH, REACH)));
        if (0.01 * REACH..REACH).contains(&centre.length()) {
            return Sphere { radius: most.min(0.5 * centre.length()), colour: Vec3::ONE, centre };
        }
    };
    let spheres = (0..count).map(&mut sphere).collect();
    Scene { spheres, ..with_camera_and_one_light(many(0, 0, SEED), camera) }
}

/// The experiment's sphere under `count` lights in a half circle above it, which together are as
/// bright as the experiment's one light.
fn lit(count: u64, camera: Camera) -> Scene {
    let mut scene = speedup::scene();
    scene.camera = camera;
    let light = scene.lights[0];
    let place = |index: u64| {
        let (sine, cosine) = (std::f32::consts::PI * (index as f32 + 0.5) / count as f32).sin_cos();
        Vec3::new(40.0 * cosine, 40.0 * sine, light.position.z)
    };
    let light = |index| Light { intensity: light.intensity / count as f32, position: place(index), ..light };
    scene.lights = (0..count).map(light).collect();
    scene
}

fn clear(film: FilmMut<'_>) {
    match film {
        FilmMut::F32x4(pixels) => pixels.fill(Vec4::default()),
        FilmMut::F32x3(pixels) => pixels.as_flattened_mut().fill(0.0),
        FilmMut::Rgba8(pixels) => pixels.as_flattened_mut().fill(0),
        FilmMut::Rgb8(pixels) => pixels.as_flattened_mut().fill(0),
        FilmMut::Bgra8(pixels) => pixels.fill(0),
    }
}

/// What is timed: an engine, or the loop that fills the film with zeros.
#[derive(Clone, Copy)]
enum Contestant {
    Engine(Engine, Keep),
    Zeros,
}

/// The number of lines to [`measure`]. A line is a scene and a pixel format in which one count
/// varies. A slope is fitted to points of one line, which one process times.
pub const LINES: usize = OUTPUTS.len() + SCENES.len() + 1;

/// The pictures of a line, each of which has more pixels, objects or lights than the one before.
struct Pictures {
    axis: Axis,
    name: &'static str,
    output: PixelFormat,
    /// The scenes by ascending count. Each is made when its turn comes, since large ones take much
    /// memory.
    scenes: Box<dyn Iterator<Item = Scene>>,
}

impl Pictures {
    fn new(settings: &Settings, line: usize) -> Self {
        let (width, height) = settings.size();
        let camera = in_size(&speedup::scene(), width, height).camera;
        let output = PixelFormat::Rgb8;
        if let Some(output) = OUTPUTS.get(line).copied() {
            let scenes = Box::new(settings.sizes().map(|(width, height)| in_size(&speedup::scene(), width, height)));
            Pictures { axis: Axis::Pixels, name: "sphere", output, scenes }
        } else if let Some(GrowingScene { name, make }) = SCENES.get(line - OUTPUTS.len()).copied() {
            let scenes = Box::new(settings.objects().map(move |count| make(count, camera)));
            Pictures { axis: Axis::Objects, name, output, scenes }
        } else {
            let scenes = Box::new(LIGHTS.into_iter().map(move |count| lit(count, camera)));
            Pictures { axis: Axis::Lights, name: "sphere", output, scenes }
        }
    }

    fn count(&self, scene: &Scene) -> u64 {
        match self.axis {
            Axis::Pixels => scene.camera.pixels(),
            Axis::Objects => (scene.spheres.len() + scene.triangle_count()) as u64,
            Axis::Lights => scene.lights.len() as u64,
        }
    }

    fn contestants(&self, engines: &[Engine], count: u64) -> Vec<Contestant> {
        let plans =
            |engines: &[Engine]| engines.iter().map(|engine| Contestant::Engine(*engine, Keep::NOTHING)).collect();
        let fastest = engines.last().map(std::slice::from_ref).unwrap_or_default();
        let by_force = fastest.iter().map(|engine| Contestant::Engine(*engine, Keep::all()));
        match self.axis {
            Axis::Pixels => [plans(engines), vec![Contestant::Zeros]].concat(),
            Axis::Objects if count <= MOST_BY_FORCE => [plans(fastest), by_force.collect()].concat(),
            Axis::Objects => plans(fastest),
            Axis::Lights => plans(engines),
        }
    }

    /// Times all contestants on a scene, in turns. Except where the number of pixels varies, the
    /// time includes the set-up, which is also timed by itself. None if `proceed` returns false.
    fn measure(
        &self,
        scene: &Scene,
        settings: &Settings,
        clock: &mut dyn Clock,
        proceed: &mut dyn FnMut() -> bool,
    ) -> Result<Option<Vec<Growth>>, LabError> {
        let (camera, output, count) = (scene.camera, self.output, self.count(scene));
        let contestants = self.contestants(&settings.engines, count);
        let mut cases = Vec::new();
        for contestant in &contestants {
            let Contestant::Engine(engine, keep) = *contestant else {
                cases.push(Case::new(camera, output, |_, film| clear(film)));
                continue;
            };
            let purpose = Purpose { format: Some(output), keep, ..Purpose::default() };
            let timed: &[Timed] =
                if self.axis == Axis::Pixels { &[Timed::Tracing] } else { &[Timed::Both, Timed::SetUp] };
            for timed in timed {
                cases.push(Case::of(*timed, scene, engine, purpose, output)?);
            }
        }
        let measured = Bench::default().time(clock, &cases, 0..settings.runs, proceed)?;
        let row = |(contestant, runs): (&Contestant, &[Runs])| Growth {
            axis: self.axis,
            scene: self.name.into(),
            count,
            width: camera.width(),
            height: camera.height(),
            engine: if let Contestant::Engine(engine, _) = contestant { engine.name() } else { ZEROS }.into(),
            output: output.name().into(),
            keep_all: matches!(contestant, Contestant::Engine(_, keep) if *keep != Keep::NOTHING),
            setup_cycles: runs.get(1).map(|setup| median(&setup.ticks)),
            cycles_median: median(&runs[0].ticks),
            cycles_min: minimum(&runs[0].ticks),
            samples: runs[0].ticks.clone(),
        };
        let rows =
            measured.map(|runs| contestants.iter().zip(runs.chunks(runs.len() / contestants.len())).map(row).collect());
        Ok(rows)
    }
}

/// The measurements along a line.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Growths {
    pub rows: Vec<Growth>,
    /// Whether every picture of the line was measured.
    pub complete: bool,
}

/// Measures a line picture by picture. `proceed` is called after each one; if it returns false, the
/// measurement ends there.
///
/// # Errors
/// If an engine cannot be prepared, or if there is not enough memory.
pub fn measure(
    settings: &Settings,
    line: usize,
    clock: &mut dyn Clock,
    proceed: &mut Progress<'_>,
) -> Result<Growths, LabError> {
    let mut found = Growths::default();
    let mut pictures = Pictures::new(settings, line);
    let mut before = 0;
    while let Some(scene) = pictures.scenes.next() {
        let count = pictures.count(&scene);
        // Two requested counts can give the same mesh, since not every number of triangles has an
        // icosphere.
        if std::mem::replace(&mut before, count) != count {
            let rows = pictures.measure(&scene, settings, clock, &mut || proceed(0))?;
            let Some(rows) = rows else { return Ok(found) };
            found.rows.extend(rows);
        }
        if !proceed(1) {
            return Ok(found);
        }
    }
    found.complete = true;
    Ok(found)
}

/// The rows grouped by contestant, scene and axis, each group by ascending count.
pub fn lines(rows: &[Growth]) -> Vec<Vec<&Growth>> {
    let mut lines: Vec<Vec<&Growth>> = Vec::new();
    for row in rows {
        match lines.iter_mut().find(|line| line[0].is_of(row)) {
            Some(line) => line.push(row),
            None => lines.push(vec![row]),
        }
    }
    lines
}

/// Fits a straight line to the last three points of each contestant: its slope is the cost of one
/// more object where there are many. For lights and for brute force, whose cost is linear from the
/// start, it is fitted to all points.
pub fn slopes(rows: &[Growth]) -> Vec<Slope> {
    const LAST: usize = 3;
    let slope = |line: Vec<&Growth>| {
        let all = line[0].axis == Axis::Lights || line[0].keep_all;
        let last = if all { &line[..] } else { &line[line.len().saturating_sub(LAST)..] };
        let (first, end) = (last.first()?, last.last()?);
        if first.count == end.count {
            return None;
        }
        let points: Vec<_> = last.iter().map(|row| (row.count as f64, row.cycles_min)).collect();
        let Growth { axis, scene, engine, output, keep_all, .. } = (*first).clone();
        let (from, to) = (first.count, end.count);
        Some(Slope { axis, scene, engine, output, keep_all, from, to, line: fit_line(&points) })
    };
    lines(rows).into_iter().filter_map(slope).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiments::svg::Screen;

    fn row(axis: Axis, count: u64, cycles: f64, keep_all: bool) -> Growth {
        Growth { axis, count, keep_all, cycles_min: cycles, ..Growth::default() }
    }

    #[test]
    fn slope_is_of_the_last_points_or_of_all_by_brute_force() {
        let points = [(1, 50.0), (10, 1000.0), (100, 1300.0), (1000, 4300.0), (10_000, 34_300.0)];
        let of = |axis, keep_all| {
            let rows: Vec<_> = points.iter().map(|(count, cycles)| row(axis, *count, *cycles, keep_all)).collect();
            let slopes = slopes(&rows);
            assert_eq!(slopes.len(), 1);
            slopes[0].clone()
        };
        let last = of(Axis::Objects, false);
        assert_eq!((last.from, last.to), (100, 10_000));
        assert!((last.line.slope - 10.0 / 3.0).abs() < 1e-9 && last.line.residual < 1e-9, "{:?}", last.line);
        for all in [of(Axis::Objects, true), of(Axis::Lights, false)] {
            assert_eq!((all.from, all.to), (1, 10_000));
        }
    }

    #[test]
    fn contestants_are_told_apart_and_one_point_has_no_slope() {
        let rows = [
            row(Axis::Objects, 1, 10.0, false),
            row(Axis::Objects, 1, 20.0, true),
            row(Axis::Objects, 2, 30.0, true),
            row(Axis::Lights, 1, 10.0, false),
        ];
        assert_eq!(lines(&rows).iter().map(Vec::len).collect::<Vec<_>>(), [1, 2, 1]);
        let slopes = slopes(&rows);
        assert_eq!(slopes.len(), 1);
        assert!(slopes[0].keep_all && slopes[0].line.slope == 10.0);
    }

    #[test]
    fn no_two_lines_of_a_panel_look_alike() {
        let scenes = ["spheres", "triangles", "mesh", "layers", "crowd"];
        let rows = scenes.into_iter().flat_map(|scene| {
            let of = move |count, keep_all| {
                let row = row(Axis::Objects, count, 1e6, keep_all);
                Growth { scene: scene.into(), width: 9, height: 9, cycles_median: 1e6, ..row }
            };
            [of(1, false), of(9, false), of(1, true), of(9, true)]
        });
        let figure = plot::figure(&rows.collect::<Vec<_>>(), Screen::Wide).unwrap();
        let lines = figure.lines().filter(|line| line.starts_with("<polyline") && !line.contains("#000000"));
        let looks: std::collections::BTreeSet<_> = lines.filter_map(|line| line.split("points").next()).collect();
        assert_eq!(looks.len(), 2 * scenes.len(), "{looks:?}");
    }
}
