//! Tables of numbers: one vocabulary of column names and one way to read headings for trajectories, pulses,
//! instances, inventories and point clouds; rows read while they arrive, as text and as Arrow streams.
//!
//! | file | what it does |
//! |---|---|
//! | `dimension` | what columns measure, and its units |
//! | `vocabulary` | quantities of columns and their names |
//! | `heading` | a heading as a name and a unit |
//! | `schema` | which quantities a table has; headings compared with it |
//! | `numbers` | columns of numbers of a file, and the names of its other columns |
//! | `lines` | tables of text in memory: separator, headings, rows with quoted fields |
//! | `input` | byte streams and Arrow tables read while they arrive |

#![deny(unsafe_code)]

pub mod input;

mod dimension;
mod heading;
mod lines;
mod numbers;
mod schema;
mod vocabulary;

pub use dimension::Dimension;
pub use heading::{
    HeadingError, ParsedHeading, did_you_mean, join_units, parse_heading, split_suffix, split_unit,
};
pub use lines::{Field, Line, TextTable};
pub use numbers::NumberTable;
pub use schema::{Headings, Schema, TableColumn, Use, WidthError, check_width};
pub use vocabulary::{Quantity, is_usually_unused, plain, similar_name};
