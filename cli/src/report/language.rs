//! The Spanish page: the English page with each text replaced by its translation in a table.

use std::cmp::Reverse;
use std::collections::HashMap;

use crate::essay::parts;
use crate::table::words;

/// The language of the page.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Language {
    #[default]
    En,
    Es,
}

/// The table: lines "English => Spanish". `{}` stands for any text, which is translated on its own.
const WORDS: &str = include_str!("words.es.txt");
/// The prose of the page. Parts and paragraphs are in the same order in both languages.
const ENGLISH: &str = include_str!("explanation.md");
const SPANISH: &str = include_str!("explanation.es.md");

/// Elements whose content is not translated: styles, listings, names of compilers, and figures, in
/// which sentences are broken into several texts.
const UNTRANSLATED: [&str; 4] = ["style", "pre", "dd", "svg"];

/// A translation with holes: the English text between the holes, and the Spanish text with `{}` for
/// each hole.
struct Template {
    pieces: Vec<&'static str>,
    spanish: &'static str,
}

struct Words {
    whole: HashMap<&'static str, &'static str>,
    templates: Vec<Template>,
}

/// The English page, translated to another language.
pub fn in_language(page: String, language: Language) -> String {
    match language {
        Language::En => page,
        Language::Es => Words::new().page(&page.replacen("<html lang=\"en\">", "<html lang=\"es\">", 1)),
    }
}

impl Words {
    fn new() -> Self {
        let mut words = Words { whole: HashMap::new(), templates: Vec::new() };
        for (english, spanish) in WORDS.lines().filter_map(|line| line.split_once(" => ")) {
            words.add(english, spanish);
        }
        for ((name, english), (spanish_name, spanish)) in parts(ENGLISH).zip(parts(SPANISH)) {
            assert_eq!(name, spanish_name, "both languages have the same parts");
            for (english, spanish) in english.trim().split("\n\n").zip(spanish.trim().split("\n\n")) {
                words.add(english, spanish);
            }
        }
        // If several templates match a text, the one with the most literal text wins.
        words.templates.sort_by_key(|template| Reverse(template.pieces.iter().map(|piece| piece.len()).sum::<usize>()));
        words
    }

    fn add(&mut self, english: &'static str, spanish: &'static str) {
        if english.contains("{}") {
            self.templates.push(Template { pieces: english.split("{}").collect(), spanish });
        } else {
            self.whole.insert(english, spanish);
        }
    }

    /// The page with every text in Spanish. A text is what is between two tags; `<code>` tags do
    /// not separate texts.
    fn page(&self, page: &str) -> String {
        let mut translated = String::with_capacity(page.len());
        let mut text = String::new();
        // The untranslated element that the current text is in, if any.
        let mut untranslated = None;
        for piece in page.split_inclusive('>') {
            let (before, tag) = piece.split_at(piece.rfind('<').unwrap_or(piece.len()));
            text += before;
            match tag {
                "<code>" | "</code>" if untranslated.is_none() => text.push('`'),
                _ => {
                    let text = std::mem::take(&mut text);
                    translated += &if untranslated.is_some() { text } else { self.text(&text) };
                    translated += &self.tag(tag);
                    let name = tag.trim_start_matches(['<', '/']).split([' ', '>']).next().unwrap_or_default();
                    if untranslated == Some(name) && tag.starts_with("</") {
                        untranslated = None;
                    } else if untranslated.is_none() && UNTRANSLATED.contains(&name) {
                        untranslated = Some(name);
                    }
                }
            }
        }
        translated + &text
    }

    /// A tag; if it has a description for screen readers, that is translated too.
    fn tag(&self, tag: &str) -> String {
        for attribute in [" aria-label=\"", " alt=\""] {
            if let Some((before, rest)) = tag.split_once(attribute)
                && let Some((value, after)) = rest.split_once('"')
            {
                return format!("{before}{attribute}{}\"{after}", self.text(value));
            }
        }
        tag.to_owned()
    }

