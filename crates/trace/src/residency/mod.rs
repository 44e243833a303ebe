//! Residency: items of a scene that are loaded when rays need them and dropped when memory is short.
//!
//! A [`Residency`] holds items of any kinds within one budget of bytes. [`Residency::add`] registers the
//! items of one kind with the function that loads them. Every thread has its own [`Pins`]: an item that it
//! takes stays in memory until the thread releases it, which it does after each packet of rays. Items that
//! nobody holds are dropped when another needs their memory, the least recently used first.
//!
//! The resident items affect the time of tracing, never its result: an item that cannot be loaded, or that
//! would take the items of one packet beyond the budget, is reported by [`Pins::release`], and the packet
//! does not count.
//!
//! A thread that needs room waits for others to release theirs, so threads together keep to the budget, too,
//! as long as one of them can go on. Where all wait for one another, one of them goes beyond the budget
//! rather than stopping forever; [`ResidencyStatistics::peak`] shows it.

mod pins;
#[cfg(test)]
mod tests;

pub use pins::{PinError, Pins};

use std::any::Any;
use std::error::Error;
use std::marker::PhantomData;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Why an item could not be loaded.
pub type LoadError = Arc<dyn Error + Send + Sync>;

/// An item of any kind.
type Content = Arc<dyn Any + Send + Sync>;
/// Loads the item with this index among those of its kind, and returns its bytes.
type Loader = Arc<dyn Fn(usize) -> Result<(Content, u64), LoadError> + Send + Sync>;

/// Number of packets for which an item that no packet needs any more is safe from [`Residency::prefetch`].
const RECENT_PACKETS: u64 = 4096;

/// Items that share a budget of memory.
pub struct Residency {
    budget: u64,
    state: Mutex<State>,
    /// An item was loaded or released, or a thread began to wait.
    changed: Condvar,
}

#[derive(Default)]
struct State {
    items: Vec<Item>,
    loaders: Vec<Loader>,
    /// Bytes of all items that are resident or being loaded.
    used: u64,
    /// Number of packets that were released.
    clock: u64,
    /// Threads whose packet has taken an item, and those of them that wait.
    active: usize,
    waiting: usize,
    statistics: ResidencyStatistics,
}

struct Item {
    /// Bytes: an estimate until `are_bytes_known`, after it has been loaded once.
    bytes: u64,
    are_bytes_known: bool,
    content: Slot,
    /// Number of packets that hold it.
    pins: u32,
    /// [`State::clock`] when it was used last.
    last_use: u64,
    loader: u32,
    /// Its index among the items of its kind.
    index: u32,
}

enum Slot {
    Absent,
    Loading,
    Resident(Content),
    Failed(LoadError),
}

/// The items of one kind in a [`Residency`].
pub struct Paged<T> {
    residency: Arc<Residency>,
    first: usize,
    len: usize,
    kind: PhantomData<fn() -> T>,
}

/// Statistics of a [`Residency`] so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ResidencyStatistics {
    /// Items that were loaded, again after they were dropped included.
    pub loaded: u64,
    /// Items among them that were loaded before a packet needed them.
    pub prefetched: u64,
    /// Items that were dropped.
    pub dropped: u64,
    /// How often a packet found an item in memory.
    pub hits: u64,
    /// How often a packet had to wait until an item was loaded.
    pub misses: u64,
    /// Number and bytes of the items that are resident.
    pub resident: (u64, u64),
    /// Maximum bytes of all resident items together.
    pub peak: u64,
    /// Time spent in the functions that load, by all threads together.
    pub load_time: Duration,
}

impl ResidencyStatistics {
    /// Share of the accesses that found their item in memory, 0–1; 1 without accesses.
    pub fn hit_rate(&self) -> f64 {
        let all = self.hits + self.misses;
        if all == 0 { 1.0 } else { self.hits as f64 / all as f64 }
    }
}

