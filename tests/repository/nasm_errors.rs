//! What the build tells of a mistake in a macro, of all that NASM writes about it.

#[path = "../../build/nasm_error.rs"]
mod nasm_error;

use nasm_error::first_error;

/// As NASM 2.16 writes it: an error for each use of the macro, and what follows from it.
const MESSAGES: &str = "\
asm/sse41.asm:16: warning: something that is no error [-w+other]
asm/sse41.asm:16: error: parser: instruction expected
asm/ops/aos.asm:80: ... from macro `AOS_OPS' defined here
asm/include/vec3_aos.inc:110: ... from macro `VEC_DOT' defined here
asm/include/vec3_aos.inc:129: ... from macro `VEC_SUM' defined here
asm/sse41.asm:16: error: label `hadps' inconsistently redefined
asm/ops/aos.asm:80: ... from macro `AOS_OPS' defined here
asm/sse41.asm:16: info: label `hadps' originally defined here
asm/sse41.asm:17: fatal: unable to open include file `x.inc'
";

fn line_of(file: &str, number: usize) -> Option<String> {
    (file == "asm/include/vec3_aos.inc" && number == 129).then(|| "    hadps   %%d, %%d".into())
}

#[test]
fn a_mistake_in_a_macro_is_told_once_with_its_line() {
    let told = first_error(MESSAGES, line_of).unwrap();
    let expected = [
        "asm/include/vec3_aos.inc:129: parser: instruction expected",
        "    hadps   %%d, %%d",
        "in the macro VEC_SUM, used at asm/include/vec3_aos.inc:110",
        "in the macro VEC_DOT, used at asm/ops/aos.asm:80",
        "in the macro AOS_OPS, used at asm/sse41.asm:16",
        "NASM reports 2 more, of which most follow from this one",
    ];
    assert_eq!(told, expected);
}

#[test]
fn a_mistake_outside_of_macros_is_told_by_its_own_line() {
    let told = first_error("C:\\a b\\sse41.asm:3: fatal: unable to open include file `x.inc'\n", |_, _| None);
    assert_eq!(told.unwrap(), ["C:\\a b\\sse41.asm:3: unable to open include file `x.inc'"]);
    let told = first_error("asm/a.asm:12: error: symbol `x' not defined\n", |_, _| Some("  jmp x".into()));
    assert_eq!(told.unwrap(), ["asm/a.asm:12: symbol `x' not defined", "    jmp x"]);
}

#[test]
fn messages_without_an_error_are_none() {
    assert_eq!(first_error("asm/a.asm:1: warning: label alone on a line\nnasm: killed\n", |_, _| None), None);
    assert_eq!(first_error("", |_, _| None), None);
}
