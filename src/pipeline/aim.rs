//! Statistics of where beams point: a few pulses of every chunk are compared with the box around the scene, so that
//! the cause can be reported when a run hits nothing.

use crate::flight::Pulse;
use crate::geom::{Aabb, DVec3};

/// Pulses per chunk that are compared.
const SAMPLED_PULSES: usize = 8;
/// Maximum number of positions in an [`AimLog`].
const MAX_PLACES: usize = 64;

/// What beams are compared with, scene frame.
#[derive(Clone, Copy, Debug)]
pub struct AimTarget {
    /// Box around the scene, m.
    pub bounds: Aabb,
    /// Minimum and maximum range of the scanner, m.
    pub ranges: [f64; 2],
}

/// Counts of sampled pulses; the counts of pieces add up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aim {
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
    /// One of the origins, scene frame, m.
    pub place: Option<DVec3>,
}

impl Aim {
    pub const NONE: Aim =
        Aim { sampled: 0, towards: 0, within: 0, upwards: 0, origins: Aabb::EMPTY, place: None };

    /// Compares a sample of `pulses`, evenly spaced.
    pub fn of(target: &AimTarget, pulses: &[Pulse]) -> Aim {
        let mut aim = Aim::NONE;
        for pulse in pulses.iter().step_by(pulses.len().div_ceil(SAMPLED_PULSES).max(1)) {
            aim.add_beam(target, pulse.origin, pulse.attitude.forward());
        }
        aim
    }

    fn add_beam(&mut self, target: &AimTarget, origin: DVec3, direction: DVec3) {
        self.sampled += 1;
        self.upwards += u64::from(direction.z > 0.0);
        self.origins = self.origins.with(origin);
        self.place = self.place.or(Some(origin));
        if let Some((enter, leave)) = target.bounds.slabs(origin, direction).filter(|(_, leave)| *leave > 0.0)
        {
            self.towards += 1;
            let [nearest, farthest] = target.ranges;
            self.within += u64::from(enter <= farthest && leave >= nearest);
        }
    }

    pub fn add(&mut self, other: &Aim) {
        self.sampled += other.sampled;
        self.towards += other.towards;
        self.within += other.within;
        self.upwards += other.upwards;
        self.origins = self.origins.union(other.origins);
        self.place = self.place.or(other.place);
    }
}

/// The sum of all pieces, and positions evenly spread over the flight.
#[derive(Clone, Debug)]
pub struct AimLog {
    pub sum: Aim,
    /// Positions, scene frame, m.
    pub places: Vec<DVec3>,
    /// Number of pieces from one kept position to the next, and number of pieces since the last.
    stride: u32,
    since: u32,
}

impl Default for AimLog {
    fn default() -> AimLog {
        AimLog { sum: Aim::NONE, places: Vec::new(), stride: 1, since: 0 }
    }
}

impl AimLog {
    /// Adds a piece. Every second position is removed when there are more than [`MAX_PLACES`].
    pub fn add(&mut self, piece: &Aim) {
        self.sum.add(piece);
        let Some(place) = piece.place else { return };
        self.since += 1;
        if self.since < self.stride && !self.places.is_empty() {
            return;
        }
        self.since = 0;
        self.places.push(place);
        if self.places.len() > MAX_PLACES {
            let mut keep = false;
            self.places.retain(|_| {
                keep = !keep;
                keep
            });
            self.stride *= 2;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn beams_are_sorted_by_where_they_point() {
        let bounds = Aabb { min: DVec3::new(-10.0, -10.0, 0.0), max: DVec3::new(10.0, 10.0, 5.0) };
        let target = AimTarget { bounds, ranges: [2.0, 100.0] };
        let looks = |origin: [f64; 3], direction: DVec3| {
            let mut aim = Aim::NONE;
            aim.add_beam(&target, origin.into(), direction);
            (aim.towards, aim.within, aim.upwards)
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
    fn places_stay_few_and_spread() {
        let mut log = AimLog::default();
        for i in 0..10_000 {
            log.add(&Aim { sampled: 1, place: Some(DVec3::X * f64::from(i)), ..Aim::NONE });
        }
        assert!((MAX_PLACES / 2..=MAX_PLACES).contains(&log.places.len()), "{}", log.places.len());
        assert!(log.places[0].x == 0.0 && log.places.last().unwrap().x > 9500.0);
        assert_eq!(log.sum.sampled, 10_000);
    }
}
