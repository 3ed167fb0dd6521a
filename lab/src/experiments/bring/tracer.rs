//! A tracer that a user brings: its picture, its memory, and its time beside C's and ours.

use std::io;

use super::call::{Part, Session};
use super::findings::{Crash, Finding, Picture, Ratio};
use super::memory::{MemoryFaults, call_between_fences};
use super::wanted::Sample;
use super::{convention, findings::Cycles};
use crate::experiments::accuracy::subjects::shipped;
use crate::experiments::in_size;
use crate::experiments::lab::{Bench, Case, LabError, Pairs, Timed};
use crate::experiments::ops::turns::YOURS;
use crate::measure::statistics::median;
use crate::measure::{MachineClock, Runs};
use rayo::internals::kernels::fences::Side;
use rayo::internals::kernels::{Frame, Vec4, bytes, examine, sys};
use rayo::internals::plan::Packed;
use rayo::internals::render::{Engine, FilmMut, PixelFormat, Purpose};
use rayo::internals::scene::{Scene, parse};

/// The scenes that are timed: one of a sphere, one of triangles. Their pictures are compared too.
const TIMED_SCENES: [&str; 2] = ["sphere", "tetrahedron"];
/// Scenes for what these leave open, with a picture that begins at a later column, on a background.
const OTHER_SCENES: [(&str, &[u8]); 2] =
    [("overlapping", include_bytes!("overlapping.in")), ("inside", include_bytes!("inside.in"))];
/// The size of the pictures that are compared, and of those that are timed.
const COMPARED: (u32, u32) = (160, 120);
const TIMED: (u32, u32) = (408, 306);
/// How many times each contestant traces its picture.
const ROUNDS: usize = 15;

fn scene(name: &str, (width, height): (u32, u32)) -> Scene {
    let other = OTHER_SCENES.iter().find(|(other, _)| *other == name);
    let scene = other.map_or_else(|| shipped(name), |(_, text)| parse(text, name).expect("a test has read it"));
    in_size(&scene, width, height)
}

/// What is asked of a tracer: the columns of a scene from one on, on a background.
struct View {
    name: String,
    scene: Scene,
    first: u32,
    background: Vec4,
}

impl View {
    /// The whole picture of each scene that is timed, and a part of each other one.
    fn all() -> Vec<View> {
        let whole = TIMED_SCENES.map(|name| View {
            name: format!("{name}.in"),
            scene: scene(name, COMPARED),
            first: 0,
            background: Vec4::default(),
        });
        let part = |(name, _): (&str, _)| View {
            name: format!("{name}.in from column 53"),
            scene: scene(name, COMPARED),
            first: 53,
            background: Vec4::new(0.25, 0.5, 0.75),
        };
        whole.into_iter().chain(OTHER_SCENES.map(part)).collect()
    }

    fn width(&self) -> u32 {
        self.scene.camera.width() - self.first
    }

    fn height(&self) -> u32 {
        self.scene.camera.height()
    }

    /// Its pixels by one of our engines; None where that cannot run.
    fn by(&self, engine: &str) -> Option<Vec<Vec4>> {
        let engine: Engine = engine.parse().ok()?;
        let mut whole = vec![Vec4::default(); self.scene.camera.pixels() as usize];
        let plan = engine.prepare(None, &self.scene).ok()?;
        plan.light(0..self.height(), &|_, columns| columns, self.background, &mut whole);
        let rows = whole.chunks_exact(self.scene.camera.width() as usize);
        Some(rows.flat_map(|row| &row[self.first as usize..]).copied().collect())
    }

    /// Its pixels by the user's tracer, in two calls, the second of which begins at a later row.
    ///
    /// # Errors
    /// The crash of one that does not return.
    fn by_users(&self, session: &mut Session<'_>) -> Result<Vec<Vec4>, Box<Crash>> {
        let packed = Packed::new(&self.scene);
        let (first, width) = (self.first.into(), self.width().into());
        let frame = Frame { background: self.background, first, width, ..*packed.frame() };
        let count = self.width() as usize * self.height() as usize;
        // As much room behind the picture, so that a tracer that writes each row at its place in
        // the whole picture spoils nothing of ours.
        let mut pixels = vec![Vec4::from([f32::NAN; 4]); 2 * count];
        let trace = session.function.trace();
        let third = self.height() / 3;
        let (above, below) = pixels[..count].split_at_mut(third as usize * self.width() as usize);
        for (rows, out) in [(0..third, above), (third..self.height(), below)] {
            session.allow();
            let examined = examine(|| trace.call(&frame, packed.objects(), rows, out));
            session.keep_broken(examined.broken);
            if let Err(crashed) = examined.result {
                return Err(Box::new(session.crash(&crashed.crash, &Sample { arguments: Vec::new() })));
            }
        }
        pixels.truncate(count);
        Ok(pixels)
    }

