//! A file that appears whole or not at all: a hidden one beside the target, or the target where it cannot be renamed over.

use std::ffi::OsStr;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tempfile::{NamedTempFile, TempPath};
use thiserror::Error;

/// What becomes of a file that is there already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// The new file takes its place.
    Replace,
    /// It stays, and that there is one is an error.
    Keep,
}

/// Why a file could not be written. Every message names the file (`path`) and says what to do.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "path is what it is called in every variant")]
pub enum OutputError {
    /// There is something of that name, and it must not be replaced.
    #[error("{path} already exists: add --force to replace it, or name another file", path = path.display())]
    Exists { path: PathBuf },
    /// The file to replace is write-protected.
    #[error("{path} is write-protected: make it writable, or name another file", path = path.display())]
    ReadOnly { path: PathBuf },
    /// The directory of the file does not exist.
    #[error("cannot write {path}: there is no directory {directory}; create it first",
        path = path.display(), directory = directory.display())]
    NoDirectory {
        path: PathBuf,
        /// The one that is missing.
        directory: PathBuf,
    },
    /// The directory of the file takes no new files.
    #[error("cannot write {path}: no file can be created in the directory {directory} ({error}); \
        name one that you may write to", path = path.display(), directory = directory.display())]
    Directory {
        path: PathBuf,
        /// The one that refuses.
        directory: PathBuf,
        /// What the system says.
        error: io::ErrorKind,
    },
    /// Creating, writing, renaming or closing failed.
    #[error("cannot write {path}: {error}{}", advice(.error), path = path.display())]
    Write {
        path: PathBuf,
        /// What the system says.
        error: io::Error,
    },
}

/// What to do about a failed write, where there is something to say.
fn advice(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => "; free some space, or write to another disk",
        io::ErrorKind::FileTooLarge => "; the file system or a limit (ulimit -f) takes no larger file",
        io::ErrorKind::BrokenPipe => "; whatever was reading it has stopped",
        io::ErrorKind::IsADirectory => "; name a file in it",
        io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => "; name a file that you may write to",
        _ => "",
    }
}

/// A file in the making, written in order: it appears under its name when [`finish`](Self::finish)ed, and until then it
/// is a hidden file beside the target, which dropping removes.
///
/// Three kinds of target differ: a symbolic link stays and the file that it points to is replaced; what is no regular
/// file (`/dev/null`, a FIFO) is written to directly; and so is the program's own standard output under the name
/// `-` or `/dev/stdout`.
pub struct OutputFile {
    path: PathBuf,
    sink: Sink,
    destination: Destination,
}

impl OutputFile {
    /// Begins a file at `path`.
    ///
    /// # Errors
    /// If nothing can be written there.
    pub fn create(path: &Path, existing: Existing) -> Result<Self, OutputError> {
        let (destination, sink) = open(path, existing, false, &mut |_| ())?;
        Ok(OutputFile { path: path.into(), sink, destination })
    }

    /// Completes the file and gives it its name.
    ///
    /// # Errors
    /// If writing or renaming fails, now or before; then the target is as it was.
    pub fn finish(self) -> Result<(), OutputError> {
        let OutputFile { path, destination, .. } = self;
        destination.finish(path)
    }
}

impl Write for OutputFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.sink.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.sink.flush()
    }
}

/// The hidden files that exist now.
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

fn unfinished() -> MutexGuard<'static, Vec<PathBuf>> {
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Removes the hidden files of everything that is being written. For a process that is about to end: what is begun or
/// finished after this waits for that end.
pub fn remove_unfinished() {
    let mut paths = unfinished();
    for path in paths.drain(..) {
        // If it is gone already, all the better.
        let _ = fs::remove_file(path);
    }
    // Held for ever, so that no file is made between this and the end.
    std::mem::forget(paths);
}

/// Keeps a hidden file known to [`remove_unfinished`].
pub struct Unfinished(PathBuf);

impl Unfinished {
    /// A new file.
    fn create(path: &Path) -> io::Result<(File, Self)> {
        let mut paths = unfinished();
        let file = File::create_new(path)?;
        paths.push(path.into());
        Ok((file, Unfinished(path.into())))
    }

