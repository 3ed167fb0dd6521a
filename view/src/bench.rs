//! `--frames`: pictures from all round a scene without a window, and the time of each part.

use std::f64::consts::TAU;
use std::time::{Duration, Instant};

use rayo::{Cancel, Scene};

use crate::commands::Source;
use crate::state::{State, Times, Tracing, Wish};
use crate::worker::Worker;

/// Turns the camera round the scene once in `frames` pictures, and prints the shortest and the
/// median time of each part.
///
/// # Errors
/// If a picture cannot be traced: why.
pub fn run(source: &Source, world: &Scene, state: &State, frames: u32) -> Result<(), String> {
    let start = Instant::now();
    let mut worker = Worker::new(source, world);
    println!("room for a moving camera: {}", milliseconds(start.elapsed()));
    let mut orbit = state.orbit();
    let first = state.finest();
    let mut film = None;
    let mut all = Vec::new();
    for _ in 0..frames {
        let wish = Wish { view: orbit.view(), ..first };
        let (drawn, times) = worker.draw(&wish, &Cancel::default(), film.take()).map_err(|none| none.to_string())?;
        film = Some(drawn);
        all.push(times);
        orbit.turn(TAU / f64::from(frames), 0.0);
    }
    let Tracing { engine, precision, threads, .. } = first.tracing;
    let [width, height] = first.size;
    println!("{engine} {precision}, {threads} threads, {width}x{height}, {frames} frames: shortest, median");
    print_part("moved", all.iter().map(|times| times.moved));
    print_part("planned", all.iter().map(|times| times.planned));
    print_part("traced", all.iter().map(|times| times.traced));
    print_part("all", all.iter().map(Times::total));
    Ok(())
}

/// Prints the shortest and the median of the times that a part of each frame took.
fn print_part(name: &str, times: impl Iterator<Item = Duration>) {
    let mut times: Vec<_> = times.collect();
    times.sort();
    println!("{name:8} {}, {}", milliseconds(times[0]), milliseconds(times[times.len() / 2]));
}

fn milliseconds(time: Duration) -> String {
    format!("{:.3} ms", 1e3 * time.as_secs_f64())
}
