//! Settings of a cloud that formats need before its first point.

use crate::columnar::Column;
use crate::las::LasSettings;
use crate::objects::ObjectIds;
use crate::record::PointRecord;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use vlscan_geom::{Aabb, DVec3, LIGHT_SPEED};

/// The program that writes, as files name it.
pub(crate) const SOFTWARE: &str = concat!("vlscan ", env!("CARGO_PKG_VERSION"));

/// State recorded in the metadata of a file.
pub(crate) fn state(is_partial: bool) -> &'static str {
    if is_partial { PARTIAL } else { "complete" }
}

/// State of a file whose points ended early.
pub(crate) const PARTIAL: &str = "partial: the run ended early";

/// Names of the coordinate frames of messages.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct FrameNames {
    /// The frame in which the scanner moves.
    pub world: String,
    /// The frame of the scanner.
    pub sensor: String,
}

impl Default for FrameNames {
    fn default() -> FrameNames {
        FrameNames { world: "map".to_owned(), sensor: "lidar".to_owned() }
    }
}

/// Rows of the devices of a scanner by elevation.
#[derive(Clone, Debug)]
pub(crate) struct Rings(Arc<[u16]>);

impl Rings {
    /// The row of the device of a point.
    #[inline]
    pub fn of(&self, point: &PointRecord) -> u16 {
        self.0.get(point.device as usize).copied().unwrap_or_else(|| point.device_u16())
    }
}

/// Facts about a cloud and the choices for its files.
///
/// ```
/// let mut settings = vlscan_formats::CloudSettings::default();
/// settings.labels = true;
/// settings.las.scale = Some(0.001);
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct CloudSettings {
    /// World position that the positions of records are relative to, m.
    pub origin: DVec3,
    /// Box that the points are expected in, relative to `origin`, m; empty if unknown. Coordinates of limited
    /// width are chosen by it.
    pub bounds: Aabb,
    /// Coordinate reference system of the world as WKT.
    pub crs: Option<String>,
    /// Display name of the instrument.
    pub scanner: String,
    /// True if times are known to be adjusted standard GPS time, for headers that are written before the
    /// first point.
    pub adjusted_times: bool,
    /// Year and day of the year (from 1), for headers.
    pub creation: (u16, u16),
    /// Names of what [`PointRecord::part`](crate::PointRecord::part) refers to.
    pub parts: Vec<String>,
    /// Numbers of these parts.
    pub objects: ObjectIds,
    /// The highest class of the points.
    pub highest_class: i32,
    /// Columns of tables, and, if set, also of the text format, which has the columns of HELIOS++ otherwise.
    pub columns: Option<Vec<Column>>,
    /// True if there are pulses without echoes, so that directions are written.
    pub misses: bool,
    /// True if LAS and PLY have labels for machine learning: part, primitive, true range. Tables always can.
    pub labels: bool,
    /// True if LAS has positions without errors of navigation. Tables have them as columns.
    pub true_positions: bool,
    /// True if points have their height above the ground.
    pub heights: bool,
    /// Names of the coordinate frames of MCAP.
    pub frame_names: FrameNames,
    /// Settings of LAS, LAZ and COPC.
    pub las: LasSettings,
    /// Row of each device of the scanner by elevation, from the lowest channel up, which PCD and MCAP have as
    /// `ring`. Empty: the row of a device is its number.
    pub rings: Vec<u16>,
    /// True if the scanner stands still in each leg, so that a file may have one viewpoint.
    pub stands: bool,
    /// Width of the bins of waveforms by device, ns.
    pub bins_ns: Vec<f64>,
    /// Metres of range per nanosecond of the times of waveforms: of one way, or of the way there and back.
    pub metres_per_ns: f64,
}

impl Default for CloudSettings {
    fn default() -> CloudSettings {
        CloudSettings {
            origin: DVec3::ZERO,
            bounds: Aabb::EMPTY,
            crs: None,
            scanner: String::new(),
            adjusted_times: false,
            creation: (0, 0),
            parts: Vec::new(),
            objects: ObjectIds::default(),
            highest_class: 0,
            columns: None,
            misses: false,
            labels: false,
            true_positions: false,
            heights: false,
            frame_names: FrameNames::default(),
            las: LasSettings::default(),
            rings: Vec::new(),
            stands: false,
            bins_ns: Vec::new(),
            metres_per_ns: LIGHT_SPEED,
        }
    }
}

impl CloudSettings {
    /// The columns of tables: the chosen ones, or those written by default.
    pub fn table_columns(&self) -> Vec<Column> {
        self.columns.clone().unwrap_or_else(|| {
            let mut columns = Column::default_columns(self.misses);
            columns.extend(self.heights.then_some(Column::HeightAboveGround));
            columns
        })
    }

    /// True if files have the colours of surfaces: a column of theirs is chosen.
    pub fn has_colours(&self) -> bool {
        self.columns.iter().flatten().any(|column| column.needs().colour)
    }

    /// True if files have the radial velocities of points: a column of theirs is chosen.
    pub fn has_velocities(&self) -> bool {
        self.columns.iter().flatten().any(|column| column.needs().velocity)
    }

    /// True if files have labels of the way of light: a column of theirs is chosen.
    pub fn has_light_labels(&self) -> bool {
        self.columns.iter().flatten().any(|column| column.is_light_label())
    }

    /// The rows of devices.
    pub(crate) fn rows(&self) -> Rings {
        Rings(self.rings.as_slice().into())
    }

    /// The bounds in the world, m.
    pub(crate) fn world_bounds(&self) -> Aabb {
        Aabb { min: self.bounds.min + self.origin, max: self.bounds.max + self.origin }
    }
}
