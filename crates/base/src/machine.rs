//! Threads, started in a way that reports a failure instead of panicking, and the memory of the machine.

use crate::error::{Error, Result};
use crate::files::{ThreadLogs, fault};
use std::error::Error as _;
use std::io;
use std::sync::OnceLock;
use std::thread::{Builder, Scope, ScopedJoinHandle};

/// Starts a thread in a scope. `name` is shown by the system, and appears in the error. The
/// [logs](crate::files::FileLog) of the present thread record the new one, too.
pub fn spawn_scoped<'scope, T: Send + 'scope>(
    scope: &'scope Scope<'scope, '_>,
    name: &str,
    work: impl FnOnce() -> T + Send + 'scope,
) -> Result<ScopedJoinHandle<'scope, T>> {
    try_spawn_scoped(scope, name, work).map_err(|e| Error::io("start the thread", name, e))
}

/// As [`spawn_scoped`], with the error of the system.
///
/// # Errors
/// The errors of [`Builder::spawn_scoped`].
pub fn try_spawn_scoped<'scope, T: Send + 'scope>(
    scope: &'scope Scope<'scope, '_>,
    name: &str,
    work: impl FnOnce() -> T + Send + 'scope,
) -> io::Result<ScopedJoinHandle<'scope, T>> {
    let logs = ThreadLogs::of_this_thread();
    let work = move || logs.record(work);
    fault::point().and_then(|()| Builder::new().name(name.to_owned()).spawn_scoped(scope, work))
}

/// Number of threads that this process can run at once; 1 where the system does not state it.
pub fn threads() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Memory that this process can have, bytes: the least of the machine's memory, the limit of its control
/// group, and the limit of its address space. `None` where the system does not state any.
pub fn memory() -> Option<u64> {
    let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
    let number = |text: Option<&str>| text.and_then(|word| word.parse::<u64>().ok());
    let field = |text: &str, name: &str| {
        let line = text.lines().find_map(|line| line.strip_prefix(name)).map(str::to_owned);
        number(line.as_deref().and_then(|line| line.split_whitespace().next()))
    };
    let total = field(&read("/proc/meminfo"), "MemTotal:").map(|kib| kib.saturating_mul(1024));
    let group = number(Some(read("/sys/fs/cgroup/memory.max").trim()));
    let space = field(&read("/proc/self/limits"), "Max address space");
    [total, group, space].into_iter().flatten().min()
}

/// The most memory that this process has had so far, bytes; `None` where the system does not state it.
pub fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.split_whitespace().next()?.parse::<u64>().ok().map(|kib| kib.saturating_mul(1024))
}

/// Starts the thread pool that all parallel iterators share, unless it is running; it can be started only
/// once.
///
/// # Errors
/// [`Error::Io`] if the system does not allow that many threads, one per core.
pub fn start_pool() -> Result<()> {
    static FAILURE: OnceLock<Option<String>> = OnceLock::new();
    let failure = FAILURE.get_or_init(|| {
        let started = rayon::ThreadPoolBuilder::new().build_global();
        // Without a cause, the program that uses this library has started the pool.
        started.err().filter(|e| e.source().is_some()).map(|e| e.to_string())
    });
    match failure {
        None => Ok(()),
        Some(reason) => Err(Error::io("start", "the shared threads", io::Error::other(reason.clone()))),
    }
}

/// Runs `work` in a separate thread pool. 0 threads means one per core.
pub fn with_pool<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> Result<T> {
    let failed = |e| Error::io("start", "the threads that load the scene", e);
    fault::point().map_err(failed)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let logs = ThreadLogs::of_this_thread();
    Ok(pool.map_err(|e| failed(io::Error::other(e)))?.install(|| logs.record(work)))
}

/// The number of cases of a comparison that takes long: an eighth of `all`, and all with `VLSCAN_ALL_CASES`
/// in the environment, as in continuous integration.
#[cfg(any(test, feature = "testkit"))]
pub fn cases(all: u32) -> u32 {
    if std::env::var_os("VLSCAN_ALL_CASES").is_some() { all } else { all.div_ceil(8) }
}

#[cfg(test)]
mod tests {
    #[test]
    #[cfg(target_os = "linux")]
    fn a_linux_machine_states_its_memory() {
        let memory = super::memory().unwrap();
        assert!((1 << 26..1 << 50).contains(&memory), "{memory}");
    }
}
