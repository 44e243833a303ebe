//! How well the points separate the speed from a pitch that changes steadily.
//!
//! A pitch that grows by ε per second moves a point at the time t, h below the platform, by
//! ε·t·(h·x·y, h·(1 + y²)) to the right and forward, where x and y are the tangents of its beam in these
//! directions. Over flat ground, and if y is the same for all beams, another speed has the same effect.
//! Relief and beams that look ahead and back show the difference, beyond the effects of place, roll, yaw and
//! scale.

use super::level::right_of;
use super::pulses::Pulse;
use super::recording::Recording;
use super::solution::Solution;
use super::solve::ATTITUDE;
use vlscan_geom::{DVec2, LeastSquares};

/// Maximum number of pulses that are used.
const MAX_PULSES: usize = 400_000;
/// Lines or revolutions within which the pitch counts as constant, and maximum number of such windows.
const TURNS: f64 = 2.0;
const MAX_WINDOWS: f64 = 10_000.0;
/// Minimum number of pulses of a window.
const MIN_PULSES: usize = 10;
/// Number of independent pulses of a line or revolution.
const WEIGHT: f64 = 160.0;
/// Minimum cosine of the angle of beams from the vertical.
const MIN_COSINE: f64 = 0.5;
/// Heights that scatter less, by range noise and roughness, show no relief, m.
const RELIEF: f64 = 0.05;
/// Damping of equations in which some effects are alike.
const DAMPING: f64 = 1e-9;

/// Standard deviation of the speed, m/s, by steady changes of the pitch that the points do not show.
///
/// Without points, the root mean square of the trend over the recording is the standard deviation of
/// attitudes. Least squares take these as independent in all sections, and their changes as a random walk
/// without drift, whose variance they estimate. Both pull the trend to 0 if the points do not hold it.
pub fn speed_deviation(recording: &Recording, solution: &Solution) -> f64 {
    let (model, duration) = (&solution.model, recording.duration().max(f64::MIN_POSITIVE));
    let rate = model.parameters.mirror.rate.abs();
    let window = (TURNS / rate).max(duration / MAX_WINDOWS);
    let pulses = &recording.pulses;
    let step = pulses.len().div_ceil(MAX_PULSES).max(1);
    let mut sampled: Vec<usize> = (0..pulses.len()).step_by(step).collect();
    sampled.sort_by(|a, b| pulses.time(*a).total_cmp(&pulses.time(*b)));
    let number = |i: usize| (pulses.time(i) / window).floor();
    let mut shown = 0.0;
    for of_window in sampled.chunk_by(|a, b| number(*a) == number(*b)) {
        let effects = of_window.iter().filter_map(|i| effects_of(&pulses.get(*i), solution));
        let effects: Vec<Effects> = effects.collect();
        if effects.len() < MIN_PULSES {
            continue;
        }
        let weight = (WEIGHT * window * rate / effects.len() as f64).min(1.0);
        let time = (number(of_window[0]) + 0.5) * window - 0.5 * duration;
        shown += weight * time * time * squares_of_pitch(effects);
    }
    let by_points = shown / (solution.residual * solution.residual);
    // Root mean square of the times of an even recording about their mean: duration / √12.
    let trend = 12f64.sqrt() * ATTITUDE / duration;
    let by_attitudes = solution.times.len() as f64 / (trend * trend);
    let heights = (0..pulses.len()).map(|i| pulses.position(i).z);
    let mean = heights.sum::<f64>() / pulses.len() as f64;
    let height = model.position(0.5 * duration).z - mean;
    let shown = by_attitudes + by_points;
    let of_attitudes = trend * by_attitudes / shown;
    // A walk of N steps has the information N/ε² about a trend whose steps are all of its variance. It takes
    // ε·(N/ε²)/(N/ε² + P) of the trend if the points have the information P: at most this for any ε.
    let of_walk = 0.5 * (solution.times.len() as f64 / shown).sqrt();
    height.abs() * of_attitudes.max(of_walk)
}

/// Shifts of a point to the right and forward, m/rad or m, by pitch, roll, yaw and scale.
type Effects = [DVec2; 4];

