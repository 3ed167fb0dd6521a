//! Bands of rows: rank 0 hands them out, traces some itself, and writes the pixels of all in order.

use std::collections::{BTreeMap, VecDeque};
use std::error::Error;
use std::ops::Range;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

use rayo::{Camera, Film, FilmMut, Found, Frame, PixelFormat, Tracer, Vec4};

use crate::Failure;
use crate::ranks::{Naps, Ranks};

/// About the most pixels of a band, which has at least one row, and as many as are cheapest
/// together.
const BAND_PIXELS: u32 = 1 << 17;

/// The least number of bands for each rank, so that all finish at about the same time. There are
/// fewer where rows that are cheapest together would be separated.
const BANDS_OF_RANK: u32 = 16;

/// The most bands that a rank has been asked for at a time: while it sends one, it has the next.
const AHEAD: usize = 2;

/// The most bands for each rank that are begun before the file has taken their pixels: enough that
/// no rank waits for the file, and few enough to keep in memory.
const KEPT_OF_RANK: u64 = 4;

/// The division of a picture's rows into bands, which end at multiples of a height.
#[derive(Clone)]
struct Cut {
    rows: Range<u32>,
    height: u32,
}

impl Cut {
    fn new(rows: Range<u32>, width: u32, together: u32, ranks: usize) -> Self {
        let fair = rows.len() as u32 / BANDS_OF_RANK / ranks as u32;
        let height = (BAND_PIXELS / width).min(fair).max(1);
        Cut { rows, height: height.next_multiple_of(together.max(1)) }
    }

    /// The band that has a row.
    fn band_of(&self, row: u32) -> u64 {
        u64::from(row / self.height - self.rows.start / self.height)
    }

    fn count(&self) -> u64 {
        if self.rows.is_empty() { 0 } else { self.band_of(self.rows.end - 1) + 1 }
    }

    /// The rows of a band.
    fn rows_of(&self, band: u64) -> Range<u32> {
        let start = (u64::from(self.rows.start / self.height) + band) * u64::from(self.height);
        let end = (start + u64::from(self.height)).min(self.rows.end.into());
        self.rows.start.max(start as u32)..end as u32
    }
}

/// The pixels of a band.
enum Pixels {
    Own(Film),
    Sent(Vec<u8>),
}

impl Pixels {
    fn bytes(&self) -> &[u8] {
        match self {
            Pixels::Own(film) => film.bytes(),
            Pixels::Sent(bytes) => bytes,
        }
    }
}

/// A band that is traced, and how many of its rows the file has not taken yet.
struct Traced {
    pixels: Pixels,
    rows_left: usize,
}

#[derive(Default)]
struct State {
    /// The format of the pixels, once the file has asked for rows.
    format: Option<PixelFormat>,
    /// The first band that nobody has begun.
    next: u64,
    /// The number of bands that the file has taken.
    taken: u64,
    traced: BTreeMap<u64, Traced>,
}

/// The tracer of rank 0: a picture's rows from whichever rank has traced them.
pub struct SharedTracer<'a> {
    own: &'a dyn Tracer,
    camera: Camera,
    cut: Cut,
    /// The number of bands that may be begun before the file takes the first of them.
    most_kept: u64,
    state: Mutex<State>,
    /// Notified whenever a band is traced or taken.
    changed: Condvar,
}

impl<'a> SharedTracer<'a> {
    /// Shares `rows` of the picture that `own` traces. The caller asks for each of them once.
    pub fn new(own: &'a dyn Tracer, camera: Camera, rows: Range<u32>, ranks: &Ranks) -> Self {
        let cut = Cut::new(rows, camera.width(), own.rows_together(), ranks.count());
        let most_kept = KEPT_OF_RANK * ranks.count() as u64;
        SharedTracer { own, camera, cut, most_kept, state: Mutex::default(), changed: Condvar::new() }
    }

