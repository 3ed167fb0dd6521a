//! A file that appears as a whole or not at all.
//!
//! The file is written beside the target, nameless or hidden, and takes the target's name in the
//! end. Targets that cannot be replaced, such as devices, are written to directly.

#[cfg(not(target_os = "linux"))]
mod unfinished;

use std::ffi::OsStr;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tempfile::{NamedTempFile, TempPath};
use thiserror::Error;

use crate::scene::shown;
#[cfg(not(target_os = "linux"))]
pub use unfinished::remove_unfinished;

/// What becomes of an existing file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// The new file replaces it.
    Replace,
    /// It is kept, and its existence is an error.
    Keep,
}

/// Why a file could not be written. Every message names the file (`path`) and says what to do.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "path is what it is called in every variant")]
pub enum OutputError {
    /// A file of that name exists and must not be replaced.
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
        /// The directory that does not exist.
        directory: PathBuf,
    },
    /// The name ends like that of a directory.
    #[error("{path} names a directory: name a file in it", path = shown(path))]
    NamesDirectory { path: PathBuf },
    /// No files can be created in the directory of the file.
    #[error("cannot write {path}: no file can be created in the directory {directory} ({error}); \
        name one that you may write to", path = shown(path), directory = shown(directory))]
    Directory {
        path: PathBuf,
        /// The directory in which no file can be created.
        directory: PathBuf,
        /// The system's error.
        error: io::ErrorKind,
    },
    /// Creating, writing, renaming or closing failed.
    #[error("cannot write {path}: {error}{}", advice(.error), path = shown(path))]
    Write {
        path: PathBuf,
        /// The system's error.
        error: io::Error,
    },
}

/// Advice for a failed write; empty if there is none.
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

/// A file that is being written in order; it appears under its name when it is
/// [`finish`](Self::finish)ed. Until then it has no name at all, so that nothing of it remains
/// however the process ends. On systems without nameless files it is a hidden file beside the
/// target, which is removed when this value is dropped. It gets the mode and, if permitted, the
/// owner of the file that it replaces. Other hard links to that file keep the old content.
///
/// Three kinds of target are treated differently. A symbolic link stays, and the file that it
/// points to is replaced. A target that is not a regular file (`/dev/null`, a FIFO) is written to
/// directly. So is the program's own standard output, under the name `-` or `/dev/stdout`.
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
        let (destination, sink) = open(path, existing, false)?;
        Ok(OutputFile { path: path.into(), sink, destination })
    }

    /// Completes the file and gives it its name.
    ///
    /// # Errors
    /// If writing or renaming fails, or a write has failed before. The target is then as it was.
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

/// The file that is being written, and what makes it the target in the end.
pub(super) struct Destination {
    sink: Sink,
    end: End,
}

enum End {
    /// A file in the target's directory, hidden or nameless, that will get the target's name.
    Rename { hidden: Option<Hidden>, target: PathBuf, existing: Existing },
    /// The file is the target itself.
    Nothing,
    /// A temporary file that is copied to the target, because the target cannot be written out of
    /// order.
    CopyTo(File),
}

/// A hidden file; it is removed when this value is dropped.
struct Hidden {
    temporary: TempPath,
    #[cfg(not(target_os = "linux"))]
    _unfinished: Option<unfinished::Unfinished>,
}

impl Hidden {
    /// Lets `make` create a file under a new name in the directory.
    fn make<T>(directory: &Path, mut make: impl FnMut(&Path) -> io::Result<T>) -> io::Result<(T, Self)> {
        #[cfg(not(target_os = "linux"))]
        let mut unfinished = None;
        // The files that tempfile creates by itself are private, which a picture should not be.
        let made = tempfile::Builder::new().prefix(".rayo-").suffix(".part").make_in(directory, |path| {
            #[cfg(not(target_os = "linux"))]
            unfinished.replace(unfinished::Unfinished::new(path));
            make(path)
        })?;
        let (made, temporary) = NamedTempFile::into_parts(made);
        let hidden = Hidden {
            temporary,
            #[cfg(not(target_os = "linux"))]
            _unfinished: unfinished,
        };
        Ok((made, hidden))
    }
}

/// A nameless file in a directory. It vanishes if it is closed before it gets a name.
#[cfg(target_os = "linux")]
fn nameless(directory: &Path) -> io::Result<File> {
    use std::os::unix::fs::OpenOptionsExt;
    let flags = rustix::fs::OFlags::TMPFILE.bits() as i32;
    // It must be readable, since it may have to be copied in the end.
    let file = OpenOptions::new().read(true).write(true).custom_flags(flags).open(directory)?;
    // Checks that the path exists through which the file can get a name in the end.
    fs::symlink_metadata(by_descriptor(&file)).map(|_| file)
}

#[cfg(target_os = "linux")]
fn by_descriptor(file: &File) -> String {
    use std::os::fd::AsRawFd;
    format!("/proc/self/fd/{}", file.as_raw_fd())
}

/// Gives a nameless file a name that nothing has.
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

