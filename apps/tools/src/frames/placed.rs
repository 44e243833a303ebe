//! Frames whose points are relative to the scanner at their first point, in axes with x forward, y left and z
//! up.

use vlscan_formats::{Frame, FramePose};
use vlscan_geom::{DVec3, Rotation};

/// An axis of the scanner that points forward.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum ForwardAxis {
    /// x, with y to the left: the vehicles of the catalogue.
    X,
    /// y, with x to the right.
    Y,
}

/// A point of a placed frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct PlacedPoint {
    /// In the frame, m.
    pub position: DVec3,
    /// Place of the scanner when the point was measured, in the frame, m.
    pub origin: DVec3,
    pub intensity: f32,
    /// Time after the start of the frame, s.
    pub time_s: f32,
    pub ring: i64,
    pub class: i64,
    pub instance: i64,
}

/// A frame at one pose.
#[derive(Clone, Debug)]
pub(super) struct PlacedFrame {
    /// Start of the frame, ns.
    pub time_ns: u64,
    /// From the frame to the world.
    pub pose: FramePose,
    pub points: Vec<PlacedPoint>,
}

/// A time after the start of a frame, ns.
pub(super) fn time_after(begin_ns: u64, after_s: f64) -> f64 {
    begin_ns as f64 + after_s * 1e9
}

/// Moves the points of a frame to the pose of its first point; `None` without poses. `forward` is the axis of
/// the scanner that points forward.
pub(super) fn place(frame: &Frame, forward: ForwardAxis, intensity_factor: f64) -> Option<PlacedFrame> {
    let time = |after_s: f32| time_after(frame.time_ns, f64::from(after_s));
    let forwards = |v: DVec3| match forward {
        ForwardAxis::X => v,
        ForwardAxis::Y => DVec3::new(v.y, -v.x, v.z),
    };
    let first = frame.points.iter().map(|point| point.time_s).fold(f32::INFINITY, f32::min);
    let pose = frame.pose_at(if first.is_finite() { time(first) } else { time(0.0) })?;
    let back = pose.rotation.inverse();
    // Points of one pulse, and of pulses at once, have one pose.
    let (mut latest, mut at) = (f32::NAN, pose);
    let mut points = Vec::with_capacity(frame.points.len());
    for point in &frame.points {
        if point.time_s != latest {
            (latest, at) = (point.time_s, frame.pose_at(time(point.time_s))?);
        }
        let own = DVec3::from(point.position.map(f64::from));
        let way = at.position - pose.position;
        points.push(PlacedPoint {
            position: forwards(back.apply(at.rotation.apply(own) + way)),
            origin: forwards(back.apply(way)),
            time_s: point.time_s,
            intensity: (f64::from(point.intensity) * intensity_factor) as f32,
            ring: point.ring,
            class: point.class,
            instance: point.instance,
        });
    }
    let rotation = match forward {
        ForwardAxis::X => pose.rotation,
        ForwardAxis::Y => pose.rotation.after(Rotation::about_z(std::f64::consts::FRAC_PI_2)),
    };
    Some(PlacedFrame { time_ns: frame.time_ns, pose: FramePose { rotation, ..pose }, points })
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_formats::{AttributeSet, FramePoint};

    #[test]
    fn a_wall_is_where_it_is_however_the_scanner_moves() {
        // 10 m/s forwards (y): the wall 50 m ahead comes nearer.
        let pose = |time_ns: u64| FramePose {
            time_ns,
            position: DVec3::new(5e5, time_ns as f64 * 1e-8, 2.0),
            rotation: Rotation::about_z(0.3 * time_ns as f64 * 1e-8),
        };
        let poses: Vec<FramePose> = (0..=10).map(|i| pose(i * 10_000_000)).collect();
        let wall = DVec3::new(5e5, 50.0, 2.0);
        let points = (0..100u64).map(|i| {
            let at = pose(i * 1_000_000);
            let local = at.rotation.inverse().apply(wall - at.position);
            FramePoint {
                position: local.to_array().map(|c| c as f32),
                intensity: 2.0,
                time_s: (i as f64 * 1e-3) as f32,
                ring: 0,
                class: 0,
                instance: 0,
                return_number: 1,
                number_of_returns: 1,
                path: 0,
            }
        });
        let (attributes, points) = (AttributeSet::default(), points.collect());
        let frame = Frame { time_ns: 0, attributes, has_misses: false, points, poses };
        let placed = place(&frame, ForwardAxis::X, 0.5).unwrap();
        assert_eq!(placed.pose.position.y, 0.0);
        for point in &placed.points {
            assert!((point.position - DVec3::new(0.0, 50.0, 0.0)).length() < 1e-4, "{}", point.position);
            assert_eq!(point.intensity, 1.0);
        }
        let turned = place(&frame, ForwardAxis::Y, 0.5).unwrap();
        for (point, other) in placed.points.iter().zip(&turned.points) {
            assert!((other.position - DVec3::new(50.0, 0.0, 0.0)).length() < 1e-4, "{}", other.position);
            let [a, b] =
                [(&placed, point), (&turned, other)].map(|(frame, p)| frame.pose.rotation.apply(p.position));
            assert!((a - b).length() < 1e-9, "{a} {b}");
        }
        assert!(place(&Frame { poses: Vec::new(), ..frame }, ForwardAxis::X, 1.0).is_none());
    }
}