    /// Asks the other ranks for bands, and takes their pixels, until the picture is finished. A
    /// second band is asked of a rank only when every rank has a first one.
    pub fn hand_out(&self, ranks: &Ranks, is_finished: impl Fn() -> bool) {
        let mut given = vec![VecDeque::new(); ranks.count()];
        let mut naps = Naps::new();
        while !is_finished() {
            let mut is_idle = true;
            while let Some((rank, bytes)) = ranks.arrived() {
                let band = given[rank].pop_front().expect("a rank sends what it was asked for");
                self.keep(band, Pixels::Sent(bytes));
                is_idle = false;
            }
            for most in 1..=AHEAD {
                for (rank, bands) in given.iter_mut().enumerate().skip(1).filter(|(_, bands)| bands.len() < most) {
                    let mut state = self.lock();
                    let Some(format) = state.format else { continue };
                    let Some(band) = self.begin_next(&mut state, None) else { continue };
                    drop(state);
                    ranks.send(rank, &order(self.cut.rows_of(band), format));
                    bands.push_back(band);
                    is_idle = false;
                }
            }
            if is_idle {
                naps.take();
            } else {
                naps = Naps::new();
            }
        }
        (1..ranks.count()).for_each(|rank| ranks.send(rank, &[]));
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes the next band that nobody has begun, unless too many are ahead of the file. Bands up
    /// to the one that the file waits for, `wanted`, are never too many.
    fn begin_next(&self, state: &mut State, wanted: Option<u64>) -> Option<u64> {
        let band = state.next;
        let is_in_time = band < state.taken + self.most_kept || wanted.is_some_and(|wanted| band <= wanted);
        if band == self.cut.count() || !is_in_time {
            return None;
        }
        state.next += 1;
        Some(band)
    }

    fn keep(&self, band: u64, pixels: Pixels) {
        let rows_left = self.cut.rows_of(band).len();
        self.lock().traced.insert(band, Traced { pixels, rows_left });
        self.changed.notify_all();
    }

    /// Traces a band here.
    fn trace(&self, band: u64, format: PixelFormat) {
        let rows = self.cut.rows_of(band);
        let mut film = film_of(format, self.camera.width() as usize * rows.len());
        self.own.rows(rows, film.as_mut());
        self.keep(band, Pixels::Own(film));
    }

    /// Copies rows of one band to `out` as soon as it is traced. Until then this thread traces
    /// bands that nobody has begun.
    fn take(&self, band: u64, rows: Range<u32>, out: FilmMut<'_>) {
        let format = out.format();
        let mut state = self.lock();
        state.format = Some(format);
        while !state.traced.contains_key(&band) {
            if let Some(next) = self.begin_next(&mut state, Some(band)) {
                drop(state);
                self.trace(next, format);
                state = self.lock();
            } else {
                state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
            }
        }
        let Some(traced) = state.traced.get_mut(&band) else { return };
        let row_bytes = self.camera.width() as usize * format.bytes();
        let start = (rows.start - self.cut.rows_of(band).start) as usize * row_bytes;
        copy(&traced.pixels.bytes()[start..][..rows.len() * row_bytes], out);
        traced.rows_left -= rows.len();
        if traced.rows_left == 0 {
            state.traced.remove(&band);
            state.taken += 1;
            self.changed.notify_all();
        }
    }
}

impl Tracer for SharedTracer<'_> {
    fn writes(&self, format: PixelFormat) -> bool {
        self.own.writes(format)
    }

    fn rows_together(&self) -> u32 {
        self.own.rows_together()
    }

    fn rows(&self, rows: Range<u32>, mut out: FilmMut<'_>) {
        let mut start = rows.start;
        while start < rows.end {
            let band = self.cut.band_of(start);
            let end = self.cut.rows_of(band).end.min(rows.end);
            let pixels = |row: u32| (row - rows.start) as usize * self.camera.width() as usize;
            self.take(band, start..end, reborrow(&mut out).part(pixels(start)..pixels(end)));
            start = end;
        }
    }

    fn hits(&self, rows: Range<u32>) -> Vec<Option<Found>> {
        self.own.hits(rows)
    }
}