    /// The Spanish HTML for a text of the page, in which code is between backticks.
    fn text(&self, text: &str) -> String {
        let plain = text.replace("&lt;", "<").replace("&gt;", ">").replace("&quot;", "\"").replace("&amp;", "&");
        let english = plain.trim();
        if english.is_empty() {
            return text.to_owned();
        }
        let (before, after) = plain.split_once(english).expect("it is a part");
        let spanish = format!("{before}{}{after}", with_commas(&self.translation(english)));
        words(&spanish).into_string()
    }

    /// The Spanish for a text: by an entry of the table for the whole text, by a template, or
    /// clause by clause. A text that the table lacks stays as it is.
    fn translation(&self, text: &str) -> String {
        if let Some(spanish) = self.whole.get(text) {
            return (*spanish).to_owned();
        }
        for template in &self.templates {
            if let Some(spanish) = template.fill(text, self) {
                return spanish;
            }
        }
        match text.split_once("; ") {
            Some((clause, rest)) => format!("{}; {}", self.translation(clause), self.translation(rest)),
            None => text.to_owned(),
        }
    }
}

impl Template {
    /// The Spanish text with its holes filled; None if `text` does not match the template.
    fn fill(&self, text: &str, words: &Words) -> Option<String> {
        let (first, last) = (self.pieces.first()?, self.pieces.last()?);
        let mut rest = text.strip_prefix(first)?.strip_suffix(last)?;
        let mut holes = Vec::new();
        for piece in &self.pieces[1..self.pieces.len() - 1] {
            let (hole, after) = rest.split_once(piece)?;
            holes.push(hole);
            rest = after;
        }
        holes.push(rest);
        // A hole may hold a single clause, or a longer text that the table has as a whole.
        let is_too_much = |hole: &&str| hole.contains("; ") && !words.whole.contains_key(hole);
        if holes.iter().any(is_too_much) {
            return None;
        }
        let mut spanish = String::new();
        let mut holes = holes.into_iter();
        for (index, piece) in self.spanish.split("{}").enumerate() {
            if index > 0 {
                spanish += &words.translation(holes.next()?);
            }
            spanish += piece;
        }
        Some(spanish)
    }
}

/// The text with numbers in Spanish notation, outside of code: "4,5 [4,1; 4,9]" for "4.5 [4.1,
/// 4.9]", and "1 000" for "1,000".
fn with_commas(text: &str) -> String {
    let characters: Vec<char> = text.chars().collect();
    let is_digit = |index: usize| characters.get(index).is_some_and(char::is_ascii_digit);
    let mut is_code = false;
    let mut in_brackets = false;
    let mut spanish = String::with_capacity(text.len());
    for (index, character) in characters.iter().enumerate() {
        is_code ^= *character == '`';
        in_brackets = (in_brackets || *character == '[') && *character != ']';
        let follows_digit = index > 0 && is_digit(index - 1);
        spanish.push(match character {
            '.' if !is_code && follows_digit && is_digit(index + 1) => ',',
            ',' if follows_digit && is_digit(index + 1) => ' ',
            ',' if in_brackets && follows_digit => ';',
            other => *other,
        });
    }
    spanish
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_commas_outside_of_code() {
        assert_eq!(with_commas("4.5 [4.1, 4.9], 1,234 and `-O1.5`."), "4,5 [4,1; 4,9], 1 234 and `-O1.5`.");
    }

    #[test]
    fn holes_keep_their_order_and_are_said_too() {
        let mut words = Words { whole: HashMap::new(), templates: Vec::new() };
        words.add("{} of {} rungs", "{} de {} peldaños");
        words.add("all", "todos");
        words.add("a `b` & c", "una `b` y c");
        assert_eq!(words.page("<p>all of 10 rungs</p>"), "<p>todos de 10 peldaños</p>");
        assert_eq!(words.page("<p>a <code>b</code> &amp; c; all</p>"), "<p>una <code>b</code> y c; todos</p>");
        assert_eq!(words.page("<pre>all</pre><td>all</td>"), "<pre>all</pre><td>todos</td>");
        assert_eq!(words.page("<i alt=\"all\">x</i>"), "<i alt=\"todos\">x</i>");
    }

    #[test]
    fn both_languages_have_the_same_parts() {
        let names =
            |prose| parts(prose).map(|(name, text)| (name, text.trim().split("\n\n").count())).collect::<Vec<_>>();
        assert_eq!(names(ENGLISH), names(SPANISH));
    }
}
