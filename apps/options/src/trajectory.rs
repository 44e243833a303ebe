//! Options of recorded trajectories.

use super::choice::choice;
use super::precedence::group;
use super::values::{Finite, Latency, Positive, Vector, Zone};
use clap::Args;
use serde::Deserialize;
use std::path::PathBuf;
use std::sync::Arc;
use vlscan_geom::{DVec3, radians};
use vlscan_survey::{AngleConvention, AngleUnit, PoseFormat, PoseStream, ProjectionGrid};

group! {
/// A recorded trajectory instead of the survey's platform.
#[derive(Clone, Debug, Default, PartialEq, Args, Deserialize)]
#[command(next_help_heading = "Trajectory")]
#[serde(default)]
pub struct TrajectoryOptions {
    /// Replace the platform by a recorded trajectory, or by one from stdin (-).
    ///
    /// Text (time,x,y,z,roll,pitch,yaw), an Arrow stream with such columns, SBET or TerraScan .trj; - or
    /// STDIN reads it from stdin as it arrives.
    #[arg(id = "trajectory.path", long = "trajectory", value_name = "PATH", help_heading = "Input")]
    pub path: Option<PathBuf>,
    /// A trajectory in memory, instead of the contents of the file.
    #[arg(skip)]
    #[serde(skip)]
    pub content: Option<Arc<[u8]>>,
    /// Layout of the trajectory. [default: detected from its content]
    #[arg(
        id = "trajectory.format",
        long = "trajectory-format",
        value_name = "FORMAT",
        value_parser = choice::<PoseFormat>(),
    )]
    pub format: Option<PoseFormat>,
    /// Columns of text: names in order (time, x, y, z, roll, pitch, yaw, lat, lon, qx, qy, qz, qw; others are
    /// skipped) or name=number, from 1; a name may have a unit: roll[rad]. [default: the heading, else
    /// time,x,y,z,roll,pitch,yaw]
    #[arg(
        id = "trajectory.columns",
        long = "trajectory-columns",
        value_name = "NAMES",
        value_delimiter = ',',
    )]
    pub columns: Option<Vec<String>>,
    /// Character between columns of text. [default: detected from the first line]
    #[arg(id = "separator", long = "trajectory-separator", value_name = "CHARACTER")]
    pub separator: Option<char>,
    /// Unit of angles in text whose column names have no unit. [default: deg]
    #[arg(
        id = "angles",
        long = "trajectory-angles",
        value_name = "UNIT",
        value_parser = choice::<AngleUnit>(),
    )]
    pub angles: Option<AngleUnit>,
    /// True if angles are degrees, an older form of `angles`.
    #[arg(skip)]
    pub degrees: Option<bool>,
    /// Meaning of the angles of text, or axes of its quaternions and matrices. [default: ros for quaternions
    /// and matrices, helios for files as HELIOS++ reads and writes them, else heading]
    #[arg(
        id = "rotation",
        long = "trajectory-rotation",
        value_name = "MEANING",
        value_parser = choice::<AngleConvention>(),
    )]
    pub rotation: Option<AngleConvention>,
    /// UTM zone to which latitudes and longitudes are projected, such as 32N. [default: that of --crs, else
    /// that of the first pose]
    #[arg(long, value_name = "ZONE")]
    pub utm_zone: Option<Zone>,
    /// Added to all heights of the trajectory, in metres, for example to convert ellipsoidal heights to those
    /// of the scene.
    #[arg(id = "height_offset_m", long = "height-offset", value_name = "METRES", allow_hyphen_values = true)]
    #[serde(rename = "height_offset_m", alias = "height_offset")]
    pub height_offset: Option<Finite>,
    /// Lever arm: position of the scanner's platform frame relative to the recorded position, in metres to
    /// the right, forward and up of the recorded body. It rotates with the attitude, not with the boresight.
    #[arg(id = "lever_arm_m", long = "lever-arm", value_name = "X,Y,Z", allow_hyphen_values = true)]
    #[serde(rename = "lever_arm_m", alias = "lever_arm")]
    pub lever_arm: Option<Vector>,
    /// Boresight: rotation of the scanner's platform frame in the recorded body: roll (right side down),
    /// pitch (nose up) and heading (clockwise from above) in degrees, roll innermost. A point is at position
    /// + attitude (lever arm + boresight (point in the frame of the platform's scanner)).
    #[arg(id = "boresight_deg", long = "boresight", value_name = "R,P,H", allow_hyphen_values = true)]
    #[serde(rename = "boresight_deg", alias = "boresight")]
    pub boresight: Option<Vector>,
    /// Do not fire between poses that are farther apart than this, in seconds.
    #[arg(id = "max_gap_s", long = "max-gap", value_name = "SECONDS")]
    #[serde(rename = "max_gap_s", alias = "max_gap")]
    pub max_gap: Option<Positive>,
    /// How long, in seconds, points of a live trajectory may wait to be computed in larger batches. [default:
    /// 0.25]
    #[arg(id = "latency_s", long = "latency", value_name = "SECONDS")]
    #[serde(rename = "latency_s", alias = "latency")]
    pub latency: Option<Latency>,
}
}

impl TrajectoryOptions {
    /// The trajectory, with the defaults of what is not chosen; `None` without a path.
    pub fn stream(&self) -> Option<PoseStream> {
        let default = PoseStream::at(self.path.clone()?);
        let degrees = self.angles.map(|unit| unit == AngleUnit::Deg).or(self.degrees);
        Some(PoseStream {
            content: self.content.clone(),
            format: self.format,
            rotation: self.rotation,
            degrees: degrees.unwrap_or(default.degrees),
            columns: self.columns.clone(),
            separator: self.separator,
            grid: self.utm_zone.map_or(default.grid, |zone| ProjectionGrid::Utm(zone.0)),
            height_offset: self.height_offset.map_or(default.height_offset, |offset| offset.0),
            lever_arm: self.lever_arm.map_or(default.lever_arm, |arm| DVec3::from(arm.0)),
            boresight: self.boresight.map_or(default.boresight, |angles| angles.0.map(radians)),
            max_gap: self.max_gap.map_or(default.max_gap, |gap| gap.0),
            path: default.path,
        })
    }
}
