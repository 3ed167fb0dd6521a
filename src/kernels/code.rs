//! The machine code of this process, read where it lies in memory.

/// The code from `address` to the end of its segment. None if the address has no code of this
/// crate's image or of an image that was loaded for good.
///
/// Where the function at `address` ends is not known.
#[cfg(target_os = "linux")]
pub fn code_at(address: usize) -> Option<&'static [u8]> {
    segment_at(address).and_then(|(segment, is_code)| is_code.then_some(segment))
}

/// The constants of this crate's image from `address` to the end of their segment. None if the
/// address has none.
#[cfg(target_os = "linux")]
pub fn constants_at(address: usize) -> Option<&'static [u8]> {
    segment_at(address).map(|(segment, _)| segment)
}

/// The base addresses of images that were loaded for good, whose code may be read like this
/// crate's.
#[cfg(target_os = "linux")]
static LOADED: std::sync::Mutex<Vec<usize>> = std::sync::Mutex::new(Vec::new());

/// The base address of the image that was loaded from `file`, and that is never unloaded.
#[cfg(target_os = "linux")]
pub(super) fn base_of(file: &std::ffi::CStr) -> Option<usize> {
    use std::ffi::{CStr, c_int, c_void};

    struct Search<'a> {
        file: &'a CStr,
        base: Option<usize>,
    }

    unsafe extern "C" fn visit(info: *mut libc::dl_phdr_info, _: usize, search: *mut c_void) -> c_int {
        // SAFETY: dl_iterate_phdr passes a valid description, and the pointer that it was given
        // below.
        let (info, search) = unsafe { (&*info, &mut *search.cast::<Search<'_>>()) };
        // SAFETY: the name is null or ends in 0.
        if !info.dlpi_name.is_null() && unsafe { CStr::from_ptr(info.dlpi_name) } == search.file {
            search.base = Some(info.dlpi_addr as usize);
        }
        search.base.is_some().into()
    }

    let mut search = Search { file, base: None };
    // SAFETY: visit() matches the signature, and `search` lives through the call.
    unsafe { libc::dl_iterate_phdr(Some(visit), (&raw mut search).cast()) };
    let base = search.base?;
    LOADED.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).push(base);
    Some(base)
}

/// The base addresses of other images are not known on this system.
#[cfg(all(unix, not(target_os = "linux")))]
pub(super) fn base_of(_: &std::ffi::CStr) -> Option<usize> {
    None
}

/// The memory of this crate's image from `address` to the end of its segment, if that is never
/// written, and whether it is code.
#[cfg(target_os = "linux")]
fn segment_at(address: usize) -> Option<(&'static [u8], bool)> {
    use std::ffi::{c_int, c_void};
    use std::ops::Range;

    struct Search {
        address: usize,
        loaded: Vec<usize>,
        found: Option<(usize, bool)>,
    }

    unsafe extern "C" fn visit(info: *mut libc::dl_phdr_info, _: usize, search: *mut c_void) -> c_int {
        // SAFETY: dl_iterate_phdr passes a valid description, and the pointer that it was given
        // below.
        let (info, search) = unsafe { (&*info, &mut *search.cast::<Search>()) };
        if info.dlpi_phdr.is_null() {
            return 0;
        }
        // SAFETY: the image has this number of headers at this address.
        let headers = unsafe { std::slice::from_raw_parts(info.dlpi_phdr, info.dlpi_phnum.into()) };
        let addresses = |header: &libc::Elf64_Phdr| -> Range<usize> {
            let start = info.dlpi_addr as usize + header.p_vaddr as usize;
            start..start + header.p_filesz as usize
        };
        let loaded = || {
            headers.iter().filter(|header| {
                header.p_type == libc::PT_LOAD && header.p_flags & libc::PF_R != 0 && header.p_flags & libc::PF_W == 0
            })
        };
        let own = code_at as fn(usize) -> Option<&'static [u8]> as usize;
        let is_known = search.loaded.contains(&(info.dlpi_addr as usize));
        if !is_known && !loaded().any(|header| addresses(header).contains(&own)) {
            return 0;
        }
        if let Some(header) = loaded().find(|header| addresses(header).contains(&search.address)) {
            search.found = Some((addresses(header).end, header.p_flags & libc::PF_X != 0));
        }
        search.found.is_some().into()
    }

    let loaded = LOADED.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).clone();
    let mut search = Search { address, loaded, found: None };
    // SAFETY: visit() matches the signature, and `search` lives through the call.
    unsafe { libc::dl_iterate_phdr(Some(visit), (&raw mut search).cast()) };
    let (end, is_code) = search.found?;
    // SAFETY: both ends are in one segment that is mapped, readable, never written, and never
    // unloaded while this function can run: it belongs to the image of this function, or to one
    // that was loaded for good.
    Some((unsafe { std::slice::from_raw_parts(address as *const u8, end - address) }, is_code))
}

/// The code from `address` on is not known on this system.
#[cfg(not(target_os = "linux"))]
pub fn code_at(_: usize) -> Option<&'static [u8]> {
    None
}

/// The constants from `address` on are not known on this system.
#[cfg(not(target_os = "linux"))]
pub fn constants_at(_: usize) -> Option<&'static [u8]> {
    None
}
