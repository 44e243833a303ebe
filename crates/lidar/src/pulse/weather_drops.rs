//! The beam in the weather of a leg, and the drops and flakes that it holds.
//!
//! Large drops of a beam form a Poisson process over its volume: the volume between a drop and the next one
//! has the exponential distribution.

use super::beam_volume::BeamVolume;
use super::footprint::Footprint;
use super::weather::{Air, Drops, MIN_DIAMETER};
use libm::{exp, hypot, log, sincos, sqrt};
use std::f64::consts::TAU;
use vlscan_base::rng::{self, Stream};
use vlscan_geom::{DVec3, unit};
use vlscan_survey::{BeamProfile, Weather};

/// Ranges between which transmitter and receiver begin to overlap, linearly, m, for instruments that do not
/// state their overlap (Hahner et al. 2021, "Fog simulation on real LiDAR point clouds for 3D object
/// detection in adverse weather").
const CROSSOVER: [f64; 2] = [0.9, 1.0];
/// Minimum range of scattered light, m.
const MIN_RANGE: f64 = 0.05;

/// Weather of an instrument in a leg.
#[derive(Clone, Debug)]
pub(super) struct WeatherModel {
    weather: Weather,
    /// nm.
    wavelength: f64,
    beam: Footprint,
    volume: BeamVolume,
    /// Ranges between which transmitter and receiver begin to overlap, linearly, m, unless the gains have
    /// their overlap.
    crossover: Option<[f64; 2]>,
}

impl WeatherModel {
    /// The model of a beam; `None` in clear air. `has_overlap` is true if the gains of the instrument include
    /// the overlap of transmitter and receiver.
    pub fn new(
        weather: &Weather,
        wavelength: f64,
        beam: Footprint,
        has_overlap: bool,
    ) -> Option<WeatherModel> {
        let crossover = (!has_overlap).then_some(CROSSOVER);
        (!weather.is_clear()).then(|| WeatherModel {
            weather: weather.clone(),
            wavelength,
            beam,
            volume: BeamVolume::new(&beam),
            crossover,
        })
    }

    /// The air at a time, ns of the GPS week; `None` if it is clear.
    pub fn air(&self, time_ns: f64) -> Option<Air> {
        let air = Air::new(&self.weather, &self.weather.at(time_ns / 1e9), self.wavelength);
        (air.extinction > 0.0).then_some(air)
    }

    /// Ranges between which transmitter and receiver begin to overlap, m; `None` if the gains have their
    /// overlap.
    pub fn crossover(&self) -> Option<[f64; 2]> {
        self.crossover
    }

    /// Share of the light from a range that reaches the receiver.
    pub fn overlap(&self, range: f64) -> f64 {
        self.crossover.map_or(1.0, |[from, to]| ((range - from) / (to - from)).clamp(0.0, 1.0))
    }

    /// Smallest range from which light reaches the receiver, m.
    pub fn nearest(&self) -> f64 {
        self.crossover.map_or(MIN_RANGE, |[from, _]| from)
    }

    /// Product of the radii of the beam along its two axes at a range, m².
    pub fn square(&self, range: f64) -> f64 {
        self.volume.square(range)
    }

    /// Range up to which the beam has a volume, m; infinite for a beam without width.
    pub fn range_of_volume(&self, volume: f64) -> f64 {
        self.volume.range(volume)
    }

    /// Brightness of the beam over its mean within its radius, at the `share`, 0 to 1, of its area.
    pub fn brightness(&self, share: f64) -> f64 {
        match self.beam.profile {
            BeamProfile::TopHat => 1.0,
            BeamProfile::Gaussian => 2.0 * exp(-2.0 * share) / (1.0 - exp(-2.0)),
        }
    }

    /// Direction from the origin of a pulse to a drop, beam frame.
    pub fn direction_of(&self, drop: &SingleDrop) -> DVec3 {
        let Footprint { half_angles, exit_radius, .. } = self.beam;
        let (sine, cosine) = sincos(drop.place.1);
        let [x, z] = half_angles.map(|angle| sqrt(drop.place.0) * hypot(exit_radius, angle * drop.range));
        unit(DVec3::new(x * cosine, drop.range, z * sine))
    }
}

/// A drop or flake in the beam.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SingleDrop {
    /// m.
    pub range: f64,
    /// mm.
    pub diameter: f64,
    /// Place across the beam: share of its area within the distance from the axis, and the angle, rad.
    pub place: (f64, f64),
    /// Light that it returns over the square of its radius, 1/sr.
    pub backscatter: f64,
}

