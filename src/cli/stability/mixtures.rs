//! `rayo stability --mixtures`: random mixtures, and what is left of those that fail.

use std::collections::BTreeSet;
use std::process::ExitCode;
use std::sync::atomic::Ordering;

use super::StabilityArgs;
use crate::cli::measuring::{bar, stop_on_signals, tell_whether, write_file};
use crate::cli::{Failure, print_result};
use crate::experiments::accuracy::Contender;
use crate::experiments::stability::Settings;
use crate::experiments::stability::mixtures::{self, Failing};
use crate::scene::families::mixture;

/// Of so many that fail, the first, it is found out what matters.
const MINIMISED: usize = 20;

/// Judges, prints, and writes scenes.
pub fn run(args: &StabilityArgs, settings: &Settings, count: usize) -> Result<ExitCode, Failure> {
    let packet = |contender: &Contender| contender.engine.is_packet();
    let contenders = settings.contenders.iter().filter(|contender| args.engine.is_some() || packet(contender));
    let contenders: Vec<Contender> = contenders.copied().collect();
    let stop = stop_on_signals()?;
    let bar = bar(count as u64);
    let proceed = || {
        bar.inc(1);
        !stop.load(Ordering::Relaxed)
    };
    let found = mixtures::judge_mixtures(&contenders, args.seed, count, &proceed).map_err(Failure::input)?;
    bar.finish_and_clear();
    for failing in found.failing.iter().take(MINIMISED) {
        write_scene(args, failing, &contenders)?;
    }
    print_result(args.json, &found, || {
        let failing: String = found.failing.iter().map(text).collect();
        let last = args.seed.wrapping_add(found.mixtures as u64).wrapping_sub(1);
        let seeds = if found.mixtures > 0 { format!(", seeds {} to {last}", args.seed) } else { String::new() };
        format!("{failing}{} mixtures{seeds}: {} fail\n", found.mixtures, found.failing.len())
    })?;
    tell_whether(found.complete);
    Ok(if found.failing.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

/// What fails in a mixture, and the command that repeats it: a line for each precision and kind of failure, with the worst.
fn text(failing: &Failing) -> String {
    let Failing { seed, kinds, counts: [spheres, triangles, lights], failures } = failing;
    let kinds = kinds.join(", ");
    let mut text = format!("mixture {seed}: {spheres} spheres, {triangles} triangles, {lights} lights; {kinds}\n");
    let kinds: BTreeSet<_> = failures.iter().map(|failure| (failure.precision, failure.what)).collect();
    for (precision, what) in kinds {
        let of = || failures.iter().filter(|failure| (failure.precision, failure.what) == (precision, what));
        let engines: BTreeSet<_> = of().map(|failure| failure.engine).collect();
        let outputs: BTreeSet<_> = of().filter_map(|failure| failure.output).collect();
        let [engines, outputs] = [engines, outputs].map(|names| names.into_iter().collect::<Vec<_>>().join(" "));
        text += &format!("    {what} in {precision} by {engines} {outputs}");
        let Some(worst) = of().max_by_key(|failure| failure.pixels).filter(|worst| worst.pixels > 0) else { continue };
        let mixtures::Failure { engine, output, pixels, pixel: [x, y], expected, found, .. } = worst;
        let output = output.unwrap_or("hits");
        text += &format!(": {pixels} pixels, {engine} {output} at {x},{y} {found} for {expected}\n");
    }
    text + &format!("    rayo stability --mixtures 1 --seed {seed}\n")
}

/// Writes what is left of a mixture that fails when all that does not matter is left out.
fn write_scene(args: &StabilityArgs, failing: &Failing, contenders: &[Contender]) -> Result<(), Failure> {
    // The first that fails is enough, and quicker.
    let [first, ..] = &failing.failures[..] else { return Ok(()) };
    let same = |contender: &&Contender| {
        (contender.engine.name(), contender.precision.name()) == (first.engine, first.precision)
    };
    let contender: Vec<Contender> = contenders.iter().filter(same).copied().collect();
    let scene = mixtures::minimised(&mixture(failing.seed).scene, &|scene| {
        mixtures::failures(scene, &contender).is_ok_and(|failures| !failures.is_empty())
    });
    // The paper's format has no film.
    let (extension, text) =
        if scene.camera.film() == 1.0 { ("in", scene.to_text()) } else { ("toml", scene.to_toml()) };
    write_file(&args.out, &format!("mixture-{}.{extension}", failing.seed), text.as_bytes())
}
