//! Mapped files of Linux: memory that is checked when it is first read, by handlers of the signals of its faults.

use super::{CHECKED_BYTES, Cause, Checksums, Loss};
use crate::damage;
use std::ffi::{c_int, c_void};
use std::fs::File;
use std::io::{Error, Result};
use std::ops::{Deref, Range};
use std::os::fd::{AsRawFd, RawFd};
use std::path::{Path, PathBuf};
use std::ptr;
use std::sync::atomic::{AtomicBool, AtomicI32, AtomicPtr, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use xxhash_rust::xxh3::Xxh3Default;

/// Maximum number of units of a file: a process can have 65 530 memory areas, and neighbouring units with and
/// without access are separate areas.
const MAX_UNITS: usize = 8192;

/// Bytes that the handler reads at once, into its stack.
const READ_BYTES: usize = 1 << 16;

/// A mapped file.
#[derive(Debug)]
pub struct Mapping {
    region: Arc<Region>,
    /// Keeps the descriptor in the region open.
    _file: File,
}

/// The memory of a mapping, as the signal handlers see it. It is freed when no handler can be looking at it any more.
#[derive(Debug)]
struct Region {
    start: usize,
    len: usize,
    /// Size of the units that are checked and replaced as a whole, a multiple of [`CHECKED_BYTES`].
    unit: usize,
    fd: RawFd,
    path: PathBuf,
    /// Whether the memory is mapped.
    is_live: AtomicBool,
    sums: OnceLock<Arc<Checksums>>,
    /// Whether each unit can be accessed.
    is_open: Box<[AtomicBool]>,
    /// The unit that was lost, and the [`Cause`] as a number.
    lost_unit: AtomicUsize,
    lost_cause: AtomicI32,
    next: AtomicPtr<Region>,
}

/// The regions of all mappings, as a linked list.
static REGIONS: AtomicPtr<Region> = AtomicPtr::new(ptr::null_mut());

/// Held while the list changes and while a loss is taken, and never by a handler.
static CHANGES: Mutex<()> = Mutex::new(());

/// Number of handlers that are looking at the list.
static READERS: AtomicUsize = AtomicUsize::new(0);

/// The region with the first loss that has not been taken. Such a region is not freed.
static LOST: AtomicPtr<Region> = AtomicPtr::new(ptr::null_mut());

/// The handlers of `SIGSEGV` and `SIGBUS` that were installed before ours.
static PREVIOUS: OnceLock<[libc::sigaction; 2]> = OnceLock::new();

const SIGNALS: [c_int; 2] = [libc::SIGSEGV, libc::SIGBUS];
const DAMAGED: i32 = -1;
const TRUNCATED: i32 = -2;

pub fn has_loss() -> bool {
    !LOST.load(Ordering::SeqCst).is_null()
}

/// Returns and clears the first loss.
pub fn take_loss() -> Option<Loss> {
    let _changes = lock_changes();
    let lost = LOST.swap(ptr::null_mut(), Ordering::SeqCst);
    // SAFETY: the pointer is null or that of a region, which is not freed as long as `LOST` names it, nor while the lock
    // is held.
    let region = unsafe { lost.as_ref() }?;
    damage::silence_panics(false);
    let cause = match region.lost_cause.load(Ordering::SeqCst) {
        DAMAGED => Cause::Damaged,
        TRUNCATED => Cause::Truncated,
        code => Cause::System(code),
    };
    Some(Loss {
        path: region.path.clone(),
        bytes: region.bytes_of(region.lost_unit.load(Ordering::SeqCst)),
        cause,
    })
}

impl Mapping {
    /// The region, to see whether it is freed.
    #[cfg(test)]
    pub fn region(&self) -> std::sync::Weak<impl Sized + use<>> {
        Arc::downgrade(&self.region)
    }

    /// Maps `len` bytes of a file, more than 0.
    pub fn new(file: File, path: &Path, len: u64) -> Result<Mapping> {
        install_handlers()?;
        let len = usize::try_from(len).map_err(|_| Error::from(std::io::ErrorKind::FileTooLarge))?;
        let fd = file.as_raw_fd();
        // SAFETY: a new read-only mapping at an address that the system chooses; the descriptor is open.
        let start = unsafe { libc::mmap(ptr::null_mut(), len, libc::PROT_READ, libc::MAP_SHARED, fd, 0) };
        if start == libc::MAP_FAILED {
            return Err(Error::last_os_error());
        }
        let unit = CHECKED_BYTES * len.div_ceil(CHECKED_BYTES).div_ceil(MAX_UNITS);
        let region = Arc::new(Region {
            start: start as usize,
            len,
            unit,
            fd,
            path: path.to_path_buf(),
            is_live: AtomicBool::new(true),
            sums: OnceLock::new(),
            is_open: (0..len.div_ceil(unit)).map(|_| AtomicBool::new(true)).collect(),
            lost_unit: AtomicUsize::new(0),
            lost_cause: AtomicI32::new(0),
            next: AtomicPtr::new(ptr::null_mut()),
        });
        let _changes = lock_changes();
        region.next.store(REGIONS.load(Ordering::SeqCst), Ordering::SeqCst);
        REGIONS.store(Arc::as_ptr(&region).cast_mut(), Ordering::SeqCst);
        Ok(Mapping { region, _file: file })
    }

    /// See [`super::FileBytes::release`]. After a loss nothing is released, since the memory of a lost part has no
    /// file.
    pub fn release(&self, bytes: Range<usize>) {
        let bytes = bytes.start.next_multiple_of(CHECKED_BYTES)..bytes.end.min(self.region.len);
        if bytes.is_empty() || has_loss() {
            return;
        }
        let start = (self.region.start + bytes.start) as *mut c_void;
        // SAFETY: the bytes are within the mapping and begin at a page; its pages are those of a file, which keep
        // their content. If the call fails, they stay in memory.
        unsafe { libc::madvise(start, bytes.len(), libc::MADV_DONTNEED) };
    }

    /// Removes the access to all units; the handler permits it again, unit by unit.
    pub fn protect(&self, sums: Arc<Checksums>) -> Result<()> {
        let region = &self.region;
        if region.sums.set(sums).is_ok() {
            region.is_open.iter().for_each(|open| open.store(false, Ordering::SeqCst));
            region.set_access(0..region.len, libc::PROT_NONE)?;
        }
        Ok(())
    }

    /// Hashes bytes as they are in the file.
    pub fn hash(&self, bytes: Range<usize>, hasher: &mut Xxh3Default) -> std::result::Result<(), Cause> {
        self.region.hash(bytes, hasher).map_err(|code| match code {
            TRUNCATED => Cause::Truncated,
            code => Cause::System(code),
        })
    }
}

impl Deref for Mapping {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        // SAFETY: the mapping is `len` bytes long and exists as long as `self`. Access to memory that the region has
        // withdrawn is permitted by the handler before it takes place. Other programs can change the file; every byte
        // is a valid value.
        unsafe { std::slice::from_raw_parts(self.region.start as *const u8, self.region.len) }
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        self.region.is_live.store(false, Ordering::SeqCst);
        // SAFETY: the mapping belongs to `self`, and slices of it borrow from `self`.
        unsafe { libc::munmap(self.region.start as *mut c_void, self.region.len) };
        remove(&self.region);
    }
}

