//! The tile kernels of spheres: from centre and radius to planes, who is nearest, and what those look like that are seen.

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

    /// Sets up a chunk of spheres in `buffers`, of which the first is number `first_id` in the tile.
    pub fn call(&self, view: &SphereView<f64>, spheres: Spheres<'_>, first_id: usize, buffers: &mut TileBuffers<E>) {
        let task = Self::task(spheres, first_id, buffers);
        // SAFETY: task() proves that the ids are those of spheres; the buffers have room for a chunk, and so for the last
        // packet of one; the references prove the rest. The CPU as in Bounds.
        unsafe { (self.code)(view, &task) }
    }

    /// As [`SphereSetUp::call`], with a look at whether the kernel keeps the calling convention.
    pub fn call_checked(
        &self,
        view: &SphereView<f64>,
        spheres: Spheres<'_>,
        first_id: usize,
        buffers: &mut TileBuffers<E>,
    ) -> Result<(), Vec<Fault>> {
        let task = Self::task(spheres, first_id, buffers);
        let args = [std::ptr::from_ref(view) as u64, std::ptr::from_ref(&task) as u64, 0, 0, 0, 0];
        // SAFETY: as in call; these are the arguments of its signature.
        unsafe { checked::call(self.code as *const (), args) }
    }

    fn task(spheres: Spheres<'_>, first_id: usize, buffers: &mut TileBuffers<E>) -> SetupTask {
        let task = spheres.task(&mut buffers.balls);
        buffers.sphere_count = task.count as usize;
        buffers.most = buffers.most.max(first_id + buffers.sphere_count - 1);
        SetupTask { planes: std::ptr::from_mut(&mut *buffers.sphere_planes).cast(), first_id: first_id as u64, ..task }
    }
}

/// Finds the nearest of spheres.
pub struct NearestSpheres<E> {
    pub(in crate::kernels) code: unsafe extern "sysv64" fn(*const SpherePlanes<E>, *const NearestTask),
    pub(in crate::kernels) symbol: &'static str,
}

impl<E: Element> NearestSpheres<E> {
    /// The symbol of its code.
    pub fn symbol(&self) -> &'static str {
        self.symbol
    }

    /// As [`NearestTriangles::call`], of the spheres that were set up last.
    pub fn call(&self, buffers: &mut TileBuffers<E>, order: &[u32], window: &TileWindow, grid: &TileGrid) {
        if buffers.sphere_count > 0 {
            let task = Self::task(buffers, order, window, grid);
            // SAFETY: as for triangles.
            unsafe { (self.code)(&*buffers.sphere_planes, &task) }
        }
    }

    /// As [`NearestSpheres::call`], with a look at whether the kernel keeps the calling convention.
    pub fn call_checked(
        &self,
        buffers: &mut TileBuffers<E>,
        order: &[u32],
        window: &TileWindow,
        grid: &TileGrid,
    ) -> Result<(), Vec<Fault>> {
        assert!(buffers.sphere_count > 0);
        let task = Self::task(buffers, order, window, grid);
        let args = [std::ptr::from_ref(&*buffers.sphere_planes) as u64, std::ptr::from_ref(&task) as u64, 0, 0, 0, 0];
        // SAFETY: as in call; these are the arguments of its signature.
        unsafe { checked::call(self.code as *const (), args) }
    }

    fn task(buffers: &mut TileBuffers<E>, order: &[u32], window: &TileWindow, grid: &TileGrid) -> NearestTask {
        assert!(buffers.most < order.len(), "everyone has a place in the scene");
        // Whole packets are read: what is past the chunk is seen nowhere.
        let past = buffers.sphere_count..buffers.sphere_count.next_multiple_of(MOST_LANES);
        buffers.balls.columns[past].fill(0);
        NearestTask {
            order: order.as_ptr(),
            turned: std::ptr::from_ref(&*buffers.balls).cast(),
            count: buffers.sphere_count as u64,
            ..nearest_task(&mut buffers.tile, window, grid)
        }
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

    /// Makes the records of a chunk of spheres, from number `first` on, under these lights; if `short`, in the short form where
    /// it is accurate enough, and otherwise in the long one.
    pub fn call(
        &self,
        view: &SphereView<f64>,
        spheres: Spheres<'_>,
        lights: &[TileLight<f64>],
        short: bool,
        first: usize,
        records: &mut SphereRecords<E>,
    ) {
        let mut turned = Balls::ZERO;
        let task = Self::task(spheres, lights, short, first, records, &mut turned);
        // SAFETY: task() proves that the ids are those of spheres and that there is room for the records; the references
        // the rest. The CPU as in Bounds.
        unsafe { (self.code)(view, &task) }
    }

    /// As [`SphereLooks::call`], with a look at whether the kernel keeps the calling convention.
    pub fn call_checked(
        &self,
        view: &SphereView<f64>,
        spheres: Spheres<'_>,
        lights: &[TileLight<f64>],
        short: bool,
        first: usize,
        records: &mut SphereRecords<E>,
    ) -> Result<(), Vec<Fault>> {
        let mut turned = Balls::ZERO;
        let task = Self::task(spheres, lights, short, first, records, &mut turned);
        let args = [std::ptr::from_ref(view) as u64, std::ptr::from_ref(&task) as u64, 0, 0, 0, 0];
        // SAFETY: as in call; these are the arguments of its signature.
        unsafe { checked::call(self.code as *const (), args) }
    }

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
