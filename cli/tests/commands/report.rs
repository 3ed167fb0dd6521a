//! `rayo report`: the page made from results of one machine and of two, results that cannot be
//! read, and the page in a browser.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::OnceLock;
use std::time::Duration;

use crate::extent;
use crate::program::{Run, in_the_foreground, rayo, signal};
use rayo::internals::kernels::sys::Cores;
use rayo::internals::render::Engine;
use rayo_lab::experiments::{gallery, roofline, threads};
use rayo_lab::measure::{Machine, MachineClock};
use scraper::{ElementRef, Html, Selector};
use serde_json::{Value, json};
use tempfile::TempDir;

/// The largest size of the page in bytes, and of the pictures on it.
const MOST_BYTES: usize = 1_500_000;
const MOST_OF_PICTURES: usize = 350_000;

/// The results of small real runs, in directories as the commands write them.
fn results() -> &'static Path {
    static RESULTS: OnceLock<TempDir> = OnceLock::new();
    RESULTS
        .get_or_init(|| {
            let directory = TempDir::new().unwrap();
            let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
            let out = |name: &str| directory.path().join(name).display().to_string();
            let (experiment, _) = crate::experiment::whole();
            fs::create_dir(out("experiment")).unwrap();
            for file in ["results.json", "table.md"] {
                fs::copy(experiment.path().join(file), Path::new(&out("experiment")).join(file)).unwrap();
            }
            for arguments in [
                &["experiment", "--complexity", "--quick", "--runs", "1", "--out", &out("complexity")][..],
                &["accuracy", "scenes/sphere.in", "S1", "--quick", "--out", &out("accuracy")],
                &["stability", "--family", "S1", "--quick", "--out", &out("stability")],
            ] {
                rayo(arguments, root).printed();
            }
            directory
        })
        .path()
}

fn report(arguments: &[&str], directory: &Path) -> Run {
    rayo([&["report"], arguments].concat(), directory)
}

/// The page made from these directories.
fn page_of(from: &[&Path]) -> (TempDir, String) {
    let directory = TempDir::new().unwrap();
    let mut arguments = vec!["--out", "page"];
    let from: Vec<String> = from.iter().map(|path| path.display().to_string()).collect();
    for path in &from {
        arguments.extend(["--from", path]);
    }
    let path = Path::new("page").join("report.html");
    assert_eq!(report(&arguments, directory.path()).printed().lines().last(), Some(path.to_str().unwrap()));
    let page = fs::read_to_string(directory.path().join(path)).unwrap();
    (directory, page)
}

fn all<'a>(page: &'a Html, selector: &str) -> Vec<ElementRef<'a>> {
    page.select(&Selector::parse(selector).unwrap()).collect()
}

fn text(of: &ElementRef<'_>) -> String {
    of.text().collect::<Vec<_>>().join(" ").split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Checks what must hold for every page.
fn check(page: &str) -> Html {
    assert!(page.len() < MOST_BYTES, "{} bytes", page.len());
    let html = Html::parse_document(page);
    assert!(html.errors.is_empty(), "{:?}", html.errors);
    // Nothing is loaded: all data is in the page itself.
    for (selector, attribute) in [("[src]", "src"), ("[href]", "href")] {
        for element in all(&html, selector) {
            let to = element.attr(attribute).unwrap();
            let inside = to.strip_prefix('#').is_some_and(|id| !all(&html, &format!("[id=\"{id}\"]")).is_empty());
            assert!(inside || to.starts_with("data:"), "{}", &to[..to.len().min(80)]);
        }
    }
    assert!(all(&html, "script, link, iframe, object").is_empty());
    assert!(!page.contains("url(") && !page.contains("@import"));
    let mut ids: Vec<_> = all(&html, "[id]").iter().map(|element| element.attr("id").unwrap()).collect();
    let count = ids.len();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), count, "an id is there twice");
    assert_eq!(page.find(|c: char| c.is_control() && c != '\n'), None, "controls and formats are escaped");
    // For screen readers, figures and pictures have descriptions, tables have headings, and the
    // page has a language.
    for figure in all(&html, "figure") {
        let plots = figure.select(&Selector::parse("[role=img][aria-label] > svg[viewBox]").unwrap()).count();
        let is_small = figure.attr("class") == Some("small");
        assert_eq!(
            plots,
            if is_small { 1 } else { 2 },
            "small, or for wide screens and narrow ones: {}",
            text(&figure)
        );
    }
    assert!(all(&html, "img:not([alt])").is_empty() && all(&html, "html[lang]").len() == 1);
    for table in all(&html, "table") {
        assert!(table.select(&Selector::parse("th[scope=col]").unwrap()).count() > 1);
        assert!(table.select(&Selector::parse("th[scope=row]").unwrap()).count() > 0);
    }
    html
}

