//! The packet kernels: a table of them per ISA and element type, and safe calls.

use std::collections::BTreeSet;
use std::marker::PhantomData;
use std::ops::Range;

use super::checked::{self, Fault};
use super::isa::Isa;
use super::spans::{
    Element, InsideSpan, LIT_ROWS, Lit, LitRows, LitSetup, LitSphere, NearSpan, OutsideSpan, TriangleSpan,
};
use super::tiles::{
    Ball, Bounds, BoundsTask, BoundsView, Facet, HalfTask, NearerHalf, Nearest, NearestTask, SetUp, SetupTask,
    ShadeTask, ShadeTile, SphereLooks, SpherePlanes, SphereSetUp, SphereView, TileRays, TileView, TrianglePlanes,
};
use super::types::{Plain, Vec4};

/// More elements than any packet has.
const MOST_LANES: usize = 16;

/// Pixels of four bytes: red, green, blue, and 255.
pub type Rgba8 = [u8; 4];
/// Pixels of three bytes: red, green, blue.
pub type Rgb8 = [u8; 3];
/// Pixels of three floats: linear red, green, blue.
pub type F32x3 = [f32; 3];

/// Shades a span: `S` is its record, `P` the pixels it makes.
pub struct Shade<S, E, P> {
    code: unsafe extern "sysv64" fn(*const S, *const Lit<E>, u64, *mut P, u64, u64),
    symbol: &'static str,
}

/// Shades, of a span in a row of buffers, the pixels that are its own.
pub struct Planes<S, E> {
    code: unsafe extern "sysv64" fn(*const S, *const Lit<E>, u64, *mut E, u64, u64),
    symbol: &'static str,
}

/// The same for the first row of a sphere under one light.
pub struct LitPlanes<E> {
    code: unsafe extern "sysv64" fn(*const LitSphere<E>, *const LitRows<E>, u64, *mut E, u64, u64),
    symbol: &'static str,
}

/// Makes a span's pixels in a row of buffers its own where it is nearest.
pub struct Depth<S, E> {
    code: unsafe extern "sysv64" fn(*const S, *mut E, u64, u64),
    symbol: &'static str,
}

/// Finds the rows of a sphere under one light.
pub struct RowSetup<E> {
    code: unsafe extern "sysv64" fn(*const LitSetup<f64>, u64, u64, *mut LitRows<E>),
    symbol: &'static str,
}

/// Makes whole rows of a picture in which there is one sphere under one light.
pub struct ShadeRows<E, P> {
    code: unsafe extern "sysv64" fn(*const LitSphere<E>, *const LitRows<E>, u64, *mut P, u64, u64),
    symbol: &'static str,
}

/// Writes a row of buffers out.
pub struct Emit<E, P> {
    code: unsafe extern "sysv64" fn(*const E, u64, *mut P, u64),
    symbol: &'static str,
}

/// Writes one pattern over many pixels.
pub struct Fill {
    code: unsafe extern "sysv64" fn(*mut u32, u64, u32, u64),
    symbol: &'static str,
}

/// What one kind of object has in all forms and outputs.
pub struct Bodies<S, E> {
    /// To linear floats, four a pixel.
    pub f32x4: Shade<S, E, Vec4>,
    /// The same with estimates (in f64: as `f32x4`).
    pub f32x4_fast: Shade<S, E, Vec4>,
    /// To linear floats, three a pixel.
    pub f32x3: Shade<S, E, F32x3>,
    /// The same with estimates (in f64: as `f32x3`).
    pub f32x3_fast: Shade<S, E, F32x3>,
    /// To 8-bit levels (in f32: with estimates), four a pixel.
    pub rgba8: Shade<S, E, Rgba8>,
    /// The same where all light together does not exceed white: not clamped.
    pub rgba8_dim: Shade<S, E, Rgba8>,
    /// To 8-bit levels, three a pixel.
    pub rgb8: Shade<S, E, Rgb8>,
    /// The same where all light together does not exceed white: not clamped.
    pub rgb8_dim: Shade<S, E, Rgb8>,
    /// To a row of buffers.
    pub planes: Planes<S, E>,
    /// To a row of buffers as `rgba8` (in f64: as `planes`).
    pub planes_fast: Planes<S, E>,
    /// Finds the nearest.
    pub depth: Depth<S, E>,
    /// To a row of buffers with the unit normal in place of the colour. None for a triangle, whose normal is a constant.
    pub normals: Option<Planes<S, E>>,
}

