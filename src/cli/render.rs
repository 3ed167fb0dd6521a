//! `rayo render`: a scene file in, a picture out.

mod args;
mod name;
mod picture;
mod stats;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

pub use self::args::RenderArgs;
use self::name::{keep_scenes, numbered, output};
use self::picture::{Picture, Progress};
use self::stats::Report;
use super::development::sampled;
use super::engine::Tracing;
use super::party::Party;
use super::preview::Preview;
use super::{Failure, print_result, remove_part_files_on_signals, say, without_links};
use crate::plan::{Keep, Omission};
use crate::render::{is_standard_error, is_standard_output};
use crate::scene::{Scene, shown};

/// Renders the scenes.
pub fn run(args: &RenderArgs, party: &Party) -> Result<ExitCode, Failure> {
    // Before any work: what no scene can make right.
    let (engine, precision) = party.agree(args.engine.chosen())?;
    let tracing = Tracing {
        engine: if args.engine.is_auto() { party.fastest() } else { engine },
        precision,
        keep: if args.keep_all { Keep::all() } else { Keep::NOTHING },
        threads: args.threads,
    };
    let to_standard_output = args.output.as_deref().is_some_and(is_standard_output);
    if (args.stats || args.json) && to_standard_output {
        return Err(Failure::input(
            "the picture goes to standard output, where --stats and --json would print into it: leave them out, or name \
             a file with -o",
        ));
    }
    if args.output.as_deref().is_some_and(is_standard_error) {
        return Err(Failure::input(
            "the picture goes to standard error, where messages would print into it: name a file with -o",
        ));
    }
    if args.preview {
        can_be_shown(args, party, to_standard_output)?;
    }
    if args.orbit.is_some() {
        can_go_round(args, party)?;
    }
    let (mut read, mut written) = (without_links(&args.scenes).collect(), BTreeSet::new());
    if let [scene] = &args.scenes[..] {
        render_one(args, party, scene, tracing, (&mut read, &mut written))?;
        return Ok(ExitCode::SUCCESS);
    }
    // Who writes knows which directories there are.
    let missing = args.output.as_deref().filter(|path| party.leads() && !path.is_dir());
    party.agree(missing.map_or(Ok(()), |directory| {
        Err(Failure::input(if to_standard_output {
            "several pictures cannot go to standard output: name a directory with -o".into()
        } else {
            format!(
                "several scenes have several pictures, and there is no directory {}: create it first",
                shown(directory)
            )
        }))
    }))?;
    let mut status = ExitCode::SUCCESS;
    for scene in &args.scenes {
        if let Err(mut failure) = render_one(args, party, scene, tracing, (&mut read, &mut written)) {
            let name = shown(scene);
            if !failure.message.contains(&name) {
                failure.message = format!("{name}: {}", failure.message);
            }
            status = failure.tell();
        }
    }
    Ok(status)
}

/// Standard output holds one thing, and a terminal one process.
fn can_be_shown(args: &RenderArgs, party: &Party, to_standard_output: bool) -> Result<(), Failure> {
    let problem = if !party.is_alone() {
        "--preview is for one process: start it without MPI, or leave it out"
    } else if to_standard_output {
        "--preview prints where the picture is to go, to standard output: name a file with -o"
    } else if args.json {
        "--preview prints a picture where --json prints a document: leave one of them out"
    } else if args.stats && args.output.is_none() {
        "--stats is of a picture that is written, and --preview alone writes none: name a file with -o"
    } else {
        return Ok(());
    };
    Err(Failure::input(problem))
}

/// A number for each picture, one scene, and one process.
fn can_go_round(args: &RenderArgs, party: &Party) -> Result<(), Failure> {
    let name = args.output.as_deref().unwrap_or(Path::new(""));
    let problem = if !party.is_alone() {
        "--orbit is for one process: start it without MPI, or leave it out".into()
    } else if name.to_str().is_none() {
        format!("--orbit finds no number in a name that is not UTF-8: {}", shown(name))
    } else if args.scenes.len() > 1 {
        "--orbit goes round one scene: render the others in calls of their own".into()
    } else if numbered(name, 0).is_none() {
        format!(
            "--orbit writes several pictures, and {} is the name of one: give it a number, as in frames/%04d.png",
            shown(name)
        )
    } else {
        return Ok(());
    };
    Err(Failure::input(problem))
}

/// Renders a scene to a picture that is not among the files `read` so far, nor those `written`.
fn render_one(
    args: &RenderArgs,
    party: &Party,
    scene_path: &Path,
    tracing: Tracing,
    (read, written): (&mut BTreeSet<PathBuf>, &mut BTreeSet<PathBuf>),
) -> Result<(), Failure> {
    let clock = Instant::now();
    let (mut scene, up, files) = args.open(scene_path, party)?;
    let (camera, parse) = (scene.camera, clock.elapsed());
    let rows = args.rows_of(&camera)?;
    scene.doubts().iter().for_each(|doubt| say(&format!("warning: {doubt}")));
    let show = |scene: &mut Scene| {
        let development = args.development.with_samples(Preview::SAMPLES);
        let (explain, quiet) = (args.explain && args.output.is_none(), args.quiet);
        Preview { tracing, development, camera, rows: rows.clone(), explain, quiet }.show(scene)
    };
    if args.preview && args.output.is_none() {
        return show(&mut scene);
    }
    let (path, format) = party.agree(output(args, &scene, party))?;
    // A link is the file that it points to.
    let file = |path: &Path| path.canonicalize().unwrap_or(path.into());
    read.extend(without_links(&files));
    party.agree(if !party.leads() {
        Ok(())
    } else if written.contains(&file(&path)) {
        let path = shown(&path);
        let problem = "as is that of a scene before it: render it in a call of its own";
        Err(Failure::input(format!("its picture is {path}, {problem}")))
    } else {
        keep_scenes(&path, read)
    })?;
    let development = args.development.of(&path, format)?;
    if args.preview {
        show(&mut scene)?;
    }
    scene.camera = development.map_or(Ok(camera), |development| sampled(&camera, development))?;
    // Before the plan: who cannot have a file need not wait for it.
    party.agree(remove_part_files_on_signals())?;
    let engine = tracing.engine;
    if args.keep_all && !args.quiet && !engine.omissions().contains(&Omission::Misses) {
        say(&format!("{engine} tests every ray against every object as it is: --keep-all changes nothing"));
    }
    let prints = args.stats || args.json || path == Path::new("/dev/stdout");
    let all_rows = rows.len() as u64 * u64::from(args.orbit.unwrap_or(1));
    let progress = Progress::new(all_rows, args.quiet, party.bar_target(prints));
    let picture = Picture { args, party, tracing, camera, rows, format, development, progress };
    if let Some(count) = args.orbit {
        return picture.go_round(&scene, (up, count), &path, read);
    }
    let (setup, stats) = picture.write(&scene, &path)?;
    picture.progress.end();
    if !party.leads() {
        return Ok(());
    }
    if args.stats || args.json {
        let report = Report::of(tracing, (camera.width(), &picture.rows), [parse, setup], &stats);
        print_result(args.json, &report, || report.text())?;
    } else if !args.quiet {
        say(&format!("{}: {} by {engine}, traced in {:.1?}", shown(&path), picture.size(), stats.trace));
    }
    written.insert(file(&path));
    Ok(())
}
