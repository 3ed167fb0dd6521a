//! Tiles: planes, who is nearest and the light on it are those of their twin, pixel by pixel, to the last bit.

use glam::{DVec3, Vec3};
use rayo::kernels::{
    self, CHUNK, Candidate, Element, ElementKernels, Isa, PacketKernels, Rgba8, ShadingRecords, SphereChunk,
    SphereRecords, TileBuffers, TileGrid, TileOut, TileRays, TileShade, TileWindow, TriangleChunk, TriangleList, Vec4,
    packets,
};
use rayo::plan::{Keep, Raster, TilePlace, Tiles, Weighted};
use rayo::reference::Real;
use rayo::reference::packet::{Exact, Rounding};
use rayo::reference::tile::{self, BoundsView, Plane, SpherePlanes, SphereView, TileView, TrianglePlanes};
use rayo::scene::{Camera, Rng, Scene, Sphere, Triangle, many};

const WIDTH: usize = 64;
const HEIGHT: usize = 32;
/// Objects of each kind.
const COUNT: usize = 60;

/// What is compared.
struct Check<'a, E: Element> {
    packets: &'static PacketKernels,
    kernels: &'a ElementKernels<E>,
    rounding: Rounding,
    scene: &'a Scene,
    plan: &'a Tiles<'a, E>,
    buffers: TileBuffers<E>,
    shades: Vec<TileShade<E>>,
    records: SphereRecords<E>,
    window: TileWindow,
    view: SphereView,
    /// How many pixels were decided in f64.
    doubts: usize,
}

