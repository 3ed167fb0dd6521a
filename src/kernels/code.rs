//! The machine code of this process, read in place.

/// The code from `address` to the end of its segment; None if no code of this crate's image is there.
///
/// The end of the function that begins there is not known.
#[cfg(target_os = "linux")]
pub fn code_at(address: usize) -> Option<&'static [u8]> {
    use std::ffi::{c_int, c_void};

    struct Search {
        address: usize,
        end: Option<usize>,
    }

    unsafe extern "C" fn visit(info: *mut libc::dl_phdr_info, _: usize, search: *mut c_void) -> c_int {
        // SAFETY: dl_iterate_phdr passes a valid description, and the pointer that it was given below.
        let (info, search) = unsafe { (&*info, &mut *search.cast::<Search>()) };
        if info.dlpi_phdr.is_null() {
            return 0;
        }
        // SAFETY: that many headers lie there.
        let headers = unsafe { std::slice::from_raw_parts(info.dlpi_phdr, info.dlpi_phnum.into()) };
        for header in headers {
            let start = info.dlpi_addr as usize + header.p_vaddr as usize;
            let end = start + header.p_filesz as usize;
            let readable_code = libc::PF_R | libc::PF_X;
            if header.p_type == libc::PT_LOAD
                && header.p_flags & readable_code == readable_code
                && (start..end).contains(&search.address)
                && (start..end).contains(&(code_at as fn(usize) -> Option<&'static [u8]> as usize))
            {
                search.end = Some(end);
                return 1;
            }
        }
        0
    }

    let mut search = Search { address, end: None };
    // SAFETY: visit() matches the signature, and `search` lives through the call.
    unsafe { libc::dl_iterate_phdr(Some(visit), (&raw mut search).cast()) };
    let end = search.end?;
    // SAFETY: both ends are in one segment that is mapped, readable, never written, and never unloaded while this function
    // can run, since it lies there too.
    Some(unsafe { std::slice::from_raw_parts(address as *const u8, end - address) })
}

/// The code from `address` on: not known here.
#[cfg(not(target_os = "linux"))]
pub fn code_at(_: usize) -> Option<&'static [u8]> {
    None
}