/// The work of the other ranks: traces the bands that rank 0 asks for, until it asks for none.
pub fn serve(ranks: &Ranks, frame: &Frame<'_>, width: u32) {
    while let Some((rows, format)) = ordered(&ranks.receive(0)) {
        let mut film = film_of(format, width as usize * rows.len());
        frame.trace(rows, film.as_mut(), &|_| ()).unwrap_or_else(|error| end_all(&error));
        ranks.send(0, film.bytes());
    }
}

fn film_of(format: PixelFormat, pixels: usize) -> Film {
    Film::new(format, pixels).unwrap_or_else(|error| end_all(&error))
}

/// Ends this rank, which cannot do its part; that ends all ranks.
fn end_all(error: &dyn Error) -> ! {
    Failure::output(error).tell();
    std::process::exit(1)
}

/// The message that asks a rank for a band: its rows, and the format of their pixels.
fn order(rows: Range<u32>, format: PixelFormat) -> Vec<u8> {
    let format = PixelFormat::ALL.iter().position(|other| *other == format).unwrap_or_default();
    [&rows.start.to_le_bytes()[..], &rows.end.to_le_bytes(), &[format as u8]].concat()
}

/// The band that a message asks for; None if it is the last message, which is empty.
fn ordered(message: &[u8]) -> Option<(Range<u32>, PixelFormat)> {
    let (start, rest) = message.split_first_chunk()?;
    let (end, rest) = rest.split_first_chunk()?;
    let format = PixelFormat::ALL.get(usize::from(*rest.first()?))?;
    Some((u32::from_le_bytes(*start)..u32::from_le_bytes(*end), *format))
}

/// The same pixels for a shorter time.
fn reborrow<'b>(film: &'b mut FilmMut<'_>) -> FilmMut<'b> {
    match film {
        FilmMut::F32x4(pixels) => FilmMut::F32x4(pixels),
        FilmMut::F32x3(pixels) => FilmMut::F32x3(pixels),
        FilmMut::Rgba8(pixels) => FilmMut::Rgba8(pixels),
        FilmMut::Rgb8(pixels) => FilmMut::Rgb8(pixels),
        FilmMut::Bgra8(pixels) => FilmMut::Bgra8(pixels),
    }
}

/// Copies `bytes`, which are [`Film::bytes`] of as many pixels, to `out`.
fn copy(bytes: &[u8], out: FilmMut<'_>) {
    let (words, _) = bytes.as_chunks();
    let float = |bytes: &[u8; 4]| f32::from_ne_bytes(*bytes);
    match out {
        FilmMut::Rgba8(out) => out.as_flattened_mut().copy_from_slice(bytes),
        FilmMut::Rgb8(out) => out.as_flattened_mut().copy_from_slice(bytes),
        FilmMut::Bgra8(out) => {
            out.iter_mut().zip(words).for_each(|(out, bytes)| *out = u32::from_ne_bytes(*bytes));
        }
        FilmMut::F32x3(out) => {
            out.as_flattened_mut().iter_mut().zip(words).for_each(|(out, bytes)| *out = float(bytes));
        }
        FilmMut::F32x4(out) => {
            let (pixels, _) = words.as_chunks::<4>();
            out.iter_mut()
                .zip(pixels)
                .for_each(|(out, pixel)| *out = Vec4::from([0, 1, 2, 3].map(|i| float(&pixel[i]))));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_are_all_rows_one_after_the_other() {
        for (rows, width, together, ranks) in
            [(0..1, 1, 1, 1), (0..1000, 333, 8, 3), (17..91, 200, 8, 2), (5..61, 1 << 20, 1, 4), (3..4000, 40, 7, 5)]
        {
            let cut = Cut::new(rows.clone(), width, together, ranks);
            let mut next = rows.start;
            for band in 0..cut.count() {
                let rows = cut.rows_of(band);
                assert_eq!(rows.start, next);
                assert!(rows.clone().all(|row| cut.band_of(row) == band), "{rows:?}");
                next = rows.end;
            }
            assert_eq!(next, rows.end);
        }
    }

    #[test]
    fn an_order_is_read_as_it_was_written() {
        for format in PixelFormat::ALL {
            assert_eq!(ordered(&order(7..70_000, format)), Some((7..70_000, format)));
        }
        assert_eq!(ordered(&[]), None);
    }
}
