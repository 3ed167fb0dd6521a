//! The rules that the sources keep: layers, where `unsafe` may be, what a file begins with, how assembly is written.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use proc_macro2::{Delimiter, TokenStream, TokenTree};

/// The layers of src/, and what each may import.
const LAYERS: [(&str, &[&str]); 9] = [
    ("cli", &["experiments", "render", "plan", "measure", "scene", "ranks", "kernels", "reference"]),
    ("experiments", &["render", "plan", "measure", "scene", "ranks", "kernels", "reference"]),
    ("render", &["plan", "measure", "scene", "ranks", "kernels", "reference"]),
    ("plan", &["measure", "scene", "kernels", "reference"]),
    ("measure", &["kernels", "reference"]),
    ("scene", &["kernels", "reference"]),
    ("ranks", &["kernels"]),
    ("kernels", &[]),
    ("reference", &[]),
];

/// The sources with one of these extensions, by their path from the root of the repository.
fn sources(extensions: &[&str]) -> BTreeMap<String, String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut found = BTreeMap::new();
    let mut open: Vec<PathBuf> =
        ["src", "asm", "tests", "benches", "examples", "build.rs"].map(|name| root.join(name)).to_vec();
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
fn tokens(text: &str) -> Vec<&str> {
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

/// The layers that paths of `super` alone lead to from a file of a layer, so many modules below the root.
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
    let allowed: BTreeMap<_, _> = LAYERS.into_iter().collect();
    let mut seen = BTreeSet::new();
    for (path, text) in sources(&["rs"]) {
        let parts: Vec<_> = path.split('/').collect();
        let ["src", layer, inner @ ..] = &parts[..] else { continue };
        if inner.is_empty() {
            assert!(["lib.rs", "main.rs"].contains(layer), "{path} belongs to no layer");
            continue;
        }
        let below = allowed.get(layer).unwrap_or_else(|| panic!("{path}: `{layer}` is no layer"));
        seen.insert(layer.to_string());
        let code = code(&text);
        let depth = inner.len() - usize::from(inner.last() == Some(&"mod.rs")) + 1;
        let mut imports = imports(&code);
        imports.extend(imports_through_super(&code, depth).into_iter().filter(|name| allowed.contains_key(&**name)));
        for import in imports.iter().filter(|import| *import != layer) {
            assert!(below.contains(&import.as_str()), "{path}: `{layer}` must not import `{import}`");
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

/// What is added takes the place of something, or argues for more here: shadows were asked for.
#[test]
fn it_stays_small() {
    const LINES: usize = 58_647;
    const KERNELS: usize = 39;
    let sources = sources(&["rs", "asm", "inc", "c", "h", "md", "css", "js", "csv"]);
    let of_product = sources.iter().filter(|(path, _)| ["src/", "asm/"].iter().any(|folder| path.starts_with(folder)));
    let lines: usize = of_product.map(|(_, text)| text.lines().count()).sum();
    assert!(lines <= LINES, "src and asm have {lines} lines, of which there may be {LINES}");
    assert!(lines > LINES - 500, "src and asm have {lines} lines: lower the budget of {LINES} to what they need");
    let kernels = rayo::kernels::packet_symbols();
    let of_one = kernels.iter().filter(|symbol| symbol.starts_with("rayo_avx2_")).count();
    assert!(of_one <= KERNELS, "{of_one} packet kernels, of which there may be {KERNELS} for each instruction set");
}

#[test]
fn the_library_is_what_its_first_page_names() {
    let page = &sources(&["rs"])["src/lib.rs"];
    let modules: Vec<_> = page.split_inclusive("pub mod ").collect();
    let hidden = |before: &&str| before.ends_with("#[doc(hidden)]\npub mod ");
    assert!(modules.len() > 6 && modules[..modules.len() - 1].iter().all(hidden), "a module of src/lib.rs is public");
    let names = page.split("pub use ").skip(1).map(|list| list.split(';').next().unwrap().split(',').count());
    let names: usize = names.sum();
    assert!((50..80).contains(&names), "{names} names");
}

#[test]
fn only_the_kernels_are_unsafe() {
    let sources = sources(&["rs"]);
    let is_unsafe = |text: &str| tokens(&code(text)).contains(&"unsafe");
    // A test has to allow it to itself, which the lints of the package see to.
    let found = sources.iter().filter(|(path, text)| !path.starts_with("tests/") && is_unsafe(text));
    let (inside, outside): (Vec<_>, Vec<_>) = found.map(|(path, _)| path).partition(|p| p.starts_with("src/kernels/"));
    assert_eq!(outside, Vec::<&String>::new());
    assert!(!inside.is_empty());
    let allows = sources.iter().filter(|(path, text)| path.starts_with("src/") && code(text).contains("unsafe_code"));
    assert_eq!(allows.map(|(path, _)| path.as_str()).collect::<Vec<_>>(), ["src/kernels/mod.rs"]);
}

#[test]
fn every_file_begins_with_a_sentence_that_says_what_lives_there() {
    for (path, text) in sources(&["rs", "asm", "inc", "c", "h"]) {
        let first = text.lines().next().unwrap_or_default();
        let name = path.rsplit('/').next().unwrap();
        let sentence = match path.rsplit('.').next().unwrap() {
            "rs" => first.strip_prefix("//! "),
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
    let root = if path.starts_with("tests::") { "" } else { "src/" };
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
        // A tracer's own macros have operations of more than one kind; its functions are named in the head of the file.
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
fn every_parameter_of_a_macro_has_a_name_and_a_tag_and_is_used_by_its_name() {
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

/// The crates that a build with these arguments links, as cargo tells.
fn crates(arguments: &[&str]) -> BTreeSet<String> {
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or("cargo".into()));
    cargo.args(["tree", "--offline", "--locked", "--edges", "normal", "--prefix", "none", "--format", "{p}"]);
    let output = cargo.args(arguments).current_dir(env!("CARGO_MANIFEST_DIR")).output().unwrap();
    assert!(output.status.success(), "{output:?}");
    let names = String::from_utf8(output.stdout).unwrap();
    names.lines().filter_map(|line| line.split(' ').next()).filter(|name| !name.is_empty()).map(str::to_owned).collect()
}

#[test]
fn the_library_alone_has_under_40_crates_and_none_for_files_experiments_and_the_program() {
    let lean = crates(&["--no-default-features", "--features", "asm,c"]);
    assert!(lean.contains("rayo") && lean.contains("rayon") && lean.len() < 40, "{} crates: {lean:?}", lean.len());
    let whole = crates(&[]);
    for other in ["clap", "dashu-float", "iced-x86", "image", "plotters", "toml"] {
        assert!(whole.contains(other) && !lean.contains(other), "{other}: {lean:?}");
    }
}
