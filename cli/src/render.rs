//! `rayo render`: renders scene files to pictures.

mod args;
mod name;
mod picture;
mod stats;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

pub use self::args::RenderArgs;
use self::args::SceneToRender;
use self::name::{keep_scenes, numbered, output};
use self::picture::{Picture, Progress};
use self::stats::Report;
use super::development::sampled;
use super::engine::Tracing;
use super::preview::Preview;
use super::{Failure, keep_standard_input_whole, print_result, remove_part_files_on_signals, say, without_links};
use rayo::internals::plan::{Keep, Omission};
use rayo::internals::render::{Format, is_standard_error, is_standard_output};
use rayo::internals::scene::{MovingCamera, Scene, shown};

/// Renders the scenes.
pub fn run(args: &RenderArgs) -> Result<ExitCode, Failure> {
    // Check first what is wrong with the arguments, independently of the scenes.
    let (engine, precision) = args.engine.chosen()?;
    let tracing = Tracing {
        engine,
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
    keep_standard_input_whole(&args.scenes)?;
    no_picture_is_a_scene(&args.scenes)?;
    if args.preview {
        can_be_shown(args, to_standard_output)?;
        if args.force && args.output.is_none() {
            say("note: --preview writes no file unless -o names one: --force has nothing to replace");
        }
    }
    if args.orbit.is_some() {
        can_go_round(args)?;
    }
    let (mut read, mut written) = (without_links(&args.scenes).collect(), BTreeSet::new());
    if let [scene] = &args.scenes[..] {
        render_one(args, scene, tracing, (&mut read, &mut written))?;
        return Ok(ExitCode::SUCCESS);
    }
    if let Some(directory) = args.output.as_deref().filter(|path| !path.is_dir()) {
        return Err(no_directory(args, directory));
    }
    let mut status = ExitCode::SUCCESS;
    for scene in &args.scenes {
        if let Err(mut failure) = render_one(args, scene, tracing, (&mut read, &mut written)) {
            let name = shown(scene);
            if !failure.message.contains(&name) {
                failure.message = format!("{name}: {}", failure.message);
            }
            status = failure.tell();
        }
    }
    Ok(status)
}

/// Fails if a picture's name is given as a scene, where -o was probably forgotten.
fn no_picture_is_a_scene(scenes: &[PathBuf]) -> Result<(), Failure> {
    let is_picture = |path: &&PathBuf| path.extension().is_some() && Format::from_path(path).is_ok() && !path.exists();
    scenes.iter().find(is_picture).map_or(Ok(()), |path| {
        let path = shown(path);
        Err(Failure::input(format!("there is no scene file `{path}`: the picture's name follows -o, as in -o {path}")))
    })
}

/// The failure if the pictures of several scenes are to go to a path that is no directory.
fn no_directory(args: &RenderArgs, directory: &Path) -> Failure {
    let (count, shown) = (args.scenes.len(), shown(directory));
    Failure::input(if is_standard_output(directory) {
        "several pictures cannot go to standard output: name a directory with -o".into()
    } else if directory.extension().is_some() || directory.is_file() {
        format!(
            "{count} scenes make {count} pictures, and {shown} is the name of one: name a directory with -o, in which \
             each gets the name in its scene, or leave -o out to have them in this one"
        )
    } else {
        format!("{count} scenes make {count} pictures, and there is no directory {shown} for them: create it first")
    })
}

/// Fails if --preview conflicts with another output to standard output, or with --stats when no
/// file is written.
fn can_be_shown(args: &RenderArgs, to_standard_output: bool) -> Result<(), Failure> {
    let problem = if to_standard_output {
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

/// Fails if --orbit has several scenes, or an output name without a place for the number.
fn can_go_round(args: &RenderArgs) -> Result<(), Failure> {
    let name = args.output.as_deref().unwrap_or(Path::new(""));
    let problem = if name.to_str().is_none() {
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

/// Renders a scene to a picture, whose file must not be among the files `read` or `written` so far.
fn render_one(
    args: &RenderArgs,
    scene_path: &Path,
    tracing: Tracing,
    (read, written): (&mut BTreeSet<PathBuf>, &mut BTreeSet<PathBuf>),
) -> Result<(), Failure> {
    let clock = Instant::now();
    let SceneToRender { mut scene, files, carried_light } = args.open(scene_path)?;
    let (camera, parse) = (scene.camera, clock.elapsed());
    let rows = args.rows_of(&camera)?;
    scene.doubts().iter().for_each(|doubt| say(&format!("warning: {doubt}")));
    let show = |scene: &mut Scene| {
        let development = args.development.with_samples(Preview::SAMPLES);
        let (explain, quiet) = (args.explain && args.output.is_none(), args.quiet);
        Preview { tracing, development, camera, rows: rows.clone(), explain, quiet, scene_name: shown(scene_path) }
            .show(scene)
    };
    let takes_notes = !args.quiet && written.is_empty();
    if args.preview && args.output.is_none() {
        if takes_notes {
            args.development.note_bright_background();
        }
        return show(&mut scene);
    }
    let (path, format) = output(args, &scene)?;
    // Compare the targets of links.
    let file = |path: &Path| path.canonicalize().unwrap_or(path.into());
    read.extend(without_links(&files));
    if written.contains(&file(&path)) {
        let path = shown(&path);
        let problem = "as is that of a scene before it: render it in a call of its own";
        return Err(Failure::input(format!("its picture is {path}, {problem}")));
    }
    keep_scenes(&path, read)?;
    let development = args.development.of(&path, format)?;
    if takes_notes && format.is_8bit() {
        args.development.note_bright_background();
    }
    if args.preview {
        show(&mut scene)?;
    }
    scene.camera = development.map_or(Ok(camera), |development| sampled(&camera, development))?;
    // If signals cannot be handled, no file is written: fail before planning, which takes time.
    remove_part_files_on_signals()?;
    let engine = tracing.engine;
    if args.keep_all && !args.quiet && !engine.omissions().contains(&Omission::Misses) {
        say(&format!("{engine} tests every ray against every object as it is: --keep-all changes nothing"));
    }
    let all_rows = rows.len() as u64 * u64::from(args.orbit.unwrap_or(1));
    let progress = Progress::new(all_rows, args.quiet);
    let picture = Picture { args, tracing, camera, rows, format, development, progress };
    if let Some(count) = args.orbit {
        let moving = MovingCamera::of(&scene).carrying_light(carried_light);
        return picture.go_round(moving, &scene, count, &path, read);
    }
    let (setup, stats) = picture.write(&scene, &path)?;
    picture.progress.end();
    if args.stats || args.json {
        let report = Report::of(tracing, (camera.width(), &picture.rows), [parse, setup], &stats);
        print_result(args.json, &report, || report.text())?;
    } else if !args.quiet {
        say(&format!("{}: {} by {engine}, traced in {:.1?}", shown(&path), picture.size(), stats.trace));
    }
    written.insert(file(&path));
    Ok(())
}
