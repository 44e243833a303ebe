//! LAS, LAZ and COPC (ASPRS LAS 1.0 to 1.5).
//!
//! | file | contents |
//! |---|---|
//! | `read` | reader of LAS and LAZ |
//! | `settings`, `write` | writer of LAS 1.4 and 1.0 |
//! | `laz`, `copc` | compression in chunks; chunks that are the nodes of an octree |

mod copc;
mod laz;
mod read;
mod settings;
mod write;

pub use laz::CHUNK_POINTS;
pub(crate) use read::read;
pub use read::{ExtraDimension, Header, LasError, LasFacts, LasReader, PointsError, Selection};
pub use settings::{ExtraDimensions, LasSettings, LasVersion, PacketPlace};
pub use write::{PACKETS_HEADER_BYTES, packets_header};
pub(crate) use write::{copc, las, laz};
