//! Accessors of glTF: numbers of any component type in the bytes of a buffer. The ranges are
//! checked against the buffer's length before anything is read.

use ::gltf::json::accessor::{ComponentType, Type};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Accessor, Root};

use super::buffers::Buffers;
use super::missing;
use crate::scene::MeshError;

/// The elements of an accessor; all are known to lie within the buffer.
pub(super) struct Elements<'a> {
    /// None if the accessor has no buffer view: then all elements are zero, except those that
    /// are replaced.
    bytes: Option<&'a [u8]>,
    stride: usize,
    pub count: usize,
    component: ComponentType,
    components: usize,
    normalized: bool,
    replaced: Option<Replaced<'a>>,
    /// How many bytes have been read of all buffers so far, which bounds the size of the mesh
    /// that is accepted.
    pub(super) buffer_bytes: usize,
}

/// The elements of a sparse accessor whose values are stored apart and replace the others.
struct Replaced<'a> {
    /// The indices of the replaced elements, ascending.
    indices: Vec<u32>,
    values: &'a [u8],
}

/// A strided range of elements in a buffer view.
struct StridedRange {
    view: usize,
    offset: u64,
    /// The bytes from the start of one element to the start of the next.
    stride: usize,
    /// The bytes of an element.
    size: usize,
    count: usize,
}

/// The types of elements that an accessor for some purpose may have.
pub(super) struct Kind {
    pub types: &'static [Type],
    pub components: &'static [ComponentType],
    /// What errors call the valid types.
    pub expected: &'static str,
}

impl Kind {
    /// Positions; with KHR_mesh_quantization also as integers.
    pub(super) const PLACES: Kind = Kind {
        types: &[Type::Vec3],
        components: &[ComponentType::F32, ComponentType::I8, ComponentType::U8, ComponentType::I16, ComponentType::U16],
        expected: "VEC3 of floats, or of integers of up to 16 bits",
    };
    pub(super) const COLOURS: Kind = Kind {
        types: &[Type::Vec3, Type::Vec4],
        components: &[ComponentType::F32, ComponentType::U8, ComponentType::U16],
        expected: "VEC3 or VEC4 of floats, or of unsigned integers of up to 16 bits",
    };
    pub(super) const INDICES: Kind = Kind {
        types: &[Type::Scalar],
        components: &[ComponentType::U8, ComponentType::U16, ComponentType::U32],
        expected: "SCALAR of unsigned integers",
    };
}

/// The most elements of an accessor without a buffer view, all of which are zero: nothing in
/// the file bounds their number.
const MOST_ZEROS: u64 = 1 << 20;

/// The elements of an accessor for the purpose `kind`; `owner` is what refers to the accessor,
/// for errors.
pub(super) fn elements<'b>(
    root: &Root,
    buffers: &'b mut Buffers<'_>,
    index: usize,
    kind: &Kind,
    owner: &str,
) -> Result<Elements<'b>, MeshError> {
    let name = format!("accessors[{index}]");
    let Some(accessor) = root.accessors.get(index) else {
        return Err(missing(owner, "accessors", index, root.accessors.len()));
    };
    let wrong = || MeshError::new(format!("{name}, of {owner}, is of another type")).expected(kind.expected);
    let (Checked::Valid(component), Checked::Valid(of)) = (accessor.component_type, accessor.type_) else {
        return Err(wrong());
    };
    let component = component.0;
    if !kind.types.contains(&of) || !kind.components.contains(&component) {
        return Err(wrong());
    }
    let components = of.multiplicity();
    let size = components * component.size();
    let count = usize::try_from(accessor.count.0).unwrap_or(usize::MAX);
    if count == 0 {
        return Err(MeshError::new(format!("{name}, of {owner}, has no elements")).expected("at least one"));
    }
    let own = own_range(accessor, buffers, size, count);
    let replaced = replaced_ranges(accessor, size, &name)?;
    // Read all buffers before borrowing any of them.
    for run in own.iter().chain(replaced.iter().flatten()) {
        buffers.load(run.view, &name)?;
    }
    let buffers = &*buffers;
    if own.is_none() && (replaced.is_none() || accessor.count.0 > MOST_ZEROS) {
        let fault = MeshError::new(format!("{name}, of {owner}, has no bytes for its {count} elements"));
        let is_compressed = root.extensions_used.iter().any(|used| used.ends_with("_compression"));
        let then = if is_compressed { ": decompress the file first" } else { "" };
        return Err(fault.expected(format!("a bufferView{then}")));
    }
    let stride = own.as_ref().map_or(size, |run| run.stride);
    let bytes = own.map(|run| run.bytes(buffers, &name)).transpose()?;
    let replaced = match (replaced, &accessor.sparse) {
        (Some([indices, values]), Some(sparse)) => {
            let Checked::Valid(index_type) = sparse.indices.component_type else { return Err(wrong()) };
            let bytes = indices.bytes(buffers, &name)?;
            let indices = (0..indices.count).map(|at| unsigned(&bytes[at * indices.size..], index_type.0)).collect();
            Some(checked(Replaced { indices, values: values.bytes(buffers, &name)? }, count, &name)?)
        }
        _ => None,
    };
    let normalized = accessor.normalized;
    let buffer_bytes = buffers.bytes_read();
    Ok(Elements { bytes, stride, count, component, components, normalized, replaced, buffer_bytes })
}

