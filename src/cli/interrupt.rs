//! Ctrl-C: the first requests an orderly stop, the second ends the process.

use crate::schedule::Stop;

/// Stop request that a run checks between chunks.
pub static STOP: Stop = Stop::new();

/// Converts SIGINT, SIGTERM and SIGHUP to stop requests. Repeated calls have no effect.
pub fn listen() {
    // A handler can be installed once per process; without one the signal ends the program.
    let _ = ctrlc::set_handler(|| {
        if STOP.is_requested() {
            std::process::exit(130);
        }
        STOP.request();
    });
}
