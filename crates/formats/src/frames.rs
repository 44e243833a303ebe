//! Frames: the points of a revolution of a scanner, or of a span of time, with the poses of the scanner
//! during that time.

use crate::AttributeSet;
use std::io::Read;
use std::path::Path;
use vlscan_base::error::Result;
use vlscan_geom::{DVec3, Rotation};

/// A point in the axes of the scanner when it was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FramePoint {
    /// m.
    pub position: [f32; 3],
    /// In the unit of the instrument.
    pub intensity: f32,
    /// Time after the start of the frame, s.
    pub time_s: f32,
    /// Row of the channel of the scanner by elevation, from the lowest up.
    pub ring: i64,
    /// Class of the surface.
    pub class: i64,
    /// Number of the object.
    pub instance: i64,
    /// Number of the return, from 1; 0 if it is unknown.
    pub return_number: i64,
    /// Number of returns of the pulse; 0 if it is unknown.
    pub number_of_returns: i64,
    /// Way of the light, see [`Cause::path`](crate::Cause::path).
    pub path: i64,
}

/// Pose of a scanner at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FramePose {
    /// ns.
    pub time_ns: u64,
    /// In the world, m.
    pub position: DVec3,
    /// From the axes of the scanner to the world.
    pub rotation: Rotation,
}

/// A frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Its start, ns.
    pub time_ns: u64,
    /// Attributes that its points have; others are 0.
    pub attributes: AttributeSet,
    /// True if return 0 of 0 marks a pulse without a return, as in files of this program.
    pub has_misses: bool,
    /// Its points.
    pub points: Vec<FramePoint>,
    /// Poses in the order of time: the last one of the frame before, and those of this frame.
    pub poses: Vec<FramePose>,
}

impl Frame {
    /// The pose at a time, ns: between the two poses around it along a line and the shortest turn, else that
    /// of the nearest one. `None` without poses.
    pub fn pose_at(&self, time_ns: f64) -> Option<FramePose> {
        let after = self.poses.partition_point(|pose| (pose.time_ns as f64) < time_ns);
        let Some(next) = self.poses.get(after) else { return self.poses.last().copied() };
        let Some(last) = after.checked_sub(1).map(|i| self.poses[i]) else { return Some(*next) };
        let share = (time_ns - last.time_ns as f64) / (next.time_ns as f64 - last.time_ns as f64);
        let (axis, angle) = last.rotation.inverse().after(next.rotation).axis_angle();
        Some(FramePose {
            time_ns: time_ns as u64,
            position: last.position + (next.position - last.position) * share,
            rotation: last.rotation.after(Rotation::about(axis, angle * share)),
        })
    }
}

/// Calls `take` with the frames of an MCAP file, in order; `path` names it in messages.
///
/// # Errors
/// [`Error::Io`](vlscan_base::Error::Io); [`Error::Input`](vlscan_base::Error::Input) for other files, for
/// damaged ones, and in a build without the feature `mcap`; those of `take`.
pub fn read_frames(
    source: &mut dyn Read,
    path: &Path,
    take: &mut dyn FnMut(Frame) -> Result<()>,
) -> Result<()> {
    #[cfg(feature = "mcap")]
    {
        crate::mcap::read_frames(source, path, take)
    }
    #[cfg(not(feature = "mcap"))]
    {
        let _ = (source, take);
        let message = format!("{}: this build does not read mcap", path.display());
        Err(vlscan_base::Error::unsupported(message, crate::point_format::build_with("mcap")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poses_are_interpolated() {
        let pose = |time_ns, x, angle| FramePose {
            time_ns,
            position: DVec3::new(x, 0.0, 0.0),
            rotation: Rotation::about_z(angle),
        };
        let poses = vec![pose(10, 1.0, 0.0), pose(20, 3.0, 0.4)];
        let (attributes, points) = (AttributeSet::default(), Vec::new());
        let frame = Frame { time_ns: 0, attributes, has_misses: false, points, poses };
        let middle = frame.pose_at(15.0).unwrap();
        assert_eq!(middle.position.x, 2.0);
        let turned = middle.rotation.apply(DVec3::X);
        assert!((turned - DVec3::new(0.2f64.cos(), 0.2f64.sin(), 0.0)).length() < 1e-12);
        assert_eq!(frame.pose_at(5.0).map(|p| p.position.x), Some(1.0));
        assert_eq!(frame.pose_at(25.0).map(|p| p.position.x), Some(3.0));
        assert_eq!(Frame { poses: Vec::new(), ..frame }.pose_at(0.0), None);
    }
}