    /// The user's pixels beside the reference's, and whether they have the bits of `paper`'s.
    fn compared(&self, pixels: &[Vec4]) -> Option<Picture> {
        let reference = self.by("reference")?;
        let (width, height) = (self.width(), self.height());
        let mut picture = Picture {
            scene: self.name.clone(),
            width,
            height,
            same_bits: self.by("paper").is_some_and(|paper| bytes(&paper) == bytes(pixels)),
            wrong: 0,
            // As many at the outlines as rounding may decide.
            allowed: u64::from(width + height) / 64,
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
}

/// Traces each view by checked calls, and compares the pictures with the reference's.
pub fn check_pictures(session: &mut Session<'_>) {
    for view in View::all() {
        match view.by_users(session) {
            Ok(pixels) => view.compared(&pixels).into_iter().for_each(|found| session.tell(&Finding::Picture(found))),
            Err(crash) => return session.tell(&Finding::Crash(crash)),
        }
    }
    let faults = convention::faults(session, false);
    session.tell(&Finding::Convention(faults));
}

/// All memory of a call of a tracer: the picture, without its first rows and columns, the frame,
/// the lists, and the lights, the spheres and the triangles.
fn fenced(scene: &Scene, first: u32, side: Side) -> io::Result<[Part; 6]> {
    let packed = Packed::new(scene);
    let all = packed.objects();
    let lights = Part::new("", "the lights", bytes(all.lights), 16, side)?;
    let spheres = Part::new("", "the spheres", bytes(all.spheres), 16, side)?;
    let triangles = Part::new("", "the triangles", bytes(all.triangles), 16, side)?;
    let counts = [all.lights.len(), all.spheres.len(), all.triangles.len()];
    let addresses = [&lights, &spheres, &triangles].map(Part::address);
    let lists = addresses.into_iter().zip(counts).flat_map(|(address, count)| [address, count as u64]);
    let lists: Vec<u8> = lists.flat_map(u64::to_ne_bytes).collect();
    let [width, height] = [scene.camera.width(), scene.camera.height()].map(|side| u64::from(side - first));
    let frame = Frame { first: first.into(), width, ..*packed.frame() };
    let picture = vec![0xff; size_of::<Vec4>() * (width * height) as usize];
    Ok([
        Part { before: None, ..Part::new("", "the picture", &picture, 16, side)? },
        Part::new("", "the frame", bytes(std::slice::from_ref(&frame)), 16, side)?,
        Part::new("", "the lists", &lists, 8, side)?,
        lights,
        spheres,
        triangles,
    ])
}

/// Traces small pictures with all of their memory next to guard pages, on either side.
///
/// # Errors
/// If there is no memory for them.
pub fn check_memory(session: &Session<'_>) -> io::Result<()> {
    let mut faults = MemoryFaults::default();
    let names = || TIMED_SCENES.into_iter().chain(OTHER_SCENES.map(|(name, _)| name));
    'sides: for (side, name) in Side::ALL.into_iter().flat_map(|side| names().map(move |name| (side, name))) {
        for (size, first) in [((1, 1), 0), ((3, 2), 0), ((3, 2), 1), ((16, 2), 0), ((33, 3), 1)] {
            let parts = fenced(&scene(name, size), first, side)?;
            let [out, frame, lists, ..] = parts.each_ref().map(Part::address);
            let registers = [frame, lists, first.into(), size.1.into(), out, 0];
            if !call_between_fences(session, registers, &parts, &mut faults) {
                break 'sides;
            }
        }
    }
    faults.tell(session);
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
    for name in TIMED_SCENES {
        match time_scene(session, name, &mut clock) {
            Ok((cycles, of_scene)) => {
                if name == TIMED_SCENES[0] {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_are_the_same_by_c_and_show_every_object_in_front() {
        let views = View::all();
        for view in &views {
            let (reference, paper) = (view.by("reference").unwrap(), view.by("c").unwrap());
            assert_eq!(reference.len(), paper.len());
            assert_eq!(view.compared(&reference).unwrap().wrong, 0);
            let of_c = view.compared(&paper).unwrap();
            assert!(2 * of_c.wrong <= of_c.allowed, "{of_c:?}");
        }
        // All but the last sphere and triangle, which are behind the camera.
        let hits = "reference".parse::<Engine>().unwrap().prepare(None, &views[2].scene).unwrap().hits(0..120);
        let objects: std::collections::BTreeSet<_> =
            hits.into_iter().flatten().map(|found| format!("{:?}", found.object)).collect();
        assert_eq!(objects.len(), 7, "{objects:?}");
    }
}
