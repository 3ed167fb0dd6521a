//! The bytes of glTF buffers: stored in the binary file itself, in another file, or in the JSON
//! as base64.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use ::gltf::json::Root;
use ::gltf::json::buffer::View;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

use super::missing;
use crate::scene::MeshError;
use crate::scene::diagnostic::{brief, is_address};
use crate::scene::open;

/// The buffers of a file; each is read when it is first needed.
pub(super) struct Buffers<'a> {
    root: &'a Root,
    /// The buffer chunk of a binary file, which is buffer 0.
    binary: Option<&'a [u8]>,
    folder: Option<&'a Path>,
    loaded: Vec<Option<Cow<'a, [u8]>>>,
    /// The paths of other files that were read.
    pub files: Vec<PathBuf>,
}

impl<'a> Buffers<'a> {
    pub(super) fn new(root: &'a Root, binary: Option<&'a [u8]>, folder: Option<&'a Path>) -> Self {
        let loaded = root.buffers.iter().map(|_| None).collect();
        Buffers { root, binary, folder, loaded, files: Vec::new() }
    }

    /// Reads the buffer that a view refers to, unless it has been read.
    pub(super) fn load(&mut self, view_index: usize, owner: &str) -> Result<(), MeshError> {
        let buffer = self.view(view_index, owner)?.buffer.value();
        let count = self.root.buffers.len();
        let Some(loaded) = self.loaded.get(buffer) else {
            return Err(missing(&format!("bufferViews[{view_index}]"), "buffers", buffer, count));
        };
        if loaded.is_none() {
            self.loaded[buffer] = Some(self.bytes_of(buffer)?);
        }
        Ok(())
    }

    /// The total length of the buffers read so far.
    pub(super) fn bytes_read(&self) -> usize {
        self.loaded.iter().flatten().map(|bytes| bytes.len()).sum()
    }

    /// The bytes of a view. Its buffer must have been read.
    pub(super) fn view_bytes(&self, view_index: usize, owner: &str) -> Result<&[u8], MeshError> {
        let view = self.view(view_index, owner)?;
        let bytes = self.loaded.get(view.buffer.value()).and_then(Option::as_deref).unwrap_or_default();
        let start = view.byte_offset.map_or(0, |offset| offset.0);
        let end = start.checked_add(view.byte_length.0).and_then(|end| usize::try_from(end).ok());
        end.and_then(|end| bytes.get(usize::try_from(start).ok()?..end)).ok_or_else(|| {
            let (length, buffer) = (view.byte_length.0, view.buffer.value());
            let message = format!(
                "bufferViews[{view_index}] has {length} bytes from {start} on, and buffers[{buffer}] has {} in all",
                bytes.len()
            );
            MeshError::new(message).expected("a view that is within its buffer")
        })
    }

    /// The byte stride of a view, if it gives one.
    pub(super) fn stride(&self, view_index: usize) -> Option<usize> {
        self.root.buffer_views.get(view_index)?.byte_stride.map(|stride| stride.0)
    }

    fn view(&self, index: usize, owner: &str) -> Result<&'a View, MeshError> {
        let views = &self.root.buffer_views;
        views.get(index).ok_or_else(|| missing(owner, "bufferViews", index, views.len()))
    }

    fn bytes_of(&mut self, index: usize) -> Result<Cow<'a, [u8]>, MeshError> {
        let buffer = &self.root.buffers[index];
        let bytes = match &buffer.uri {
            None => Cow::Borrowed(self.binary.filter(|_| index == 0).ok_or_else(|| {
                let fault = MeshError::new(format!("buffers[{index}] has no bytes"));
                fault.expected("a uri, or the binary part of a .glb file")
            })?),
            Some(uri) => match uri.strip_prefix("data:") {
                Some(data) => Cow::Owned(decoded(data, index)?),
                None => Cow::Owned(self.file(uri, index)?),
            },
        };
        let claimed = buffer.byte_length.0;
        if (bytes.len() as u64) < claimed {
            let message = format!("buffers[{index}] claims {claimed} bytes, and has {}", bytes.len());
            return Err(MeshError::new(message).expected("all of its bytes"));
        }
        Ok(bytes)
    }

    /// The bytes of another file, whose path is relative to `folder`.
    fn file(&mut self, uri: &str, index: usize) -> Result<Vec<u8>, MeshError> {
        let shown = brief(uri);
        let Some(folder) = self.folder else {
            let fault = MeshError::new(format!("buffers[{index}] is in another file, `{shown}`"));
            return Err(fault.expected("a file of its own, or a .glb file"));
        };
        if is_address(Path::new(uri)) {
            let fault = MeshError::new(format!("buffers[{index}] is at an address, `{shown}`"));
            return Err(fault.expected("a file: download it first"));
        }
        // Most programs write names percent-encoded, some as they are.
        let plain = folder.join(uri);
        let path = if plain.is_file() { plain } else { folder.join(unescaped(uri)) };
        if !path.is_file() {
            let fault = MeshError::new(format!("there is no file `{shown}` for buffers[{index}]"));
            return Err(fault.expected("the file beside this one, as it was exported"));
        }
        let bytes = open::contents(&path).map_err(|cause| {
            let fault = MeshError::new(format!("the file `{shown}` of buffers[{index}] cannot be read: {cause}"));
            fault.expected("a file that can be read")
        })?;
        self.files.push(path);
        Ok(bytes)
    }
}

/// The bytes that a data URI contains; `data` is what follows `data:`.
fn decoded(data: &str, index: usize) -> Result<Vec<u8>, MeshError> {
    let fault = || {
        let fault = MeshError::new(format!("buffers[{index}] has a data: address that cannot be decoded"));
        fault.expected("bytes in base64, as in data:application/octet-stream;base64,AAAA")
    };
    let (kind, text) = data.split_once(',').ok_or_else(fault)?;
    if !kind.ends_with(";base64") {
        return Err(fault());
    }
    STANDARD.decode(text.trim_ascii()).map_err(|_| fault())
}

/// A name with percent-encoded bytes, such as `%20`, decoded.
fn unescaped(uri: &str) -> String {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let [first, after @ ..] = rest {
        let digits = after.get(..2).and_then(|digits| str::from_utf8(digits).ok());
        let byte = digits.filter(|_| *first == b'%').and_then(|digits| u8::from_str_radix(digits, 16).ok());
        bytes.push(byte.unwrap_or(*first));
        rest = if byte.is_some() { &after[2..] } else { after };
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

#[cfg(test)]
mod tests {
    use super::unescaped;

    #[test]
    fn escapes_in_names_are_bytes_and_other_signs_stay() {
        for (uri, name) in [("a%20b.bin", "a b.bin"), ("100%.bin", "100%.bin"), ("%C3%A9%2", "\u{e9}%2"), ("", "")] {
            assert_eq!(unescaped(uri), name);
        }
    }
}