    /// A file of another process, which this one may outlive.
    #[cfg(feature = "mpi")]
    pub fn of_another(path: PathBuf) -> Self {
        unfinished().push(path.clone());
        Unfinished(path)
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        unfinished().retain(|path| *path != self.0);
    }
}

/// The file that is being written, and what makes it the target in the end.
pub(super) struct Destination {
    sink: Sink,
    end: End,
}

enum End {
    /// A file beside the target, which takes its name.
    Rename { temporary: TempPath, target: PathBuf, existing: Existing, _unfinished: Unfinished },
    /// The target itself, which is no file to rename over.
    Nothing,
    /// An anonymous file, which is copied to a target that cannot be written out of order.
    CopyTo(File),
}

/// Opens what to write to for an image at `path`. `seeking`: whether it will be written out of order. `announce` hears the
/// absolute path of a hidden file before that is made.
pub(super) fn open(
    path: &Path,
    existing: Existing,
    seeking: bool,
    announce: &mut dyn FnMut(&Path),
) -> Result<(Destination, Sink), OutputError> {
    let failed = |error| OutputError::Write { path: path.into(), error };
    if existing == Existing::Keep && fs::symlink_metadata(path).is_ok() {
        return Err(OutputError::Exists { path: path.into() });
    }
    let (file, end) = match direct(path).map_err(failed)? {
        Some(target) if seeking => (tempfile::tempfile().map_err(failed)?, End::CopyTo(target)),
        Some(target) => (target, End::Nothing),
        None => beside(path, existing, announce)?,
    };
    let sink = Sink::new(file);
    Ok((Destination { sink: sink.clone(), end }, sink))
}

/// Whether a name is that of the program's own standard output: `-`, `ppm:-` and the like, or a path of the system's.
pub fn is_standard_output(path: &Path) -> bool {
    let names = ["-", "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"];
    cfg!(unix) && (names.iter().any(|name| path == Path::new(name)) || format_of_standard_output(path).is_some())
}

/// The extension that stands before `:-`, which gives standard output a format.
pub(super) fn format_of_standard_output(path: &Path) -> Option<&OsStr> {
    path.to_str()?.strip_suffix(":-").map(OsStr::new)
}

/// The open target, if it is something to write to directly: no regular file, or one reached through a descriptor.
fn direct(path: &Path) -> io::Result<Option<File>> {
    #[cfg(unix)]
    if is_standard_output(path) {
        // The descriptor itself and not the path: it keeps the offset of `>> file`, and works on a socket.
        use std::os::fd::AsFd;
        return Ok(Some(io::stdout().as_fd().try_clone_to_owned()?.into()));
    }
    let descriptor = ["/dev/fd", "/dev/stderr", "/proc"].iter().any(|place| path.starts_with(place));
    match fs::metadata(path) {
        // For a directory, opening it says best what is wrong.
        Ok(metadata) if descriptor || !metadata.is_file() => {
            OpenOptions::new().write(true).truncate(true).open(path).map(Some)
        }
        Ok(_) => Ok(None),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    }
}

/// A new file in the target's directory.
fn beside(path: &Path, existing: Existing, announce: &mut dyn FnMut(&Path)) -> Result<(File, End), OutputError> {
    let target = behind_links(path).map_err(|error| OutputError::Write { path: path.into(), error })?;
    // A rename would not ask whether the old file may be written to.
    if fs::metadata(&target).is_ok_and(|metadata| metadata.permissions().readonly()) {
        return Err(OutputError::ReadOnly { path: path.into() });
    }
    let directory = match target.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    };
    // A file as any other: tempfile's own are for secrets, which nobody else may read.
    let make = |path: &Path| {
        announce(path);
        Unfinished::create(path)
    };
    let made = tempfile::Builder::new().prefix(".rayo-").suffix(".part").make_in(directory, make);
    let ((file, _unfinished), temporary) = made.map(NamedTempFile::into_parts).map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => OutputError::NoDirectory { path: path.into(), directory: directory.into() },
        error => OutputError::Directory { path: path.into(), directory: directory.into(), error },
    })?;
    Ok((file, End::Rename { temporary, target, existing, _unfinished }))
}

