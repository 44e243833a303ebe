//! Threshold, photon statistics and dropouts from the pulses at planes that have no echo.

use libm::{exp, log, sqrt};

/// Photoelectrons at the threshold that are tried.
const PHOTONS: [u32; 14] = [1, 2, 3, 4, 6, 8, 11, 16, 23, 32, 45, 64, 90, 128];
/// Steps of the threshold that is tried, from the weakest echo to the strongest.
const THRESHOLDS: usize = 240;
/// Minimum and maximum share of dropouts that are tried, and steps between them.
const DROPOUTS: (f64, f64, usize) = (1e-4, 0.3, 48);
const BINS: usize = 80;
/// Strengths over the threshold beyond which every echo is detected.
const CERTAIN: f64 = 50.0;

/// Detection of echoes by a receiver.
#[derive(Clone, Copy, Debug)]
pub(super) struct Detection {
    /// Strength of an echo at the threshold, in the unit of the recording.
    pub threshold: f64,
    /// Its relative standard deviation.
    pub threshold_deviation: f64,
    /// Photoelectrons at the threshold.
    pub photons: u32,
    /// Share of echoes that are lost at any strength.
    pub dropout_rate: f64,
    /// Its standard deviation.
    pub dropout_deviation: f64,
}

/// The detection with the largest likelihood, of pulses with the expected strength of their echo and whether
/// it was detected; `None` without pulses.
pub(super) fn detection(pulses: &[(f64, bool)]) -> Option<Detection> {
    let strengths = || pulses.iter().map(|(strength, _)| *strength).filter(|s| *s > 0.0);
    let (low, high) = (strengths().fold(f64::MAX, f64::min), strengths().fold(0.0, f64::max));
    if low.is_nan() || high.is_nan() || low >= high {
        return None;
    }
    let width = log(high / low) / (BINS - 1) as f64;
    let mut bins = vec![(0.0, 0.0, 0.0); BINS];
    for (strength, is_seen) in pulses.iter().filter(|(strength, _)| *strength > 0.0) {
        let bin = &mut bins[(log(strength / low) / width) as usize];
        *bin = (bin.0 + strength, bin.1 + 1.0, bin.2 + f64::from(u8::from(*is_seen)));
    }
    let bins: Vec<(f64, f64, f64)> =
        bins.into_iter().filter(|bin| bin.1 > 0.0).map(|(sum, n, seen)| (sum / n, n, seen)).collect();
    let threshold_at = |i: f64| 0.1 * low * exp(i * log(high / low * 10.0) / THRESHOLDS as f64);
    let chances = |threshold: f64, photons: u32| -> Vec<f64> {
        bins.iter().map(|(strength, ..)| chance(strength / threshold, photons)).collect()
    };
    let likelihood = |chances: &[f64], dropout_rate: f64| -> f64 {
        let of_bin = |((_, n, seen), chance): (&(f64, f64, f64), &f64)| {
            let chance = ((1.0 - dropout_rate) * chance).clamp(1e-9, 1.0 - 1e-9);
            seen * log(chance) + (n - seen) * log(1.0 - chance)
        };
        bins.iter().zip(chances).map(of_bin).sum()
    };
    let dropouts: Vec<f64> = (0..DROPOUTS.2)
        .map(|i| DROPOUTS.0 * exp(log(DROPOUTS.1 / DROPOUTS.0) * i as f64 / (DROPOUTS.2 - 1) as f64))
        .collect();
    let mut best = (f64::MIN, 0.0, PHOTONS[0], 0.0);
    for photons in PHOTONS {
        for i in 0..THRESHOLDS {
            let threshold = threshold_at(i as f64);
            let chances = chances(threshold, photons);
            for rate in &dropouts {
                let found = likelihood(&chances, *rate);
                if found > best.0 {
                    best = (found, threshold, photons, *rate);
                }
            }
        }
    }
    let (most, threshold, photons, dropout_rate) = best;
    // By the curvature of the likelihood.
    let deviation = |lower: f64, upper: f64, step: f64| {
        let curvature = (2.0 * most - lower - upper) / (step * step);
        if curvature > 0.0 { 1.0 / sqrt(curvature) } else { f64::NAN }
    };
    let of_threshold = |by: f64| likelihood(&chances(threshold * exp(by), photons), dropout_rate);
    let of_rate = |by: f64| likelihood(&chances(threshold, photons), dropout_rate * exp(by));
    Some(Detection {
        threshold,
        threshold_deviation: deviation(of_threshold(-0.1), of_threshold(0.1), 0.1),
        photons,
        dropout_rate,
        dropout_deviation: dropout_rate * deviation(of_rate(-0.2), of_rate(0.2), 0.2),
    })
}

impl Detection {
    /// Probability that an echo of that strength is detected.
    pub fn chance(&self, strength: f64) -> f64 {
        (1.0 - self.dropout_rate) * chance(strength / self.threshold, self.photons)
    }
}

/// Probability of at least `photons` photoelectrons where there are `photons` times `over` on average
/// (Poisson).
fn chance(over: f64, photons: u32) -> f64 {
    if over > CERTAIN {
        return 1.0;
    }
    let mean = over * f64::from(photons);
    let (mut term, mut below) = (exp(-mean), 0.0);
    for k in 0..photons {
        below += term;
        term *= mean / f64::from(k + 1);
    }
    (1.0 - below).max(0.0)
}
