//! Triangles that share their corners, as meshes have them.

use std::ops::Range;

use glam::Vec3;

use super::records::{FACE_BYTES, Triangle};

const _: () = assert!(size_of::<[u32; 3]>() == FACE_BYTES && size_of::<Vec3>() == FACE_BYTES);

/// The number past those of faces that follow one another and have one colour, and that colour.
pub type ColourRun = (usize, Vec3);

/// Triangles that share their corners: of each the numbers of three vertices, counted from 0. There are no others than those
/// of vertices, which is how kernels may go by them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Faces {
    /// Behind them is one more, since kernels read 4 bytes past the last of them; but nothing if there are no faces.
    vertices: Vec<Vec3>,
    corners: Vec<[u32; 3]>,
    colours: Vec<ColourRun>,
}

impl Faces {
    /// The most vertices that there may be.
    pub const MOST_VERTICES: usize = i32::MAX as usize;

    /// Faces of one colour.
    ///
    /// # Panics
    /// If one has a vertex that is not there, or there are too many of these.
    pub fn new(vertices: Vec<Vec3>, corners: Vec<[u32; 3]>, colour: Vec3) -> Self {
        let all = vec![(corners.len(), colour)];
        Self::coloured(vertices, corners, all)
    }

    /// Faces of several colours, whose runs follow one another up to the last face.
    ///
    /// # Panics
    /// As [`new`](Self::new), and if the runs do not.
    pub fn coloured(mut vertices: Vec<Vec3>, corners: Vec<[u32; 3]>, colours: Vec<ColourRun>) -> Self {
        let Some(most) = corners.as_flattened().iter().copied().reduce(u32::max) else { return Faces::default() };
        assert!((most as usize) < vertices.len(), "vertex {most} of {}", vertices.len());
        assert!(vertices.len() <= Self::MOST_VERTICES, "{} vertices are too many", vertices.len());
        assert!(
            colours.is_sorted_by(|(a, _), (b, _)| a < b) && colours.last().is_some_and(|run| run.0 == corners.len())
        );
        vertices.reserve_exact(1);
        vertices.push(Vec3::ZERO);
        Faces { vertices, colours, corners }
    }

    /// Adds those of `other` after these, unless there would be too many vertices: then these are what they were.
    #[must_use]
    pub fn append(&mut self, mut other: Faces) -> bool {
        let (before, vertices) = (self.corners.len(), self.vertices().len());
        if before == 0 {
            *self = other;
            return true;
        }
        if vertices + other.vertices().len() > Self::MOST_VERTICES {
            return false;
        }
        if !other.corners.is_empty() {
            self.vertices.pop();
            self.vertices.append(&mut other.vertices);
            self.corners.extend(other.corners.iter().map(|face| face.map(|corner| corner + vertices as u32)));
            self.colours.extend(other.colours.iter().map(|(end, colour)| (before + end, *colour)));
        }
        true
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.corners.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.corners.is_empty()
    }

    /// The vertices.
    pub fn vertices(&self) -> &[Vec3] {
        &self.vertices[..self.vertices.len().saturating_sub(1)]
    }

    /// The same, to be moved.
    pub fn vertices_mut(&mut self) -> &mut [Vec3] {
        let count = self.vertices().len();
        &mut self.vertices[..count]
    }

    /// The numbers of each face's vertices.
    pub fn corners(&self) -> &[[u32; 3]] {
        &self.corners
    }

    /// Has another corner of each face come first, where `first` says so of its corners: 0, 1 or 2.
    pub fn turn(&mut self, first: impl Fn([Vec3; 3]) -> usize) {
        for face in &mut self.corners {
            let comes_first = first(face.map(|corner| self.vertices[corner as usize]));
            face.rotate_left(comes_first);
        }
    }

    /// Puts the third corner of a face on its first, so that it has no area.
    pub fn collapse(&mut self, face: usize) {
        let [first, _, third] = &mut self.corners[face];
        *third = *first;
    }

    /// Gives a face the corners that it has in `others`.
    ///
    /// # Panics
    /// If these have other vertices.
    pub fn take_corners(&mut self, others: &Faces, face: usize) {
        assert_eq!(self.vertices.len(), others.vertices.len(), "other vertices");
        self.corners[face] = others.corners[face];
    }

    /// Gives all of them one colour.
    pub fn paint(&mut self, colour: Vec3) {
        self.colours.iter_mut().for_each(|(_, of)| *of = colour);
    }

    /// A face as a triangle.
    pub fn get(&self, face: usize) -> Triangle {
        Triangle { colour: run_of_colour(&self.colours, face).1, vertices: self.corners_of(face) }
    }

    /// All of them as triangles.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Triangle> + Clone {
        (0..self.len()).map(|face| self.get(face))
    }

    /// The vertices, with the one behind them, and the colours.
    pub(super) fn parts(&self) -> (&[Vec3], &[ColourRun]) {
        (&self.vertices, &self.colours)
    }

    /// Its corners.
    pub fn corners_of(&self, face: usize) -> [Vec3; 3] {
        self.corners[face].map(|corner| self.vertices[corner as usize])
    }
}

/// The colour of a face, and all that have it by the same run.
pub(super) fn run_of_colour(colours: &[ColourRun], face: usize) -> (Range<usize>, Vec3) {
    let run = colours.partition_point(|(end, _)| *end <= face);
    let (end, colour) = colours[run];
    let start = if run == 0 { 0 } else { colours[run - 1].0 };
    (start..end, colour)
}