/// What a sphere from outside under one light has in all outputs. The light does not exceed white.
pub struct LitBodies<E> {
    /// To linear floats, four a pixel.
    pub f32x4: ShadeRows<E, Vec4>,
    /// The same with estimates (in f64: as `f32x4`).
    pub f32x4_fast: ShadeRows<E, Vec4>,
    /// To linear floats, three a pixel.
    pub f32x3: ShadeRows<E, F32x3>,
    /// The same with estimates (in f64: as `f32x3`).
    pub f32x3_fast: ShadeRows<E, F32x3>,
    /// To 8-bit levels (with estimates where there are good ones), four a pixel.
    pub rgba8: ShadeRows<E, Rgba8>,
    /// The same, three a pixel.
    pub rgb8: ShadeRows<E, Rgb8>,
}

/// All packet kernels of an ISA for one element type.
pub struct SpanKernels<E: 'static> {
    /// Rays in lockstep.
    pub lanes: usize,
    /// The rows of a sphere from outside under one light, short form.
    pub lit_rows: RowSetup<E>,
    /// Shades such rows.
    pub lit: LitBodies<E>,
    /// The same where the three weights are equal.
    pub grey: LitBodies<E>,
    /// Shades a span of such a row in a row of buffers. What finds the nearest is that of any sphere from outside.
    pub lit_planes: LitPlanes<E>,
    /// The same as `rgba8` does.
    pub lit_planes_fast: LitPlanes<E>,
    /// Spheres from outside.
    pub outside: Bodies<OutsideSpan<E>, E>,
    /// Spheres from outside at less than sqrt 2 radii.
    pub near: Bodies<NearSpan<E>, E>,
    /// Spheres from inside.
    pub inside: Bodies<InsideSpan<E>, E>,
    /// Triangles.
    pub triangle: Bodies<TriangleSpan<E>, E>,
    /// A row of buffers to linear floats, four a pixel.
    pub emit_f32x4: Emit<E, Vec4>,
    /// The same, three a pixel.
    pub emit_f32x3: Emit<E, F32x3>,
    /// A row of buffers to 8-bit levels, four a pixel.
    pub emit_rgba8: Emit<E, Rgba8>,
    /// The same, three a pixel.
    pub emit_rgb8: Emit<E, Rgb8>,
    /// Many objects, tile by tile.
    pub tiles: TileKernels<E>,
}

/// The kernels that trace in object order.
pub struct TileKernels<E> {
    /// Triangles to planes.
    pub set_up: SetUp<E>,
    /// The nearest of triangles.
    pub nearest_triangles: Nearest<TrianglePlanes<E>>,
    /// Spheres to planes.
    pub sphere_set_up: SphereSetUp<E>,
    /// The nearest of spheres.
    pub nearest_spheres: Nearest<SpherePlanes<E>>,
    /// Spheres to what shades them.
    pub sphere_looks: SphereLooks<E>,
    /// To linear floats, four a pixel.
    pub f32x4: ShadeTile<E, Vec4>,
    /// The same with estimates (in f64: as `f32x4`).
    pub f32x4_fast: ShadeTile<E, Vec4>,
    /// To linear floats, three a pixel.
    pub f32x3: ShadeTile<E, F32x3>,
    /// The same with estimates (in f64: as `f32x3`).
    pub f32x3_fast: ShadeTile<E, F32x3>,
    /// To 8-bit levels (in f32: with estimates), four a pixel.
    pub rgba8: ShadeTile<E, Rgba8>,
    /// The same, three a pixel.
    pub rgb8: ShadeTile<E, Rgb8>,
    /// To levels, where no pixel is brighter than white.
    pub rgba8_dim: ShadeTile<E, Rgba8>,
    /// The same, three a pixel.
    pub rgb8_dim: ShadeTile<E, Rgb8>,
    /// To levels, where red, green and blue of every object and light are equal.
    pub rgba8_grey: ShadeTile<E, Rgba8>,
    /// The same, three a pixel.
    pub rgb8_grey: ShadeTile<E, Rgb8>,
}

impl<E: Element> TileKernels<E> {
    fn symbols(&self) -> Vec<&'static str> {
        #[rustfmt::skip]
        let TileKernels {
            set_up, nearest_triangles, sphere_set_up, nearest_spheres, sphere_looks, f32x4, f32x4_fast, f32x3, f32x3_fast,
            rgba8, rgb8, rgba8_dim, rgb8_dim, rgba8_grey, rgb8_grey,
        } = self;
        let floats = [f32x4.symbol(), f32x4_fast.symbol(), f32x3.symbol(), f32x3_fast.symbol()];
        let bytes = [
            rgba8.symbol(),
            rgb8.symbol(),
            rgba8_dim.symbol(),
            rgb8_dim.symbol(),
            rgba8_grey.symbol(),
            rgb8_grey.symbol(),
        ];
        let triangles = [set_up.symbol(), nearest_triangles.symbol()];
        let spheres = [sphere_set_up.symbol(), nearest_spheres.symbol(), sphere_looks.symbol()];
        [&floats[..], &triangles, &spheres, &bytes].concat()
    }
}

