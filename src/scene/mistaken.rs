//! Recognises files that are not what their names say: pointers of Git LFS, web pages, archives,
//! pictures, text in UTF-16.

use super::log::BYTE_ORDER_MARK;

/// A kind of file that is no scene, no mesh and no material file.
pub(crate) struct Mistaken {
    /// What the file is, in a sentence.
    pub what: &'static str,
    /// What the user can do.
    pub help: &'static str,
}

/// How many bytes from the start of a file [`recognise`] looks at: most signatures are of a few
/// bytes, but blanks and a comment may stand before the first tag of a web page.
pub(crate) const BEGINNING: usize = 256;

const UTF_16: Mistaken = Mistaken {
    what: "this looks like UTF-16",
    help: "save the file as UTF-8, or convert it: iconv -f UTF-16 -t UTF-8 IN > OUT",
};
const GIT_LFS: Mistaken = Mistaken {
    what: "this is a pointer of Git LFS, which stands for a file that is not here",
    help: "fetch the file: git lfs pull",
};
const HTML: Mistaken = Mistaken {
    what: "this is a web page (HTML), such as a server sends in place of a file",
    help: "download the file again, by a link to its raw content",
};
const XML: Mistaken = Mistaken {
    what: "this is XML: a message of a server, or a file of another format",
    help: "download the file again, or export it in the format that its name says",
};
const ARCHIVE: Mistaken = Mistaken { what: "this is an archive", help: "unpack it first" };
const PICTURE: Mistaken = Mistaken { what: "this is a picture", help: "name a file of the format that its name says" };

/// The first bytes of kinds of files that no readable format begins with.
const BEGINNINGS: [(&[u8], &Mistaken); 4] = [
    (b"\xff\xfe", &UTF_16),
    (b"\xfe\xff", &UTF_16),
    (b"version https://git-lfs.github.com/", &GIT_LFS),
    (b"version https://hawser.github.com/", &GIT_LFS),
];

/// How web pages begin.
const TAGS: [&[u8]; 4] = [b"<!doctype html", b"<html", b"<head", b"<body"];

/// The first bytes of files that may have been chosen on purpose, but in a format that is not read.
const BEGINNINGS_UNREAD: [(&[u8], &Mistaken); 7] = [
    (b"<?xml", &XML),
    (b"PK\x03\x04", &ARCHIVE),
    (b"\x1f\x8b", &ARCHIVE),
    (b"BZh", &ARCHIVE),
    (b"\xfd7zXZ", &ARCHIVE),
    (b"7z\xbc\xaf\x27\x1c", &ARCHIVE),
    (b"\x28\xb5\x2f\xfd", &ARCHIVE),
];

/// The first bytes of picture formats.
const PICTURES: [&[u8]; 13] = [
    b"\x89PNG",
    b"\xff\xd8\xff",
    b"GIF8",
    b"II*\0",
    b"II+\0",
    b"MM\0*",
    b"MM\0+",
    b"v/1\x01",
    b"#?R",
    b"qoif",
    b"P3",
    b"P6",
    b"PF",
];

/// The kind of file that begins so, if no scene and no mesh does.
pub(crate) fn recognise(beginning: &[u8]) -> Option<&'static Mistaken> {
    let text = beginning.strip_prefix(BYTE_ORDER_MARK.as_bytes()).unwrap_or(beginning).trim_ascii_start();
    let is_tag = |tag: &&[u8]| text.get(..tag.len()).is_some_and(|begins| begins.eq_ignore_ascii_case(tag));
    let known = find(&BEGINNINGS, beginning);
    known.or(TAGS.iter().any(is_tag).then_some(&HTML)).or(is_utf_16(beginning).then_some(&UTF_16))
}

/// As [`recognise`], and for a file which is to be a picture also formats of other content that are
/// not read.
pub(crate) fn recognise_no_picture(beginning: &[u8]) -> Option<&'static Mistaken> {
    recognise(beginning).or_else(|| find(&BEGINNINGS_UNREAD, beginning))
}

/// As [`recognise_no_picture`], also with pictures. Only for a file that could not be read, since
/// the title of a binary file may begin with any bytes.
pub(super) fn recognise_unread(beginning: &[u8]) -> Option<&'static Mistaken> {
    recognise_no_picture(beginning).or(is_picture(beginning).then_some(&PICTURE))
}

fn find(known: &[(&[u8], &'static Mistaken)], beginning: &[u8]) -> Option<&'static Mistaken> {
    known.iter().find(|(begins, _)| beginning.starts_with(begins)).map(|(_, mistaken)| *mistaken)
}

/// Whether a file begins as a picture. Only for a file that could not be read.
pub(super) fn is_picture(beginning: &[u8]) -> bool {
    PICTURES.iter().any(|begins| beginning.starts_with(begins))
}

/// Whether a text looks like UTF-16 without a byte order mark: every other byte is zero, and those
/// between are ASCII.
fn is_utf_16(beginning: &[u8]) -> bool {
    let units = &beginning.as_chunks::<2>().0;
    let units = &units[..units.len().min(BEGINNING / 2)];
    let is_text = |byte: u8| byte.is_ascii_graphic() || byte.is_ascii_whitespace();
    let all_are_text = |zero: usize| units.iter().all(|unit| unit[zero] == 0 && is_text(unit[1 - zero]));
    units.len() >= 4 && (all_are_text(0) || all_are_text(1))
}
