//! The disassembled kernels: checks of their instructions, symbols and constants, and of the
//! instruction counts in the macros' comments.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::ops::Range;
use std::path::Path;
use std::process::Command;

use iced_x86::CpuidFeature::{
    AVX, AVX2, AVX512BW, AVX512DQ, AVX512F, AVX512VL, BMI1, BMI2, FMA, POPCNT, SSE3, SSE4_1, SSSE3,
};
use iced_x86::{Code, CpuidFeature, Decoder, DecoderOptions, EncodingKind, FlowControl, Instruction, Mnemonic};
use object::{Object, ObjectSection, ObjectSymbol, RelocationKind, RelocationTarget, SectionFlags, SymbolFlags, elf};
use rayo::internals::kernels::harness::{BROKEN, BROKEN_DOTS};
use rayo::internals::kernels::{self, OBJECTS};

/// What the code of a unit of kernels may contain.
struct Unit {
    name: &'static str,
    /// The CPU features that it may use beyond x86-64's baseline: those that `Isa::usable` checks.
    features: &'static [CpuidFeature],
    /// Whether all of its vector instructions must be VEX or EVEX encoded; otherwise none may be.
    vex: bool,
}

/// The units of asm/ with kernels that engines call.
const UNITS: [Unit; 3] = [
    Unit { name: "sse41", features: &[SSE3, SSSE3, SSE4_1], vex: false },
    Unit { name: "avx2", features: &[AVX, AVX2, FMA], vex: true },
    // A CPU with AVX-512 has all of AVX2, FMA, BMI1, BMI2 and POPCNT.
    Unit {
        name: "avx512",
        features: &[AVX, AVX2, FMA, BMI1, BMI2, POPCNT, AVX512F, AVX512VL, AVX512DQ, AVX512BW],
        vex: true,
    },
];

/// The unit of the checked call and of the broken kernels. It has instructions of every vector
/// width.
const HARNESS: &str = "checked";

/// Objects that exist only to be counted or timed and that no engine calls;
/// cli/tests/commands/ops.rs tests them.
const MEASURED: [&str; 7] = ["known", "chains", "O0", "O1", "O2", "O3", "native"];

/// The implementations whose symbols are named rayo_<name>_<operation>.
const IMPLEMENTATIONS: [&str; 3] = ["c", "paper", "aos"];

/// The only kernel that calls other functions: the experiment's tracer, whose operations are called
/// instead of expanded inline.
const CALLS: &str = "rayo_calls_trace";
/// The section with these operations.
const CALLED: &str = ".text.called";

/// The features of the x86-64 baseline. endbr64 (CET_IBT) counts too, as it is a nop on other CPUs.
const BASELINE: [CpuidFeature; 10] = [
    CpuidFeature::INTEL8086,
    CpuidFeature::INTEL186,
    CpuidFeature::INTEL386,
    CpuidFeature::INTEL486,
    CpuidFeature::X64,
    CpuidFeature::CMOV,
    CpuidFeature::MULTIBYTENOP,
    CpuidFeature::SSE,
    CpuidFeature::SSE2,
    CpuidFeature::CET_IBT,
];

/// A unit's machine code and its symbols.
struct Code64<'a> {
    file: object::File<'a>,
}

/// An exported function and its instructions.
struct Function {
    name: String,
    addresses: Range<u64>,
    instructions: Vec<Instruction>,
}

impl<'a> Code64<'a> {
    fn of(unit: &str) -> Code64<'static> {
        let (_, bytes) = OBJECTS.iter().find(|(name, _)| *name == unit).expect("an object of that name");
        Code64::new(bytes)
    }

    fn new(bytes: &'a [u8]) -> Self {
        Code64 { file: object::File::parse(bytes).expect("an object file") }
    }

    /// The instructions between two addresses of .text.
    fn decode(&self, addresses: Range<u64>) -> Vec<Instruction> {
        let text = self.file.section_by_name(".text").expect("code").data().unwrap();
        let bytes = &text[addresses.start as usize..addresses.end as usize];
        Decoder::with_ip(64, bytes, addresses.start, DecoderOptions::NONE).into_iter().collect()
    }

    /// The names of the exported symbols.
    fn exported(&self) -> Vec<&str> {
        let exported = self.file.symbols().filter(|symbol| symbol.is_global() && !symbol.is_undefined());
        exported.map(|symbol| symbol.name().unwrap()).collect()
    }

    /// The exported functions of a NASM object, in the order of their addresses.
    fn functions(&self) -> Vec<Function> {
        let functions = self.exported().into_iter().map(|name| {
            let symbol = self.file.symbol_by_name(name).unwrap();
            let addresses = symbol.address()..symbol.address() + symbol.size();
            let instructions = self.decode(addresses.clone());
            Function { name: name.to_owned(), addresses, instructions }
        });
        let mut functions: Vec<_> = functions.collect();
        functions.sort_by_key(|function| function.addresses.start);
        functions
    }

    fn address(&self, label: &str) -> u64 {
        let symbol = self.file.symbol_by_name(label);
        symbol.unwrap_or_else(|| panic!("there is no label {label}")).address()
    }

    /// The instructions between the labels .body and .body_end of a function.
    fn body(&self, function: &str) -> Vec<Instruction> {
        let label = |label| self.address(&format!(".L{function}.{label}"));
        self.decode(label("body")..label("body_end"))
    }
}

