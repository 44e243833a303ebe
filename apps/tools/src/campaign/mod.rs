//! Campaigns: one run for every scene, variant and seed of a matrix, computed by any number of processes that
//! share a folder and nothing else.
//!
//! ```text
//! campaign.toml ─► File ─► Cells ─► a process takes a cell: lock ─► work folder ─► renamed to OUT/cells/NAME
//!                                                                      │ Record
//!                                                   all cells done: OUT/manifest.jsonl
//! ```
//!
//! | file | what it does |
//! |---|---|
//! | `file` | the campaign's file |
//! | `plots` | plots within an area |
//! | `cells` | the matrix, groups and their split |
//! | `store` | the folder of the data set: locks, work, failures, what is complete |
//! | `made` | what was written for a cell, and its removal |
//! | `record` | the line of a cell in the manifest |
//! | `inputs` | what the contents of cells depend on |

mod cells;
mod file;
mod inputs;
mod made;
mod plots;
mod record;
mod store;

pub use cells::{Cell, Cells};
pub use file::{File, GroupBy, SceneEntry, Seeds, Split, UnclosedQuote, VariantEntry, text_of, words};
pub use inputs::{Inputs, checksum};
pub use record::{FileRecord, Record};
pub use store::{CellLock, Outcome, Store};