/// All packet kernels of an ISA.
pub struct PacketKernels {
    /// On f32.
    pub single: SpanKernels<f32>,
    /// On f64.
    pub double: SpanKernels<f64>,
    /// What no ray hits.
    pub fill: Fill,
    /// Which pixels triangles can cover.
    pub bounds: Bounds<Facet>,
    /// Which pixels spheres can cover.
    pub sphere_bounds: Bounds<Ball>,
    /// Which objects of a tile go first.
    pub nearer_half: NearerHalf,
}

impl<S, E> Bodies<S, E> {
    fn symbols(&self) -> Vec<&'static str> {
        #[rustfmt::skip]
        let Bodies {
            f32x4, f32x4_fast, f32x3, f32x3_fast, rgba8, rgba8_dim, rgb8, rgb8_dim, planes, planes_fast, depth, normals,
        } = self;
        let floats = [f32x4.symbol, f32x4_fast.symbol, f32x3.symbol, f32x3_fast.symbol];
        let bytes = [rgba8.symbol, rgba8_dim.symbol, rgb8.symbol, rgb8_dim.symbol];
        let rows = [planes.symbol, planes_fast.symbol, depth.symbol];
        let normals = normals.as_ref().map(|normals| normals.symbol);
        floats.into_iter().chain(bytes).chain(rows).chain(normals).collect()
    }
}

impl<E> LitBodies<E> {
    fn symbols(&self) -> Vec<&'static str> {
        let LitBodies { f32x4, f32x4_fast, f32x3, f32x3_fast, rgba8, rgb8 } = self;
        vec![f32x4.symbol, f32x4_fast.symbol, f32x3.symbol, f32x3_fast.symbol, rgba8.symbol, rgb8.symbol]
    }
}

impl<E: Element> SpanKernels<E> {
    fn symbols(&self) -> Vec<&'static str> {
        #[rustfmt::skip]
        let SpanKernels {
            lanes: _, lit_rows, lit, grey, lit_planes, lit_planes_fast, outside, near, inside, triangle, emit_f32x4,
            emit_f32x3, emit_rgba8, emit_rgb8, tiles,
        } = self;
        let spheres = [outside.symbols(), near.symbols(), inside.symbols()].concat();
        let rows = vec![lit_rows.symbol, lit_planes.symbol, lit_planes_fast.symbol];
        let emits = vec![emit_f32x4.symbol, emit_f32x3.symbol, emit_rgba8.symbol, emit_rgb8.symbol];
        [lit.symbols(), grey.symbols(), spheres, triangle.symbols(), rows, emits, tiles.symbols()].concat()
    }
}

/// The symbols of all packet kernels in this build, whether this CPU runs them or not.
pub fn packet_symbols() -> BTreeSet<&'static str> {
    let of = |kernels: &PacketKernels| {
        let PacketKernels { single, double, fill, bounds, sphere_bounds, nearer_half } = kernels;
        let others = vec![fill.symbol, bounds.symbol(), sphere_bounds.symbol(), nearer_half.symbol()];
        [single.symbols(), double.symbols(), others].concat()
    };
    [&SSE41, &AVX2, &AVX512].into_iter().flat_map(of).collect()
}

impl<S, E, P> Shade<S, E, P> {
    /// The symbol of its code.
    pub fn symbol(&self) -> &'static str {
        self.symbol
    }

    /// Writes the span's pixels to `out`, which has exactly as many. `streaming`: past the cache, where the output can and
    /// is aligned to 4 bytes.
    pub fn call(&self, span: &S, lits: &[Lit<E>], out: &mut [P], streaming: bool) {
        if !out.is_empty() {
            let streaming = streaming && is_aligned(out);
            // SAFETY: the references prove the addresses and lengths, and there is a pixel; a kernel reads records of S
            // and E and writes `out` alone, any bits of which are pixels, by aligned stores only where packets of its
            // pixels can be aligned. The table it came from was handed out by packets(), which had checked the CPU.
            unsafe {
                let (lits, count) = (lits.as_ptr(), lits.len() as u64);
                (self.code)(span, lits, count, out.as_mut_ptr(), out.len() as u64, streaming.into());
            }
        }
    }

    /// As [`Shade::call`], with a look at whether the kernel keeps the calling convention.
    pub fn call_checked(&self, span: &S, lits: &[Lit<E>], out: &mut [P], streaming: bool) -> Result<(), Vec<Fault>> {
        assert!(!out.is_empty());
        let args = [
            std::ptr::from_ref(span) as u64,
            lits.as_ptr() as u64,
            lits.len() as u64,
            out.as_mut_ptr() as u64,
            out.len() as u64,
            (streaming && is_aligned(out)).into(),
        ];
        // SAFETY: as in call; these are the arguments of its signature.
        unsafe { checked::call(self.code as *const (), args) }
    }
}

