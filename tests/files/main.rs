//! Files: scenes, meshes and images, read and written, and never trusted.

#![cfg(feature = "files")]

#[allow(unsafe_code)]
#[path = "../common/counting.rs"]
mod counting;

mod clouds;
mod corpus;
mod gltf;
mod image_files;
mod map_coordinates;
mod meshes;
mod meshes_obj;
mod meshes_ply;
mod meshes_stl;
mod odd_pictures;
mod scene_files;
mod toml_scenes;
