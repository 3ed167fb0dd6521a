//! What a picture costs the packets as it grows: in pixels, in objects, in lights; and the slopes.

pub mod plot;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::claims::Axis;
use super::in_size;
use super::lab::{Bench, Case, LabError, Progress, Timed};
use super::speedup;
use crate::kernels::Vec4;
use crate::measure::Name;
use crate::measure::statistics::{Line, fit_line, median, minimum};
use crate::measure::{Clock, Machine, Runs};
use crate::plan::Keep;
use crate::render::{Engine, FilmMut, PixelFormat, Purpose};
use crate::scene::mesh::shapes;
use crate::scene::{Camera, Light, MeshFormat, Rng, Scene, Setting, Sphere, Triangle, many};

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
/// One to ten million objects, each about the root of ten times as many as the last.
const OBJECTS: [u64; 15] =
    [1, 3, 10, 32, 100, 316, 1_000, 3_162, 10_000, 31_623, 100_000, 316_228, 1_000_000, 3_162_278, 10_000_000];
/// More than this are not traced by brute force.
const MOST_BY_FORCE: u64 = 1_000;
/// One to 64 lights.
const LIGHTS: [u64; 7] = [1, 2, 4, 8, 16, 32, 64];
/// The pictures along the axes of objects and lights.
const SIZE: (u32, u32) = (1632, 1224);
const QUICK_SIZE: (u32, u32) = (204, 153);
/// A quick run goes no further than this, in pixels and in objects.
const QUICK_PIXELS: u64 = 1_000_000;
const QUICK_OBJECTS: u64 = 10_000;
/// Runs of every picture.
pub const RUNS: usize = 9;
/// The same of a quick run.
pub const QUICK_RUNS: usize = 2;
const SEED: u64 = 7;
/// How far the mesh's corners are from a sphere, as a share of its radius.
const BUMPS: f64 = 0.3;

/// The name of the contestant that only fills the film with zeros, by plain stores.
pub const ZEROS: &str = "zeros";

#[derive(Clone, Debug)]
pub struct Settings {
    /// Small pictures, few objects.
    pub quick: bool,
    pub runs: usize,
    /// The packet engines; the last of them, which is the fastest, traces all objects.
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

    /// How many times [`measure`] of all lines calls `proceed` with the work 1.
    pub fn work(&self) -> u64 {
        let pixels = self.sizes().count() * OUTPUTS.len();
        (pixels + self.objects().count() * SCENES.len() + LIGHTS.len()) as u64
    }
}

/// What pixels are written as along the axis of pixels.
const OUTPUTS: [PixelFormat; 4] = PixelFormat::ALL;

/// What is along the axis of objects: a name, and the scene of so many.
type Make = fn(u64, Camera) -> Scene;
const SCENES: [(&str, Make); 5] =
    [("spheres", spheres), ("triangles", triangles), ("mesh", mesh), ("layers", layers), ("crowd", crowd)];

/// A contestant in a picture. The field names are those of the JSON document.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Growth {
    pub axis: Axis,
    pub scene: Name,
    /// How much there is of what is varied.
    pub count: u64,
    pub width: u32,
    pub height: u32,
    /// The engine, or [`ZEROS`].
    pub engine: Name,
    pub output: Name,
    pub keep_all: bool,
    /// The CPU that the cycles are of, where that is not the document's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cpu: Option<String>,
    /// Median TSC cycles of the set-up, from the parsed scene to the first ray; None where it is not in the time below.
    pub setup_cycles: Option<f64>,
    /// TSC cycles of the picture: the median.
    pub cycles_median: f64,
    /// The same: the minimum.
    pub cycles_min: f64,
    /// Cycles of every run.
    pub samples: Vec<f64>,
}

impl Growth {
    pub fn pixels(&self) -> f64 {
        f64::from(self.width) * f64::from(self.height)
    }

    /// Median cycles by the pixel.
    pub fn cycles_per_pixel(&self) -> f64 {
        self.cycles_median / self.pixels()
    }

    fn is_of(&self, other: &Growth) -> bool {
        fn who(row: &Growth) -> (Axis, &str, &str, &str, bool) {
            (row.axis, &*row.scene, &*row.engine, &*row.output, row.keep_all)
        }
        who(self) == who(other)
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
    /// The least count that the line goes through.
    pub from: u64,
    /// The greatest.
    pub to: u64,
    /// Through the fastest pictures; its slope is in TSC cycles by the pixel, object or light.
    pub line: Line,
}

/// Everything that was measured, where, and with what; `docs/complexity.schema.json` is its schema.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Complexity {
    pub machine: Machine,
    pub runs: usize,
    pub complete: bool,
    pub rows: Vec<Growth>,
    pub slopes: Vec<Slope>,
}

impl Complexity {
    /// The document of what was measured.
    pub fn new(machine: Machine, settings: &Settings, complete: bool, rows: Vec<Growth>) -> Self {
        Complexity { machine, runs: settings.runs, complete, slopes: slopes(&rows), rows }
    }
}

/// `count` spheres all over the picture.
fn spheres(count: u64, camera: Camera) -> Scene {
    scattered(many(count as usize, 0, SEED), camera)
}

/// `count` triangles all over the picture.
fn triangles(count: u64, camera: Camera) -> Scene {
    scattered(many(0, count as usize, SEED), camera)
}

