//! Rows of R, G, B filtered for PNG and deflated: runs of a pixel and single bytes, with a Huffman code for each part.
//!
//! A row minus the one above consists of small numbers, and of zeros where nothing changes. Searching for matches
//! farther away would make files a sixth to two fifths smaller, in 1.5 to 2 times the time (zlib's first level).

/// The most bytes that one byte of deflate can stand for: two bits can repeat 258 bytes.
pub(super) const DEFLATE_EXPANSION: u64 = 1032;
/// Bytes of a pixel, which is the distance of a run.
const PIXEL: usize = 3;
/// Padding after a filtered row, so that sixteen bytes can be read from any place in it and from its end.
const BEHIND: usize = 16;
/// One row in this many is counted to make the code.
const SAMPLED: usize = 16;
/// Bytes, the end of a block, and the lengths of runs.
const SYMBOLS: usize = 286;
const END: usize = 256;
/// The longest run that has a symbol: whole pixels.
const LONGEST_RUN: usize = 258;
/// The longest codeword in bits. Deflate allows 15, but gains nothing by them if all symbols need a word.
const LONGEST_WORD: usize = 14;
/// The word of the only distance.
const DISTANCE: Word = Word { bits: 0, length: 1 };
/// The order in which deflate stores the lengths of the code for lengths, and the symbol that repeats one.
const ORDER: [usize; 19] = [16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15];
const REPEAT: usize = 16;

/// The rows, of `row` bytes each, as blocks that end on a byte boundary, and the Adler-32 of their content.
pub(super) fn blocks(rows: &[u8], row: usize) -> (Vec<u8>, u32) {
    let mut filtered = vec![0; 1 + row + BEHIND];
    let number = rows.len() / row;
    // One of each symbol, so that symbols of uncounted rows have a word too.
    let mut counts = [1; SYMBOLS];
    for at in (number.min(SAMPLED) / 2..number).step_by(SAMPLED) {
        filter(&mut filtered, rows, row, at);
        tokens(&filtered, |token| match token {
            Token::Pixel(pixel) => split(pixel).iter().for_each(|byte| counts[*byte] += SAMPLED as u64),
            Token::Run(length) => counts[run(length).0] += SAMPLED as u64,
        });
    }
    let lengths = lengths(&counts, LONGEST_WORD);
    let words = words(&lengths);
    let literals: [Word; 1 << 8] = std::array::from_fn(|byte| words[byte]);
    let runs: Vec<_> =
        (PIXEL..=LONGEST_RUN).map(run).map(|(symbol, more)| words[symbol].then(more).then(DISTANCE)).collect();

    let (mut out, mut end) = begin_block(&lengths);
    let mut sum = simd_adler32::Adler32::new();
    for at in 0..number {
        filter(&mut filtered, rows, row, at);
        sum.write(&filtered[..1 + row]);
        let bytes = end.reserve(&mut out, 1 + row);
        end.put(bytes, literals[usize::from(filtered[0])]);
        tokens(&filtered, |token| match token {
            Token::Pixel(pixel) => {
                let [r, g, b] = split(pixel).map(|byte| literals[byte]);
                end.put(bytes, r.then(g).then(b));
            }
            Token::Run(length) => end.put(bytes, runs[length - PIXEL]),
        });
    }
    (end_block(out, end, words[END]), sum.finish())
}

/// Stores a row after the number of its filter: minus the row above, or, in the first row, minus the pixel to the left.
fn filter(filtered: &mut [u8], rows: &[u8], row: usize, at: usize) {
    let from = &rows[at * row..][..row];
    let to = &mut filtered[..1 + row];
    if at > 0 {
        to[0] = 2;
        let above = &rows[(at - 1) * row..][..row];
        to[1..].iter_mut().zip(from).zip(above).for_each(|((to, from), above)| *to = from.wrapping_sub(*above));
    } else {
        to[0] = 1;
        to[1..][..PIXEL].copy_from_slice(&from[..PIXEL]);
        let left = from.iter().zip(&from[PIXEL..]);
        to[1 + PIXEL..].iter_mut().zip(left).for_each(|(to, (left, from))| *to = from.wrapping_sub(*left));
    }
}

