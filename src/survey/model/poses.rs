//! Recorded trajectories: where poses come from and how they are meant.

use super::RotationSpec;
use crate::geom::{DVec3, UtmZone};
use std::path::PathBuf;

/// A trajectory that is flown along as its poses arrive (`--trajectory`, `[trajectory]`).
#[derive(Clone, Debug, PartialEq)]
pub struct PoseStream {
    /// Where the poses come from; `-` is standard input.
    pub path: PathBuf,
    /// The layout; `None` finds it out from the content.
    pub format: Option<PoseFormat>,
    /// How the angles of text compose; `None` is [`AngleConvention::Helios`] for the text files of HELIOS++ and
    /// [`AngleConvention::Heading`] for all others. SBET and TerraScan have headings.
    pub rotation: Option<AngleConvention>,
    /// Angles of text are degrees where no unit stands behind a column's name.
    pub degrees: bool,
    /// Columns of text, by name in their order or as `name=number` from 1, when neither a header line nor the default
    /// order time,x,y,z,roll,pitch,yaw is meant.
    pub columns: Option<Vec<String>>,
    /// Column separator; `None` guesses from the first line.
    pub separator: Option<char>,
    /// The grid to which latitudes and longitudes are projected.
    pub grid: Grid,
    /// Added to all heights, m.
    pub height_offset: f64,
    /// Position of the scanner's platform frame in the frame of the poses (x right, y forward, z up), m.
    pub lever_arm: DVec3,
    /// Roll, pitch and heading of the scanner's platform frame in the frame of the poses, rad, composed as headings.
    pub boresight: [f64; 3],
    /// Nothing is fired between poses that are farther apart than this, s.
    pub max_gap: f64,
}

impl PoseStream {
    /// The trajectory at `path` with all defaults.
    pub fn at(path: impl Into<PathBuf>) -> PoseStream {
        PoseStream {
            path: path.into(),
            format: None,
            rotation: None,
            degrees: true,
            columns: None,
            separator: None,
            grid: Grid::FirstFix,
            height_offset: 0.0,
            lever_arm: DVec3::ZERO,
            boresight: [0.0; 3],
            max_gap: f64::INFINITY,
        }
    }
}

/// The layout of a trajectory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PoseFormat {
    /// Lines of numbers.
    Text,
    /// Lines of numbers; without names in the order in which HELIOS++ writes them: x, y, z, t, roll, pitch, yaw.
    Helios,
    /// Applanix' smoothed best estimate of trajectory: records of 17 doubles.
    Sbet,
    /// TerraScan's binary trajectory (.trj).
    #[value(name = "terrascan")]
    TerraScan,
}

/// What the three angles of a pose mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AngleConvention {
    /// Yaw is the heading, clockwise from +y (north), pitch has the nose up, roll the right side down; roll is the innermost
    /// rotation (ARINC 705).
    ///
    /// See [`crate::geom::Rotation::of_heading`].
    #[value(alias = "arinc705")]
    #[serde(alias = "arinc705")]
    Heading,
    /// Yaw turns counter-clockwise from +x (east); pitch, roll and order as with headings.
    Yaw,
    /// Rz(yaw) Ry(pitch) Rx(roll) of the axes forward, left, up, as in ROS (REP 103): yaw turns counter-clockwise from +x
    /// (east), pitch is positive with the nose down, roll with the right side down.
    Ros,
    /// The angles of headings in the order of HELIOS++, pitch innermost: Rz(−yaw) Ry(roll) Rx(pitch) of the axes right,
    /// forward, up.
    ///
    /// Spec kinematics §2.6.
    Helios,
    /// Rotations about x, y and z in this order, as HELIOS++ writes them for platforms that fly from waypoint to waypoint.
    Canonical,
}

impl AngleConvention {
    /// How HELIOS++ reports these angles in its trajectory files.
    pub fn rotation_spec(self) -> RotationSpec {
        match self {
            AngleConvention::Canonical => RotationSpec::Canonical,
            _ => RotationSpec::Arinc705,
        }
    }
}

/// The unit of angles in text.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AngleUnit {
    /// Degrees.
    Deg,
    /// Radians.
    Rad,
}

/// The rectangular grid to which latitudes and longitudes are projected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Grid {
    /// The UTM zone in which the first pose lies.
    FirstFix,
    /// This UTM zone.
    Utm(UtmZone),
    /// The scene's coordinate reference system, which is no UTM zone: nothing can be projected.
    Foreign,
}

impl Grid {
    /// The grid of a scene whose coordinate reference system may be known; a zone that is chosen stays.
    pub fn of_scene(self, crs_wkt: Option<&str>) -> Grid {
        match (self, crs_wkt) {
            (Grid::FirstFix, Some(wkt)) => UtmZone::of_wkt(wkt).map_or(Grid::Foreign, Grid::Utm),
            _ => self,
        }
    }
}
