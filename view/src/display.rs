//! Opening the display: what is missing is found before winit is called, and said in one sentence.

use std::panic;

use winit::event_loop::EventLoop;

/// An event loop on the display of this process.
///
/// # Errors
/// One sentence that says what is missing.
pub fn open() -> Result<EventLoop<()>, String> {
    require_display()?;
    require_keyboard_library()?;
    // The messages of winit name its own source files, and it panics if the server lacks an
    // extension: neither is shown.
    let hook = panic::take_hook();
    panic::set_hook(Box::new(|_| ()));
    let opened = panic::catch_unwind(EventLoop::new);
    panic::set_hook(hook);
    match opened {
        Ok(Ok(event_loop)) => Ok(event_loop),
        Ok(Err(_)) | Err(_) => Err(cannot_be_opened()),
    }
}

/// The message for a display that is named but cannot be opened.
pub fn cannot_be_opened() -> String {
    let name = std::env::var("DISPLAY").unwrap_or_default();
    if is_x11() && !name.is_empty() {
        format!("the display {name} of the variable DISPLAY cannot be opened, or lacks what a window needs")
    } else {
        "the display cannot be opened, or lacks what a window needs".into()
    }
}

/// Whether this program opens its windows by X11 on this system.
fn is_x11() -> bool {
    cfg!(all(unix, not(target_vendor = "apple")))
}

fn require_display() -> Result<(), String> {
    let is_named = |variable: &str| std::env::var_os(variable).is_some_and(|value| !value.is_empty());
    if !is_x11() || is_named("DISPLAY") {
        Ok(())
    } else if is_named("WAYLAND_DISPLAY") || is_named("WAYLAND_SOCKET") {
        Err("this program opens its windows by X11 alone, and the variable DISPLAY names no server: start Xwayland"
            .into())
    } else {
        Err("there is no display to open a window on: the variable DISPLAY names none".into())
    }
}

#[cfg(all(unix, not(target_vendor = "apple")))]
fn require_keyboard_library() -> Result<(), String> {
    match xkbcommon_dl::x11::xkbcommon_x11_option() {
        Some(_) => Ok(()),
        None => Err("the library libxkbcommon-x11 is not installed, without which a window has no keys: Debian's \
            package is libxkbcommon-x11-0"
            .into()),
    }
}

#[cfg(not(all(unix, not(target_vendor = "apple"))))]
fn require_keyboard_library() -> Result<(), String> {
    Ok(())
}