/// The sections, their parts, and the headings of tables: everything but figures, which differ
/// between machines.
fn structure(html: &Html) -> String {
    let mut lines = Vec::new();
    for section in all(html, "section") {
        let title = section.select(&Selector::parse("h2").unwrap()).next().unwrap();
        lines.push(format!("{}: {}", section.attr("id").unwrap(), text(&title)));
        let parts =
            Selector::parse("figcaption, summary, article h3, dt, p.absent, .scroll > table:not(.map) thead").unwrap();
        for part in section.select(&parts) {
            // Skip what depends on the CPU, and on whether this is a repository.
            let text = text(&part);
            if !text.starts_with("This CPU") && text != "commit" {
                lines.push(format!("    {}: {}", part.value().name(), text.split(" avx512").next().unwrap()));
            }
        }
    }
    lines.join("\n")
}

#[test]
fn the_page_has_what_was_measured_and_says_what_was_not() {
    let (_directory, page) = page_of(&[results()]);
    let html = check(&page);
    insta::assert_snapshot!("report_structure", structure(&html));
    // The same rows as in the commands' own tables.
    let table = fs::read_to_string(results().join("experiment/table.md")).unwrap();
    let row = table.lines().find(|line| line.starts_with("| 365×273 ")).unwrap();
    let cells: Vec<_> = row.trim_matches('|').split('|').map(str::trim).collect();
    let rows = all(&html, "#experiment tbody tr");
    let shown = rows.iter().map(|row| row.child_elements().map(|cell| text(&cell)).collect::<Vec<_>>());
    assert!(shown.into_iter().any(|shown| shown == cells), "{cells:?}");
    // Each cell of a family's map names the command that repeats it.
    let cells = all(&html, "#family-S1 td");
    assert!(!cells.is_empty());
    for cell in cells {
        assert!(cell.attr("data-case").unwrap().parse::<usize>().is_ok());
    }
    // The style sheet gives the cells of a column the name of their engine.
    let style = text(&all(&html, "head style")[0]);
    let engines: Vec<&str> = style.split("--engine: '").skip(1).map(|rest| rest.split('\'').next().unwrap()).collect();
    assert_eq!(engines.len(), all(&html, "#family-S1 thead th").len() - 1);
    for engine in engines {
        assert!(engine.parse::<Engine>().is_ok_and(Engine::usable), "{engine}");
    }
    let command = all(&html, "#family-S1")[0].attr("style").unwrap();
    assert_eq!(command, "--before:'rayo stability --family S1 --engine ';--after:' --seed 1 --quick'");
}

#[test]
fn the_first_line_answers_the_papers_question() {
    let (_directory, page) = page_of(&[results()]);
    let answer = text(&all(&check(&page), "header > p")[0]);
    let is_whole = answer.starts_with("C/SIMD is ") && answer.contains(" here; the paper has 6.1 to 6.8; ");
    assert!(is_whole && answer.contains(" % of it, by logarithm, is "), "{answer}");
}

/// The texts of a page that are translated: not styles, listings, figures and names of compilers.
fn texts(html: &Html) -> Vec<String> {
    let has_none = |name: &str| ["style", "pre", "code", "svg", "dd", "cite", "title"].contains(&name);
    let mut texts = Vec::new();
    for node in html.tree.nodes() {
        let within = || node.ancestors().filter_map(|above| above.value().as_element());
        if let Some(words) = node.value().as_text().map(|text| text.trim())
            && !words.is_empty()
            && !within().any(|element| has_none(element.name()))
        {
            texts.push(words.to_owned());
        }
    }
    texts
}

