//! How far the subrays went, and what would be received from there.

use super::energy::{Block, LANES};
use super::instrument::Instrument;
use crate::geom::DVec3;
use crate::scene::Scene;
use crate::tree::{Hits, RayGroup, prefetch};

/// The traced subrays of a pulse.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shot<'a> {
    /// Where all of them began, m.
    pub origin: DVec3,
    /// x, y and z of each.
    pub directions: [&'a [Block]; 3],
    /// How far each went, in units of its direction.
    pub t: &'a [Block],
    /// What each met: as many as there are subrays; the others are filled up to whole blocks.
    pub primitive: &'a [u32],
    /// The same in whole blocks.
    pub met: &'a [[u32; LANES]],
}

impl<'a> Shot<'a> {
    /// Pulse `pulse` of a group and what it hit.
    #[inline(always)]
    pub fn of(group: &'a RayGroup, hits: &'a Hits, pulse: usize) -> Shot<'a> {
        let row = pulse * group.stride();
        Shot {
            origin: group.origin(pulse),
            directions: group.blocks(pulse),
            t: hits.t[row..row + group.stride()].as_chunks().0,
            primitive: &hits.primitive[row..row + group.rays()],
            met: hits.primitive[row..row + group.stride()].as_chunks().0,
        }
    }

    /// Asks for what the hits will be looked up by, ahead of their turn: some of them stand for their neighbours.
    #[inline(always)]
    pub fn foresee(&self, scene: &Scene) {
        for primitive in self.primitive.iter().step_by(4) {
            let primitive = *primitive as usize;
            if let Some(triangle) = scene.geometry.triangles.get(primitive) {
                prefetch(triangle);
                scene.surface_ids.prefetch(primitive);
            }
        }
    }

    /// Blocks that the subrays fill.
    #[inline(always)]
    pub fn blocks(&self) -> usize {
        self.t.len()
    }

    /// Direction of a subray.
    #[inline(always)]
    pub fn direction(&self, i: usize) -> DVec3 {
        let [x, y, z] = self.directions.map(|d| d.as_flattened());
        DVec3::new(x[i], y[i], z[i])
    }

    /// Distance of every hit from the origin, of the point that it has in the scene's frame: that rounding decides which
    /// ranges are equal (§4.2).
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
pub(super) struct Sights {
    ranges: Vec<Block>,
    gains: Vec<Block>,
}

impl Sights {
    /// Forgets all pulses.
    pub fn clear(&mut self) {
        self.ranges.clear();
        self.gains.clear();
    }

    /// Appends the ranges of a pulse, and what an instrument gains of a perfect reflector there (§3).
    #[inline(always)]
    pub fn push(&mut self, instrument: &Instrument, shot: &Shot) {
        let (first, end) = (self.ranges.len(), self.ranges.len() + shot.t.len());
        self.ranges.resize(end, [0.0; LANES]);
        self.gains.resize(end, [0.0; LANES]);
        if instrument.corrections.radiometry {
            // Directions are unit vectors: no rounding by coordinates.
            self.ranges[first..].copy_from_slice(shot.t);
        } else {
            shot.measure(&mut self.ranges[first..]);
        }
        instrument.energy.gains(&self.ranges[first..], &mut self.gains[first..]);
    }

    /// The pulse whose first block is number `first`.
    #[inline(always)]
    pub fn of(&self, first: usize, shot: &Shot) -> Sight<'_> {
        let row = first..first + shot.t.len();
        Sight { ranges: self.ranges[row.clone()].as_flattened(), gains: self.gains[row].as_flattened() }
    }
}

/// The same of one pulse, by subray.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sight<'a> {
    /// m.
    pub ranges: &'a [f64],
    /// Intensity of a perfect reflector.
    pub gains: &'a [f64],
}
