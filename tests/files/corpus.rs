//! The fuzzing targets on their corpus and on seeded mutations of it: a short version of what
//! cargo-fuzz does.

#[path = "../../fuzz/targets.rs"]
mod targets;

use std::fs;
use std::path::{Path, PathBuf};

use crate::counting::peak_of;
use rayo::internals::scene::Rng;
use targets::{TARGETS, Target};

/// The number of runs of each target, over all its files.
const ROUNDS: u64 = 7500;

/// Words that are difficult for parsers; further bytes are in `BYTES`.
const WORDS: &str = "0 -1 4 1e39 nan inf -inf 4294967295 18446744073709551615 99999999999999999999 -9223372036854775808 \
    1979-05-27 1/2/3/4 # // [ [[ ]] [] {} \" ' \"\"\" = \\ x a.b.c true mesh [image] list double uchar endloop endsolid f v o \
    \u{feff}";
const BYTES: [&[u8]; 9] = [
    b"\n",
    b" ",
    b"\0",
    b"\xc3",
    b"\xff\xff\xff\xff",
    b"\x7f\x80\x00\x00",
    b"element vertex 999999999\n",
    b"list uint int ",
    b"f 1 2 3\n",
];

fn files(target: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(target);
    let mut files: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    assert!(files.len() >= 4, "{target} has {} files", files.len());
    files
}

/// Runs a target and checks that it takes at most a multiple of its input's length in memory.
/// Pixels, and the parts of scenes shown in errors, take most.
fn run(name: &str, target: Target, source: &[u8]) {
    let ((), peak) = peak_of(|| target(source));
    let times = if name.starts_with("mesh") || name.starts_with("cloud") { 64 } else { 1000 };
    assert!(peak <= times * source.len() + (4 << 20), "{peak} bytes for an input of {}", source.len());
}

#[test]
fn the_corpus_is_small() {
    let size = |file: PathBuf| fs::metadata(file).unwrap().len();
    let bytes: u64 = TARGETS.iter().flat_map(|(name, _)| files(name)).map(size).sum();
    assert!(bytes < 300_000, "{bytes} bytes: minimise it, see CONTRIBUTING.md");
}

#[test]
fn the_corpus_and_its_mutations_are_read_or_refused_in_order() {
    // RAYO_SEED repeats the mutations of an earlier run.
    let seed = std::env::var("RAYO_SEED").ok().and_then(|seed| seed.parse().ok()).unwrap_or(1);
    println!("RAYO_SEED={seed}");
    for (name, target) in TARGETS {
        let files = files(name);
        let rounds = ROUNDS.div_ceil(files.len() as u64);
        for file in files {
            let original = fs::read(&file).unwrap();
            let mut rng = Rng::new(seed);
            for round in 0..rounds {
                let mut source = original.clone();
                // Run the unchanged file first.
                for _ in 0..round.min(1) * (1 + rng.next_u64() % 4) {
                    mutate(&mut source, &mut rng);
                }
                // The output is shown only if the test fails.
                println!("{} round {round}: {}", file.display(), source.escape_ascii());
                run(name, target, &source);
            }
        }
    }
}

/// Mutates the source once: changes a bit or byte, replaces bytes or a word by a piece, or removes,
/// duplicates or cuts off a part.
fn mutate(source: &mut Vec<u8>, rng: &mut Rng) {
    let pieces: Vec<_> = WORDS.split(' ').map(str::as_bytes).chain(BYTES).collect();
    let mut below = |limit: usize| (rng.next_u64() % limit.max(1) as u64) as usize;
    let at = below(source.len());
    let length = below(16).min(source.len() - at);
    let piece = pieces[below(pieces.len())].iter().copied();
    let is_white = |byte: &u8| byte.is_ascii_whitespace();
    match below(8) {
        0 if !source.is_empty() => source[at] ^= 1 << below(8),
        1 if !source.is_empty() => source[at] = below(256) as u8,
        2 => drop(source.splice(at..at + length, piece)),
        3 => drop(source.splice(at..at, piece)),
        4 => drop(source.drain(at..at + length)),
        5 => drop(source.splice(at..at, source[at..at + length].to_vec())),
        6 => {
            let start = source[..at].iter().rposition(is_white).map_or(0, |white| white + 1);
            let end = source[at..].iter().position(is_white).map_or(source.len(), |white| at + white);
            drop(source.splice(start..end, piece));
        }
        _ => source.truncate(at),
    }
}
