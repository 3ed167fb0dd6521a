//! The packet kernels: a table of them per ISA and element type, and safe calls.

use std::collections::BTreeSet;
use std::marker::PhantomData;
use std::ops::Range;

use super::checked::{self, Fault};
use super::isa::Isa;
use super::spans::{Element, InsideSpan, Lit, LitSpan, OutsideSpan, TriangleSpan};
use super::tiles::{
    Bounds, BoundsTask, BoundsView, NearestSpheres, NearestTask, NearestTriangles, SetUp, SetupTask, ShadeTask,
    ShadeTile, TileRays, TileSphere, TileView, TrianglePlanes,
};
use super::types::Vec4;

/// More elements than any packet has.
const MOST_LANES: usize = 16;

/// Pixels of four bytes: red, green, blue, and 255.
pub type Rgba8 = [u8; 4];

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

/// Makes a span's pixels in a row of buffers its own where it is nearest.
pub struct Depth<S, E> {
    code: unsafe extern "sysv64" fn(*const S, *mut E, u64, u64),
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
    /// To linear floats.
    pub f32x4: Shade<S, E, Vec4>,
    /// To linear floats with estimates (in f64: as `f32x4`).
    pub f32x4_fast: Shade<S, E, Vec4>,
    /// To 8-bit levels (in f32: with estimates).
    pub rgba8: Shade<S, E, Rgba8>,
    /// To a row of buffers.
    pub planes: Planes<S, E>,
    /// To a row of buffers, with estimates (in f64: as `planes`).
    pub planes_fast: Planes<S, E>,
    /// Finds the nearest.
    pub depth: Depth<S, E>,
}

/// All packet kernels of an ISA for one element type.
pub struct SpanKernels<E: 'static> {
    /// Rays in lockstep.
    pub lanes: usize,
    /// A sphere from outside under one light, short form, to linear floats.
    pub lit_f32x4: Shade<LitSpan<E>, E, Vec4>,
    /// The same with estimates (in f64: without).
    pub lit_f32x4_fast: Shade<LitSpan<E>, E, Vec4>,
    /// The same to 8-bit levels; the weights are at most 127.5, so that nothing exceeds white.
    pub lit_rgba8: Shade<LitSpan<E>, E, Rgba8>,
    /// The same where the three weights are equal.
    pub grey_rgba8: Shade<LitSpan<E>, E, Rgba8>,
    /// Spheres from outside.
    pub outside: Bodies<OutsideSpan<E>, E>,
    /// Spheres from inside.
    pub inside: Bodies<InsideSpan<E>, E>,
    /// Triangles.
    pub triangle: Bodies<TriangleSpan<E>, E>,
    /// A row of buffers to linear floats.
    pub emit_f32x4: Emit<E, Vec4>,
    /// A row of buffers to 8-bit levels.
    pub emit_rgba8: Emit<E, Rgba8>,
    /// Many objects, tile by tile.
    pub tiles: TileKernels<E>,
}

/// The kernels that trace in object order.
pub struct TileKernels<E> {
    /// Triangles to planes.
    pub set_up: SetUp<E>,
    /// The nearest of triangles.
    pub nearest_triangles: NearestTriangles<E>,
    /// The nearest of spheres.
    pub nearest_spheres: NearestSpheres<E>,
    /// To linear floats.
    pub f32x4: ShadeTile<E, Vec4>,
    /// To linear floats with estimates (in f64: as `f32x4`).
    pub f32x4_fast: ShadeTile<E, Vec4>,
    /// To 8-bit levels (in f32: with estimates).
    pub rgba8: ShadeTile<E, Rgba8>,
}

