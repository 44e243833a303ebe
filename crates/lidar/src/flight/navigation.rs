//! Navigation errors: computes the reported pose from the true pose.
//!
//! The errors are functions of seed and time alone, so that any worker computes them at any time.

use libm::{cosh, exp, tanh};
use std::cell::Cell;
use vlscan_base::rng::{Purpose, Stream};
use vlscan_geom::{DVec3, Rotation};
use vlscan_survey::NavigationErrors;

/// Correlation times between two nodes of a process.
const NODE_SPACING: f64 = 8.0;
/// Draws that contribute to a node. Older ones weigh less than exp(−3·8) < 1e-10.
const NODE_TERMS: i64 = 3;
/// Bisections of the interval between two nodes, below which the process is interpolated linearly. The
/// smallest interval is 8/2¹⁵ of the correlation time, which lowers the variance in its middle by 1/8192.
const BISECTIONS: u32 = 15;
/// Smallest intervals between two nodes.
const LEAVES: u32 = 1 << BISECTIONS;
/// Number of processes of a flight: three of the position, three of the attitude.
const PROCESSES: usize = 6;

/// A smallest interval of a process, with the values at its ends.
#[derive(Clone, Copy)]
struct Leaf {
    /// Process and interval that the values belong to.
    key: Option<(Stream, i64, u32)>,
    low: f64,
    high: f64,
}

thread_local! {
    /// The latest interval of each process: successive pulses of a worker mostly lie in the same one. The
    /// values are those of a pure function, so that they do not depend on the thread.
    static LATEST: [Cell<Leaf>; PROCESSES] =
        const { [const { Cell::new(Leaf { key: None, low: 0.0, high: 0.0 }) }; PROCESSES] };
}

/// A first-order Gauss–Markov (Ornstein–Uhlenbeck) process of unit variance: mean 0, covariance exp(−|Δt|/τ)
/// (Gelb 1974, Applied Optimal Estimation, §3.8).
///
/// Nodes that are `NODE_SPACING` correlation times apart are x(k) = w Σ aʲ n(k−j) with a = exp(−NODE_SPACING)
/// and standard normal draws n, which is the process sampled there. Between two nodes it is found by
/// bisection: given its values x and y at either end of an interval of length 2δ, the value in the middle is
/// normal with mean (x + y)/(2 cosh(δ/τ)) and variance tanh(δ/τ).
#[derive(Clone, Debug)]
struct GaussMarkov {
    stream: Stream,
    /// Correlation time, s.
    correlation: f64,
    /// Weight of the mean and standard deviation of the middle, by level.
    middles: [(f64, f64); BISECTIONS as usize],
}

impl GaussMarkov {
    fn new(stream: Stream, correlation: f64) -> GaussMarkov {
        let middle = |level: usize| {
            let half = NODE_SPACING / f64::from(2 << level);
            (0.5 / cosh(half), tanh(half).sqrt())
        };
        GaussMarkov { stream, correlation, middles: std::array::from_fn(middle) }
    }

    /// The value of the process `axis` at `time` seconds.
    fn at(&self, axis: u32, time: f64) -> f64 {
        let ((first, leaf), share) = self.leaf_at(time);
        let Leaf { low, high, .. } = LATEST.with(|latest| {
            let Some(latest) = latest.get(axis as usize) else { return self.leaf(axis, first, leaf) };
            let mut found = latest.get();
            if found.key != Some((self.stream, first, leaf)) {
                found = self.leaf(axis, first, leaf);
                latest.set(found);
            }
            found
        });
        low + (high - low) * share
    }

    /// The node before a time and the smallest interval after it that holds the time, and where in the
    /// interval, from 0 to 1.
    fn leaf_at(&self, time: f64) -> ((i64, u32), f64) {
        let cells = time / (NODE_SPACING * self.correlation);
        let cell = cells.floor();
        // Products with powers of two and their fractions are exact.
        let leaves = (cells - cell) * f64::from(LEAVES);
        let leaf = (leaves as u32).min(LEAVES - 1);
        ((cell as i64, leaf), leaves - f64::from(leaf))
    }

