//! Triangles that share their corners, as in meshes.

use std::ops::Range;

use glam::Vec3;

use super::records::{FACE_BYTES, Triangle};

const _: () = assert!(size_of::<[u32; 3]>() == FACE_BYTES && size_of::<Vec3>() == FACE_BYTES);

/// The end of a run of consecutive faces with the same colour, which is the index after its last
/// face, and the colour.
pub type ColourRun = (usize, Vec3);

/// Triangles that share their corners: each has the indices, from 0, of three vertices. Kernels
/// rely on all indices being in range.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Faces {
    /// The vertices, followed by one of padding, since kernels read 4 bytes beyond the last one.
    /// Empty if there are no faces.
    vertices: Vec<Vec3>,
    corners: Vec<[u32; 3]>,
    colours: Vec<ColourRun>,
}

impl Faces {
    /// The number of vertices that is allowed.
    pub const MOST_VERTICES: usize = i32::MAX as usize;

    /// Faces that all have the same colour.
    ///
    /// # Panics
    /// If an index is out of range, or if there are too many vertices.
    pub fn new(vertices: Vec<Vec3>, corners: Vec<[u32; 3]>, colour: Vec3) -> Self {
        let all = vec![(corners.len(), colour)];
        Self::coloured(vertices, corners, all)
    }

    /// Faces of several colours. The runs follow one another up to the last face.
    ///
    /// # Panics
    /// As [`new`](Self::new), and if the runs do not end with the last face.
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

    /// Appends the faces of `other`. Returns false, and changes nothing, if there would be too many
    /// vertices.
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

    /// The number of faces.
    pub fn len(&self) -> usize {
        self.corners.len()
    }

    /// Whether there are no faces.
    pub fn is_empty(&self) -> bool {
        self.corners.is_empty()
    }

    /// The vertices, without the padding.
    pub fn vertices(&self) -> &[Vec3] {
        &self.vertices[..self.vertices.len().saturating_sub(1)]
    }

    /// The vertices, to be transformed.
    pub fn vertices_mut(&mut self) -> &mut [Vec3] {
        let count = self.vertices().len();
        &mut self.vertices[..count]
    }

    /// The indices of each face's vertices.
    pub fn corners(&self) -> &[[u32; 3]] {
        &self.corners
    }

    /// Moves the third corner of a face to its first, so that the face has no area.
    pub fn collapse(&mut self, face: usize) {
        let [first, _, third] = &mut self.corners[face];
        *third = *first;
    }

    /// Gives a face the corner indices that it has in `others`.
    ///
    /// # Panics
    /// If `others` does not have the same number of vertices.
    pub fn take_corners(&mut self, others: &Faces, face: usize) {
        assert_eq!(self.vertices.len(), others.vertices.len(), "other vertices");
        self.corners[face] = others.corners[face];
    }

    /// Gives all faces one colour.
    pub fn paint(&mut self, colour: Vec3) {
        self.colours.iter_mut().for_each(|(_, of)| *of = colour);
    }

    /// A face as a triangle.
    pub fn get(&self, face: usize) -> Triangle {
        Triangle { colour: run_of_colour(&self.colours, face).colour, vertices: self.corners_of(face) }
    }

    /// All faces as triangles.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Triangle> + Clone {
        (0..self.len()).map(|face| self.get(face))
    }

    /// The vertices, followed by the one of padding.
    pub(super) fn padded_vertices(&self) -> &[Vec3] {
        &self.vertices
    }

    pub(super) fn colours(&self) -> &[ColourRun] {
        &self.colours
    }

    /// The corners of a face.
    pub fn corners_of(&self, face: usize) -> [Vec3; 3] {
        self.corners[face].map(|corner| self.vertices[corner as usize])
    }
}

/// A run of consecutive faces with the same colour.
pub(super) struct FacesOfColour {
    pub(super) faces: Range<usize>,
    pub(super) colour: Vec3,
}

/// The run that contains a face.
pub(super) fn run_of_colour(colours: &[ColourRun], face: usize) -> FacesOfColour {
    let run = colours.partition_point(|(end, _)| *end <= face);
    let (end, colour) = colours[run];
    let start = if run == 0 { 0 } else { colours[run - 1].0 };
    FacesOfColour { faces: start..end, colour }
}
