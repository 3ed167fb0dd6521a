//! Checks the documents: their commands run, and the paths, options, targets and pictures that they
//! name exist.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::extent::all;
use crate::program::rayo;
use tempfile::TempDir;

/// The documents that exist in English and in Spanish.
const GUIDES: [[&str; 2]; 2] = [["README.md", "LEEME.md"], ["docs/tutorial.md", "docs/tutorial.es.md"]];

/// The pages whose commands are run: all that have `sh` blocks.
const PAGES: [&str; 6] =
    ["README.md", "docs/tutorial.md", "docs/counts.md", "docs/image-files.md", "docs/leaving-out.md", "docs/try.md"];

/// How the commands begin that are not run here, and why.
const NOT_RUN: [(&str, &str); 8] = [
    ("make build", "it may install packages"),
    ("make demo", "it measures for minutes"),
    ("make test", "this test is a part of it"),
    ("make counts", "it writes into the sources"),
    ("export PATH=", "tests call the program by its path"),
    ("rayo experiment --ladder", "it measures for minutes"),
    ("rayo report --quick", "it measures for a minute; cli/tests/commands/report.rs runs it"),
    (
        "rayo ops",
        "it counts and times everything; the tutorial's with --op are run, and cli/tests/commands/ops.rs runs it",
    ),
];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap()
}

fn text(path: impl AsRef<Path>) -> String {
    let path = root().join(path);
    fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The paths of all pages, relative to the root.
fn documents() -> Vec<String> {
    let of = |folder: &'static str| {
        let names = fs::read_dir(root().join(folder)).unwrap().map(|entry| entry.unwrap().file_name());
        names.map(move |name| format!("{folder}{}", name.to_str().unwrap())).filter(|name| name.ends_with(".md"))
    };
    let documents: Vec<_> = ["", "docs/", "docs/results/"].into_iter().flat_map(of).collect();
    assert!(documents.len() > 15, "{documents:?}");
    documents
}

/// The blocks of a document that are fenced as `language`.
fn blocks(document: &str, language: &str) -> Vec<String> {
    let text = text(document);
    let begin = format!("```{language}\n");
    let blocks: Vec<_> = text.split(&begin).skip(1).map(|rest| rest.split("```").next().unwrap().to_owned()).collect();
    assert!(!blocks.is_empty(), "{document} has no block of {language}");
    blocks
}

/// The commands in a document's `sh` blocks, without trailing comments.
fn lines_of(document: &str) -> Vec<String> {
    let lines = blocks(document, "sh").concat();
    lines.lines().map(|line| line.split(" #").next().unwrap().trim_end().to_owned()).collect()
}

/// The arguments of a command, if it is a `rayo` command.
fn arguments_of(line: &str) -> Option<Vec<String>> {
    Some(line.strip_prefix("rayo ")?.split_whitespace().map(str::to_owned).collect())
}

fn is_run(line: &str) -> bool {
    let is_exception = |beginning: &str| line == beginning || beginning.ends_with('=') && line.starts_with(beginning);
    !NOT_RUN.iter().any(|(beginning, _)| is_exception(beginning))
}

/// The `rayo` commands of all pages.
fn commands() -> Vec<Vec<String>> {
    PAGES.iter().flat_map(|page| lines_of(page)).filter_map(|line| arguments_of(&line)).collect()
}

/// `command` as this build can run it; None if it needs kernels that the build lacks.
fn in_this_build(mut command: Vec<String>) -> Option<Vec<String>> {
    if cfg!(not(all(feature = "asm", target_arch = "x86_64"))) {
        if ["step", "ops", "experiment", "try"].contains(&command[0].as_str()) {
            return None;
        }
        for engine in command.iter_mut().filter(|word| ["paper", "sse41"].contains(&word.as_str())) {
            *engine = "rust".to_owned();
        }
    }
    Some(command)
}

/// Cargo's complaint about a command's arguments in a folder without a package, so that nothing is
/// built.
fn cargo_without_package(arguments: &str) -> String {
    let directory = TempDir::new().unwrap();
    let mut cargo = Command::new(env!("CARGO"));
    let output = cargo.args(arguments.split_whitespace()).current_dir(&directory).output().unwrap();
    String::from_utf8(output.stderr).unwrap()
}