fn is_vex(instruction: &Instruction) -> bool {
    instruction.encoding() != EncodingKind::Legacy
}

/// The instructions that need other features than `unit.features`, or that have the wrong encoding.
fn foreign(unit: &Unit, functions: &[Function]) -> Vec<String> {
    let allowed = |feature: &CpuidFeature| BASELINE.contains(feature) || unit.features.contains(feature);
    let mut found = Vec::new();
    for function in functions {
        for instruction in &function.instructions {
            let vector = (0..instruction.op_count()).any(|i| instruction.op_register(i).is_vector_register());
            if instruction.is_invalid()
                || !instruction.cpuid_features().iter().all(allowed)
                || vector && is_vex(instruction) != unit.vex
            {
                found.push(format!("{}: {instruction}", function.name));
            }
        }
    }
    found
}

/// The number of returns that no vzeroupper precedes, although VEX or EVEX encoded vector
/// instructions do.
fn returns_with_dirty_registers(function: &Function) -> usize {
    let mut returns = 0;
    let mut dirty = false;
    for instruction in &function.instructions {
        match instruction.mnemonic() {
            Mnemonic::Vzeroupper | Mnemonic::Vzeroall => dirty = false,
            Mnemonic::Ret => {
                returns += usize::from(dirty);
                // What follows a jump or return may be reached from anywhere before.
                dirty = function.instructions.iter().any(is_vex);
            }
            _ => dirty |= is_vex(instruction),
        }
    }
    returns
}

#[test]
fn every_object_is_under_test() {
    let mut known: BTreeSet<_> = UNITS.iter().map(|unit| unit.name).collect();
    known.extend([HARNESS, "trace", "ops", "hits"]);
    known.extend(MEASURED);
    known.extend(["alone_sse41", "alone_avx2", "alone_avx512"]);
    assert_eq!(OBJECTS.iter().map(|(name, _)| *name).collect::<BTreeSet<_>>(), known);
}

#[test]
fn no_object_names_the_folder_of_its_sources() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/..").as_bytes();
    for (name, bytes) in OBJECTS {
        assert!(!bytes.windows(folder.len()).any(|window| window == folder), "{name} names it");
    }
}

#[test]
fn no_unit_has_an_instruction_above_its_instruction_set() {
    for unit in &UNITS {
        let none: Vec<String> = Vec::new();
        assert_eq!(foreign(unit, &Code64::of(unit.name).functions()), none, "{}", unit.name);
    }
    let harness = Code64::of(HARNESS).functions();
    let upper: Vec<_> = harness.into_iter().filter(|function| function.name == "rayo_broken_upper").collect();
    assert_eq!(foreign(&UNITS[0], &upper).len(), 1, "AVX would be noticed");
}

#[test]
fn returns_of_vex_units_come_after_vzeroupper() {
    for unit in &UNITS {
        for function in Code64::of(unit.name).functions() {
            assert_eq!(returns_with_dirty_registers(&function), 0, "{}", function.name);
        }
    }
    for function in Code64::of(HARNESS).functions() {
        let expected = usize::from(function.name == "rayo_broken_upper");
        assert_eq!(returns_with_dirty_registers(&function), expected, "{}", function.name);
    }
}

#[test]
fn kernels_begin_with_endbr64_and_are_aligned_and_hidden() {
    for unit in UNITS.iter().map(|unit| unit.name).chain([HARNESS]) {
        let code = Code64::of(unit);
        for symbol in code.file.symbols().filter(|symbol| symbol.is_global()) {
            let name = symbol.name().unwrap();
            assert!(name.starts_with("rayo_"), "{unit}: {name}");
            assert!(symbol.size() > 0, "{unit}: {name} has no size");
            assert_eq!(symbol.kind(), object::SymbolKind::Text, "{unit}: {name}");
            assert_eq!(symbol.address() % 32, 0, "{unit}: {name}");
            let SymbolFlags::Elf { st_other, .. } = symbol.flags() else { panic!("not ELF") };
            assert_eq!(st_other.visibility(), elf::STV_HIDDEN, "{unit}: {name} is visible to other libraries");
        }
        for function in code.functions() {
            let [first, .., last] = &function.instructions[..] else { panic!("{} is too short", function.name) };
            assert_eq!(first.code(), Code::Endbr64, "{}", function.name);
            let leaves = [FlowControl::Return, FlowControl::UnconditionalBranch].contains(&last.flow_control());
            assert!(leaves, "{} falls off its end: {last}", function.name);
            assert_eq!(last.next_ip(), function.addresses.end, "{}", function.name);
        }
    }
}

#[test]
fn kernels_are_leaves_and_jump_only_within_themselves() {
    for unit in &UNITS {
        for function in Code64::of(unit.name).functions() {
            for instruction in &function.instructions {
                let inside = function.addresses.contains(&instruction.near_branch_target());
                let fine = match instruction.flow_control() {
                    FlowControl::Next | FlowControl::Return => true,
                    FlowControl::ConditionalBranch | FlowControl::UnconditionalBranch => inside,
                    FlowControl::Call => function.name == CALLS,
                    _ => false,
                };
                assert!(fine, "{}: {instruction}", function.name);
            }
        }
    }
}

