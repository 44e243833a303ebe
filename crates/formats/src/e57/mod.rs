//! E57 (ASTM E2807).

mod read;

pub(crate) use read::read;
