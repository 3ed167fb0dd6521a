//! Fuzzes the parser of glTF meshes.
#![no_main]

#[path = "../targets.rs"]
#[allow(dead_code, reason = "each binary runs one of the targets")]
mod targets;

libfuzzer_sys::fuzz_target!(|source: &[u8]| targets::mesh_gltf(source));
