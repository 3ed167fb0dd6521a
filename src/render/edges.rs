//! Finds the edges of a picture: the pixels at which more than one ray per pixel is worthwhile.

use std::ops::Range;

/// A pixel is at an edge if in some direction the sum of the levels of two opposite neighbours
/// differs from twice its own level by more than this. Where light is smooth, this second
/// difference approximates the second derivative, and the mean over a pixel differs from the value
/// at its centre by a 24th of it per axis: by less than a level.
const MOST_BEND: i16 = 8;

/// The pixels of some rows that are at edges.
pub(super) struct Edges {
    /// The first of the rows.
    first: u32,
    /// The columns of the first row's edges, followed by those of the next row, and so on.
    columns: Vec<u32>,
    /// The index in `columns` at which each row begins, and the end of the last row.
    starts: Vec<usize>,
}

impl Edges {
    /// The edges of `rows`. `levels` are the `known` rows of the picture: those rows, and the ones
    /// above and below them if they exist. At the picture's border its last pixels are repeated.
    pub(super) fn of(levels: &[[u8; 4]], known: Range<u32>, rows: Range<u32>, width: usize) -> Self {
        let (mut columns, mut starts) = (Vec::new(), vec![0]);
        // Three rows of levels, each with one more pixel at either end.
        let mut three = [const { Vec::new() }; 3];
        let mut bends = vec![0; 4 * width];
        for row in rows.clone() {
            let ends = [row.saturating_sub(1).max(known.start), row, (row + 1).min(known.end - 1)];
            for (padded, row) in three.iter_mut().zip(ends) {
                let pixels = &levels[(row - known.start) as usize * width..][..width];
                padded.clear();
                padded.extend_from_slice(&pixels[0]);
                padded.extend_from_slice(pixels.as_flattened());
                padded.extend_from_slice(&pixels[width - 1]);
            }
            find_bends(three.each_ref().map(|row| &row[..]), &mut bends);
            let bends = bends.as_chunks().0.iter().map(|bends| u32::from_ne_bytes(*bends));
            columns.extend((0..).zip(bends).filter(|(_, bends)| *bends != 0).map(|(column, _)| column));
            starts.push(columns.len());
        }
        Edges { first: rows.start, columns, starts }
    }

    /// The columns of a row's edges.
    pub(super) fn row(&self, row: u32) -> &[u32] {
        let row = (row - self.first) as usize;
        &self.columns[self.starts[row]..self.starts[row + 1]]
    }

    /// The range of those of `rows` that have an edge in `columns`, from the first to the last.
    pub(super) fn within(&self, rows: Range<u32>, columns: Range<u32>) -> Range<u32> {
        let has = |row: &u32| {
            let of_row = self.row(*row);
            of_row.get(of_row.partition_point(|column| *column < columns.start)).is_some_and(|next| *next < columns.end)
        };
        let first = rows.clone().find(has).unwrap_or(rows.end);
        let end = (first..rows.end).rfind(has).map_or(first, |last| last + 1);
        first..end
    }

    /// The number of edges.
    pub(super) fn count(&self) -> u64 {
        self.columns.len() as u64
    }
}

/// For each level of the middle row 1 if its second difference is too large in one of four
/// directions, else 0. The rows have one more pixel at either end.
fn find_bends(rows: [&[u8]; 3], bends: &mut [u8]) {
    let count = bends.len();
    let [above, here, below] = rows.map(|row| [0, 4, 8].map(|start| &row[start..][..count]));
    for (i, bends) in bends.iter_mut().enumerate() {
        let twice = 2 * i16::from(here[1][i]);
        let bend = |one: &[u8], other: &[u8]| (i16::from(one[i]) + i16::from(other[i]) - twice).abs();
        let straight = bend(here[0], here[2]).max(bend(above[1], below[1]));
        let slanting = bend(above[0], below[2]).max(bend(above[2], below[0]));
        *bends = u8::from(straight.max(slanting) > MOST_BEND);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The columns of edges in each row of a picture of grey levels. Checks that all rows at once
    /// and each row alone give the same ones.
    fn edges<const WIDTH: usize>(picture: &[[u8; WIDTH]]) -> Vec<Vec<u32>> {
        let height = picture.len() as u32;
        let levels: Vec<_> = picture.as_flattened().iter().map(|level| [*level, 7, 7, 255]).collect();
        let whole = Edges::of(&levels, 0..height, 0..height, WIDTH);
        let rows: Vec<Vec<u32>> = (0..height).map(|row| whole.row(row).to_vec()).collect();
        for row in 0..height {
            let known = row.saturating_sub(1)..height.min(row + 2);
            let levels = &levels[known.start as usize * WIDTH..known.end as usize * WIDTH];
            let alone = Edges::of(levels, known, row..row + 1, WIDTH);
            assert_eq!(alone.row(row), rows[row as usize]);
            for column in 0..WIDTH as u32 {
                let with = (0..height).filter(|row| rows[*row as usize].contains(&column));
                let with: Vec<u32> = with.filter(|other| *other >= row).collect();
                let within = whole.within(row..height, column..column + 1);
                assert_eq!(within.is_empty(), with.is_empty(), "row {row}, column {column}");
                if let (Some(first), Some(last)) = (with.first(), with.last()) {
                    assert_eq!(within, *first..last + 1, "row {row}, column {column}");
                }
            }
        }
        assert_eq!(whole.count() as usize, rows.iter().flatten().count());
        rows
    }

    #[test]
    fn smooth_pictures_have_no_edges_and_steps_two() {
        let slope = [[10, 30, 50, 70, 90]; 4];
        assert_eq!(edges(&slope).concat(), [0, 4].repeat(4), "the picture's own border is one");
        let step = [[40, 40, 40, 90, 90, 90]; 3];
        assert_eq!(edges(&step).concat(), [2, 3].repeat(3));
        let down = [[5; 3], [5; 3], [200; 3], [200; 3]];
        assert_eq!(edges(&down), [vec![], vec![0, 1, 2], vec![0, 1, 2], vec![]]);
    }

    #[test]
    fn a_corner_is_seen_from_all_around_and_eight_levels_are_none() {
        let mut dot = [[50; 7]; 5];
        dot[2][3] = 58;
        // The pixel itself counts twice: its difference is 16, that of its neighbours only 8, which
        // is no edge.
        assert_eq!(edges(&dot), [vec![], vec![], vec![3], vec![], vec![]]);
        dot[2][3] = 54;
        assert_eq!(edges(&dot).concat(), [0; 0]);
        dot[2][3] = 59;
        assert_eq!(edges(&dot), [vec![], vec![2, 3, 4], vec![2, 3, 4], vec![2, 3, 4], vec![]]);
    }
}
