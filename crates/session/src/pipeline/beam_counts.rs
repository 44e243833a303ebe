//! Statistics of where beams point: a few pulses of every chunk are compared with the box around the scene,
//! so that the cause can be reported when a run hits nothing.

use vlscan_base::rng::GOLDEN;
use vlscan_geom::{Aabb, DVec3};
use vlscan_lidar::flight::Pulse;
use vlscan_lidar::pulse::{NearPulses, WeakPulses};
use vlscan_warehouse::Series;

/// Pulses per chunk that are compared.
const SAMPLED_PULSES: usize = 8;
/// Maximum number of beams of each kind in a [`BeamLog`].
const MAX_BEAMS: usize = 256;

/// Target of the beams, scene frame.
#[derive(Clone, Copy, Debug)]
pub struct BeamTarget {
    /// Box around the scene, m.
    pub bounds: Aabb,
    /// Minimum and maximum range of the scanner, m.
    pub ranges: [f64; 2],
}

/// Counts of sampled pulses; the counts of pieces add up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BeamCounts {
    /// Pulses that were compared.
    pub sampled: u64,
    /// Pulses whose beam hits the box around the scene at any distance.
    pub towards: u64,
    /// Pulses whose beam is within the box at ranges that the scanner measures.
    pub within: u64,
    /// Pulses whose beam points above the horizon.
    pub upwards: u64,
    /// Box around the origins, scene frame, m.
    pub origins: Aabb,
    /// One of the beams, wherever it points.
    pub beam: Option<SampledBeam>,
    /// One of the beams that point at the box around the scene.
    pub aimed: Option<SampledBeam>,
    /// Of all pulses those that hit and were too weak.
    pub weak: WeakPulses,
    /// Of all pulses those that hit within the dead zone.
    pub near: NearPulses,
}

/// Origin (m) and direction of a beam, scene frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampledBeam {
    pub origin: DVec3,
    pub direction: DVec3,
}

impl BeamCounts {
    pub const NONE: BeamCounts = BeamCounts {
        sampled: 0,
        towards: 0,
        within: 0,
        upwards: 0,
        origins: Aabb::EMPTY,
        beam: None,
        aimed: None,
        weak: WeakPulses { count: 0, strongest: 0.0, threshold: 0.0 },
        near: NearPulses { count: 0, nearest: 0.0, dead_zone: 0.0, range_min: 0.0 },
    };

    /// Compares a sample of `pulses`: one of each of some equal runs, at changing places, so that no channel
    /// of the scanner and no phase of a mirror is met more often than others.
    pub fn of(target: &BeamTarget, pulses: &[Pulse]) -> BeamCounts {
        let mut beam_counts = BeamCounts::NONE;
        for run in pulses.chunks(pulses.len().div_ceil(SAMPLED_PULSES).max(1)) {
            let place = (run[0].number as f64 * GOLDEN).fract() * run.len() as f64;
            let pulse = &run[(place as usize).min(run.len() - 1)];
            beam_counts.add_beam(target, pulse.origin, pulse.attitude.forward());
        }
        beam_counts
    }

    fn add_beam(&mut self, target: &BeamTarget, origin: DVec3, direction: DVec3) {
        self.sampled += 1;
        self.upwards += u64::from(direction.z > 0.0);
        self.origins = self.origins.with(origin);
        let beam = SampledBeam { origin, direction };
        self.beam.get_or_insert(beam);
        let slabs = target.bounds.slabs(origin, direction).filter(|(_, leave)| *leave > 0.0);
        if let Some((enter, leave)) = slabs {
            self.aimed.get_or_insert(beam);
            self.towards += 1;
            let [nearest, farthest] = target.ranges;
            self.within += u64::from(enter <= farthest && leave >= nearest);
        }
    }

    pub fn add(&mut self, other: &BeamCounts) {
        self.sampled += other.sampled;
        self.towards += other.towards;
        self.within += other.within;
        self.upwards += other.upwards;
        self.origins = self.origins.union(other.origins);
        self.beam = self.beam.or(other.beam);
        self.aimed = self.aimed.or(other.aimed);
        self.weak.add(&other.weak);
        self.near.add(&other.near);
    }
}

/// The sum of all pieces, and beams evenly spread over the flight.
#[derive(Clone, Debug)]
pub struct BeamLog {
    pub sum: BeamCounts,
    /// Beams, wherever they point.
    pub beams: Series<SampledBeam>,
    /// Beams that point at the box around the scene.
    pub aimed: Series<SampledBeam>,
}

