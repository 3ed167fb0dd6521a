//! Assembles `asm/`, compiles the paper's C, and passes their shared layout, objects and versions
//! to the crate.

use std::env;
use std::fs;
use std::path::PathBuf;
use std::process::Command;

/// The most objects of a kind that a rung of the ladder takes.
const LADDER_MOST: usize = 64;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=asm/include");
    println!("cargo::rustc-check-cfg=cfg(rayo_asm, rayo_c)");
    println!("cargo::rustc-env=RAYO_RUSTC={}", first_line(env::var("RUSTC").unwrap(), "--version"));
    let out = PathBuf::from(env::var_os("OUT_DIR").unwrap());
    let [paper, tiles] = ["layout.inc", "tile_layout.inc"].map(layout::Layout::read);
    // C does not use the structures of tiles.
    fs::write(out.join("layout.h"), paper.to_c()).unwrap();
    fs::write(out.join("layout.rs"), paper.to_rust() + &tiles.to_rust()).unwrap();
    if cfg!(feature = "lab") {
        // What a build without kernels includes instead.
        fs::write(out.join("objects.rs"), "&[]").unwrap();
        fs::write(out.join("rungs.rs"), format!("rungs! {{ most {LADDER_MOST}; }} closed! {{}}")).unwrap();
        for unit in ["sse41", "avx2", "avx512"] {
            fs::write(out.join(format!("{unit}.lines")), "").unwrap();
        }
    }
    #[cfg(any(feature = "asm", feature = "c"))]
    native::build(&out);
}

/// The first line printed by `program flag`; empty if it cannot be run.
fn first_line(program: impl AsRef<std::ffi::OsStr>, flag: &str) -> String {
    let output = Command::new(program).arg(flag).output();
    let text = output.map(|o| String::from_utf8_lossy(&o.stdout).into_owned()).unwrap_or_default();
    text.lines().next().unwrap_or_default().to_owned()
}

#[cfg(any(feature = "asm", feature = "c"))]
mod native {
    use std::env;
    use std::fmt::Write as _;
    use std::fs;
    use std::hash::{DefaultHasher, Hash, Hasher};
    use std::path::{Path, PathBuf};

    use super::{LADDER_MOST, first_line};

