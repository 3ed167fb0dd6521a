//! A tracer that a user brings: its picture, its memory, and its time beside C's and ours.

use std::io;

use super::call::{SIGPROF, Session};
use super::findings::{Fault, Finding, Picture, Ratio};
use super::memory::{beyond, distance};
use super::wanted::Sample;
use super::{convention, findings::Cycles};
use crate::experiments::accuracy::subjects::shipped;
use crate::experiments::in_size;
use crate::experiments::lab::{Bench, Case, LabError, Pairs, Timed};
use crate::experiments::ops::turns::YOURS;
use crate::measure::statistics::median;
use crate::measure::{MachineClock, Runs};
use rayo::internals::kernels::fences::{Fenced, Side};
use rayo::internals::kernels::{Vec4, bytes, sys};
use rayo::internals::plan::Packed;
use rayo::internals::render::{Engine, Film, FilmMut, PixelFormat, Purpose};
use rayo::internals::scene::Scene;

/// The scenes that are traced: one of a sphere, one of triangles.
const SCENES: [&str; 2] = ["sphere", "tetrahedron"];
/// The size of the pictures that are compared, and of those that are timed.
const COMPARED: (u32, u32) = (160, 120);
const TIMED: (u32, u32) = (408, 306);
/// Pixels behind a picture that a tracer may write over without harm.
const ROOM: usize = 64;
/// How many times each contestant traces its picture.
const ROUNDS: usize = 15;

fn scene(name: &str, (width, height): (u32, u32)) -> Scene {
    in_size(&shipped(name), width, height)
}

/// A picture in floats by one of our engines.
fn picture_by(engine: &str, scene: &Scene) -> Option<Vec<Vec4>> {
    let engine: Engine = engine.parse().ok()?;
    let mut film = Film::new(PixelFormat::F32x4, scene.camera.pixels() as usize).ok()?;
    engine.prepare(None, scene).ok()?.rows(0..scene.camera.height(), film.as_mut());
    match film.as_mut() {
        FilmMut::F32x4(pixels) => Some(pixels.to_vec()),
        _ => None,
    }
}

/// Traces each scene by checked calls, and compares the pictures with the reference's.
pub fn check_pictures(session: &mut Session<'_>) {
    for name in SCENES {
        let scene = scene(name, COMPARED);
        let packed = Packed::new(&scene);
        // Room behind the picture, so that what is written there spoils nothing of ours.
        let count = scene.camera.pixels() as usize;
        let mut room = vec![Vec4::from([f32::NAN; 4]); count + ROOM];
        let pixels = &mut room[..count];
        let trace = session.function.trace();
        let rows = 0..scene.camera.height();
        let examined = rayo::internals::kernels::examine(|| trace.call(packed.frame(), packed.objects(), rows, pixels));
        for rule in examined.broken.into_iter().flat_map(|call| call.broken) {
            if !session.broken.contains(&rule) {
                session.broken.push(rule);
            }
        }
        if let Err(crashed) = examined.result {
            let crash = session.crash(&crashed.crash, &Sample { arguments: Vec::new() });
            return session.tell(&Finding::Crash(Box::new(crash)));
        }
        if let Some(picture) = compared(name, &scene, pixels) {
            session.tell(&Finding::Picture(picture));
        }
    }
    let faults = convention::faults(session, false);
    session.tell(&Finding::Convention(faults));
}

/// A picture beside the reference's, and whether it has the bits of `paper`'s.
fn compared(name: &str, scene: &Scene, pixels: &[Vec4]) -> Option<Picture> {
    let reference = picture_by("reference", scene)?;
    let width = scene.camera.width();
    let mut picture = Picture {
        scene: format!("{name}.in"),
        width,
        height: scene.camera.height(),
        same_bits: picture_by("paper", scene).is_some_and(|paper| bytes(&paper) == bytes(pixels)),
        wrong: 0,
        // As many at the outlines as rounding may decide.
        allowed: u64::from(width + scene.camera.height()) / 64,
        largest: 0.0,
        at: None,
    };
    for (index, (ours, theirs)) in reference.iter().zip(pixels).enumerate() {
        let off = |(a, b): (f32, f32)| if b.is_nan() { f32::INFINITY } else { (a - b).abs() };
        let lanes = ours.lanes().into_iter().zip(theirs.lanes()).take(3);
        let difference = f64::from(lanes.map(off).fold(0.0, f32::max));
        picture.wrong += u64::from(difference > 1.0 / 255.0);
        if difference > picture.largest {
            picture.largest = difference;
            picture.at = Some((index as u32 % width, index as u32 / width));
        }
    }
    Some(picture)
}

/// All memory of a call of a tracer, each list of it next to a guard page.
struct FencedScene {
    frame: Fenced,
    lists: Fenced,
    out: Fenced,
    /// The lights, the spheres and the triangles.
    objects: [Fenced; 3],
    rows: u64,
}

