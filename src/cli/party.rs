//! This process alone, or with the others that MPI started: what they agree on before they work together.

use std::ops::Range;
#[cfg(feature = "mpi")]
use std::{
    hash::{DefaultHasher, Hash, Hasher},
    path::Path,
};

use super::Failure;
use super::render::failure;
#[cfg(feature = "mpi")]
use super::{say, silence};
#[cfg(feature = "mpi")]
use crate::ranks::Ranks;
use crate::render::{Engine, Format, Frame, ImageWriter, Stats, render};
#[cfg(feature = "mpi")]
use crate::render::{Unfinished, render_by_ranks};
#[cfg(feature = "mpi")]
use crate::scene::{self, Camera, Scene};

/// Who takes part in this run.
pub struct Party {
    #[cfg(feature = "mpi")]
    ranks: Option<Ranks>,
}

/// Without MPI every process is alone.
#[cfg(not(feature = "mpi"))]
impl Party {
    pub fn join() -> Result<Self, Failure> {
        Ok(Party {})
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

    pub fn render(
        &self,
        frame: &Frame<'_>,
        _: (Format, Range<u32>),
        image: Option<&mut ImageWriter>,
        done: &(dyn Fn(u32) + Sync),
    ) -> Result<Stats, Failure> {
        render(frame, image.expect("who is alone has the file"), done).map_err(failure)
    }
}

#[cfg(feature = "mpi")]
impl Party {
    /// Takes part in what MPI started, if it started anything.
    ///
    /// # Errors
    /// If not all are the same program.
    pub fn join() -> Result<Self, Failure> {
        let party = Party { ranks: Ranks::join() };
        if !party.leads() {
            silence();
        }
        let kernels = option_env!("RAYO_KERNELS").unwrap_or("none");
        let build = concat!(env!("CARGO_PKG_VERSION"), ", ", env!("RAYO_RUSTC"), ", kernels ");
        let build = format!("{build}{kernels}");
        party.same(build.as_bytes(), |first| {
            let first = String::from_utf8_lossy(first);
            format!("this is another build of rayo ({build}) than that of rank 0 ({first}): install one on all")
        })?;
        Ok(party)
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
        let usable = |name: &[u8]| Engine::ALL.iter().find(|engine| engine.name().as_bytes() == name).copied();
        let names: Vec<_> = Engine::ALL.iter().filter(|engine| engine.usable()).map(|engine| engine.name()).collect();
        let all = ranks.gather(format!("{}\0{}", names.join(","), Ranks::host()).into_bytes());
        let all: Vec<_> = all.iter().map(|word| String::from_utf8_lossy(word).into_owned()).collect();
        let runs = |word: &str, name: &str| word.split(['\0', ',']).any(|own| own == name);
        // Listed from the slowest to the fastest, as in Engine::fastest.
        let common = names.iter().rev().find(|name| **name != "c" && all.iter().all(|word| runs(word, name)));
        let common = ranks.broadcast(common.map_or_else(Vec::new, |name| name.as_bytes().into()));
        let engine = usable(&common).unwrap_or(Engine::Rust);
        for (rank, word) in all.iter().enumerate().filter(|(_, word)| !runs(word, own.name())) {
            let host = word.rsplit('\0').next().unwrap_or_default();
            say(&format!("rank {rank} on {host} does not run {own}: all render by {engine}"));
        }
        engine
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
            self.same(&digest(&scene), |_| {
                format!("{} is another scene here than on rank 0: copy it, or let --broadcast send it", path.display())
            })?;
            return Ok(scene);
        }
        let opened = self.agree(self.leads().then(open).transpose())?;
        let text = ranks.broadcast(opened.as_ref().map_or_else(Vec::new, |scene| scene.to_text().into_bytes()));
        let film =
            ranks.broadcast(opened.as_ref().map_or_else(Vec::new, |scene| scene.camera.film().to_le_bytes().into()));
        let name = ranks.broadcast(opened.as_ref().map_or_else(Vec::new, |scene| scene.name.clone().into_bytes()));
        let received = || {
            let mut scene =
                scene::parse(&text, "the scene of rank 0").map_err(|error| Failure::output(error.render(false)))?;
            let camera = scene.camera;
            let film = film.first_chunk().map_or(1.0, |film| f32::from_le_bytes(*film));
            scene.camera =
                Camera::new(camera.width(), camera.height(), camera.focal(), film).map_err(Failure::output)?;
            scene.name = String::from_utf8_lossy(&name).into_owned();
            Ok(scene)
        };
        self.agree(opened.map_or_else(received, Ok))
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
            return render(frame, image.expect("who is alone has the file"), done).map_err(failure);
        };
        // Whoever is left when rank 0 is killed removes its hidden file.
        let path = image.as_ref().and_then(|image| image.unfinished()?.canonicalize().ok()).unwrap_or_default();
        let path = ranks.broadcast(path.into_os_string().into_encoded_bytes());
        let path = String::from_utf8_lossy(&path).into_owned();
        let _unfinished = (!self.leads() && !path.is_empty()).then(|| Unfinished::new(Path::new(&path)));
        self.agree(render_by_ranks(ranks, frame, (format, rows), image, done).map_err(failure))
    }
}

/// What tells scenes apart.
#[cfg(feature = "mpi")]
fn digest(scene: &Scene) -> [u8; 8] {
    let mut hasher = DefaultHasher::new();
    let Scene { camera, lights, spheres, triangles, .. } = scene;
    (camera.width(), camera.height(), lights.len(), spheres.len(), triangles.len()).hash(&mut hasher);
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
    for triangle in triangles {
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
