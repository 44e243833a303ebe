//! Reads point clouds: LAS and LAZ, PLY, and columns of text.
//!
//! | file | what it does |
//! |---|---|
//! | `columns` | which columns of a table hold which attributes of a point |
//! | `las` | LAS and LAZ 1.0 to 1.4: points, extra dimensions, raw records |
//! | `ply` | PLY, text and binary |
//! | `text` | splits and parses lines of text |

mod columns;
mod las;
mod ply;
pub mod text;

pub use columns::{Attribute, Columns};
pub use las::{LasReader, Selection, is_las};
pub use ply::{PlyReader, is_ply};

use crate::geom::DVec3;

/// Points that [`PointReader::read_batch`] appends at most.
const BATCH_POINTS: usize = 1 << 16;

/// A point as its file describes it; attributes that the file lacks are 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PointRow {
    /// In the units of the file, not checked.
    pub position: DVec3,
    /// Surface normal of any length, not checked.
    pub normal: Option<DVec3>,
    /// Strength of the return.
    pub intensity: f32,
    /// Point class.
    pub class: u8,
    /// Number of the return, from 1.
    pub return_number: u8,
    /// Number of the object that was hit.
    pub object: i64,
}

/// A file whose points are read one after the other.
pub trait PointReader {
    /// Whether the file has an attribute.
    fn has(&self, attribute: Attribute) -> bool;

    /// The centre of the points by the file's header, if it states one.
    fn stated_centre(&self) -> Option<DVec3>;

    /// Appends some points, in the order of the file; `false` after the last one. An error tells what is wrong with the
    /// file.
    fn read_batch(&mut self, batch: &mut Vec<PointRow>) -> Result<bool, String>;
}
