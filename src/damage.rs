//! Libraries that assert that a file is sound, where it may be damaged.

use std::cell::Cell;
use std::panic::{self, AssertUnwindSafe};
use std::sync::Once;

thread_local! {
    /// Whether a panic of this thread is caught by [`survive`].
    static CAUGHT: Cell<bool> = const { Cell::new(false) };
}

/// Does what leads through a library that panics on damaged data (`laz` does); `None` when it has. Nothing that the panic
/// may have left half done is to be used afterwards.
pub(crate) fn survive<T>(read: impl FnOnce() -> T) -> Option<T> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let usual = panic::take_hook();
        panic::set_hook(Box::new(move |about| {
            if !CAUGHT.get() {
                usual(about);
            }
        }));
    });
    CAUGHT.set(true);
    let done = panic::catch_unwind(AssertUnwindSafe(read));
    CAUGHT.set(false);
    done.ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_panics_is_survived_and_what_does_not_is_passed_on() {
        assert_eq!(survive(|| 7), Some(7));
        assert_eq!(survive(|| (0..3).collect::<Vec<_>>()[std::hint::black_box(3)]), None);
    }
}