/// Makes a hidden file of a nameless one, by `link` or, where the system refuses that, as sandboxes
/// do, by copying it.
fn hidden(
    file: &mut File,
    directory: &Path,
    mut link: impl FnMut(&File, &Path) -> io::Result<()>,
) -> io::Result<Hidden> {
    if let Ok(((), hidden)) = Hidden::make(directory, |path| link(file, path)) {
        return Ok(hidden);
    }
    let (mut copy, hidden) = Hidden::make(directory, |path| File::create_new(path))?;
    take_after(&copy, &file.metadata()?);
    file.rewind()?;
    io::copy(file, &mut copy)?;
    sync(&copy)?;
    Ok(hidden)
}

/// Waits until the content is on the disk. If the name came first, a power failure could leave an
/// empty file in place of the old one. Some network file systems report only now that there was no
/// room.
fn sync(file: &File) -> io::Result<()> {
    match file.sync_data() {
        // Some file systems do not support syncing, because they have nothing to do.
        Err(error) if matches!(error.kind(), io::ErrorKind::Unsupported | io::ErrorKind::InvalidInput) => Ok(()),
        result => result,
    }
}

/// Gives a file the mode of the file that it will replace, and its owner and group as far as this
/// process may. Failures are ignored, since some file systems have neither.
#[cfg(unix)]
fn take_after(file: &File, old: &fs::Metadata) {
    use std::os::unix::fs::{MetadataExt, PermissionsExt, fchown};
    if file.metadata().is_ok_and(|new| (new.uid(), new.gid()) != (old.uid(), old.gid())) {
        let _ = fchown(file, Some(old.uid()), Some(old.gid())).or_else(|_| fchown(file, None, Some(old.gid())));
    }
    // The picture must not inherit the set-user-ID and set-group-ID bits.
    let _ = file.set_permissions(fs::Permissions::from_mode(old.mode() & 0o777));
}

#[cfg(not(unix))]
fn take_after(_: &File, _: &fs::Metadata) {}

/// Opens the output for an image at `path`. `seeking` says whether it will be written out of order.
pub(super) fn open(path: &Path, existing: Existing, seeking: bool) -> Result<(Destination, Sink), OutputError> {
    let failed = |error| OutputError::Write { path: path.into(), error };
    if existing == Existing::Keep && fs::symlink_metadata(path).is_ok() {
        return Err(OutputError::Exists { path: path.into() });
    }
    if path.as_os_str().as_encoded_bytes().ends_with(b"/") {
        return Err(OutputError::NamesDirectory { path: path.into() });
    }
    let mut is_temporary = false;
    let (file, end) = match direct(path).map_err(failed)? {
        Some(target) if seeking => {
            is_temporary = true;
            let file = tempfile::tempfile().map_err(|error| unmade(path, &std::env::temp_dir(), error))?;
            (file, End::CopyTo(target))
        }
        Some(target) => (target, End::Nothing),
        None => beside(path, existing)?,
    };
    let sink = Sink::new(file, is_temporary);
    Ok((Destination { sink: sink.clone(), end }, sink))
}

/// Whether the name means the program's own standard output: `-`, `ppm:-` and the like, or a path
/// of the system's.
pub fn is_standard_output(path: &Path) -> bool {
    let names = ["-", "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"];
    cfg!(unix) && (names.iter().any(|name| path == Path::new(name)) || format_of_standard_output(path).is_some())
}

/// Whether the name means the program's own standard error.
pub fn is_standard_error(path: &Path) -> bool {
    ["/dev/stderr", "/dev/fd/2", "/proc/self/fd/2"].iter().any(|name| path == Path::new(name))
}

/// The extension before `:-`, which chooses the format of standard output.
pub(super) fn format_of_standard_output(path: &Path) -> Option<&OsStr> {
    path.to_str()?.strip_suffix(":-").filter(|format| !format.contains('/')).map(OsStr::new)
}

/// The open target, if it is to be written to directly: it is not a regular file, or it is reached
/// through a file descriptor.
fn direct(path: &Path) -> io::Result<Option<File>> {
    #[cfg(unix)]
    if is_standard_output(path) {
        // The descriptor itself is used and not its path: it keeps the offset of `>> file`, and
        // works for a socket.
        use std::os::fd::AsFd;
        if !crate::kernels::sys::is_open(1) {
            return Err(io::Error::other("standard output is closed"));
        }
        return Ok(Some(io::stdout().as_fd().try_clone_to_owned()?.into()));
    }
    let is_error = is_standard_error(path);
    #[cfg(unix)]
    if is_error && !crate::kernels::sys::is_open(2) {
        return Err(io::Error::other("standard error is closed"));
    }
    // Links of the system's own, such as /proc/self/fd/3, but not /proc/self/cwd/a.png.
    let of_system = |folder: &Path| folder.canonicalize().is_ok_and(|folder| folder.starts_with("/proc"));
    let descriptor = is_error || fs::read_link(path).is_ok() && path.parent().is_some_and(of_system);
    match fs::metadata(path) {
        // For a directory, the attempt to open it gives the clearest error.
        Ok(metadata) if descriptor || !metadata.is_file() => {
            OpenOptions::new().write(true).truncate(true).open(path).map(Some)
        }
        Ok(_) => Ok(None),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    }
}