    /// The units of the engines, one per ISA, whose source lines `rayo step` shows.
    #[cfg(all(feature = "asm", feature = "lab"))]
    const TRACERS: [&str; 3] = ["sse41", "avx2", "avx512"];
    /// All translation units: those of the engines, the harness of checked calls, functions to test
    /// the counters, chains to time, and macros by themselves, to be proved.
    const UNITS: [&str; 9] =
        ["sse41", "avx2", "avx512", "checked", "known", "chains", "alone_sse41", "alone_avx2", "alone_avx512"];
    const C_SOURCES: [&str; 3] = ["trace", "ops", "hits"];
    /// The levels at which by_value.c is compiled, to be counted: name, optimisation, and whether
    /// for this machine's CPU.
    const C_LEVELS: [(&str, u32, bool); 5] =
        [("O0", 0, false), ("O1", 1, false), ("O2", 2, false), ("O3", 3, false), ("native", 3, true)];
    /// The ladder's rungs in C: each differs from the previous one by a definition, a flag, or the
    /// source.
    const RUNGS: [Rung; 23] = [
        Rung { name: "calls", source: "trace", level: Level::Base, flags: &["-DCALLS"] },
        Rung {
            name: "calls_scalar",
            source: "trace",
            level: Level::Base,
            flags: &["-DCALLS", "-fno-tree-slp-vectorize"],
        },
        Rung { name: "sqrtf", source: "trace", level: Level::Base, flags: &["-DCALLS", "-DSQRTF"] },
        Rung { name: "inlined", source: "trace", level: Level::Base, flags: &["-DSQRTF"] },
        Rung { name: "lean", source: "lean", level: Level::Base, flags: &["-DSQRTF", EVERY_HIT, PER_RAY] },
        Rung { name: "nearest", source: "lean", level: Level::Base, flags: &["-DSQRTF", NEAREST, PER_RAY] },
        Rung { name: "hoisted", source: "lean", level: Level::Base, flags: &["-DSQRTF", NEAREST, HOISTED] },
        Rung { name: "native_v3", source: "lean", level: Level::V3, flags: &["-DSQRTF", NEAREST, HOISTED] },
        Rung { name: "native_v4", source: "lean", level: Level::V4, flags: &["-DSQRTF", NEAREST, HOISTED] },
        Rung { name: "fast_v3", source: "lean", level: Level::V3, flags: &["-DSQRTF", NEAREST, HOISTED, FAST] },
        Rung { name: "fast_v4", source: "lean", level: Level::V4, flags: &["-DSQRTF", NEAREST, HOISTED, FAST] },
        Rung { name: "turned_sse41", source: "turned", level: Level::Sse41, flags: &["-DSQRTF", FAST, NO_BRANCHES] },
        Rung { name: "turned_v3", source: "turned", level: Level::V3, flags: &["-DSQRTF", FAST, NO_BRANCHES] },
        Rung { name: "turned_v4", source: "turned", level: Level::V4, flags: &["-DSQRTF", FAST, NO_BRANCHES] },
        Rung { name: "closed_sse41", source: CLOSED, level: Level::Sse41, flags: &PLAIN },
        Rung { name: "closed_v3", source: CLOSED, level: Level::V3, flags: &PLAIN },
        Rung { name: "closed_v4", source: CLOSED, level: Level::V4, flags: &PLAIN },
        Rung { name: "clang_sse41", source: CLOSED, level: Level::Sse41, flags: &PLAIN },
        Rung { name: "clang_v3", source: CLOSED, level: Level::V3, flags: &PLAIN },
        Rung { name: "clang_v4", source: CLOSED, level: Level::V4, flags: &PLAIN },
        Rung { name: "intrinsics_sse41", source: CLOSED, level: Level::Sse41, flags: &INTRINSICS },
        Rung { name: "intrinsics_v3", source: CLOSED, level: Level::V3, flags: &INTRINSICS },
        Rung { name: "intrinsics_v4", source: CLOSED, level: Level::V4, flags: &INTRINSICS },
    ];
    /// The C source of the ladder's closed-form rungs, which shade whole rows. Rungs named after
    /// Clang are compiled by Clang, if it is installed.
    const CLOSED: &str = "lit";
    /// With these flags gcc vectorises square roots and selections.
    const PLAIN: [&str; 3] = ["-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast"];
    const INTRINSICS: [&str; 2] = ["-DINTRINSICS", "-ffp-contract=fast"];
    const EVERY_HIT: &str = "-DNEAREST_ONLY=0";
    const NEAREST: &str = "-DNEAREST_ONLY=1";
    const PER_RAY: &str = "-DHOISTED=0";
    const HOISTED: &str = "-DHOISTED=1";
    const FAST: &str = "-ffast-math";
    /// gcc would merge several selections with the same condition into a branch, and then not
    /// vectorise.
    const NO_BRANCHES: &str = "-fno-thread-jumps";
    const V3: &str = "-march=x86-64-v3";
    const V4: &str = "-march=x86-64-v4";
    /// The flags that V3 (the first eight) and V4 (all) stand for, for compilers that do not know
    /// these names, such as gcc 10.
    const EXTENSIONS: [&str; 13] = [
        "-mavx2",
        "-mbmi",
        "-mbmi2",
        "-mf16c",
        "-mfma",
        "-mlzcnt",
        "-mmovbe",
        "-mpopcnt",
        "-mavx512f",
        "-mavx512bw",
        "-mavx512cd",
        "-mavx512dq",
        "-mavx512vl",
    ];

