//! The rules that the sources keep: layers, where `unsafe` may be, what a file begins with, how
//! assembly is written.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use proc_macro2::{Delimiter, TokenStream, TokenTree};

/// A layer of a package, which is a folder or a file, and what of its package it may import.
struct Layer {
    folder: &'static str,
    name: &'static str,
    below: &'static [&'static str],
}

/// The layers of the library and of the lab. Which package needs which, Cargo knows.
const LAYERS: [Layer; 11] = [
    Layer { folder: "src", name: "render", below: &["plan", "scene", "kernels", "reference"] },
    Layer { folder: "src", name: "plan", below: &["scene", "kernels", "reference"] },
    Layer { folder: "src", name: "scene", below: &["kernels", "reference"] },
    Layer { folder: "src", name: "kernels", below: &[] },
    Layer { folder: "src", name: "reference", below: &[] },
    Layer { folder: "lab/src", name: "experiments", below: &["truth", "operands", "families", "exact", "measure"] },
    Layer { folder: "lab/src", name: "truth", below: &["exact"] },
    Layer { folder: "lab/src", name: "operands", below: &[] },
    Layer { folder: "lab/src", name: "families", below: &[] },
    Layer { folder: "lab/src", name: "exact", below: &[] },
    Layer { folder: "lab/src", name: "measure", below: &[] },
];

/// The sources of all packages, but for those of fuzzing.
const SOURCES: [&str; 10] = ["src", "asm", "lab", "cli", "mpi", "view", "tests", "benches", "examples", "build.rs"];

/// The sources with one of these extensions, by their path from the root of the repository.
pub(super) fn sources(extensions: &[&str]) -> BTreeMap<String, String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut found = BTreeMap::new();
    let mut open: Vec<PathBuf> = SOURCES.map(|name| root.join(name)).to_vec();
    while let Some(path) = open.pop() {
        if path.is_dir() {
            open.extend(fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path()));
        } else if path.extension().is_some_and(|extension| extensions.iter().any(|e| extension == *e)) {
            let name = path.strip_prefix(root).unwrap().to_str().unwrap().to_owned();
            found.insert(name, fs::read_to_string(path).unwrap());
        }
    }
    assert!(!found.is_empty());
    found
}

