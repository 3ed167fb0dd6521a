//! Shades each pixel of a tile once: asm/tracers/shade.asm.

use super::super::records::{
    Element, LightPosition, ObjectLight, ShortLight, TILE_HEIGHT, TILE_WIDTH, Tile, TileRays, TileShade, TileSphere,
};
use super::super::tiles::{ShadingRecords, TileOut, TileWindow};
use super::super::types::Plain;
use super::lanes::{Each, Lanes, Number, dot, zip};
use super::nearest::Blocks;
use super::rows::Pixel;

/// n / sqrt q, clamped to [0, 1]. A NaN, such as 0 / 0, becomes 0: COSINE.
#[inline(always)]
pub fn cosine<L: Lanes>(n: L, q: L) -> L {
    (n / q.sqrt()).max(L::of(0.0)).min(L::of(1.0))
}

/// The vector from the hit to a light, divided by t: l w - d, where w is 1/t.
#[inline(always)]
fn to_light<L: Lanes>([x, y, z, _]: &LightPosition<L::Number>, w: L, d: [L; 3]) -> [L; 3] {
    zip([*x, *y, *z].each(L::all), d, |l, d| l.fms(w, d))
}

/// The cosine at a triangle, where n is n . (l - v) / |n|: TRIANGLE_COSINE.
#[inline(always)]
pub fn triangle_cosine<L: Lanes>(n: L, w: L, ray: [L; 3], light: &LightPosition<L::Number>) -> L {
    let l = to_light(light, w, ray);
    cosine(n * w, dot(l, l))
}

/// A sphere's normal divided by t, at a pixel relative to the sphere's own origin: SPHERE_ROOT and
/// NORMAL_OVER_T.
#[inline(always)]
pub fn normal_over_t<L: Lanes>(sphere: &TileSphere<L::Number>, x: L, y: L) -> [L; 3] {
    let all = L::all;
    let along = all(sphere.dx).fma(all(sphere.dxy), y).fma(all(sphere.dxx), x);
    let row = all(sphere.d0).fma(all(sphere.dy).fma(all(sphere.dyy), y), y);
    let root = row.fma(along, x).max(L::of(0.0)).sqrt();
    let planes = [
        [sphere.mx, sphere.mxx, sphere.mxy, sphere.ux],
        [sphere.my, sphere.myx, sphere.myy, sphere.uy],
        [sphere.mz, sphere.mzx, sphere.mzy, sphere.uz],
    ];
    planes.each(|plane| {
        let [m, mx, my, u] = plane.each(all);
        m.fma(mx, x).fma(my, y).fnma(u, root)
    })
}

/// The cosine at a sphere, from its normal divided by t: SPHERE_COSINE.
#[inline(always)]
pub fn sphere_cosine<L: Lanes>(m: [L; 3], w: L, light: &ObjectLight<L::Number>) -> L {
    let l = [light.x, light.y, light.z].each(L::all);
    let to_light = zip(l, m, |l, m| l.fms(w, m));
    cosine(dot(l, m) - w, dot(to_light, to_light))
}

/// The normal of a sphere that contains the camera or is beside it: AROUND_NORMAL.
#[inline(always)]
pub fn around_normal<L: Lanes>(sphere: &TileSphere<L::Number>, w: L, ray: [L; 3]) -> [L; 3] {
    let t = L::of(1.0) / w;
    let centre = [sphere.ux, sphere.uy, sphere.uz].each(L::all);
    zip(ray, centre, |d, c| (d * t - c) * L::all(sphere.mx))
}

/// The cosine for a unit normal and a light's position: AROUND_COSINE.
#[inline(always)]
pub fn around_cosine<L: Lanes>(n: [L; 3], w: L, ray: [L; 3], light: &LightPosition<L::Number>) -> L {
    let l = to_light(light, w, ray);
    cosine(dot(n, l), dot(l, l))
}

/// A block of pixels: 1/t and ids, the pixels' rays, and their positions in the picture.
struct Block<L> {
    w: L,
    who: L,
    ray: [L; 3],
    pixel: [L; 2],
}

impl<L: Lanes> Block<L> {
    /// Adds the effect of all lights on triangles. `shade` gives the effect of the light at an
    /// index.
    #[inline(always)]
    fn add_triangles(&self, lights: &[LightPosition<L::Number>], colour: &mut [L; 3], shade: impl Fn(usize) -> [L; 4]) {
        for (number, light) in lights.iter().enumerate() {
            let [n, weights @ ..] = shade(number);
            add(colour, triangle_cosine(n, self.w, self.ray, light), weights);
        }
    }