fn lock_changes() -> MutexGuard<'static, ()> {
    CHANGES.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Removes a region from the list and waits until no handler can have a pointer to it.
fn remove(region: &Arc<Region>) {
    let _changes = lock_changes();
    let own = Arc::as_ptr(region).cast_mut();
    let mut place = &REGIONS;
    loop {
        let next = place.load(Ordering::SeqCst);
        if next == own {
            break;
        }
        // SAFETY: a region in the list is freed only after it has been removed, and the lock is held.
        let Some(other) = (unsafe { next.as_ref() }) else { return };
        place = &other.next;
    }
    place.store(region.next.load(Ordering::SeqCst), Ordering::SeqCst);
    // Handlers that begin from now on do not find it.
    while READERS.load(Ordering::SeqCst) != 0 {
        std::thread::yield_now();
    }
    if LOST.load(Ordering::SeqCst) == own {
        std::mem::forget(region.clone());
    }
}

// The functions below are called by the handlers: they allocate nothing and take no lock.

impl Region {
    /// The bytes of a unit of the file.
    fn bytes_of(&self, unit: usize) -> Range<usize> {
        unit * self.unit..((unit + 1) * self.unit).min(self.len)
    }

    fn set_access(&self, bytes: Range<usize>, access: c_int) -> Result<()> {
        // SAFETY: the bytes are within the mapping and begin at a page.
        match unsafe { libc::mprotect((self.start + bytes.start) as *mut c_void, bytes.len(), access) } {
            0 => Ok(()),
            _ => Err(Error::last_os_error()),
        }
    }