/// The names and signs of Rust: without its comments, strings and numbers.
fn code(text: &str) -> String {
    fn add(stream: TokenStream, code: &mut String) {
        for token in stream {
            match token {
                TokenTree::Group(group) => {
                    let [open, close] = if group.delimiter() == Delimiter::Brace { ["{ ", "} "] } else { ["( ", ") "] };
                    *code += open;
                    add(group.stream(), code);
                    *code += close;
                }
                TokenTree::Ident(_) | TokenTree::Punct(_) => *code += &format!("{token} "),
                TokenTree::Literal(_) => {}
            }
        }
    }
    let mut code = String::new();
    add(text.parse().unwrap(), &mut code);
    code
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// The words of a text, and its other characters one by one.
pub(super) fn tokens(text: &str) -> Vec<&str> {
    let mut tokens = Vec::new();
    let mut rest = text.trim_start();
    while !rest.is_empty() {
        let word = rest.find(|c| !is_word(c)).unwrap_or(rest.len());
        let end = if word > 0 { word } else { rest.chars().next().unwrap().len_utf8() };
        tokens.push(&rest[..end]);
        rest = rest[end..].trim_start();
    }
    tokens
}

/// What follows `crate::` in `code`: a name, or every first name of a list in braces.
fn imports(code: &str) -> BTreeSet<String> {
    named_after("crate", code)
}

/// The same of what follows `root::`.
fn named_after(root: &str, code: &str) -> BTreeSet<String> {
    let tokens = tokens(code);
    let mut found = BTreeSet::new();
    for (at, _) in tokens.windows(3).enumerate().filter(|(_, window)| *window == [root, ":", ":"]) {
        let after = &tokens[at + 3..];
        if after.first() != Some(&"{") {
            found.extend(after.first().map(|name| name.to_string()));
            continue;
        }
        let mut depth = 0;
        for pair in after.windows(2) {
            depth += i32::from(pair[0] == "{");
            depth -= i32::from(pair[0] == "}");
            if depth == 0 {
                break;
            }
            // At the first level, what comes after a brace or a comma is the first name of a path.
            if depth == 1 && ["{", ","].contains(&pair[0]) && pair[1] != "}" {
                found.insert(pair[1].to_owned());
            }
        }
    }
    found
}

/// The layers that paths of `super` alone lead to from a file of a layer, so many modules below the
/// root.
fn imports_through_super(code: &str, depth: usize) -> BTreeSet<String> {
    let step = ["super", ":", ":"];
    let tokens = tokens(code);
    let mut found = BTreeSet::new();
    for at in 0..tokens.len() {
        let steps = tokens[at..].chunks(3).take_while(|chunk| *chunk == step).count();
        let inside = at >= 3 && tokens[at - 3..at] == step;
        if steps >= depth && !inside {
            found.extend(tokens.get(at + 3 * steps).map(|name| name.to_string()));
        }
    }
    found
}

#[test]
fn every_layer_imports_only_from_those_below_it() {
    let mut seen = BTreeSet::new();
    for (path, text) in sources(&["rs"]) {
        let Some(folder) = ["src", "lab/src"].into_iter().find(|folder| path.starts_with(&format!("{folder}/"))) else {
            continue;
        };
        let inner: Vec<_> = path[folder.len() + 1..].split('/').collect();
        if inner == ["lib.rs"] {
            continue;
        }
        let name = inner[0].trim_end_matches(".rs");
        let layers: Vec<_> = LAYERS.iter().filter(|layer| layer.folder == folder).collect();
        let layer = layers.iter().find(|layer| layer.name == name);
        let layer = layer.unwrap_or_else(|| panic!("{path}: `{name}` is no layer of {folder}"));
        seen.insert((folder, name.to_owned()));
        let code = code(&text);
        // A layer of one file is as deep as the first file of a folder.
        let depth = inner.len().max(2) - usize::from(inner.last() == Some(&"mod.rs") || inner.len() == 1);
        let is_layer = |name: &String| layers.iter().any(|layer| layer.name == name);
        let mut imports = imports(&code);
        imports.extend(imports_through_super(&code, depth).into_iter().filter(is_layer));
        for import in imports.iter().filter(|import| *import != name) {
            assert!(layer.below.contains(&import.as_str()), "{path}: `{name}` must not import `{import}`");
        }
    }
    assert_eq!(seen.len(), LAYERS.len(), "only {seen:?}");
}

#[test]
fn no_module_of_the_kernels_needs_one_that_needs_it() {
    let kernels: BTreeMap<_, _> = sources(&["rs"])
        .into_iter()
        .filter_map(|(path, text)| Some((path.strip_prefix("src/kernels/")?.strip_suffix(".rs")?.to_owned(), text)))
        .filter(|(module, _)| module != "mod")
        .collect();
    let modules: BTreeSet<_> = kernels.keys().cloned().collect();
    let needs = |module: &str, text: &str| {
        let named = ["super", "kernels"].map(|root| named_after(root, &code(text)));
        named.into_iter().flatten().filter(|name| name != module && modules.contains(name)).collect::<BTreeSet<_>>()
    };
    let mut above: BTreeMap<_, _> =
        kernels.iter().map(|(module, text)| (module.clone(), needs(module, text))).collect();
    assert!(above.values().map(BTreeSet::len).sum::<usize>() > modules.len(), "{above:?}");
    // Whoever needs nobody that is left goes, until nobody is left.
    while let Some(lowest) = above.iter().find(|(_, needs)| needs.is_empty()).map(|(module, _)| module.clone()) {
        above.remove(&lowest);
        above.values_mut().for_each(|needs| _ = needs.remove(&lowest));
    }
    assert!(above.is_empty(), "these need each other: {above:?}");
}

/// The lines of a source that are code: not blank, no comment, and not in the unit tests that end a
/// file of Rust.
fn code_lines(path: &str, text: &str) -> usize {
    let comment: &[&str] = match path.rsplit('.').next() {
        Some("rs") => &["//"],
        Some("asm" | "inc") => &[";"],
        _ => &["//", "/*", "*"],
    };
    let product = text.split("#[cfg(test)]\nmod ").next().unwrap_or_default();
    let is_code = |line: &&str| !line.is_empty() && !comment.iter().any(|mark| line.starts_with(mark));
    product.lines().map(str::trim).filter(is_code).count()
}

#[test]
fn examples_need_nothing_that_the_documentation_hides() {
    for (path, text) in sources(&["rs"]).iter().filter(|(path, _)| path.starts_with("examples/")) {
        let reaches_behind = code(text).contains("rayo : : internals : :");
        // One of them calls a kernel, and says at its top that this is no part of the interface.
        let is_said = text.contains("`rayo::internals` is no part");
        assert!(!reaches_behind || is_said, "{path} reaches behind the interface");
    }
}

#[test]
fn it_stays_small() {
    // Some 2,950 of these lines prove operations for all inputs, and replace no other code: no
    // number of tests can show as much.
    const CODE_LINES: usize = 62_160;
    const KERNELS: usize = 39;
    const PRODUCT: [&str; 6] = ["src/", "asm/", "lab/src/", "cli/src/", "mpi/src/", "view/src/"];
    let sources = sources(&["rs", "asm", "inc", "c", "h"]);
    let is_product = |path: &str| PRODUCT.iter().any(|folder| path.starts_with(folder));
    let of_product = sources.iter().filter(|(path, _)| is_product(path));
    let lines: usize = of_product.map(|(path, text)| code_lines(path, text)).sum();
    assert!(lines <= CODE_LINES, "the packages have {lines} lines of code, of which there may be {CODE_LINES}");
    let kernels = rayo::internals::kernels::packet_symbols();
    let of_one = kernels.iter().filter(|symbol| symbol.starts_with("rayo_avx2_")).count();
    assert!(of_one <= KERNELS, "{of_one} packet kernels, of which there may be {KERNELS} for each instruction set");
}

#[test]
fn comments_blank_lines_and_unit_tests_cost_nothing() {
    let rust =
        "//! What it is.\n\nfn f() {\n    // Why.\n    g();\n}\n\n#[cfg(test)]\nmod tests {\n    use super::*;\n}\n";
    assert_eq!(code_lines("a.rs", rust), 3);
    assert_eq!(code_lines("a.inc", "; what it is\n\n    mov eax, 1 ; why\n"), 1);
    assert_eq!(code_lines("a.h", "/* what it is,\n * and why */\nint f(void);\n"), 1);
}

#[test]
fn the_library_is_what_its_first_page_names() {
    let page = &sources(&["rs"])["src/lib.rs"];
    let outside: Vec<_> = page.lines().filter(|line| line.starts_with("pub mod ")).collect();
    assert_eq!(outside, ["pub mod internals {"], "modules of src/lib.rs are public");
    assert!(page.contains("#[doc(hidden)]\npub mod internals {"));
    let names = page.split("\npub use ").skip(1).map(|list| list.split(';').next().unwrap().split(',').count());
    let names: usize = names.sum();
    assert!((50..85).contains(&names), "{names} names");
}

fn is_test(path: &str) -> bool {
    path.starts_with("tests/") || path.contains("/tests/")
}

#[test]
fn only_the_kernels_are_unsafe() {
    let sources = sources(&["rs"]);
    let is_unsafe = |text: &str| tokens(&code(text)).contains(&"unsafe");
    // A test has to allow it to itself, which the lints of the package see to.
    let found = sources.iter().filter(|(path, text)| !is_test(path) && is_unsafe(text));
    let (inside, outside): (Vec<_>, Vec<_>) = found.map(|(path, _)| path).partition(|p| p.starts_with("src/kernels/"));
    assert_eq!(outside, Vec::<&String>::new());
    assert!(!inside.is_empty());
    let allows = sources.iter().filter(|(path, text)| !is_test(path) && code(text).contains("unsafe_code"));
    assert_eq!(allows.map(|(path, _)| path.as_str()).collect::<Vec<_>>(), ["src/kernels/mod.rs"]);
}

#[test]
fn every_file_begins_with_a_sentence_that_says_what_lives_there() {
    for (path, text) in sources(&["rs", "asm", "inc", "c", "h"]) {
        let first = text.lines().next().unwrap_or_default();
        let name = path.rsplit('/').next().unwrap();
        // In Rust it is the first paragraph, of one line or two.
        let paragraph: Vec<_> = text.lines().map_while(|line| line.strip_prefix("//! ")).collect();
        let paragraph = paragraph.join(" ");
        let sentence = match path.rsplit('.').next().unwrap() {
            "rs" => Some(&*paragraph),
            "c" | "h" => first.strip_prefix(&format!("/* {name} - ")).and_then(|text| text.strip_suffix(" */")),
            _ => first.strip_prefix(&format!("; {name} - ")),
        };
        let fine = sentence.is_some_and(|sentence| sentence.split(' ').count() > 2 && sentence.ends_with('.'));
        assert!(fine, "{path} begins with: {first}");
    }
}

#[test]
fn lines_of_assembly_and_c_have_no_tabs_and_at_most_120_columns() {
    for (path, text) in sources(&["asm", "inc", "c", "h"]) {
        for (number, line) in text.lines().enumerate() {
            assert!(!line.contains('\t'), "{path}:{}: a tab", number + 1);
            assert!(line.chars().count() <= 120, "{path}:{}: {} columns", number + 1, line.chars().count());
            assert_eq!(line, line.trim_end(), "{path}:{}: space at the end", number + 1);
        }
    }
}

/// A multi-line macro of the assembly.
struct Macro {
    place: String,
    name: String,
    parameters: usize,
    /// The comment right above it.
    comment: Vec<String>,
    body: Vec<String>,
}

/// Every macro of asm/.
fn macros() -> Vec<Macro> {
    let mut macros = Vec::new();
    for (path, text) in sources(&["asm", "inc"]) {
        let lines: Vec<_> = text.lines().collect();
        for (at, line) in lines.iter().enumerate() {
            let trimmed = line.trim_start();
            assert!(!trimmed.starts_with("%imacro"), "{path}:{}: NASM's %imacro takes any case", at + 1);
            let Some(head) = trimmed.strip_prefix("%macro ") else { continue };
            let [name, parameters] = head.split_whitespace().collect::<Vec<_>>()[..] else {
                panic!("{path}:{}: not a name and a number of parameters: {line}", at + 1)
            };
            let above = lines[..at].iter().rev().take_while(|line| line.starts_with(';')).count();
            let length = lines[at..].iter().position(|line| line.trim_start() == "%endmacro").expect("%endmacro");
            let own = |lines: &[&str]| lines.iter().map(|line| line.to_string()).collect();
            macros.push(Macro {
                place: format!("{path}:{}: {name}", at + 1),
                name: name.to_owned(),
                // A plus: the last one takes what is left, commas and all.
                parameters: parameters
                    .trim_end_matches('+')
                    .parse()
                    .unwrap_or_else(|_| panic!("{path}: how many parameters has {name}?")),
                comment: own(&lines[at - above..at]),
                body: own(&lines[at + 1..at + length]),
            });
        }
    }
    assert!(macros.len() > 10);
    macros
}

#[test]
fn every_macro_is_uppercase_and_its_comment_says_what_it_does() {
    for Macro { place, name, comment, .. } in macros() {
        assert!(name.chars().all(|c| c.is_ascii_uppercase() || c.is_ascii_digit() || c == '_'), "{place}");
        let first = comment.first().map(String::as_str).unwrap_or_default();
        assert!(first.starts_with(&format!("; {name} - ")), "{place}: the comment above begins with `{first}`");
        let counted = comment.iter().any(|line| line.starts_with(";   instructions "));
        assert!(counted || !place.starts_with("asm/include"), "{place}: its instructions are not counted");
    }
}

/// What the lines after the word `equals` in a comment name.
fn equals(comment: &[String]) -> Vec<String> {
    let lines = comment.iter().filter_map(|line| line.strip_prefix(";   equals "));
    let words = lines.flat_map(|line| line.split([' ', ',', ';'])).filter(|word| word.contains("::"));
    words.map(str::to_owned).collect()
}

/// Whether src/, or tests/, has what a path names: a module, or something in one.
fn is_there(path: &str, sources: &BTreeMap<String, String>) -> bool {
    let parts: Vec<_> = path.split("::").collect();
    // The longest path that is a file is the module.
    let root = match parts[0] {
        "tests" => "lab/",
        "experiments" => "lab/src/",
        _ => "src/",
    };
    let file = |length: usize| sources.get(&format!("{root}{}.rs", parts[..length].join("/")));
    let module = (2..=parts.len()).rev().find(|length| file(*length).is_some()).unwrap_or(parts.len());
    let (text, inner) = (file(module), &parts[module..]);
    let defined = |text: &String, name: &str| {
        let tokens = tokens(text);
        tokens.windows(2).any(|pair| ["fn", "struct"].contains(&pair[0]) && pair[1] == name)
    };
    text.is_some_and(|text| inner.iter().all(|name| defined(text, name)))
}

#[test]
fn every_formula_and_every_tracer_names_the_twin_that_it_equals() {
    let rust = sources(&["rs"]);
    let mut formulas = 0;
    for Macro { place, comment, body, .. } in macros() {
        // What only packs, or is one operation of a packet, is no formula; estimates have no twin.
        let path = comment.iter().find_map(|line| line.strip_prefix(";   critical path "));
        let in_path = path.is_some_and(|path| {
            let operations = ["mul", "add", "sub", "div", "fma", "fnma", "hadd", "sqrt", "dot"];
            path.contains("->") && tokens(path).iter().any(|word| operations.contains(word))
        });
        // A tracer's own macros have operations of more than one kind; its functions are named in
        // the head of the file.
        let words: BTreeSet<_> = body.iter().filter_map(|line| line.split_whitespace().next()).collect();
        let operations = ["VADD", "VSUB", "VMUL", "VDIV", "VSQRT", "VMIN", "VMAX", "VROUND", "DOT3_UNFUSED", "VFMA"];
        let in_tracer = place.starts_with("asm/tracers/")
            && !words.contains("FUNC")
            && operations.iter().filter(|operation| words.contains(*operation)).count() > 1;
        let in_include = place.starts_with("asm/include") && !place.starts_with("asm/include/packet.inc");
        if in_include && in_path || in_tracer {
            formulas += 1;
            let twins = equals(&comment);
            assert!(!twins.is_empty(), "{place}: no twin is named");
            assert!(twins.iter().all(|twin| twin.contains("::") && is_there(twin, &rust)), "{place}: {twins:?}");
        }
    }
    assert!(formulas > 50, "{formulas}");
    for (path, text) in sources(&["asm"]).into_iter().filter(|(path, _)| path.starts_with("asm/tracers/")) {
        let head: Vec<_> = text.lines().take_while(|line| line.starts_with(';')).map(str::to_owned).collect();
        let twins = equals(&head);
        assert!(!twins.is_empty(), "{path}: no twin is named");
        let ours = ["reference::", "plan::", "kernels::"];
        for twin in twins.iter().filter(|twin| ours.iter().any(|layer| twin.starts_with(layer))) {
            assert!(is_there(twin, &rust), "{path}: there is no {twin}");
        }
    }
}

#[test]
fn parameters_of_macros_have_names_and_tags() {
    for Macro { place, parameters, body, .. } in macros() {
        let mut named = Vec::new();
        for line in &body {
            let line = line.trim_start();
            let (code, comment) = line.split_once(';').unwrap_or((line, ""));
            let numbers = parameter_numbers(code);
            match code.split_whitespace().collect::<Vec<_>>()[..] {
                ["%define", name, value] if name.starts_with("%%") && !numbers.is_empty() => {
                    assert_eq!(value, format!("%{}", numbers[0]), "{place}: {line}");
                    named.push(numbers[0]);
                    let tag = comment.trim_start();
                    let known = ["[in]", "[out]", "[in/out]", "[clobbered]", "[clobbered "];
                    assert!(known.iter().any(|known| tag.starts_with(known)), "{place}: {name} has no tag: {line}");
                    let text = tag.split_once(']').map_or("", |(_, text)| text.trim());
                    assert!(!text.is_empty(), "{place}: {name} is not explained");
                }
                _ => assert!(numbers.is_empty(), "{place}: a parameter without a name: {line}"),
            }
        }
        assert_eq!(
            named,
            (1..=parameters).collect::<Vec<_>>(),
            "{place}: each parameter gets one name, in their order"
        );
    }
}

/// The n of every %n in a line.
fn parameter_numbers(code: &str) -> Vec<usize> {
    let digits = |text: &str| text.find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len());
    code.split('%').skip(1).filter_map(|after| after[..digits(after)].parse().ok()).collect()
}