#[test]
fn no_code_lies_between_the_kernels_but_padding() {
    for unit in UNITS.iter().map(|unit| unit.name).chain([HARNESS]) {
        let code = Code64::of(unit);
        let mut end = 0;
        for function in code.functions() {
            let gap = code.decode(end..function.addresses.start);
            assert!(gap.iter().all(|i| i.mnemonic() == Mnemonic::Nop), "{unit}: code before {}", function.name);
            end = function.addresses.end;
        }
        assert_eq!(end, code.file.section_by_name(".text").unwrap().size(), "{unit}: code after the last function");
    }
}

#[test]
fn units_are_position_independent_without_executable_stack() {
    for unit in UNITS.iter().map(|unit| unit.name).chain([HARNESS]) {
        let code = Code64::of(unit);
        for section in code.file.sections() {
            let name = section.name().unwrap();
            for (offset, relocation) in section.relocations() {
                assert_eq!(relocation.kind(), RelocationKind::Relative, "{unit}: {name}+{offset:#x}");
            }
        }
        let note = code.file.section_by_name(".note.GNU-stack").expect("the note about the stack");
        let SectionFlags::Elf { sh_flags, .. } = note.flags() else { panic!("not ELF") };
        assert_eq!(sh_flags & elf::SHF_EXECINSTR, elf::SectionFlags(0), "{unit}");
    }
}

#[test]
fn constants_are_read_only_and_aligned() {
    for unit in &UNITS {
        let code = Code64::of(unit.name);
        let rodata = code.file.section_by_name(".rodata").expect("constants");
        assert_eq!(rodata.align(), 64, "{}", unit.name);
        let text = code.file.section_by_name(".text").unwrap();
        let instructions: Vec<_> = code.functions().into_iter().flat_map(|function| function.instructions).collect();
        let mut read = 0;
        for (offset, relocation) in text.relocations() {
            let instruction = instructions
                .iter()
                .find(|i| (i.ip()..i.next_ip()).contains(&offset))
                .expect("an instruction that the relocation is in");
            let (section, base) = match relocation.target() {
                RelocationTarget::Symbol(index) => {
                    let symbol = code.file.symbol_by_index(index).unwrap();
                    (symbol.section_index().expect("a constant of this unit"), symbol.address())
                }
                target => panic!("{}: {instruction} needs {target:?}", unit.name),
            };
            if instruction.flow_control() == FlowControl::Call {
                let called = code.file.section_by_name(CALLED).expect("what is called");
                assert_eq!(section, called.index(), "{}: {instruction}", unit.name);
                continue;
            }
            assert_eq!(section, rodata.index(), "{}: {instruction}", unit.name);
            // rip-relative addressing adds the displacement to the address of the next instruction,
            // but the relocation is relative to the address of the displacement.
            let rest = instruction.next_ip() - offset;
            let address = base.wrapping_add_signed(relocation.addend()).wrapping_add(rest);
            // `lea` takes the address of a record, whose elements are then read.
            let taken = instruction.mnemonic() == Mnemonic::Lea;
            let size = if taken { 4 } else { instruction.memory_size().size() as u64 };
            assert!(size > 0 && address + size <= rodata.size(), "{}: {instruction} at {address}", unit.name);
            assert_eq!(address % size, 0, "{}: {instruction} reads {size} bytes at {address}", unit.name);
            read += 1;
        }
        assert!(read > 0, "{} reads no constant", unit.name);
    }
}

#[test]
fn kernels_of_the_list_are_the_symbols_of_the_objects() {
    let mut expected = BTreeSet::from(
        ["rayo_checked_call", "rayo_checked_crashed", "rayo_checked_home", CALLS, "rayo_c_hits", "rayo_paper_hits"]
            .map(str::to_owned),
    );
    expected.extend(BROKEN_DOTS.iter().map(|broken| broken.symbol().to_owned()));
    let rules = BROKEN.iter().map(|broken| format!("{:?}", broken.breaks).to_lowercase());
    expected.extend(rules.map(|rule| format!("rayo_broken_{rule}")));
    for implementation in IMPLEMENTATIONS {
        let ops = kernels::c().unwrap().ops().map(|(name, _)| name);
        expected.extend(ops.chain(["trace"]).map(|name| format!("rayo_{implementation}_{name}")));
    }
    expected.extend(kernels::packet_symbols().into_iter().map(str::to_owned));
    expected.extend(kernels::packet_op_symbols().map(str::to_owned));
    expected.extend(kernels::lane_symbols().map(str::to_owned));
    expected.extend(kernels::alone().map(|macros| macros.symbol().to_owned()));
    // Each operation in f32 has two chains, which are timed.
    for symbol in kernels::packet_op_symbols().filter(|symbol| symbol.contains("_single_")) {
        expected.extend(["latency", "throughput"].map(|chain| format!("{symbol}_{chain}")));
    }
    for unit in &UNITS {
        expected.extend(
            ["feedback_latency", "muladd_throughput"].map(|chain| format!("rayo_{}_single_{chain}", unit.name)),
        );
    }
    let mut found = BTreeSet::new();
    for (unit, _) in OBJECTS.iter().filter(|(unit, _)| !MEASURED.contains(unit)) {
        for name in Code64::of(unit).exported() {
            assert!(found.insert(name.to_owned()), "{name} is there twice");
        }
    }
    let difference: Vec<_> = found.symmetric_difference(&expected).collect();
    assert!(difference.is_empty(), "in the objects or in the list alone: {difference:?}");
}

/// The key of a documented number of instructions: `(macro, form, circumstances)`. The form is
/// empty if the number holds for all forms, and the circumstances are empty for the usual ones.
type Count = (String, String, String);

