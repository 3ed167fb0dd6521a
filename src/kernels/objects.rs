//! The objects of a scene as the tile kernels read them: spheres, and triangles with or without
//! shared corners.

use std::ops::Range;

use glam::Vec3;

use super::faces::{ColourRun, Faces, FacesOfColour, run_of_colour};
use super::kernel::reads;
use super::records::{Candidate, Sphere, Triangle};

/// A range of [`Faces`].
#[derive(Clone, Copy, Debug)]
pub struct FacePart<'a> {
    /// The vertices, followed by one of padding.
    vertices: &'a [Vec3],
    /// The corner indices of the faces; none refers to the padding.
    corners: &'a [[u32; 3]],
    colours: &'a [ColourRun],
    /// The index of this part's first face in the whole list, whose faces `colours` counts.
    first: usize,
}

impl<'a> FacePart<'a> {
    /// Faces with all `vertices` but the last, which is padding. `corners` must not contain the
    /// index of that one, nor an index beyond [`Faces::MOST_VERTICES`].
    ///
    /// # Panics
    /// If `corners` contains such an index.
    pub fn new(vertices: &'a [Vec3], corners: &'a [[u32; 3]], colours: &'a [ColourRun]) -> Self {
        let most = corners.as_flattened().iter().copied().reduce(u32::max);
        let past = vertices.len().min(Faces::MOST_VERTICES + 1);
        assert!(most.is_none_or(|most| (most as usize) + 1 < past), "vertex {most:?} of {past}");
        FacePart { vertices, corners, colours, first: 0 }
    }

    /// Writes the colours of the candidates as bits, one channel after the other.
    pub(super) fn paint(&self, candidates: &[Candidate], channels: [&mut [u32]; 3]) {
        let number = |candidate: &Candidate| self.first + candidate.id as usize;
        let Some(first) = candidates.first() else { return };
        let FacesOfColour { faces: run, colour } = run_of_colour(self.colours, number(first));
        // Nearly always all candidates have the same colour.
        if self.colours.len() == 1 || candidates.iter().all(|candidate| run.contains(&number(candidate))) {
            let colour = colour.to_array().map(f32::to_bits);
            return channels.into_iter().zip(colour).for_each(|(channel, of)| channel[..candidates.len()].fill(of));
        }
        let [red, green, blue] = channels;
        for (i, candidate) in candidates.iter().enumerate() {
            let colour = run_of_colour(self.colours, number(candidate)).colour;
            [red[i], green[i], blue[i]] = colour.to_array().map(f32::to_bits);
        }
    }
}

impl<'a> From<&'a Faces> for FacePart<'a> {
    fn from(faces: &'a Faces) -> Self {
        let vertices = faces.padded_vertices();
        FacePart { vertices, corners: faces.corners(), colours: faces.colours(), first: 0 }
    }
}

/// A range of a scene's triangles.
#[derive(Clone, Copy, Debug)]
pub enum TriangleList<'a> {
    /// Triangles with corners of their own.
    Apart(&'a [Triangle]),
    /// Triangles that share their corners.
    Joined(FacePart<'a>),
}

/// A range of objects of one kind, as a scene stores them and kernels read them.
///
/// # Safety
/// The first address has [`ObjectList::len`] objects, as kernels of this kind read them. If they
/// are faces, the second address is that of their vertices, followed by 4 readable bytes; otherwise
/// it is 0.
pub unsafe trait ObjectList: Copy + Send + Sync {
    type Object;
    /// The number of objects.
    fn len(self) -> usize;
    fn part(self, range: Range<usize>) -> Self;
    fn get(self, at: usize) -> Self::Object;
    /// The address of the objects, and that of their vertices.
    fn addresses(self) -> [u64; 2];
    /// The colours, if kernels do not read them with the objects; otherwise none.
    fn colours(self) -> impl Iterator<Item = Vec3>;

    fn is_empty(self) -> bool {
        self.len() == 0
    }
}

// SAFETY: a slice of spheres, which set-up reads as they are.
unsafe impl ObjectList for &[Sphere] {
    type Object = Sphere;
    fn len(self) -> usize {
        <[Sphere]>::len(self)
    }
    fn part(self, range: Range<usize>) -> Self {
        &self[range]
    }
    fn get(self, at: usize) -> Sphere {
        self[at]
    }
    fn addresses(self) -> [u64; 2] {
        [reads(self), 0]
    }
    fn colours(self) -> impl Iterator<Item = Vec3> {
        [].into_iter()
    }
}

impl TriangleList<'_> {
    /// The corners of the triangle at an index.
    #[inline]
    pub fn vertices(&self, at: usize) -> [Vec3; 3] {
        match self {
            TriangleList::Apart(triangles) => triangles[at].vertices,
            TriangleList::Joined(part) => part.corners[at].map(|corner| part.vertices[corner as usize]),
        }
    }
}

// SAFETY: a slice of triangles; or a slice of faces, whose numbers are indices of vertices, after
// which there is one more vertex.
unsafe impl ObjectList for TriangleList<'_> {
    type Object = Triangle;
    fn len(self) -> usize {
        match self {
            TriangleList::Apart(triangles) => triangles.len(),
            TriangleList::Joined(part) => part.corners.len(),
        }
    }
    fn part(self, Range { start, end }: Range<usize>) -> Self {
        match self {
            TriangleList::Apart(triangles) => TriangleList::Apart(&triangles[start..end]),
            TriangleList::Joined(part) => {
                TriangleList::Joined(FacePart { corners: &part.corners[start..end], first: part.first + start, ..part })
            }
        }
    }
    fn get(self, at: usize) -> Triangle {
        match self {
            TriangleList::Apart(triangles) => triangles[at],
            TriangleList::Joined(part) => {
                Triangle { colour: run_of_colour(part.colours, part.first + at).colour, vertices: self.vertices(at) }
            }
        }
    }
    fn addresses(self) -> [u64; 2] {
        match self {
            TriangleList::Apart(triangles) => [reads(triangles), 0],
            TriangleList::Joined(FacePart { vertices, corners, .. }) => [reads(corners), reads(vertices)],
        }
    }
    fn colours(self) -> impl Iterator<Item = Vec3> {
        let of_faces = match self {
            TriangleList::Apart(_) => [].iter(),
            TriangleList::Joined(FacePart { colours, corners, first, .. }) => {
                let run = |face: usize| colours.partition_point(|(end, _)| *end <= face);
                colours[run(first)..colours.len().min(run(first + corners.len()) + 1)].iter()
            }
        };
        of_faces.map(|(_, colour)| *colour)
    }
}
