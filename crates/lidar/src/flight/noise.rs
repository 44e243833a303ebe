//! Noise of the platform's pose (spec kinematics §7). Every source has its own random stream.

use vlscan_base::rng::{Purpose, Stream};
use vlscan_geom::{DVec3, Rotation};
use vlscan_survey::{Noise, NoiseKind, PlatformNoise};

/// Noise of the position along x, y, z and of the attitude about the x, y, z of its frame.
#[derive(Clone, Debug, Default)]
pub(super) struct PoseNoise {
    position: [Option<NoiseSource>; 3],
    attitude: [Option<NoiseSource>; 3],
}

#[derive(Clone, Debug)]
struct NoiseSource {
    noise: Noise,
    stream: Stream,
}

impl PoseNoise {
    pub fn new(noise: &PlatformNoise, seed: u64) -> PoseNoise {
        let sources = |noise: &[Option<Noise>; 3], purposes: [Purpose; 3]| {
            std::array::from_fn(|i| {
                noise[i].clone().map(|noise| NoiseSource { noise, stream: Stream::new(seed, purposes[i]) })
            })
        };
        PoseNoise {
            position: sources(&noise.position, [Purpose::PositionX, Purpose::PositionY, Purpose::PositionZ]),
            attitude: sources(&noise.attitude, [Purpose::AttitudeX, Purpose::AttitudeY, Purpose::AttitudeZ]),
        }
    }

    /// Offset of a pulse's origin, m, world axes. `pulse` counts the emitted pulses of a device from 0.
    pub fn position_offset(&self, device: u32, pulse: u64) -> DVec3 {
        let along =
            |i: usize| self.position[i].as_ref().map_or(0.0, |s: &NoiseSource| s.value(device, pulse));
        DVec3::new(along(0), along(1), along(2))
    }

    /// True if attitudes have noise.
    #[inline]
    pub fn has_attitude(&self) -> bool {
        !matches!(self.attitude, [None, None, None])
    }

    /// `attitude` with noise about x, then y, then z of its own frame; in the reference this is the beam
    /// frame.
    pub fn apply_noise(&self, attitude: Rotation, device: u32, pulse: u64) -> Rotation {
        let about: [fn(f64) -> Rotation; 3] = [Rotation::about_x, Rotation::about_y, Rotation::about_z];
        self.attitude.iter().zip(about).fold(attitude, |a, (source, about)| match source {
            Some(source) => a.after(about(source.value(device, pulse))),
            None => a,
        })
    }
}

impl NoiseSource {
    /// One drawn value applies to `lifespan` consecutive pulses; with lifespan 0 one unclipped value applies
    /// to all.
    fn value(&self, device: u32, pulse: u64) -> f64 {
        let number = pulse.checked_div(u64::from(self.noise.lifespan)).unwrap_or(u64::MAX);
        let drawn = match self.noise.kind {
            NoiseKind::Normal { mean, stdev } => self.stream.normal(device, number, 0) * stdev + mean,
            NoiseKind::Uniform { min, max } => self.stream.uniform(device, number, 0) * (max - min) + min,
        };
        match self.noise.clip {
            Some((low, high)) if self.noise.lifespan > 0 => drawn.max(low).min(high),
            _ => drawn,
        }
    }
}