/// Whether pixels of numbers of 32 bits are aligned to these, as all other pixels are.
fn is_aligned<P>(out: &[P]) -> bool {
    !size_of::<P>().is_multiple_of(4) || out.as_ptr().cast::<u32>().is_aligned()
}

impl<E: Element> RowSetup<E> {
    /// The symbol of its code.
    pub fn symbol(&self) -> &'static str {
        self.symbol
    }

    /// Sets the first `count` of `rows`, which are the picture's rows from `first` on.
    ///
    /// # Panics
    /// Where there is no room for as many.
    pub fn call(&self, setup: &LitSetup<f64>, first: u32, count: usize, rows: &mut LitRows<E>) {
        assert!(count <= LIT_ROWS, "{count} rows do not fit");
        if count > 0 {
            // SAFETY: the references prove the addresses; LIT_ROWS is a multiple of every packet's lanes, so that there
            // is room for the last packet of rows. The CPU as in Shade::call.
            unsafe { (self.code)(setup, first.into(), count as u64, rows) }
        }
    }

    /// As [`RowSetup::call`], with a look at whether the kernel keeps the calling convention.
    pub fn call_checked(
        &self,
        setup: &LitSetup<f64>,
        first: u32,
        count: usize,
        rows: &mut LitRows<E>,
    ) -> Result<(), Vec<Fault>> {
        assert!((1..=LIT_ROWS).contains(&count));
        let (setup, rows) = (std::ptr::from_ref(setup) as u64, std::ptr::from_mut(rows) as u64);
        // SAFETY: as in call; these are the arguments of its signature.
        unsafe { checked::call(self.code as *const (), [setup, first.into(), count as u64, rows, 0, 0]) }
    }
}

impl<E: Element, P: Copy> ShadeRows<E, P> {
    /// The symbol of its code.
    pub fn symbol(&self) -> &'static str {
        self.symbol
    }

    /// Makes the rows of `out`, each `width` pixels, from as many of `rows`. `streaming`: past the cache, where the
    /// output can.
    ///
    /// # Panics
    /// Where `out` is of numbers of 32 bits and not aligned to these, has no whole number of rows or more than there are,
    /// or where one of the spans does not lie in its row.
    pub fn call(&self, sphere: &LitSphere<E>, rows: &LitRows<E>, out: &mut [P], width: usize, streaming: bool) {
        if !out.is_empty() {
            let [sphere, rows, count, out, width, streaming] = Self::arguments(sphere, rows, out, width, streaming);
            let (sphere, rows, out) = (sphere as *const _, rows as *const _, out as *mut _);
            // SAFETY: the references that became these addresses prove them and the lengths, arguments() that every span
            // lies in its row; any bits are pixels. The CPU as in Shade::call.
            unsafe { (self.code)(sphere, rows, count, out, width, streaming) }
        }
    }

    /// As [`ShadeRows::call`], with a look at whether the kernel keeps the calling convention.
    pub fn call_checked(
        &self,
        sphere: &LitSphere<E>,
        rows: &LitRows<E>,
        out: &mut [P],
        width: usize,
        streaming: bool,
    ) -> Result<(), Vec<Fault>> {
        assert!(!out.is_empty());
        let args = Self::arguments(sphere, rows, out, width, streaming);
        // SAFETY: as in call; these are the arguments of its signature.
        unsafe { checked::call(self.code as *const (), args) }
    }

    fn arguments(sphere: &LitSphere<E>, rows: &LitRows<E>, out: &mut [P], width: usize, streaming: bool) -> [u64; 6] {
        assert!(is_aligned(out), "pixels must be aligned to 4 bytes");
        let count = out.len() / width;
        assert!(count <= LIT_ROWS && count * width == out.len(), "{} pixels are no rows of {width}", out.len());
        for row in 0..count {
            let (start, end) = (rows.start[row].to_f64(), rows.end[row].to_f64());
            assert!(start >= 0.0 && end <= width as f64, "columns {start} to {end} of {width}");
        }
        let (sphere, rows) = (std::ptr::from_ref(sphere) as u64, std::ptr::from_ref(rows) as u64);
        [sphere, rows, count as u64, out.as_mut_ptr() as u64, width as u64, streaming.into()]
    }
}

