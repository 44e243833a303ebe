//! The wiring of the river, short enough to read in a minute.

mod batch;

pub use batch::Batch;
