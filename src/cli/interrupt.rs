//! Ctrl-C: the first asks the run to end in order, the second ends the process.

use crate::schedule::Stop;

/// What a run looks at between chunks.
pub static STOP: Stop = Stop::new();

/// Turns SIGINT, SIGTERM and SIGHUP into a wish to stop. Harmless when called again.
pub fn listen() {
    // Without a handler (it can be installed once per process) the signal simply ends the program.
    let _ = ctrlc::set_handler(|| {
        if STOP.is_requested() {
            std::process::exit(130);
        }
        STOP.request();
    });
}
