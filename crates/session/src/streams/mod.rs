//! The streams between commands: pulses and poses as rows of text or of an Arrow stream.
//!
//! | file | what it does |
//! |---|---|
//! | `columns` | names, dimensions and meanings of the columns of pulses |
//! | `row` | a pulse as numbers and back, bit for bit |
//! | `text`, `table` | writes rows as comma-separated values, and as an Arrow IPC stream |
//! | `read` | reads blocks of rows while they arrive |
//! | `schema` | the columns of one stream and their positions; a row as a pulse |

mod columns;
mod read;
mod row;
mod schema;
mod table;
mod text;

pub use columns::PulseColumn;
pub use read::{PulseReader, RowBlock};
pub use row::{ColumnSet, PulseRow, RowFault};
pub use table::{TableColumn, TableWriter, pose_columns, pulse_columns, push_pose_row, push_pulse_row};
pub use text::{POSE_HEADER, default_columns, header, push_pose, push_pulse, with_errors, with_reported};
