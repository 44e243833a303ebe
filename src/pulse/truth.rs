//! What really sent an echo: the surface of its strongest subray, and how much of the footprint took part.

use super::detect::Return;
use super::echo::EchoTruth;
use super::facet::Facets;
use super::instrument::Instrument;
use super::reflect::View;
use super::reflections::Reflections;
use super::sight::{Shot, Sight};
use crate::geom::DVec3;
use crate::tree::Hits;

/// The truth behind the reflections of a pulse, and memory for it.
#[derive(Clone, Debug, Default)]
pub(super) struct Truths {
    /// Subray of each reflection.
    subrays: Vec<u32>,
    /// For each reflection the return that it is part of, from 1; 0 if of none.
    returns: Vec<u32>,
}

impl Truths {
    /// Tells reflections apart by subray and by the return that is nearest to them, if it is nearer than the pulse is long.
    pub fn assign(
        &mut self,
        instrument: &Instrument,
        (shot, sight): (&Shot, &Sight),
        reflections: &Reflections,
        returns: &[Return],
    ) {
        self.subrays.clear();
        match reflections.subrays() {
            Some(subrays) => self.subrays.extend_from_slice(subrays),
            None => {
                let in_range = |range: f64| range >= instrument.range_min && range <= instrument.range_max;
                let reflects = |i: &usize| shot.primitive[*i] != Hits::MISS && in_range(sight.ranges[*i]);
                self.subrays.extend((0..shot.primitive.len()).filter(reflects).map(|i| i as u32));
            }
        }
        let pulse_depth = instrument.light_speed * instrument.shape.duration;
        let nearest = |entry: &f64| {
            let off = |r: &Return| (r.range - entry).abs();
            let found = (1..).zip(returns).min_by(|a, b| off(a.1).total_cmp(&off(b.1)));
            found.filter(|(_, r)| off(r) <= pulse_depth).map_or(0, |(number, _)| number)
        };
        self.returns.clear();
        self.returns.extend(reflections.entries().iter().map(nearest));
    }

    /// The truth of return `number` (from 1): of the strongest of its subrays, else of the reflection `source`.
    pub fn of_return(
        &self,
        number: u32,
        source: usize,
        view: &View,
        (shot, origin): (&Shot, DVec3),
        (reflections, facets): (&Reflections, &mut Facets),
    ) -> EchoTruth {
        let own = || (0..self.returns.len()).filter(|i| self.returns[*i] == number);
        let intensities = reflections.intensities();
        let strongest = own().max_by(|a, b| intensities[*a].total_cmp(&intensities[*b])).unwrap_or(source);
        let of_subray = self.of_reflection(strongest, view, (shot, origin), (reflections, facets));
        EchoTruth { fraction: own().count() as f64 / shot.primitive.len().max(1) as f64, ..of_subray }
    }

    /// The truth of a single reflection.
    pub fn of_reflection(
        &self,
        i: usize,
        view: &View,
        (shot, origin): (&Shot, DVec3),
        (reflections, facets): (&Reflections, &mut Facets),
    ) -> EchoTruth {
        let subray = self.subrays.get(i).copied().unwrap_or(0);
        let direction = shot.direction(subray as usize);
        let normal = facets.look_up(view, reflections.primitives()[i]).map_or(DVec3::ZERO, |f| f.normal());
        EchoTruth {
            surface: origin + direction * reflections.ranges()[i],
            normal: if normal.dot(direction) > 0.0 { -normal } else { normal },
            fraction: 1.0 / shot.primitive.len().max(1) as f64,
            subray,
        }
    }

    /// The return that a reflection is part of, from 1; 0 if of none.
    pub fn return_of(&self, reflection: usize) -> u32 {
        self.returns[reflection]
    }
}
