//! Parts of a run: shares of its pulses that any number of processes compute, and that are merged to the outputs of one
//! run. A part holds what the writers of a run would have been handed: batches of echoes, waveforms, pulses and poses, in
//! order and bit for bit.
//!
//! ```text
//! Borders: where parts begin ─► one process per part ─► Block … Block ─► part-000003-of-000256.vlpart
//!                                                                               │
//!                        the pipeline's writers ◄─ Batch ◄─ Block ◄─ PartSet ◄──┘
//! ```
//!
//! | file | what it does |
//! |---|---|
//! | `fingerprint` | what the contents of a part depend on, and how two runs differ |
//! | `borders` | states of the flight from which parts begin |
//! | `column`, `block` | batches as bytes, column by column |
//! | `file` | the file of a part |
//! | `private` | unfinished files of a process in a folder that others share |
//! | `folder` | the parts in a folder: missing, damaged, of other runs |

mod block;
mod borders;
mod column;
mod file;
mod fingerprint;
mod folder;
mod private;

pub use block::{BlockHead, encode, encode_records};
pub use borders::{Border, Borders, BordersBuilder, StoredBorders};
pub use file::{PartFile, PartHead, PartTable, Records};
pub use fingerprint::Fingerprint;
pub use folder::{PartSet, array_list, is_file_of_parts, is_part, part_path};
pub use private::PrivateFolder;