impl<E: Element> TileKernels<E> {
    fn symbols(&self) -> [&'static str; 6] {
        let TileKernels { set_up, nearest_triangles, nearest_spheres, f32x4, f32x4_fast, rgba8 } = self;
        let nearest = [nearest_triangles.symbol(), nearest_spheres.symbol()];
        [set_up.symbol(), nearest[0], nearest[1], f32x4.symbol(), f32x4_fast.symbol(), rgba8.symbol()]
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
    pub bounds: Bounds,
}

impl<S, E> Bodies<S, E> {
    fn symbols(&self) -> [&'static str; 6] {
        let Bodies { f32x4, f32x4_fast, rgba8, planes, planes_fast, depth } = self;
        [f32x4.symbol, f32x4_fast.symbol, rgba8.symbol, planes.symbol, planes_fast.symbol, depth.symbol]
    }
}

impl<E: Element> SpanKernels<E> {
    fn symbols(&self) -> Vec<&'static str> {
        #[rustfmt::skip]
        let SpanKernels {
            lanes: _, lit_f32x4, lit_f32x4_fast, lit_rgba8, grey_rgba8, outside, inside, triangle, emit_f32x4, emit_rgba8,
            tiles,
        } = self;
        let mut symbols = vec![lit_f32x4.symbol, lit_f32x4_fast.symbol, lit_rgba8.symbol, grey_rgba8.symbol];
        symbols.extend(outside.symbols().into_iter().chain(inside.symbols()).chain(triangle.symbols()));
        symbols.extend([emit_f32x4.symbol, emit_rgba8.symbol]);
        symbols.extend(tiles.symbols());
        symbols
    }
}

/// The symbols of all packet kernels in this build, whether this CPU runs them or not.
pub fn packet_symbols() -> BTreeSet<&'static str> {
    let of = |kernels: &PacketKernels| {
        let PacketKernels { single, double, fill, bounds } = kernels;
        [single.symbols(), double.symbols(), vec![fill.symbol, bounds.symbol()]].concat()
    };
    [&SSE41, &AVX2, &AVX512].into_iter().flat_map(of).collect()
}