    /// A smallest interval after the node `first`, found by bisection.
    fn leaf(&self, axis: u32, first: i64, leaf: u32) -> Leaf {
        let (mut low, mut high) = (self.node(axis, first), self.node(axis, first + 1));
        let mut index = first;
        for (level, (weight, deviation)) in (1..).zip(&self.middles) {
            let draw = self.stream.normal(axis, index as u64, level);
            let middle = (low + high) * weight + deviation * draw;
            let is_upper = (leaf >> (BISECTIONS - level)) & 1 == 1;
            index = index.wrapping_mul(2).wrapping_add(i64::from(is_upper));
            if is_upper {
                low = middle;
            } else {
                high = middle;
            }
        }
        Leaf { key: Some((self.stream, first, leaf)), low, high }
    }

    fn node(&self, axis: u32, number: i64) -> f64 {
        let a = exp(-NODE_SPACING);
        let scale = ((1.0 - a * a) / (1.0 - a.powi(2 * NODE_TERMS as i32))).sqrt();
        let sum: f64 = (0..NODE_TERMS)
            .map(|j| a.powi(j as i32) * self.stream.normal(axis, number.wrapping_sub(j) as u64, 0))
            .sum();
        scale * sum
    }
}

#[derive(Clone, Debug)]
pub(super) struct Navigation {
    errors: NavigationErrors,
    position: GaussMarkov,
    attitude: GaussMarkov,
    boresight: Rotation,
    /// From the navigation system's body to the scanner's platform frame, and back.
    mounting: [Rotation; 2],
    /// The platform frame's position relative to the navigation system, m, in its body axes: true and
    /// reported.
    arm: DVec3,
    reported_arm: DVec3,
}

/// Rows of draws: 0–2 position, 3–5 attitude, 6–8 boresight, 9–11 lever arm.
const ATTITUDE: u32 = 3;
const BORESIGHT: u32 = 6;
const LEVER_ARM: u32 = 9;

impl Navigation {
    /// Navigation errors under `seed`, for a platform whose frame is at `arm` in the navigation system's body
    /// and rotated by `boresight` relative to it.
    pub fn new(errors: NavigationErrors, seed: u64, arm: DVec3, boresight: [f64; 3]) -> Navigation {
        let stream = Stream::new(seed, Purpose::Navigation);
        let drawn = |row: u32, constant: [f64; 3], sigma: [f64; 3]| -> [f64; 3] {
            std::array::from_fn(|i| constant[i] + sigma[i] * stream.normal(row + i as u32, 0, 0))
        };
        let [roll, pitch, heading] = drawn(BORESIGHT, errors.boresight, errors.boresight_sigma);
        let mounting = Rotation::of_heading(boresight[0], boresight[1], boresight[2]);
        Navigation {
            errors,
            position: GaussMarkov::new(stream, errors.position_correlation),
            attitude: GaussMarkov::new(stream, errors.attitude_correlation),
            boresight: Rotation::of_heading(roll, pitch, heading),
            mounting: [mounting, mounting.inverse()],
            arm,
            reported_arm: arm + DVec3::from(drawn(LEVER_ARM, errors.lever_arm, errors.lever_arm_sigma)),
        }
    }

    /// Errors of the reported position to the east, north and up, m, `time` seconds after the start of the
    /// flight.
    fn position_error(&self, time: f64) -> DVec3 {
        let e = &self.errors;
        DVec3::from(std::array::from_fn::<f64, 3, _>(|i| {
            let random =
                if e.position[i] > 0.0 { e.position[i] * self.position.at(i as u32, time) } else { 0.0 };
            e.position_bias[i] + random
        }))
    }

