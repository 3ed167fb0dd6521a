//! The units assembled for other systems: ELF, Win64 and Mach-O have the same code and constants,
//! under the names that each system expects.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

use iced_x86::{Decoder, DecoderOptions, Mnemonic, OpKind};
use object::{BinaryFormat, File, Object, ObjectSection, ObjectSymbol};
use rayo::internals::kernels::OBJECTS;

/// The formats, as NASM calls them.
const FORMATS: [&str; 3] = ["elf64", "win64", "macho64"];
/// The possible names of each section in the formats.
const SECTIONS: [&[&str]; 3] =
    [&[".text", "__text"], &[".text.called", ".called", "__called"], &[".rodata", ".rdata", "__const"]];

/// The content of a section, independent of the format.
#[derive(Debug, PartialEq)]
struct Section {
    /// The bytes, with zeros where the linker writes, and with a normalised order of the registers
    /// of xchg.
    bytes: Vec<u8>,
    /// The places that the linker writes, and how many bits each has.
    linked: Vec<(u64, u8)>,
    /// The exported symbols by their names in C, with their addresses.
    exported: Vec<(String, u64)>,
}

fn sections(object: &[u8]) -> Vec<Option<Section>> {
    let file = File::parse(object).unwrap();
    let underscore = if file.format() == BinaryFormat::MachO { "_" } else { "" };
    let section = |names: &&[&str]| {
        let section = file.sections().find(|section| names.contains(&section.name().unwrap()))?;
        let mut bytes = section.data().unwrap().to_vec();
        let mut linked: Vec<_> = section.relocations().map(|(at, relocation)| (at, relocation.size())).collect();
        linked.sort_unstable();
        for &(at, bits) in &linked {
            bytes[at as usize..][..usize::from(bits / 8)].fill(0);
        }
        if names.contains(&".text") {
            // NASM 2.16.03 encodes the two registers of xchg in the other order, which has the same
            // effect.
            let code: Vec<_> = Decoder::with_ip(64, &bytes, 0, DecoderOptions::NONE).into_iter().collect();
            for one in code.iter().filter(|one| one.mnemonic() == Mnemonic::Xchg) {
                if one.op0_kind() == OpKind::Register && one.op1_kind() == OpKind::Register {
                    bytes[one.ip() as usize..][..one.len()].fill(0);
                }
            }
        }
        let here = file.symbols().filter(|s| s.is_global() && s.section_index() == Some(section.index()));
        let mut exported: Vec<_> = here
            .map(|symbol| {
                let name = symbol.name().unwrap();
                let name = name.strip_prefix(underscore).unwrap_or_else(|| panic!("{name} has no underscore"));
                (name.to_owned(), symbol.address() - section.address())
            })
            .collect();
        exported.sort_unstable();
        Some(Section { bytes, linked, exported })
    };
    SECTIONS.iter().map(section).collect()
}

/// Assembles the units that are quick to assemble.
fn assembled(folder: &Path) -> Vec<PathBuf> {
    let asm = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join("asm");
    let mut objects = Vec::new();
    for format in FORMATS {
        for unit in ["known", "checked", "chains"] {
            let object = folder.join(format).join(format!("{unit}.o"));
            fs::create_dir_all(object.parent().unwrap()).unwrap();
            let mut nasm = Command::new(env::var("NASM").unwrap_or("nasm".into()));
            // As build.rs does in unoptimised builds.
            nasm.args(cfg!(debug_assertions).then_some("-O1"));
            nasm.args(["-Wall", "-Werror", "-f", format, "-i"])
                .arg(format!("{}/", asm.display()))
                .arg("-o")
                .arg(&object);
            let status = nasm.arg(asm.join(format!("{unit}.asm"))).status();
            let status = status.expect("NASM, which the kernels were built with: name it in the variable NASM");
            assert!(status.success(), "{unit} for {format}");
            objects.push(object);
        }
    }
    objects
}

/// `scripts/toolchains.sh` sets RAYO_OBJECTS to a folder with a subfolder for each version of NASM,
/// each with one for each format.
#[test]
fn every_format_and_every_nasm_has_the_code_of_this_build() {
    let folder = tempfile::tempdir().unwrap();
    let objects = match env::var_os("RAYO_OBJECTS") {
        None => assembled(folder.path()),
        Some(given) => {
            let within = |folder: PathBuf| fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
            within(given.into()).flat_map(within).flat_map(within).collect()
        }
    };
    assert!(objects.len() >= 9, "three units in three formats at least");
    for object in objects {
        let unit = object.file_stem().unwrap().to_str().unwrap();
        let (_, own) = OBJECTS.iter().find(|(name, _)| *name == unit).expect("an object of this build");
        let (own, other) = (sections(own), sections(&fs::read(&object).unwrap()));
        for (own, other) in own.iter().zip(&other) {
            // Do not print the thousands of bytes.
            assert!(own == other, "{}: not the code, constants or names of this build", object.display());
        }
    }
}