    struct Rung {
        name: &'static str,
        source: &'static str,
        level: Level,
        flags: &'static [&'static str],
    }

    /// A level of x86-64 by the psABI. Code for `-march=native` on this machine could not run on
    /// another, so the program chooses among these when it runs.
    #[derive(Clone, Copy, Debug, PartialEq)]
    enum Level {
        Base,
        /// Not a level of its own, but SSE4.1, for the packets of that name.
        Sse41,
        V3,
        V4,
    }

    /// The oldest NASM that is tested.
    #[cfg(feature = "asm")]
    const NASM_VERSION: [u32; 3] = [2, 15, 5];
    #[cfg(feature = "asm")]
    const NASM_MISSING: &str = "NASM 2.15 or newer is needed to assemble the kernels. Install the package `nasm`: \
        `apt install nasm`, `dnf install nasm`, `pacman -S nasm`, `zypper install nasm` or `brew install nasm`; \
        or name another one in the variable NASM; \
        or build without the kernels in assembly: --no-default-features --features c";
    const CC_MISSING: &str = "a C compiler is needed for the paper's C. Install the package `gcc`: `apt install gcc libc6-dev`, \
        `dnf install gcc`, `pacman -S gcc`, `zypper install gcc` or `xcode-select --install`; \
        or name another one in the variable CC; \
        or build without the engine in C: --no-default-features --features asm";

    pub fn build(out: &Path) {
        println!("cargo::rerun-if-changed=asm");
        println!("cargo::rerun-if-changed=src/kernels/c");
        println!("cargo::rerun-if-env-changed=NASM");
        println!("cargo::rerun-if-env-changed=RAYO_STRICT");

        // C first: a compiler that cannot be used fails at once.
        let compiled = if cfg!(feature = "c") { compile(out) } else { Vec::new() };
        let assembled = assemble(out);
        let mut objects: Vec<_> = assembled.iter().chain(&compiled).cloned().collect();
        if objects.is_empty() {
            return;
        }
        // Code to be counted, timed and disassembled, which renders for no engine. C is measured
        // only beside assembly.
        if cfg!(feature = "lab") {
            let both = !assembled.is_empty() && !compiled.is_empty();
            let levels = if both { C_LEVELS.map(|level| compile_level(out, level)).to_vec() } else { Vec::new() };
            let named = UNITS.iter().zip(&assembled).chain(C_SOURCES.iter().zip(&compiled));
            let named = named.chain(C_LEVELS.iter().map(|(name, ..)| name).zip(&levels));
            fs::write(out.join("objects.rs"), objects_to_rust(named)).unwrap();
            objects.extend(levels);
            objects.extend(if both { compile_rungs(out) } else { Vec::new() });
        }
        let mut kernels = DefaultHasher::new();
        objects.iter().for_each(|object| fs::read(object).unwrap().hash(&mut kernels));
        println!("cargo::rustc-env=RAYO_KERNELS={:016x}", kernels.finish());
        cc::Build::new().objects(objects).compile("rayo_kernels");
        if env::var("CARGO_CFG_TARGET_OS").as_deref() == Ok("linux") {
            // Local labels would cut a kernel in pieces for objdump and perf.
            println!("cargo::rustc-link-arg=-Wl,--discard-locals");
        }
    }

    #[cfg(not(feature = "asm"))]
    fn assemble(_: &Path) -> Vec<PathBuf> {
        Vec::new()
    }

    #[cfg(feature = "asm")]
    fn assemble(out: &Path) -> Vec<PathBuf> {
        if env::var("CARGO_CFG_TARGET_ARCH").as_deref() != Ok("x86_64") {
            return Vec::new();
        }
        println!("cargo::rustc-cfg=rayo_asm");
        // NASM runs once per unit, since each has its own listing.
        let objects: Result<_, _> = std::thread::scope(|threads| {
            let units = UNITS.map(|unit| threads.spawn(move || assemble_unit(out, unit)));
            units.map(|unit| unit.join().expect("assembling does not panic")).into_iter().collect()
        });
        let program = env::var("NASM").unwrap_or("nasm".into());
        let version = first_line(program, "-v");
        println!("cargo::rustc-env=RAYO_NASM={version}");
        objects.unwrap_or_else(|refused: Refused| {
            // If NASM is missing, the error says all, and there is no version.
            let too_old = (!version.is_empty() && is_too_old(&version)).then(|| {
                format!("this is {version}, which may be too old: name one of 2.15.05 or newer in the variable NASM")
            });
            fail(&refused.what, &refused.details.into_iter().chain(too_old).collect::<Vec<_>>().join("\n"))
        })
    }

    /// Whether a version as NASM prints it, such as `NASM version 2.16.01 compiled on ...`, is
    /// below [`NASM_VERSION`].
    #[cfg(feature = "asm")]
    fn is_too_old(version: &str) -> bool {
        let numbers = version.split_whitespace().nth(2).unwrap_or_default().split(['.', 'r']);
        numbers.map_while(|number| number.parse().ok()).collect::<Vec<u32>>().as_slice() < NASM_VERSION.as_slice()
    }

    /// Why a unit was not assembled.
    #[cfg(feature = "asm")]
    struct Refused {
        what: String,
        details: Vec<String>,
    }

    #[cfg(feature = "asm")]
    fn assemble_unit(out: &Path, unit: &str) -> Result<PathBuf, Refused> {
        let mut nasm = nasm_rs::Build::new();
        nasm.min_version(2, 15, 0).include("asm").debug(false);
        if strict() {
            nasm.flag("-Wall").flag("-Werror");
        }
        // The shortest jumps take NASM about eleven passes over a unit, unoptimised ones two.
        // Unoptimised jumps suffice for debug builds, and for Clippy, which runs nothing.
        if matches!(env::var("OPT_LEVEL").as_deref(), Ok("0" | "1")) || env::var_os("CLIPPY_ARGS").is_some() {
            nasm.flag("-O1");
        }
        let listing = out.join(format!("{unit}.lst"));
        if cfg!(feature = "lab") {
            nasm.flag("-Lm").flag("-l").flag(listing.to_str().expect("Cargo's paths are UTF-8"));
        }
        // Messages go to a file: nasm-rs reports only the exit status.
        let messages = out.join(format!("{unit}.messages"));
        nasm.flag("-Z").flag(messages.to_str().expect("Cargo's paths are UTF-8"));
        nasm.file(format!("asm/{unit}.asm"));
        let made = nasm.compile_objects();
        let messages = fs::read_to_string(&messages).unwrap_or_default();
        let objects = made.map_err(|error| {
            if !error.contains("exit status") {
                return Refused { what: NASM_MISSING.into(), details: vec![error] };
            }
            let line_of =
                |file: &str, number: usize| fs::read_to_string(file).ok()?.lines().nth(number - 1).map(str::to_owned);
            let root = env::var("CARGO_MANIFEST_DIR").unwrap_or_default() + "/";
            let told = super::nasm_error::first_error(&messages.replace(&root, ""), line_of);
            let mut details = told.unwrap_or_else(|| messages.lines().map(str::to_owned).chain([error]).collect());
            Refused { what: format!("asm/{unit}.asm is not assembled: {}", details.remove(0)), details }
        })?;
        eprint!("{messages}");
        // nasm-rs names objects only after their sources and can lose one without an error.
        let [object] = &objects[..] else { panic!("NASM did not make one object of {unit}: {objects:?}") };
        forget_folder(object, unit);
        #[cfg(feature = "lab")]
        {
            if TRACERS.contains(&unit) {
                // If nothing can be single-stepped, the table is not needed.
                let asked = env::var("CARGO_CFG_TARGET_OS").as_deref() == Ok("linux");
                let table = if asked { super::listing::table(&listing, object) } else { Vec::new() };
                fs::write(out.join(format!("{unit}.lines")), table).unwrap();
            }
            fs::remove_file(listing).unwrap(); // tens of megabytes
        }
        Ok(object.clone())
    }

    /// Gives an object the name of its unit for a source, in place of the absolute path that
    /// nasm-rs makes of it: a program would name the folders of who built it, and kernels would
    /// seem to differ from folder to folder.
    #[cfg(feature = "asm")]
    fn forget_folder(object: &Path, unit: &str) {
        let name = format!("asm/{unit}.asm");
        let path = Path::new(&env::var_os("CARGO_MANIFEST_DIR").unwrap()).join(&name);
        let path = path.to_str().expect("Cargo's paths are UTF-8").as_bytes();
        let mut bytes = fs::read(object).unwrap();
        if let Some(at) = bytes.windows(path.len()).position(|window| window == path) {
            // The name ends at the first 0.
            bytes[at..at + path.len()].fill(0);
            bytes[at..at + name.len()].copy_from_slice(name.as_bytes());
            fs::write(object, bytes).unwrap();
        }
    }

    /// Whether a warning is an error: not for users, whose tools may have warnings that ours do
    /// not.
    fn strict() -> bool {
        env::var("RAYO_STRICT").is_ok_and(|value| value == "1")
    }

    /// The compiler as the paper uses it.
    fn compiler(out: &Path) -> cc::Build {
        let mut c = cc::Build::new();
        c.opt_level(3)
            .debug(false)
            .std("c11")
            // gcc's default for this C standard; Clang has to be asked for it.
            .flag_if_supported("-ffp-contract=off")
            .include(out)
            .warnings(true)
            .extra_warnings(true)
            .warnings_into_errors(strict());
        c
    }

    fn compile(out: &Path) -> Vec<PathBuf> {
        println!("cargo::rustc-cfg=rayo_c");
        let mut c = compiler(out);
        c.files(C_SOURCES.map(|source| format!("src/kernels/c/{source}.c")));
        let compiler = c.try_get_compiler().unwrap_or_else(|error| fail(CC_MISSING, &error.to_string()));
        let objects = c.try_compile_intermediates().unwrap_or_else(|error| {
            fail(
                if compiler.path().exists() {
                    "the C compiler refused the paper's C: name another one in the variable CC"
                } else {
                    CC_MISSING
                },
                &error.to_string(),
            )
        });
        println!("cargo::rustc-env=RAYO_CC={}", first_line(compiler.path(), "--version"));
        // Keep the flags that affect measurements; paths do not, and are specific to this machine.
        let flags = compiler.args().iter().map(|flag| flag.to_string_lossy());
        let flags: Vec<_> = flags
            .filter(|flag| flag.starts_with('-') && !matches!(&**flag, "-I" | "-Werror") && !flag.contains('/'))
            .collect();
        println!("cargo::rustc-env=RAYO_CFLAGS={}", flags.join(" "));
        objects
    }

    /// Compiles by_value.c at one level, in an object named after it.
    fn compile_level(out: &Path, (name, level, native): (&str, u32, bool)) -> PathBuf {
        let mut c = compiler(out);
        c.opt_level(level).define("RAYO_LEVEL", name).out_dir(out.join(name)).file("src/kernels/c/by_value.c");
        if native {
            c.flag_if_supported("-march=native");
        }
        let objects = c.try_compile_intermediates();
        let objects = objects.unwrap_or_else(|error| fail("the C compiler refused by_value.c", &error.to_string()));
        let object = out.join(format!("by_value-{name}.o"));
        fs::copy(&objects[0], &object).unwrap();
        object
    }

    /// Compiles each rung, and lists them for `rungs!` in src/kernels/ladder.rs.
    fn compile_rungs(out: &Path) -> Vec<PathBuf> {
        let mut objects = Vec::new();
        let mut list = format!("rungs! {{\n    most {LADDER_MOST};\n");
        let mut closed = String::new();
        let clang = !first_line("clang", "--version").is_empty();
        for Rung { name, source, level, flags } in RUNGS {
            let mut c = compiler(out);
            if name.starts_with("clang") {
                if !clang {
                    continue;
                }
                c.compiler("clang");
            }
            let supported = |flag: &&str| c.is_flag_supported(flag).unwrap_or(false);
            let machine: &[&str] = match level {
                Level::Base => &[],
                Level::Sse41 => &["-msse4.1"],
                Level::V3 if supported(&V3) => &[V3],
                Level::V4 if supported(&V4) => &[V4],
                Level::V3 => &EXTENSIONS[..8],
                Level::V4 => &EXTENSIONS,
            };
            // Of the tuning flags, those that this compiler has.
            let flags = flags.iter().filter(|flag| flag.starts_with("-D") || supported(flag));
            let flags: Vec<_> = machine.iter().chain(flags).copied().collect();
            for flag in &flags {
                c.flag(flag);
            }
            c.define("TRACE", format!("rayo_ladder_{name}").as_str());
            c.define("LADDER_MOST", LADDER_MOST.to_string().as_str());
            // A directory for each rung: objects are named after their sources.
            c.out_dir(out.join(name)).file(format!("src/kernels/c/{source}.c"));
            objects.extend(c.try_compile_intermediates().unwrap_or_else(|error| {
                fail(&format!("the C compiler refused the rung `{name}` of the ladder"), &error.to_string())
            }));
            let list = if source == CLOSED { &mut closed } else { &mut list };
            writeln!(list, "    {name:?}, {level:?}, \"-O3 {}\";", flags.join(" ")).unwrap();
        }
        fs::write(out.join("rungs.rs"), list + "}\nclosed! {\n" + &closed + "}\n").unwrap();
        objects
    }

    fn objects_to_rust<'a>(objects: impl Iterator<Item = (&'a &'a str, &'a PathBuf)>) -> String {
        let mut text = String::from("&[\n");
        for (name, path) in objects {
            // By its place in OUT_DIR: a copied build directory has its own objects.
            let file = format!("/{}", path.file_name().unwrap().to_str().unwrap());
            writeln!(text, "    ({name:?}, include_bytes!(concat!(env!(\"OUT_DIR\"), {file:?}))),").unwrap();
        }
        text + "]\n"
    }

    fn fail(what: &str, detail: &str) -> ! {
        println!("cargo::error={what}");
        for line in detail.lines().filter(|line| !line.trim().is_empty()) {
            println!("cargo::error=  {line}");
        }
        // Cargo fails the build for the errors alone; after another status it would print all that
        // this script has printed.
        std::process::exit(0);
    }
}

