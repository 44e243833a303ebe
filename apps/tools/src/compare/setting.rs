//! Both clouds, prepared for measurement, and the results.

use super::chance::Halves;
use super::cut::{CellGrid, Cut, of_both};
use super::pulses::{MissingPulses, Pulses, PulsesError};
use super::quantity::{Definition, MAX_VALUES, Quantity, evenly};
use super::statistic::Statistic;
use super::terrain::Terrain;

/// Values of cells by the points in them and their weight.
pub(super) type CellValues<'v> = dyn Fn(&mut dyn Iterator<Item = [f64; 3]>, f64) -> Vec<f64> + Sync + 'v;

/// Both clouds, ready to be measured.
pub(super) struct Setting<'a> {
    pub cuts: [&'a Cut<'a>; 2],
    pub pulses: [Result<Pulses<'a>, PulsesError>; 2],
    /// The block of each point of the first cloud, and its halves; without halves no blocks.
    pub blocks: Vec<u32>,
    pub halves: Option<Halves>,
    pub grid: CellGrid,
    /// The lowest points of both clouds in wide cells, which heights refer to without a terrain.
    pub wide_grid: CellGrid,
    pub lowest: Vec<f64>,
    pub terrain: Option<Terrain<'a>>,
    /// Maximum number of points of each cloud whose height above the terrain is computed.
    pub most: usize,
}

/// Of how many points of a cut one has a value that counts.
pub(super) fn step_of_values(cut: &Cut) -> usize {
    cut.len().div_ceil(MAX_VALUES).max(1)
}

/// The quantities that both clouds have, and why others are missing.
#[derive(Default)]
pub(super) struct Findings {
    pub quantities: Vec<Quantity>,
    pub missing: Vec<String>,
}

impl Findings {
    pub fn add(&mut self, name: &str, quantity: Option<Quantity>) {
        match quantity {
            Some(quantity) => self.quantities.push(quantity),
            None => self.missing.push(format!("{name}: a cloud has no such values")),
        }
    }

    pub fn note_missing(&mut self, what: &str, why: &str) {
        self.missing.push(format!("{what}: {why}"));
    }
}

impl Setting<'_> {
    pub fn define(
        &self,
        group: &'static str,
        name: &str,
        (unit, per): (&'static str, &'static str),
        statistics: &[Statistic],
        meaning: &str,
    ) -> Definition {
        Definition {
            group,
            name: name.to_owned(),
            unit,
            per,
            meaning: meaning.to_owned(),
            is_whole: false,
            errors: None,
            statistics: statistics.to_vec(),
        }
    }

    /// The quantity of a value of each point, or of every n-th point of the first cloud for a step of n; NaN
    /// where a point has none.
    pub fn of_points(
        &self,
        definition: Definition,
        [mut first, mut second]: [Vec<f64>; 2],
        step: usize,
    ) -> Option<Quantity> {
        second.retain(|value| !value.is_nan());
        if self.halves.is_none() {
            first.retain(|value| !value.is_nan());
            return definition.compare(first, second, None, None);
        }
        let blocks = self.blocks.iter().copied().step_by(step);
        let first = first.into_iter().zip(blocks).filter(|(value, _)| !value.is_nan());
        definition.measure(first, second, self.halves.as_ref())
    }

    /// The quantity of a value of each cell, by the points in the cells.
    pub fn of_cells(&self, definition: Definition, values: &CellValues) -> Option<Quantity> {
        let [first, second] = of_both(self.cuts, |cut| values(&mut cut.offsets(), cut.weight));
        let of_split = self.halves.as_ref().map(|halves| {
            move |split: usize| {
                [0, 1].map(|half| {
                    let points = self.cuts[0].offsets().zip(&self.blocks);
                    let mut points = points
                        .filter(|(_, block)| halves.half(split, **block) == half)
                        .map(|(offset, _)| offset);
                    // A half has half the points.
                    values(&mut points, 2.0 * self.cuts[0].weight)
                })
            }
        });
        let of_split = of_split.as_ref().map(|of| of as &(dyn Fn(usize) -> [Vec<f64>; 2] + Sync));
        definition.compare(first, second, None, of_split)
    }

    /// The block of a point of the first cloud.
    pub fn block(&self, point: u32) -> u32 {
        self.blocks.get(point as usize).copied().unwrap_or(0)
    }

    /// The pulses of both clouds, unless one has none.
    pub fn both_pulses(&self) -> Result<[&Pulses<'_>; 2], MissingPulses> {
        match &self.pulses {
            [Ok(first), Ok(second)] => Ok([first, second]),
            [Err(reason), _] => Err(MissingPulses { cloud: "first", reason: *reason }),
            [_, Err(reason)] => Err(MissingPulses { cloud: "second", reason: *reason }),
        }
    }

    /// Measures values with their lines.
    pub fn of_lines<V>(&self, definition: Definition, [first, second]: [V; 2]) -> Option<Quantity>
    where
        V: IntoIterator<Item = (f64, u32)>,
    {
        // One cloud after the other, so that the columns of one are in memory.
        let first = evenly(first, MAX_VALUES);
        self.cuts[0].points.release();
        let second = evenly(second.into_iter().map(|(value, _)| value), MAX_VALUES);
        self.cuts[1].points.release();
        definition.measure(first, second, self.halves_of_lines())
    }

    /// The halves of the first cloud, if they consist of scan lines.
    pub fn halves_of_lines(&self) -> Option<&Halves> {
        self.halves.as_ref().filter(|_| self.pulses[0].as_ref().is_ok_and(|pulses| pulses.has_lines))
    }

    /// Frees the memory of pulses and terrain, when all quantities are measured.
    pub fn free(&mut self) {
        self.pulses.iter_mut().flatten().for_each(Pulses::free);
        self.terrain = None;
    }

    /// World height of the lower corner of the common box, m.
    pub fn corner(&self) -> f64 {
        let cut = self.cuts[0];
        cut.points.position(cut.index(0)).z - cut.offset(0)[2]
    }
}