impl FencedScene {
    fn new(scene: &Scene, side: Side) -> io::Result<Self> {
        let packed = Packed::new(scene);
        let all = packed.objects();
        let fenced = |bytes: &[u8]| Fenced::new(bytes, 16, side);
        let objects = [fenced(bytes(all.lights))?, fenced(bytes(all.spheres))?, fenced(bytes(all.triangles))?];
        let counts = [all.lights.len(), all.spheres.len(), all.triangles.len()];
        let lists = objects.iter().zip(counts).flat_map(|(list, count)| [list.address() as u64, count as u64]);
        let lists: Vec<u8> = lists.flat_map(u64::to_ne_bytes).collect();
        Ok(FencedScene {
            frame: fenced(bytes(std::slice::from_ref(packed.frame())))?,
            lists: Fenced::new(&lists, 8, side)?,
            out: fenced(&vec![0xff; size_of::<Vec4>() * scene.camera.pixels() as usize])?,
            objects,
            rows: scene.camera.height().into(),
        })
    }

    fn registers(&self) -> [u64; 6] {
        let [frame, lists, out] = [&self.frame, &self.lists, &self.out].map(|place| place.address() as u64);
        [frame, lists, 0, self.rows, out, 0]
    }

    /// Its parts by name.
    fn parts(&self) -> [(&'static str, &Fenced); 6] {
        let [lights, spheres, triangles] = &self.objects;
        [
            ("the picture", &self.out),
            ("the frame", &self.frame),
            ("the lists", &self.lists),
            ("the lights", lights),
            ("the spheres", spheres),
            ("the triangles", triangles),
        ]
    }
}

/// Traces small pictures with all of their memory next to guard pages, on either side.
///
/// # Errors
/// If there is no memory for them.
pub fn check_memory(session: &mut Session<'_>) -> io::Result<()> {
    let mut faults: Vec<Fault> = Vec::new();
    let mut add = |fault: Fault| {
        if !faults.contains(&fault) {
            faults.push(fault);
        }
    };
    for (side, name) in Side::ALL.into_iter().flat_map(|side| SCENES.map(|name| (side, name))) {
        for size in [(1, 1), (3, 2), (16, 2), (33, 3)] {
            let places = FencedScene::new(&scene(name, size), side)?;
            let outcome = session.function.examine(places.registers());
            let is_late = outcome.crash.as_ref().is_some_and(|crashed| crashed.crash.signal == SIGPROF);
            if let Some(crashed) = outcome.crash {
                add(beyond(session, &crashed.crash, &places.parts()));
            }
            for (name, part) in places.parts() {
                if let Some(place) = part.spoiled() {
                    add(Fault::new(format!("writes beside {name}: {}", distance(place, part.len()))));
                }
            }
            if is_late {
                session.tell(&Finding::Memory(faults));
                return Ok(());
            }
        }
    }
    session.tell(&Finding::Memory(faults));
    Ok(())
}

/// Times the tracer beside C's and the paper's, in turns, and reports the ratios.
pub fn time(session: &Session<'_>) {
    let Some(mut clock) = MachineClock::counter() else {
        return session.tell(&Finding::Undone("cycles: this machine has no time-stamp counter".into()));
    };
    // Failing to pin the thread makes the figures noisier, not wrong.
    let _ = sys::pin_to_this_core();
    let mut ratios = Vec::new();
    for name in SCENES {
        match time_scene(session, name, &mut clock) {
            Ok((cycles, of_scene)) => {
                if name == SCENES[0] {
                    session.tell(&Finding::Cycles(cycles));
                }
                ratios.extend(of_scene);
            }
            Err(error) => session.tell(&Finding::Undone(format!("cycles: {error}"))),
        }
    }
    session.tell(&Finding::Ratios(ratios));
}

fn time_scene(
    session: &Session<'_>,
    name: &str,
    clock: &mut MachineClock,
) -> Result<(Vec<Cycles>, Vec<Ratio>), LabError> {
    let scene = scene(name, TIMED);
    let packed = Packed::new(&scene);
    let trace = session.function.trace();
    let yours = Case::new(scene.camera, PixelFormat::F32x4, |rows, film| {
        let FilmMut::F32x4(out) = film else { unreachable!("it has the format of the case") };
        trace.call(packed.frame(), packed.objects(), rows, out);
    });
    let (mut names, mut cases) = (vec![YOURS], vec![yours]);
    for (engine, contestant) in [("c", "c-O3"), ("paper", "paper")] {
        let Some(engine) = Engine::ALL.iter().find(|known| known.name() == engine && known.usable()) else { continue };
        cases.push(Case::of(Timed::Tracing, &scene, *engine, Purpose::default(), PixelFormat::F32x4)?);
        names.push(contestant);
    }
    let runs = Bench::default().time(clock, &cases, 0..ROUNDS, &mut || true)?.expect("nobody stops it");
    let per_pixel = |runs: &Runs| median(&runs.ticks) / scene.camera.pixels() as f64;
    let cycles = names.iter().zip(&runs).map(|(name, runs)| Cycles {
        contestant: (*name).into(),
        latency: Some(per_pixel(runs)),
        throughput: None,
        executed: None,
    });
    let ratio = |what: &str, a: usize, b: usize| {
        let estimate = Pairs::of(&runs[a], &runs[b]).estimate(1);
        let (ratio, low, high) = (estimate.value, estimate.low, estimate.high);
        Ratio { scene: format!("{name}.in"), what: what.into(), ratio, low, high, per_pixel: per_pixel(&runs[0]) }
    };
    let place = |name: &str| names.iter().position(|known| *known == name);
    let against_c = place("c-O3").map(|c| ratio("C/yours", c, 0));
    let against_paper = place("paper").map(|paper| ratio("yours/paper", 0, paper));
    Ok((cycles.collect(), against_c.into_iter().chain(against_paper).collect()))
}