#[test]
fn the_formulas_touch_no_register_but_their_parameters() {
    let is_register = |word: &str| {
        let vector = ["xmm", "ymm", "zmm", "mm", "k"].iter().any(|kind| {
            word.strip_prefix(kind).is_some_and(|number| number.parse::<u8>().is_ok_and(|number| number < 32))
        });
        let general = ["ax", "bx", "cx", "dx", "si", "di", "bp", "sp"];
        let old = word.strip_prefix(['r', 'e']).is_some_and(|rest| general.contains(&rest));
        let new = word.strip_prefix('r').is_some_and(|rest| {
            rest.trim_end_matches(['d', 'w', 'b']).parse::<u8>().is_ok_and(|number| (8..16).contains(&number))
        });
        vector || old || new
    };
    assert!(["xmm0", "zmm31", "rax", "esi", "r8", "r15d", "k1"].into_iter().all(is_register));
    assert!(!["r", "k", "max", "xmm", "r2", "axis"].into_iter().any(is_register));
    // Which registers there are is the business of isa.inc.
    for Macro { place, body, .. } in macros().into_iter().filter(|m| m.place.starts_with("asm/include")) {
        if place.starts_with("asm/include/isa.inc") {
            continue;
        }
        for line in body {
            let code = line.split(';').next().unwrap_or_default().replace("%%", "parameter_");
            let register = tokens(&code).into_iter().find(|word| is_register(&word.to_lowercase()));
            assert_eq!(register, None, "{place}: {line}");
        }
    }
}