impl<S, E, P> Shade<S, E, P> {
    /// The symbol of its code.
    pub fn symbol(&self) -> &'static str {
        self.symbol
    }

    /// Writes the span's pixels to `out`, which has exactly as many. `streaming`: past the cache, where the output can.
    pub fn call(&self, span: &S, lits: &[Lit<E>], out: &mut [P], streaming: bool) {
        if !out.is_empty() {
            // SAFETY: the references prove the addresses and lengths, and there is a pixel; a kernel reads records of S
            // and E and writes `out` alone, any bits of which are pixels. The table it came from was handed out by
            // packets(), which had checked the CPU.
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
            streaming.into(),
        ];
        // SAFETY: as in call; these are the arguments of its signature.
        unsafe { checked::call(self.code as *const (), args) }
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
        // SAFETY: as many 32-bit numbers as `out` has, aligned to more than 4; any bits are floats. The CPU as in Shade.
        unsafe { (self.code)(out.as_mut_ptr().cast(), 4 * out.len() as u64, 0, streaming.into()) }
    }

    /// Black levels.
    pub fn rgba8(&self, out: &mut [Rgba8]) {
        if !out.as_ptr().cast::<u32>().is_aligned() {
            // The kernel's middle is aligned to registers, where the pattern would begin in the middle of a pixel.
            return out.fill([0, 0, 0, 255]);
        }
        // SAFETY: as many 32-bit numbers as `out` has, aligned to 4 as just checked.
        unsafe { (self.code)(out.as_mut_ptr().cast(), out.len() as u64, u32::from_le_bytes([0, 0, 0, 255]), 0) }
    }

    /// As [`Fill::f32x4`], with a look at whether the kernel keeps the calling convention.
    pub fn f32x4_checked(&self, out: &mut [Vec4], streaming: bool) -> Result<(), Vec<Fault>> {
        let args = [out.as_mut_ptr() as u64, 4 * out.len() as u64, 0, streaming.into(), 0, 0];
        // SAFETY: as in f32x4.
        unsafe { checked::call(self.code as *const (), args) }
    }

    /// As [`Fill::rgba8`], with a look at whether the kernel keeps the calling convention.
    ///
    /// # Panics
    /// Where `out` is not aligned to 4, and the kernel would not be called.
    pub fn rgba8_checked(&self, out: &mut [Rgba8]) -> Result<(), Vec<Fault>> {
        assert!(out.as_ptr().cast::<u32>().is_aligned());
        let pattern = u32::from_le_bytes([0, 0, 0, 255]);
        let args = [out.as_mut_ptr() as u64, out.len() as u64, pattern.into(), 0, 0, 0];
        // SAFETY: as in rgba8.
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
    ($element:ty, $lanes:literal, $prefix:expr, $fast:literal) => {{
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
            ($body:literal, $span:ty, $fast_name:literal) => {{
                unsafe extern "sysv64" {
                    #[link_name = concat!($prefix, $body, "_planes", $fast_name)]
                    fn kernel(s: *const $span, l: *const Lit<$element>, n: u64, row: *mut $element, p: u64, f: u64);
                }
                Planes { code: kernel, symbol: concat!($prefix, $body, "_planes", $fast_name) }
            }};
        }
        macro_rules! bodies {
            ($body:literal, $span:ty) => {{
                unsafe extern "sysv64" {
                    #[link_name = concat!($prefix, $body, "_depth")]
                    fn kernel(s: *const $span, row: *mut $element, p: u64, f: u64);
                }
                Bodies {
                    f32x4: shade!($body, $span, "_f32x4", Vec4),
                    f32x4_fast: shade!($body, $span, concat!("_f32x4", $fast), Vec4),
                    rgba8: shade!($body, $span, "_rgba8", Rgba8),
                    planes: planes!($body, $span, ""),
                    planes_fast: planes!($body, $span, $fast),
                    depth: Depth { code: kernel, symbol: concat!($prefix, $body, "_depth") },
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
        SpanKernels {
            lanes: $lanes,
            lit_f32x4: shade!("lit", LitSpan<$element>, "_f32x4", Vec4),
            lit_f32x4_fast: shade!("lit", LitSpan<$element>, concat!("_f32x4", $fast), Vec4),
            lit_rgba8: shade!("lit", LitSpan<$element>, "_rgba8", Rgba8),
            grey_rgba8: shade!("grey", LitSpan<$element>, "_rgba8", Rgba8),
            outside: bodies!("outside", OutsideSpan<$element>),
            inside: bodies!("inside", InsideSpan<$element>),
            triangle: bodies!("triangle", TriangleSpan<$element>),
            emit_f32x4: emit!("f32x4", Vec4),
            emit_rgba8: emit!("rgba8", Rgba8),
            tiles: {
                unsafe extern "sysv64" {
                    #[link_name = concat!($prefix, "set_up")]
                    fn set_up(view: *const TileView<f64>, task: *const SetupTask);
                    #[link_name = concat!($prefix, "nearest_triangles")]
                    fn triangles(planes: *const TrianglePlanes<$element>, task: *const NearestTask);
                    #[link_name = concat!($prefix, "nearest_spheres")]
                    fn spheres(spheres: *const TileSphere<$element>, task: *const NearestTask);
                }
                TileKernels {
                    set_up: SetUp { code: set_up, symbol: concat!($prefix, "set_up"), writes: PhantomData },
                    nearest_triangles: NearestTriangles {
                        code: triangles,
                        symbol: concat!($prefix, "nearest_triangles"),
                    },
                    nearest_spheres: NearestSpheres { code: spheres, symbol: concat!($prefix, "nearest_spheres") },
                    f32x4: shade_tile!("f32x4", Vec4),
                    f32x4_fast: shade_tile!(concat!("f32x4", $fast), Vec4),
                    rgba8: shade_tile!("rgba8", Rgba8),
                }
            },
        }
    }};
}

macro_rules! packet_kernels {
    ($static:ident, $isa:literal, $single:literal, $double:literal) => {
        static $static: PacketKernels = {
            unsafe extern "sysv64" {
                #[link_name = concat!("rayo_", $isa, "_fill")]
                fn fill(out: *mut u32, count: u64, pattern: u32, streaming: u64);
                #[link_name = concat!("rayo_", $isa, "_bounds")]
                fn bounds(view: *const BoundsView<f32>, task: *const BoundsTask);
            }
            PacketKernels {
                single: span_kernels!(f32, $single, concat!("rayo_", $isa, "_single_"), "_fast"),
                double: span_kernels!(f64, $double, concat!("rayo_", $isa, "_double_"), ""),
                fill: Fill { code: fill, symbol: concat!("rayo_", $isa, "_fill") },
                bounds: Bounds { code: bounds, symbol: concat!("rayo_", $isa, "_bounds") },
            }
        };
    };
}

packet_kernels!(SSE41, "sse41", 4, 2);
packet_kernels!(AVX2, "avx2", 8, 4);
packet_kernels!(AVX512, "avx512", 16, 8);

/// The packet kernels of an ISA. None where the CPU or the operating system does not run it.
pub fn packets(isa: Isa) -> Option<&'static PacketKernels> {
    isa.usable().then_some(match isa {
        Isa::Sse41 => &SSE41,
        Isa::Avx2 => &AVX2,
        Isa::Avx512 => &AVX512,
    })
}