/// The words of an output line that are the same on every machine: without cycles, and without what
/// C and Rust compilers generate for an operation.
#[cfg(all(feature = "asm", target_arch = "x86_64"))]
fn stable_words(line: &str) -> Vec<&str> {
    /// The columns up to `proved`.
    const COUNTS: usize = 6;
    /// The heading of the column of names, and the names whose code the assembler determines.
    const BY_ASSEMBLER: [&str; 6] = ["by", "paper", "aos", "sse41", "avx2", "avx512"];
    let cells: Vec<_> = line.trim_matches('|').split('|').map(str::trim).collect();
    match &cells[..] {
        [_, by, ..] if by.starts_with("c-") || ["rust", "glam"].contains(by) => cells[..2].to_vec(),
        [_, by, ..] if BY_ASSEMBLER.contains(by) || by.starts_with("printed") => cells[..COUNTS].to_vec(),
        [rule, ..] if rule.starts_with("--") => vec!["--"],
        [_, _, ..] => cells,
        _ => line.split_whitespace().collect(),
    }
}

/// The commands with an `sh` block of their own, each with the text block after it, which shows its
/// output.
#[cfg(all(feature = "asm", target_arch = "x86_64"))]
fn shown_outputs(document: &str) -> Vec<(String, String)> {
    let text = text(document);
    let fenced: Vec<_> = text.split("```").skip(1).step_by(2).filter_map(|block| block.split_once('\n')).collect();
    let pairs = fenced.windows(2).filter(|pair| pair[0].0 == "sh" && pair[1].0 == "text");
    pairs.map(|pair| (pair[0].1.trim_end().to_owned(), pair[1].1.to_owned())).collect()
}