    /// Hashes bytes of the file. The error is [`TRUNCATED`] or the number of the system's error.
    fn hash(&self, bytes: Range<usize>, hasher: &mut Xxh3Default) -> std::result::Result<(), i32> {
        let mut buffer = [0u8; READ_BYTES];
        let mut at = bytes.start;
        while at < bytes.end {
            let count = READ_BYTES.min(bytes.end - at);
            // SAFETY: the buffer has room for `count` bytes, and the descriptor is open as long as the mapping.
            let read = unsafe { libc::pread(self.fd, buffer.as_mut_ptr().cast(), count, at as libc::off_t) };
            match usize::try_from(read) {
                Ok(0) => return Err(TRUNCATED),
                Ok(read) => {
                    hasher.update(&buffer[..read]);
                    at += read;
                }
                Err(_) => match errno() {
                    libc::EINTR => {}
                    code => return Err(code),
                },
            }
        }
        Ok(())
    }

    /// Compares the checksums of a unit. The error is the cause of a loss as a number.
    fn check(&self, sums: &Checksums, unit: usize) -> std::result::Result<(), i32> {
        let blocks = self.unit / CHECKED_BYTES;
        for i in unit * blocks..(unit + 1) * blocks {
            let bytes = sums.block(i);
            if bytes.is_empty() {
                continue;
            }
            let mut hasher = Xxh3Default::new();
            self.hash(bytes, &mut hasher)?;
            if sums.sums.get(i) != Some(&hasher.digest()) {
                return Err(DAMAGED);
            }
        }
        Ok(())
    }

    /// Makes the byte at an address readable after a signal; `false` if the signal has another reason.
    fn resolve(&self, signal: c_int, address: usize) -> bool {
        let unit = (address - self.start) / self.unit;
        let open = &self.is_open[unit];
        let checked = match self.sums.get() {
            Some(sums) if !open.load(Ordering::SeqCst) => self.check(sums, unit),
            // Another thread has permitted the access meanwhile.
            Some(_) if signal == libc::SIGSEGV => return true,
            None if signal == libc::SIGSEGV => return false,
            _ => Err(if self.is_shortened() { TRUNCATED } else { libc::EIO }),
        };
        let opened = checked.and_then(|()| {
            self.set_access(self.bytes_of(unit), libc::PROT_READ)
                .map_err(|e| e.raw_os_error().unwrap_or(libc::ENOMEM))
        });
        let is_resolved = match opened {
            Ok(()) => true,
            Err(cause) => self.lose(unit, cause),
        };
        open.store(true, Ordering::SeqCst);
        is_resolved
    }

    fn is_shortened(&self) -> bool {
        // SAFETY: `stat` is plain data for which zeros are valid, and the descriptor is open.
        unsafe {
            let mut about: libc::stat = std::mem::zeroed();
            libc::fstat(self.fd, &raw mut about) == 0 && (about.st_size as u64) < self.len as u64
        }
    }

    /// Records the loss of a unit and replaces its memory; `false` if the system does not allow that.
    fn lose(&self, unit: usize, cause: i32) -> bool {
        if !has_loss() {
            self.lost_unit.store(unit, Ordering::SeqCst);
            self.lost_cause.store(cause, Ordering::SeqCst);
            let own = ptr::from_ref(self).cast_mut();
            let _ = LOST.compare_exchange(ptr::null_mut(), own, Ordering::SeqCst, Ordering::SeqCst);
        }
        damage::silence_panics(true);
        let bytes = self.bytes_of(unit);
        let access = libc::PROT_READ | libc::PROT_WRITE;
        let flags = libc::MAP_PRIVATE | libc::MAP_ANONYMOUS | libc::MAP_FIXED;
        let start = (self.start + bytes.start) as *mut c_void;
        // SAFETY: the unit lies within the mapping of this region, begins at a page, and is only read by others;
        // every bit pattern is a valid value for them.
        unsafe {
            let replaced = libc::mmap(start, bytes.len(), access, flags, -1, 0);
            if replaced != libc::MAP_FAILED {
                ptr::write_bytes(start.cast::<u8>(), 0xff, bytes.len());
            }
            replaced != libc::MAP_FAILED
        }
    }
}

