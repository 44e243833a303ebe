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
    /// A trajectory about which nothing is said but where it is.
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
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PoseFormat {
    /// Lines of numbers.
    Text,
    /// Lines of numbers; without names in the order in which HELIOS++ writes them: x, y, z, t, roll, pitch, yaw.
    Helios,
    /// Applanix' smoothed best estimate of trajectory: records of 17 doubles.
    Sbet,
    /// TerraScan's binary trajectory (.trj).
    TerraScan,
}

impl PoseFormat {
    /// Names on the command line and in pipeline files.
    pub const NAMES: [&str; 4] = ["text", "helios", "sbet", "terrascan"];

    /// The format of that name.
    pub fn named(name: &str) -> Option<PoseFormat> {
        Some(match name {
            "text" => PoseFormat::Text,
            "helios" => PoseFormat::Helios,
            "sbet" => PoseFormat::Sbet,
            "terrascan" => PoseFormat::TerraScan,
            _ => return None,
        })
    }
}

/// What the three angles of a pose mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AngleConvention {
    /// Yaw is the heading, clockwise from +y (north), pitch has the nose up, roll the right side down; roll is the innermost
    /// rotation (ARINC 705, see [`crate::geom::Rotation::of_heading`]).
    Heading,
    /// Yaw turns counter-clockwise from +x (east); pitch, roll and order as with headings.
    Yaw,
    /// `Rz(yaw) Ry(pitch) Rx(roll)` of the axes forward, left, up, as in ROS (REP 103): yaw turns counter-clockwise from +x
    /// (east), pitch is positive with the nose down, roll with the right side down.
    Ros,
    /// The angles of headings in the reference's order, pitch innermost: `Rz(−yaw) Ry(roll) Rx(pitch)` of the axes right,
    /// forward, up (spec kinematics §2.6).
    Helios,
    /// Rotations about x, y and z in this order, as HELIOS++ writes them for platforms that fly from waypoint to waypoint.
    Canonical,
}

impl AngleConvention {
    /// Names on the command line and in pipeline files; `arinc705` is another one for `heading`.
    pub const NAMES: [&str; 6] = ["heading", "arinc705", "yaw", "ros", "helios", "canonical"];

    /// The convention of that name.
    pub fn named(name: &str) -> Option<AngleConvention> {
        Some(match name {
            "heading" | "arinc705" => AngleConvention::Heading,
            "yaw" => AngleConvention::Yaw,
            "ros" => AngleConvention::Ros,
            "helios" => AngleConvention::Helios,
            "canonical" => AngleConvention::Canonical,
            _ => return None,
        })
    }

    /// How HELIOS++ reports these angles in its trajectory files.
    pub fn rotation_spec(self) -> RotationSpec {
        match self {
            AngleConvention::Canonical => RotationSpec::Canonical,
            _ => RotationSpec::Arinc705,
        }
    }
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
    /// The grid of a scene whose coordinate reference system may be known; what `self` says already stays.
    pub fn of_scene(self, crs_wkt: Option<&str>) -> Grid {
        match (self, crs_wkt) {
            (Grid::FirstFix, Some(wkt)) => UtmZone::of_wkt(wkt).map_or(Grid::Foreign, Grid::Utm),
            _ => self,
        }
    }
}

/// What a command line or a pipeline file says of a trajectory; the meanings are those of [`PoseStream`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PoseChoices {
    /// Where the poses come from.
    pub path: Option<PathBuf>,
    /// The layout.
    pub format: Option<PoseFormat>,
    /// How the angles compose.
    pub rotation: Option<AngleConvention>,
    /// Angles are degrees.
    pub degrees: Option<bool>,
    /// Columns of text.
    pub columns: Option<Vec<String>>,
    /// Column separator.
    pub separator: Option<char>,
    /// The UTM zone.
    pub utm_zone: Option<UtmZone>,
    /// Added to all heights, m.
    pub height_offset: Option<f64>,
    /// Offset of the scanner, m.
    pub lever_arm: Option<DVec3>,
    /// Misalignment of the scanner, rad.
    pub boresight: Option<[f64; 3]>,
    /// Longest gap within which pulses are fired, s.
    pub max_gap: Option<f64>,
}

impl PoseChoices {
    /// These choices, and those of `other` where nothing is chosen.
    pub fn or(self, other: PoseChoices) -> PoseChoices {
        PoseChoices {
            path: self.path.or(other.path),
            format: self.format.or(other.format),
            rotation: self.rotation.or(other.rotation),
            degrees: self.degrees.or(other.degrees),
            columns: self.columns.or(other.columns),
            separator: self.separator.or(other.separator),
            utm_zone: self.utm_zone.or(other.utm_zone),
            height_offset: self.height_offset.or(other.height_offset),
            lever_arm: self.lever_arm.or(other.lever_arm),
            boresight: self.boresight.or(other.boresight),
            max_gap: self.max_gap.or(other.max_gap),
        }
    }

    /// The trajectory with the defaults of what is not chosen; `None` where nobody says where it is.
    pub fn stream(self) -> Option<PoseStream> {
        let usual = PoseStream::at(self.path?);
        Some(PoseStream {
            format: self.format,
            rotation: self.rotation,
            degrees: self.degrees.unwrap_or(usual.degrees),
            columns: self.columns,
            separator: self.separator,
            grid: self.utm_zone.map_or(usual.grid, Grid::Utm),
            height_offset: self.height_offset.unwrap_or(usual.height_offset),
            lever_arm: self.lever_arm.unwrap_or(usual.lever_arm),
            boresight: self.boresight.unwrap_or(usual.boresight),
            max_gap: self.max_gap.unwrap_or(usual.max_gap),
            path: usual.path,
        })
    }
}
