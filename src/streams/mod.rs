//! What the commands hand to one another: pulses and poses as rows of text.
//!
//! | file | what it does |
//! |---|---|
//! | `columns` | names, units and meanings of a pulse's columns |
//! | `row` | a pulse as numbers and back, bit for bit |
//! | `text` | rows as comma-separated values |
//! | `read` | rows as they arrive |

mod columns;
mod read;
mod row;
mod text;

pub use columns::Column;
pub use read::{Block, PulseReader};
pub use row::{Present, PulseRow};
pub use text::{POSE_HEADER, header, push_pose, push_pulse, usual_columns, with_errors};
