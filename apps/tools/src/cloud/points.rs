//! A point cloud: 12 or 24 bytes for each position and up to 30 for its attributes, in bounded memory, and a
//! bounded number of points.

mod adding;

use super::column::{Column, HeldValues};
use super::points_part::{KeptValues, PointsPart, held_points, is_placed};
use super::positions::Positions;
use std::any::Any;
use std::collections::HashMap;
use std::ops::ControlFlow;
use std::path::Path;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::Result;
use vlscan_base::quantity::counted;
use vlscan_formats::{
    Attribute, AttributeSet, FileFacts, LasFacts, NewPart, PointPart, PointRow, PointSink, PositionSteps,
    Selection, StrayFinder,
};
use vlscan_geom::{Aabb, DVec3, MAX_COORDINATE};

/// Maximum number of points that are kept.
const MAX_POINTS: usize = 40_000_000;

/// Memory of a cloud unless another limit is given, bytes.
pub(super) const POINTS_BYTES: u64 = 1 << 27;

/// A point cloud. When there are too many points, every second one of those kept is dropped. Points beyond
/// the memory that the cloud may take are in temporary files.
#[derive(Clone, Debug)]
pub struct Points {
    attributes: AttributeSet,
    /// The attributes that are kept of those of a file; `None` for all.
    kept: Option<AttributeSet>,
    /// Steps of the positions in a file of LAS.
    steps: Option<PositionSteps>,
    /// Memory that the points may take, bytes; `None` for any.
    max_bytes: Option<u64>,
    positions: Positions,
    pub(crate) intensity: Column<f32>,
    pub(crate) class: Column<u8>,
    pub(crate) return_number: Column<u8>,
    pub(crate) number_of_returns: Column<u8>,
    /// Degrees.
    pub(crate) scan_angle: Column<f32>,
    pub(crate) object: Column<u16>,
    pub(crate) objects: Vec<String>,
    pub(crate) leg: Column<u16>,
    /// Numbers above 255 are 255.
    pub(crate) channel: Column<u8>,
    /// Red, green and blue as the file has them; empty without colours.
    colour: Column<[u16; 3]>,
    /// The greatest component of colours.
    max_colour: u16,
    /// Seconds after the first point.
    pub(crate) time: Column<f64>,
    first_time: Option<f64>,
    /// System of the coordinates as WKT.
    crs: Option<String>,
    bounds: Aabb,
    /// True if legs are flight lines, numbered from 1, and 0 means none.
    legs_from_one: bool,
    object_numbers: HashMap<String, u16>,
    latest_object: u16,
    /// Number of points that were added, without those skipped.
    added: u64,
    /// Number of points of which the first is kept.
    stride: u64,
    max_points: usize,
    skipped: u64,
    /// Pulses without a return.
    misses: u64,
    strays: StrayFinder,
    /// Numbers of points with legs and channels above 255.
    high_legs: u64,
    high_channels: u64,
}

impl Default for Points {
    fn default() -> Points {
        Points::new(AttributeSet::default())
    }
}

impl Points {
    /// An empty cloud whose points have `attributes`; the others take no memory.
    pub fn new(attributes: AttributeSet) -> Points {
        Points::within(attributes, None)
    }

    /// An empty cloud whose points have `attributes` and take at most this memory, bytes.
    pub(crate) fn within(attributes: AttributeSet, max_bytes: Option<u64>) -> Points {
        let held = max_bytes.map_or(HeldValues::ALL, |bytes| held_points(attributes, bytes));
        Points {
            attributes,
            kept: None,
            steps: None,
            max_bytes,
            positions: Positions::in_metres(held),
            intensity: Column::new(held),
            class: Column::new(held),
            return_number: Column::new(held),
            number_of_returns: Column::new(held),
            scan_angle: Column::new(held),
            object: Column::new(held),
            objects: Vec::new(),
            leg: Column::new(held),
            channel: Column::new(held),
            colour: Column::new(held),
            max_colour: 0,
            time: Column::new(held),
            first_time: None,
            crs: None,
            bounds: Aabb::EMPTY,
            legs_from_one: false,
            object_numbers: HashMap::new(),
            latest_object: 0,
            added: 0,
            stride: 1,
            max_points: MAX_POINTS,
            skipped: 0,
            misses: 0,
            strays: StrayFinder::default(),
            high_legs: 0,
            high_channels: 0,
        }
    }

    /// An empty cloud that keeps, of the points of a file, these attributes, or all, in this memory, bytes.
    pub(super) fn keeping(attributes: Option<AttributeSet>, max_bytes: u64) -> Points {
        Points { kept: attributes, max_bytes: Some(max_bytes), ..Points::default() }
    }

