//! The prose of generated pages: named parts of Markdown files, with placeholders for figures.

use rayo::internals::render::Engine;

/// A part begins with a comment: `BEGIN`, its name, and `END`.
const BEGIN: &str = "<!-- part: ";
const END: &str = " -->\n";

/// The part with this name: its text up to the next part.
///
/// # Panics
/// If there is no such part.
pub(super) fn part(prose: &'static str, name: &str) -> &'static str {
    parts(prose).find_map(|(of, text)| (of == name).then_some(text)).unwrap_or_else(|| panic!("no part `{name}`"))
}

/// The names and texts of all parts.
pub(super) fn parts(prose: &'static str) -> impl Iterator<Item = (&'static str, &'static str)> {
    prose.split(BEGIN).filter_map(|part| part.split_once(END))
}

/// The names of the engines that this machine cannot run; None if it can run all.
pub(super) fn absent_engines() -> Option<String> {
    let absent = Engine::ALL.iter().filter(|engine| !engine.usable()).map(|engine| engine.name());
    Some(absent.collect::<Vec<_>>().join(" and ")).filter(|absent| !absent.is_empty())
}

/// The prose with each placeholder `{name}` replaced by the figure that `figure` returns for the
/// name.
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
