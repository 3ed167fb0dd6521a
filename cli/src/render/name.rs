//! The name of the picture file: from `-o`, or from the scene, which may come from anybody and is
//! not trusted.

use std::collections::BTreeSet;
use std::io::{self, IsTerminal};
use std::path::{Path, PathBuf};

use super::args::RenderArgs;
use crate::{Failure, is_read, keep_off_terminals, keep_scene_files, say};
use rayo::internals::render::{Format, is_standard_output};
use rayo::internals::scene::{Scene, is_unseen, printable, shown};

/// The name of picture `number` of a series; None if the name has no place for it: `%d`, or `%04d`
/// for four digits.
pub(super) fn numbered(name: &Path, number: u32) -> Option<PathBuf> {
    let (before, rest) = name.to_str()?.split_once('%')?;
    let (width, after) = rest.split_once('d')?;
    let digits: usize = if width.is_empty() { 0 } else { width.strip_prefix('0')?.parse().ok()? };
    (digits < 10 && !after.contains('%')).then(|| format!("{before}{number:0digits$}{after}").into())
}

/// The picture file that `-o` names, or else the one that the scene names, in the current
/// directory.
pub(super) fn output(args: &RenderArgs, scene: &Scene) -> Result<(PathBuf, Format), Failure> {
    let path = match &args.output {
        Some(directory) if args.scenes.len() > 1 => directory.join(bare_name(&scene.name)?),
        Some(path) => path.clone(),
        None => bare_name(&scene.name)?,
    };
    let is_of_scene = args.output.is_none() || args.scenes.len() > 1;
    let name = printable(&scene.name);
    let format = Format::from_path(&path).map_err(|error| {
        let advice = match (is_of_scene, args.scenes.len()) {
            (false, _) => "",
            (true, 1) => "; this name stands in the scene: change it there, or name a file with -o",
            (true, _) => "; this name stands in the scene: change it there, or render it in a call of its own with -o",
        };
        Failure::input(format!("{error}{advice}"))
    })?;
    if is_of_scene && path.is_dir() {
        return Err(Failure::input(format!(
            "the scene names its picture `{name}`, and {} is a directory: name a file with -o",
            shown(&path)
        )));
    }
    keep_off_terminals(&path)?;
    if !is_standard_output(&path) {
        return Ok((path, format));
    }
    if format != Format::PpmText && io::stdout().is_terminal() {
        return Err(Failure::input(
            "the picture goes to standard output, and that is a terminal: name a file with -o, or send it on to a program",
        ));
    }
    // The name that errors show for standard output.
    Ok(("/dev/stdout".into(), format))
}

/// Fails if the picture would replace a file in `read` or is a link to a file that a later scene
/// may be read from.
pub(super) fn keep_scenes(path: &Path, read: &BTreeSet<PathBuf>) -> Result<(), Failure> {
    let target = path.canonicalize().unwrap_or_default();
    if read.contains(&target) && target.is_file() {
        return Err(is_read(path));
    }
    keep_scene_files(path)
}

/// The image name of a scene without its directories. Since scenes come from anywhere, they must
/// not choose a directory, a hidden file, or a name that looks like an option.
fn bare_name(name: &str) -> Result<PathBuf, Failure> {
    let (shown, bare) = (printable(name), name.rsplit(['/', '\\']).next().unwrap_or_default());
    if bare.is_empty() || bare.starts_with(['.', '-']) || is_standard_output(Path::new(bare)) {
        return Err(Failure::input(format!(
            "the scene's image name `{shown}` is not the name of a plain file: name one with -o"
        )));
    }
    if name.contains(is_unseen) {
        return Err(Failure::input(format!(
            "the scene's image name `{shown}` has control or format characters: name a file with -o"
        )));
    }
    if bare != name {
        say(&format!("warning: of the scene's image name `{shown}` only `{bare}` is used, in this directory"));
    }
    Ok(Path::new(bare).to_path_buf())
}
