//! The documents kept true: their commands run, and the paths, flags, targets and pictures that they name are there.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::extent::all;
use crate::program::rayo;
use tempfile::TempDir;

/// Those whose commands are shown after a prompt, each in English and in Spanish.
const GUIDES: [[&str; 2]; 2] = [["README.md", "LEEME.md"], ["docs/tutorial.md", "docs/tutorial.es.md"]];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn text(path: impl AsRef<Path>) -> String {
    let path = root().join(path);
    fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Every page, from the root.
fn documents() -> Vec<String> {
    let of = |folder: &'static str| {
        let names = fs::read_dir(root().join(folder)).unwrap().map(|entry| entry.unwrap().file_name());
        names.map(move |name| format!("{folder}{}", name.to_str().unwrap())).filter(|name| name.ends_with(".md"))
    };
    let documents: Vec<_> = ["", "docs/", "docs/results/"].into_iter().flat_map(of).collect();
    assert!(documents.len() > 15, "{documents:?}");
    documents
}

/// The blocks of a document fenced as `language`.
fn blocks(document: &str, language: &str) -> Vec<String> {
    let text = text(document);
    let begin = format!("```{language}\n");
    let blocks: Vec<_> = text.split(&begin).skip(1).map(|rest| rest.split("```").next().unwrap().to_owned()).collect();
    assert!(!blocks.is_empty(), "{document} has no block of {language}");
    blocks
}

/// The commands that a document shows after a prompt, one vector of arguments each, without `rayo` itself.
fn commands_of(document: &str) -> Vec<Vec<String>> {
    let blocks = blocks(document, "console");
    let lines = blocks.iter().flat_map(|block| block.lines());
    let commands = lines.map(|line| {
        let arguments = line.strip_prefix("$ rayo ").unwrap_or_else(|| panic!("not a command: {line}"));
        arguments.split_whitespace().map(str::to_owned).collect()
    });
    commands.collect()
}

/// Those of the guides.
fn commands() -> Vec<Vec<String>> {
    GUIDES.iter().flat_map(|[english, _]| commands_of(english)).collect()
}

/// What stands between backticks in running text, in the order of the document.
fn spans(document: &str) -> Vec<String> {
    let text = text(document);
    let prose: String = text.split("```").step_by(2).collect();
    prose.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

/// The pictures and files that a document leads to.
fn links(document: &str) -> Vec<String> {
    let text = text(document);
    let links = text.split("](").skip(1).map(|rest| rest.split(')').next().unwrap().to_owned());
    links.filter(|link| !link.contains("://")).collect()
}

fn help(subcommand: &[&str]) -> String {
    rayo([subcommand, &["--help"]].concat(), root()).printed().to_owned()
}

/// A new directory with the project's scenes in it.
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
    ];
    for file in scenes.into_iter().chain(["meshes/hills.ply", "meshes/ring.ply", "meshes/rock.ply"]) {
        fs::copy(root().join("scenes").join(file), directory.path().join("scenes").join(file)).unwrap();
    }
    directory
}

/// Whether a pattern with at most one `*`, in its last part, names something of the project.
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

/// Headings by their depth, and how many lines each kind of block has.
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
        assert_eq!(commands_of(english), commands_of(spanish), "{english} and {spanish}");
    }
}

#[test]
fn every_command_of_the_guides_succeeds() {
    let directory = scratch_folder();
    for mut command in commands() {
        if cfg!(not(rayo_asm)) {
            // Without kernels there are none to watch, to count or to compare.
            if ["step", "ops", "experiment"].contains(&command[0].as_str()) {
                continue;
            }
            command.iter_mut().filter(|word| *word == "paper").for_each(|engine| *engine = "rust".to_owned());
        }
        rayo(&command, directory.path()).printed();
    }
}

#[test]
fn every_subcommand_and_flag_of_a_document_is_known_to_the_program() {
    // Some in blocks, some in running text, such as `rayo render --film`; and flags alone, which a subcommand has.
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
fn every_engine_of_the_readme_is_one_of_the_programs_and_the_other_way_round() {
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

/// Without the kernels in a sample: no other build has their features, and they would be assembled once more.
#[test]
fn the_library_of_the_readme_is_a_crate_with_the_dependency_that_stands_there() {
    let [program] = &blocks("README.md", "rust")[..] else { panic!("expected one program") };
    let [dependency] = &blocks("README.md", "toml")[..] else { panic!("expected one dependency") };
    assert!(dependency.contains("path = \"../rayo\"") && dependency.contains("[\"asm\", "), "{dependency}");
    let dependency = dependency.replace("../rayo", root().to_str().unwrap());
    let dependency = if all() && cfg!(rayo_asm) { dependency } else { dependency.replace("\"asm\", ", "") };
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

#[test]
fn the_pictures_of_the_readme_are_what_the_program_renders() {
    if cfg!(not(rayo_asm)) {
        // They are by packets, to which the other engine in f32 comes close, but not at every edge.
        return;
    }
    let directory = scratch_folder();
    let shown = text("Makefile").split("\nshown := ").nth(1).unwrap().lines().next().unwrap().to_owned();
    for scene in shown.split(' ') {
        let picture = Path::new(scene).with_extension("png").display().to_string();
        let look = ["--shadows", "--size", "400x300", "--samples", "4", "--srgb"];
        let rendered =
            rayo([&["render", &format!("scenes/{scene}"), "-o", &picture], &look[..]].concat(), directory.path());
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
            // What is built is not there yet, and <...> stands for a name to be chosen.
            let built = path.starts_with("target") || path.starts_with("out");
            if built || path.contains([' ', '<']) {
                continue;
            }
            let in_a_folder = path.contains('/') && top.contains(path.split('/').next().unwrap());
            // What a page in docs calls by its name alone is what a command writes.
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
    let arguments = ["package", "--list", "--allow-dirty", "--offline"];
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
    folders("asm", &mut found);
    folders("src", &mut found);
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
