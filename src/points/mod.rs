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

/// Maximum number of points that one call of [`PointReader::read_batch`] appends.
const BATCH_POINTS: usize = 1 << 16;

/// A point as stored in its file; attributes that the file lacks are 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PointRow {
    /// In the units of the file; not validated.
    pub position: DVec3,
    /// Surface normal of any length; not validated.
    pub normal: Option<DVec3>,
    pub intensity: f32,
    pub class: u8,
    /// Return number, from 1.
    pub return_number: u8,
    /// Number of the object that was hit.
    pub object: i64,
    /// Number of the leg.
    pub leg: u16,
    /// Number of the scanner's device.
    pub channel: u16,
    /// Time of the pulse, s.
    pub time: f64,
}

/// Reads the points of a file in order.
pub trait PointReader {
    fn has(&self, attribute: Attribute) -> bool;

    /// The centre of the points according to the file's header, if it states one.
    fn stated_centre(&self) -> Option<DVec3>;

    /// Appends the next points, in the order of the file; returns `false` after the last one. The error describes what
    /// is wrong with the file.
    fn read_batch(&mut self, batch: &mut Vec<PointRow>) -> Result<bool, String>;
}
