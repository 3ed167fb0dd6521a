//! The lines of a user's source that instructions came from, by debugging information.

use std::collections::HashMap;
use std::fs;
use std::path::Path;

use addr2line::Context;
use addr2line::gimli::{Dwarf, EndianSlice, LittleEndian, SectionId};
use object::{Object, ObjectSection};
use serde::{Deserialize, Serialize};

/// A line of a source.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Line {
    /// The file's name without its folders.
    pub file: String,
    pub line: u32,
    /// What is written there; empty if the file cannot be read.
    pub text: String,
}

/// The lines of a shared object.
pub struct Lines {
    context: Option<Context<EndianSlice<'static, LittleEndian>>>,
}

impl Lines {
    /// Those of the file at `path`; none if it says nothing of them.
    pub fn of(path: &Path) -> Self {
        Lines { context: context(path) }
    }

    /// The line of the instruction at an address of the file.
    pub fn at(&self, address: u64) -> Option<Line> {
        let location = self.context.as_ref()?.find_location(address).ok()??;
        let path = Path::new(location.file?);
        let line = location.line?;
        let text = text_of(path).get(line.checked_sub(1)? as usize).cloned().unwrap_or_default();
        Some(Line { file: path.file_name()?.to_string_lossy().into_owned(), line, text })
    }
}

fn context(path: &Path) -> Option<Context<EndianSlice<'static, LittleEndian>>> {
    // Never freed: a process reads one file, and asks for its lines until it ends.
    let data: &'static [u8] = Vec::leak(fs::read(path).ok()?);
    let file = object::File::parse(data).ok()?;
    let section = |id: SectionId| -> Result<_, addr2line::gimli::Error> {
        let section = file.section_by_name(id.name());
        let bytes = section.and_then(|section| section.data().ok()).unwrap_or_default();
        Ok(EndianSlice::new(bytes, LittleEndian))
    };
    Context::from_dwarf(Dwarf::load(section).ok()?).ok()
}

/// The lines of a source, without the space around them.
fn text_of(path: &Path) -> Vec<String> {
    thread_local! {
        static FILES: std::cell::RefCell<HashMap<std::path::PathBuf, Vec<String>>> = Default::default();
    }
    FILES.with_borrow_mut(|files| {
        let read = || {
            let text = fs::read(path).unwrap_or_default();
            String::from_utf8_lossy(&text).lines().map(|line| line.trim().to_owned()).collect()
        };
        files.entry(path.to_owned()).or_insert_with(read).clone()
    })
}