#[test]
fn nothing_but_isa_inc_asks_for_an_instruction_set_by_its_name() {
    let mut conditions = 0;
    for (path, text) in sources(&["asm", "inc"]) {
        for (number, line) in text.lines().enumerate() {
            let code = line.split(';').next().unwrap_or_default().trim_start().to_lowercase();
            if !["%if", "%elif"].iter().any(|word| code.starts_with(word)) {
                continue;
            }
            conditions += 1;
            let named = tokens(&code).into_iter().any(|word| ["isa", "sse41", "avx2", "avx512"].contains(&word));
            assert!(!named || path == "asm/include/isa.inc", "{path}:{}: {line}", number + 1);
        }
    }
    assert!(conditions > 0);
}

/// The lines of `cargo tree` with these arguments.
fn tree(arguments: &[&str]) -> BTreeSet<String> {
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or("cargo".into()));
    cargo.args(["tree", "--offline", "--locked", "--prefix", "none"]);
    let output = cargo.args(arguments).current_dir(env!("CARGO_MANIFEST_DIR")).output().unwrap();
    assert!(output.status.success(), "{output:?}");
    let lines = String::from_utf8(output.stdout).unwrap();
    lines.lines().map(|line| line.trim_end_matches(" (*)").to_owned()).filter(|line| !line.is_empty()).collect()
}