impl Residency {
    /// An empty residency for `budget` bytes.
    pub fn new(budget: u64) -> Arc<Residency> {
        Arc::new(Residency { budget, state: Mutex::default(), changed: Condvar::new() })
    }

    /// The budget, bytes.
    pub fn budget(&self) -> u64 {
        self.budget
    }

    /// Registers items of one kind, each with its approximate bytes. `load` loads the item with an index in
    /// this kind and tells its bytes; it must return the same item whenever it is called, and must not take
    /// items itself.
    pub fn add<T: Send + Sync + 'static>(
        self: &Arc<Self>,
        bytes: impl IntoIterator<Item = u64>,
        load: impl Fn(usize) -> Result<(T, u64), LoadError> + Send + Sync + 'static,
    ) -> Paged<T> {
        let mut state = self.lock();
        let (first, loader) = (state.items.len(), state.loaders.len() as u32);
        state
            .loaders
            .push(Arc::new(move |index| load(index).map(|(item, bytes)| (Arc::new(item) as Content, bytes))));
        state.items.extend((0..).zip(bytes).map(|(index, bytes)| Item {
            // What is larger than the budget is found out when it is loaded.
            bytes: bytes.min(self.budget),
            are_bytes_known: false,
            content: Slot::Absent,
            pins: 0,
            last_use: 0,
            loader,
            index,
        }));
        let len = state.items.len() - first;
        Paged { residency: self.clone(), first, len, kind: PhantomData }
    }

    /// Statistics so far.
    pub fn statistics(&self) -> ResidencyStatistics {
        let state = self.lock();
        let resident = state.items.iter().filter(|item| matches!(item.content, Slot::Resident(_)));
        let resident = resident.fold((0, 0), |(count, bytes), item| (count + 1, bytes + item.bytes));
        ResidencyStatistics { resident, ..state.statistics }
    }

    /// Loads an item that packets will need soon, if there is room for it besides recently used items.
    /// Returns whether it is in memory now. A failure is reported to the packet that needs the item.
    fn prefetch(&self, item: usize) -> bool {
        let mut state = self.lock();
        match &state.items[item].content {
            Slot::Resident(_) => return true,
            Slot::Loading | Slot::Failed(_) => return false,
            Slot::Absent => {}
        }
        let bytes = state.items[item].bytes;
        let before = state.clock.saturating_sub(RECENT_PACKETS);
        let unused = state.unused_before(before);
        let freed: u64 = unused.iter().map(|i| state.items[*i].bytes).sum();
        if state.used - freed + bytes > self.budget {
            return false;
        }
        self.drop_first(&mut state, &unused, bytes);
        let mut state = self.load(state, item);
        state.statistics.prefetched += 1;
        state.items[item].content.is_resident()
    }

    /// Loads an item that is absent, for which there is room, without the lock.
    fn load<'a>(&'a self, mut state: MutexGuard<'a, State>, item: usize) -> MutexGuard<'a, State> {
        let Item { bytes, loader, index, .. } = state.items[item];
        state.items[item].content = Slot::Loading;
        state.used += bytes;
        state.statistics.peak = state.statistics.peak.max(state.used);
        let load = state.loaders[loader as usize].clone();
        drop(state);
        let started = Instant::now();
        let unwinding = Unwinding { residency: self, item };
        let loaded = load(index as usize);
        std::mem::forget(unwinding);
        let mut state = self.lock();
        state.statistics.load_time += started.elapsed();
        state.used -= bytes;
        match loaded {
            Ok((content, bytes)) => {
                state.used += bytes;
                state.statistics.loaded += 1;
                state.statistics.peak = state.statistics.peak.max(state.used);
                let last_use = state.clock;
                let of = &mut state.items[item];
                (of.content, of.last_use) = (Slot::Resident(content), last_use);
                (of.bytes, of.are_bytes_known) = (bytes, true);
                if state.used > self.budget {
                    // It is larger than was thought.
                    let mut others = state.unused_before(u64::MAX);
                    others.retain(|other| *other != item);
                    self.drop_first(&mut state, &others, 0);
                }
            }
            Err(error) => state.items[item].content = Slot::Failed(error),
        }
        self.changed.notify_all();
        state
    }

    /// Makes room for `bytes`: drops items without holders, then waits for others to release theirs, unless
    /// all of them wait, too.
    fn make_room<'a>(&'a self, mut state: MutexGuard<'a, State>, bytes: u64) -> MutexGuard<'a, State> {
        loop {
            let unused = state.unused_before(u64::MAX);
            self.drop_first(&mut state, &unused, bytes);
            if state.used + bytes <= self.budget || state.active <= state.waiting + 1 {
                return state;
            }
            state = self.wait(state);
        }
    }

    /// Drops the first of these items until there is room for `bytes`.
    fn drop_first(&self, state: &mut State, items: &[usize], bytes: u64) {
        for item in items {
            if state.used + bytes <= self.budget {
                break;
            }
            state.drop_item(*item);
        }
    }

    /// Waits for a change, as a thread for which no other should wait.
    fn wait<'a>(&'a self, mut state: MutexGuard<'a, State>) -> MutexGuard<'a, State> {
        state.waiting += 1;
        if state.waiting == state.active {
            // One of the others must continue beyond the budget.
            self.changed.notify_all();
        }
        let mut state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        state.waiting -= 1;
        state
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    /// The items without holders that were last used before packet `before`, the least recently used first.
    fn unused_before(&self, before: u64) -> Vec<usize> {
        let is_unused = |item: &Item| item.pins == 0 && item.last_use < before && item.content.is_resident();
        let mut unused: Vec<usize> = (0..self.items.len()).filter(|i| is_unused(&self.items[*i])).collect();
        unused.sort_by_key(|i| self.items[*i].last_use);
        unused
    }

    fn drop_item(&mut self, item: usize) {
        self.used -= self.items[item].bytes;
        self.items[item].content = Slot::Absent;
        self.statistics.dropped += 1;
    }
}

