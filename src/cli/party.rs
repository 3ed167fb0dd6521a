//! This process, alone or with the others that MPI started: what they agree on before they work together.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
#[cfg(feature = "mpi")]
use std::{
    env,
    ffi::OsString,
    hash::{DefaultHasher, Hash, Hasher},
    os::unix::ffi::{OsStrExt, OsStringExt},
};

use indicatif::ProgressDrawTarget;
#[cfg(feature = "mpi")]
use serde::{Serialize, de::DeserializeOwned};

use super::measuring::{pin, stop_on_signals};
use super::{Failure, remove_part_files_on_signals};
#[cfg(feature = "mpi")]
use super::{engine::VARIABLE, say, silence};
#[cfg(feature = "mpi")]
use crate::measure::cpu_name;
use crate::plan::on_all_cores;
#[cfg(feature = "mpi")]
use crate::ranks::{Pace, Ranks};
use crate::render::{Engine, Format, Frame, ImageWriter, Stats, render};
#[cfg(feature = "mpi")]
use crate::render::{Unfinished, render_by_ranks};
use crate::scene::Scene;
#[cfg(feature = "mpi")]
use crate::scene::{self, Camera};

/// Who takes part in this run.
pub struct Party {
    #[cfg(feature = "mpi")]
    ranks: Option<Ranks>,
}

impl Party {
    /// This process by itself.
    pub const ALONE: Party = Party {
        #[cfg(feature = "mpi")]
        ranks: None,
    };

    /// How many there are.
    pub fn count(&self) -> usize {
        #[cfg(feature = "mpi")]
        return self.ranks().map_or(1, Ranks::count);
        #[cfg(not(feature = "mpi"))]
        1
    }

    /// Set when the user asks for an end. That ends all ranks at once, since MPI gives them no time for what they have begun.
    pub fn stop_on_signals(&self) -> Result<Arc<AtomicBool>, Failure> {
        if self.is_alone() {
            return stop_on_signals();
        }
        remove_part_files_on_signals()?;
        Ok(Arc::default())
    }

    /// Where a bar shows how far all are, which rank 0 draws. Where MPI has started this, standard error goes through a pipe, and
    /// only standard output is a terminal: nothing else may be there, as there is if a result `is_printed` for programs.
    pub fn bar_target(&self, is_printed: bool) -> fn() -> ProgressDrawTarget {
        match (self.is_alone(), self.leads() && !is_printed) {
            (true, _) => ProgressDrawTarget::stderr,
            (false, true) => ProgressDrawTarget::stdout,
            (false, false) => ProgressDrawTarget::hidden,
        }
    }

    /// Keeps this thread on its core, so that times are of one; where MPI has started this, it has its place from there. All threads
    /// compute the truth: they are started first, or they would share the core.
    pub fn start_threads_and_pin(&self) {
        if self.is_alone() {
            on_all_cores(0, drop);
            pin();
        }
    }
}