#[test]
fn a_page_in_spanish_has_the_same_parts_and_no_english() {
    let directory = TempDir::new().unwrap();
    let from = results().display().to_string();
    report(&["--from", &from, "--lang", "es", "--out", "page"], directory.path()).printed();
    let spanish = check(&fs::read_to_string(directory.path().join("page/report.html")).unwrap());
    let english = check(&page_of(&[results()]).1);
    let ids = |html: &Html| all(html, "[id]").iter().map(|of| of.attr("id").unwrap().to_owned()).collect::<Vec<_>>();
    assert_eq!(ids(&spanish), ids(&english));
    assert_eq!(all(&spanish, "html[lang=es]").len(), 1);
    assert_eq!(texts(&spanish).len(), texts(&english).len());
    let words = [" the ", " of ", " is ", " are ", " and ", " which ", " than ", " from ", "The ", "Each "];
    let left: Vec<_> =
        texts(&spanish).into_iter().filter(|text| words.iter().any(|word| text.contains(word))).collect();
    assert_eq!(left, [""; 0], "these are in English: a line of words.es.txt is missing");
    let verdicts: Vec<_> = all(&spanish, ".verdict").iter().map(text).collect();
    let known = ["reproducida", "no reproducida", "muy pocas corridas para decidir", "no comprobable aquí"];
    assert!(verdicts.len() == 9 && verdicts.iter().all(|verdict| known.contains(&&**verdict)), "{verdicts:?}");
    let answer = text(&all(&spanish, "header > p")[0]);
    assert!(answer.starts_with("C/SIMD es ") && answer.contains("en el artículo, de 6,1 a 6,8"), "{answer}");
    report(&["--from", &from, "--lang", "fr"], directory.path()).refuses("en, es");
}

#[test]
fn a_whole_quick_report_is_no_larger_than_it_may_be() {
    if !extent::all() {
        return; // some minutes
    }
    let directory = TempDir::new().unwrap();
    let run = report(&["--quick", "--out", "page"], directory.path());
    let page = fs::read_to_string(directory.path().join("page/report.html")).unwrap();
    check(&page);
    assert!(run.status == 0 && run.stderr.contains("stage 10 of 10: ray"), "{}", run.stderr);
}

#[test]
fn machines_stand_side_by_side() {
    let other = TempDir::new().unwrap();
    let document = fs::read_to_string(results().join("experiment/results.json")).unwrap();
    let mut document: serde_json::Value = serde_json::from_str(&document).unwrap();
    document["machine"]["cpu"] = "Another CPU\u{7}".into();
    document["machine"]["family"] = Value::Null;
    document["conditions"]["complete"] = false.into();
    fs::write(other.path().join("results.json"), document.to_string()).unwrap();
    let (_directory, page) = page_of(&[results(), other.path()]);
    let html = check(&page);
    let heads: Vec<_> = all(&html, "#factor thead th").iter().map(text).collect();
    let answer = text(&all(&html, "header > p")[0]);
    assert!(answer.contains(" on these machines; the paper has 6.1 to 6.8"), "{answer}");
    assert_eq!(heads.len(), 3, "{heads:?}");
    assert_eq!(heads[2], "2: Another CPU\\u{7}");
    assert_eq!(all(&html, "#factor tbody tr").len(), 9, "claims");
    // Incomplete results are shown as such.
    let notes: Vec<_> = all(&html, "p.note").iter().map(text).collect();
    assert!(notes.iter().any(|note| note == "Another CPU\\u{7}: ended before the end: experiment."), "{notes:?}");
}

