//! The prose of the pages that commands write: parts of Markdown files beside the code, and figures
//! put into them.

use rayo::internals::render::Engine;

/// What begins a part: this, its name, and the end of the comment.
const BEGIN: &str = "<!-- part: ";
const END: &str = " -->\n";

/// The part of that name, up to the next one.
///
/// # Panics
/// If there is none.
pub(super) fn part(prose: &'static str, name: &str) -> &'static str {
    parts(prose).find_map(|(of, text)| (of == name).then_some(text)).unwrap_or_else(|| panic!("no part `{name}`"))
}

/// All parts: their names, and their texts.
pub(super) fn parts(prose: &'static str) -> impl Iterator<Item = (&'static str, &'static str)> {
    prose.split(BEGIN).filter_map(|part| part.split_once(END))
}

/// The engines that this machine does not run, where there are any.
pub(super) fn absent_engines() -> Option<String> {
    let absent = Engine::ALL.iter().filter(|engine| !engine.usable()).map(|engine| engine.name());
    Some(absent.collect::<Vec<_>>().join(" and ")).filter(|absent| !absent.is_empty())
}

/// The prose of what only assembly has, with a figure in place of each `{what it is}`.
pub(super) fn filled(prose: &str, figure: impl Fn(&str) -> String) -> String {
    let mut pieces = prose.split('{');
    let mut text = pieces.next().unwrap_or_default().to_owned();
    for piece in pieces {
        let (what, rest) = piece.split_once('}').expect("a figure's name ends");
        text += &figure(what);
        text += rest;
    }
    text
}

#[cfg(test)]
mod tests {
    #[test]
    fn figures_go_in_place_of_what_they_are() {
        assert_eq!(super::filled("A {b} {c d}.", |what| what.repeat(2)), "A bb c dc d.");
    }
}
