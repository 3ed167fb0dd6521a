//! The pages of argument kept true: every name of the code that they give is in the code.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use crate::architecture::{sources, tokens};

/// The pages whose names are looked up.
const PAGES: [&str; 5] = [
    "ARCHITECTURE.md",
    "CONTRIBUTING.md",
    "docs/no-hit-is-lost.md",
    "docs/life-of-a-picture.md",
    "docs/life-of-a-kernel.md",
];

/// Names of other things: an operation to be added, an instruction.
const OTHERS: [&str; 2] = ["VEC_REFLECT", "prefetchw"];

/// What stands between backticks in the running text of a page.
fn spans(page: &str) -> Vec<String> {
    let text = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(page)).unwrap();
    let prose: String = text.split("```").step_by(2).collect();
    prose.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

/// The words of a name such as `Tiles::view` or `kinds!`; None if it is no name.
fn words_of_name(span: &str) -> Option<Vec<&str>> {
    let words: Vec<_> = span.trim_end_matches("()").trim_end_matches('!').split("::").collect();
    let is_word = |word: &&str| {
        let is_first = |c: char| c.is_ascii_alphabetic() || c == '_';
        word.starts_with(is_first) && word.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
    };
    words.iter().all(is_word).then_some(words)
}

#[test]
fn every_name_on_a_page_is_in_the_code() {
    let sources = sources(&["rs", "asm", "inc", "c", "h", "toml"]);
    let known: BTreeSet<&str> = sources.values().flat_map(|text| tokens(text)).collect();
    let mut checked = 0;
    for page in PAGES {
        for span in spans(page).iter().filter(|span| !OTHERS.contains(&span.as_str())) {
            for word in words_of_name(span).unwrap_or_default() {
                // The symbols of kernels are pasted of parts.
                let is_there = known.contains(word) || word.starts_with("rayo_");
                assert!(is_there, "{page} names `{span}`, and nothing is called {word} in the code");
                checked += 1;
            }
        }
    }
    assert!(checked > 200, "only {checked} names were found");
}

#[test]
fn a_name_is_told_from_other_code() {
    for (span, words) in [
        ("Tiles::view", Some(vec!["Tiles", "view"])),
        ("kinds!", Some(vec!["kinds"])),
        ("16 EPSILON", None),
        ("src/plan", None),
        ("--keep-all", None),
    ] {
        assert_eq!(words_of_name(span), words, "{span}");
    }
}