    /// Adds the effect of all lights on one sphere of the tile, in the lanes of the mask.
    #[inline(always)]
    fn add_sphere<P: Pixel>(&self, id: usize, mask: L, records: &ShadingRecords<'_, L::Number>, colour: &mut [L; 3]) {
        let all = L::all;
        let record = records.sphere_ids[id - 1] as usize;
        let sphere = &records.spheres[record];
        let lights = record * records.lights.len()..(record + 1) * records.lights.len();
        let [x, y] = [self.pixel[0] - all(sphere.column), self.pixel[1] - all(sphere.row)];
        if sphere.around != L::Number::ZERO {
            let n = around_normal(sphere, self.w, self.ray);
            for (lit, point) in records.lits[lights].iter().zip(records.lights) {
                let cosine = around_cosine(n, self.w, self.ray, point);
                add(colour, mask.and(cosine), [lit.red, lit.green, lit.blue].each(all));
            }
        } else if P::LEVELS && sphere.short != L::Number::ZERO {
            for lit in &records.shorts[lights] {
                let cosine = short_cosine(lit, self.w, [x, y]);
                add(colour, mask.and(cosine), [lit.red, lit.green, lit.blue].each(all));
            }
        } else {
            let m = normal_over_t(sphere, x, y);
            for lit in &records.lits[lights] {
                let cosine = sphere_cosine(m, self.w, lit);
                add(colour, mask.and(cosine), [lit.red, lit.green, lit.blue].each(all));
            }
        }
    }
}

/// Adds the weights times a cosine.
#[inline(always)]
fn add<L: Lanes>(colour: &mut [L; 3], cosine: L, weights: [L; 3]) {
    *colour = zip(*colour, weights, |colour, weight| colour.fma(cosine, weight));
}

/// The cosine in the short form: SHORT_COSINE.
#[inline(always)]
pub fn short_cosine<L: Lanes>(lit: &ShortLight<L::Number>, w: L, [x, y]: [L; 2]) -> L {
    let q = L::all(lit.q0).fma(x, L::all(lit.qx)).fma(y, L::all(lit.qy));
    let e = (w * L::all(lit.ke) - q - q) * w;
    cosine(q.fma(w, L::all(lit.kn)), e)
}

/// The colours of a block's pixels under all lights.
#[inline(always)]
fn colour_of<L: Lanes, P: Pixel>(block: &Block<L>, records: &ShadingRecords<'_, L::Number>) -> [L; 3] {
    let all = L::all;
    let (lights, spheres) = (records.lights.len(), records.sphere_ids.len());
    let mut colour = [L::of(0.0); 3];
    let shade = |id: L::Number, light: usize| &records.shades[id.to_index() as usize * lights + light];
    let owner = block.who.lane(0);
    if !block.who.mask(all(owner), PartialEq::ne).any() {
        // Most blocks show a single object.
        match owner.to_index() as usize {
            0 => {}
            id if id <= spheres => block.add_sphere::<P>(id, all(Number::mask(true)), records, &mut colour),
            _ => block.add_triangles(records.lights, &mut colour, |light| {
                let TileShade { cosine, red, green, blue } = *shade(owner, light);
                [cosine, red, green, blue].each(all)
            }),
        }
    } else if lights > 0 {
        if block.who.greater(L::of(spheres as f64)).any() {
            block.add_triangles(records.lights, &mut colour, |light| {
                let of = |f: fn(&TileShade<L::Number>) -> L::Number| {
                    L::from_fn(|lane| f(shade(block.who.lane(lane), light)))
                };
                [of(|shade| shade.cosine), of(|shade| shade.red), of(|shade| shade.green), of(|shade| shade.blue)]
            });
        }
        for lane in 0..L::COUNT {
            let who = block.who.lane(lane);
            let id = who.to_index() as usize;
            let is_first = (0..lane).all(|before| block.who.lane(before) != who);
            if (1..=spheres).contains(&id) && is_first {
                block.add_sphere::<P>(id, block.who.equal(all(who)), records, &mut colour);
            }
        }
    }
    colour
}

/// Writes the pixels of a window of a tile.
pub fn shade<L: Lanes, P: Pixel>(
    rays: &TileRays<L::Number>,
    tile: &Tile<L::Number>,
    records: ShadingRecords<'_, L::Number>,
    window: &TileWindow,
    TileOut { pixels, first, width: pitch }: TileOut<'_, P>,
) {
    let all = L::all;
    let (width, height) = (Blocks::<L>::WIDTH, Blocks::<L>::HEIGHT);
    let [block_x, block_y] = Blocks::<L>::pixels();
    let (rows, columns) = (window.rows.start as usize..window.rows.end as usize, window.columns as usize);
    let number = |x: usize| L::of(x as f64);
    for down in rows.start / height..rows.end.div_ceil(height) {
        let y = number(down * height) + block_y;
        let ray_y = all(rays.dy).fma(y - number(TILE_HEIGHT / 2), all(rays.down));
        for across in 0..columns.div_ceil(width) {
            let at = (down * Blocks::<L>::ACROSS + across) * L::COUNT;
            let x = number(across * width) + block_x;
            let block = Block {
                w: L::load(&tile.near[at..]),
                who: L::load(&tile.who[at..]),
                ray: [all(rays.dx).fma(all(rays.step), x - number(TILE_WIDTH / 2)), ray_y, all(rays.dz)],
                pixel: [number(window.column as usize) + x, number(window.row as usize) + y],
            };
            let colour = colour_of::<L, P>(&block, &records);
            let columns = across * width..columns.min((across + 1) * width);
            for row in (down * height..(down + 1) * height).filter(|row| rows.contains(row)) {
                let line = first + (row - rows.start) * pitch;
                let to = &mut pixels[line + columns.start..line + columns.end];
                P::put_some(to, colour, (row - down * height) * width, width);
            }
        }
    }
}
