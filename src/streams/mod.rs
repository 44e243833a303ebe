//! What the commands hand to one another: pulses and poses as rows of text or of an Arrow stream.
//!
//! | file | what it does |
//! |---|---|
//! | `columns` | names, units and meanings of a pulse's columns |
//! | `row` | a pulse as numbers and back, bit for bit |
//! | `text`, `table` | rows as comma-separated values, and as an Arrow IPC stream |
//! | `read` | rows as they arrive, whichever they are |
//! | `text_rows`, `table_rows` | what has arrived as lines, and as batches |

mod columns;
mod read;
mod row;
mod table;
mod table_rows;
mod text;
mod text_rows;

pub use columns::Column;
pub use read::{Block, PulseReader};
pub use row::{Present, PulseRow};
pub use table::{TableColumn, TableWriter, pose_columns, pulse_columns, push_pose_row, push_pulse_row};
pub use text::{POSE_HEADER, default_columns, header, push_pose, push_pulse, with_errors, with_reported};