impl<E: Element + Real> Check<'_, E> {
    fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.scene.triangles[triangle].vertices.map(|v| v.as_dvec3())
    }

    /// Sets all objects up as a picture of these weights does, and compares planes and shades.
    fn set_up(&mut self, weighted: &Weighted) {
        let (plan, kernels) = (self.plan, &self.kernels.tiles);
        let mut candidates = vec![Candidate::default(); CHUNK];
        let view = &weighted.spheres;
        self.packets.sphere_bounds.call(view, plan.spheres(), 0, true, &mut candidates).unwrap();
        let spheres = SphereChunk { spheres: plan.spheres(), candidates: &candidates[..COUNT] };
        let order: Vec<_> = (0..=2 * COUNT as u32).collect();
        self.buffers.clear();
        kernels.sphere_set_up.call(view, spheres, 1, &mut self.buffers);
        kernels.nearest_spheres.call(&mut self.buffers, &order, &self.window, &plan.grid(), 1);
        kernels.sphere_shading.call(view, spheres, plan.sphere_lights(), weighted.bytes, 0, &mut self.records);
        let bounds = [(WIDTH as u32) << 16, (HEIGHT as u32) << 16];
        let all = |id| Candidate { id, columns: bounds[0], rows: bounds[1], most: 0.75 + id as f32 };
        let candidates: Vec<_> = (0..COUNT as u32).map(all).collect();
        let triangles = TriangleChunk {
            triangles: plan.triangle_lists()[0],
            lights: &weighted.lights,
            candidates: &candidates,
            first_id: 1 + COUNT,
        };
        let (view, _) = plan.view(TilePlace { across: 0, down: 0 });
        kernels.set_up.call(&view, triangles, &mut self.buffers, &mut self.shades);
        kernels.nearest_triangles.call(&mut self.buffers, &order, &self.window, &plan.grid(), 1);

        let twin = TileView {
            ray: DVec3::new(view.dx, view.dy, view.dz),
            step: view.step,
            down: view.down,
            scale: view.scale,
            bound: DVec3::new(view.bound_x, view.bound_y, view.bound_z),
            bound_0: view.bound_0,
        };
        for (i, candidate) in candidates.iter().enumerate() {
            let expected = self.rounding.set_up(self.corners(i), candidate.most.into(), &twin);
            let found = self.triangle(i);
            let numbers = |plane: &Plane<E>| [plane.origin, plane.across, plane.down].map(Element::to_f64);
            let rounded = |plane: &Plane<f64>| {
                [plane.origin, plane.across, plane.down].map(|x| Element::to_f64(<E as Element>::from_f64(x)))
            };
            let own = &expected.planes;
            for (plane, twin) in found.edges.iter().zip(&own.edges).chain([(&found.inverse, &own.inverse)]) {
                assert_eq!(numbers(plane), rounded(twin), "triangle {i}");
            }
            for (number, light) in weighted.lights.iter().enumerate() {
                let shade = &self.shades[(1 + COUNT + i) * weighted.lights.len() + number];
                let cosine = self.rounding.shade(&expected, DVec3::new(light.x, light.y, light.z));
                let radiance = DVec3::new(light.red, light.green, light.blue);
                let colour = self.scene.triangles[i].colour.as_dvec3();
                let colour = tile::weights(colour, 1.0, radiance, f64::INFINITY);
                let twin = [cosine, colour.x, colour.y, colour.z].map(<E as Element>::from_f64);
                assert_eq!(shade.numbers(), twin, "triangle {i}, light {number}");
            }
        }
    }

    fn triangle(&self, i: usize) -> TrianglePlanes<E> {
        let p = self.buffers.planes();
        let plane = |origin: &[E; CHUNK], across: &[E; CHUNK], down: &[E; CHUNK]| Plane {
            origin: origin[i],
            across: across[i],
            down: down[i],
        };
        TrianglePlanes {
            edges: [plane(&p.e10, &p.e1x, &p.e1y), plane(&p.e20, &p.e2x, &p.e2y), plane(&p.e30, &p.e3x, &p.e3y)],
            inverse: plane(&p.t0, &p.tx, &p.ty),
            most: p.most[i],
        }
    }

    /// Who is nearest at a pixel, and how near.
    fn nearest(&mut self, column: usize, row: usize) -> (E, usize) {
        let middle = |x: usize, side: usize| <E as Element>::from_f64(x as f64 - (side / 2) as f64);
        let (x, y) = (middle(column, WIDTH), middle(row, HEIGHT));
        let (one, ray) = (E::ONE, self.view.ray(column as f64, row as f64));
        let (mut nearest, mut who) = (<E as Real>::ZERO, 0);
        let mut see = |hit: bool, w: E, id: usize| {
            if hit && w > nearest {
                (nearest, who) = (w, id);
            }
        };
        for i in 0..COUNT {
            let p = self.buffers.sphere_planes();
            let bounds = [column as f64, row as f64].map(<E as Element>::from_f64);
            let (x, y) = (bounds[0] - p.column[i], bounds[1] - p.row[i]);
            let planes = SpherePlanes {
                d: [p.d0[i], p.dx[i], p.dy[i], p.dxx[i], p.dxy[i], p.dyy[i]],
                h: Plane { origin: p.h[i], across: p.hx[i], down: p.hy[i] },
                most: p.most[i],
            };
            let (d, w) = self.rounding.sphere_at(&planes, x, y);
            let sphere = &self.scene.spheres[i];
            let exact = || !tile::outside_sphere(ray, sphere.centre.as_dvec3(), sphere.radius.into());
            self.doubts += usize::from(d.abs() < p.bound[i]);
            see(d >= -p.bound[i] && (d >= p.bound[i] || exact()), w, 1 + i);
        }
        for i in 0..COUNT {
            let (edge, w) = self.rounding.triangle_at(&self.triangle(i), x, y);
            let side = self.buffers.planes().side[i].to_f64();
            self.doubts += usize::from(edge.abs() < one);
            let exact = || !tile::outside_triangle(ray, self.corners(i), side);
            see(edge >= -one && (edge >= one || exact()), w, 1 + COUNT + i);
        }
        (nearest, who)
    }

    /// The ray through a pixel.
    fn ray(&self, rays: &TileRays<E>, column: usize, row: usize) -> [E; 3] {
        let of = |x: usize, side: usize| <E as Element>::from_f64(x as f64 - (side / 2) as f64);
        let across = Plane { origin: rays.dx, across: rays.step, down: <E as Real>::ZERO };
        let down = Plane { origin: rays.dy, across: rays.down, down: <E as Real>::ZERO };
        let along = |plane, x| self.rounding.plane_at(plane, x, <E as Real>::ZERO);
        [along(&across, of(column, WIDTH)), along(&down, of(row, HEIGHT)), rays.dz]
    }

    /// The colour of a pixel whose nearest object is `who` at 1/t = w.
    fn colour(&self, (w, who): (E, usize), rays: &TileRays<E>, column: usize, row: usize) -> [E; 3] {
        let mut colour = [<E as Real>::ZERO; 3];
        let lights = self.plan.points();
        for (number, point) in lights.iter().enumerate() {
            let (cosine, weights) = match who {
                0 => return colour,
                1..=COUNT => {
                    let record = &self.records.spheres[who - 1];
                    let shading: [E; 20] = record.numbers()[..20].try_into().unwrap();
                    let [x, y] = [column, row].map(|x| <E as Element>::from_f64(x as f64));
                    let (x, y) = (x - record.column, y - record.row);
                    let at = (who - 1) * lights.len() + number;
                    if record.around == E::ONE {
                        let lit = &self.records.lits[at];
                        let (centre, light) = ([record.ux, record.uy, record.uz], [point[0], point[1], point[2]]);
                        let ray = self.ray(rays, column, row);
                        let n = self.rounding.around_normal(w, ray, centre, record.mx);
                        let cosine = self.rounding.around_cosine(w, ray, n, light, &mut Exact);
                        (cosine, [lit.red, lit.green, lit.blue])
                    } else if record.short == E::ONE {
                        let lit = &self.records.shorts[at];
                        let short = [lit.q0, lit.qx, lit.qy, lit.kn, lit.ke];
                        let cosine = self.rounding.short_cosine(short, w, x, y, &mut Exact);
                        (cosine, [lit.red, lit.green, lit.blue])
                    } else {
                        let lit = &self.records.lits[at];
                        let m = self.rounding.normal_over_t(&shading, x, y);
                        let cosine = self.rounding.sphere_cosine(m, w, [lit.x, lit.y, lit.z], &mut Exact);
                        (cosine, [lit.red, lit.green, lit.blue])
                    }
                }
                _ => {
                    let shade = &self.shades[who * lights.len() + number];
                    let ray = self.ray(rays, column, row);
                    let light = [point[0], point[1], point[2]];
                    let cosine = self.rounding.triangle_cosine(shade.cosine, w, ray, light, &mut Exact);
                    (cosine, [shade.red, shade.green, shade.blue])
                }
            };
            colour = [0, 1, 2].map(|i| match self.rounding {
                Rounding::Fused => cosine.mul_add(weights[i], colour[i]),
                Rounding::Unfused => colour[i] + cosine * weights[i],
            });
        }
        colour
    }

    /// Compares all pixels of the tile, in floats and, where bytes have no estimates, in bytes.
    fn pixels(&mut self, bytes: bool) -> usize {
        let (_, rays) = self.plan.view(TilePlace { across: 0, down: 0 });
        let ids: Vec<_> = (0..COUNT as u32).collect();
        let shading = ShadingRecords {
            shades: &self.shades,
            lights: self.plan.points(),
            sphere_ids: &ids,
            spheres: &self.records.spheres,
            lits: &self.records.lits,
            shorts: &self.records.shorts,
        };
        let (mut floats, mut levels) = (vec![Vec4::default(); WIDTH * HEIGHT], vec![Rgba8::default(); WIDTH * HEIGHT]);
        let tiles = &self.kernels.tiles;
        if bytes {
            let out = TileOut { pixels: &mut levels, first: 0, width: WIDTH };
            tiles.rgba8.call(&rays, &self.buffers, shading, &self.window, out);
        } else {
            let out = TileOut { pixels: &mut floats, first: 0, width: WIDTH };
            tiles.f32x4.call(&rays, &self.buffers, shading, &self.window, out);
        }
        let mut hits = 0;
        for (row, column) in (0..HEIGHT).flat_map(|row| (0..WIDTH).map(move |column| (row, column))) {
            let what = format!("{}, column {column}, row {row}", tiles.rgba8.symbol());
            let found = self.buffers.pixel(self.kernels.lanes, column, row);
            let nearest = self.nearest(column, row);
            assert_eq!((Element::to_f64(found.0), found.1), (Element::to_f64(nearest.0), nearest.1), "{what}");
            let colour = self.colour(nearest, &rays, column, row).map(Element::to_f64);
            let at = row * WIDTH + column;
            if bytes {
                let [red, green, blue] = colour.map(|x| x.min(255.0) as u8);
                assert_eq!(levels[at], [red, green, blue, 255], "{what}");
            } else {
                let [red, green, blue] = colour.map(|x| x as f32);
                assert_eq!(floats[at].lanes(), [red, green, blue, 0.0], "{what}");
            }
            hits += usize::from(nearest.1 > 0);
        }
        hits
    }
}

