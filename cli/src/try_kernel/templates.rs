//! What `rayo try --template` prints: for every operation and language a start that passes.

use clap::ValueEnum;

use rayo_lab::experiments::bring::wanted::{Type, Wanted};

/// What a template is written in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Language {
    Asm,
    C,
    Rust,
    Macro,
}

impl Language {
    /// The head of all templates and then the function of each operation, in sections that begin
    /// with `== ` and a name.
    fn sections(self) -> &'static str {
        match self {
            Language::Asm => include_str!("templates/asm.txt"),
            Language::C => include_str!("templates/c.txt"),
            Language::Rust => include_str!("templates/rust.txt"),
            Language::Macro => include_str!("templates/macro.txt"),
        }
    }

    fn extension(self) -> &'static str {
        match self {
            Language::Asm | Language::Macro => "asm",
            Language::C => "c",
            Language::Rust => "rs",
        }
    }
}

/// What each operation computes.
const FORMULAS: [(&str, &str); 11] = [
    ("add", "a + b in each lane"),
    ("sub", "a - b in each lane"),
    ("scale", "a times the scalar b in each lane"),
    ("dot", "a . b"),
    ("norm", "the length of a; there is no b"),
    ("cross", "a x b"),
    ("normalise", "a divided by its length; there is no b"),
    ("sphere", "the least t > 0 at which t a is on the sphere b, infinity for none"),
    ("triangle", "the t > 0 at which t a is in the triangle b, infinity for none"),
    ("lambert", "the light that b adds to the surface a on the side of its normal"),
    ("lambert2", "the light that b adds to the surface a, which has two sides"),
];

/// The paper's tracer, which the template of one in assembly is.
const TRACER: &str = include_str!("../../../asm/tracers/paper.asm");

/// The template of an operation; None if there is no such operation.
pub fn of(language: Language, op: &str) -> Option<String> {
    if op == "trace" {
        let text = section(language, "trace")?;
        // It is in the paper's file as a macro, which a user may change as it stands.
        return Some(text.replace("{tracer}", TRACER));
    }
    let (_, formula) = FORMULAS.iter().find(|(known, _)| *known == op)?;
    let Wanted { takes, gives, .. } = Wanted::operation(op)?;
    let name = |kind: Type| if kind == Type::F32 { "float".to_owned() } else { format!("{kind:?}") };
    let arguments: Vec<_> =
        takes.iter().zip(["a", "b"]).map(|(kind, argument)| format!("const {} *{argument}", name(*kind))).collect();
    let signature = format!("void {op}({} *out, {})", name(gives), arguments.join(", "));
    let text = section(language, "head")? + &section(language, op)?;
    let filled = text
        .replace("{op}", op)
        .replace("{file}", &format!("{op}.{}", language.extension()))
        .replace("{formula}", formula)
        .replace("{signature}", &signature);
    Some(filled)
}

/// A section of a language's texts: the lines after its head, up to that of the next.
fn section(language: Language, name: &str) -> Option<String> {
    let head = format!("== {name}");
    let lines = language.sections().lines().skip_while(|line| *line != head).skip(1);
    let text: String = lines.take_while(|line| !line.starts_with("== ")).map(|line| format!("{line}\n")).collect();
    (!text.is_empty()).then_some(text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rayo::internals::kernels::ALL_OPERATIONS;

    #[test]
    fn every_operation_has_a_template_in_every_language() {
        for language in Language::value_variants() {
            for op in ALL_OPERATIONS.into_iter().chain(["trace"]) {
                let text = of(*language, op).unwrap_or_else(|| panic!("{language:?} {op}"));
                assert!(text.contains(op) && !text.contains("{op}") && !text.contains("{tracer}"), "{text}");
            }
            assert_eq!(of(*language, "head"), None);
        }
    }
}