impl<S, E: Element> Planes<S, E> {
    /// The symbol of its code.
    pub fn symbol(&self) -> &'static str {
        self.symbol
    }

    /// Shades the pixels `span_x` of the row that carry the span's id.
    pub fn call(&self, span: &S, lits: &[Lit<E>], row: &mut Row<E>, span_x: Range<usize>) {
        if !span_x.is_empty() {
            let (first, pixels, stride) = row.part(span_x);
            // SAFETY: part() proves that five planes of `stride` bytes lie there with room for a whole packet past the
            // last pixel; the rest as in Shade::call.
            unsafe { (self.code)(span, lits.as_ptr(), lits.len() as u64, first, pixels, stride) }
        }
    }

    /// As [`Planes::call`], with a look at whether the kernel keeps the calling convention.
    pub fn call_checked(
        &self,
        span: &S,
        lits: &[Lit<E>],
        row: &mut Row<E>,
        span_x: Range<usize>,
    ) -> Result<(), Vec<Fault>> {
        assert!(!span_x.is_empty());
        let (first, pixels, stride) = row.part(span_x);
        let span = std::ptr::from_ref(span) as u64;
        let args = [span, lits.as_ptr() as u64, lits.len() as u64, first as u64, pixels, stride];
        // SAFETY: as in call; these are the arguments of its signature.
        unsafe { checked::call(self.code as *const (), args) }
    }
}

impl<E: Element> LitPlanes<E> {
    /// The symbol of its code.
    pub fn symbol(&self) -> &'static str {
        self.symbol
    }

    /// Shades the pixels `span_x` of the row that carry the id of the first of `rows`.
    pub fn call(&self, sphere: &LitSphere<E>, rows: &LitRows<E>, row: &mut Row<E>, span_x: Range<usize>) {
        if !span_x.is_empty() {
            let (first, pixels, stride) = row.part(span_x);
            // SAFETY: as in Planes::call; the references prove the addresses of the sphere and its rows.
            unsafe { (self.code)(sphere, rows, 0, first, pixels, stride) }
        }
    }

    /// As [`LitPlanes::call`], with a look at whether the kernel keeps the calling convention.
    pub fn call_checked(
        &self,
        sphere: &LitSphere<E>,
        rows: &LitRows<E>,
        row: &mut Row<E>,
        span_x: Range<usize>,
    ) -> Result<(), Vec<Fault>> {
        assert!(!span_x.is_empty());
        let (first, pixels, stride) = row.part(span_x);
        let (sphere, rows) = (std::ptr::from_ref(sphere) as u64, std::ptr::from_ref(rows) as u64);
        // SAFETY: as in call; these are the arguments of its signature.
        unsafe { checked::call(self.code as *const (), [sphere, rows, 0, first as u64, pixels, stride]) }
    }
}

impl<S, E: Element> Depth<S, E> {
    /// The symbol of its code.
    pub fn symbol(&self) -> &'static str {
        self.symbol
    }

    /// Makes those of the pixels `span_x` of the row the span's own that have nothing as near.
    pub fn call(&self, span: &S, row: &mut Row<E>, span_x: Range<usize>) {
        if !span_x.is_empty() {
            let (first, pixels, stride) = row.part(span_x);
            // SAFETY: as in Planes::call.
            unsafe { (self.code)(span, first, pixels, stride) }
        }
    }

    /// As [`Depth::call`], with a look at whether the kernel keeps the calling convention.
    pub fn call_checked(&self, span: &S, row: &mut Row<E>, span_x: Range<usize>) -> Result<(), Vec<Fault>> {
        assert!(!span_x.is_empty());
        let (first, pixels, stride) = row.part(span_x);
        let args = [std::ptr::from_ref(span) as u64, first as u64, pixels, stride, 0, 0];
        // SAFETY: as in call; these are the arguments of its signature.
        unsafe { checked::call(self.code as *const (), args) }
    }
}

impl<E: Element, P> Emit<E, P> {
    /// The symbol of its code.
    pub fn symbol(&self) -> &'static str {
        self.symbol
    }

    /// Writes the pixels of the row from `start` on to `out`, as many as there are.
    pub fn call(&self, row: &mut Row<E>, start: usize, out: &mut [P]) {
        if !out.is_empty() {
            let (first, pixels, stride) = row.part(start..start + out.len());
            // SAFETY: as in Planes::call, and `out` has that many pixels.
            unsafe { (self.code)(first, stride, out.as_mut_ptr(), pixels) }
        }
    }

    /// As [`Emit::call`], with a look at whether the kernel keeps the calling convention.
    pub fn call_checked(&self, row: &mut Row<E>, start: usize, out: &mut [P]) -> Result<(), Vec<Fault>> {
        assert!(!out.is_empty());
        let (first, pixels, stride) = row.part(start..start + out.len());
        let args = [first as u64, stride, out.as_mut_ptr() as u64, pixels, 0, 0];
        // SAFETY: as in call; these are the arguments of its signature.
        unsafe { checked::call(self.code as *const (), args) }
    }
}

