//! A user's file made into a shared object: assembled, compiled and linked.

use std::ffi::{OsStr, OsString};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use object::{Object, ObjectSymbol, SymbolKind};
use tempfile::TempDir;

use super::process::output_within;
use crate::measure::instructions::Code;
use rayo::internals::scene::{brief, shown};

/// Why a file cannot be used: in words, the assembler's own among them.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Unusable(pub String);

/// What a file is written in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Language {
    Nasm,
    /// Assembly for the C compiler, `.s` and `.S`.
    Gas,
    C,
    Rust,
    Object,
    Shared,
}

impl Language {
    const EXTENSIONS: [(&'static str, Language); 8] = [
        ("asm", Language::Nasm),
        ("nasm", Language::Nasm),
        ("s", Language::Gas),
        ("S", Language::Gas),
        ("c", Language::C),
        ("rs", Language::Rust),
        ("o", Language::Object),
        ("so", Language::Shared),
    ];

    fn of(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_str()?;
        Self::EXTENSIONS.into_iter().find(|(known, _)| *known == extension).map(|(_, language)| language)
    }
}

/// A file of our macros: its name, its text, and what it needs before it.
struct Include {
    name: &'static str,
    text: &'static str,
    needs: &'static [&'static str],
}

macro_rules! includes {
    ($($name:literal needs $needs:expr;)*) => {
        const INCLUDES: &[Include] = &[$(Include {
            name: $name,
            text: include_str!(concat!("../../../../asm/include/", $name)),
            needs: &$needs,
        }),*];
    };
}

includes! {
    "isa.inc" needs [];
    "layout.inc" needs [];
    "constants.inc" needs ["isa.inc"];
    "vec3_aos.inc" needs ["isa.inc"];
    "sphere_aos.inc" needs ["vec3_aos.inc", "layout.inc", "constants.inc"];
    "triangle_aos.inc" needs ["vec3_aos.inc", "layout.inc", "constants.inc"];
    "lambert_aos.inc" needs ["vec3_aos.inc", "layout.inc", "constants.inc"];
    "packet.inc" needs ["isa.inc"];
    "vec3.inc" needs ["packet.inc"];
}

impl Include {
    /// A file that includes it once, after what it needs, with the settings that our units make,
    /// unless the user has made others.
    fn wrapper(&self) -> String {
        let guard = format!("RAYO_{}", self.name.to_uppercase().replace('.', "_"));
        let mut text = format!("%ifndef {guard}\n%define {guard}\n%ifndef ISA\n%define ISA sse41\n%endif\n");
        text += "%ifndef AOS_BEST\n%assign AOS_BEST 0\n%endif\n";
        for needed in self.needs {
            text += &format!("%include \"include/{needed}\"\n");
        }
        text + &format!("%include \"asm/include/{}\"\nsection .text\n%endif\n", self.name)
    }
}

/// A shared object that was made of a user's file.
pub struct Built {
    /// The file's name as it was given.
    pub name: String,
    /// The file itself.
    pub path: PathBuf,
    pub language: Language,
    pub shared: PathBuf,
    /// Where instructions are counted: the object before it was linked, which still names what it
    /// refers to.
    pub object: Vec<u8>,
    /// The warnings of the tools.
    pub warnings: String,
    /// It is removed when this is dropped.
    pub folder: TempDir,
}

/// A larger file is no kernel: refused before it is read.
const MOST_BYTES: u64 = 64 << 20;

impl Built {
    /// Assembles or compiles a file, and links it.
    ///
    /// # Errors
    /// If it cannot be read, is no such file, or the tools refuse it or are not there.
    pub fn of(path: &Path, flags: &str) -> Result<Self, Unusable> {
        let language = readable(path)?;
        let folder = tempfile::Builder::new().prefix("rayo-try-").tempdir();
        let folder = folder.map_err(|error| Unusable(format!("no folder for temporary files: {error}")))?;
        let maker = Maker { path, flags, folder: folder.path(), language };
        let (shared, object, warnings) = maker.make()?;
        let object = fs::read(object).map_err(|error| cannot_read(path, &error))?;
        if object::File::parse(&*object).is_err() {
            return Err(Unusable(format!("{} is not an object file that can be read", shown(path))));
        }
        Ok(Built { name: shown(path).to_string(), path: path.to_owned(), language, shared, object, warnings, folder })
    }

