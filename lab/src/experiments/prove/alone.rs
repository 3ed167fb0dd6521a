//! Single macros of the tracers as subjects of proofs, each with its inputs and its twin.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::mem::offset_of;

use super::operations::{A, ARGUMENT_REGISTERS, B, OUT};
use super::symbol::{Carrier, Symbol};
use super::{InputNumber, ResultNumber, Subject};
use crate::experiments::step::model::Number as Format;
use rayo::internals::kernels::harness::lanes::{self, Lanes, Packet};
use rayo::internals::kernels::harness::nearest::{self, Planes};
use rayo::internals::kernels::harness::set_up::{self, Projected, Volume};
use rayo::internals::kernels::harness::shadows::{self, Query, SeenTriangles};
use rayo::internals::kernels::harness::spheres::{self, InFront};
use rayo::internals::kernels::harness::{rows, shade};
use rayo::internals::kernels::{
    self, Alone, CasterBounds, CasterEdges, Isa, LightSideView, LitSphere, ObjectLight, Plain, ShortLight,
    SphereArrays, SphereCaster, SpherePlanes, SphereView, TileLight, TileSphere, TileView, TriangleArrays,
    TriangleCaster, TrianglePlanes,
};
use rayo::internals::render::Precision;

/// Of a record of at most this many bytes all fields are inputs of a proof; of a larger one, only
/// the fields that the twin reads.
const MOST_FIELDS: usize = 256;

/// The arguments of a twin: packets by their index (`a`), and the numbers of a record by their byte
/// offsets. `number` reads a number in the format of the elements; `array` reads f32 numbers from
/// an offset on, one for each lane.
struct Arguments<'a, L: Lanes> {
    a: &'a dyn Fn(usize) -> L,
    number: &'a dyn Fn(usize) -> L::Number,
    array: &'a dyn Fn(usize) -> L,
}

impl<L: Lanes> Arguments<'_, L> {
    fn three(&self, first: usize) -> [L; 3] {
        [0, 1, 2].map(|i| (self.a)(first + i))
    }
}

/// Makes a record whose named fields are numbers of the arguments, and whose other fields are 0.
/// With `first of` the fields are arrays, of which only the first element is set; with `bits of`
/// they are arrays of the bits of numbers.
macro_rules! record {
    ($arguments:ident, $type:ty: $($field:ident)*) => {{
        let mut record = <$type>::ZERO;
        $(record.$field = ($arguments.number)(offset_of!($type, $field));)*
        record
    }};
    ($arguments:ident, first of $type:ty: $($field:ident)*) => {{
        let mut record = <$type>::ZERO;
        $(record.$field[0] = ($arguments.number)(offset_of!($type, $field));)*
        record
    }};
    ($arguments:ident, bits of $type:ty: $($field:ident)*) => {{
        let mut record = <$type>::ZERO;
        $(record.$field[0] = ($arguments.number)(offset_of!($type, $field)).to_bits();)*
        record
    }};
}

/// The numbers of each lane in the arrays named, of which the first is at an offset in a record.
macro_rules! arrays {
    ($arguments:ident, $first:expr, $type:ty: $($field:ident)*) => {
        [$(($arguments.array)($first + offset_of!($type, $field))),*]
    };
}