impl Fill {
    /// The symbol of its code.
    pub fn symbol(&self) -> &'static str {
        self.symbol
    }

    /// Black floats. `streaming`: past the cache.
    pub fn f32x4(&self, out: &mut [Vec4], streaming: bool) {
        self.fill(out, Vec4::ZERO, 0, streaming);
    }

    /// Black floats. `streaming`: past the cache.
    pub fn f32x3(&self, out: &mut [F32x3], streaming: bool) {
        self.fill(out, F32x3::ZERO, 0, streaming);
    }

    /// Black levels. `streaming`: past the cache.
    pub fn rgba8(&self, out: &mut [Rgba8], streaming: bool) {
        let black = [0, 0, 0, 255];
        self.fill(out, black, u32::from_le_bytes(black), streaming);
    }

    /// Black levels. `streaming`: past the cache.
    pub fn rgb8(&self, out: &mut [Rgb8], streaming: bool) {
        self.fill(out.as_flattened_mut(), 0, 0, streaming);
    }

    /// Fills `out` with a value, of which `pattern` is made.
    fn fill<T: Plain>(&self, out: &mut [T], value: T, pattern: u32, streaming: bool) {
        // SAFETY: any bits are numbers of 32 bits, and any of these are a Plain type.
        let (before, numbers, after) = unsafe { out.align_to_mut() };
        // All of it, where no value begins at a number.
        before.fill(value);
        self.call(numbers, pattern, streaming);
        after.fill(value);
    }

    /// Writes `pattern` to all of `out`. `streaming`: past the cache.
    pub fn call(&self, out: &mut [u32], pattern: u32, streaming: bool) {
        // SAFETY: the reference proves the address and the length. The CPU as in Shade::call.
        unsafe { (self.code)(out.as_mut_ptr(), out.len() as u64, pattern, streaming.into()) }
    }

    /// As [`Fill::call`], with a look at whether the kernel keeps the calling convention.
    pub fn call_checked(&self, out: &mut [u32], pattern: u32, streaming: bool) -> Result<(), Vec<Fault>> {
        let args = [out.as_mut_ptr() as u64, out.len() as u64, pattern.into(), streaming.into(), 0, 0];
        // SAFETY: as in call; these are the arguments of its signature.
        unsafe { checked::call(self.code as *const (), args) }
    }
}

/// A row of buffers: for each pixel who is nearest (0 for nobody), its colour and its 1/t. It stays in cache.
#[derive(Clone, Debug)]
pub struct Row<E> {
    elements: Vec<E>,
    /// Elements from one plane to the next: the width, and room for a whole packet past its end.
    stride: usize,
}

impl<E: Element> Row<E> {
    /// For `width` pixels.
    pub fn new(width: usize) -> Self {
        let stride = (width + MOST_LANES).next_multiple_of(MOST_LANES);
        Row { elements: vec![E::ZERO; 5 * stride], stride }
    }

    /// Forgets the pixels of `x`: nobody, black, infinitely far.
    pub fn clear(&mut self, x: Range<usize>) {
        for plane in self.elements.chunks_exact_mut(self.stride) {
            plane[x.clone()].fill(E::ZERO);
        }
    }

    /// A plane: 0 who, 1 to 3 red, green and blue, 4 1/t.
    pub fn plane(&self, plane: usize) -> &[E] {
        &self.elements[plane * self.stride..][..self.stride]
    }

    /// The address of the first of the pixels `x`, how many there are, and the bytes from plane to plane.
    ///
    /// The kernels touch five planes from there, each up to a packet past the last pixel.
    fn part(&mut self, x: Range<usize>) -> (*mut E, u64, u64) {
        assert!(x.end + MOST_LANES <= self.stride, "the pixels must be in the row");
        (self.elements[x.start..].as_mut_ptr(), x.len() as u64, (self.stride * size_of::<E>()) as u64)
    }
}

