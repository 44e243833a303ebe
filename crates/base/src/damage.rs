//! Panics over damaged data: libraries that assert that a file is valid are called through
//! [`catch_decoder_panic`]. Texts of other panics.

use std::any::Any;
use std::cell::Cell;
use std::panic::{self, AssertUnwindSafe};
use std::sync::Once;

thread_local! {
    /// True if a panic of this thread is caught by [`catch_decoder_panic`].
    static IS_CAUGHT: Cell<bool> = const { Cell::new(false) };
}

/// Calls `decode`, which may go through a library that panics on damaged data (`laz` does), and returns
/// `None` when it panicked, without the message on stderr. State that the panic may have left inconsistent
/// must not be used afterwards.
pub fn catch_decoder_panic<T>(decode: impl FnOnce() -> T) -> Option<T> {
    install_panic_hook();
    // Decoders call each other.
    let is_caught = IS_CAUGHT.replace(true);
    let decoded = panic::catch_unwind(AssertUnwindSafe(decode));
    IS_CAUGHT.set(is_caught);
    decoded.ok()
}

/// Calls `work` as a part of `decode` in [`catch_decoder_panic`] that is not decoding: a panic shows its
/// message and is returned as the error.
///
/// # Errors
/// The panic.
pub fn outside_decoder<T>(work: impl FnOnce() -> T) -> std::thread::Result<T> {
    let is_caught = IS_CAUGHT.replace(false);
    let done = panic::catch_unwind(AssertUnwindSafe(work));
    IS_CAUGHT.set(is_caught);
    done
}

/// The text of a panic, for messages.
pub fn panic_text(payload: &(dyn Any + Send)) -> &str {
    let text = payload.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| payload.downcast_ref::<&str>().copied()).unwrap_or("a value that is not text")
}

/// Installs the panic hook that omits the messages of panics that are caught.
fn install_panic_hook() {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let default_hook = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            if !IS_CAUGHT.get() {
                default_hook(info);
            }
        }));
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_decoder_within_a_decoder_shows_no_message() {
        let shown = catch_decoder_panic(|| {
            assert_eq!(catch_decoder_panic(|| 7), Some(7));
            let inner = outside_decoder(|| catch_decoder_panic(|| IS_CAUGHT.get()));
            (IS_CAUGHT.get(), inner.unwrap())
        });
        assert_eq!((shown, IS_CAUGHT.get()), (Some((true, Some(true))), false));
    }

    #[test]
    fn a_panic_gives_none_and_a_result_is_passed_on() {
        assert_eq!(catch_decoder_panic(|| 7), Some(7));
        let outside =
            catch_decoder_panic(|| outside_decoder(|| assert!(std::hint::black_box(false), "sink")));
        assert_eq!(panic_text(&*outside.unwrap().unwrap_err()), "sink");
        let formatted = outside_decoder(|| assert!(std::hint::black_box(0) == 1, "of {}", 7));
        assert_eq!(panic_text(&*formatted.unwrap_err()), "of 7");
        assert_eq!(catch_decoder_panic(|| (0..3).collect::<Vec<_>>()[std::hint::black_box(3)]), None);
    }
}
