//! Fuzzes the parser of PDB files.
#![no_main]

#[path = "../targets.rs"]
#[allow(dead_code, reason = "each binary runs one of the targets")]
mod targets;

libfuzzer_sys::fuzz_target!(|source: &[u8]| targets::cloud_pdb(source));