/// Declares the kernels of one ISA and element type, and makes their table.
macro_rules! span_kernels {
    ($element:ty, $lanes:literal, $prefix:expr, $fast:literal, $lit_fast:literal) => {{
        macro_rules! shade {
            ($body:literal, $span:ty, $output:expr, $pixel:ty) => {{
                unsafe extern "sysv64" {
                    #[link_name = concat!($prefix, $body, $output)]
                    fn kernel(s: *const $span, l: *const Lit<$element>, n: u64, out: *mut $pixel, p: u64, f: u64);
                }
                Shade { code: kernel, symbol: concat!($prefix, $body, $output) }
            }};
        }
        macro_rules! planes {
            ($body:literal, $span:ty, $output:expr) => {{
                unsafe extern "sysv64" {
                    #[link_name = concat!($prefix, $body, $output)]
                    fn kernel(s: *const $span, l: *const Lit<$element>, n: u64, row: *mut $element, p: u64, f: u64);
                }
                Planes { code: kernel, symbol: concat!($prefix, $body, $output) }
            }};
        }
        macro_rules! bodies {
            ($body:literal, $span:ty, $normals:expr) => {{
                unsafe extern "sysv64" {
                    #[link_name = concat!($prefix, $body, "_depth")]
                    fn kernel(s: *const $span, row: *mut $element, p: u64, f: u64);
                }
                Bodies {
                    f32x4: shade!($body, $span, "_f32x4", Vec4),
                    f32x4_fast: shade!($body, $span, concat!("_f32x4", $fast), Vec4),
                    f32x3: shade!($body, $span, "_f32x3", F32x3),
                    f32x3_fast: shade!($body, $span, concat!("_f32x3", $fast), F32x3),
                    rgba8: shade!($body, $span, "_rgba8", Rgba8),
                    rgba8_dim: shade!($body, $span, "_rgba8_dim", Rgba8),
                    rgb8: shade!($body, $span, "_rgb8", Rgb8),
                    rgb8_dim: shade!($body, $span, "_rgb8_dim", Rgb8),
                    planes: planes!($body, $span, "_planes"),
                    planes_fast: planes!($body, $span, concat!("_planes", $fast)),
                    depth: Depth { code: kernel, symbol: concat!($prefix, $body, "_depth") },
                    normals: $normals,
                }
            }};
        }
        macro_rules! emit {
            ($output:literal, $pixel:ty) => {{
                unsafe extern "sysv64" {
                    #[link_name = concat!($prefix, "emit_", $output)]
                    fn kernel(row: *const $element, stride: u64, out: *mut $pixel, pixels: u64);
                }
                Emit { code: kernel, symbol: concat!($prefix, "emit_", $output) }
            }};
        }
        macro_rules! shade_tile {
            ($output:expr, $pixel:ty) => {{
                unsafe extern "sysv64" {
                    #[link_name = concat!($prefix, "tile_", $output)]
                    fn kernel(rays: *const TileRays<$element>, task: *const ShadeTask);
                }
                ShadeTile { code: kernel, symbol: concat!($prefix, "tile_", $output), writes: PhantomData }
            }};
        }
        macro_rules! lit {
            ($body:literal, $output:expr, $pixel:ty) => {{
                unsafe extern "sysv64" {
                    #[link_name = concat!($prefix, $body, $output)]
                    fn kernel(
                        sphere: *const LitSphere<$element>,
                        rows: *const LitRows<$element>,
                        n: u64,
                        out: *mut $pixel,
                        w: u64,
                        f: u64,
                    );
                }
                ShadeRows { code: kernel, symbol: concat!($prefix, $body, $output) }
            }};
        }
        macro_rules! lit_planes {
            ($fast_name:literal) => {{
                unsafe extern "sysv64" {
                    #[link_name = concat!($prefix, "lit_planes", $fast_name)]
                    fn kernel(
                        sphere: *const LitSphere<$element>,
                        rows: *const LitRows<$element>,
                        unused: u64,
                        row: *mut $element,
                        p: u64,
                        f: u64,
                    );
                }
                LitPlanes { code: kernel, symbol: concat!($prefix, "lit_planes", $fast_name) }
            }};
        }
        macro_rules! lit_bodies {
            ($body:literal) => {
                LitBodies {
                    f32x4: lit!($body, "_f32x4", Vec4),
                    f32x4_fast: lit!($body, concat!("_f32x4", $fast), Vec4),
                    f32x3: lit!($body, "_f32x3", F32x3),
                    f32x3_fast: lit!($body, concat!("_f32x3", $fast), F32x3),
                    rgba8: lit!($body, "_rgba8", Rgba8),
                    rgb8: lit!($body, "_rgb8", Rgb8),
                }
            };
        }
        unsafe extern "sysv64" {
            #[link_name = concat!($prefix, "lit_rows")]
            fn lit_rows(setup: *const LitSetup<f64>, first: u64, count: u64, rows: *mut LitRows<$element>);
        }
        SpanKernels {
            lanes: $lanes,
            lit_rows: RowSetup { code: lit_rows, symbol: concat!($prefix, "lit_rows") },
            lit: lit_bodies!("lit"),
            grey: lit_bodies!("grey"),
            lit_planes: lit_planes!(""),
            lit_planes_fast: lit_planes!($lit_fast),
            outside: bodies!(
                "outside",
                OutsideSpan<$element>,
                Some(planes!("outside", OutsideSpan<$element>, "_normals"))
            ),
            near: bodies!("near", NearSpan<$element>, Some(planes!("near", NearSpan<$element>, "_normals"))),
            inside: bodies!("inside", InsideSpan<$element>, Some(planes!("inside", InsideSpan<$element>, "_normals"))),
            triangle: bodies!("triangle", TriangleSpan<$element>, None),
            emit_f32x4: emit!("f32x4", Vec4),
            emit_f32x3: emit!("f32x3", F32x3),
            emit_rgba8: emit!("rgba8", Rgba8),
            emit_rgb8: emit!("rgb8", Rgb8),
            tiles: {
                unsafe extern "sysv64" {
                    #[link_name = concat!($prefix, "set_up")]
                    fn set_up(view: *const TileView<f64>, task: *const SetupTask);
                    #[link_name = concat!($prefix, "nearest_triangles")]
                    fn triangles(planes: *const TrianglePlanes<$element>, task: *const NearestTask);
                    #[link_name = concat!($prefix, "nearest_spheres")]
                    fn spheres(planes: *const SpherePlanes<$element>, task: *const NearestTask);
                    #[link_name = concat!($prefix, "sphere_set_up")]
                    fn sphere_set_up(view: *const SphereView<f64>, task: *const SetupTask);
                    #[link_name = concat!($prefix, "sphere_looks")]
                    fn sphere_looks(view: *const SphereView<f64>, task: *const SetupTask);
                }
                TileKernels {
                    set_up: SetUp { code: set_up, symbol: concat!($prefix, "set_up"), writes: PhantomData },
                    nearest_triangles: Nearest { code: triangles, symbol: concat!($prefix, "nearest_triangles") },
                    sphere_set_up: SphereSetUp {
                        code: sphere_set_up,
                        symbol: concat!($prefix, "sphere_set_up"),
                        writes: PhantomData,
                    },
                    nearest_spheres: Nearest { code: spheres, symbol: concat!($prefix, "nearest_spheres") },
                    sphere_looks: SphereLooks {
                        code: sphere_looks,
                        symbol: concat!($prefix, "sphere_looks"),
                        writes: PhantomData,
                    },
                    f32x4: shade_tile!("f32x4", Vec4),
                    f32x4_fast: shade_tile!(concat!("f32x4", $fast), Vec4),
                    f32x3: shade_tile!("f32x3", F32x3),
                    f32x3_fast: shade_tile!(concat!("f32x3", $fast), F32x3),
                    rgba8: shade_tile!("rgba8", Rgba8),
                    rgb8: shade_tile!("rgb8", Rgb8),
                    rgba8_dim: shade_tile!("rgba8_dim", Rgba8),
                    rgb8_dim: shade_tile!("rgb8_dim", Rgb8),
                    rgba8_grey: shade_tile!("rgba8_grey", Rgba8),
                    rgb8_grey: shade_tile!("rgb8_grey", Rgb8),
                }
            },
        }
    }};
}

