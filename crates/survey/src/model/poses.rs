//! Settings of recorded trajectories: source, layout and meaning of the poses.

use super::RotationSpec;
use std::path::PathBuf;
use std::sync::Arc;
use vlscan_geom::{DVec3, UtmZone};

/// Settings of a trajectory that is flown while its poses arrive (`--trajectory`, `[trajectory]`).
#[derive(Clone, Debug, PartialEq)]
pub struct PoseStream {
    /// Source of the poses; `-` is standard input.
    pub path: PathBuf,
    /// The bytes of a trajectory in memory; `path` is then its name in messages.
    pub content: Option<Arc<[u8]>>,
    /// The layout; `None` detects it from the content.
    pub format: Option<PoseFormat>,
    /// Composition of the angles of text. `None`: [`AngleConvention::Ros`] for quaternions and matrices,
    /// [`AngleConvention::Helios`] for text files of HELIOS++, [`AngleConvention::Heading`] for all others.
    /// SBET and TerraScan contain headings.
    pub rotation: Option<AngleConvention>,
    /// True if angles of text are degrees where the heading of a column names no unit.
    pub degrees: bool,
    /// Columns of text, by name in their order or as `name=number` from 1. `None`: by the header line, or in
    /// the default order time,x,y,z,roll,pitch,yaw.
    pub columns: Option<Vec<String>>,
    /// Column separator; `None` guesses from the first line.
    pub separator: Option<char>,
    /// The grid on which latitudes and longitudes are projected.
    pub grid: ProjectionGrid,
    /// Added to all heights, m.
    pub height_offset: f64,
    /// Position of the scanner's platform frame in the frame of the poses (x right, y forward, z up), m.
    pub lever_arm: DVec3,
    /// Roll, pitch and heading of the scanner's platform frame in the frame of the poses, rad, composed as
    /// headings.
    pub boresight: [f64; 3],
    /// Maximum time between poses across which pulses are fired, s.
    pub max_gap: f64,
}

impl PoseStream {
    /// Settings for the poses of a file, or of standard input for `-`, with defaults for everything else.
    pub fn at(path: impl Into<PathBuf>) -> PoseStream {
        PoseStream {
            path: path.into(),
            content: None,
            format: None,
            rotation: None,
            degrees: true,
            columns: None,
            separator: None,
            grid: ProjectionGrid::FirstFix,
            height_offset: 0.0,
            lever_arm: DVec3::ZERO,
            boresight: [0.0; 3],
            max_gap: f64::INFINITY,
        }
    }
}

vlscan_choice::choices! {
    /// The layout of a trajectory.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum PoseFormat {
        /// Lines of numbers.
        Text = "text",
        /// Lines of numbers; without names in the order in which HELIOS++ writes them: x, y, z, t, roll,
        /// pitch, yaw.
        Helios = "helios",
        /// Applanix' smoothed best estimate of trajectory: records of 17 doubles.
        Sbet = "sbet",
        /// TerraScan's binary trajectory (.trj).
        TerraScan = "terrascan",
    }
}

vlscan_choice::choices! {
    /// Meaning of the angles of a pose, or the axes of its quaternion or matrix.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum AngleConvention {
        /// Yaw is the heading, clockwise from +y (north), pitch has the nose up, roll the right side down;
        /// roll is the innermost rotation (ARINC 705).
        ///
        /// See [`vlscan_geom::Rotation::of_heading`].
        Heading = "heading" | "arinc705",
        /// Yaw turns counter-clockwise from +x (east); pitch, roll and order as with headings.
        Yaw = "yaw",
        /// Rz(yaw) Ry(pitch) Rx(roll) of the axes forward, left, up, as in ROS (REP 103): yaw turns
        /// counter-clockwise from +x (east), pitch is positive with the nose down, roll with the right side
        /// down.
        Ros = "ros",
        /// The angles of headings in the order of HELIOS++, pitch innermost: Rz(−yaw) Ry(roll) Rx(pitch) of
        /// the axes right, forward, up.
        ///
        /// Spec kinematics §2.6.
        Helios = "helios",
        /// Rotations about x, y and z in this order, as HELIOS++ writes them for platforms that fly from
        /// waypoint to waypoint; quaternions of the axes right, forward, up.
        Canonical = "canonical",
        /// Quaternions of a camera's axes right, down, forward; the world of matrices is the first camera, as
        /// in KITTI.
        Camera = "camera",
    }
}

impl AngleConvention {
    /// The convention by which HELIOS++ reports these angles in its trajectory files.
    pub fn rotation_spec(self) -> RotationSpec {
        match self {
            AngleConvention::Canonical => RotationSpec::Canonical,
            _ => RotationSpec::Arinc705,
        }
    }
}

vlscan_choice::choices! {
    /// The unit of angles in text.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum AngleUnit {
        /// Degrees.
        Deg = "deg",
        /// Radians.
        Rad = "rad",
    }
}

/// The rectangular grid on which latitudes and longitudes are projected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProjectionGrid {
    /// The UTM zone of the first pose.
    FirstFix,
    /// This UTM zone, which was chosen.
    Utm(UtmZone),
    /// The UTM zone of the scene's coordinate reference system.
    OfScene(UtmZone),
    /// The scene's coordinate reference system, which is not a UTM zone: nothing can be projected.
    Foreign,
}

impl ProjectionGrid {
    /// The grid for a scene whose coordinate reference system may be known; a chosen zone takes precedence.
    pub fn of_scene(self, crs_wkt: Option<&str>) -> ProjectionGrid {
        match (self, crs_wkt) {
            (ProjectionGrid::FirstFix, Some(wkt)) => {
                UtmZone::of_wkt(wkt).map_or(ProjectionGrid::Foreign, ProjectionGrid::OfScene)
            }
            _ => self,
        }
    }
}