/// The results of the twins of macros that are used in both formats.
fn in_both<L: Lanes>(name: &str, arguments: &Arguments<'_, L>) -> Vec<L> {
    let a = arguments.a;
    let point = || [0, 1, 2].map(|i| (arguments.number)(i * size_of::<L::Number>()));
    let light = |[x, y, z]: [L::Number; 3]| [x, y, z, L::Number::ZERO];
    match name {
        "cross3_unfused" => lanes::cross_unfused(arguments.three(0), arguments.three(3)).to_vec(),
        "dot3_unfused" => vec![lanes::dot_unfused(arguments.three(0), arguments.three(3))],
        "cosine" => vec![shade::cosine(a(0), a(1))],
        "triangle_cosine" => vec![shade::triangle_cosine(a(0), a(1), arguments.three(2), &light(point()))],
        "normal_over_t" => {
            let sphere = record!(arguments, TileSphere<L::Number>: dx dxy dxx dy dyy d0
                mx mxx mxy my myx myy mz mzx mzy ux uy uz);
            shade::normal_over_t(&sphere, a(0), a(1)).to_vec()
        }
        "sphere_cosine" => {
            let light = record!(arguments, ObjectLight<L::Number>: x y z);
            vec![shade::sphere_cosine([a(1), a(2), a(3)], a(0), &light)]
        }
        "around_normal" => {
            let sphere = record!(arguments, TileSphere<L::Number>: ux uy uz mx);
            shade::around_normal(&sphere, a(0), arguments.three(1)).to_vec()
        }
        "around_cosine" => vec![shade::around_cosine(arguments.three(4), a(0), arguments.three(1), &light(point()))],
        "short_cosine" => {
            let light = record!(arguments, ShortLight<L::Number>: q0 qx qy kn ke);
            vec![shade::short_cosine(&light, a(0), [a(1), a(2)])]
        }
        "triangle_at" => {
            let planes = record!(arguments, first of TrianglePlanes<L::Number>: e10 e1x e1y e20 e2x e2y e30 e3x e3y
                t0 tx ty most);
            let row = Planes::<L>::row(&planes, 0, a(1), [0.0; 2]);
            let measure = <TrianglePlanes<L::Number> as Planes<L>>::measure(row, a(0));
            vec![measure, <TrianglePlanes<L::Number> as Planes<L>>::inverse(row, a(0), measure)]
        }
        "sphere_at" => {
            let planes = record!(arguments, first of SpherePlanes<L::Number>: d0 dx dy dxx dxy dyy h hx hy most);
            let row = nearest::sphere_row(&planes, 0, a(1));
            let d = nearest::sphere_d(row.d, a(0));
            vec![d, nearest::sphere_inverse(row.h, a(0), d, L::all(planes.most[0]))]
        }
        "sphere_lit" => {
            let sphere = &record!(arguments, LitSphere<L::Number>: h1 q1 kn ke);
            let j = L::Number::ZERO;
            vec![rows::Span::<L, false> { sphere, j, m: a(1), a: a(2), h0: a(3), q0: a(4) }.light(a(0))]
        }
        _ => panic!("the function `{name}` needs a twin in lab/src/experiments/prove/alone.rs"),
    }
}

/// The results of the twins of macros that are used in f32 alone.
fn in_single<L: Lanes<Number = f32>>(name: &str, arguments: &Arguments<'_, L>) -> Vec<L> {
    let a = arguments.a;
    match name {
        "edges_here" => set_up::edges_here([a(0), a(1)], arguments.three(2)).to_vec(),
        "cross2" => vec![set_up::cross2([a(0), a(1)], [a(2), a(3)])],
        "project" => {
            let Projected { along, ends } = set_up::project(arguments.three(0), arguments.three(3));
            [&along[..], &ends].concat()
        }
        "caster_edge" => {
            let offsets = [offset_of!(CasterEdges, a1), offset_of!(CasterEdges, b1), offset_of!(CasterEdges, c1)];
            vec![shadows::caster_edge(offsets.map(arguments.number).map(L::all), a(0), a(1))]
        }
        "within_edges" => {
            let edges = record!(arguments, bits of CasterEdges: a1 b1 c1 a2 b2 c2 a3 b3 c3);
            vec![shadows::within_edges([a(0), a(1)], &edges, 0).and(L::of(1.0))]
        }
        "within_bounds" => {
            let bounds = record!(arguments, bits of CasterBounds: x y past_x past_y);
            vec![shadows::within_bounds([a(0), a(1)], &bounds, 0).and(L::of(1.0))]
        }
        _ => in_both(name, arguments),
    }
}

/// The corners of triangles whose arrays are at an offset in a record.
fn corners<W: Lanes>(arguments: &Arguments<'_, W>, first: usize) -> [[W; 3]; 3] {
    [
        arrays!(arguments, first, TriangleArrays: ax ay az),
        arrays!(arguments, first, TriangleArrays: bx by bz),
        arrays!(arguments, first, TriangleArrays: cx cy cz),
    ]
}

/// A view of all constants of the functions that set up spheres.
fn sphere_view<W: Lanes<Number = f64>>(arguments: &Arguments<'_, W>) -> SphereView<f64> {
    record!(arguments, SphereView<f64>: step half_width half_height focal scale width height most far white)
}

