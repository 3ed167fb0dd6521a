//! Scenes: what they do not need, how every engine shows them, and one ray of one of them.

use maud::{Markup, html};

use super::{Section, section, words};
use crate::cli::table::Table;
use crate::experiments::gallery::{Shot, Shown};
use crate::experiments::report::{Planned, Results, Stage};
use crate::experiments::svg::PlotError;

pub fn plans(results: &Results) -> Result<Section, PlotError> {
    section(results, (Stage::Plans, "What a scene does not need", "plans"), &results.plans, |plans| {
        Ok(html! { @for plan in plans { (of_scene(plan)) } })
    })
}

fn of_scene(plan: &Planned) -> Markup {
    let Planned { scene, engine, output, width, height, kept, cycles_per_pixel, keep_all, left_out } = plan;
    let mut table = Table::new(3, ["left out", "of it", "why", "times as long with it"]);
    let times = |ratio: &Option<f64>| ratio.map_or("-".into(), |ratio| format!("{ratio:.2}"));
    for line in left_out {
        let apart = format!("; with it the arithmetic is another, so that it is not in the {} above", times(keep_all));
        table.row(vec![
            line.what.clone(),
            format!("{} {}", line.count, line.unit),
            line.reason.clone() + if line.other_arithmetic { &apart } else { "" },
            times(&line.worth),
        ]);
    }
    html! {
        h3 { (scene) ": " (times(keep_all)) " times as long if everything is kept" }
        p {
            (width) "×" (height) " by " (engine) ", " (output) ": " (format!("{cycles_per_pixel:.2}")) " cycles a pixel. Traced: spheres "
            (kept.spheres) ", triangles " (kept.triangles) ", lights " (kept.lights) "."
        }
        (table.html())
    }
}

pub fn gallery(results: &Results) -> Result<Section, PlotError> {
    section(results, (Stage::Gallery, "The scenes by every engine", "gallery"), &results.gallery, |gallery| {
        Ok(html! { div.gallery { @for (number, shown) in gallery.iter().enumerate() { (flip(shown, number)) } } })
    })
}

/// A set to flip through, of names and pictures: each different one once, then what each has that the reference's has not.
fn sides(shown: &Shown) -> Vec<(String, &str)> {
    let names = |of: &Shot| {
        let like =
            shown.pictures.iter().filter(|other| other.like.as_ref() == Some(&of.engine)).map(|other| &*other.engine);
        [&*of.engine].into_iter().chain(like).collect::<Vec<_>>().join(", ")
    };
    let own = shown.pictures.iter().filter_map(|shot| Some((names(shot), shot.png.as_deref()?)));
    let differences = shown.pictures.iter().filter_map(|shot| {
        let pixels = if shot.differing == 1 { "pixel differs" } else { "pixels differ" };
        let levels = if shot.largest <= 1.0 { "a level".to_owned() } else { format!("up to {} levels", shot.largest) };
        let name = format!("{} - reference: {} {pixels}, by {levels}", names(shot), shot.differing);
        Some((name, shot.difference.as_deref()?))
    });
    own.chain(differences).collect()
}

fn flip(shown: &Shown, number: usize) -> Markup {
    let Shown { scene, width, height, .. } = shown;
    let sides = sides(shown);
    let id = |place: usize| format!("picture-{number}-{place}");
    html! {
        fieldset.flip {
            legend { (scene) }
            @for place in 0..sides.len() {
                input type="radio" name={ "picture-" (number) } id=(id(place)) checked[place == 0];
            }
            div.stage {
                @for (name, image) in &sides {
                    img width=(width) height=(height) loading="lazy" alt={ (scene) " by " (name) } src={ "data:image/png;base64," (image) };
                }
            }
            div.sides { @for (place, (name, _)) in sides.iter().enumerate() { label for=(id(place)) { (name) } } }
        }
    }
}

pub fn ray(results: &Results) -> Result<Section, PlotError> {
    section(results, (Stage::Ray, "One ray watched", "ray"), &results.ray, |told| {
        let command = words(&format!("`{}`", told.command));
        Ok(html! { details { summary { (command) } pre.wide tabindex="0" { (told.text) } } })
    })
}