macro_rules! packet_kernels {
    ($static:ident, $isa:literal, $single:literal, $double:literal, $lit_fast:literal) => {
        static $static: PacketKernels = {
            unsafe extern "sysv64" {
                #[link_name = concat!("rayo_", $isa, "_fill")]
                fn fill(out: *mut u32, count: u64, pattern: u32, streaming: u64);
                #[link_name = concat!("rayo_", $isa, "_bounds")]
                fn bounds(view: *const BoundsView<f32>, task: *const BoundsTask);
                #[link_name = concat!("rayo_", $isa, "_sphere_bounds")]
                fn sphere_bounds(view: *const SphereView<f64>, task: *const BoundsTask);
                #[link_name = concat!("rayo_", $isa, "_nearer_half")]
                fn nearer_half(task: *const HalfTask) -> u64;
            }
            PacketKernels {
                single: span_kernels!(f32, $single, concat!("rayo_", $isa, "_single_"), "_fast", "_fast"),
                double: span_kernels!(f64, $double, concat!("rayo_", $isa, "_double_"), "", $lit_fast),
                fill: Fill { code: fill, symbol: concat!("rayo_", $isa, "_fill") },
                bounds: Bounds { code: bounds, symbol: concat!("rayo_", $isa, "_bounds") },
                sphere_bounds: Bounds { code: sphere_bounds, symbol: concat!("rayo_", $isa, "_sphere_bounds") },
                nearer_half: NearerHalf { code: nearer_half, symbol: concat!("rayo_", $isa, "_nearer_half") },
            }
        };
    };
}

// The last is what the short form with estimates in f64 is called: AVX-512 alone has these.
packet_kernels!(SSE41, "sse41", 4, 2, "");
packet_kernels!(AVX2, "avx2", 8, 4, "");
packet_kernels!(AVX512, "avx512", 16, 8, "_fast");

/// The packet kernels of an ISA. None where the CPU or the operating system does not run it.
pub fn packets(isa: Isa) -> Option<&'static PacketKernels> {
    isa.usable().then_some(match isa {
        Isa::Sse41 => &SSE41,
        Isa::Avx2 => &AVX2,
        Isa::Avx512 => &AVX512,
    })
}
