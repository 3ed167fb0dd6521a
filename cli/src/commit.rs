//! The commit that the program was built from.

/// The reflog of HEAD, whose last line names the commit that is checked out; None if the program
/// was not built in a repository.
const LOG: Option<&[u8]> = include!(concat!(env!("OUT_DIR"), "/log.rs"));

/// The first digits of the current commit's hash. Each line of the reflog begins with the hash of
/// the previous commit, a space, and the hash of the new one.
static COMMIT: Option<[u8; 12]> = match LOG {
    Some(log) => commit(log),
    None => None,
};

const fn commit(log: &[u8]) -> Option<[u8; 12]> {
    let mut begin = log.len().saturating_sub(1);
    while begin > 0 && log[begin - 1] != b'\n' {
        begin -= 1;
    }
    while begin < log.len() && log[begin] != b' ' {
        begin += 1;
    }
    match log.split_at(begin).1 {
        [b' ', rest @ ..] => rest.first_chunk().copied(),
        _ => None,
    }
}

/// The first digits of the commit's hash; None if the program was not built in a repository.
pub fn name() -> Option<&'static str> {
    std::str::from_utf8(COMMIT.as_ref()?).ok()
}