/// Creates a new file in the target's directory.
fn beside(path: &Path, existing: Existing) -> Result<(File, End), OutputError> {
    let target = behind_links(path).map_err(|error| OutputError::Write { path: path.into(), error })?;
    let old = fs::metadata(&target).ok();
    // A rename does not check whether the old file may be written to.
    if old.as_ref().is_some_and(|metadata| metadata.permissions().readonly()) {
        return Err(OutputError::ReadOnly { path: path.into() });
    }
    let directory = directory(&target);
    let made = nameless(directory).map(|file| (file, None)).or_else(|_| {
        let (file, hidden) = Hidden::make(directory, |path| File::create_new(path))?;
        Ok((file, Some(hidden)))
    });
    let (file, hidden) = made.map_err(|error| unmade(path, directory, error))?;
    old.iter().for_each(|old| take_after(&file, old));
    Ok((file, End::Rename { hidden, target, existing }))
}

/// The error for a file that could not be created in a directory.
fn unmade(path: &Path, directory: &Path, error: io::Error) -> OutputError {
    let (path, directory) = (path.into(), PathBuf::from(directory));
    match error.kind() {
        io::ErrorKind::NotFound if !directory.is_dir() => OutputError::NoDirectory { path, directory },
        #[cfg(unix)]
        _ if error.raw_os_error() == Some(nix::errno::Errno::EMFILE as i32) => OutputError::Write { path, error },
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => OutputError::Write { path, error },
        error => OutputError::Directory { path, directory, error },
    }
}

/// The directory of a file.
fn directory(target: &Path) -> &Path {
    target.parent().filter(|parent| *parent != Path::new("")).unwrap_or(Path::new("."))
}

/// Follows symbolic links from `path` to their final target, which need not exist.
fn behind_links(path: &Path) -> io::Result<PathBuf> {
    let mut path = path.to_path_buf();
    // As many as Linux follows. A loop of links has failed before, when the metadata was read.
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
    /// The error of a write to `path`. It is the first failure of the file, since an encoder's own
    /// error may have lost its kind.
    pub(super) fn explain(&self, path: &Path, error: io::Error) -> OutputError {
        OutputError::Write { path: path.into(), error: self.sink.attempt(|_| Ok(())).err().unwrap_or(error) }
    }

    /// The time that the system has taken so far to accept what was written.
    pub(super) fn writing(&self) -> Duration {
        self.sink.lock().out.get_ref().writing
    }

    /// Flushes everything to the system and gives the file the target's name. `path` is for
    /// messages.
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
            End::Rename { hidden: named, target, existing } => {
                let named = sink.attempt(|out| {
                    let file = &mut out.get_mut().file;
                    sync(file)?;
                    named.map_or_else(|| hidden(file, directory(&target), give_name), Ok)
                });
                let hidden = named?;
                match existing {
                    Existing::Replace => hidden.temporary.persist(&target),
                    Existing::Keep => hidden.temporary.persist_noclobber(&target),
                }
                .map_err(|failed| failed.error)
            }
        }
    }
}

/// A buffered file that remembers its first failure, shared between an encoder and the
/// [`Destination`].
///
/// The PNG encoder writes its last bytes in destructors, which cannot report an error, so that the
/// failure has to be asked for here.
#[derive(Clone)]
pub(super) struct Sink(Arc<Mutex<Inner>>);

struct Inner {
    out: BufWriter<Timed>,
    failure: Option<io::Error>,
}

/// A file that measures how long the system takes to accept writes.
struct Timed {
    file: File,
    writing: Duration,
    is_temporary: bool,
}

impl Write for Timed {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let clock = Instant::now();
        let result = self.file.write(bytes);
        self.writing += clock.elapsed();
        result.map_err(|error| {
            let place = std::env::temp_dir();
            let told = || format!("{error}, in the directory {} of temporary files", shown(place));
            if self.is_temporary { io::Error::new(error.kind(), told()) } else { error }
        })
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
    fn new(file: File, is_temporary: bool) -> Self {
        let timed = Timed { file, writing: Duration::ZERO, is_temporary };
        let out = BufWriter::with_capacity(1 << 16, timed);
        Sink(Arc::new(Mutex::new(Inner { out, failure: None })))
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Applies `action` to the file, unless it has failed before; then it returns that error.
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

/// A copy of an error, since `io::Error` does not implement Clone.
fn copy(error: &io::Error) -> io::Error {
    match error.raw_os_error() {
        Some(code) => io::Error::from_raw_os_error(code),
        None => io::Error::new(error.kind(), error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_may_not_be_linked_is_copied() {
        let directory = tempfile::tempdir().unwrap();
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(b"content").unwrap();
        let refuse = |_: &File, _: &Path| Err(io::ErrorKind::PermissionDenied.into());
        let hidden = hidden(&mut file, directory.path(), refuse).unwrap();
        assert_eq!(fs::read(&hidden.temporary).unwrap(), b"content");
        assert_eq!(fs::metadata(&hidden.temporary).unwrap().permissions(), file.metadata().unwrap().permissions());
        drop(hidden);
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 0);
    }
}