    /// Releases the memory of points in temporary files, which is taken again when they are used.
    pub(crate) fn release(&self) {
        self.positions.release();
        self.intensity.release();
        self.class.release();
        self.return_number.release();
        self.number_of_returns.release();
        self.scan_angle.release();
        self.object.release();
        self.leg.release();
        self.channel.release();
        self.colour.release();
        self.time.release();
    }

    /// Adds a point; `object` is the name of its object, if it has one besides its number. A point with a
    /// coordinate that is NaN or beyond [`MAX_COORDINATE`], and a pulse without a return, is counted and
    /// skipped. Object names beyond the first 65 535 share one number.
    pub fn push(&mut self, row: &PointRow, object: Option<&str>) {
        if row.is_miss {
            self.misses += 1;
            return;
        }
        if !is_placed(row.position) {
            self.skipped += 1;
            return;
        }
        self.bounds = self.bounds.with(row.position);
        self.strays.add(row.position);
        self.keep(row.position, &KeptValues::of(row), object);
    }

    /// Leaves out the points that lie far from all others, with a warning. Above [`MAX_POINTS`], where the
    /// cloud is thinned, strays are found and counted among all points, and the bounds become those of the
    /// points that are kept.
    pub(super) fn leave_out_strays(&mut self, path: &Path, found: &mut Diagnostics) {
        let strays = self.strays.strays();
        if strays.count == 0 {
            return;
        }
        strays.warn(path, "left out", found);
        let marks: Vec<bool> = self.positions.iter().map(|p| !strays.contains(p)).collect();
        let is_kept = |index: usize| marks.get(index).copied().unwrap_or(true);
        self.positions.retain(is_kept);
        self.intensity.retain(is_kept);
        self.class.retain(is_kept);
        self.return_number.retain(is_kept);
        self.number_of_returns.retain(is_kept);
        self.scan_angle.retain(is_kept);
        self.object.retain(is_kept);
        self.leg.retain(is_kept);
        self.channel.retain(is_kept);
        self.colour.retain(is_kept);
        self.time.retain(is_kept);
        self.added -= strays.count;
        self.bounds = self.positions.iter().fold(Aabb::EMPTY, Aabb::with);
    }

    /// Treats the legs of further points as flight lines, numbered from 1; 0 means none.
    pub fn count_legs_from_one(&mut self) {
        self.legs_from_one = true;
    }

    pub(crate) fn legs_from_one(&self) -> bool {
        self.legs_from_one
    }

    /// World position of a point that is kept, m.
    pub fn position(&self, i: usize) -> DVec3 {
        self.positions.get(i)
    }