/// What NASM says of a mistake, shortened.
#[cfg(feature = "asm")]
#[path = "build/nasm_error.rs"]
mod nasm_error;

/// Makes the tables of source lines.
#[cfg(all(feature = "asm", feature = "lab"))]
#[path = "build/listing.rs"]
mod listing;

/// Reads the `struc` blocks of asm/include and writes them as records for Rust, and their offsets
/// for C.
mod layout {
    use std::fmt::Write as _;
    use std::fs;

    /// A file of structures and numbers.
    pub struct Layout {
        strucs: Vec<Struc>,
        /// For Rust.
        numbers: String,
    }

    struct Struc {
        name: String,
        comment: String,
        fields: Vec<Field>,
        size: usize,
    }

    struct Field {
        name: String,
        comment: String,
        offset: usize,
        /// 1, 4 or 8 bytes; where it is 1, the structure is of elements, f32 or f64, and so are
        /// offset and size.
        unit: usize,
        count: usize,
    }

    /// A line of documentation, if there is something to say.
    fn doc(comment: &str) -> String {
        if comment.is_empty() { String::new() } else { format!("#[doc = {comment:?}] ") }
    }

    impl Struc {
        /// Its definition by a macro of src/kernels/records.rs; if its fields have types of their
        /// own, which Rust defines, their offsets for `layout_checks!`.
        fn to_rust(&self) -> String {
            let Struc { name, comment, fields, size } = self;
            let (unit, count) = (fields[0].unit, fields[0].count);
            let alike = fields.iter().all(|field| (field.unit, field.count) == (unit, count));
            let (of, head) = match (unit, count) {
                (1, 1) if alike => ("elements", name.clone()),
                (8, 1) if alike => ("words", name.clone()),
                (1, _) if alike => ("columns", format!("{name}<E>: E, {count}")),
                (4, 16 | 64 | 128) if alike => ("columns", format!("{name}: u32, {count}")),
                _ => {
                    let fields = fields.iter().map(|field| format!("{}: {}, ", field.name, field.offset));
                    return format!("layout_checks! {{ {name}, {size}, {{ {}}} }}\n", fields.collect::<String>());
                }
            };
            let fields = fields.iter().map(|field| format!("    {}{},\n", doc(&field.comment), field.name));
            format!("{of}! {{ {}{head} {{\n{}}} }}\n", doc(comment), fields.collect::<String>())
        }
    }

