//! A file that appears whole or not at all: a hidden one beside the target, or the target where it cannot be renamed over.

use std::ffi::OsStr;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tempfile::{NamedTempFile, TempPath};
use thiserror::Error;

use crate::scene::shown;

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
    #[error("{path} already exists: add --force to replace it, or name another file", path = shown(path))]
    Exists { path: PathBuf },
    /// The file to replace is write-protected.
    #[error("{path} is write-protected: make it writable, or name another file", path = shown(path))]
    ReadOnly { path: PathBuf },
    /// The directory of the file does not exist.
    #[error("cannot write {path}: there is no directory {directory}; create it first",
        path = shown(path), directory = shown(directory))]
    NoDirectory {
        path: PathBuf,
        /// The one that is missing.
        directory: PathBuf,
    },
    /// The directory of the file takes no new files.
    #[error("cannot write {path}: no file can be created in the directory {directory} ({error}); \
        name one that you may write to", path = shown(path), directory = shown(directory))]
    Directory {
        path: PathBuf,
        /// The one that refuses.
        directory: PathBuf,
        /// What the system says.
        error: io::ErrorKind,
    },
    /// Creating, writing, renaming or closing failed.
    #[error("cannot write {path}: {error}{}", advice(.error), path = shown(path))]
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

/// A file in the making, written in order: it appears under its name when [`finish`](Self::finish)ed. Until then it has no name
/// at all, so that nothing is left of it however the process ends; where the system has no such files, it is a hidden file
/// beside the target, which dropping removes. It has the mode and, where that is permitted, the owner of the file that it
/// replaces; other names (hard links) of that one keep the old content.
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
    /// What `make` puts there.
    fn create<T>(path: &Path, make: impl FnOnce(&Path) -> io::Result<T>) -> io::Result<(T, Self)> {
        let mut paths = unfinished();
        let made = make(path)?;
        paths.push(path.into());
        Ok((made, Unfinished(path.into())))
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
    /// A file in the target's directory, hidden or still without a name, which takes that of the target.
    Rename { hidden: Option<Hidden>, target: PathBuf, existing: Existing },
    /// The target itself, which is no file to rename over.
    Nothing,
    /// An anonymous file, which is copied to a target that cannot be written out of order.
    CopyTo(File),
}

/// A hidden file, which dropping removes.
struct Hidden {
    temporary: TempPath,
    _unfinished: Unfinished,
}

impl Hidden {
    /// What `make` puts under a new name in the directory.
    fn make<T>(directory: &Path, mut make: impl FnMut(&Path) -> io::Result<T>) -> io::Result<(T, Self)> {
        // tempfile's own files are for secrets, which nobody else may read.
        let made = tempfile::Builder::new()
            .prefix(".rayo-")
            .suffix(".part")
            .make_in(directory, |path| Unfinished::create(path, &mut make))?;
        let ((made, _unfinished), temporary) = NamedTempFile::into_parts(made);
        Ok((made, Hidden { temporary, _unfinished }))
    }
}

/// A file in a directory that has no name there, and is gone when it is closed without one.
#[cfg(target_os = "linux")]
fn nameless(directory: &Path) -> io::Result<File> {
    use std::os::unix::fs::OpenOptionsExt;
    let flags = rustix::fs::OFlags::TMPFILE.bits() as i32;
    let file = OpenOptions::new().write(true).custom_flags(flags).open(directory)?;
    // By this it gets one in the end.
    fs::symlink_metadata(by_descriptor(&file)).map(|_| file)
}

#[cfg(target_os = "linux")]
fn by_descriptor(file: &File) -> String {
    use std::os::fd::AsRawFd;
    format!("/proc/self/fd/{}", file.as_raw_fd())
}

/// Gives such a file a name that is free.
#[cfg(target_os = "linux")]
fn give_name(file: &File, path: &Path) -> io::Result<()> {
    use rustix::fs::{AtFlags, CWD, linkat};
    Ok(linkat(CWD, by_descriptor(file), CWD, path, AtFlags::SYMLINK_FOLLOW)?)
}

#[cfg(not(target_os = "linux"))]
fn nameless(_: &Path) -> io::Result<File> {
    Err(io::ErrorKind::Unsupported.into())
}

#[cfg(not(target_os = "linux"))]
fn give_name(_: &File, _: &Path) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}

/// Gives a file the mode of the one that it will replace, and its owner and group as far as this process may: all of it is
/// a wish, since some file systems have neither.
#[cfg(unix)]
fn take_after(file: &File, old: &fs::Metadata) {
    use std::os::unix::fs::{MetadataExt, PermissionsExt, fchown};
    if file.metadata().is_ok_and(|new| (new.uid(), new.gid()) != (old.uid(), old.gid())) {
        let _ = fchown(file, Some(old.uid()), Some(old.gid())).or_else(|_| fchown(file, None, Some(old.gid())));
    }
    // What a program may do as its owner is not for a picture.
    let _ = file.set_permissions(fs::Permissions::from_mode(old.mode() & 0o777));
}

#[cfg(not(unix))]
fn take_after(_: &File, _: &fs::Metadata) {}

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
    path.to_str()?.strip_suffix(":-").filter(|format| !format.contains('/')).map(OsStr::new)
}

/// The open target, if it is something to write to directly: no regular file, or one reached through a descriptor.
fn direct(path: &Path) -> io::Result<Option<File>> {
    #[cfg(unix)]
    if is_standard_output(path) {
        // The descriptor itself and not the path: it keeps the offset of `>> file`, and works on a socket.
        use std::os::fd::AsFd;
        if !crate::kernels::sys::is_standard_output_open() {
            return Err(io::Error::other("standard output is closed"));
        }
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
    let old = fs::metadata(&target).ok();
    // A rename would not ask whether the old file may be written to.
    if old.as_ref().is_some_and(|metadata| metadata.permissions().readonly()) {
        return Err(OutputError::ReadOnly { path: path.into() });
    }
    let named = |path: &Path| {
        announce(path);
        File::create_new(path)
    };
    let directory = directory(&target);
    let made = nameless(directory).map(|file| (file, None)).or_else(|_| {
        let (file, hidden) = Hidden::make(directory, named)?;
        Ok((file, Some(hidden)))
    });
    let (file, hidden) = made.map_err(|error: io::Error| match error.kind() {
        io::ErrorKind::NotFound if !directory.is_dir() => {
            OutputError::NoDirectory { path: path.into(), directory: directory.into() }
        }
        error => OutputError::Directory { path: path.into(), directory: directory.into(), error },
    })?;
    old.iter().for_each(|old| take_after(&file, old));
    Ok((file, End::Rename { hidden, target, existing }))
}

/// The directory that a file is in.
fn directory(target: &Path) -> &Path {
    target.parent().filter(|parent| *parent != Path::new("")).unwrap_or(Path::new("."))
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
            End::Rename { hidden, target, existing } => {
                let name = |path: &Path| give_name(&sink.lock().out.get_ref().file, path);
                let hidden = hidden.map_or_else(|| Hidden::make(directory(&target), name).map(|made| made.1), Ok)?;
                match existing {
                    Existing::Replace => hidden.temporary.persist(&target),
                    Existing::Keep => hidden.temporary.persist_noclobber(&target),
                }
                .map_err(|failed| failed.error)
            }
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
