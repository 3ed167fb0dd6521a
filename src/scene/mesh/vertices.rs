//! Vertices while a mesh is being read. If all are far from 0, as in map coordinates, they are
//! stored relative to an origin near them.

use glam::{DVec3, Vec3};

/// A mesh counts as far from 0 if its largest coordinate is more than this many times its extent:
/// then f32 coordinates would lose over 4 bits of its shape, compared to a mesh around 0.
const FAR: f64 = 16.0;

/// Vertices in f32 and, as long as all may turn out to be far from 0, in f64.
#[derive(Default)]
pub(in crate::scene) struct Vertices {
    rounded: Vec<Vec3>,
    /// All vertices in f64, once f32 does not hold one of them exactly; empty before.
    exact: Vec<DVec3>,
    /// Whether some vertices are near 0, so that no later vertex can make the mesh count as far
    /// from 0.
    is_near: bool,
    bounds: Option<Bounds>,
}

/// An axis-aligned bounding box.
#[derive(Clone, Copy)]
struct Bounds {
    low: DVec3,
    high: DVec3,
}

impl Bounds {
    /// The box `before`, extended to a point.
    fn around(before: Option<Self>, point: DVec3) -> Self {
        let Bounds { low, high } = before.unwrap_or(Bounds { low: point, high: point });
        Bounds { low: low.min(point), high: high.max(point) }
    }

    fn size(self) -> f64 {
        (self.high - self.low).max_element()
    }

    /// Whether its largest coordinate is more than `times` times its size.
    fn is_beyond(self, times: f64) -> bool {
        self.low.abs().max(self.high.abs()).max_element() > times * self.size()
    }

    /// An origin near the middle of the box with few significant bits, so that most differences of
    /// vertices from it are exact.
    fn origin(self) -> DVec3 {
        let step = self.size().log2().ceil().exp2();
        ((self.low + self.high) / 2.0 / step).round() * step
    }
}

impl Vertices {
    /// No vertices yet; they will be stored in `rounded`.
    pub(in crate::scene) fn in_room(rounded: Vec<Vec3>) -> Self {
        Vertices { rounded, ..Vertices::default() }
    }

    /// No vertices yet, in a part of a mesh whose earlier vertices include some near 0.
    pub(super) fn after_near_ones(rounded: Vec<Vec3>) -> Self {
        Vertices { is_near: true, ..Vertices::in_room(rounded) }
    }

    /// Appends vertices of a later part of the mesh. Some vertices before must be near 0.
    pub(super) fn append(&mut self, others: Vertices) {
        debug_assert!(self.is_near);
        self.rounded.extend(others.rounded);
    }

    pub(in crate::scene) fn len(&self) -> usize {
        self.rounded.len()
    }

    /// Whether some vertices are near 0, so that later vertices are not needed in f64.
    pub(in crate::scene) fn are_near(&self) -> bool {
        self.is_near
    }

    /// Adds a vertex, given rounded to f32 and to f64.
    #[inline]
    pub(in crate::scene) fn push(&mut self, single: Vec3, double: impl FnOnce() -> DVec3) {
        if !self.is_near {
            self.push_exact(single, double());
        }
        self.rounded.push(single);
    }

    #[cold]
    fn push_exact(&mut self, single: Vec3, double: DVec3) {
        let is_exact = single.as_dvec3() == double;
        if !self.exact.is_empty() || !is_exact {
            let missing = &self.rounded[self.exact.len()..];
            self.exact.extend(missing.iter().map(|vertex| vertex.as_dvec3()));
            self.exact.push(double);
        }
        if !single.is_finite() {
            return;
        }
        let bounds = Bounds::around(self.bounds, double);
        self.bounds = Some(bounds);
        // A further point enlarges the box by as much as its own distance can grow. So a box within
        // half of the limit can never exceed the limit.
        if !bounds.is_beyond(FAR / 2.0) {
            self.is_near = true;
            self.exact = Vec::new();
        }
    }

    /// Whether vertex `index`, which equals `single` in f32, also equals the vertex in f64, where
    /// that matters.
    #[inline]
    pub(super) fn is_exactly(&self, index: u32, single: Vec3, double: impl FnOnce() -> DVec3) -> bool {
        self.is_near || *self.exact.get(index as usize).unwrap_or(&single.as_dvec3()) == double()
    }

    /// All vertices relative to an origin, and the origin. It is 0 unless the vertices would lose
    /// digits that matter.
    pub(in crate::scene) fn finish(self) -> (Vec<Vec3>, DVec3) {
        let Vertices { mut rounded, exact, bounds, .. } = self;
        let Some(bounds) = bounds.filter(|bounds| bounds.is_beyond(FAR) && bounds.size() > 0.0) else {
            return (rounded, DVec3::ZERO);
        };
        if exact.is_empty() {
            return (rounded, DVec3::ZERO);
        }
        let origin = bounds.origin();
        for (vertex, exact) in rounded.iter_mut().zip(exact) {
            *vertex = (exact - origin).as_vec3();
        }
        (rounded, origin)
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};

    use super::Vertices;

    fn read(points: &[DVec3]) -> Vertices {
        let mut vertices = Vertices::default();
        points.iter().for_each(|point| vertices.push(point.as_vec3(), || *point));
        vertices
    }

    #[test]
    fn vertices_have_an_origin_only_where_digits_would_be_lost() {
        let shape = [DVec3::new(0.1, 0.2, 0.3), DVec3::new(3.7, 0.0, 1.1), DVec3::new(-2.3, 5.9, 0.7)];
        for (away, has_origin) in [(0.0, false), (1.0, false), (60.0, false), (200.0, true), (4e6, true), (1e12, true)]
        {
            let points = shape.map(|point| point + away);
            let (rounded, origin) = read(&points).finish();
            assert_eq!(origin != DVec3::ZERO, has_origin, "{away}");
            for (vertex, point) in rounded.iter().zip(points) {
                let error = (origin + vertex.as_dvec3() - point).abs().max_element();
                let most = if has_origin { 1e-6 + 1e-15 * away } else { 6e-8 * (away + 6.0) };
                assert!(error <= most, "{away}: {error}");
            }
            // What f32 holds stays as it is.
            let held = points.map(|point| point.as_vec3().as_dvec3());
            assert_eq!(read(&held).finish(), (held.map(|point| point.as_vec3()).to_vec(), DVec3::ZERO));
        }
    }

    #[test]
    fn no_later_vertex_makes_a_mesh_far_that_was_near() {
        // The points are as far apart as they may be for the mesh to count as far from 0.
        let mut points = vec![DVec3::new(8.1, 0.0, 0.0), DVec3::new(9.1, 0.0, 0.0)];
        for _ in 0..200 {
            let vertices = read(&points);
            assert!(vertices.is_near || vertices.bounds.unwrap().is_beyond(super::FAR / 2.0));
            points.push(points[points.len() - 1] * 1.03);
        }
        let (rounded, origin) = read(&points).finish();
        assert_eq!((rounded[1], origin), (Vec3::new(9.1, 0.0, 0.0), DVec3::ZERO));
    }

    #[test]
    fn vertices_that_differ_in_f64_alone_are_not_the_same() {
        let points = [DVec3::new(5e6, 1.0, 2.0), DVec3::new(5e6 + 0.1, 1.0, 2.0), DVec3::new(5e6 + 3.0, 1.0, 2.0)];
        let vertices = read(&points);
        let is = |index: u32, point: DVec3| vertices.is_exactly(index, point.as_vec3(), || point);
        assert!((0..3).all(|index| is(index, points[index as usize])));
        assert!(!is(0, points[1]) && !is(1, points[0]));
    }
}