#[test]
fn what_cannot_be_read_is_refused_and_nothing_is_written() {
    let directory = TempDir::new().unwrap();
    let whole = fs::read_to_string(results().join("experiment/results.json")).unwrap();
    let case = |name: &str, content: &str| {
        let path = directory.path().join(name);
        fs::create_dir(&path).unwrap();
        fs::write(path.join("results.json"), content).unwrap();
        path
    };
    let newer = whole.replacen("\"schema\": 1", "\"schema\": 7", 1);
    assert_ne!(newer, whole);
    let mut gap: Value = serde_json::from_str(&whole).unwrap();
    gap["rows"].as_array_mut().unwrap().pop();
    let gap = gap.to_string();
    fs::create_dir(directory.path().join("empty")).unwrap();
    for (from, expected) in [
        (case("newer", &newer), "has results of schema 7, and this program reads schema 1"),
        (case("cut", &whole[..whole.len() / 2]), "results.json is cut short, or no results: EOF"),
        (case("unlike", "{\"schema\": 1, \"rows\": []}"), "is cut short, or no results: missing field `machine`"),
        (case("gap", &gap), "is not whole: in its rows, "),
        (
            case("odd", &whole.replacen("\"core\": ", "\"core\": \"\", \"was\": ", 1)),
            "invalid type: string \"\", expected usize at line ",
        ),
        (case("none", "[]"), "has results of schema no number"),
        (directory.path().join("empty"), "no results are here: name a directory that `rayo report`"),
        (directory.path().join("nowhere"), "no results are here"),
    ] {
        report(&["--from", from.to_str().unwrap(), "--out", "page"], directory.path()).refuses(expected);
        assert!(!directory.path().join("page").exists());
    }
    report(&["--quick", "--from", "x"], directory.path()).refuses("--from");
}

/// The paths of all values in a document; of each list only the first and the last item.
fn places(of: &Value, path: &str, found: &mut Vec<String>) {
    let mut into = |key: String, value: &Value| {
        let path = format!("{path}/{key}");
        found.push(path.clone());
        places(value, &path, found);
    };
    match of {
        Value::Object(fields) => fields.iter().for_each(|(key, value)| into(key.clone(), value)),
        Value::Array(items) if !items.is_empty() => {
            [0, items.len() - 1].iter().for_each(|at| into(at.to_string(), &items[*at]));
        }
        _ => {}
    }
}

#[test]
fn documents_with_missing_or_absurd_fields_do_no_harm() {
    let directory = TempDir::new().unwrap();
    let mut runs = 0;
    for name in
        ["experiment/results.json", "complexity/complexity.json", "accuracy/results.json", "stability/results.json"]
    {
        let whole: Value = serde_json::from_str(&fs::read_to_string(results().join(name)).unwrap()).unwrap();
        let mut found = Vec::new();
        places(&whole, "", &mut found);
        for (turn, path) in extent::sampled(found.into_iter().enumerate(), 7) {
            runs += 1;
            let mut document = whole.clone();
            let (parent, key) = path.rsplit_once('/').unwrap();
            match (document.pointer_mut(parent).unwrap(), turn % 4) {
                (Value::Object(fields), 0) => drop(fields.remove(key)),
                (Value::Array(items), _) => drop(items.remove(key.parse().unwrap())),
                (fields, turn) => {
                    let absurd = [json!(1e308), json!(0), json!(-1)];
                    let value = &mut fields[key];
                    *value = if value.is_string() { json!("x") } else { absurd[turn - 1].clone() };
                }
            }
            fs::write(directory.path().join("results.json"), document.to_string()).unwrap();
            let run = report(&["--from", ".", "--out", "page"], directory.path());
            assert!([0, 2].contains(&run.status) && !run.stderr.contains("panicked"), "{name}{path}: {}", run.stderr);
        }
    }
    assert!(runs > if extent::all() { 300 } else { 40 }, "{runs}");
}

/// Stopped in its first stage, the command still makes the page, which says so, and can read its
/// own results again.
#[cfg(target_os = "linux")]
#[test]
fn an_interrupt_leaves_a_page_of_what_is_done() {
    let directory = TempDir::new().unwrap();
    let child = in_the_foreground()
        .args(["report", "--quick", "--out", "page"])
        .current_dir(directory.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    std::thread::sleep(Duration::from_secs(2));
    assert!(signal("INT", child.id()));
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130));
    // Without a terminal, stages are logged in lines instead of a bar.
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("\nstage 1 of 10: experiment\n"), "{said}");
    let page = fs::read_to_string(directory.path().join("page/report.html")).unwrap();
    let html = check(&page);
    let absent: Vec<_> = all(&html, "p.absent").iter().map(text).collect();
    assert!(absent.iter().filter(|text| *text == "Not measured: stopped before.").count() > 4, "{absent:?}");
    let (_again, again) = page_of(&[&directory.path().join("page")]);
    assert_eq!(all(&check(&again), "section").len(), all(&html, "section").len());
}

