//! Poses of the scanner as messages `tf2_msgs/msg/TFMessage` and `nav_msgs/msg/Odometry`.

use super::cdr::CdrWriter;
use crate::settings::FrameNames;
use vlscan_geom::{DVec3, Rotation};

/// Time between poses at most, while there are points, ns.
const STEP_NS: u64 = 10_000_000;

/// Pose of the scanner at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// ns.
    pub time_ns: u64,
    /// Origin of the beam in the world, m.
    pub position: DVec3,
    /// From the axes of the scanner to the world.
    pub rotation: Rotation,
}

/// Bytes of a pose among collected points, without its time.
pub const POSE_BYTES: usize = 56;

impl Pose {
    pub fn put(position: DVec3, rotation: Rotation, out: &mut Vec<u8>) {
        let values = position.to_array().into_iter().chain(rotation.u.to_array()).chain([rotation.w]);
        values.for_each(|value| out.extend(value.to_le_bytes()));
    }

    pub fn get(time_ns: u64, bytes: &[u8]) -> Pose {
        let value = |i: usize| f64::from_le_bytes(std::array::from_fn(|k| bytes[8 * i + k]));
        let vector = |i: usize| DVec3::new(value(i), value(i + 1), value(i + 2));
        Pose { time_ns, position: vector(0), rotation: Rotation { u: vector(3), w: value(6) } }
    }
}

/// Chooses the poses that are published: the first and the last one of each frame, and one every 10 ms
/// between them.
#[derive(Debug, Default)]
pub struct PoseTrack {
    published: Option<Pose>,
    latest: Option<Pose>,
    /// The pose whose velocity is that to the next one.
    waiting: Option<Pose>,
    /// The pose before `waiting`.
    before: Option<Pose>,
}

impl PoseTrack {
    /// Notes the pose of a point; returns it if it is to be published.
    pub fn next(&mut self, pose: Pose, begins_frame: bool) -> Option<Pose> {
        self.latest = Some(pose);
        let least = if begins_frame { 1 } else { STEP_NS };
        let is_due = self.published.is_none_or(|last| {
            // Devices may fire in another order than time; legs may restart.
            pose.time_ns.saturating_sub(last.time_ns) >= least || last.time_ns > pose.time_ns + 1_000_000_000
        });
        is_due.then(|| self.publish(pose))
    }

    /// The last pose of a frame, unless it is published already.
    pub fn end_frame(&mut self) -> Option<Pose> {
        let latest = self.latest?;
        let is_due = self.published.is_none_or(|last| latest.time_ns > last.time_ns);
        is_due.then(|| self.publish(latest))
    }

    fn publish(&mut self, pose: Pose) -> Pose {
        self.published = Some(pose);
        pose
    }

    /// The pose before `next` and the step that has its velocities: to `next`, or from the pose before to the
    /// last pose, which has no `next`.
    pub fn odometry(&mut self, next: Option<Pose>) -> Option<(Pose, [Pose; 2])> {
        let (before, waiting) = (self.before, self.waiting);
        (self.before, self.waiting) = (waiting, next);
        let pose = waiting?;
        let step = match next {
            Some(next) => [pose, next],
            None => [before.unwrap_or(pose), pose],
        };
        Some((pose, step))
    }
}

/// A transform as a message.
pub fn transform(pose: &Pose, names: &FrameNames) -> Vec<u8> {
    let mut out = CdrWriter::new();
    out.word(1);
    out.header(pose.time_ns, &names.world);
    out.string(&names.sensor);
    out.vector(pose.position);
    out.rotation(pose.rotation);
    out.0
}

/// Odometry as a message: a pose and the velocities of a step that begins or ends there, in the axes of the
/// scanner. Covariances are 0: the poses are those by which points are placed.
pub fn odometry(pose: &Pose, step: &[Pose; 2], names: &FrameNames) -> Vec<u8> {
    let [linear, angular] = velocities(pose.rotation, step);
    let mut out = CdrWriter::new();
    out.header(pose.time_ns, &names.world);
    out.string(&names.sensor);
    out.vector(pose.position);
    out.rotation(pose.rotation);
    (0..36).for_each(|_| out.double(0.0));
    out.vector(linear);
    out.vector(angular);
    (0..36).for_each(|_| out.double(0.0));
    out.0
}

