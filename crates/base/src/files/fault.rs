//! Failures of chosen operations, for tests of runs on a failing machine.
//!
//! In builds with debug assertions the environment variable `VLSCAN_FAULT` names an operation by its number,
//! from 1: `VLSCAN_FAULT=7` fails the seventh operation of the process, `VLSCAN_FAULT=7+` every one from the
//! seventh on, and `VLSCAN_FAULT=7!` ends the process before it as a kill would. Other builds contain nothing
//! of it.

use std::io;

/// Fails if this is the chosen operation. To be called before an operation of the system that can fail:
/// creating, writing, synchronising and renaming a file, creating a folder, mapping memory, starting a
/// thread.
pub fn point() -> io::Result<()> {
    #[cfg(debug_assertions)]
    chosen::check()?;
    Ok(())
}

#[cfg(debug_assertions)]
mod chosen {
    use std::io;
    use std::sync::LazyLock;
    use std::sync::atomic::{AtomicU64, Ordering};

    static OPERATIONS: AtomicU64 = AtomicU64::new(0);

    /// The number of the first operation that fails, and the sign after it: `+` or `!`.
    static CHOSEN: LazyLock<Option<(u64, Option<char>)>> = LazyLock::new(|| {
        let text = std::env::var("VLSCAN_FAULT").ok()?;
        let number = text.trim_end_matches(['+', '!']).parse().ok()?;
        Some((number, text.chars().last().filter(|last| !last.is_ascii_digit())))
    });

    pub fn check() -> io::Result<()> {
        let Some((first, mark)) = *CHOSEN else { return Ok(()) };
        let number = OPERATIONS.fetch_add(1, Ordering::Relaxed) + 1;
        if number == first && mark == Some('!') {
            std::process::abort();
        }
        if number == first || mark == Some('+') && number > first {
            return Err(io::Error::new(
                io::ErrorKind::StorageFull,
                format!("injected failure of operation {first}"),
            ));
        }
        Ok(())
    }
}
