//! Ctrl-C and other requests to end. While a run measures, the first one stops it in order; at any other
//! time, and the second time, it ends the process, which leaves no temporary files.

use super::Console;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use vlscan_base::error::Error;
use vlscan_base::files;
use vlscan_warehouse::Stop;

/// Stop request that a run checks between chunks.
pub static STOP: Stop = Stop::new();

/// True if a signal has arrived.
static SIGNALLED: AtomicBool = AtomicBool::new(false);

/// How long a stopped run waits for the readers of its streams, and the end of the process for that of its
/// messages.
const GRACE: Duration = Duration::from_secs(2);

/// Handles SIGINT, SIGTERM and SIGHUP from now on.
pub fn listen(console: &Console) {
    let console = console.clone();
    // A handler can be installed once per process; without one the signal ends the program.
    let _ = ctrlc::set_handler(move || {
        if SIGNALLED.swap(true, Ordering::Relaxed) || !STOP.has_open_outputs() {
            end(console.clone());
        }
        STOP.request();
        files::limit_waiting(GRACE);
    });
}

/// True if the user has requested the end.
pub fn is_signalled() -> bool {
    SIGNALLED.load(Ordering::Relaxed)
}

/// Ends the process.
fn end(console: Console) -> ! {
    files::remove_temporary();
    let (done, is_done) = flume::bounded(1);
    // A full pipe must not keep the process.
    let started = std::thread::Builder::new().spawn(move || {
        console.failure(&Error::Interrupted);
        let _ = done.send(());
    });
    if started.is_ok() {
        let _ = is_done.recv_timeout(GRACE);
    }
    std::process::exit(i32::from(Error::Interrupted.exit_status()));
}