    /// Errors of the reported roll, pitch and heading, rad.
    fn attitude_error(&self, time: f64) -> [f64; 3] {
        let e = &self.errors;
        std::array::from_fn(|i| {
            let row = ATTITUDE + i as u32;
            let random = if e.attitude[i] > 0.0 { e.attitude[i] * self.attitude.at(row, time) } else { 0.0 };
            e.attitude_bias[i] + e.attitude_drift[i] * time + random
        })
    }

    /// Reported position and attitude of the scanner's platform frame, given its true `position` and
    /// `attitude` at `time` seconds after the start of the flight: r' = r_nav + ε + R'(l + δl), R'_platform =
    /// R' B δB, where R' has the angles of R with their errors (Glennie 2007, Rigorous 3D error analysis of
    /// kinematic scanning lidar systems, eq. 1).
    pub fn reported(&self, position: DVec3, attitude: Rotation, time: f64) -> (DVec3, Rotation) {
        let [mounting, back] = self.mounting;
        let body = attitude.after(back);
        let [roll, pitch, heading] = body.heading_angles();
        let [d_roll, d_pitch, d_heading] = self.attitude_error(time);
        let reported = Rotation::of_heading(roll + d_roll, pitch + d_pitch, heading + d_heading);
        let antenna = position - body.apply(self.arm) + self.position_error(time);
        (antenna + reported.apply(self.reported_arm), reported.after(mounting).after(self.boresight))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_geom::radians;

    fn process(seed: u64, correlation: f64) -> GaussMarkov {
        GaussMarkov::new(Stream::new(seed, Purpose::Navigation), correlation)
    }

    #[test]
    fn variance_and_correlation_are_those_of_a_gauss_markov_process() {
        // Over 20,000 seeds: four standard errors of a variance, and of a covariance ρ, sqrt((1 + ρ²)/n).
        let (n, tau) = (20_000, 30.0);
        let moment = |a: f64, b: f64| {
            (0..n)
                .map(|seed| {
                    let p = process(seed, tau);
                    p.at(0, a) * p.at(0, b)
                })
                .sum::<f64>()
                / n as f64
        };
        // Within a cell of 8 τ, near its ends, in its middle, and across a node; also before the start.
        for start in [0.0, 0.37, 3.999, 7.9, -2.5] {
            for lag in [0.0, 0.01, 0.3, 1.0, 2.0] {
                let (found, rho) = (moment(start * tau, (start + lag) * tau), f64::exp(-lag));
                assert!(
                    (found - rho).abs() < 4.0 * ((1.0 + rho * rho) / n as f64).sqrt(),
                    "{start} {lag}: {found} {rho}"
                );
            }
        }
        let mean = (0..n).map(|seed| process(seed, tau).at(0, 11.0)).sum::<f64>() / n as f64;
        assert!(mean.abs() < 4.0 / (n as f64).sqrt(), "{mean}");
    }

    #[test]
    fn processes_in_turn_have_the_values_that_each_has_alone() {
        let processes = [process(1, 10.0), process(2, 10.0), process(1, 300.0)];
        let times = || (0..2000).map(|i| f64::from(i) * 0.037 - 20.0);
        let alone: Vec<Vec<f64>> =
            processes.iter().map(|p| times().map(|time| p.at(2, time)).collect()).collect();
        for (i, time) in times().enumerate() {
            for (process, values) in processes.iter().zip(&alone) {
                assert_eq!(process.at(2, time), values[i]);
                let (first, leaf) = process.leaf_at(time).0;
                let fresh = process.leaf(2, first, leaf);
                assert_eq!(
                    process.at(2, time),
                    fresh.low + (fresh.high - fresh.low) * process.leaf_at(time).1
                );
            }
        }
        // Intervals meet at their ends.
        let p = &processes[0];
        for leaf in [0, 1, 5, LEAVES / 2 - 1, LEAVES - 2] {
            assert_eq!(p.leaf(0, 3, leaf).high, p.leaf(0, 3, leaf + 1).low);
        }
        assert_eq!(p.leaf(0, 3, LEAVES - 1).high, p.leaf(0, 4, 0).low);
    }

    #[test]
    fn the_process_is_continuous_and_axes_are_independent() {
        let p = process(5, 10.0);
        let mut last = p.at(1, 0.0);
        for i in 1..200_000 {
            let next = p.at(1, f64::from(i) * 1e-3);
            // The process moves by sqrt(2 Δt/τ) in a step: 0.014 here.
            assert!((next - last).abs() < 0.09, "jumps from {last} to {next} at {i}");
            last = next;
        }
        let n = 4000;
        let of = |seed: u64| {
            let p = process(seed, 10.0);
            p.at(0, 3.0) * p.at(1, 3.0)
        };
        let correlation = (0..n).map(of).sum::<f64>() / n as f64;
        assert!(correlation.abs() < 4.0 / (n as f64).sqrt(), "{correlation}");
    }

    #[test]
    fn constant_errors_move_the_pose_as_computed_by_hand() {
        // Heading 90°: right is south, forward is east.
        let errors = NavigationErrors {
            position_bias: [0.1, 0.2, 0.3],
            attitude_bias: [0.0, 0.0, radians(90.0)],
            attitude_drift: [0.0, radians(0.5), 0.0],
            lever_arm: [0.0, 1.0, 0.0],
            ..NavigationErrors::NONE
        };
        let n = Navigation::new(errors, 1, DVec3::new(2.0, 0.0, 0.0), [0.0; 3]);
        let attitude = Rotation::of_heading(0.0, 0.0, radians(90.0));
        let (position, reported) = n.reported(DVec3::new(10.0, 20.0, 30.0), attitude, 60.0);
        // The antenna is at (10, 22, 30), reported at (10.1, 22.2, 30.3); the reported heading is south, so
        // that right is west and forward south, 30° up: its arm is (2, 1, 0).
        let c = 3f64.sqrt() / 2.0;
        assert!((position - DVec3::new(8.1, 22.2 - c, 30.8)).length() < 1e-9, "{position}");
        assert!((reported.forward() - DVec3::new(0.0, -c, 0.5)).length() < 1e-9);
    }

    #[test]
    fn drawn_calibration_errors_hold_for_the_whole_run() {
        let errors = NavigationErrors {
            boresight_sigma: [0.01; 3],
            lever_arm_sigma: [0.1; 3],
            ..NavigationErrors::NONE
        };
        let of = |seed: u64, time: f64| {
            Navigation::new(errors, seed, DVec3::ZERO, [0.0; 3]).reported(
                DVec3::ZERO,
                Rotation::IDENTITY,
                time,
            )
        };
        assert_eq!(of(1, 0.0), of(1, 1000.0));
        assert_ne!(of(1, 0.0), of(2, 0.0));
        let n = 4000;
        let variance = (0..n).map(|s| of(s, 0.0).0.x.powi(2)).sum::<f64>() / n as f64;
        // Four standard errors of a variance: sqrt(2/n).
        assert!((variance / 0.01 - 1.0).abs() < 0.09, "{variance}");
        let roll = (0..n).map(|s| of(s, 0.0).1.heading_angles()[0].powi(2)).sum::<f64>() / n as f64;
        assert!((roll / 1e-4 - 1.0).abs() < 0.09, "{roll}");
    }

    #[test]
    fn a_boresight_of_the_platform_stays_where_it_is() {
        let boresight = [radians(5.0), radians(-3.0), radians(20.0)];
        let n = Navigation::new(NavigationErrors::NONE, 1, DVec3::new(1.0, 2.0, 3.0), boresight);
        let (at, attitude) = (DVec3::new(4.0, 5.0, 6.0), Rotation::of_heading(0.1, 0.2, 0.3));
        let (position, reported) = n.reported(at, attitude, 7.0);
        assert!((position - at).length() < 1e-12);
        assert!((reported.forward() - attitude.forward()).length() < 1e-12);
    }
}