fn scattered(mut scene: Scene, camera: Camera) -> Scene {
    scene.camera = camera;
    scene.lights.truncate(1);
    scene
}

/// A closed, bumpy mesh of about `count` triangles that fills the picture's height.
pub(super) fn mesh(count: u64, camera: Camera) -> Scene {
    let mesh = shapes::icosphere(count, BUMPS, SEED);
    let setting = Setting::of(&mesh, MeshFormat::Obj, &camera);
    let scene = setting.and_then(|setting| setting.scene(mesh, Vec3::ONE, "mesh.png".into(), camera));
    scene.expect("the shapes are of ordinary size")
}

/// `count` triangles that each fill the picture and are parallel to it, in no order of depth.
fn layers(count: u64, camera: Camera) -> Scene {
    let mut rng = Rng::new(SEED);
    let mut layer = |_| {
        let depth = rng.between(100.0, 300.0);
        // Their edges are as far from the axis as the depth, the picture's corners half of that.
        let corners = [(2.0, 0.0), (-1.0, 1.75), (-1.0, -1.75)];
        let vertices = corners.map(|(x, y)| depth * Vec3::new(x, y, 1.0));
        Triangle { colour: Vec3::ONE, vertices }
    };
    let triangles = (0..count).map(&mut layer).collect();
    Scene { triangles, ..scattered(many(0, 0, SEED), camera) }
}

/// `count` spheres all round the camera, beside it and behind it, none of them around it.
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
    Scene { spheres, ..scattered(many(0, 0, SEED), camera) }
}

/// The experiment's sphere under `count` lights in a half circle above it, together as strong as its one.
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
    }
}

/// Who traces, or fills.
#[derive(Clone, Copy)]
enum Who {
    Engine(Engine, Keep),
    Zeros,
}

/// How many lines [`measure`] has: an axis of a scene and an output is one, so that one clock times what slopes go through.
pub const LINES: usize = OUTPUTS.len() + SCENES.len() + 1;

/// Pictures of which one has more of something than the one before.
struct Pictures {
    axis: Axis,
    name: &'static str,
    output: PixelFormat,
    /// From the least to the greatest; a scene is made when its turn comes.
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
        } else if let Some((name, make)) = SCENES.get(line - OUTPUTS.len()).copied() {
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

    fn who(&self, engines: &[Engine], count: u64) -> Vec<Who> {
        let plans = |engines: &[Engine]| engines.iter().map(|engine| Who::Engine(*engine, Keep::NOTHING)).collect();
        let fastest = engines.last().map(std::slice::from_ref).unwrap_or_default();
        let by_force = fastest.iter().map(|engine| Who::Engine(*engine, Keep::all()));
        match self.axis {
            Axis::Pixels => [plans(engines), vec![Who::Zeros]].concat(),
            Axis::Objects if count <= MOST_BY_FORCE => [plans(fastest), by_force.collect()].concat(),
            Axis::Objects => plans(fastest),
            Axis::Lights => plans(engines),
        }
    }

    /// Everybody in a scene, in turns; all but along the axis of pixels with the set-up. None where `proceed` says no.
    fn measure(
        &self,
        scene: &Scene,
        settings: &Settings,
        clock: &mut dyn Clock,
        proceed: &mut dyn FnMut() -> bool,
    ) -> Result<Option<Vec<Growth>>, LabError> {
        let (camera, output, count) = (scene.camera, self.output, self.count(scene));
        let who = self.who(&settings.engines, count);
        let mut cases = Vec::new();
        for who in &who {
            let Who::Engine(engine, keep) = *who else {
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
        let row = |(who, runs): (&Who, &[Runs])| Growth {
            axis: self.axis,
            scene: self.name.into(),
            count,
            width: camera.width(),
            height: camera.height(),
            engine: if let Who::Engine(engine, _) = who { engine.name() } else { ZEROS }.into(),
            output: output.name().into(),
            keep_all: matches!(who, Who::Engine(_, keep) if *keep != Keep::NOTHING),
            cpu: None,
            setup_cycles: runs.get(1).map(|setup| median(&setup.ticks)),
            cycles_median: median(&runs[0].ticks),
            cycles_min: minimum(&runs[0].ticks),
            samples: runs[0].ticks.clone(),
        };
        let rows = measured.map(|runs| who.iter().zip(runs.chunks(runs.len() / who.len())).map(row).collect());
        Ok(rows)
    }
}

/// What was measured along a line.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Measured {
    pub rows: Vec<Growth>,
    /// Whether it has come to the end.
    pub complete: bool,
}

/// Measures a line picture by picture; `proceed` hears of each, and where it says no that was all.
///
/// # Errors
/// An engine that cannot be prepared, or no memory.
pub fn measure(
    settings: &Settings,
    line: usize,
    clock: &mut dyn Clock,
    proceed: &mut Progress<'_>,
) -> Result<Measured, LabError> {
    let mut found = Measured::default();
    let mut pictures = Pictures::new(settings, line);
    let mut before = 0;
    while let Some(scene) = pictures.scenes.next() {
        let count = pictures.count(&scene);
        // A mesh has as many triangles as its shape admits.
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

/// The rows of each contestant along each axis, in ascending order of what is varied.
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

/// The line through the last three points of each contestant: what one more costs where there are many. Along the axis of
/// lights, and by brute force, through all points.
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
    fn a_slope_is_that_of_the_last_three_points_and_by_brute_force_of_all() {
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