/// A number rounded to f32.
fn rounded<W: Lanes<Number = f64>>(x: W) -> W {
    let mut single = [0.0_f32];
    x.store(&mut single);
    W::load_bits(&single.map(f32::to_bits))
}

/// The results of the twins of macros that set up spheres.
fn of_spheres<W: Lanes<Number = f64>>(name: &str, arguments: &Arguments<'_, W>) -> Vec<W> {
    let a = arguments.a;
    match name {
        "sphere_box" => {
            let view = record!(arguments, SphereView<f64>: focal step half_width half_height);
            spheres::outline(&view, arguments.three(0)).concat()
        }
        "pixels_between" => {
            spheres::pixels_between([a(0), a(1)], (arguments.number)(offset_of!(SphereView<f64>, width))).to_vec()
        }
        "sphere_d" => {
            let view = sphere_view(arguments);
            let [x, y, z, radius] = arrays!(arguments, size_of::<SphereView<f64>>(), SphereArrays: x y z radius);
            let InFront { c, squared, k, over, origin, reach, ray, h, d } = InFront::new(&view, [x, y, z], radius);
            let h = [h[1], h[2], h[0]];
            let d = [d[0], d[1], d[4], d[2], d[3], d[5]];
            [&origin[..], &c, &[squared, k, over], &ray[..2], &h, &reach, &d].concat()
        }
        "term" => {
            let sum = spheres::sum_of_terms([a(2), a(3), a(5), a(6), a(4), a(7)], [a(0), a(1)]);
            [3, 5, 6, 4, 7].map(|i| rounded(a(i))).into_iter().chain([sum]).collect()
        }
        "normal" => {
            let SphereView { step, focal, .. } = sphere_view(arguments);
            let (step, zero, t) = (W::all(step), W::of(0.0), arguments.three(0));
            let rays = [[a(7), step, zero], [a(8), zero, step], [W::all(focal), zero, zero]];
            [0, 1, 2].map(|axis| spheres::normal(a(4 + axis), t, rays[axis], a(3))).concat()
        }
        "lights" => {
            let light = record!(arguments, TileLight<f64>: x y z red green blue);
            let spheres = size_of::<TileLight<f64>>();
            let [x, y, z, radius, red, green] = arrays!(arguments, spheres, SphereArrays: x y z radius red green);
            let [blue] = arrays!(arguments, spheres + size_of::<SphereArrays>(), TriangleArrays: blue);
            let [x, y, z] = spheres::to_light(&light, [x, y, z], radius);
            let red = spheres::weight(red, light.red, 255.0, f32::MAX.into());
            let green = spheres::weight(green, light.green, 255.0, f64::INFINITY);
            vec![x, y, z, red, green, set_up::weight(blue, light.blue)]
        }
        _ => in_both(name, arguments),
    }
}