    /// World positions of the points that are kept, m.
    pub fn positions(&self) -> impl Iterator<Item = DVec3> + Clone + '_ {
        self.positions.iter()
    }

    /// Position of a point relative to [`Points::origin`], m.
    pub(crate) fn offset(&self, i: usize) -> [f32; 3] {
        rounded(self.position(i) - self.origin())
    }

    /// The offsets of all points.
    pub(crate) fn offsets(&self) -> impl Iterator<Item = [f32; 3]> + Clone {
        let origin = self.origin();
        self.positions.iter().map(move |position| rounded(position - origin))
    }

    /// Intensity of a point; `None` if the points have none.
    pub fn intensity_of(&self, i: usize) -> Option<f32> {
        self.intensity.get(i)
    }

    /// Return number of a point; `None` if the points have none.
    pub fn return_number_of(&self, i: usize) -> Option<u8> {
        self.return_number.get(i)
    }

    /// Number of returns of the pulse of a point; `None` if the points have none.
    pub fn number_of_returns_of(&self, i: usize) -> Option<u8> {
        self.number_of_returns.get(i)
    }

    /// Class of a point; `None` if the points have none.
    pub fn class_of(&self, i: usize) -> Option<u8> {
        self.class.get(i)
    }

    /// Scan angle of a point, degrees; `None` if the points have none.
    pub fn scan_angle_of(&self, i: usize) -> Option<f32> {
        self.scan_angle.get(i)
    }

    /// True if some points have colours other than black.
    pub(crate) fn has_colours(&self) -> bool {
        self.max_colour > 0
    }

    /// Red, green and blue of a point; black if it has none. Files have 8 bits or the upper 8 of 16.
    pub(crate) fn colour_of(&self, i: usize) -> [u8; 3] {
        let shift = if self.max_colour > 255 { 8 } else { 0 };
        self.colour.get(i).map_or([0; 3], |colour| colour.map(|component| (component >> shift) as u8))
    }

    /// Time of a point, s; `None` if the points have none. Points of one pulse have the same bits.
    pub fn time_of(&self, i: usize) -> Option<f64> {
        Some(self.first_time? + self.time.get(i)?)
    }

    /// Leg (point source) and channel, at most 255, of a point; 0 where the points have none.
    pub fn source_of(&self, i: usize) -> (u16, u8) {
        (self.leg.get(i).unwrap_or(0), self.channel.get(i).unwrap_or(0))
    }

    /// The system of the coordinates as WKT, if the file names one.
    pub fn crs(&self) -> Option<&str> {
        self.crs.as_deref()
    }

    /// True if the cloud had more points than are kept.
    pub fn is_thinned(&self) -> bool {
        self.stride > 1
    }

    /// World position of the origin of offsets, the centre of the cloud's box, m.
    pub(crate) fn origin(&self) -> DVec3 {
        if self.is_empty() { DVec3::ZERO } else { self.bounds.centre() }
    }

    /// Number of points that are kept.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Number of points of the cloud, of which not all may be kept.
    pub fn total(&self) -> usize {
        self.added as usize
    }

    /// True if there are no points.
    pub fn is_empty(&self) -> bool {
        self.positions.len() == 0
    }

    /// Box around the points, world frame, m; empty without points.
    pub fn bounds(&self) -> Aabb {
        if self.is_empty() { Aabb::EMPTY } else { self.bounds }
    }

    /// A warning of the points of the file `path` that are left out, and a note of its pulses without a
    /// return.
    pub fn doubts(&self, path: &Path) -> Diagnostics {
        let mut found = Diagnostics::default();
        if self.skipped > 0 {
            let points = counted(self.skipped, "point");
            let message = format!("left out: {points} without coordinates within ±{MAX_COORDINATE:e} m");
            found.warn(Some(Place::of_file(path)), message);
        }
        if self.misses > 0 {
            let pulses = counted(self.misses, "pulse");
            let message = format!("left out: {pulses} without a return");
            found.note(Some(Place::of_file(path)), message);
        }
        found
    }

    /// Number of pulses without a return, which are no points.
    pub fn misses(&self) -> u64 {
        self.misses
    }

    /// Numbers of points whose leg and whose channel is above 255, and shown as 255.
    pub fn beyond_bytes(&self) -> (u64, u64) {
        (self.high_legs, self.high_channels)
    }

    /// Number of points skipped because of their position.
    pub fn skipped(&self) -> u64 {
        self.skipped
    }

    /// True if the points have an attribute.
    pub fn has(&self, attribute: Attribute) -> bool {
        self.attributes.has(attribute)
    }
}

impl PointSink for Points {
    fn selection(&self) -> Selection {
        self.kept.map_or(Selection::All, Selection::Attributes)
    }

    fn start(&mut self, attributes: AttributeSet) {
        let Points { kept, steps, max_bytes, .. } = *self;
        let is_kept = |attribute| attributes.has(attribute) && kept.is_none_or(|kept| kept.has(attribute));
        let points = Points::within(AttributeSet::of(is_kept), max_bytes);
        let held = points.positions.max_held();
        let in_steps = |steps| Positions::in_steps(steps, held);
        let positions = steps.map_or_else(|| Positions::in_metres(held), in_steps);
        *self = Points { kept, steps, positions, ..points };
    }

    fn file(&mut self, facts: &FileFacts) {
        self.steps = facts.las.as_ref().map(LasFacts::steps);
    }

    fn crs(&mut self, wkt: &str) {
        self.crs = Some(wkt.to_owned());
    }

    fn parts(&self) -> Option<NewPart> {
        let needs_names = self.has(Attribute::Object);
        let part = move || PointsPart { needs_names, ..PointsPart::default() };
        Some(Box::new(move || -> Box<dyn PointPart> { Box::new(part()) }))
    }

    fn add_part(&mut self, part: &mut (dyn PointPart + 'static)) -> Result<ControlFlow<()>> {
        let part: &mut dyn Any = part;
        if let Some(part) = part.downcast_ref::<PointsPart>() {
            self.append(part);
        }
        Ok(ControlFlow::Continue(()))
    }

    fn point(&mut self, row: &PointRow, object: Option<&str>) -> Result<ControlFlow<()>> {
        self.push(row, object);
        Ok(ControlFlow::Continue(()))
    }
}

fn rounded(offset: DVec3) -> [f32; 3] {
    [offset.x as f32, offset.y as f32, offset.z as f32]
}

#[cfg(test)]
mod tests;