/// Spheres around the camera, beside it and behind, at every pixel of a tile.
fn check_around<E: Element + Real>(kernels: &ElementKernels<E>, plan: &Tiles<'_, E>, seed: u64) {
    let mut rng = Rng::new(seed);
    let [mut inside, mut far, mut hits] = [0; 3];
    for _ in 0..60 {
        let [x, y, z] = [0; 3].map(|_| rng.between(-3.0, 3.0));
        let sphere = Sphere { radius: rng.between(0.1, 4.0), colour: Vec3::ONE, centre: Vec3::new(x, y, z.min(0.5)) };
        let Some(around) = plan.around(&sphere) else { continue };
        let mut buffers = TileBuffers::<E>::default();
        let window = TileWindow { column: 0, row: 0, columns: WIDTH as u32, rows: 0..HEIGHT as u32 };
        kernels.tiles.around.call(&around, &window, &mut buffers, &[0, 1]);
        (inside, far) = (inside + usize::from(around.k < 0.0), far + usize::from(around.far == 1.0));
        for (row, column) in (0..HEIGHT).flat_map(|row| (0..WIDTH).map(move |column| (row, column))) {
            let d = plan.ray(row as u32, column as u32);
            let expected = tile::around(d, sphere.centre.as_dvec3(), sphere.radius.into(), plan.scale());
            let (near, who) = buffers.pixel(kernels.lanes, column, row);
            let expected = <E as Element>::from_f64(expected);
            assert!(near == expected, "{near:?} and not {expected:?} at {row}, {column} of {sphere:?}");
            assert_eq!(who, usize::from(expected > <E as Real>::ZERO));
            hits += who;
        }
    }
    assert!(inside > 10 && far > 5 && hits > 1000, "{inside}, {far}, {hits}");
}

