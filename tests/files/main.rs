//! Files: scenes, meshes and images, read and written, and never trusted.

#![cfg(feature = "files")]

#[allow(unsafe_code)]
#[path = "../common/counting.rs"]
mod counting;

mod compare;
mod corpus;
mod image_files;
mod meshes;
mod scene_files;
mod toml_scenes;