/// The macros of asm/include: name, number of parameters, and the comment lines above.
fn macros() -> Vec<(String, usize, Vec<String>)> {
    let mut macros = Vec::new();
    for entry in fs::read_dir(asm().join("include")).unwrap() {
        let text = fs::read_to_string(entry.unwrap().path()).unwrap();
        let mut comment = Vec::new();
        for line in text.lines() {
            if let Some(head) = line.strip_prefix("%macro ") {
                let (name, parameters) = head.split_once(' ').unwrap();
                let parameters = parameters.trim().trim_end_matches('+').parse().unwrap();
                macros.push((name.to_owned(), parameters, std::mem::take(&mut comment)));
            } else if line.starts_with(';') {
                comment.push(line.to_owned());
            } else {
                comment.clear();
            }
        }
    }
    macros
}

/// The numbers of instructions in the comments above the macros of asm/include.
///
/// The word `instructions` is followed by forms, separated by two spaces or line ends. Each is
/// `<name>[, <name>...] <number>[, <number> <circumstances>...] [(<details>)]`; the name is missing
/// if the number holds for all forms.
fn documented() -> BTreeMap<Count, usize> {
    let mut counts = BTreeMap::new();
    for (name, _, comment) in macros() {
        let from = comment.iter().position(|line| line.starts_with(";   instructions "));
        let from = from.unwrap_or_else(|| panic!("the comment of {name} does not count its instructions"));
        let first = comment[from].replacen("instructions", "", 1);
        let more = comment[from + 1..].iter().take_while(|line| line.starts_with(";                  "));
        for line in [&first].into_iter().chain(more) {
            for (form, of, count) in counts_of_line(line.trim_start_matches(';')) {
                let before = counts.insert((name.clone(), form, of), count);
                assert_eq!(before, None, "{name} is counted twice");
            }
        }
    }
    counts
}

/// The forms, circumstances and numbers in one line; see [`documented`].
fn counts_of_line(line: &str) -> Vec<(String, String, usize)> {
    let mut plain = String::new();
    let mut depth = 0;
    for c in line.chars() {
        depth += i32::from(c == '(');
        if depth == 0 {
            plain.push(c);
        }
        depth -= i32::from(c == ')');
    }
    assert_eq!(depth, 0, "an open parenthesis: {line}");
    let mut counts = Vec::new();
    for part in plain.split("  ").map(str::trim).filter(|part| !part.is_empty()) {
        // A form's name may contain digits: the first word that is a number begins the counts.
        let mut words = part.split_inclusive(' ').scan(0, |at, word| {
            *at += word.len();
            Some((*at - word.len(), word))
        });
        let number = words.find(|(_, word)| word.trim_end_matches([' ', ',']).parse::<usize>().is_ok());
        let (start, _) = number.unwrap_or_else(|| panic!("no number in `{part}`"));
        let (forms, numbers) = part.split_at(start);
        for number in numbers.split(", ") {
            let (count, of) = number.split_once(' ').unwrap_or((number, ""));
            let count = count.parse().unwrap_or_else(|_| panic!("not a number in `{part}`"));
            for form in forms.trim().split(", ") {
                counts.push((form.to_owned(), of.to_owned(), count));
            }
        }
    }
    counts
}

fn asm() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../asm"))
}

/// The forms of the paper's macros, and the implementations built from them.
const FORMS: [(&str, &str); 2] = [("paper", "paper"), ("best", "aos")];

/// Macros that an operation of asm/ops consists of: the macro, the operation, and the circumstances
/// whose count the whole operation gives.
const OPERATIONS: &[(&str, &str, &str)] = &[
    ("VEC_ADD", "add", ""),
    ("VEC_SUB", "sub", ""),
    ("VEC_SCALE", "scale", ""),
    ("VEC_DOT", "dot", ""),
    ("VEC_NORM", "norm", ""),
    ("VEC_CROSS", "cross", ""),
    ("VEC_NORMALISE", "normalise", ""),
    ("SPHERE_HIT", "sphere", ""),
    ("TRIANGLE_HIT", "triangle", ""),
    ("LAMBERT", "lambert", ""),
    ("LAMBERT", "lambert2", "with two sides"),
];

/// The other macros of the paper's engine, counted in functions that consist of one use.
const AOS_SNIPPETS: [Row; 4] = [
    ("VEC_SUM", "", "xmm0, xmm1"),
    ("PLANE_NORMAL", "", "xmm0, rdx, xmm1, xmm2, xmm3, xmm4"),
    ("SAME_SIDE", "", "[rdx], [rdx + 16], [rdx + 32], xmm0, .body_end, xmm1, xmm2, xmm3, xmm4, xmm5, xmm6, xmm7"),
    ("OPERATION END_OPERATION", "", ""),
];