/// The code spans in running text, in the order of the document.
fn spans(document: &str) -> Vec<String> {
    let text = text(document);
    let prose: String = text.split("```").step_by(2).collect();
    prose.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

/// The pictures and files that a document links to.
fn links(document: &str) -> Vec<String> {
    let text = text(document);
    let links = text.split("](").skip(1).map(|rest| rest.split(')').next().unwrap().to_owned());
    links.filter(|link| !link.contains("://")).collect()
}

fn help(subcommand: &[&str]) -> String {
    rayo([subcommand, &["--help"]].concat(), root()).printed().to_owned()
}

/// A new directory with the project's scenes.
fn scratch_folder() -> TempDir {
    let directory = TempDir::new().unwrap();
    fs::create_dir_all(directory.path().join("scenes/meshes")).unwrap();
    let scenes = [
        "sphere.in",
        "tetrahedron.in",
        "many.in",
        "knot.in",
        "planet.in",
        "sunflower.in",
        "island.toml",
        "chain.toml",
        "far.toml",
        "helix.xyz",
    ];
    for file in scenes.into_iter().chain(["meshes/hills.ply", "meshes/ring.ply", "meshes/rock.ply"]) {
        fs::copy(root().join("scenes").join(file), directory.path().join("scenes").join(file)).unwrap();
    }
    directory
}

/// Whether a pattern, with at most one `*` in its last component, matches a file of the project.
fn exists(pattern: &str) -> bool {
    let path = root().join(pattern);
    let Some((start, end)) = path.file_name().and_then(|name| name.to_str()?.split_once('*')) else {
        return path.exists();
    };
    let files = fs::read_dir(path.parent().unwrap()).into_iter().flatten();
    files
        .flatten()
        .any(|file| file.file_name().to_str().is_some_and(|name| name.starts_with(start) && name.ends_with(end)))
}

/// The headings with their depths, and the number of lines in each kind of block.
fn outline(document: &str) -> Vec<String> {
    let text = text(document);
    let mut outline = Vec::new();
    for (place, part) in text.split("```").enumerate() {
        if place % 2 == 1 {
            outline.push(format!("{}, {} lines", part.lines().next().unwrap(), part.lines().count()));
        } else {
            let depth = |line: &str| line.chars().take_while(|c| *c == '#').count();
            outline.extend(
                part.lines().filter(|line| line.starts_with('#')).map(|line| format!("heading {}", depth(line))),
            );
        }
    }
    outline
}

#[test]
fn the_guides_in_spanish_have_the_same_headings_and_commands() {
    for [english, spanish] in GUIDES {
        assert_eq!(outline(english), outline(spanish), "{english} and {spanish} have drifted apart");
        assert_eq!(lines_of(english), lines_of(spanish), "{english} and {spanish}");
    }
}

#[test]
fn every_page_with_commands_is_among_those_whose_commands_run() {
    let translated: Vec<_> = GUIDES.iter().map(|[_, spanish]| *spanish).collect();
    for document in documents().iter().filter(|document| text(document).contains("```sh\n")) {
        let is_of_developers = document == "CONTRIBUTING.md" || document.starts_with("docs/processes");
        let is_run = PAGES.contains(&document.as_str()) || translated.contains(&document.as_str());
        assert!(is_run || is_of_developers, "the commands of {document} are not run");
    }
    for document in documents() {
        assert!(!text(&document).contains("```console"), "{document} has prompts, which cannot be pasted");
    }
}

#[test]
fn every_command_of_the_pages_succeeds() {
    let directory = scratch_folder();
    for page in PAGES {
        for line in lines_of(page).iter().filter(|line| is_run(line)) {
            if let Some(arguments) = line.strip_prefix("cargo ") {
                let said = cargo_without_package(arguments);
                assert!(said.contains("could not find `Cargo.toml`"), "{page}: {line}: {said}");
                continue;
            }
            let command = arguments_of(line).unwrap_or_else(|| panic!("{page}: neither run nor excepted: {line}"));
            if let Some(mut command) = in_this_build(command) {
                let target = command.iter().position(|word| word == ">").map(|place| command.split_off(place));
                let run = rayo(&command, directory.path());
                if let Some([_, file]) = target.as_deref() {
                    fs::write(directory.path().join(file), run.printed()).unwrap();
                }
                run.printed();
            }
        }
    }
}

#[cfg(all(feature = "asm", target_arch = "x86_64"))]
#[test]
fn the_tutorial_shows_what_its_commands_print() {
    let directory = scratch_folder();
    for page in GUIDES[1] {
        let outputs = shown_outputs(page);
        assert!(outputs.len() >= 3, "{page} shows too few outputs");
        for (line, shown) in outputs {
            let printed = rayo(arguments_of(&line).expect("it is one command"), directory.path()).printed().to_owned();
            let mut printed_lines = printed.lines().map(stable_words);
            for expected in shown.lines().map(stable_words) {
                assert!(printed_lines.any(|words| words == expected), "{page}: `{line}` prints no {expected:?} there");
            }
        }
    }
}

#[test]
fn flags_in_documents_are_known_to_the_program() {
    // Options are in blocks, in running text such as `rayo render --film`, or alone; an option
    // alone must belong to some subcommand.
    let known = help(&[]);
    let is_subcommand = |word: &str| known.lines().any(|line| line.trim_start().starts_with(&format!("{word} ")));
    let has_flag = |help: &str, flag: &str| help.split([' ', ',', '\n']).any(|word| word == flag);
    let inline = documents().into_iter().flat_map(|document| spans(&document));
    let inline = inline.filter_map(|span| Some(span.strip_prefix("rayo ")?.split(' ').map(str::to_owned).collect()));
    let mut checked = 0;
    for command in commands().into_iter().chain(inline) {
        let subcommand = &command[0];
        assert!(is_subcommand(subcommand), "there is no `rayo {subcommand}`");
        let help = help(&[subcommand]);
        for flag in command.iter().filter(|word| word.starts_with('-')) {
            assert!(has_flag(&help, flag), "`rayo {subcommand}` has no {flag}");
            checked += 1;
        }
    }
    assert!(checked > 10);
    let all = help(&["render"]) + &help(&["diff"]) + &help(&["step"]) + &help(&["report"]);
    for span in spans("README.md").iter().filter(|span| span.starts_with("--") && !span.contains("features")) {
        assert!(has_flag(&all, span.split(' ').next().unwrap()), "no subcommand has {span}");
    }
}

#[test]
fn engines_of_the_readme_are_those_of_the_program() {
    let text = text("README.md");
    let table = text.split("| engine |").nth(1).unwrap().split("\n\n").next().unwrap();
    let rows = table.lines().skip(2).map(|row| row.split('|').nth(1).unwrap());
    let documented: BTreeSet<_> = rows.flat_map(|names| names.split('`').skip(1).step_by(2)).collect();
    let help = help(&["render"]).split_whitespace().collect::<Vec<_>>().join(" ");
    let list = help.split("The engine: ").nth(1).unwrap().split(", or auto").next().unwrap();
    assert_eq!(documented, list.split(", ").collect());
}

#[test]
fn the_error_of_the_readme_is_the_one_that_its_scene_gives() {
    let blocks = blocks("README.md", "text");
    let [scene, error] = blocks.as_slice() else { panic!("expected a scene and an error") };
    let directory = scratch_folder();
    let render = |name: &str, scene: &str| {
        fs::write(directory.path().join(name), scene).unwrap();
        rayo(["render", name, "--size", "8x6"], directory.path())
    };
    render("right.in", scene).printed();
    let wrong = render("wrong.in", &scene.replace("\n30 ", "\n-30 "));
    assert_eq!((wrong.status, wrong.stderr), (2, error.clone()));
}

/// Not part of the sampled tests: Cargo would check the library again, since no other build has
/// these features.
#[test]
fn library_of_the_readme_builds_with_its_dependency() {
    if !all() {
        return; // the program alone is a test of the library's documentation
    }
    let [program] = &blocks("README.md", "rust,no_run")[..] else { panic!("expected one program") };
    let [dependency] = &blocks("README.md", "toml")[..] else { panic!("expected one dependency") };
    assert!(dependency.contains("path = \"../rayo\"") && dependency.contains("[\"asm\", "), "{dependency}");
    let dependency = dependency.replace("../rayo", root().to_str().unwrap());
    let dependency = if cfg!(all(feature = "asm", target_arch = "x86_64")) {
        dependency
    } else {
        dependency.replace("\"asm\", ", "")
    };
    let directory = TempDir::new().unwrap();
    let write = |name: &str, text: &str| fs::write(directory.path().join(name), text).unwrap();
    write("Cargo.toml", &format!("[package]\nname = \"reader\"\nedition = \"2024\"\n\n{dependency}"));
    write("Cargo.lock", &text("Cargo.lock"));
    fs::create_dir(directory.path().join("src")).unwrap();
    write("src/main.rs", program);
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap();
    let mut cargo = Command::new(env!("CARGO"));
    cargo.args(["check", "--release", "--offline", "--target-dir"]).arg(target).current_dir(&directory);
    let output = cargo.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// The options of all pictures in the README.
const LOOK: &str = "--shadows --size 400x300 --samples 4 --srgb";

#[test]
fn readme_demo_and_makefile_make_the_same_pictures() {
    for (document, command) in [
        ("README.md", format!("rayo render scenes/knot.in -o knot.png {LOOK}\n")),
        ("LEEME.md", format!("rayo render scenes/knot.in -o knot.png {LOOK}\n")),
        ("scripts/demo.sh", format!("render scenes/island.toml {LOOK} ")),
        ("Makefile", format!("render scenes/$$scene {LOOK} ")),
    ] {
        assert!(text(document).contains(&command), "{document} has no `{command}`");
    }
}

#[test]
fn the_pictures_of_the_readme_are_what_the_program_renders() {
    if cfg!(not(all(feature = "asm", target_arch = "x86_64"))) {
        // The pictures that are kept were rendered by packets in assembly, and are compared byte by byte
        // with those of the same engines.
        return;
    }
    let directory = scratch_folder();
    let shown = text("Makefile").split("\nshown := ").nth(1).unwrap().lines().next().unwrap().to_owned();
    for scene in shown.split(' ') {
        let picture = Path::new(scene).with_extension("png").display().to_string();
        let words = LOOK.split(' ');
        let rendered =
            rayo(["render", &format!("scenes/{scene}"), "-o", &picture].into_iter().chain(words), directory.path());
        rendered.printed();
        let kept = root().join("docs/images").join(&picture);
        assert!(text("README.md").contains(&format!("(docs/images/{picture})")), "the README does not show {picture}");
        let compared = rayo(["diff", kept.to_str().unwrap(), &picture, "--tolerance", "1"], directory.path());
        assert_eq!(compared.status, 0, "`make images` renders {picture} anew: {compared:?}");
    }
}

#[test]
fn every_path_that_a_document_names_exists() {
    let top: BTreeSet<String> =
        fs::read_dir(root()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    let mut checked = 0;
    for document in &documents() {
        for span in spans(document) {
            let path = span.trim_end_matches('/');
            // Build results do not exist yet, and <...> stands for a name to be chosen.
            let built = path.starts_with("target") || path.starts_with("out");
            if built || path.contains([' ', '<']) {
                continue;
            }
            let in_a_folder = path.contains('/') && top.contains(path.split('/').next().unwrap());
            // A file that a page in docs calls by its bare name is written by a command.
            let at_the_top = !document.contains('/') && !path.contains('/') && path.ends_with(".md");
            if in_a_folder || at_the_top {
                assert!(exists(path), "{document} names {path}, which is not there");
                checked += 1;
            }
        }
        let folder = Path::new(document).parent().unwrap().to_owned();
        for link in links(document) {
            let path: PathBuf = folder.join(&link);
            assert!(root().join(&path).exists(), "{document} links to {link}, which is not there");
            checked += 1;
        }
    }
    assert!(checked > 50, "only {checked} paths were found");
}

#[test]
fn the_package_has_all_that_its_readme_shows_and_leads_to() {
    let arguments = ["package", "-p", "rayo", "--list", "--allow-dirty", "--offline"];
    let list = Command::new(env!("CARGO")).args(arguments).current_dir(root()).output().unwrap();
    let files = String::from_utf8(list.stdout).unwrap();
    for link in links("README.md") {
        assert!(files.lines().any(|file| file == link), "the package has no {link}: {files}");
    }
}

#[test]
fn every_page_is_reached_from_the_readme() {
    let readme = text("README.md");
    for document in documents().iter().filter(|document| *document != "README.md") {
        assert!(readme.contains(&format!("]({document})")), "README.md has no link to {document}");
    }
}

#[test]
fn every_folder_of_sources_is_in_the_map() {
    fn folders(path: &str, found: &mut Vec<String>) {
        found.push(path.to_owned());
        for entry in fs::read_dir(root().join(path)).unwrap().map(Result::unwrap) {
            if entry.file_type().unwrap().is_dir() {
                folders(&format!("{path}/{}", entry.file_name().to_str().unwrap()), found);
            }
        }
    }
    let text = text("ARCHITECTURE.md");
    let map = text.split("## Where things are").nth(1).unwrap().split("\n## ").next().unwrap();
    let mut found = Vec::new();
    for sources in ["asm", "src", "lab/src", "cli/src", "mpi/src", "view/src"] {
        folders(sources, &mut found);
    }
    for folder in found.iter().filter(|folder| *folder != "src") {
        assert!(map.contains(&format!("`{folder}`")), "ARCHITECTURE.md has no `{folder}` in its map");
    }
}

#[test]
fn every_make_target_that_a_document_names_exists() {
    let makefile = text("Makefile");
    let mut named = BTreeSet::new();
    for document in &documents() {
        let lines = text(document);
        let shown = lines.lines().filter_map(|line| line.strip_prefix("make ")).map(str::to_owned);
        let inline = spans(document).into_iter().filter_map(|span| Some(span.strip_prefix("make ")?.to_owned()));
        named.extend(shown.chain(inline).map(|target| target.split_whitespace().next().unwrap().to_owned()));
    }
    assert!(named.contains("demo") && named.contains("test"), "{named:?}");
    for target in named {
        assert!(makefile.contains(&format!("\n{target}:")), "the Makefile has no target {target}");
    }
}

/// Cargo looks for these only in the default package, which is that of the program.
#[test]
fn cargo_commands_of_pages_name_their_package() {
    let examples = fs::read_dir(root().join("examples")).unwrap().map(|entry| entry.unwrap().path());
    let texts = examples.map(|path| fs::read_to_string(path).unwrap()).chain(documents().into_iter().map(text));
    let mut checked = 0;
    for text in texts {
        for command in text.split(['`', '\n']).filter(|command| command.starts_with("cargo ")) {
            let words: Vec<_> = command.split_whitespace().collect();
            if ["--bench", "--example", "--test"].iter().any(|target| words.contains(target)) {
                assert!(words.contains(&"-p"), "{command}");
                checked += 1;
            }
        }
    }
    assert!(checked > 10, "only {checked} commands were found");
}
