//! Identities of values in memory, by which parts of a scene share them.

use super::MaterialChange;
use std::ops::Deref;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Identity of a value: its clones share it, other values of the process have another one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Identity(u64);

impl Identity {
    pub(super) fn new() -> Identity {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        Identity(NEXT.fetch_add(1, Ordering::Relaxed))
    }
}

/// Materials that replace those of a part's files, in this order. Clones share their materials.
#[derive(Clone, Debug, Default)]
pub struct MaterialChanges(Option<Arc<(Identity, Vec<MaterialChange>)>>);

impl MaterialChanges {
    /// Their identity; `None` without changes.
    pub fn identity(&self) -> Option<Identity> {
        self.0.as_ref().map(|changes| changes.0)
    }
}

impl Deref for MaterialChanges {
    type Target = [MaterialChange];

    fn deref(&self) -> &[MaterialChange] {
        self.0.as_ref().map_or(&[], |changes| &changes.1)
    }
}

impl FromIterator<MaterialChange> for MaterialChanges {
    fn from_iter<I: IntoIterator<Item = MaterialChange>>(changes: I) -> MaterialChanges {
        let changes: Vec<MaterialChange> = changes.into_iter().collect();
        MaterialChanges((!changes.is_empty()).then(|| Arc::new((Identity::new(), changes))))
    }
}

impl From<Vec<MaterialChange>> for MaterialChanges {
    fn from(changes: Vec<MaterialChange>) -> MaterialChanges {
        changes.into_iter().collect()
    }
}