/// Checks the stages that no other command has, without looking at times.
#[test]
fn kernels_threads_and_pictures_are_all_there() {
    let (machine, mut clock) = (Machine::this(), MachineClock::counter().unwrap());
    let assembly: Vec<_> = Engine::ALL.iter().filter(|engine| engine.usable()).map(|engine| engine.name()).collect();
    let assembly = || assembly.iter().copied().filter(|name| !["reference", "rust", "c", "portable"].contains(name));
    let roofline = roofline::run(&machine.caches, &mut clock, &mut |_| true).unwrap().unwrap();
    assert_eq!(roofline.peaks.len() + 1, assembly().count(), "the paper has no peak of its own");
    assert_eq!(roofline.roofs.len(), machine.caches.len() + 1, "and memory");
    if roofline.uncounted.is_none() {
        for scene in ["sphere", "tetrahedron"] {
            let flops = |engine: &str| {
                let points = &roofline.points;
                points.iter().find(|point| (&*point.scene, &*point.engine) == (scene, engine)).unwrap().flops_per_pixel
            };
            for engine in assembly() {
                assert!(flops(engine) > 1.0 && flops(engine) <= flops("paper"), "{scene}, {engine}: {}", flops(engine));
            }
        }
    }
    let cores = Cores::of_this_thread().unwrap();
    let rows = threads::run(true, &cores, &mut clock, &mut |_| true).unwrap().unwrap();
    for scene in rows.chunk_by(|a, b| a.scene == b.scene) {
        assert_eq!((scene[0].threads, scene[0].speedup), (1, 1.0));
        assert_eq!(scene.last().unwrap().threads, cores.count());
    }
    let gallery = gallery::run(&mut |_| true).unwrap().unwrap();
    let bytes = |of: &Option<String>| of.as_ref().map_or(0, String::len);
    let pictures = gallery.iter().flat_map(|shown| &shown.pictures);
    let pictures: usize = pictures.map(|shot| bytes(&shot.png) + bytes(&shot.difference)).sum();
    assert!(pictures < MOST_OF_PICTURES, "{pictures} bytes");
    for shown in &gallery {
        let reference = &shown.pictures[0];
        assert_eq!((&*reference.engine, reference.differing, &reference.like), ("reference", 0, &None));
        // The picture of the reference, the one that differs most, and the difference of the two.
        let pictures = shown.pictures.iter().filter(|shot| shot.png.is_some());
        let differences: Vec<_> = shown.pictures.iter().filter(|shot| shot.difference.is_some()).collect();
        assert_eq!((pictures.count(), differences.len()), (2, 1), "{}", shown.scene);
        let largest = shown.pictures.iter().map(|shot| shot.largest).fold(0.0, f64::max);
        assert_eq!(differences[0].largest, largest, "{}", shown.scene);
        for shot in &shown.pictures {
            // Packets are right within one level in every scene; the paper's formulas are not, and
            // that must show.
            assert!(
                shot.largest <= 1.0 || ["rust", "c", "paper"].contains(&&*shot.engine),
                "{} by {}",
                shown.scene,
                shot.engine
            );
        }
    }
    assert!(
        gallery.iter().any(|shown| shown.pictures.iter().any(|shot| shot.engine == "paper" && shot.largest > 100.0))
    );
    assert!(threads::run(true, &cores, &mut clock, &mut |_| false).unwrap().is_none());
}

/// A browser that is on PATH.
fn browser() -> Option<&'static str> {
    let runs = |name: &&str| {
        let found = Command::new(name).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
        found.is_ok_and(|status| status.success())
    };
    ["chromium", "chromium-browser", "google-chrome"].into_iter().find(runs)
}

/// The layout of a figure in a browser.
type Figure = (f64, f64, f64, Vec<String>);