impl Default for BeamLog {
    fn default() -> BeamLog {
        BeamLog { sum: BeamCounts::NONE, beams: Series::new(MAX_BEAMS), aimed: Series::new(MAX_BEAMS) }
    }
}

impl BeamLog {
    /// Adds a piece.
    pub fn add(&mut self, piece: &BeamCounts) {
        self.sum.add(piece);
        piece.beam.into_iter().for_each(|beam| self.beams.push(beam));
        piece.aimed.into_iter().for_each(|beam| self.aimed.push(beam));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_geom::Rotation;

    #[test]
    fn beams_are_sorted_by_where_they_point() {
        let bounds = Aabb { min: DVec3::new(-10.0, -10.0, 0.0), max: DVec3::new(10.0, 10.0, 5.0) };
        let target = BeamTarget { bounds, ranges: [2.0, 100.0] };
        let looks = |origin: [f64; 3], direction: DVec3| {
            let mut beam_counts = BeamCounts::NONE;
            beam_counts.add_beam(&target, origin.into(), direction);
            (beam_counts.towards, beam_counts.within, beam_counts.upwards)
        };
        assert_eq!(looks([0.0, 0.0, 50.0], -DVec3::Z), (1, 1, 0));
        assert_eq!(looks([0.0, 0.0, 50.0], DVec3::Z), (0, 0, 1), "behind the scanner");
        assert_eq!(looks([0.0, 0.0, 106.0], -DVec3::Z), (1, 0, 0), "101 m away");
        assert_eq!(
            looks([0.0, 0.0, 4.0], DVec3::Z),
            (1, 0, 1),
            "1 m of the box ahead, nearer than the least range"
        );
        assert_eq!(looks([11.0, 0.0, 50.0], -DVec3::Z), (0, 0, 0));
    }

    #[test]
    fn all_channels_are_sampled_alike() {
        let bounds = Aabb { min: DVec3::new(-20.0, -20.0, 0.0), max: DVec3::new(20.0, 20.0, 1.0) };
        let target = BeamTarget { bounds, ranges: [0.0, 100.0] };
        for channels in [1, 16, 128] {
            // Half of the channels point down, half of them up.
            let pulse = |i: u64| {
                let (number, device) = (i / channels + 1, i % channels);
                let is_down = if channels == 1 { number % 2 == 0 } else { device < channels / 2 };
                let attitude = Rotation::about_x(if is_down { -0.5 } else { 0.5 });
                Pulse {
                    origin: DVec3::Z * 5.0,
                    attitude,
                    exact_attitude: attitude,
                    reported_attitude: attitude,
                    scanner_attitude: Rotation::IDENTITY,
                    origin_error: DVec3::ZERO,
                    time_ns: 0.0,
                    number,
                    device: device as u32,
                    scan_angle: 0.0,
                    range_error: 0.0,
                    velocity: None,
                }
            };
            let pulses: Vec<Pulse> = (0..200 * 1024).map(pulse).collect();
            let mut sum = BeamCounts::NONE;
            pulses.chunks(1024).for_each(|chunk| sum.add(&BeamCounts::of(&target, chunk)));
            let share = sum.towards as f64 / sum.sampled as f64;
            assert!(sum.sampled == 1600 && (share - 0.5).abs() < 0.05, "{channels}: {share}");
        }
    }

    #[test]
    fn the_beams_of_a_log_point_where_those_of_the_flight_do() {
        let bounds = Aabb { min: DVec3::new(-1.0, -1.0, 0.0), max: DVec3::new(1.0, 1.0, 1.0) };
        let target = BeamTarget { bounds, ranges: [0.0, 100.0] };
        let mut log = BeamLog::default();
        for _ in 0..1000 {
            let mut piece = BeamCounts::NONE;
            // One of four beams of a piece meets the box, the last one.
            let sideways = [DVec3::X, DVec3::Y, DVec3::Z, -DVec3::Z];
            sideways.iter().for_each(|direction| piece.add_beam(&target, DVec3::Z * 50.0, *direction));
            log.add(&piece);
        }
        assert_eq!((log.sum.sampled, log.sum.towards), (4000, 1000));
        assert!(log.beams.entries().iter().all(|beam| beam.direction == DVec3::X));
        assert!(log.aimed.entries().iter().all(|beam| beam.direction == -DVec3::Z));
    }
}
