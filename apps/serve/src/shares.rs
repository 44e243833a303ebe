//! Shared limits of requests, such as concurrent uploads: each owner has a share, so that no owner can use
//! all.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::Duration;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// A number of places, of which an owner takes a part at most.
#[derive(Debug)]
pub struct Shares {
    all: Arc<Semaphore>,
    each: usize,
    owners: Mutex<HashMap<String, Weak<Semaphore>>>,
}

/// A place, until it is dropped.
#[derive(Debug)]
pub struct Share {
    _of_owner: OwnedSemaphorePermit,
    _of_all: OwnedSemaphorePermit,
}

impl Shares {
    /// `all` places, of which an owner takes at most `each`.
    pub fn new(all: usize, each: usize) -> Shares {
        Shares { all: Arc::new(Semaphore::new(all)), each, owners: Mutex::default() }
    }

    fn count(&self, owner: &str) -> Arc<Semaphore> {
        let mut owners = self.owners.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(count) = owners.get(owner).and_then(Weak::upgrade) {
            return count;
        }
        owners.retain(|_, count| count.strong_count() > 0);
        let count = Arc::new(Semaphore::new(self.each));
        owners.insert(owner.to_owned(), Arc::downgrade(&count));
        count
    }

    /// A place for an owner, if there is one now.
    pub fn try_take(&self, owner: &str) -> Option<Share> {
        let count = self.count(owner);
        let of_owner = count.try_acquire_owned().ok()?;
        let of_all = Arc::clone(&self.all).try_acquire_owned().ok()?;
        Some(Share { _of_owner: of_owner, _of_all: of_all })
    }

    /// A place for an owner, if there is one within this time.
    pub async fn take(&self, owner: &str, time: Duration) -> Option<Share> {
        let count = self.count(owner);
        let taken = async {
            // Take the owner's place first, so that a waiting owner holds no shared place.
            let of_owner = count.acquire_owned().await.ok()?;
            let of_all = Arc::clone(&self.all).acquire_owned().await.ok()?;
            Some((of_owner, of_all))
        };
        let (of_owner, of_all) = tokio::time::timeout(time, taken).await.ok()??;
        Some(Share { _of_owner: of_owner, _of_all: of_all })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_owner_takes_a_part_only() {
        let shares = Shares::new(3, 2);
        let first = shares.try_take("anna").unwrap();
        let _second = shares.try_take("anna").unwrap();
        assert!(shares.try_take("anna").is_none());
        let _third = shares.try_take("ben").unwrap();
        assert!(shares.try_take("ben").is_none() && shares.try_take("carl").is_none());
        drop(first);
        assert!(shares.try_take("carl").is_some());
        assert!(shares.try_take("anna").is_some());
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
        let _fourth = shares.try_take("anna").unwrap();
        let waited = runtime.block_on(shares.take("anna", Duration::from_millis(5)));
        assert!(waited.is_none(), "the wait ends");
    }
}