/// The effects on the point of a pulse; `None` for slanted beams.
fn effects_of(pulse: &Pulse, solution: &Solution) -> Option<Effects> {
    let beam = pulse.position - solution.model.position(pulse.time);
    let height = -beam.z;
    let ahead = solution.model.horizontal_velocity(pulse.time).normalize_or(DVec2::Y);
    let (right, forward) = (beam.truncate().dot(right_of(ahead)), beam.truncate().dot(ahead));
    let (x, y) = (right / height, forward / height);
    let pitch = DVec2::new(right * y, height + forward * y);
    let roll = DVec2::new(height + right * x, right * y);
    let (yaw, scale) = (DVec2::new(forward, -right), DVec2::new(right, 0.0));
    // False for NaN.
    (height > MIN_COSINE * beam.length()).then_some([pitch, roll, yaw, scale])
}

/// Sum of the squares of the effect of the pitch on the points of a window, m²/rad², beyond the other effects
/// and the scatter of heights.
fn squares_of_pitch(mut effects: Vec<Effects>) -> f64 {
    let count = effects.len() as f64;
    // A shift of the window has the same effect on all points.
    let mut mean = [DVec2::ZERO; 4];
    for of_pulse in &effects {
        mean.iter_mut().zip(of_pulse).for_each(|(mean, effect)| *mean += *effect / count);
    }
    let mut sums = LeastSquares::new(3);
    let mut squares = -count * RELIEF * RELIEF;
    for of_pulse in &mut effects {
        of_pulse.iter_mut().zip(mean).for_each(|(effect, mean)| *effect -= mean);
        let [pitch, others @ ..] = *of_pulse;
        sums.add(&others.map(|effect| effect.x), pitch.x, 1.0);
        sums.add(&others.map(|effect| effect.y), pitch.y, 1.0);
        squares += pitch.length_squared();
    }
    let Some(decomposition) = sums.matrix.scaled_cholesky(DAMPING, 0.0) else { return 0.0 };
    let explained = decomposition.solve(&sums.right).iter().zip(&sums.right).map(|(a, b)| a * b).sum::<f64>();
    (squares - explained).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::super::mirror::{Mirror, MirrorParameters};
    use super::super::model::{Attitude, Model};
    use super::super::parameters::{Channel, Parameters};
    use super::*;
    use libm::sin;
    use vlscan_geom::{DVec3, radians};

    /// Two seconds of a flight at 40 m/s and 500 m over ground of this height.
    fn deviation(mirror: Mirror, angle: f64, ground: impl Fn(f64) -> f64) -> f64 {
        let parameters = Parameters {
            position: DVec3::new(0.0, 0.0, 500.0),
            velocity: DVec3::new(0.0, 40.0, 0.0),
            mirror: MirrorParameters { angle: radians(angle), rate: 50.0, ..MirrorParameters::default() },
            channels: vec![Channel { phase: 1.0, ..Channel::default() }],
            ..Parameters::default()
        };
        let model = Model { mirror, parameters };
        let pulse = |k: u32| {
            let time = 1e-4 * f64::from(k);
            let mut position = DVec3::ZERO;
            for _ in 0..6 {
                let at = model.footprint(&Attitude::default(), 0, time, position.z);
                position = DVec3::new(at.x, at.y, ground(at.x));
            }
            Pulse::on_ground(time, position, 0.0)
        };
        let recording = Recording::new((0..20_000).map(pulse).collect()).unwrap();
        let solution = Solution {
            deviations: model.parameters.filled(0.0),
            model,
            times: (0..800).map(|k| f64::from(k) / 400.0).collect(),
            attitudes: vec![Attitude::default(); 800],
            residual: 0.02,
            angle_residual: 1e-4,
        };
        speed_deviation(&recording, &solution)
    }

    #[test]
    fn flat_ground_does_not_separate_the_speed_from_a_trend_of_the_pitch() {
        // 500 m times √12 · 0.02 rad in 2 s.
        let flat = deviation(Mirror::Polygon, 50.0, |_| 7.0);
        assert!((flat / (493.0 * 12f64.sqrt() * 0.01) - 1.0).abs() < 0.01, "{flat}");
        let rough = deviation(Mirror::Polygon, 50.0, |x| 0.02 * sin(40.0 * x));
        assert!((rough / flat - 1.0).abs() < 0.1, "{rough}");
    }

    #[test]
    fn relief_and_cones_separate_the_speed_from_a_trend_of_the_pitch() {
        let hills = deviation(Mirror::Polygon, 50.0, |x| 5.0 * sin(0.03 * x));
        assert!(hills < 1.0, "{hills}");
        let cone = deviation(Mirror::Cone, 20.0, |_| 0.0);
        assert!(cone < 0.2, "{cone}");
    }
}
