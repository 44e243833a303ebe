//! Platforms: how they move, their mounts, and the noise of their poses.

use super::poses::{PoseStream, ProjectionGrid};
use std::path::PathBuf;
use std::sync::Arc;
use vlscan_geom::{DVec3, Rotation};

/// Position and attitude of one frame within another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mount {
    /// Offset, m. The reference adds it in world axes, see spec kinematics §3.
    pub offset: DVec3,
    /// Rotation from the axes of this frame to the axes of the frame that carries it.
    pub rotation: Rotation,
}

impl Mount {
    /// No offset and no rotation: both frames coincide.
    pub const IDENTITY: Mount = Mount { offset: DVec3::ZERO, rotation: Rotation::IDENTITY };
}

/// A platform (spec input-formats §7, kinematics §2).
#[derive(Clone, Debug)]
pub struct Platform {
    /// Id of the platform in its document, for messages.
    pub id: String,
    /// How the platform moves.
    pub kind: PlatformKind,
    /// Pose of the scanner on the platform.
    pub mount: Mount,
    /// Noise of the platform's pose. Noise elements of the survey have already replaced those of the
    /// platform.
    pub noise: PlatformNoise,
}

/// Kinds of platforms; no others exist.
#[derive(Clone, Debug)]
pub enum PlatformKind {
    /// Stationary at each leg.
    Static,
    /// Flies straight from waypoint to waypoint.
    LinearPath,
    /// Steers and accelerates towards waypoints on the ground.
    GroundVehicle {
        /// Drag coefficient per step.
        drag: f64,
    },
    /// Pitches, yaws and accelerates towards waypoints in the air.
    Multicopter(Multicopter),
    /// Follows recorded poses of files, see [`TrajectoryFile`].
    Interpolated(Interpolated),
    /// Follows a stream of poses while they arrive; [`crate::Survey::legs`] then has exactly one leg.
    Stream(PoseStream),
}

impl PlatformKind {
    /// The type of the platform in XML.
    pub fn name(&self) -> &'static str {
        match self {
            PlatformKind::Static => "static",
            PlatformKind::LinearPath => "linearpath",
            PlatformKind::GroundVehicle { .. } => "groundvehicle",
            PlatformKind::Multicopter(_) => "multicopter",
            PlatformKind::Interpolated(_) => "interpolated",
            PlatformKind::Stream(_) => "stream",
        }
    }

    /// True if a platform of this kind can carry the scanner in a leg of a survey whose platform is `other`:
    /// it moves in the same way, or `other` follows poses, along which any platform can move.
    pub(crate) fn can_fly_for(&self, other: &PlatformKind) -> bool {
        match (self, other) {
            (_, PlatformKind::Interpolated(_) | PlatformKind::Stream(_)) => true,
            (PlatformKind::Static, PlatformKind::Static) => true,
            (PlatformKind::LinearPath, PlatformKind::LinearPath) => true,
            (PlatformKind::GroundVehicle { drag: a }, PlatformKind::GroundVehicle { drag: b }) => a == b,
            (PlatformKind::Multicopter(a), PlatformKind::Multicopter(b)) => a == b,
            _ => false,
        }
    }
}

/// Parameters of a multicopter (spec kinematics §2.5.1).
#[derive(Clone, Debug, PartialEq)]
pub struct Multicopter {
    /// Drag coefficient per step.
    pub drag: f64,
    /// Horizontal engine force limit.
    pub engine_max_force: f64,
    /// Acceleration factor, 1/s.
    pub speedup: f64,
    /// Braking factor, 1/s.
    pub slowdown: f64,
    /// Pitch at rest, rad.
    pub base_pitch: f64,
    /// Pitch rate, rad/s.
    pub pitch_speed: f64,
    /// Roll rate, rad/s.
    pub roll_speed: f64,
    /// Yaw rate, rad/s.
    pub yaw_speed: f64,
    /// Maximum deviation from the base pitch, rad.
    pub pitch_offset: f64,
    /// Maximum roll, rad.
    pub roll_offset: f64,
}

/// How attitude angles of a trajectory compose (spec kinematics §2.6).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RotationSpec {
    /// `Rz(−yaw)∘Ry(roll)∘Rx(pitch)`: heading clockwise from north.
    Arinc705,
    /// `Rx(roll)∘Ry(pitch)∘Rz(yaw)`.
    Canonical,
}

/// Settings of an interpolated platform.
#[derive(Clone, Debug)]
pub struct Interpolated {
    /// Composition of the attitude angles in the files.
    pub rotation_spec: RotationSpec,
    /// True if only positions are used and the attitude is the identity.
    pub position_only: bool,
    /// True if angles in the files are degrees.
    pub degrees: bool,
    /// True if the GPS clock starts at the trajectory's time.
    pub sync_gps_time: bool,
    /// The distinct files in the order of their first reference.
    pub files: Vec<TrajectoryFile>,
    /// The grid on which latitudes and longitudes are projected.
    pub grid: ProjectionGrid,
}

/// A trajectory file and how to read it.
#[derive(Clone, Debug)]
pub struct TrajectoryFile {
    /// Path of the file.
    pub path: PathBuf,
    /// The bytes of a trajectory in memory; `path` is then its name in messages.
    pub content: Option<Arc<[u8]>>,
    /// Zero-based columns of t, roll, pitch, yaw, x, y, z. `None`: by the file's header or in the default
    /// order.
    pub columns: Option<[usize; 7]>,
    /// Column separator. `None` when the survey names none: a comma, or blanks in lines without a comma.
    pub separator: Option<char>,
    /// Slope filter threshold, 0 = off. Only the first file of a survey is filtered.
    pub slope_filter: f64,
}

/// Noise of the platform's pose, per pulse (spec input-formats §2.10).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlatformNoise {
    /// Position x, y, z in metres, world axes.
    pub position: [Option<Noise>; 3],
    /// Attitude about the beam frame's x, y, z in radians.
    pub attitude: [Option<Noise>; 3],
}

/// Random noise of one quantity, in the unit of that quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct Noise {
    /// Distribution of the values.
    pub kind: NoiseKind,
    /// Limits to which a value is clamped.
    pub clip: Option<(f64, f64)>,
    /// Number of consecutive uses of one drawn value; 0 = one unclipped value throughout.
    pub lifespan: u32,
}

/// Probability distributions of noise, in the unit of the noisy quantity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NoiseKind {
    /// Normal.
    Normal {
        /// Mean.
        mean: f64,
        /// Standard deviation.
        stdev: f64,
    },
    /// Uniform.
    Uniform {
        /// Smallest value.
        min: f64,
        /// Largest value.
        max: f64,
    },
}