/// The range of an accessor's own elements, if it has a buffer view.
fn own_range(accessor: &Accessor, buffers: &Buffers<'_>, size: usize, count: usize) -> Option<StridedRange> {
    let view = accessor.buffer_view?.value();
    let stride = buffers.stride(view).filter(|stride| *stride > 0).unwrap_or(size);
    Some(StridedRange { view, offset: accessor.byte_offset.map_or(0, |offset| offset.0), stride, size, count })
}

/// The ranges of a sparse accessor's indices and values.
fn replaced_ranges(accessor: &Accessor, size: usize, name: &str) -> Result<Option<[StridedRange; 2]>, MeshError> {
    let Some(sparse) = &accessor.sparse else { return Ok(None) };
    let Checked::Valid(index_type) = sparse.indices.component_type else {
        let fault = MeshError::new(format!("{name} has sparse indices of another type"));
        return Err(fault.expected("unsigned integers"));
    };
    let count = usize::try_from(sparse.count.0).unwrap_or(usize::MAX);
    let run = |view: usize, offset: u64, size: usize| StridedRange { view, offset, stride: size, size, count };
    let indices = run(sparse.indices.buffer_view.value(), sparse.indices.byte_offset.0, index_type.0.size());
    let values = run(sparse.values.buffer_view.value(), sparse.values.byte_offset.0, size);
    Ok(Some([indices, values]))
}

/// `replaced`, or an error if its indices do not ascend or are out of range.
fn checked<'a>(replaced: Replaced<'a>, count: usize, name: &str) -> Result<Replaced<'a>, MeshError> {
    let ascend = replaced.indices.is_sorted_by(|a, b| a < b);
    let are_in_range = replaced.indices.last().is_none_or(|last| (*last as usize) < count);
    if ascend && are_in_range {
        return Ok(replaced);
    }
    let fault = MeshError::new(format!("{name} has sparse indices that do not ascend, or are out of range"));
    Err(fault.expected(format!("indices from 0 to {}, each larger than the one before", count - 1)))
}

impl StridedRange {
    /// The bytes from the first element on, which are checked to reach to the end of the last
    /// one.
    fn bytes<'b>(&self, buffers: &'b Buffers<'_>, name: &str) -> Result<&'b [u8], MeshError> {
        let StridedRange { view, offset, stride, size, count } = *self;
        let bytes = buffers.view_bytes(view, name)?;
        let before_last = (stride as u64).checked_mul(count.max(1) as u64 - 1);
        let needed = before_last.and_then(|before| before.checked_add(size as u64)?.checked_add(offset));
        let needed = if count == 0 { Some(0) } else { needed };
        match needed {
            Some(needed) if needed <= bytes.len() as u64 => Ok(&bytes[(offset as usize).min(bytes.len())..]),
            _ => {
                let message = format!(
                    "{name} has {count} elements of {size} bytes, {stride} bytes apart, from byte {offset} on, and \
                     bufferViews[{view}] has {} bytes",
                    bytes.len()
                );
                Err(MeshError::new(message).expected("elements that are within their view"))
            }
        }
    }
}

/// The unsigned integer at the start of `bytes`.
fn unsigned(bytes: &[u8], component: ComponentType) -> u32 {
    match component {
        ComponentType::U8 | ComponentType::I8 => bytes[0].into(),
        ComponentType::U16 | ComponentType::I16 => u16::from_le_bytes([bytes[0], bytes[1]]).into(),
        ComponentType::U32 | ComponentType::F32 => u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
    }
}

impl Elements<'_> {
    /// The bytes of an element; None if it is zero by default.
    #[inline]
    fn element(&self, index: usize) -> Option<&[u8]> {
        if let Some(replaced) = &self.replaced
            && let Ok(at) = replaced.indices.binary_search(&(index as u32))
        {
            let size = self.components * self.component.size();
            return Some(&replaced.values[at * size..]);
        }
        self.bytes.map(|bytes| &bytes[index * self.stride..])
    }

    /// An element that is a single unsigned integer.
    #[inline]
    pub(super) fn index(&self, index: usize) -> u32 {
        self.element(index).map_or(0, |bytes| unsigned(bytes, self.component))
    }

    /// The first three numbers of an element that has at least three; normalized integers are
    /// divided by the largest one of their type.
    #[inline]
    pub(super) fn vector(&self, index: usize) -> [f32; 3] {
        let Some(bytes) = self.element(index) else { return [0.0; 3] };
        let size = self.component.size();
        [0, 1, 2].map(|axis| self.number(&bytes[axis * size..]))
    }

    /// As [`vector`](Self::vector), but with all integers taken as normalized.
    pub(super) fn shares(&self, index: usize) -> [f32; 3] {
        let vector = self.vector(index);
        let highest = match self.component {
            _ if self.normalized => 1.0,
            ComponentType::U8 => 255.0,
            ComponentType::U16 => 65535.0,
            _ => 1.0,
        };
        vector.map(|number| number / highest)
    }

    #[inline]
    fn number(&self, bytes: &[u8]) -> f32 {
        let (number, highest) = match self.component {
            ComponentType::F32 => return f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
            ComponentType::I8 => (f32::from(bytes[0] as i8), 127.0),
            ComponentType::U8 => (f32::from(bytes[0]), 255.0),
            ComponentType::I16 => (f32::from(i16::from_le_bytes([bytes[0], bytes[1]])), 32767.0),
            ComponentType::U16 => (f32::from(u16::from_le_bytes([bytes[0], bytes[1]])), 65535.0),
            ComponentType::U32 => (unsigned(bytes, ComponentType::U32) as f32, u32::MAX as f32),
        };
        if self.normalized { (number / highest).max(-1.0) } else { number }
    }
}