/// Velocity, m/s, and angular velocity, rad/s, of a step in the axes of its first or last pose; the axis of
/// the turn is the same in both. Zero for a step without duration.
fn velocities(axes: Rotation, [from, to]: &[Pose; 2]) -> [DVec3; 2] {
    let seconds = to.time_ns.saturating_sub(from.time_ns) as f64 / 1e9;
    if seconds <= 0.0 {
        return [DVec3::ZERO; 2];
    }
    let (axis, angle) = from.rotation.inverse().after(to.rotation).axis_angle();
    [axes.inverse().apply(to.position - from.position) / seconds, axis * (angle / seconds)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn velocities_are_in_the_axes_of_the_scanner() {
        // East at 10 m/s with the forward axis to the east, turning left.
        let at = |time_ns, x, angle| Pose {
            time_ns,
            position: DVec3::new(x, 0.0, 0.0),
            rotation: Rotation::about_z(angle),
        };
        let east = -std::f64::consts::FRAC_PI_2;
        let step = [at(0, 5.0, east), at(100_000_000, 6.0, east + 0.02)];
        let [linear, angular] = velocities(step[0].rotation, &step);
        assert!((linear - DVec3::new(0.0, 10.0, 0.0)).length() < 1e-12, "{linear}");
        assert!((angular - DVec3::new(0.0, 0.0, 0.2)).length() < 1e-12, "{angular}");
        let [linear, angular] = velocities(step[1].rotation, &step);
        let turned = DVec3::new(10.0 * libm::sin(0.02), 10.0 * libm::cos(0.02), 0.0);
        assert!((linear - turned).length() < 1e-12, "{linear}");
        assert!((angular - DVec3::new(0.0, 0.0, 0.2)).length() < 1e-12, "{angular}");
        let standing = [at(5, 0.0, 0.0), at(5, 1.0, 0.0)];
        assert_eq!(velocities(Rotation::IDENTITY, &standing), [DVec3::ZERO; 2]);
    }

    #[test]
    fn the_last_pose_has_the_velocity_of_the_step_to_it() {
        let pose = |time_ns| Pose {
            time_ns,
            position: DVec3::new(0.0, 1e-8 * time_ns as f64, 0.0),
            rotation: Rotation::IDENTITY,
        };
        let mut track = PoseTrack::default();
        assert_eq!(track.odometry(Some(pose(0))), None);
        let (first, last) = (pose(0), pose(10_000_000));
        assert_eq!(track.odometry(Some(last)), Some((first, [first, last])));
        let (end, step) = track.odometry(None).unwrap();
        assert_eq!((end, step), (last, [first, last]));
        assert!((velocities(end.rotation, &step)[0] - DVec3::new(0.0, 10.0, 0.0)).length() < 1e-12);
        // A single pose has no step.
        let mut alone = PoseTrack::default();
        assert_eq!(alone.odometry(Some(first)), None);
        assert_eq!(alone.odometry(None), Some((first, [first, first])));
        assert_eq!(velocities(Rotation::IDENTITY, &[first, first]), [DVec3::ZERO; 2]);
    }

    #[test]
    fn poses_are_published_at_the_ends_of_frames_and_between() {
        let pose = |time_ns| Pose { time_ns, position: DVec3::ZERO, rotation: Rotation::IDENTITY };
        let mut track = PoseTrack::default();
        let published: Vec<u64> = (0..30u64)
            .filter_map(|ms| track.next(pose(ms * 1_000_000), ms % 15 == 0))
            .map(|pose| pose.time_ns / 1_000_000)
            .collect();
        assert_eq!(published, [0, 10, 15, 25]);
        assert_eq!(track.end_frame().map(|pose| pose.time_ns), Some(29_000_000));
        assert_eq!(track.end_frame(), None);
    }

    #[test]
    fn poses_keep_their_bits() {
        let (position, rotation) = (DVec3::new(5e5 + 0.1, 5.4e6, 300.25), Rotation::about(DVec3::ONE, 0.3));
        let mut bytes = Vec::new();
        Pose::put(position, rotation, &mut bytes);
        assert_eq!(bytes.len(), POSE_BYTES);
        assert_eq!(Pose::get(7, &bytes), Pose { time_ns: 7, position, rotation });
    }
}