fn check<E: Element + Real>(
    isa: Isa,
    packets: &'static PacketKernels,
    kernels: &ElementKernels<E>,
    seed: u64,
) -> usize {
    let camera = Camera::new(WIDTH as u32, HEIGHT as u32, 1.0, 1.0).unwrap();
    let scene = Scene { camera, ..many(COUNT, COUNT, seed) };
    let plan = Tiles::<E>::new(&scene, Raster::of(&scene.camera)[0], packets, Keep::NOTHING, 1);
    let TileGrid { step, half_width, half_height, focal } = plan.grid();
    let mut check = Check {
        packets,
        kernels,
        rounding: if isa == Isa::Sse41 { Rounding::Unfused } else { Rounding::Fused },
        scene: &scene,
        plan: &plan,
        buffers: TileBuffers::default(),
        shades: vec![TileShade::default(); (1 + COUNT) * plan.points().len()],
        records: SphereRecords::default(),
        window: TileWindow { column: 0, row: 0, columns: WIDTH as u32, rows: 0..HEIGHT as u32 },
        view: SphereView { step, half_width, half_height, focal, scale: plan.scale(), sides: [64.0, 32.0] },
        doubts: 0,
    };
    check.set_up(plan.linear());
    assert!(check.pixels(false) > 100);
    // Some are shaded as spheres around the camera are.
    for record in check.records.spheres.iter_mut().step_by(3) {
        let [x, y, z, over_radius, around] = [0.25, -0.125, 3.0, 0.75, 1.0].map(<E as Element>::from_f64);
        (record.ux, record.uy, record.uz, record.mx, record.around) = (x, y, z, over_radius, around);
    }
    assert!(check.pixels(false) > 100);
    check_around(kernels, &plan, seed);
    // In f32 bytes have estimates.
    if size_of::<E>() == 8 {
        check.set_up(plan.levels());
        assert!(check.pixels(true) > 100);
        assert!(check.records.spheres[..COUNT].iter().any(|sphere| sphere.short == E::ONE));
    }
    check.doubts
}

