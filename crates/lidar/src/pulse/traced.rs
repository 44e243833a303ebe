//! Ranges of the subrays of a pulse, and the gain of the instrument there.

use super::instrument::Instrument;
use super::lanes::{Block, LANES};
use super::ray_batch::RayBatch;
use vlscan_geom::DVec3;
use vlscan_trace::Hit;

/// First hits of the light that a mirror or pane mirrors, and of that which it lets pass, if they are known;
/// see [`Hits::MISS`](vlscan_trace::Hits::MISS).
pub(super) type NextHits = [Option<Hit>; 2];

#[derive(Clone, Copy, Debug)]
pub(super) struct TracedPulse<'a> {
    /// Origin of the pulse, m.
    pub origin: DVec3,
    /// Exit of each subray from the instrument, m; empty if all leave the pulse's origin.
    pub exits: &'a [DVec3],
    /// x, y and z of their directions.
    pub directions: [&'a [Block]; 3],
    /// Distances to the hits, in units of the directions.
    pub t: &'a [Block],
    /// Primitive that each subray hit, without padding.
    pub primitives: &'a [u32],
    /// Primitive that each subray hit, padded to whole blocks.
    pub primitive_blocks: &'a [[u32; LANES]],
    /// Hits of the light of each subray behind a mirror or pane; empty if they are not traced ahead.
    pub ahead: &'a [NextHits],
}

impl<'a> TracedPulse<'a> {
    #[inline(always)]
    pub fn of(batch: &'a RayBatch, pulse: usize) -> TracedPulse<'a> {
        let RayBatch { rays: group, hits, exits, .. } = batch;
        let row = pulse * group.stride();
        TracedPulse {
            origin: group.origin(pulse),
            exits: exits.get(pulse * group.rays()..(pulse + 1) * group.rays()).unwrap_or_default(),
            directions: group.registers(pulse),
            t: hits.t[row..row + group.stride()].as_chunks().0,
            primitives: &hits.primitive[row..row + group.rays()],
            primitive_blocks: hits.primitive[row..row + group.stride()].as_chunks().0,
            ahead: &[],
        }
    }

    #[inline(always)]
    pub fn blocks(&self) -> usize {
        self.t.len()
    }

    #[inline(always)]
    pub fn direction(&self, i: usize) -> DVec3 {
        let [x, y, z] = self.directions.map(|d| d.as_flattened());
        DVec3::new(x[i], y[i], z[i])
    }

    /// Start of subray `i`, m.
    #[inline(always)]
    pub fn start(&self, i: usize) -> DVec3 {
        self.exits.get(i).copied().unwrap_or(self.origin)
    }

    /// Computes the distance of every hit from the origin through the hit point in the scene frame, whose
    /// rounding decides which ranges are equal (spec pulse-physics §4.2).
    #[inline(always)]
    fn measure(&self, ranges: &mut [Block]) {
        let (o, [x, y, z]) = (self.origin, self.directions);
        for ((((range, x), y), z), t) in ranges.iter_mut().zip(x).zip(y).zip(z).zip(self.t) {
            for i in 0..LANES {
                let (dx, dy, dz) =
                    ((o.x + x[i] * t[i]) - o.x, (o.y + y[i] * t[i]) - o.y, (o.z + z[i] * t[i]) - o.z);
                range[i] = (dx * dx + dy * dy + dz * dz).sqrt();
            }
        }
    }
}

/// Ranges and gains of the subrays of some pulses, one pulse after the other.
#[derive(Clone, Debug, Default)]
pub(super) struct GainBuffer {
    ranges: Vec<Block>,
    gains: Vec<Block>,
}

impl GainBuffer {
    pub fn clear(&mut self) {
        self.ranges.clear();
        self.gains.clear();
    }

    /// Appends the ranges of a pulse, and the intensities of a perfect reflector there (spec pulse-physics
    /// §3).
    #[inline(always)]
    pub fn push(&mut self, instrument: &Instrument, traced: &TracedPulse) {
        let (first, end) = (self.ranges.len(), self.ranges.len() + traced.t.len());
        self.ranges.resize(end, [0.0; LANES]);
        self.gains.resize(end, [0.0; LANES]);
        if instrument.detector.corrections.radiometry {
            // Directions are unit vectors: no rounding by coordinates.
            self.ranges[first..].copy_from_slice(traced.t);
        } else {
            traced.measure(&mut self.ranges[first..]);
        }
        instrument.energy.gains(&self.ranges[first..], &mut self.gains[first..]);
    }

    /// The pulse whose first block is number `first`.
    #[inline(always)]
    pub fn of(&self, first: usize, traced: &TracedPulse) -> SubrayGains<'_> {
        let row = first..first + traced.t.len();
        SubrayGains { ranges: self.ranges[row.clone()].as_flattened(), gains: self.gains[row].as_flattened() }
    }
}

/// Ranges and gains of one pulse, by subray.
#[derive(Clone, Copy, Debug)]
pub(super) struct SubrayGains<'a> {
    /// Distance of the hit, m.
    pub ranges: &'a [f64],
    /// Intensity of a perfect reflector at that range.
    pub gains: &'a [f64],
}