    /// The functions that it has for others, by name.
    pub fn functions(&self) -> Vec<String> {
        let Ok(file) = object::File::parse(&*self.object) else { return Vec::new() };
        let mut names: Vec<String> = Vec::new();
        for symbol in file.symbols().chain(file.dynamic_symbols()) {
            let is_function = symbol.is_definition()
                && symbol.is_global()
                && matches!(symbol.kind(), SymbolKind::Text | SymbolKind::Unknown | SymbolKind::Label);
            let name = symbol.name().unwrap_or_default();
            // What rustc and the linker add begins with an underscore.
            let is_own = !name.starts_with('_') && !name.contains(".end") && !name.starts_with("rust_eh");
            if is_function && is_own && !names.iter().any(|known| known == name) {
                names.push(name.to_owned());
            }
        }
        names
    }

    /// Refuses a file that has no function for others.
    ///
    /// # Errors
    /// If there is none.
    pub fn require_functions(&self) -> Result<(), Unusable> {
        if !self.functions().is_empty() {
            return Ok(());
        }
        let hint = "is a `global` missing, or a `static` too many?";
        Err(Unusable(format!("{} has no function for others: {hint}", self.name)))
    }

    /// The address of a function in the shared object.
    pub fn offset(&self, symbol: &str) -> Option<u64> {
        let data = fs::read(&self.shared).ok()?;
        let file = object::File::parse(&*data).ok()?;
        let mut symbols = file.symbols().chain(file.dynamic_symbols());
        symbols.find(|known| known.is_definition() && known.name() == Ok(symbol)).map(|symbol| symbol.address())
    }

    /// The code of a function.
    pub fn code(&self, symbol: &str) -> Option<Code> {
        Code::in_object(&self.object, symbol)
    }
}

fn cannot_read(path: &Path, error: &io::Error) -> Unusable {
    Unusable(format!("cannot read {}: {error}", shown(path)))
}

/// The language of a file that is there and has something in it.
fn readable(path: &Path) -> Result<Language, Unusable> {
    let name = shown(path);
    let metadata = fs::metadata(path).map_err(|error| cannot_read(path, &error))?;
    if metadata.is_dir() {
        return Err(Unusable(format!("{name} is a folder: name a file of it")));
    }
    let language = Language::of(path).ok_or_else(|| {
        let known: Vec<_> = Language::EXTENSIONS.iter().map(|(extension, _)| format!(".{extension}")).collect();
        Unusable(format!("{name}: its name has to end in one of {}, which say what is in it", known.join(", ")))
    })?;
    if !metadata.is_file() {
        return Err(Unusable(format!("{name} is no file")));
    }
    if metadata.len() == 0 {
        return Err(Unusable(format!("{name} is empty: `rayo try --template asm --op dot` prints a start")));
    }
    if metadata.len() > MOST_BYTES {
        return Err(Unusable(format!("{name} has {} bytes, and a kernel at most {MOST_BYTES}", metadata.len())));
    }
    fs::File::open(path).map_err(|error| cannot_read(path, &error))?;
    Ok(language)
}

/// What makes a shared object of a file.
struct Maker<'a> {
    path: &'a Path,
    flags: &'a str,
    folder: &'a Path,
    language: Language,
}

/// A tool, by the variable that names another one.
struct Tool {
    name: OsString,
    /// What to do where it is not there.
    missing: &'static str,
}

impl Tool {
    fn new(variable: &str, usual: &str, missing: &'static str) -> Self {
        let name = std::env::var_os(variable).filter(|name| !name.is_empty()).unwrap_or(usual.into());
        Tool { name, missing }
    }

    fn nasm() -> Self {
        Tool::new("NASM", "nasm", "install the package `nasm`, or name one in the variable NASM")
    }

    fn cc() -> Self {
        Tool::new("CC", "cc", "install the package `gcc`, or name a C compiler in the variable CC")
    }

    fn rustc() -> Self {
        Tool::new("RUSTC", "rustc", "install Rust (rustup.rs), or name a compiler in the variable RUSTC")
    }
}

