//! Names in documents that are read back: of engines, outputs, families and the like, as the program's own are.

use std::collections::BTreeSet;
use std::sync::Mutex;

use serde::{Deserialize, Deserializer};

/// A name that the program has, or that a document of another run had.
pub type Name = &'static str;

/// Each name that was read, once: they are few, and the program that reads them soon ends.
static READ: Mutex<BTreeSet<Name>> = Mutex::new(BTreeSet::new());

fn of(text: String) -> Name {
    let mut read = READ.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    if let Some(name) = read.get(text.as_str()) {
        return name;
    }
    let name = Box::leak(text.into_boxed_str());
    read.insert(name);
    name
}

/// A name.
///
/// # Errors
/// What is no string.
pub fn read<'de, D: Deserializer<'de>>(from: D) -> Result<Name, D::Error> {
    String::deserialize(from).map(of)
}

/// A name, or null.
///
/// # Errors
/// What is neither.
pub fn read_optional<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Name>, D::Error> {
    Ok(Option::<String>::deserialize(from)?.map(of))
}