/// The results of the twins of macros that are used in f64 alone.
fn in_double<W: Lanes<Number = f64>>(name: &str, arguments: &Arguments<'_, W>) -> Vec<W> {
    let a = arguments.a;
    let truth = |holds: bool| vec![W::of(f64::from(u8::from(holds)))];
    match name {
        "length_of" => vec![lanes::dot_unfused(arguments.three(0), arguments.three(0)).sqrt()],
        "better_corner" => vec![set_up::better_corner([0, 3, 6].map(|first| arguments.three(first))).and(W::of(1.0))],
        "triangle_volume" => {
            let [v, to_b, to_c] = [0, 3, 6].map(|first| arguments.three(first));
            let Volume { normal: [x, y, z], volume, seen_from_a_side } = Volume::new(v, to_b, to_c);
            vec![x, y, z, volume, seen_from_a_side.and(W::of(1.0))]
        }
        "triangle_edge" => {
            let view = record!(arguments, TileView<f64>: dx dy dz step down bound_x bound_y bound_z bound_0);
            set_up::edge(&view, arguments.three(0), arguments.three(3), W::of(0.0).with_sign_of(a(6))).to_vec()
        }
        "outside_triangle" => truth(nearest::is_in_triangle(corners(arguments, 0), a(3), arguments.three(0))),
        "outside_sphere" => {
            let [x, y, z, radius] = arrays!(arguments, 0, SphereArrays: x y z radius);
            truth(nearest::is_in_sphere([x, y, z], radius, arguments.three(0)))
        }
        "triangle_hides" => {
            let caster = record!(arguments, TriangleCaster<f64>: e1x e1y e1z e10 e2x e2y e2z e20 e3x e3y e3z e30
                px py pz p0 bound own);
            let points = Query { p: arguments.three(0), size: a(3), own: a(4), g: [W::of(0.0); 3] };
            vec![shadows::triangle_hides(&caster, &points).and(W::of(1.0))]
        }
        "sphere_hides" => {
            let caster = record!(arguments, SphereCaster<f64>: x y z ux uy uz wx wy wz k lx ly lz far r2 side most past
                bound own);
            let points = Query { p: arguments.three(0), size: a(6), own: a(7), g: arguments.three(3) };
            vec![shadows::sphere_hides(&caster, &points).and(W::of(1.0))]
        }
        "casters" => {
            let view = record!(arguments, LightSideView<f64>: across down depth sign low_x low_y scale_x scale_y slack);
            let light = [view.across, view.down, view.depth].map(W::all);
            let corners = corners(arguments, size_of::<LightSideView<f64>>());
            let seen = SeenTriangles::new(&view, corners.map(|corner| lanes::zip(corner, light, W::sub)));
            let bounds = [seen.x, seen.y, seen.past_x, seen.past_y, seen.depth];
            [&bounds, seen.edges().as_flattened()].concat().into_iter().map(rounded).collect()
        }
        _ => of_spheres(name, arguments),
    }
}

/// All functions of asm/ops/alone.asm as subjects.
pub fn all() -> Vec<Subject> {
    kernels::alone().map(subject).collect()
}

fn subject(alone: &'static Alone) -> Subject {
    let of = match (alone.element, alone.isa) {
        (4, Isa::Sse41) => of_single::<Symbol<f32, false>, Packet<f32, 1, false>>,
        (4, _) => of_single::<Symbol<f32, true>, Packet<f32, 1, true>>,
        (_, Isa::Sse41) => of_double::<Symbol<f64, false>, Packet<f64, 1, false>>,
        _ => of_double::<Symbol<f64, true>, Packet<f64, 1, true>>,
    };
    of(alone)
}

fn of_single<S: Lanes<Number = f32>, P: Lanes<Number = f32>>(alone: &'static Alone) -> Subject {
    of_twins::<f32, S, P>(alone, in_single::<S>, in_single::<P>)
}

fn of_double<S: Lanes<Number = f64>, P: Lanes<Number = f64>>(alone: &'static Alone) -> Subject {
    of_twins::<f64, S, P>(alone, in_double::<S>, in_double::<P>)
}

type Twin<L> = fn(&str, &Arguments<'_, L>) -> Vec<L>;

/// A number in a record, by its place.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Field {
    offset: usize,
    bytes: usize,
}

/// The name of the input that is a number of the record.
fn field_name(offset: usize) -> String {
    format!("record{offset}")
}

/// The name of the input that is a lane of a packet.
fn lane_name(packet: usize, lane: usize) -> String {
    format!("a{packet}@{lane}")
}

/// Where a lane of a packet is in an array of packets, in bytes.
fn lane_offset(alone: &Alone, packet: usize, lane: usize) -> usize {
    packet * alone.packet_bytes() + lane * alone.element
}