/// The crates that a build with these arguments links, as cargo tells.
fn crates(arguments: &[&str]) -> BTreeSet<String> {
    let lines = tree(&[&["--edges", "normal", "--format", "{p}"], arguments].concat());
    lines.iter().filter_map(|line| Some(line.split_once(' ')?.0.to_owned())).collect()
}

/// Of other features Cargo would build anew, for the tests, whatever depends on them: the library
/// and the lab too.
#[test]
fn tests_link_the_crates_that_are_built_for_the_program() {
    let format = ["--format", "{p} [{f}]", "--edges"];
    let of_program = tree(&[&format[..], &["normal,build"]].concat());
    let packages = ["normal,build,dev", "-p", "rayo", "-p", "rayo-lab", "-p", "rayo-cli"];
    let of_tests = tree(&[&format[..], &packages].concat());
    let built_anew: Vec<_> = of_program.difference(&of_tests).collect();
    assert!(of_program.len() > 100 && built_anew.is_empty(), "lab/Cargo.toml has to ask for as much: {built_anew:?}");
}

#[test]
fn library_alone_has_under_40_crates() {
    let lean = crates(&["-p", "rayo", "--no-default-features", "--features", "asm,c"]);
    assert!(lean.contains("rayo") && lean.contains("rayon") && lean.len() < 40, "{} crates: {lean:?}", lean.len());
    let with_files = crates(&["-p", "rayo"]);
    let program = crates(&[]);
    for (of, name) in [
        (&with_files, "image"),
        (&with_files, "toml"),
        (&program, "clap"),
        (&program, "dashu-float"),
        (&program, "iced-x86"),
        (&program, "plotters"),
    ] {
        assert!(of.contains(name) && !lean.contains(name), "{name}: {lean:?}");
    }
    assert!(!with_files.contains("clap") && !with_files.contains("plotters"), "{with_files:?}");
}