/// What a script finds on the page in a window of `width` pixels: for each figure its width and
/// height, the size of its smallest letters, and the words that are cut off or overlap; by how much
/// the page is wider than the window; and the page's background colour.
fn laid_out(browser: &str, page: &str, width: u32, dark: bool, directory: &Path) -> (Vec<Figure>, f64, String) {
    const SCRIPT: &str = "<script>
        onload = () => {
            document.querySelectorAll('details').forEach(part => part.open = true);
            const shown = [...document.querySelectorAll('figure svg')].filter(svg => svg.getBoundingClientRect().width > 0);
            const figures = shown.map(svg => {
                const box = svg.getBoundingClientRect();
                const scale = box.width / svg.viewBox.baseVal.width;
                const words = [...svg.querySelectorAll('text')];
                const places = words.map(text => text.getBoundingClientRect());
                const letters = words.map(text => scale * text.getAttribute('font-size'));
                const wrong = words.filter((text, i) => {
                    const a = places[i];
                    const on = b => a.left + 1 < b.right && b.left + 1 < a.right && a.top + 3 < b.bottom && b.top + 3 < a.bottom;
                    const inside = box.left <= a.left && a.right <= box.right && box.top <= a.top + 3 && a.bottom <= box.bottom + 3;
                    return !inside || places.slice(0, i).some(on);
                });
                return [box.width, box.height, Math.min(...letters), wrong.map(text => text.textContent.trim())];
            });
            const wider = document.documentElement.scrollWidth - innerWidth;
            const paper = getComputedStyle(document.body).backgroundColor;
            parent.postMessage(JSON.stringify([figures, wider, paper]), '*');
        };
    </script></body>";
    let inner = directory.join("inner.html");
    fs::write(&inner, page.replace("</body>", SCRIPT)).unwrap();
    let outer = directory.join("outer.html");
    let frame = format!(
        "<!DOCTYPE html><iframe width={width} height=900 src=inner.html></iframe><pre id=found></pre>
        <script>onmessage = event => document.getElementById('found').textContent = event.data;</script>"
    );
    fs::write(&outer, frame).unwrap();
    let profile = directory.join(format!("profile-{width}-{dark}"));
    let mut command = Command::new(browser);
    command.args(["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking"]);
    command.args([
        "--disable-component-update",
        "--disable-sync",
        "--virtual-time-budget=10000",
        "--enable-logging=stderr",
    ]);
    // The browser cannot reach any host.
    command.arg("--host-resolver-rules=MAP * ~NOTFOUND").arg(format!("--user-data-dir={}", profile.display()));
    if dark {
        command.arg("--blink-settings=preferredColorScheme=0");
    }
    let output = command.args(["--window-size=1400,1000", "--dump-dom"]).arg(format!("file://{}", outer.display()));
    let output = output.output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(!errors.contains("CONSOLE"), "{errors}");
    let dom = String::from_utf8_lossy(&output.stdout).into_owned();
    let found = all(&Html::parse_document(&dom), "#found").first().map(text).unwrap_or_default();
    serde_json::from_str(&found).unwrap_or_else(|error| panic!("{error}: {found}\n{errors}"))
}

#[test]
fn a_browser_shows_every_figure_wide_and_narrow_light_and_dark() {
    let Some(browser) = browser() else {
        return extent::not_run("chromium", "a browser shows every figure of the report");
    };
    let (directory, page) = page_of(&[results()]);
    let mut papers = Vec::new();
    for (width, dark) in extent::sampled([(390, false), (1280, false), (1280, true)], 3) {
        let (figures, wider, paper) = laid_out(browser, &page, width, dark, directory.path());
        assert!(figures.len() > 5, "{figures:?}");
        for (wide, high, letters, wrong) in &figures {
            assert!(*wide > 300.0 && *high > 60.0 && *letters > 9.0, "at {width}: {figures:?}");
            assert_eq!(wrong, &[""; 0], "at {width} these are cut or lie on others");
        }
        assert!(wider <= 0.0, "at {width} the page is {wider} pixels wider than the window");
        papers.push(paper);
    }
    if let [narrow, wide, dark] = &papers[..] {
        assert_eq!(narrow, wide);
        assert_ne!(wide, dark, "dark is another paper");
    }
}