impl Slot {
    fn is_resident(&self) -> bool {
        matches!(self, Slot::Resident(_))
    }
}

impl<T> Paged<T> {
    /// Number of items.
    pub fn len(&self) -> usize {
        self.len
    }

    /// True if there are no items.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The residency of the items.
    pub fn residency(&self) -> &Arc<Residency> {
        &self.residency
    }

    /// Loads an item that packets will need soon, if there is room for it besides recently used items.
    /// Returns whether it is in memory now. A failure is reported to the packet that needs the item.
    pub fn prefetch(&self, index: usize) -> bool {
        index < self.len && self.residency.prefetch(self.first + index)
    }
}

impl<T> Clone for Paged<T> {
    fn clone(&self) -> Paged<T> {
        Paged { residency: self.residency.clone(), ..*self }
    }
}

impl std::fmt::Debug for Residency {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Residency").field("budget", &self.budget).finish_non_exhaustive()
    }
}

impl<T> std::fmt::Debug for Paged<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Paged").field("first", &self.first).field("len", &self.len).finish_non_exhaustive()
    }
}

/// Ends the wait for an item whose loading panics.
struct Unwinding<'a> {
    residency: &'a Residency,
    item: usize,
}

impl Drop for Unwinding<'_> {
    fn drop(&mut self) {
        let mut state = self.residency.lock();
        state.used -= state.items[self.item].bytes;
        state.items[self.item].content = Slot::Failed(Arc::new(LoadPanicked));
        self.residency.changed.notify_all();
    }
}

/// The function that loads an item panicked.
#[derive(Debug)]
struct LoadPanicked;

impl std::fmt::Display for LoadPanicked {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("the loading of a part of the scene failed")
    }
}

impl Error for LoadPanicked {}