impl Maker<'_> {
    /// The shared object, the object that is counted, and the warnings.
    fn make(&self) -> Result<(PathBuf, PathBuf, String), Unusable> {
        let (object, shared) = (self.folder.join("kernel.o"), self.folder.join("kernel.so"));
        let compiled = match self.language {
            Language::Nasm => self.assemble(&object)?,
            Language::C | Language::Gas => self.compile(&object)?,
            Language::Rust => {
                let warnings = self.run(Tool::rustc(), &self.rust_arguments(&shared))?;
                return Ok((shared.clone(), shared, warnings));
            }
            Language::Object => {
                fs::copy(self.path, &object).map_err(|error| cannot_read(self.path, &error))?;
                String::new()
            }
            Language::Shared => {
                fs::copy(self.path, &shared).map_err(|error| cannot_read(self.path, &error))?;
                return Ok((shared.clone(), shared, String::new()));
            }
        };
        if object::File::parse(&*fs::read(&object).unwrap_or_default()).is_err() {
            return Err(Unusable(format!("{} is not an object file", shown(self.path))));
        }
        let linked =
            self.run(Tool::cc(), &link_arguments(&object, &shared)).map_err(|error| self.in_other_words(error))?;
        Ok((shared, object, compiled + &linked))
    }

    /// The path as an argument of a tool: one that begins with `-` would be an option, one with `@`
    /// a file of options.
    fn argument(&self) -> OsString {
        match self.path.as_os_str().as_encoded_bytes().first() {
            Some(b'-' | b'@') => Path::new(".").join(self.path).into(),
            _ => self.path.into(),
        }
    }

    fn assemble(&self, object: &Path) -> Result<String, Unusable> {
        let written = write_includes(self.folder);
        written.map_err(|error| Unusable(format!("cannot write our include files: {error}")))?;
        let format = if cfg!(target_os = "macos") { "macho64" } else { "elf64" };
        let mut arguments: Vec<OsString> = ["-f", format, "-g"].map(OsString::from).into();
        // Our own folder comes first: a copy of our files beside the user's would not be guarded
        // against being read twice.
        for folder in [self.folder.to_owned(), self.folder.join("include"), parent(self.path)] {
            let mut argument = OsString::from("-I");
            argument.push(folder);
            argument.push("/");
            arguments.push(argument);
        }
        arguments.extend(self.flags.split_whitespace().map(OsString::from));
        arguments.extend(["-o".into(), object.into(), self.argument()]);
        self.run(Tool::nasm(), &arguments)
    }

    fn compile(&self, object: &Path) -> Result<String, Unusable> {
        let mut arguments: Vec<OsString> = ["-c", "-g", "-fPIC"].map(OsString::from).into();
        let flags = if self.flags.trim().is_empty() { "-O3" } else { self.flags };
        arguments.extend(flags.split_whitespace().map(OsString::from));
        arguments.extend(["-o".into(), object.into(), self.argument()]);
        self.run(Tool::cc(), &arguments)
    }

    fn rust_arguments(&self, shared: &Path) -> Vec<OsString> {
        let fixed =
            ["--crate-type", "cdylib", "--crate-name", "kernel", "-g", "-C", "panic=abort", "--edition", "2021"];
        let mut arguments: Vec<OsString> = fixed.map(OsString::from).into();
        let flags = if self.flags.trim().is_empty() { "-C opt-level=3" } else { self.flags };
        arguments.extend(flags.split_whitespace().map(OsString::from));
        arguments.extend(["-o".into(), shared.into(), self.argument()]);
        arguments
    }

    /// Runs a tool; what it says, if it is content.
    fn run(&self, tool: Tool, arguments: &[OsString]) -> Result<String, Unusable> {
        let name = shown(self.path);
        let mut command = Command::new(&tool.name);
        command.args(arguments).stdin(Stdio::null());
        let program = tool.name.to_string_lossy();
        let output = output_within(command).map_err(|error| match error.kind() {
            io::ErrorKind::NotFound => {
                Unusable(format!("{name} needs `{program}`, which is not there: {}", tool.missing))
            }
            _ => Unusable(format!("{name}: `{program}` cannot be run: {error}")),
        })?;
        let said = self.messages(&output);
        if output.status.success() {
            return Ok(said);
        }
        Err(Unusable(format!("{name} cannot be used: {program} says\n{}", said.trim_end())))
    }

    /// What a tool said, without the names of our own folder.
    fn messages(&self, output: &Output) -> String {
        let said = [&output.stdout[..], &output.stderr[..]].concat();
        let text = String::from_utf8_lossy(&said);
        let own = format!("{}/", self.folder.display());
        let lines = text
            .lines()
            .filter(|line| !line.contains("missing .note.GNU-stack") && !line.contains("NOTE: This behaviour"));
        lines.map(|line| line.replace(&own, "") + "\n").collect()
    }

    /// Says what to do about code that is not position-independent, which learners meet first.
    fn in_other_words(&self, error: Unusable) -> Unusable {
        let hint = "\nEvery address has to be relative to rip: write `default rel` at the top, and `wrt ..plt` after names of libc";
        let is_absolute = error.0.contains("relocation R_X86_64_32");
        Unusable(if is_absolute { error.0 + hint } else { error.0 })
    }
}