fn install_handlers() -> Result<()> {
    damage::install_panic_hook();
    if PREVIOUS.get().is_some() {
        return Ok(());
    }
    // SAFETY: `sigaction` is plain data for which zeros are valid; the handler has the signature that `SA_SIGINFO`
    // asks for, and only makes calls that are allowed in handlers. It is installed once more in a race of two
    // threads, whose previous handlers are then those of the first.
    unsafe {
        let mut previous: [libc::sigaction; 2] = std::mem::zeroed();
        for (signal, previous) in SIGNALS.into_iter().zip(&mut previous) {
            if libc::sigaction(signal, ptr::null(), previous) != 0 {
                return Err(Error::last_os_error());
            }
        }
        if PREVIOUS.set(previous).is_err() {
            return Ok(());
        }
        for signal in SIGNALS {
            let mut action: libc::sigaction = std::mem::zeroed();
            let handler: unsafe extern "C" fn(c_int, *mut libc::siginfo_t, *mut c_void) = on_fault;
            action.sa_sigaction = handler as libc::sighandler_t;
            // Without `SA_ONSTACK`: the handler needs more stack than the alternative one has.
            action.sa_flags = libc::SA_SIGINFO;
            if libc::sigaction(signal, &raw const action, ptr::null_mut()) != 0 {
                return Err(Error::last_os_error());
            }
        }
    }
    Ok(())
}

fn errno() -> c_int {
    // SAFETY: the address of the thread's error number is always valid.
    unsafe { *libc::__errno_location() }
}

/// # Safety
/// Called by the system with the information on a signal.
unsafe extern "C" fn on_fault(signal: c_int, info: *mut libc::siginfo_t, context: *mut c_void) {
    let before = errno();
    // SAFETY: the system passes valid information.
    let address = unsafe { (*info).si_addr() } as usize;
    READERS.fetch_add(1, Ordering::SeqCst);
    let mut next = REGIONS.load(Ordering::SeqCst);
    // SAFETY: the list ends with null, and no region is freed that was in it while `READERS` counts this handler.
    while let Some(region) = unsafe { next.as_ref() } {
        let is_within = (region.start..region.start + region.len.next_multiple_of(4096)).contains(&address);
        if is_within && region.is_live.load(Ordering::SeqCst) && region.resolve(signal, address) {
            READERS.fetch_sub(1, Ordering::SeqCst);
            // SAFETY: the address of the thread's error number is always valid.
            unsafe { *libc::__errno_location() = before };
            return;
        }
        next = region.next.load(Ordering::SeqCst);
    }
    READERS.fetch_sub(1, Ordering::SeqCst);
    // SAFETY: the arguments are passed on as they came.
    unsafe { pass_on(signal, info, context) };
}

/// Calls the previous handler of a signal, or ends the process as without a handler.
///
/// # Safety
/// The arguments must be those of a handler.
unsafe fn pass_on(signal: c_int, info: *mut libc::siginfo_t, context: *mut c_void) {
    let previous = PREVIOUS.get().map(|all| all[usize::from(signal == libc::SIGBUS)]);
    match previous {
        Some(p) if p.sa_sigaction != libc::SIG_DFL && p.sa_sigaction != libc::SIG_IGN => {
            // SAFETY: it was installed as a handler with or without `SA_SIGINFO`; one without ignores the further
            // arguments, which the calling conventions of all targets of Linux allow.
            unsafe {
                let handler: extern "C" fn(c_int, *mut libc::siginfo_t, *mut c_void) =
                    std::mem::transmute(p.sa_sigaction);
                handler(signal, info, context);
            }
        }
        _ => {
            // SAFETY: the default action is restored; the access is repeated and ends the process.
            unsafe { libc::signal(signal, libc::SIG_DFL) };
        }
    }
}