#[test]
fn every_tile_kernel_without_estimates_equals_its_twin_to_the_last_bit() {
    for isa in [Isa::Sse41, Isa::Avx2, Isa::Avx512] {
        let Some(kernels) = packets(isa) else { continue };
        let doubts: usize = (1..5).map(|seed| check(isa, kernels, &kernels.single, seed)).sum();
        assert!(doubts > 0, "nothing was decided in f64");
        (1..5).for_each(|seed| _ = check(isa, kernels, &kernels.double, seed));
    }
}

#[test]
fn bounds_of_triangles_equal_their_twin_to_the_last_bit() {
    const SIDES: [f32; 2] = [640.0, 480.0];
    let all = SIDES.map(|side| f32::from_bits((side as u32) << 16));
    let twin = BoundsView {
        to_pixels: 600.0,
        column: 319.5,
        row: 239.5,
        low: 0.998,
        high: 1.002,
        sides: SIDES,
        most: 1.5,
        reach: 1.992,
        outside: -0.026,
    };
    let BoundsView { to_pixels, column, row, low, high, sides: [width, height], most, reach, outside } = twin;
    let [all_columns, all_rows] = all;
    let view = kernels::BoundsView {
        to_pixels,
        column,
        row,
        low,
        high,
        width,
        height,
        most,
        all_columns,
        all_rows,
        reach,
        outside,
    };
    let mut rng = Rng::new(7);
    let triangles: Vec<_> = (0..2000)
        .map(|i| {
            let z = rng.between(-1.0, 9.0);
            let middle = [rng.between(-0.6, 0.6) * z.abs(), rng.between(-0.6, 0.6) * z.abs(), z];
            // From larger than the picture to a fraction of a pixel.
            let size = 4f32.powi(-(i % 8));
            let mut corner = || Vec3::from(middle.map(|x| x + size * rng.between(-1.0, 1.0)));
            Triangle { colour: Vec3::ONE, vertices: [corner(), corner(), corner()] }
        })
        .collect();
    let expected: Vec<_> =
        triangles.iter().map(|triangle| twin.of_triangle(triangle.vertices.map(|v| v.to_array()))).collect();
    assert!(expected.iter().filter(|([columns, _], _)| *columns == 0).count() > 100);
    let longest = |expected: &[([u32; 2], f32)]| {
        expected.iter().map(|(bounds, _)| BoundsView::longer_side(*bounds)).fold(0.0, f32::max)
    };
    for kernels in [Isa::Sse41, Isa::Avx2, Isa::Avx512].into_iter().filter_map(packets) {
        let mut candidates = vec![Candidate::default(); triangles.len().next_multiple_of(CHUNK)];
        let (_, extremes) =
            kernels.bounds.call(&view, TriangleList::Apart(&triangles), 0, true, &mut candidates).unwrap();
        assert_eq!(extremes.longest, longest(&expected));
        for (i, expected) in expected.iter().enumerate() {
            let found = ([candidates[i].columns, candidates[i].rows], candidates[i].most);
            assert_eq!(found, *expected, "{}: {:?}", kernels.bounds.symbol(), triangles[i]);
        }
    }
}
