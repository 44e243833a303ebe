//! Disk space of uploads that are being received: it counts for their owner before the database lists them.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Reserved bytes of each owner.
#[derive(Debug, Default)]
pub struct Reservations {
    owners: Mutex<HashMap<String, u64>>,
}

/// Reserved bytes of an owner, until it is dropped.
#[derive(Debug)]
pub struct Reservation {
    all: Arc<Reservations>,
    owner: String,
    bytes: u64,
}

impl Reservations {
    fn owners(&self) -> MutexGuard<'_, HashMap<String, u64>> {
        self.owners.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Bytes of an owner.
    pub fn of(&self, owner: &str) -> u64 {
        self.owners().get(owner).copied().unwrap_or(0)
    }
}

impl Reservation {
    /// A reservation of no bytes.
    pub fn new(all: &Arc<Reservations>, owner: &str) -> Reservation {
        Reservation { all: Arc::clone(all), owner: owner.to_owned(), bytes: 0 }
    }

    /// Its bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Changes its bytes. Returns those of all reservations of its owner.
    pub fn set(&mut self, bytes: u64) -> u64 {
        let mut owners = self.all.owners();
        let sum = owners.get(&self.owner).copied().unwrap_or(0);
        let sum = sum.saturating_sub(self.bytes).saturating_add(bytes);
        self.bytes = bytes;
        if sum == 0 {
            owners.remove(&self.owner);
        } else {
            owners.insert(self.owner.clone(), sum);
        }
        sum
    }

    /// Adds bytes. Returns those of all reservations of its owner.
    pub fn add(&mut self, bytes: u64) -> u64 {
        self.set(self.bytes.saturating_add(bytes))
    }
}

impl Drop for Reservation {
    fn drop(&mut self) {
        self.set(0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reservations_of_an_owner_add_up_and_end() {
        let all = Arc::new(Reservations::default());
        let mut first = Reservation::new(&all, "anna");
        let mut second = Reservation::new(&all, "anna");
        assert_eq!((first.add(3), second.add(4), first.add(2)), (3, 7, 9));
        assert_eq!((all.of("anna"), all.of("ben"), second.set(1)), (9, 0, 6));
        drop(first);
        assert_eq!(all.of("anna"), 1);
        drop(second);
        assert!(all.of("anna") == 0 && all.owners().is_empty());
    }
}
