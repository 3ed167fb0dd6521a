//! A fast parser for the lines that nearly all OBJ files consist of, directly from the bytes.
//! Lines of any other form are left to the parser of words, which also reports errors.

use glam::Vec3;

/// Reads a vertex: text after `v` that is three numbers up to the line end. Returns the point
/// and the text after the line.
#[inline]
pub(super) fn point(mut text: &[u8]) -> Option<(Vec3, &[u8])> {
    let mut point = Vec3::ZERO;
    for number in point.as_mut() {
        text = after_blanks(text);
        let (value, length) = fast_float2::parse_partial::<f32, _>(text).ok()?;
        *number = value;
        text = &text[length..];
        if !matches!(text, [b' ' | b'\t' | b'\r' | b'\n', ..]) {
            return None;
        }
    }
    point.is_finite().then_some((point, after_line(after_blanks(text))?))
}

/// Reads a face: text after `f` up to the line end, with at least three corners whose numbers
/// are from 1 to `vertices`. Returns the text after the line.
#[inline]
pub(super) fn corners<'a>(mut text: &'a [u8], vertices: usize, corners: &mut Vec<u32>) -> Option<&'a [u8]> {
    corners.clear();
    loop {
        text = after_blanks(text);
        if !matches!(text, [b'0'..=b'9', ..]) {
            break;
        }
        let (index, after) = whole(text)?;
        text = after;
        if index == 0 || index as usize > vertices {
            return None;
        }
        corners.push(index - 1);
        // Skip the numbers of texture coordinates and normal.
        for _ in 0..2 {
            if let [b'/', after @ ..] = text {
                text = if matches!(after, [b'0'..=b'9', ..]) { whole(after)?.1 } else { after };
            }
        }
        if !matches!(text, [b' ' | b'\t' | b'\r' | b'\n', ..]) {
            return None;
        }
    }
    if corners.len() < 3 { None } else { after_line(text) }
}

/// Reads a non-negative integer of up to nine digits from the start of a text.
#[inline]
fn whole(text: &[u8]) -> Option<(u32, &[u8])> {
    const MOST_DIGITS: usize = 9;
    let (mut number, mut rest) = (0, text);
    while let [digit @ b'0'..=b'9', after @ ..] = rest {
        if text.len() - rest.len() == MOST_DIGITS {
            return None;
        }
        number = 10 * number + u32::from(digit - b'0');
        rest = after;
    }
    Some((number, rest))
}

/// Splits off the next line, trimmed at its end; None if it ends in a backslash and so
/// continues.
pub(super) fn line(text: &[u8]) -> Option<(&[u8], &[u8])> {
    let end = memchr::memchr2(b'\n', b'\r', text)?;
    let line = text[..end].trim_ascii_end();
    Some((line, after_line(&text[end..])?)).filter(|(line, _)| !line.ends_with(b"\\"))
}

#[inline]
fn after_blanks(mut text: &[u8]) -> &[u8] {
    while let [b' ' | b'\t', after @ ..] = text {
        text = after;
    }
    text
}

/// The text after the line end at its start, if it starts with one.
#[inline]
fn after_line(text: &[u8]) -> Option<&[u8]> {
    text.strip_prefix(b"\n").or_else(|| text.strip_prefix(b"\r\n"))
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::io::Write;
    use std::path::Path;

    use super::super::read;
    use crate::scene::Rng;
    use crate::scene::chunks::SharedFile;

    /// The same text with carriage returns alone at the ends of lines, so that no line is a usual
    /// one.
    fn with_returns(source: &[u8]) -> Vec<u8> {
        let mut returns = source.to_vec();
        let mut at = 0;
        returns.retain(|byte| {
            at += 1;
            !(*byte == b'\n' && at > 1 && source[at - 2] == b'\r')
        });
        returns.iter_mut().filter(|byte| **byte == b'\n').for_each(|byte| *byte = b'\r');
        returns
    }

    /// What breaks a line, or makes it an unusual one.
    const PIECES: [&[u8]; 18] = [
        b" ", b"\n", b"\r", b"-", b"0", b"9", b"#", b"/", b"e", b".", b"\\", b"\\\n", b"nan ", b"1e39 ", b"\xff",
        b"\t", b"g", b"\nv",
    ];

    #[test]
    fn usual_lines_are_read_as_others_are() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus/mesh_obj");
        let corpus = fs::read_dir(folder).unwrap().map(|entry| fs::read(entry.unwrap().path()).unwrap());
        let made = "v 1 2 3\nv 0 0 0\nv -1 .5 1e-1\r\nv 1. 2e0 +3 \nv 0 0 1 1 1 1\nv\t1 1 1\nf 1 2 3\n\
            f 1/ 2/1 3/1/4\nf 1//1 2//2 3//3 4\nf 1 2 3 4 5\t\r\nf -1 -2 -3\nf 5 6 7\nv 9 9 9\nf 1 2\n\
            vt 0 1\nvn 1 2 3\r\nusemtl a b\\\n c\n\no x # y\nwhat 1\nmtllib m.mtl\n  f 1 2 3\n\
            f 1 2 3 # 4\nf 1 2 \\\n3\nf 2 3 4";
        let mut rng = Rng::new(8);
        let mut sound = 0;
        for original in corpus.chain([made.as_bytes().to_vec()]) {
            for round in 0..200 {
                let mut source = original.clone();
                if round > 0 {
                    rng.change(&mut source, &PIECES);
                }
                let read = |source: &[u8]| read(source, source.len(), None).unwrap();
                let (usual, careful) = (read(&source), read(&with_returns(&source)));
                sound += usize::from(usual.is_ok());
                assert_eq!(format!("{usual:?}"), format!("{careful:?}"), "{}", source.escape_ascii());
            }
        }
        assert!(sound > 50, "{sound} sound ones");
    }

    #[test]
    fn several_threads_read_the_same_as_one() {
        const CHUNK: usize = 2 << 10;
        let mut rng = Rng::new(9);
        let mut original = b"mtllib a.mtl\nv 1 2 3\nv 0 0 .5\n".to_vec();
        for i in 3..600 {
            let mut some = || 1 + rng.next_u64() % i;
            let (a, b, c, d) = (some(), some(), some(), some());
            let lines = match i % 9 {
                0 => format!("v 1 {a} 3 \r\nf {a} {b} {c} {d}\n"),
                1 => format!("usemtl m{a}\nv {a}e-2 .{b} 3\nf {a}/{b}/{c} {b}//{c} {c}/1\n"),
                2 => format!("vt 0 {a}\nv {a} {b} {c}\nvn 0 0 {b}\no {a}\nwhat {c}\nf {c} {b} {a}\n"),
                _ => format!("v {a}.5 -{b} +{c}\nf {a} {b} {c}\n"),
            };
            original.extend(lines.as_bytes());
        }
        let (mut sound, mut others) = (0, 0);
        for round in 0..150 {
            let mut source = original.clone();
            (0..round % 4).for_each(|_| rng.change(&mut source, &PIECES));
            let mut file = tempfile::tempfile().unwrap();
            file.write_all(&source).unwrap();
            let shared = SharedFile::new(&file, 3).in_chunks_of(CHUNK);
            let by_three = read(shared.rest(0).unwrap(), source.len(), Some(shared)).unwrap();
            let by_one = read(&source[..], source.len(), None).unwrap();
            *if by_one.is_ok() { &mut sound } else { &mut others } += 1;
            assert!(format!("{by_three:?}") == format!("{by_one:?}"), "round {round}: {}", source.escape_ascii());
        }
        assert!(sound > 20 && others > 20, "{sound} sound ones, {others} others");
    }
}
