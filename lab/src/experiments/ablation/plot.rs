//! The figure of the gain of each omission: a line per omission, and on it a mark per scene.

use std::collections::BTreeMap;

use plotters::prelude::*;

use super::Timed;
use crate::experiments::svg::{COLOURS, GREY, Mark, PlotError, SMALL, down, draw, head, mark, text_width, write};

const WIDTH: i32 = 960;
const LINE: i32 = 26;
/// The marks of scenes. When all colours are used up, further scenes have the same colours again
/// with the next mark.
const MARKS: [Mark; 3] = [Mark::Dot, Mark::Triangle, Mark::Square];
/// The axis values that may be labelled; those outside of the axis's range are not drawn.
const TICKS: [f64; 11] = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0, 1024.0];

/// A scene's name, and for each omission the ratio of the time without it to the plan's.
pub type OmissionGain<'a> = (String, Vec<(&'a str, Timed)>);

/// Draws a line for each omission, sorted by its largest gain in any scene, on a logarithmic scale.
pub fn figure(scenes: &[OmissionGain<'_>]) -> Result<String, PlotError> {
    let ratios = || scenes.iter().flat_map(|(_, lines)| lines).filter_map(|(name, timed)| Some((*name, timed.ratio?)));
    let mut most = BTreeMap::new();
    for (name, ratio) in ratios() {
        let most = most.entry(name).or_insert(ratio);
        *most = ratio.max(*most);
    }
    let mut names: Vec<_> = most.keys().copied().collect();
    names.sort_by(|one, other| most[other].total_cmp(&most[one]));
    let low = ratios().map(|(_, ratio)| ratio).fold(0.9, f64::min).log2();
    let high = (1.15 * most.values().copied().fold(2.0, f64::max)).log2();
    let left = names.iter().map(|name| text_width(name, SMALL)).max().unwrap_or(0) + 28;
    let place = |ratio: f64| left + (f64::from(WIDTH - left - 24) * (ratio.log2() - low) / (high - low)) as i32;
    let look = |scene: usize| (MARKS[scene / COLOURS.len() % MARKS.len()], COLOURS[scene % COLOURS.len()]);
    let entries: Vec<_> = scenes
        .iter()
        .enumerate()
        .map(|(scene, (name, _))| {
            let (mark, colour) = look(scene);
            (mark, colour, name.clone())
        })
        .collect();
    let bottom = LINE * names.len() as i32;
    draw((WIDTH, bottom + 110 + LINE * (scenes.len() as i32 / 7)), |area| {
        let area = head(area, "Time without each omission, divided by the time as planned", &entries)?;
        for ratio in TICKS.into_iter().filter(|ratio| ratio.log2() <= high) {
            down(&area, place(ratio), bottom, ratio, if ratio == 1.0 { 0.5 } else { 0.12 })?;
        }
        for (line, name) in names.iter().enumerate() {
            let y = LINE * line as i32 + LINE / 2;
            write(&area, name, (12, y - SMALL / 2 - 1), SMALL)?;
            area.draw(&PathElement::new([(left, y), (WIDTH - 24, y)], GREY.mix(0.25).stroke_width(1)))?;
            for (scene, (_, lines)) in scenes.iter().enumerate() {
                let (shape, colour) = look(scene);
                for ratio in lines.iter().filter(|(other, _)| other == name).filter_map(|(_, timed)| timed.ratio) {
                    mark(&area, shape, (place(ratio), y), 5, colour)?;
                }
            }
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn omissions_have_lines_and_scenes_marks_on_them() {
        let scene = |name: &str, lines: &[(&'static str, Timed)]| (name.to_owned(), lines.to_vec());
        let svg = figure(&[
            scene("one.in", &[("misses", Timed::once(8.0)), ("no code", Timed::NO_CODE)]),
            scene("two.in", &[("misses", Timed::once(30.0)), ("depths", Timed::once(1.5))]),
        ])
        .unwrap();
        // Three marks in the lines, and two in the legend.
        assert_eq!(svg.matches("<circle").count(), 3 + 2);
        for text in ["one.in", "two.in", "misses", "depths"] {
            assert_eq!(svg.matches(&format!(">{text}<")).count(), 1, "{text}");
        }
        assert!(!svg.contains("no code"));
        assert!(svg.find(">misses<") < svg.find(">depths<"), "what is worth most comes first");
    }
}