/// Makes a subject from a twin over symbols, which is compared with the code, and the same twin
/// over numbers, which shows what it reads of the record.
fn of_twins<E: Carrier, S: Lanes<Number = E>, P: Lanes<Number = E>>(
    alone: &'static Alone,
    twin: Twin<S>,
    on_numbers: Twin<P>,
) -> Subject {
    let lanes = alone.packet_bytes() / alone.element;
    let name = alone.name;
    // IF_OUTSIDE_TRIANGLE and IF_OUTSIDE_SPHERE jump, and therefore decide for the first lane
    // alone.
    let compared_lanes = if name.starts_with("outside") { 1 } else { lanes };
    let fields = fields_read::<E, P>(alone, on_numbers);
    let mut inputs = Vec::new();
    for field in &fields {
        let format = if field.bytes == 8 { Format::Double } else { Format::Single };
        inputs.push(InputNumber { address: B + field.offset as u64, format, name: field_name(field.offset) });
    }
    for lane in 0..lanes {
        for packet in 0..alone.inputs {
            let address = A + lane_offset(alone, packet, lane) as u64;
            inputs.push(InputNumber { address, format: E::FORMAT, name: lane_name(packet, lane) });
        }
    }
    let result = |packet: usize, lane: usize| ResultNumber {
        address: OUT + lane_offset(alone, packet, lane) as u64,
        format: E::FORMAT,
    };
    let results = (0..compared_lanes).map(|lane| (0..alone.outputs).map(|packet| result(packet, lane)).collect());
    let twin = move |lane: usize| {
        let a = |packet: usize| S::all(E::named(&lane_name(packet, lane)));
        let number = |offset: usize| E::named(&field_name(offset));
        let array = |offset: usize| S::load_bits(&[f32::named(&field_name(offset + 4 * lane)).to_bits()]);
        let results = twin(name, &Arguments { a: &a, number: &number, array: &array });
        results.into_iter().map(|result| result.lane(0).node()).collect()
    };
    let call = move |given: &dyn Fn(&str) -> u64| call_on_bits(alone, &fields, compared_lanes, given);
    Subject {
        name,
        form: "macros",
        isa: alone.isa,
        precision: if alone.element == 4 { Precision::Single } else { Precision::Double },
        macros: alone.macros,
        symbol: alone.symbol(),
        address: alone.address(),
        registers: vec![(ARGUMENT_REGISTERS[0], B), (ARGUMENT_REGISTERS[1], A), (ARGUMENT_REGISTERS[2], OUT)],
        inputs,
        results: results.collect(),
        twin: Box::new(twin),
        call: if alone.isa.usable() { Some(Box::new(call)) } else { None },
    }
}

/// The numbers of the record that a function may read: those that its twin reads and, of a small
/// record, all others too, since the function may read numbers on which its result does not depend.
fn fields_read<E: Carrier, P: Lanes<Number = E>>(alone: &Alone, twin: Twin<P>) -> Vec<Field> {
    let read = RefCell::new(BTreeSet::new());
    let number = |offset: usize| -> E {
        read.borrow_mut().insert(Field { offset, bytes: alone.element });
        E::from_f64(1.0)
    };
    let array = |offset: usize| {
        let lanes = 0..alone.packet_bytes() / alone.element;
        read.borrow_mut().extend(lanes.map(|lane| Field { offset: offset + 4 * lane, bytes: 4 }));
        P::of(1.0)
    };
    twin(alone.name, &Arguments { a: &|_| P::of(1.0), number: &number, array: &array });
    let mut fields = read.into_inner();
    if alone.record <= MOST_FIELDS {
        let offsets = (0..alone.record).step_by(alone.element);
        fields.extend(offsets.map(|offset| Field { offset, bytes: alone.element }));
    }
    fields.into_iter().collect()
}

/// Calls a function on inputs, whose bits `given` gives by their names. Returns the bits of its
/// results in the first `compared_lanes` lanes.
fn call_on_bits(alone: &Alone, fields: &[Field], compared_lanes: usize, given: &dyn Fn(&str) -> u64) -> Vec<u64> {
    let mut record = vec![0; alone.record];
    for &Field { offset, bytes } in fields {
        let bits = given(&field_name(offset));
        record[offset..offset + bytes].copy_from_slice(&bits.to_le_bytes()[..bytes]);
    }
    let mut packets = vec![0; alone.inputs * alone.packet_bytes()];
    for packet in 0..alone.inputs {
        for lane in 0..alone.packet_bytes() / alone.element {
            let offset = lane_offset(alone, packet, lane);
            let bits = given(&lane_name(packet, lane));
            packets[offset..offset + alone.element].copy_from_slice(&bits.to_le_bytes()[..alone.element]);
        }
    }
    let out = alone.call(&record, &packets);
    let mut results = Vec::new();
    for lane in 0..compared_lanes {
        for packet in 0..alone.outputs {
            let offset = lane_offset(alone, packet, lane);
            let mut word = [0; 8];
            word[..alone.element].copy_from_slice(&out[offset..offset + alone.element]);
            results.push(u64::from_le_bytes(word));
        }
    }
    results
}
