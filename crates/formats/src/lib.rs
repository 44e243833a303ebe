//! Reads point clouds. Every command and loader reads points through [`PointFile`] or [`read_points`], which recognise
//! the format by the first bytes and pass the points one by one to a [`PointSink`]. Positions are metres.
//!
//! | file | what it does |
//! |---|---|
//! | `columns` | which columns of a table hold which attributes of a point, and in which units |
//! | `file` | opens files and streams, and calls the reader of their format |
//! | `format` | recognises formats, also those that are not read |
//! | `las` | LAS and LAZ 1.0 to 1.5: points, extra dimensions, units, raw records |
//! | `ply` | PLY, text and binary |
//! | `pcd`, `e57` | PCD, E57 |
//! | `leica` | PTS and PTX |
//! | `table` | Arrow, Parquet and tables in memory |
//! | `text` | lines of columns, with or without a line of names |

#![deny(unsafe_code)]

mod columns;
mod e57;
mod file;
mod format;
mod las;
mod leica;
mod pcd;
mod ply;
mod table;
pub mod text;

pub use columns::{Attribute, AttributeSet, Columns, Misfits};
pub use file::{PointFile, read_points};
pub use format::CloudFormat;
pub use las::{ExtraDimension, Header as LasHeader, LasReader, Selection};
pub use ply::{PlyNumbers, is_ply, ply_header};
pub use table::read_record_batch;

/// The example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

use std::ops::ControlFlow;
use std::path::Path;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_geom::DVec3;

/// A point as stored in its file. Attributes that the file lacks are 0; an intensity that it marks as missing is NaN.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PointRow {
    /// World position, m; not validated.
    pub position: DVec3,
    /// Surface normal of any length; not validated.
    pub normal: Option<DVec3>,
    /// Strength of the return, in the unit of the file.
    pub intensity: f32,
    /// Point class: the classification code of LAS.
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
    /// Attributes whose values in the file do not fit the types here.
    pub misfits: Misfits,
}

/// Takes the points of a file.
pub trait PointSink {
    /// Called once, before the first point, with the attributes that the points have.
    fn start(&mut self, attributes: AttributeSet);

    /// Takes the next point in the order of the file; `object` is the name of its object in files that have names.
    /// `Break` ends reading.
    fn point(&mut self, row: &PointRow, object: Option<&str>) -> ControlFlow<()>;
}

/// A file that is being read: where its points go and where its problems are recorded.
struct Reading<'a> {
    path: &'a Path,
    selection: Selection,
    sink: &'a mut dyn PointSink,
    found: &'a mut Diagnostics,
    /// Number of points with a value that does not fit, by attribute, and the place of the first one.
    misfits: [(u64, Option<Place>); Attribute::COUNT],
}

impl<'a> Reading<'a> {
    fn new(
        path: &'a Path,
        selection: Selection,
        sink: &'a mut dyn PointSink,
        found: &'a mut Diagnostics,
    ) -> Reading<'a> {
        Reading { path, selection, sink, found, misfits: Default::default() }
    }

    /// Records a warning about the whole file.
    fn warn(&mut self, message: impl Into<String>) {
        self.found.warn(Some(self.place()), message);
    }

    /// Warns of what follows the points that the header of the file counts.
    fn warn_of_rest(&mut self, points: usize) {
        self.warn(format!("more follows the {points} points that its header states, which is not read"));
    }

    /// Records why the file cannot be read.
    fn fail(&mut self, message: &str) {
        self.found.error(None, message);
    }

    /// Records how the whole file was interpreted.
    fn note(&mut self, message: impl Into<String>) {
        self.found.note(Some(self.place()), message);
    }

    fn place(&self) -> Place {
        Place::of_file(self.path)
    }

    /// Passes a point to the sink.
    fn take(&mut self, row: &PointRow) -> ControlFlow<()> {
        let path = self.path;
        self.take_from(row, None, |_| Place::of_file(path))
    }

    /// Passes a point to the sink, with the name of its object; `place` is where the value of an attribute stands.
    fn take_from(
        &mut self,
        row: &PointRow,
        object: Option<&str>,
        place: impl Fn(Attribute) -> Place,
    ) -> ControlFlow<()> {
        if !row.misfits.is_empty() {
            for attribute in Attribute::ALL.into_iter().filter(|attribute| row.misfits.has(*attribute)) {
                let (count, first) = &mut self.misfits[attribute as usize];
                *count += 1;
                first.get_or_insert_with(|| place(attribute));
            }
        }
        self.sink.point(row, object)
    }

    /// Warns of the values of all points that do not fit, as far as they are selected.
    fn end(self) {
        let wanted = |attribute| self.selection == Selection::All || attribute == Attribute::Class;
        for (attribute, (count, place)) in Attribute::ALL.into_iter().zip(self.misfits) {
            if count > 0 && wanted(attribute) {
                let points = if count == 1 { "point has" } else { "points have" };
                self.found.warn(place, format!("{count} {points} {}", attribute.misfit()));
            }
        }
    }
}
