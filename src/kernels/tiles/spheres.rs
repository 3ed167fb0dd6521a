//! The tile kernels of spheres: from centre and radius to planes, and what those look like that are seen.

use super::*;

/// Spheres, and which of them a chunk is.
#[derive(Clone, Copy)]
pub struct Spheres<'a> {
    /// All spheres of the scene.
    pub balls: &'a [Ball],
    /// The first [`CHUNK`] of them, or as many as there are, are the chunk; the next ones are fetched ahead.
    pub seen: &'a [Seen],
}

impl Spheres<'_> {
    /// What both kinds of set-up share: those of the chunk, turned round, and nothing to write.
    fn task(self, turned: &mut Balls) -> SetupTask {
        let Spheres { balls, seen } = self;
        let (seen, ahead) = chunk_of(seen, balls.len());
        SetupTask {
            objects: balls.as_ptr().cast(),
            seen: seen.as_ptr(),
            count: seen.len() as u64,
            ahead,
            turned: std::ptr::from_mut(turned).cast(),
            planes: std::ptr::null_mut(),
            shades: std::ptr::null_mut(),
            shorts: std::ptr::null_mut(),
            lights: std::ptr::null(),
            light_count: 0,
            first_id: 0,
        }
    }
}

/// Turns spheres into planes over their own pixels.
pub struct SphereSetUp<E> {
    pub(in crate::kernels) code: unsafe extern "sysv64" fn(*const SphereView<f64>, *const SetupTask),
    pub(in crate::kernels) symbol: &'static str,
    pub(in crate::kernels) writes: PhantomData<E>,
}

impl<E: Element> SphereSetUp<E> {
    /// The symbol of its code.
    pub fn symbol(&self) -> &'static str {
        self.symbol
    }

    calls! {
        /// Sets up a chunk of spheres in `buffers`, of which the first is number `first_id` in the tile.
        (SphereView<f64>, spheres: Spheres<'_>, first_id: usize, buffers: &mut TileBuffers<E>) with ()
    }

    /// The ids are those of spheres; the buffers have room for a chunk, and so for the last packet of one.
    fn task(spheres: Spheres<'_>, first_id: usize, buffers: &mut TileBuffers<E>, (): &mut ()) -> SetupTask {
        let chunk = &mut buffers.spheres;
        let task = spheres.task(&mut chunk.turned);
        chunk.count = task.count as usize;
        buffers.most = buffers.most.max(first_id + chunk.count - 1);
        SetupTask { planes: std::ptr::from_mut(&mut *chunk.planes).cast(), first_id: first_id as u64, ..task }
    }
}

/// What shading needs to know of the spheres that have a pixel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SphereRecords<E> {
    /// A record for each.
    pub spheres: Vec<TileSphere<E>>,
    /// As many for each as there are lights.
    pub lits: Vec<Lit<E>>,
    /// As many.
    pub shorts: Vec<ShortLit<E>>,
}

impl<E: Element> SphereRecords<E> {
    /// Room for so many spheres and so many lights for each.
    fn hold(&mut self, spheres: usize, lights: usize) {
        fn grow<T: Plain>(records: &mut Vec<T>, len: usize) {
            records.resize(records.len().max(len), T::ZERO);
        }
        grow(&mut self.spheres, spheres);
        // As many as there are records, whatever they were made for.
        let lits = self.spheres.len() * lights;
        grow(&mut self.lits, lits);
        grow(&mut self.shorts, lits);
    }
}

/// Turns spheres into what shades them.
pub struct SphereLooks<E> {
    pub(in crate::kernels) code: unsafe extern "sysv64" fn(*const SphereView<f64>, *const SetupTask),
    pub(in crate::kernels) symbol: &'static str,
    pub(in crate::kernels) writes: PhantomData<E>,
}

impl<E: Element> SphereLooks<E> {
    /// The symbol of its code.
    pub fn symbol(&self) -> &'static str {
        self.symbol
    }

    calls! {
        /// Makes the records of a chunk of spheres, from number `first` on, under these lights; if `short`, in the short form
        /// where it is accurate enough, and otherwise in the long one.
        (
            SphereView<f64>, spheres: Spheres<'_>, lights: &[TileLight<f64>], short: bool, first: usize,
            records: &mut SphereRecords<E>
        ) with Balls::ZERO
    }

    /// The ids are those of spheres, and there is room for the records.
    fn task(
        spheres: Spheres<'_>,
        lights: &[TileLight<f64>],
        short: bool,
        first: usize,
        records: &mut SphereRecords<E>,
        turned: &mut Balls,
    ) -> SetupTask {
        let task = spheres.task(turned);
        // The last packet writes as many as it has lanes.
        records.hold(first + task.count as usize + MOST_SET_UP, lights.len());
        let before = first * lights.len();
        SetupTask {
            planes: records.spheres[first..].as_mut_ptr().cast(),
            shades: records.lits[before..].as_mut_ptr().cast(),
            shorts: if short { records.shorts[before..].as_mut_ptr().cast() } else { std::ptr::null_mut() },
            lights: lights.as_ptr(),
            light_count: lights.len() as u64,
            ..task
        }
    }
}