/// A macro, the circumstances of a use (empty for the usual ones), and its operands.
type Row = (&'static str, &'static str, &'static str);
/// The same, with owned strings.
type Snippet = (String, &'static str, String);

/// The circumstances of a count that depends on a number of constants: by how much one more
/// constant raises it.
const EACH: &str = "more for each constant";

/// The circumstances in which ESTIMATE is 1.
const ESTIMATES: &str = "with estimates";

/// The macros of packets, in every circumstance that may change the number of instructions. Macros
/// that are not in the table are used in one way, with a register of its own for each parameter.
const PACKET_SNIPPETS: [Row; 101] = [
    ("ELEMENT", "", "ELEM"),
    ("CONSTANTS", "", "0"),
    ("LEVELS GREY_RGBA8", "", "0"),
    ("CONSTANTS", EACH, "1"),
    ("KLOAD", "", "v0, 0"),
    ("VOP", "", "sqrt, v0, v1"),
    ("VMOV", "", "v0, v1"),
    ("VMOV", "where they are the same register", "v0, v0"),
    ("VARITH", "", "add, 1, v0, v0, v1"),
    ("VARITH", "where d is b", "add, 1, v0, v1, v0"),
    ("VARITH", "where d is neither a nor b", "add, 1, v0, v1, v2"),
    ("VADD VMUL VSUB VDIV VMIN VMAX VAND VXOR", "", "v0, v0, v1"),
    ("VADD VMUL", "where d is b", "v0, v1, v0"),
    ("VADD VMUL VAND VXOR", "where d is neither a nor b", "v0, v1, v2"),
    ("VSUB VDIV VMIN VMAX", "where d is not a", "v0, v1, v2"),
    ("VFMA VFNMA", "", "v0, v1, v2, v3"),
    ("VFMA VFNMA", "where t is a", "v0, v1, v2, v1"),
    ("VFMSUB MASK_AND_LESS", "", "v0, K(0), v1"),
    ("VFMADD", "", "v0, v1, K(0)"),
    ("VDIFFERENCE", "", "v0, v1, 0, v2, 1, v3"),
    ("VRSQRT", "in f32", "v0, v1"),
    ("VOVER_SQRT", "in f64", "v0, v1, v2, v3"),
    ("VSPREAD_INTEGER", "", "0, rax"),
    ("MASK_EQUAL MASK_NOT_LESS", "", "v0, K(0)"),
    ("VROUND", "", "v0, v1, UP"),
    ("VTRUNCATE", "", "rax, [rdi]"),
    ("VLOAD VSPREAD", "", "v0, [rdi]"),
    ("VSTORE ELEMENT_OPERAND VMOV_TO", "", "[rdi], v0"),
    ("IOP", "", "por, x0, x0, x1"),
    ("IOP", "where d is not a", "por, x0, x1, x2"),
    ("IAND IOR", "", "x0, x0, x1"),
    ("IAND IOR", "where d is not a", "x0, x1, x2"),
    ("PACK_RGBA8", "", "0, 1, 2, 0"),
    ("PACK_RGBA8", "with the clamp", "0, 1, 2, 1"),
    ("TRANSPOSE_F32X4", "", "0, 1, 2, 3, 7, 8"),
    ("SPREAD_F32X4", "", "0, 1, edi, k2"),
    ("NARROW NARROW_COLOUR", "in f64", "0"),
    ("STORE_SAME_F32X4", "", "rdi, 0, movaps"),
    ("STORE_SAME_F32X4 STORE_F32X4", "past the cache", "rdi, 0, movntps"),
    ("STORE_PIXEL_F32X4 STORE_PIXEL_RGBA8 STORE_NUMBERS", "", "rdi, 0"),
    ("PART_F32X4", "", "rdi, 4, rax, rcx, rdx, k1, 1"),
    ("PART_RGBA8", "", "rdi, 1, rax, rcx, rdx, k1, 3"),
    ("MASK_FROM_TO", "", "rax, rcx, rdx"),
    ("COPY_PART", "", "F32X4, rdi, rax, rcx, rdx, 1"),
    ("COPY_PART", "of RGBA8", "RGBA8, rdi, rax, rcx, rdx, 1"),
    ("COPY_PIXEL_F32X4 COPY_PIXEL_RGBA8", "", "rdi, rax, rdx, 1"),
    ("STORE_RGBA8 STORE_F32X4", "", "rdi, 0, movups"),
    ("ADD3 SUB3", "", "v0, v1, v2, v0, v1, v2, v3, v4, v5"),
    ("ADD3 SUB3", "where d is not a", "v0, v1, v2, v3, v4, v5, v6, v7, v8"),
    ("SCALE3", "", "v0, v1, v2, v0, v1, v2, v3"),
    ("SCALE3", "where d is not a", "v0, v1, v2, v3, v4, v5, v6"),
    ("LIT_PLACE", "", "other, 14"),
    ("LIT_CONSTANT", "", "m, [rdi]"),
    ("LIT_SCALED", "", "kn, [rdi]"),
    ("LIT_SCALED", ESTIMATES, "kn, [rdi]"),
    ("LIT_SPHERE_CONSTANTS", "", "rdi"),
    ("LIT_SPHERE_CONSTANTS", ESTIMATES, "rdi"),
    ("LIT_ROW_CONSTANTS", "", "rsi"),
    ("LIT_ROW_CONSTANTS", ESTIMATES, "rsi"),
    ("SPHERE_LIT", "", "v0, v1, 1, v2, v3, v4, v5, v6"),
    ("SPHERE_LIT", "inside", "v0, v1, 0, v2, v3, v4, v5, v6"),
    ("SPHERE_LIT", ESTIMATES, "v0, v1, 1, v2, v3, v4, v5, v6"),
    ("SPHERE_LIT", "inside with estimates", "v0, v1, 0, v2, v3, v4, v5, v6"),
    ("LAMBERT3", "", "v0, v1, v2, v3, v4, v5, rdi, v6, v7, v8, v9, v10, v11"),
    ("AROUND_NORMAL", "", "v0, v1, v2, v3, v4, v5, v6, rdi, v7"),
    ("AROUND_COSINE", "", "v0, v1, v2, v3, v4, v5, v6, v7, rdi, v8, v9, v10, v11"),
    ("VABS", "", "v0, v0"),
    ("VABS", "where d is not a", "v0, v1"),
    ("MASK_BITS", "", "eax"),
    ("WIDEN", "in f64", "v0, [rdi]"),
    ("INSERT128", "", "0, [rdi], 0"),
    ("STORE128", "", "[rdi], w, 0, 0"),
    ("STORE_SPLIT", "", "rdi, v, 0"),
    ("ENTER_OWNED", "", "256, 64"),
    ("TRANSPOSE4", "", "0, 1, 2, 3, 4, 5, 6, 0"),
    ("TRANSPOSE_THREE", "", "rdi, TriangleArrays, ax, ay, az, 0, 1, 2, 3, 4"),
    ("TRANSPOSE_QUARTER", "", "rdi, TriangleArrays, red, green, blue, ax, rax, rbx, rcx, rdx, 0, 0, 1, 2, 3, 4"),
    ("TRANSPOSE_TRIANGLES TRANSPOSE_SPHERES", "", "rdi, rax, rbx, rcx, rdx"),
    ("LOAD_VERTEX", "", "0, rdx, rax, 1, rbx"),
    ("TRANSPOSE_FACES", "", "rdi, rax, rbx, rcx, rdx, r8, r9"),
    ("OBJECT_AT", "", "1, rax, Sphere_size, rdx, r15"),
    ("STORE_CANDIDATES", "", "rdi, 2, 3, 4, 5, 6, 7, 8, eax, r12"),
    ("PLANE_ROW", "", "VLOAD, v0, rdi, e1, v1, v2, v3"),
    ("PLANE_ROW", "in all lanes", "VSPREAD, v0, rdi, e1, v1, v2, v3"),
    ("SPHERE_ROW", "", "VLOAD, v0, v1, v2, rdi, v3, v4, v5, v6"),
    ("SPHERE_ROW", "in all lanes", "VSPREAD, v0, v1, v2, rdi, v3, v4, v5, v6"),
    ("SD", "", "addsd, xmm0, xmm1"),
    ("IF_BELOW", "", "xmm0, xmm1, .body_end"),
    ("WIDEN_ONE ELEMENT_F64", "", "xmm0, [rdi]"),
    ("ONE_RAY", "", "xmm0, xmm1, xmm2, 12, 14, rsi"),
    ("ONE_TERM", "", "xmm3, xmm0, rdx, ay, bz, az, by, xmm4, xmm5"),
    ("IF_OUTSIDE_EDGE", "", "xmm0, xmm1, xmm2, rdx, a, b, xmm7, .body_end, xmm6, xmm3, xmm4, xmm5"),
    ("IF_OUTSIDE_TRIANGLE", "", "xmm0, xmm1, xmm2, rdx, xmm7, xmm6, xmm3, xmm4, xmm5, .body_end"),
    ("ONE_SQUARE", "", "xmm3, xmm0, x, xmm1, y, rdx, xmm4"),
    ("IF_OUTSIDE_SPHERE", "", "xmm0, xmm1, xmm2, rdx, xmm6, xmm3, xmm4, .body_end"),
    ("TRIANGLE_COSINE SPHERE_COSINE", "", "v0, v1, v2, v3, v4, rdi, v5, v6, v7, v8"),
    ("BETTER_CORNER", "", "eax"),
    ("SPHERE_ROOT", "", "v0, v1, v2, rdi, v3, v4, v5"),
    ("NORMAL_OVER_T", "", "v0, x, v1, v2, v3, rdi, v4, v5"),
    ("SHORT_COSINE", "", "v0, v1, v2, v3, rdi, v4, v5, v6, v7"),
    ("GATHER4", "", "0, 1, 2, 3, 4, 5, 6, rdi, rsi, ax"),
];

fn snippets(rows: &[Row]) -> Vec<Snippet> {
    let snippets = |(names, of, operands): &Row| {
        names.split(' ').map(|name| (name.to_owned(), *of, (*operands).to_owned())).collect::<Vec<_>>()
    };
    rows.iter().flat_map(snippets).collect()
}

/// The snippets of all macros of packets.
fn packet_snippets() -> Vec<Snippet> {
    let mut packets = snippets(&PACKET_SNIPPETS);
    let others =
        ["FUNC", "ENDFUNC", "END"].into_iter().chain(OPERATIONS.iter().map(|(name, ..)| *name)).map(str::to_owned);
    let listed = packets.iter().cloned().chain(snippets(&AOS_SNIPPETS)).map(|(name, ..)| name);
    let listed: BTreeSet<_> = listed.chain(others).collect();
    let alike = macros().into_iter().filter(|(name, ..)| !listed.contains(name)).map(|(name, parameters, _)| {
        let registers: Vec<_> = (0..parameters).map(|number| format!("v{number}")).collect();
        (name, "", registers.join(", "))
    });
    packets.extend(alike);
    packets
}

/// The bytes of an element, for f32 and f64.
const ELEMENTS: [u32; 2] = [4, 8];

/// Assembles each line in a function rayo_<number> in the unit `isa`, for elements of this many
/// bytes and with AOS_BEST set to `best`. The labels .begin, .body, .body_end and .leave separate
/// the code of FUNC, of the line and of ENDFUNC.
fn assemble(isa: &str, element: u32, best: bool, lines: &[String]) -> Result<Vec<u8>, String> {
    let includes = |file: &str| {
        let text = fs::read_to_string(asm().join(file)).unwrap();
        let kept = |line: &&str| line.starts_with("%define ISA ") || line.starts_with("%include \"include/");
        text.lines().filter(kept).flat_map(|line| [line, "\n"]).collect::<String>()
    };
    let constants = "%include \"include/packet_constants.inc\"\n";
    let packets = includes("include/packets.inc").replace(constants, "");
    let mut source = includes(&format!("{isa}.asm")).replace("%include \"include/packets.inc\"\n", &packets);
    source += &format!("    ELEMENT {element}\n{constants}%assign AOS_BEST {}\n", u8::from(best));
    for (number, line) in lines.iter().enumerate() {
        source += &format!("FUNC {number}\n.begin:\n    CONSTANTS 1\n.body:\n{line}\n");
        source += ".body_end:\n    UNCONSTANTS\n.leave:\nENDFUNC\n";
    }
    let folder = tempfile::tempdir().unwrap();
    let (input, output) = (folder.path().join("snippets.asm"), folder.path().join("snippets.o"));
    fs::write(&input, source).unwrap();
    let nasm = std::env::var("NASM").unwrap_or("nasm".into());
    let done = Command::new(nasm)
        .args(["-f", "elf64", "-o"])
        .arg(&output)
        .arg("-i")
        .arg(format!("{}/", asm().display()))
        .arg(&input)
        .output()
        .expect("NASM, which the kernels were built with: name it in the variable NASM");
    if done.status.success() { Ok(fs::read(output).unwrap()) } else { Err(String::from_utf8(done.stderr).unwrap()) }
}

/// The number of instructions of each snippet, preceded by those of FUNC, ENDFUNC and END.
fn count_snippets(isa: &str, element: u32, best: bool, snippets: &[Snippet]) -> BTreeMap<(String, String), usize> {
    let line = |(name, of, operands): &Snippet| {
        format!("%assign ESTIMATE {}\n    {name} {operands}", u8::from(of.contains(ESTIMATES)))
    };
    let bytes = assemble(isa, element, best, &snippets.iter().map(line).collect::<Vec<_>>()).unwrap();
    let code = Code64::new(&bytes);
    let mut counts = BTreeMap::new();
    for (number, (name, of, _)) in snippets.iter().enumerate() {
        let symbol = code.file.symbol_by_name(&format!("rayo_{number}")).unwrap();
        let (start, end) = (symbol.address(), symbol.address() + symbol.size());
        let label = |label| code.address(&format!(".Lrayo_{number}.{label}"));
        let leaving = code.decode(label("leave")..end);
        let after = leaving.iter().skip_while(|i| i.flow_control() != FlowControl::Return).skip(1);
        let mut count = |name: &str, of: &str, count| counts.insert((name.to_owned(), of.to_owned()), count);
        count("FUNC", "", code.decode(start..label("begin")).len());
        count("ENDFUNC", "", leaving.len());
        count("END", "", after.count());
        count(name, of, code.decode(label("body")..label("body_end")).len());
    }
    counts
}

/// The numbers of instructions of the packet macros in one unit: the usual numbers, and those of
/// other circumstances where they differ.
fn count_packets(isa: &str) -> BTreeMap<(String, String), usize> {
    let [usual, wide] = ELEMENTS.map(|element| {
        // Only AVX-512 has estimates in f64, and only the short form uses them there.
        let refined =
            |name: &str| isa == "avx512" && (["VOVER_SQRT", "SPHERE_LIT"].contains(&name) || name.starts_with("LIT_"));
        let has = |(name, of, _): &Snippet| match *of {
            "in f64" if name == "VOVER_SQRT" => element == 8 && refined(name),
            of if of.contains(ESTIMATES) => element == 4 || refined(name),
            "in f32" => element == 4,
            "in f64" => element == 8,
            _ => true,
        };
        let snippets: Vec<_> = packet_snippets().into_iter().filter(has).collect();
        let mut counts = count_snippets(isa, element, false, &snippets);
        let none = counts[&("CONSTANTS".to_owned(), String::new())];
        *counts.get_mut(&("CONSTANTS".to_owned(), EACH.to_owned())).unwrap() -= none;
        counts
    });
    let mut counts: BTreeMap<_, _> = wide.clone().into_iter().filter(|((_, of), _)| of == "in f64").collect();
    for ((name, of), count) in &usual {
        let plain = usual.get(&(name.clone(), String::new()));
        let differs = of.is_empty() || plain != Some(count);
        if differs {
            counts.insert((name.clone(), of.clone()), *count);
        }
        // Numbers in f64 are listed only where they differ from what holds for f32.
        let Some(in_wide) = wide.get(&(name.clone(), of.clone())) else { continue };
        let said = if differs { Some(count) } else { wide.get(&(name.clone(), String::new())) };
        if said != Some(in_wide) {
            counts.insert((name.clone(), format!("{of} in f64").trim_start().to_owned()), *in_wide);
        }
    }
    counts
}

/// The numbers of instructions of all macros, counted in assembled code.
fn counted() -> BTreeMap<Count, usize> {
    let mut counts = BTreeMap::new();
    let mut count = |name: &str, form: &str, of: &str, instructions: usize| {
        counts.insert((name.to_owned(), form.to_owned(), of.to_owned()), instructions);
    };
    let code = Code64::of("sse41");
    for (form, implementation) in FORMS {
        for &(name, op, of) in OPERATIONS {
            let body = code.body(&format!("rayo_{implementation}_{op}"));
            count(name, form, of, body.len());
            if name == "SPHERE_HIT" {
                let end = body.last().unwrap().next_ip();
                let inside = body[0].ip()..=end;
                let until = |leaves: &dyn Fn(u64) -> bool| {
                    let jump = |i: &Instruction| {
                        i.flow_control() == FlowControl::ConditionalBranch && leaves(i.near_branch_target())
                    };
                    body.iter().position(jump).expect("a jump") + 1
                };
                count(name, form, "on the way to a miss", until(&|target| !inside.contains(&target)));
                count(name, form, "to the near wall", until(&|target| target == end));
            }
        }
        for ((name, of), instructions) in count_snippets("sse41", 4, form == "best", &snippets(&AOS_SNIPPETS)) {
            count(&name, form, &of, instructions);
        }
    }
    for unit in &UNITS {
        for ((name, of), instructions) in count_packets(unit.name) {
            count(&name, unit.name, &of, instructions);
        }
    }
    counts
}

#[test]
fn every_documented_number_of_instructions_is_that_of_the_code() {
    let (documented, counted) = (documented(), counted());
    let mut wrong = Vec::new();
    let mut unchecked: BTreeSet<_> = documented.keys().collect();
    for ((name, form, of), count) in &counted {
        let own = (name.clone(), form.clone(), of.clone());
        let common = (name.clone(), String::new(), of.clone());
        let said = documented.get_key_value(&own).or(documented.get_key_value(&common));
        if let Some((key, _)) = said {
            unchecked.remove(key);
        }
        if said.map(|(_, count)| count) != Some(count) {
            wrong.push(format!("{name} {form} {of}: {count}, and the comment says {:?}", said.map(|(_, count)| count)));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    assert!(unchecked.is_empty(), "these numbers have no code to compare them with: {unchecked:#?}");
}

/// Asserts that the macro refuses each of these calls.
fn are_refused(isa: &str, element: u32, best: bool, calls: &[&str]) {
    for call in calls {
        let Err(message) = assemble(isa, element, best, &[call.to_string()]) else {
            panic!("{isa}: {call} is not refused")
        };
        assert!(message.contains("this macro needs two different registers"), "{isa}: {call}: {message}");
    }
}

#[test]
fn a_macro_refuses_registers_that_must_not_be_the_same() {
    let paper = ["VEC_SCALE xmm1, xmm1", "VEC_SCALE xmm1, XMM1", "VEC_CROSS xmm1, xmm1, xmm2, xmm3, xmm4"];
    are_refused("sse41", 4, false, &[&paper[..], &["VEC_CROSS xmm1, xmm2, xmm3, xmm4, xmm4"]].concat());
    let best = [
        "VEC_SUM xmm1, xmm1",
        "VEC_DOT xmm1, xmm2, xmm1",
        "VEC_DOT xmm1, xmm2, xmm2",
        "VEC_NORM xmm1, xmm1",
        "VEC_CROSS xmm1, xmm2, xmm1, xmm3, xmm4",
        "VEC_CROSS xmm1, xmm2, xmm3, xmm2, xmm4",
        "VEC_NORMALISE xmm1, xmm1, xmm2",
        "VEC_NORMALISE xmm1, xmm2, xmm1",
        "VEC_NORMALISE xmm1, xmm2, xmm2",
    ];
    are_refused("sse41", 4, true, &best);
    assemble("sse41", 4, true, &["VEC_DOT xmm1, xmm1, xmm2".into()]).unwrap();
}

/// What legacy SSE cannot do, or only with a further copy, is refused in all units.
#[test]
fn packet_macros_refuse_alike_in_every_unit() {
    let fine = ["VADD v0, v1, v0", "VMUL v0, v1, v0", "VSUB v0, v0, v0", "VSUB v0, v0, v1", "IOP pslld, x0, x0, 8"];
    let refused = [
        "VSUB v0, v1, v0",
        "VDIV v0, v1, v0",
        "VMIN v0, v1, v0",
        "VMAX v0, v1, v0",
        "SUB3 v0, v1, v2, v3, v4, v5, v6, v7, v2",
        "VFMA v0, v1, v2, v0",
        "VFMA v0, v1, v2, v2",
        "VFNMA v0, v1, v2, v2",
        "VFMSUB v0, K(0), v0",
        "VFMADD v0, v1, v0",
        "VDIFFERENCE v0, v0, 0, v1, 1, v2",
        "VDIFFERENCE v0, v1, 0, v2, 1, v2",
        "VSIGN v0, v1, v1",
        "VSELECT v0, v0",
        "DOT3 v0, v1, v0, v2, v3, v4, v5, v6",
        "DOT3 v0, v1, v2, v3, v4, v5, v6, v6",
        "IOP por, x0, x1, x0",
    ];
    for (unit, element) in UNITS.iter().flat_map(|unit| ELEMENTS.map(|element| (unit, element))) {
        are_refused(unit.name, element, false, &refused);
        assemble(unit.name, element, false, &fine.map(str::to_owned)).unwrap();
    }
}
