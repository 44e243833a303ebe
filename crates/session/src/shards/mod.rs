//! Shards of a run: shares of its pulses that any number of processes compute, and that are merged to the
//! outputs of one run. A shard holds the input of the writers of a run: batches of echoes, waveforms, pulses
//! and poses, in order and bit for bit.
//!
//! ```text
//! Borders: where shards begin ─► one process per shard ─► Block … Block ─► shard-000003-of-000256.vlshard
//!                                                                               │
//!                        the pipeline's writers ◄─ Batch ◄─ Block ◄─ ShardSet ◄──┘
//! ```
//!
//! | file | what it does |
//! |---|---|
//! | `fingerprint` | what the contents of a shard depend on, and how two runs differ |
//! | `borders` | states of the flight from which shards begin |
//! | `column`, `block` | batches as bytes, column by column |
//! | `file` | the file of a shard |
//! | `share` | the number of a share |
//! | `private` | unfinished files of a process in a folder that others share |
//! | `folder` | the shards in a folder: missing, damaged, of other runs |

mod block;
mod borders;
mod column;
mod file;
mod fingerprint;
mod folder;
mod private;
mod share;

pub use block::{BlockHead, encode};
pub use borders::{Border, Borders, BordersBuilder, StoredBorders};
pub use file::{BlockTable, Records, ShardFile, ShardFileError, ShardHead};
pub use fingerprint::Fingerprint;
pub use folder::{ShardSet, array_list, is_file_of_shards, is_shard, shard_path};
pub use private::PrivateFolder;
pub use share::{OneOf, OneOfError};