    impl Layout {
        /// A file of asm/include.
        pub fn read(file: &str) -> Layout {
            let path = format!("asm/include/{file}");
            let mut layout = Layout { strucs: Vec::new(), numbers: String::new() };
            // The comment lines directly above the structure.
            let mut above = Vec::new();
            for (number, line) in fs::read_to_string(&path).unwrap().lines().enumerate() {
                let (line, comment) = line.split_once(';').unwrap_or((line, ""));
                let comment = comment.trim().to_owned();
                match *line.split_whitespace().collect::<Vec<_>>() {
                    [] if !comment.is_empty() => {
                        above.push(comment);
                        continue;
                    }
                    [] | ["endstruc"] => {}
                    ["%assign", name, value] => {
                        writeln!(layout.numbers, "{}pub const {name}: usize = {value};", doc(&comment)).unwrap();
                    }
                    ["struc", name] => {
                        let comment = above.join(" ");
                        layout.strucs.push(Struc { name: name.into(), comment, fields: Vec::new(), size: 0 });
                    }
                    [name, unit @ ("resb" | "resd" | "resq"), count] => {
                        let struc = layout.strucs.last_mut().expect("a field outside a struc");
                        let name = name.trim_start_matches('.').trim_end_matches(':').to_owned();
                        let unit = [("resb", 1), ("resd", 4), ("resq", 8)].iter().find(|(u, _)| *u == unit).unwrap().1;
                        let (offset, count) = (struc.size, count.parse().expect("a number of units"));
                        struc.size += unit * count;
                        struc.fields.push(Field { name, comment, offset, unit, count });
                    }
                    _ => panic!("{path}:{}: not a struc, a field or its end: {line}", number + 1),
                }
                above.clear();
            }
            layout
        }

        /// The numbers and structures of the file, for Rust.
        pub fn to_rust(&self) -> String {
            self.strucs.iter().fold(self.numbers.clone(), |text, struc| text + &struc.to_rust())
        }

        /// A macro that applies one check to every field and one to every size.
        pub fn to_c(&self) -> String {
            let mut text = String::from("#define LAYOUT_CHECKS(OFFSET, SIZE)");
            for Struc { name, fields, size, .. } in self.strucs.iter().filter(|struc| struc.fields[0].unit > 1) {
                // The paper's C knows only the paper's spheres and triangles.
                let name = name.trim_start_matches("Paper").to_lowercase();
                for Field { name: field, offset, .. } in fields {
                    write!(text, " \\\n    OFFSET({name}, {field}, {offset});").unwrap();
                }
                write!(text, " \\\n    SIZE({name}, {size});").unwrap();
            }
            text + "\n"
        }
    }
}
