//! What `rayo try --template` prints: for every operation and language a start that passes.

use clap::ValueEnum;

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

/// An operation, what it computes, and the types of its result and arguments.
struct Operation {
    name: &'static str,
    formula: &'static str,
    types: [&'static str; 3],
}

const OPERATIONS: [Operation; 11] = [
    Operation { name: "add", formula: "a + b in each lane", types: ["Vec4", "Vec4", "Vec4"] },
    Operation { name: "sub", formula: "a - b in each lane", types: ["Vec4", "Vec4", "Vec4"] },
    Operation { name: "scale", formula: "a times the scalar b in each lane", types: ["Vec4", "Vec4", "float"] },
    Operation { name: "dot", formula: "a . b", types: ["float", "Vec4", "Vec4"] },
    Operation { name: "norm", formula: "the length of a; there is no b", types: ["float", "Vec4", ""] },
    Operation { name: "cross", formula: "a x b", types: ["Vec4", "Vec4", "Vec4"] },
    Operation { name: "normalise", formula: "a divided by its length; there is no b", types: ["Vec4", "Vec4", ""] },
    Operation {
        name: "sphere",
        formula: "the least t > 0 at which t a is on the sphere b, infinity for none",
        types: ["float", "Vec4", "Sphere"],
    },
    Operation {
        name: "triangle",
        formula: "the t > 0 at which t a is in the triangle b, infinity for none",
        types: ["float", "Vec4", "Triangle"],
    },
    Operation {
        name: "lambert",
        formula: "the light that b adds to the surface a on the side of its normal",
        types: ["Vec4", "Surface", "Light"],
    },
    Operation {
        name: "lambert2",
        formula: "the light that b adds to the surface a, which has two sides",
        types: ["Vec4", "Surface", "Light"],
    },
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
    let operation = OPERATIONS.iter().find(|known| known.name == op)?;
    let [out, a, b] = operation.types;
    let pointer = |kind: &str, name: &str| format!("const {kind} *{name}");
    let arguments: Vec<_> = [(a, "a"), (b, "b")]
        .iter()
        .filter(|(kind, _)| !kind.is_empty())
        .map(|(kind, name)| pointer(kind, name))
        .collect();
    let signature = format!("void {op}({out} *out, {})", arguments.join(", "));
    let text = section(language, "head")? + &section(language, op)?;
    let filled = text
        .replace("{op}", op)
        .replace("{file}", &format!("{op}.{}", language.extension()))
        .replace("{formula}", operation.formula)
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