fn parent(path: &Path) -> PathBuf {
    path.parent().filter(|parent| *parent != Path::new("")).unwrap_or(Path::new(".")).to_owned()
}

fn link_arguments(object: &Path, shared: &Path) -> Vec<OsString> {
    let mut arguments: Vec<OsString> = vec!["-shared".into()];
    if cfg!(target_os = "linux") {
        arguments.extend(["-Wl,-z,defs", "-Wl,-z,noexecstack"].map(OsString::from));
    }
    arguments.extend([OsStr::new("-o"), shared.as_os_str(), object.as_os_str(), OsStr::new("-lm")].map(OsString::from));
    arguments
}

/// Our include files: as they are under `asm/include`, and by their names alone in wrappers.
fn write_includes(folder: &Path) -> io::Result<()> {
    fs::create_dir_all(folder.join("asm/include"))?;
    fs::create_dir_all(folder.join("include"))?;
    for include in INCLUDES {
        fs::write(folder.join("asm/include").join(include.name), include.text)?;
        fs::write(folder.join("include").join(include.name), include.wrapper())?;
    }
    Ok(())
}

/// The function to try: the one that is named, or that has the operation's name, or the only one.
///
/// # Errors
/// If there is none, or which one is meant is not clear: with those that there are.
pub fn function_of(built: &Built, symbol: Option<&str>, operation: Option<&str>) -> Result<String, Unusable> {
    let functions = built.functions();
    let name = &built.name;
    let list = functions.iter().take(12).map(|known| brief(known)).collect::<Vec<_>>().join(", ");
    let find = |wanted: &str| {
        let ours = format!("rayo_{wanted}");
        functions.iter().find(|known| *known == wanted).or(functions.iter().find(|known| **known == ours)).cloned()
    };
    match (symbol, operation) {
        (Some(symbol), _) => {
            find(symbol).ok_or_else(|| Unusable(format!("{name} has no function `{}`; it has: {list}", brief(symbol))))
        }
        (None, Some(operation)) => {
            let only = || (functions.len() == 1).then(|| functions[0].clone());
            find(operation).or_else(only).ok_or_else(|| {
                Unusable(format!(
                    "{name} has no function `{}`: name one with --symbol; it has: {list}",
                    brief(operation)
                ))
            })
        }
        (None, None) => Ok(functions[0].clone()),
    }
}

/// The operation that a file has a function of, if its name says so.
///
/// # Errors
/// If no name does, or several do.
pub fn operation_of(built: &Built, symbol: Option<&str>, operations: &[&str]) -> Result<String, Unusable> {
    let named = symbol.map_or_else(|| built.functions(), |symbol| vec![symbol.to_owned()]);
    let is_one = |function: &str, operation: &str| function.strip_prefix("rayo_").unwrap_or(function) == operation;
    let find = |function: &String| operations.iter().find(|operation| is_one(function, operation));
    let known: Vec<_> = named.iter().filter_map(find).collect();
    let all = operations.join(", ");
    match known[..] {
        [one] => Ok((*one).to_owned()),
        [] => Err(Unusable(format!(
            "{}: no function has the name of an operation, so --op has to say which it is: {all}; or --truth gives a formula",
            built.name
        ))),
        _ => Err(Unusable(format!("{}: it has functions of several operations: say which with --op", built.name))),
    }
}