enum Token {
    /// Bytes, the first one lowest.
    Pixel(u32),
    /// So many bytes, of whole pixels, that equal those one pixel before.
    Run(usize),
}

fn split(pixel: u32) -> [usize; PIXEL] {
    [0, 8, 16].map(|shift| (pixel >> shift & 0xff) as usize)
}

/// Hands over the items of a filtered row, after its first byte.
#[inline(always)]
fn tokens(filtered: &[u8], mut each: impl FnMut(Token)) {
    let sixteen =
        |at: usize| u128::from_le_bytes(*filtered[at..].first_chunk().expect("there are more behind the row"));
    let pixel = |at| sixteen(at) as u32 & 0xff_ffff;
    let change = |at| sixteen(at) ^ sixteen(at - PIXEL);
    let (mut start, end) = (1, filtered.len() - BEHIND);
    while start < end {
        let (first, mut at) = (pixel(start), start + PIXEL);
        let token = if start == 1 || first != pixel(start - PIXEL) {
            Token::Pixel(first)
        } else {
            let end = end.min(start + LONGEST_RUN);
            while at < end && change(at) == 0 {
                at += 16;
            }
            at += change(at.min(end)).trailing_zeros() as usize / 8;
            at = start + (at.min(end) - start) / PIXEL * PIXEL;
            Token::Run(at - start)
        };
        each(token);
        start = at;
    }
}

/// The symbol for the length of a run, and the extra bits of the length after it.
fn run(length: usize) -> (usize, Word) {
    let beyond = length as u64 - 3;
    match (length, beyond.checked_ilog2().unwrap_or(0)) {
        (LONGEST_RUN, _) => (SYMBOLS - 1, Word::default()),
        (_, 0..3) => (END + 1 + beyond as usize, Word::default()),
        (_, magnitude) => {
            let more = magnitude - 2;
            let symbol = END + 1 + 4 * more as usize + (beyond >> more) as usize;
            (symbol, Word { bits: beyond & ((1 << more) - 1), length: more })
        }
    }
}

/// Bits of a codeword, the first one lowest.
#[derive(Clone, Copy, Default)]
struct Word {
    bits: u64,
    length: u32,
}

impl Word {
    #[inline(always)]
    fn then(self, next: Word) -> Word {
        Word { bits: self.bits | next.bits << self.length, length: self.length + next.length }
    }
}

/// The lengths of the Huffman code's words for symbols of these frequencies, at most `longest`; 0 for a frequency of 0.
fn lengths(counts: &[u64], longest: usize) -> Vec<u8> {
    let mut symbols: Vec<_> = (0..counts.len()).filter(|symbol| counts[*symbol] > 0).collect();
    symbols.sort_by_key(|symbol| counts[*symbol]);
    // Nodes of the tree: the symbols, the rarest first, and then pairs, in order of frequency too.
    let mut weights: Vec<_> = symbols.iter().map(|symbol| counts[*symbol]).collect();
    let mut parents = vec![0; 2 * symbols.len()];
    let (mut leaf, mut pair) = (0, symbols.len());
    while weights.len() + 1 < 2 * symbols.len() {
        let mut weight = 0;
        for _ in 0..2 {
            let is_leaf = leaf < symbols.len() && weights.get(pair).is_none_or(|pair| weights[leaf] <= *pair);
            let next = if is_leaf { &mut leaf } else { &mut pair };
            parents[*next] = weights.len();
            weight += weights[*next];
            *next += 1;
        }
        weights.push(weight);
    }
    let mut depths = vec![0; weights.len()];
    for node in (0..weights.len() - 1).rev() {
        depths[node] = depths[parents[node]] + 1;
    }
    let mut numbers = vec![0_usize; longest + 1];
    symbols.iter().zip(&depths).for_each(|(_, depth)| numbers[longest.min(*depth)] += 1);
    // Words that were shortened take too much room: of each two too many, one goes below a shorter word.
    let room: usize = (1..=longest).map(|length| numbers[length] << (longest - length)).sum();
    for _ in 1 << longest..room {
        let shorter = (1..longest).rev().find(|length| numbers[*length] > 0).unwrap_or(1);
        numbers[longest] -= 1;
        numbers[shorter] -= 1;
        numbers[shorter + 1] += 2;
    }
    let mut lengths = vec![0; counts.len()];
    let longest_first = (1..=longest).rev().flat_map(|length| std::iter::repeat_n(length as u8, numbers[length]));
    symbols.iter().zip(longest_first).for_each(|(symbol, length)| lengths[*symbol] = length);
    lengths
}