/// The cells one after the other, until `take` says no.
fn one_by_one<T>(
    count: usize,
    mut work: impl FnMut(usize) -> Result<T, Failure>,
    mut take: impl FnMut(T, Option<&str>) -> bool,
) -> Result<bool, Failure> {
    for cell in 0..count {
        if !take(work(cell)?, None) {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Without MPI every process is alone.
#[cfg(not(feature = "mpi"))]
impl Party {
    pub fn join() -> Self {
        Party {}
    }

    pub fn is_started_alike(&self) -> Result<(), Failure> {
        Ok(())
    }

    pub fn leads(&self) -> bool {
        true
    }

    pub fn is_alone(&self) -> bool {
        true
    }

    pub fn agree<T>(&self, result: Result<T, Failure>) -> Result<T, Failure> {
        result
    }

    pub fn fastest(&self) -> Engine {
        Engine::fastest()
    }

    pub fn run_alike(&self, _: &[&str]) -> Result<(), Failure> {
        Ok(())
    }

    pub fn has_same(&self, _: &str, _: &Scene, _: &str) -> Result<(), Failure> {
        Ok(())
    }

    pub fn cells<T>(
        &self,
        count: usize,
        work: impl FnMut(usize) -> Result<T, Failure>,
        take: impl FnMut(T, Option<&str>) -> bool,
    ) -> Result<bool, Failure> {
        one_by_one(count, work, take)
    }

    pub fn begin(
        &self,
        begin: impl FnOnce(&mut dyn FnMut(&Path)) -> Result<ImageWriter, Failure>,
    ) -> Result<(Option<ImageWriter>, ()), Failure> {
        Ok((Some(begin(&mut |_| ())?), ()))
    }

    pub fn render(
        &self,
        frame: &Frame<'_>,
        _: (Format, Range<u32>),
        image: Option<&mut ImageWriter>,
        done: &(dyn Fn(u32) + Sync),
    ) -> Result<Stats, Failure> {
        render(frame, image.expect("who is alone has the file"), done).map_err(Failure::from)
    }
}

#[cfg(feature = "mpi")]
impl Party {
    /// Takes part in what MPI started, if it started anything.
    ///
    /// Whoever drops this waits until all do, and `mpirun` kills those who have not ended when one has failed: what there is to
    /// tell has to be told before.
    pub fn join() -> Self {
        let party = Party { ranks: Ranks::join() };
        if !party.leads() {
            silence();
        }
        party
    }

    /// Fails where not all are the same program, with the same arguments.
    pub fn is_started_alike(&self) -> Result<(), Failure> {
        let kernels = option_env!("RAYO_KERNELS").unwrap_or("none");
        let build = concat!(env!("CARGO_PKG_VERSION"), ", ", env!("RAYO_RUSTC"), ", kernels ");
        let build = format!("{build}{kernels}");
        self.same(build.as_bytes(), |first| {
            let first = String::from_utf8_lossy(first);
            format!("this is another build of rayo ({build}) than that of rank 0 ({first}): install one on all")
        })?;
        let engine = env::var_os(VARIABLE).filter(|engine| !engine.is_empty());
        self.same(format!("{engine:?} {:?}", env::args_os().skip(1)).as_bytes(), |_| {
            format!("this was started with other arguments, or another {VARIABLE}, than rank 0: start all alike")
        })
    }

    /// The others, if there are any.
    pub fn ranks(&self) -> Option<&Ranks> {
        self.ranks.as_ref()
    }

    /// Whether this is the one that writes and tells.
    pub fn leads(&self) -> bool {
        self.ranks().is_none_or(|ranks| ranks.rank() == 0)
    }

    /// Whether there is no other.
    pub fn is_alone(&self) -> bool {
        self.ranks.is_none()
    }

    /// The result, if none has failed: else the failure that all have, or with where it was.
    pub fn agree<T>(&self, result: Result<T, Failure>) -> Result<T, Failure> {
        let Some(ranks) = self.ranks() else { return result };
        let word = match &result {
            Ok(_) => Vec::new(),
            Err(Failure { message, status }) => format!("{status}\0{message}\0{}", Ranks::host()).into_bytes(),
        };
        let words = ranks.gather(word);
        let verdict = ranks.broadcast(verdict(&words));
        match (String::from_utf8_lossy(&verdict).split_once('\0'), result) {
            (None, result) => result,
            (Some((status, message)), _) => {
                Err(Failure { message: message.into(), status: status.parse().unwrap_or(1) })
            }
        }
    }

    /// Fails where what this one has is not what rank 0 has, with what there is to say of that.
    pub fn same(&self, mine: &[u8], message: impl FnOnce(&[u8]) -> String) -> Result<(), Failure> {
        let Some(ranks) = self.ranks() else { return Ok(()) };
        let first = ranks.broadcast(if ranks.rank() == 0 { mine.into() } else { Vec::new() });
        self.agree(if first == mine { Ok(()) } else { Err(Failure::output(message(&first))) })
    }

    /// The fastest engine that all run.
    pub fn fastest(&self) -> Engine {
        let own = Engine::fastest();
        let Some(ranks) = self.ranks() else { return own };
        let names: Vec<_> = Engine::ALL.iter().filter(|engine| engine.usable()).map(|engine| engine.name()).collect();
        let all = ranks.gather(format!("{}\0{}", names.join(","), Ranks::host()).into_bytes());
        let (common, narrower) = fastest_of_all(own.name(), &all);
        let common = ranks.broadcast(common.into_bytes());
        let engine = Engine::ALL.iter().find(|engine| engine.name().as_bytes() == common);
        let engine = engine.copied().unwrap_or(Engine::Rust);
        for who in narrower {
            say(&format!("{who} does not run {own}: all render by {engine}"));
        }
        engine
    }

    /// Fails where a rank runs other engines than rank 0: its rows would be others.
    pub fn run_alike(&self, engines: &[&str]) -> Result<(), Failure> {
        let engines = engines.join(", ");
        self.same(engines.as_bytes(), |first| {
            let first = String::from_utf8_lossy(first);
            format!("this CPU runs other engines ({engines}) than that of rank 0 ({first}): measure on CPUs that run the same")
        })
    }

    /// Has all ranks measure `count` cells: `work` measures one, in a thread of its own where there are ranks, and rank 0 hands
    /// them to `take` in order, each with the name of the CPU that its times are of where that is not rank 0's. Whether `take`
    /// has never said no, which is the end.
    pub fn cells<T: Serialize + DeserializeOwned>(
        &self,
        count: usize,
        mut work: impl FnMut(usize) -> Result<T, Failure> + Send,
        mut take: impl FnMut(T, Option<&str>) -> bool,
    ) -> Result<bool, Failure> {
        let Some(ranks) = self.ranks() else { return one_by_one(count, work, take) };
        let place = format!("rank {} on {}", ranks.rank(), Ranks::host());
        let own = cpu_name();
        let measure = |cell| {
            let measured = work(cell as usize).map_err(|failure| format!("{place}: {}", failure.message))?;
            let mut bytes = Vec::new();
            ciborium::into_writer(&(&own, measured), &mut bytes).map_err(|error| format!("{place}: {error}"))?;
            Ok(bytes)
        };
        let read = |_, bytes: Result<Vec<u8>, String>| {
            let bytes = bytes.map_err(Failure::output)?;
            let (cpu, measured): (String, T) = ciborium::from_reader(&bytes[..]).map_err(Failure::output)?;
            take(measured, (cpu != own).then_some(&cpu));
            Ok(())
        };
        self.agree(ranks.share((count as u64, Pace::CELLS), measure, read))?;
        Ok(true)
    }

    /// Fails where the scene of this name is not what it is on rank 0, with what to do.
    pub fn has_same(&self, name: &str, scene: &Scene, advice: &str) -> Result<(), Failure> {
        self.same(&digest(scene), |_| format!("{name} is another scene here than on rank 0: {advice}"))
    }

    /// The scene that `open` reads from `path`: on every rank, which must be the same; or on rank 0 alone, which sends it.
    pub fn scene(
        &self,
        path: &Path,
        broadcast: bool,
        open: impl FnOnce() -> Result<Scene, Failure>,
    ) -> Result<Scene, Failure> {
        let Some(ranks) = self.ranks() else { return open() };
        if !broadcast {
            let scene = self.agree(open())?;
            self.has_same(&path.display().to_string(), &scene, "copy it, or let --broadcast send it")?;
            return Ok(scene);
        }
        let opened = self.agree(self.leads().then(open).transpose())?;
        let text = ranks.broadcast(opened.as_ref().map_or_else(Vec::new, |scene| scene.to_text().into_bytes()));
        let beside = |scene: &Scene| [&scene.camera.film().to_le_bytes()[..], &[scene.shadows.into()]].concat();
        let beside = ranks.broadcast(opened.as_ref().map_or_else(Vec::new, beside));
        let name = ranks.broadcast(opened.as_ref().map_or_else(Vec::new, |scene| scene.name.clone().into_bytes()));
        let received = || {
            let mut scene =
                scene::parse(&text, "the scene of rank 0").map_err(|error| Failure::output(error.render(false)))?;
            let camera = scene.camera;
            let film = beside.first_chunk().map_or(1.0, |film| f32::from_le_bytes(*film));
            scene.camera =
                Camera::new(camera.width(), camera.height(), camera.focal(), film).map_err(Failure::output)?;
            scene.name = String::from_utf8_lossy(&name).into_owned();
            scene.shadows = beside.last() == Some(&1);
            Ok(scene)
        };
        self.agree(opened.map_or_else(received, Ok))
    }

    /// Begins the file that rank 0 writes; `begin` tells of its hidden file before that is there. The others know that name for
    /// as long as they keep what they are given, and remove the file if rank 0 is killed.
    pub fn begin(
        &self,
        begin: impl FnOnce(&mut dyn FnMut(&Path)) -> Result<ImageWriter, Failure>,
    ) -> Result<(Option<ImageWriter>, Option<Unfinished>), Failure> {
        let Some(ranks) = self.ranks() else { return Ok((Some(begin(&mut |_| ())?), None)) };
        if self.leads() {
            let announce = &mut |path: &Path| {
                ranks.broadcast(path.as_os_str().as_bytes().into());
                // All have heard it.
                ranks.gather(Vec::new());
            };
            let image = begin(announce);
            ranks.broadcast(Vec::new());
            return Ok((self.agree(image.map(Some))?, None));
        }
        let mut unfinished = None;
        loop {
            let path = ranks.broadcast(Vec::new());
            if path.is_empty() {
                return Ok((self.agree(Ok(None))?, unfinished));
            }
            unfinished = Some(Unfinished::at(OsString::from_vec(path).into()));
            ranks.gather(Vec::new());
        }
    }

    /// Renders rows into the file that rank 0 has.
    pub fn render(
        &self,
        frame: &Frame<'_>,
        (format, rows): (Format, Range<u32>),
        image: Option<&mut ImageWriter>,
        done: &(dyn Fn(u32) + Sync),
    ) -> Result<Stats, Failure> {
        let Some(ranks) = self.ranks() else {
            return render(frame, image.expect("who is alone has the file"), done).map_err(Failure::from);
        };
        self.agree(render_by_ranks(ranks, frame, (format, rows), image, done).map_err(Failure::from))
    }
}

/// The fastest engine that all run, and who does not run rank 0's `fastest`. Each word lists the engines of a rank, from the
/// slowest to the fastest, as [`Engine::fastest`] has them, and its host.
#[cfg(feature = "mpi")]
fn fastest_of_all(fastest: &str, words: &[Vec<u8>]) -> (String, Vec<String>) {
    let words: Vec<_> = words.iter().map(|word| String::from_utf8_lossy(word)).collect();
    let of_ranks: Vec<_> = words.iter().filter_map(|word| word.split_once('\0')).collect();
    let runs = |engines: &str, name: &str| engines.split(',').any(|own| own == name);
    let first = of_ranks.first().map_or("", |(engines, _)| *engines);
    let is_common = |name: &&str| *name != "c" && of_ranks.iter().all(|(engines, _)| runs(engines, name));
    let common = first.split(',').rev().find(is_common).unwrap_or_default();
    let narrower = (0..).zip(&of_ranks).filter(|(_, (engines, _))| !runs(engines, fastest));
    (common.into(), narrower.map(|(rank, (_, host))| format!("rank {rank} on {host}")).collect())
}

/// What tells scenes apart.
#[cfg(feature = "mpi")]
fn digest(scene: &Scene) -> [u8; 8] {
    let mut hasher = DefaultHasher::new();
    let Scene { name, camera, lights, spheres, .. } = scene;
    (name, camera.width(), camera.height(), lights.len(), spheres.len(), scene.triangle_count()).hash(&mut hasher);
    scene.shadows.hash(&mut hasher);
    let mut hash = |numbers: &[f32]| numbers.iter().for_each(|number| number.to_bits().hash(&mut hasher));
    hash(&[camera.focal(), camera.film()]);
    for light in lights {
        hash(&[light.intensity]);
        [light.colour, light.position].iter().for_each(|vector| hash(&vector.to_array()));
    }
    for sphere in spheres {
        hash(&[sphere.radius]);
        [sphere.colour, sphere.centre].iter().for_each(|vector| hash(&vector.to_array()));
    }
    for triangle in scene.all_triangles() {
        hash(&triangle.colour.to_array());
        triangle.vertices.iter().for_each(|vertex| hash(&vertex.to_array()));
    }
    hasher.finish().to_le_bytes()
}

/// What is said of failures, of which each is a status, a message and a host; nothing where there are none.
#[cfg(feature = "mpi")]
fn verdict(words: &[Vec<u8>]) -> Vec<u8> {
    let failed = |word: &Vec<u8>| {
        let word = String::from_utf8_lossy(word).into_owned();
        let (status, rest) = word.split_once('\0')?;
        let (message, host) = rest.rsplit_once('\0')?;
        Some((status.to_owned(), message.to_owned(), host.to_owned()))
    };
    let failures: Vec<_> = (0..).zip(words).filter_map(|(rank, word)| Some((rank, failed(word)?))).collect();
    let Some((rank, (status, message, host))) = failures.first() else { return Vec::new() };
    let is_common = failures.len() == words.len() && failures.iter().all(|(_, (_, other, _))| other == message);
    // What rank 0 alone does, such as writing, needs no place.
    if is_common || *rank == 0 {
        return format!("{status}\0{message}").into_bytes();
    }
    let message = message.strip_prefix("error: ").unwrap_or(message);
    let others = match failures.len() - 1 {
        0 => String::new(),
        others => format!(" ({others} more of {} ranks failed too)", words.len()),
    };
    format!("1\0rank {rank} on {host}: {message}{others}").into_bytes()
}

#[cfg(all(test, feature = "mpi"))]
mod tests {
    use super::*;

    const WIDE: &str = "reference,rust,c,paper,sse41,avx2,avx512";

    fn words(of_ranks: &[&str]) -> Vec<Vec<u8>> {
        (0..).zip(of_ranks).map(|(rank, engines)| format!("{engines}\0node{rank}").into_bytes()).collect()
    }

    #[test]
    fn ranks_on_different_cpus_choose_the_widest_engine_that_all_run_and_name_who_is_narrower() {
        let of = |fastest, of_ranks: &[&str]| fastest_of_all(fastest, &words(of_ranks));
        assert_eq!(of("avx512", &[WIDE, WIDE]), ("avx512".into(), vec![]));
        let narrow = "reference,rust,c,paper,sse41,avx2";
        assert_eq!(of("avx512", &[WIDE, narrow, WIDE]), ("avx2".into(), vec!["rank 1 on node1".into()]));
        // Where rank 0 is the narrower one, nobody lacks what it runs.
        assert_eq!(of("avx2", &[narrow, WIDE]), ("avx2".into(), vec![]));
        let both = ["rank 1 on node1".to_owned(), "rank 2 on node2".to_owned()];
        assert_eq!(of("avx512", &[WIDE, "reference,rust,c", "reference,rust"]), ("rust".into(), both.to_vec()));
    }

    #[test]
    fn a_failure_of_some_ranks_names_the_first_and_one_of_all_is_told_as_by_one_process() {
        let fine = Vec::new();
        let failed = |host: &str| format!("2\0there is no scene\0{host}").into_bytes();
        let text = |words: &[Vec<u8>]| String::from_utf8(verdict(words)).unwrap();
        assert_eq!(text(&[fine.clone(), fine.clone()]), "");
        assert_eq!(text(&[failed("a"), failed("b")]), "2\0there is no scene");
        assert_eq!(text(&[fine.clone(), failed("b"), fine.clone()]), "1\0rank 1 on b: there is no scene");
        assert_eq!(
            text(&[fine, failed("b"), failed("c")]),
            "1\0rank 1 on b: there is no scene (1 more of 3 ranks failed too)"
        );
    }
}