/// The random vector added to the position of leg `leg` (spec kinematics §7.3).
pub(super) fn leg_offset(seed: u64, leg: u32, mean: f64, stdev: f64) -> DVec3 {
    let stream = Stream::new(seed, Purpose::LegOffset);
    let along = |counter| stream.normal(0, u64::from(leg), counter) * stdev + mean;
    DVec3::new(along(0), along(1), along(2))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn normal(lifespan: u32, clip: Option<(f64, f64)>) -> Option<Noise> {
        Some(Noise { kind: NoiseKind::Normal { mean: 0.0, stdev: 1.0 }, clip, lifespan })
    }

    fn only_x(noise: Option<Noise>) -> PoseNoise {
        PoseNoise::new(&PlatformNoise { position: [noise, None, None], attitude: [None, None, None] }, 42)
    }

    #[test]
    fn attitude_noise_acts_in_the_beam_frame() {
        // spec kinematics §7.4: n = (0.01, 0.02, 0.03)
        let fixed =
            |v: f64| Some(Noise { kind: NoiseKind::Uniform { min: v, max: v }, clip: None, lifespan: 1 });
        let noise =
            PlatformNoise { position: [None, None, None], attitude: [fixed(0.01), fixed(0.02), fixed(0.03)] };
        let beam = PoseNoise::new(&noise, 1).apply_noise(Rotation::IDENTITY, 0, 0).forward();
        assert!((beam - DVec3::new(-0.029990, 0.999494, 0.010595)).length() < 2e-6, "{beam}");
    }

    #[test]
    fn uniform_noise_fills_its_interval_evenly() {
        let noise = Noise { kind: NoiseKind::Uniform { min: -0.2, max: 0.6 }, clip: None, lifespan: 1 };
        let source = only_x(Some(noise));
        let values: Vec<f64> = (0..8000).map(|i| source.position_offset(0, i).x).collect();
        assert!(values.iter().all(|v| (-0.2..0.6).contains(v)));
        // Four standard deviations of a count of 1000 among 8000.
        for tenth in 0..8 {
            let low = -0.2 + 0.1 * f64::from(tenth);
            let count = values.iter().filter(|v| (low..low + 0.1).contains(*v)).count();
            assert!(count.abs_diff(1000) < 120, "{count} from {low}");
        }
    }

    #[test]
    fn each_attitude_source_turns_about_its_own_axis() {
        for axis in 0..3 {
            let mut attitude = [None, None, None];
            attitude[axis] = normal(1, None);
            let noise = PoseNoise::new(&PlatformNoise { position: [None, None, None], attitude }, 3);
            let angles: Vec<f64> = (0..4000)
                .map(|i| {
                    let turned = noise.apply_noise(Rotation::IDENTITY, 0, i);
                    let about = [turned.u.x, turned.u.y, turned.u.z];
                    assert!((0..3).all(|other| other == axis || about[other] == 0.0), "{turned:?}");
                    2.0 * about[axis].atan2(turned.w)
                })
                .collect();
            let mean = angles.iter().sum::<f64>() / 4000.0;
            let variance = angles.iter().map(|a| (a - mean).powi(2)).sum::<f64>() / 3999.0;
            // Four standard errors: 1/sqrt(n), and sqrt(2/n) of the variance.
            assert!(mean.abs() < 0.0633 && (variance - 1.0).abs() < 0.09, "{mean} {variance}");
        }
    }

    #[test]
    fn lifespan_repeats_and_clipping_saturates() {
        let draw = |n: &PoseNoise, i: u64| n.position_offset(0, i).x;
        let three = only_x(normal(3, None));
        assert_eq!(draw(&three, 3), draw(&three, 5));
        assert_ne!(draw(&three, 2), draw(&three, 3));
        let for_ever = only_x(normal(0, Some((7.0, 8.0))));
        assert_eq!(draw(&for_ever, 0), draw(&for_ever, 1_000_000));
        assert!(draw(&for_ever, 0) < 7.0, "the one value is not clipped");
        let clipped = only_x(normal(1, Some((-0.1, 0.2))));
        let values: Vec<f64> = (0..200).map(|i| draw(&clipped, i)).collect();
        assert!(values.iter().all(|v| (-0.1..=0.2).contains(v)));
        assert!(values.contains(&-0.1) && values.contains(&0.2));
    }

    #[test]
    fn sources_and_devices_are_independent() {
        let noise = PlatformNoise {
            position: [normal(1, None), normal(1, None), normal(1, None)],
            attitude: [None, None, None],
        };
        let n = PoseNoise::new(&noise, 42);
        let correlation = (0..2000).map(|i| n.position_offset(0, i)).map(|o| o.x * o.y).sum::<f64>() / 2000.0;
        assert!(correlation.abs() < 0.1, "{correlation}");
        assert_ne!(n.position_offset(0, 5), n.position_offset(1, 5));
        assert_ne!(leg_offset(1, 0, 0.0, 0.1), leg_offset(1, 1, 0.0, 0.1));
    }
}