/// Follows symbolic links from `path` to what they end at, which need not exist.
fn behind_links(path: &Path) -> io::Result<PathBuf> {
    let mut path = path.to_path_buf();
    // As many as Linux follows; a loop of links has been an error before, when the metadata was asked for.
    for _ in 0..40 {
        match fs::symlink_metadata(&path) {
            Ok(metadata) if metadata.is_symlink() => {
                let link = fs::read_link(&path)?;
                path = path.parent().unwrap_or(Path::new("")).join(link);
            }
            _ => return Ok(path),
        }
    }
    Err(io::Error::other("too many symbolic links"))
}

impl Destination {
    /// The error of a write to `path`: what failed first, for an encoder's own error may have lost the kind of that one
    /// on its way.
    pub(super) fn explain(&self, path: &Path, error: io::Error) -> OutputError {
        OutputError::Write { path: path.into(), error: self.sink.attempt(|_| Ok(())).err().unwrap_or(error) }
    }

    /// How long the system has taken so far to take what was written.
    pub(super) fn writing(&self) -> Duration {
        self.sink.lock().out.get_ref().writing
    }

    /// Hands everything to the system and makes it the target; `path` is for messages.
    pub(super) fn finish(self, path: PathBuf) -> Result<(), OutputError> {
        self.complete().map_err(|error| match error.kind() {
            io::ErrorKind::AlreadyExists => OutputError::Exists { path },
            _ => OutputError::Write { path, error },
        })
    }

    fn complete(self) -> io::Result<()> {
        let Destination { sink, end } = self;
        sink.attempt(|out| out.flush())?;
        match end {
            End::Nothing => Ok(()),
            End::CopyTo(mut target) => sink.attempt(|out| {
                out.rewind()?;
                io::copy(&mut out.get_mut().file, &mut target).map(drop)
            }),
            End::Rename { temporary, target, existing, _unfinished } => match existing {
                Existing::Replace => temporary.persist(&target),
                Existing::Keep => temporary.persist_noclobber(&target),
            }
            .map_err(|failed| failed.error),
        }
    }
}

/// A buffered file that remembers its first failure, shared between an encoder and the [`Destination`].
///
/// The PNG encoder writes its last bytes from destructors, which cannot report an error: asking here is the only way to
/// know of it.
#[derive(Clone)]
pub(super) struct Sink(Arc<Mutex<Inner>>);

struct Inner {
    out: BufWriter<Timed>,
    failure: Option<io::Error>,
}

/// A file that knows how long the system took to take what was written.
struct Timed {
    file: File,
    writing: Duration,
}

impl Write for Timed {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let clock = Instant::now();
        let result = self.file.write(bytes);
        self.writing += clock.elapsed();
        result
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Seek for Timed {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        self.file.seek(position)
    }
}

impl Sink {
    fn new(file: File) -> Self {
        let out = BufWriter::with_capacity(1 << 16, Timed { file, writing: Duration::ZERO });
        Sink(Arc::new(Mutex::new(Inner { out, failure: None })))
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Does something with the file, unless something has failed before: then that is the error.
    fn attempt<T>(&self, action: impl FnOnce(&mut BufWriter<Timed>) -> io::Result<T>) -> io::Result<T> {
        let mut inner = self.lock();
        if let Some(failure) = &inner.failure {
            return Err(copy(failure));
        }
        let result = action(&mut inner.out);
        if let Err(error) = &result
            && error.kind() != io::ErrorKind::Interrupted
        {
            inner.failure = Some(copy(error));
        }
        result
    }
}

impl Seek for Sink {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        self.attempt(|out| out.seek(position))
    }
}

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.attempt(|out| out.write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.attempt(|out| out.flush())
    }
}

/// The same error again; `io::Error` cannot be cloned.
fn copy(error: &io::Error) -> io::Error {
    match error.raw_os_error() {
        Some(code) => io::Error::from_raw_os_error(code),
        None => io::Error::new(error.kind(), error.to_string()),
    }
}
