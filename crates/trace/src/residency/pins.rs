//! The items that a thread holds while it traces a packet.

use super::{Content, Item, LoadError, Paged, Residency, Slot};
use std::cell::{OnceCell, RefCell};
use std::fmt;
use std::sync::Arc;

/// The items that one thread holds for the packet of rays that it traces.
///
/// The first access of a packet to an item takes a lock and may load the item; further ones take neither lock
/// nor atomic operation. [`Pins::release`] ends the packet.
pub struct Pins {
    residency: Arc<Residency>,
    /// Every item of the residency, as far as the packet has taken it; `None` if it is not available.
    taken: Vec<OnceCell<Option<Content>>>,
    packet: RefCell<Packet>,
}

/// Items that a packet has taken.
#[derive(Default)]
struct Packet {
    is_active: bool,
    /// The items that it has asked for, and whether it holds them.
    items: Vec<(usize, bool)>,
    /// Bytes of the items that it holds.
    bytes: u64,
    /// Bytes of the items that would have exceeded the budget.
    refused: u64,
    failure: Option<LoadError>,
}

/// Why a packet cannot be traced.
#[derive(Clone, Debug)]
pub enum PinError {
    /// An item could not be loaded.
    Load(LoadError),
    /// The items of this packet alone need more than the budget.
    TooSmall {
        /// Bytes of the items that the packet met; it may meet others with these in memory.
        needed: u64,
        /// The budget, bytes.
        budget: u64,
    },
}

impl Pins {
    /// Pins of one thread, for all items that have been added to `residency`.
    pub fn new(residency: &Arc<Residency>) -> Pins {
        let mut taken = Vec::new();
        taken.resize_with(residency.lock().items.len(), OnceCell::new);
        Pins { residency: residency.clone(), taken, packet: RefCell::default() }
    }

    /// The item with this index among those of `items`, which is loaded if it is not resident. `None` if that
    /// fails or if the packet's items exceed the budget; [`Pins::release`] then reports it.
    #[inline]
    pub fn get<T: Send + Sync + 'static>(&self, items: &Paged<T>, index: usize) -> Option<&T> {
        debug_assert!(Arc::ptr_eq(&items.residency, &self.residency), "items of another residency");
        let taken = self.taken.get(items.first + index).filter(|_| index < items.len)?;
        taken.get_or_init(|| self.take(items.first + index)).as_ref()?.downcast_ref()
    }

    /// True if the items that the packet has asked for exceed the budget.
    pub fn is_over_budget(&self) -> bool {
        self.packet.borrow().refused > 0
    }

    #[cold]
    fn take(&self, item: usize) -> Option<Content> {
        self.residency.take(item, &mut self.packet.borrow_mut())
    }

    /// Ends the packet: its items are not needed any more.
    ///
    /// # Errors
    /// When [`Pins::get`] returned `None` for one of them; the packet's results are then invalid.
    pub fn release(&mut self) -> Result<(), PinError> {
        let mut packet = std::mem::take(self.packet.get_mut());
        if packet.is_active {
            self.residency.release(&packet.items);
        }
        for (item, _) in packet.items.drain(..) {
            self.taken[item].take();
        }
        let outcome = match packet.failure.take() {
            Some(failure) => Err(PinError::Load(failure)),
            None if packet.refused > 0 => {
                let needed = packet.bytes + packet.refused;
                Err(PinError::TooSmall { needed, budget: self.residency.budget })
            }
            None => Ok(()),
        };
        // Keeps the memory of the list.
        *self.packet.get_mut() = Packet { items: packet.items, ..Packet::default() };
        outcome
    }
}

impl Residency {
    /// Gives an item to a packet, and loads it if it is not resident.
    fn take(&self, item: usize, packet: &mut Packet) -> Option<Content> {
        let mut state = self.lock();
        packet.items.push((item, false));
        if !packet.is_active {
            packet.is_active = true;
            state.active += 1;
        }
        let mut is_hit = true;
        loop {
            let Item { bytes, are_bytes_known, .. } = state.items[item];
            if are_bytes_known && packet.bytes + bytes > self.budget {
                packet.refused += bytes;
                return None;
            }
            match &state.items[item].content {
                Slot::Resident(content) => {
                    let content = content.clone();
                    state.items[item].pins += 1;
                    packet.bytes += bytes;
                    packet.items.last_mut().expect("was pushed above").1 = true;
                    let count = &mut state.statistics;
                    *(if is_hit { &mut count.hits } else { &mut count.misses }) += 1;
                    return Some(content);
                }
                Slot::Failed(failure) => {
                    packet.failure.get_or_insert_with(|| failure.clone());
                    return None;
                }
                Slot::Loading => state = self.wait(state),
                Slot::Absent => {
                    state = self.make_room(state, bytes);
                    if matches!(state.items[item].content, Slot::Absent) {
                        state = self.load(state, item);
                    }
                }
            }
            is_hit = false;
        }
    }

    /// Takes the items back that a packet holds.
    fn release(&self, items: &[(usize, bool)]) {
        let mut state = self.lock();
        state.active -= 1;
        state.clock += 1;
        let now = state.clock;
        for (item, _) in items.iter().filter(|(_, is_held)| *is_held) {
            let item = &mut state.items[*item];
            item.pins -= 1;
            item.last_use = now;
        }
        if state.used > self.budget {
            let unused = state.unused_before(u64::MAX);
            self.drop_first(&mut state, &unused, 0);
        }
        self.changed.notify_all();
    }
}

impl Drop for Pins {
    fn drop(&mut self) {
        // Whoever drops them without a release has given up the packet.
        let _ = self.release();
    }
}

impl fmt::Debug for Pins {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Pins").field("residency", &self.residency).finish_non_exhaustive()
    }
}

impl fmt::Display for PinError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PinError::Load(error) => error.fmt(f),
            PinError::TooSmall { needed, budget } => {
                write!(
                    f,
                    "rays traced together need {needed} bytes of the scene at once, the budget is {budget}"
                )
            }
        }
    }
}

impl std::error::Error for PinError {}
