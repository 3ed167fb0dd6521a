//! The sections about scenes: what the plan omits, the pictures of all engines, and one ray through
//! a scene.

use maud::{Markup, html};

use super::{Section, counted, section, words};
use crate::table::Table;
use rayo::internals::plan::with_digit_groups;
use rayo_lab::experiments::gallery::{ScenePictures, Shot, farthest};
use rayo_lab::experiments::report::{Planned, Results, Stage};
use rayo_lab::experiments::svg::PlotError;

pub fn plans(results: &Results) -> Result<Section, PlotError> {
    section(results, Stage::Plans, "What a scene does not need", "plans", &results.plans, |plans| {
        Ok(html! { @for plan in plans { (of_scene(plan)) } })
    })
}

fn of_scene(plan: &Planned) -> Markup {
    let Planned { scene, engine, output, width, height, kept, cycles_per_pixel, keep_all, left_out } = plan;
    let mut table = Table::new(3, ["left out", "how much", "why", "times as long if kept"]);
    let times = |ratio: &Option<f64>| ratio.map_or("-".into(), |ratio| format!("{ratio:.2}"));
    for line in left_out {
        let apart = format!("; this needs other arithmetic, so that it is not part of the {} above", times(keep_all));
        table.row(vec![
            line.what.clone(),
            counted(line.count, &line.unit),
            line.reason.clone() + if line.other_arithmetic { &apart } else { "" },
            times(&line.worth),
        ]);
    }
    html! {
        h3 { (scene) ": " (times(keep_all)) " times as long if everything is kept" }
        p {
            (width) "×" (height) " by " (engine) ", " (output) ": " (format!("{cycles_per_pixel:.2}")) " TSC cycles per pixel. Traced: "
            (counted(kept.spheres as u64, "spheres")) ", " (counted(kept.triangles as u64, "triangles")) ", "
            (counted(kept.lights as u64, "lights")) "."
        }
        (table.html())
    }
}

pub fn gallery(results: &Results) -> Result<Section, PlotError> {
    section(results, Stage::Gallery, "The scenes by every engine", "gallery", &results.gallery, |gallery| {
        Ok(html! {
            div.gallery {
                @for (number, shown) in gallery.iter().enumerate() { div { (flip(shown, number)) (apart(shown)) } }
            }
        })
    })
}

/// One of the pictures of a set that the reader can switch between: its name, and its PNG in
/// base64.
struct Side<'a> {
    name: String,
    png: &'a str,
}

/// The picture of the reference, the picture that differs most from it, and their difference.
fn sides(shown: &ScenePictures) -> Vec<Side<'_>> {
    let mut sides = Vec::new();
    if let Some((reference, png)) = shown.pictures.first().and_then(|shot| Some((&shot.engine, shot.png.as_deref()?))) {
        sides.push(Side { name: reference.to_string(), png });
    }
    if let Some(shot) = farthest(&shown.pictures).map(|place| &shown.pictures[place]) {
        sides.extend(shot.png.as_deref().map(|png| Side { name: like(shown, shot), png }));
        let name = "the difference, amplified".to_owned();
        sides.extend(shot.difference.as_deref().map(|png| Side { name, png }));
    }
    sides
}

fn flip(shown: &ScenePictures, number: usize) -> Markup {
    let ScenePictures { scene, width, height, .. } = shown;
    let sides = sides(shown);
    let id = |place: usize| format!("picture-{number}-{place}");
    html! {
        fieldset.flip {
            legend { (scene) }
            @for place in 0..sides.len() {
                input type="radio" name={ "picture-" (number) } id=(id(place)) checked[place == 0];
            }
            div.stage {
                @for Side { name, png } in &sides {
                    img width=(width) height=(height) loading="lazy" alt={ (scene) ": " (name) } src={ "data:image/png;base64," (png) };
                }
            }
            div.sides { @for (place, side) in sides.iter().enumerate() { label for=(id(place)) { (side.name) } } }
        }
    }
}

/// A table of how far each engine's picture is from the reference's. Engines with the same picture
/// share a row.
fn apart(shown: &ScenePictures) -> Markup {
    let mut table = Table::new(1, ["engine", "pixels that differ", "by levels, at most"]);
    for shot in shown.pictures.iter().skip(1).filter(|shot| shot.like.is_none()) {
        table.row(vec![like(shown, shot), with_digit_groups(shot.differing, ' '), format!("{}", shot.largest)]);
    }
    let same: Vec<_> = shown.pictures.iter().filter(|shot| shot.like.as_deref() == Some("reference")).collect();
    html! {
        (table.html())
        @if !same.is_empty() {
            p.absent { "Equal to the reference: " (same.iter().map(|shot| &*shot.engine).collect::<Vec<_>>().join(", ")) "." }
        }
    }
}

/// The name of an engine, and of those with the same picture.
fn like(shown: &ScenePictures, shot: &Shot) -> String {
    let like = shown.pictures.iter().filter(|other| other.like.as_ref() == Some(&shot.engine));
    [&*shot.engine].into_iter().chain(like.map(|other| &*other.engine)).collect::<Vec<_>>().join(", ")
}

pub fn ray(results: &Results) -> Result<Section, PlotError> {
    section(results, Stage::Ray, "Watching one ray", "ray", &results.ray, |told| {
        let command = words(&format!("`{}`", told.command));
        Ok(html! { details { summary { (command) } pre.wide tabindex="0" { (told.text) } } })
    })
}