/// Replaces `out` by the drops of a pulse up to a range, m, by kind and range.
pub(super) fn draw_drops(
    model: &WeatherModel,
    air: &Air,
    stream: &Stream,
    (device, pulse): (u32, u64),
    limit: f64,
    out: &mut Vec<SingleDrop>,
) {
    out.clear();
    let volume = model.volume.up_to(limit);
    for (kind, drops) in (0u32..).zip(&air.drops) {
        let Some(drops) = drops else { continue };
        let number = drops.number(MIN_DIAMETER);
        if number <= 0.0 {
            continue;
        }
        let (mut passed, mut counter) = (0.0, kind << 24);
        loop {
            let [a, b, c, d] = stream.bits(device, pulse, counter);
            passed -= log(rng::open_unit(a, b)) / number;
            if passed >= volume {
                break;
            }
            let place = stream.bits(device, pulse, counter + 1);
            out.push(drop_at(model, drops, passed, ([c, d], place)));
            counter += 2;
        }
    }
}

/// The drop behind a volume of the beam, m³, by draws of its diameter and of its place across the beam.
fn drop_at(
    model: &WeatherModel,
    drops: &Drops,
    volume: f64,
    ([high, low], [a, b, c, d]): ([u32; 2], [u32; 4]),
) -> SingleDrop {
    SingleDrop {
        range: model.range_of_volume(volume),
        diameter: drops.diameter(rng::open_unit(high, low)),
        place: (rng::open_unit(a, b), TAU * rng::open_unit(c, d)),
        backscatter: drops.backscatter,
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use std::f64::consts::PI;
    use vlscan_base::rng::Purpose;
    use vlscan_survey::AirState;

    pub fn model(half_angle: f64, exit_radius: f64) -> WeatherModel {
        let beam = Footprint { profile: BeamProfile::Gaussian, half_angles: [half_angle; 2], exit_radius };
        let weather = Weather { air: AirState { fog: 0.1, ..AirState::default() }, ..Weather::CLEAR };
        WeatherModel::new(&weather, 905.0, beam, false).unwrap()
    }

    pub fn air(state: AirState) -> Air {
        Air::new(&Weather::CLEAR, &state, 905.0)
    }

    pub fn near(found: f64, expected: f64, tolerance: f64) {
        assert!((found / expected - 1.0).abs() <= tolerance, "{found:e} is not {expected:e}");
    }

    pub fn rain() -> Air {
        air(AirState { rain: 10.0, ..AirState::default() })
    }

    #[test]
    fn the_beam_has_the_volume_of_its_cone() {
        let (cone, wide) = (model(1.5e-3, 0.0), model(1.5e-3, 0.01));
        near(cone.volume.up_to(50.0), PI * 125_000.0 * 9e-6 / 12.0, 1e-12);
        for model in [&cone, &wide, &model(0.0, 0.01)] {
            for range in [1e-3, 0.5, 20.0, 3000.0] {
                near(model.range_of_volume(model.volume.up_to(range)), range, 1e-9);
            }
        }
        assert_eq!(model(0.0, 0.0).range_of_volume(1.0), f64::INFINITY);
        let mean = (0..1000).map(|i| cone.brightness((f64::from(i) + 0.5) / 1000.0)).sum::<f64>() / 1000.0;
        near(mean, 1.0, 1e-6);
    }

    #[test]
    fn a_beam_holds_the_drops_of_its_volume() {
        let (model, air, mut drops) = (model(1.5e-3, 0.0), rain(), Vec::new());
        let stream = Stream::new(5, Purpose::WeatherDrop);
        let mut of_pulse = |pulse: u64, limit: f64| {
            draw_drops(&model, &air, &stream, (0, pulse), limit, &mut drops);
            let nearest = drops.first().map_or(f64::INFINITY, |drop: &SingleDrop| drop.range);
            assert!(drops.iter().all(|drop| drop.range <= limit && drop.diameter >= 0.5));
            (drops.len() as f64, nearest)
        };
        let expected = air.large_drops() * model.volume.up_to(50.0);
        near(expected, 263.311893, 1e-7);
        let pulses = 2000;
        let count = (0..pulses).map(|pulse| of_pulse(pulse, 50.0).0).sum::<f64>() / pulses as f64;
        near(count, expected, 0.01);
        let pulses = 20_000;
        let nearest = (0..pulses).map(|pulse| of_pulse(pulse, 25.0).1).sum::<f64>() / pulses as f64;
        near(nearest, 6.966073, 0.01);
        assert_eq!(of_pulse(77, 50.0), of_pulse(77, 50.0));
    }
}