/// The words of the canonical code with these lengths.
fn words(lengths: &[u8]) -> Vec<Word> {
    let mut words = vec![Word::default(); lengths.len()];
    let mut next = 0_u16;
    for length in 1..=15_u8 {
        next <<= 1;
        for (word, _) in words.iter_mut().zip(lengths).filter(|(_, of)| **of == length) {
            *word = Word { bits: (next.reverse_bits() >> (16 - length)).into(), length: length.into() };
            next += 1;
        }
    }
    words
}

/// Bits written one after another, from the lowest of a byte up.
#[derive(Clone, Copy, Default)]
struct End {
    /// The complete bytes.
    full: usize,
    /// Bits that do not fill a byte yet.
    partial: Word,
}

impl End {
    /// Makes room for this many more symbols.
    fn reserve(self, bytes: &mut Vec<u8>, symbols: usize) -> &mut [u8] {
        let needed = self.full + 2 * symbols + 2 * size_of::<u64>();
        if bytes.len() < needed {
            bytes.resize(needed.max(2 * bytes.len()), 0);
        }
        bytes
    }

    /// Appends at most 56 bits.
    #[inline(always)]
    fn put(&mut self, bytes: &mut [u8], word: Word) {
        let Word { bits, length } = self.partial.then(word);
        bytes[self.full..][..size_of::<u64>()].copy_from_slice(&bits.to_le_bytes());
        self.full += length as usize / 8;
        self.partial = Word { bits: bits >> (length & !7), length: length % 8 };
    }
}

/// Begins a block with a code of these lengths, in which all runs have the same distance.
fn begin_block(code: &[u8]) -> (Vec<u8>, End) {
    // The distances 1 and 2 have no word.
    let all = [code, &[0; PIXEL - 1], &[DISTANCE.length as u8]].concat();
    // Each with its extra bits: how often the previous length is repeated.
    let mut told = Vec::new();
    for same in all.chunk_by(|a, b| a == b) {
        let symbol = (usize::from(same[0]), Word::default());
        told.push(symbol);
        for repeated in same[1..].chunks(6) {
            match repeated.len() {
                times @ 3.. => told.push((REPEAT, Word { bits: times as u64 - 3, length: 2 })),
                times => told.extend(std::iter::repeat_n(symbol, times)),
            }
        }
    }
    let mut counts = [0; ORDER.len()];
    told.iter().for_each(|(symbol, _)| counts[*symbol] += 1);
    let lengths = lengths(&counts, 7);
    let words = words(&lengths);
    let (mut bytes, mut end) = (Vec::new(), End::default());
    end.reserve(&mut bytes, all.len());
    // Not the last block, a dynamic code; and the number of lengths of each kind.
    let numbers = [(0b100, 3), (code.len() - 257, 5), (PIXEL - 1, 5), (ORDER.len() - 4, 4)];
    let lengths = ORDER.map(|symbol| (lengths[symbol].into(), 3));
    for (bits, length) in numbers.into_iter().chain(lengths) {
        end.put(&mut bytes, Word { bits: bits as u64, length });
    }
    told.iter().for_each(|(symbol, more)| end.put(&mut bytes, words[*symbol].then(*more)));
    (bytes, end)
}

/// Ends a block, and the last byte: with a stored block of no bytes, which begins on a byte boundary.
fn end_block(mut bytes: Vec<u8>, mut end: End, word: Word) -> Vec<u8> {
    end.reserve(&mut bytes, 0);
    end.put(&mut bytes, word.then(Word { bits: 0, length: 3 }));
    end.put(&mut bytes, Word { bits: 0, length: (8 - end.partial.length) % 8 });
    end.put(&mut bytes, Word { bits: 0xffff_0000, length: 32 });
    bytes.truncate(end.full);
    bytes
}
