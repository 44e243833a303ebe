//! Selection of the returns that a receiver reports: photon statistics, dropouts, dead time, number of
//! returns.
//!
//! A receiver that counts photons detects an echo when at least N of its photoelectrons arrive. Their number
//! has the Poisson distribution around a mean that is proportional to the amplitude of the echo, N at the
//! threshold. So an echo at the threshold is detected every other time, and weaker ones now and then. After
//! an event the receiver is blind for its dead time, whatever arrives meanwhile (non-paralysable: Müller
//! 1973, "Dead-time problems").

use super::detector_settings::Return;
use libm::{exp, floor, sqrt};
use vlscan_base::rng::{self, Purpose, Stream};
use vlscan_survey::Receiver;

/// Means above which the Poisson distribution is taken as a normal one: its skewness is below 0.1.
const MAX_POISSON_MEAN: f64 = 128.0;
/// Probability of a detection below which an echo is not looked for.
const MIN_DETECTION: f64 = 1e-6;
/// Standard deviations of the number of photons below the threshold at which an echo is not looked for, where
/// it is normal.
const MAX_DEVIATIONS: f64 = 4.8;

/// The selection of returns, for receivers whose statistics or dead time decide on it.
#[derive(Clone, Debug)]
pub(super) struct ReturnSelection {
    photons: Option<PhotonStatistics>,
    /// Share of echoes that are lost.
    dropout_rate: f64,
    stream: Stream,
    /// Draws of large numbers of photons.
    normals: Stream,
    /// Range within which no return follows another one, m.
    dead_range: f64,
    max_returns: usize,
}

/// Detection by a number of photoelectrons.
#[derive(Clone, Debug)]
struct PhotonStatistics {
    /// Photoelectrons of an echo at the threshold.
    threshold: f64,
    /// Photoelectrons per amplitude.
    per_amplitude: f64,
}

impl ReturnSelection {
    /// The selection of a receiver with the detection threshold `threshold`; `None` if it reports all
    /// returns. 0 `max_returns` are any number.
    pub fn new(receiver: &Receiver, threshold: f64, max_returns: u32, seed: u64) -> Option<ReturnSelection> {
        let photons = receiver.threshold_photons.filter(|_| threshold > 0.0).map(|count| PhotonStatistics {
            threshold: f64::from(count),
            per_amplitude: f64::from(count) / threshold,
        });
        let dead_range = receiver.dead_time * vlscan_geom::LIGHT_SPEED * 0.5;
        let dropout_rate = receiver.dropout_rate;
        (photons.is_some() || dead_range > 0.0 || dropout_rate > 0.0).then_some(ReturnSelection {
            photons,
            dropout_rate,
            stream: Stream::new(seed, Purpose::PhotonCount),
            normals: Stream::new(seed, Purpose::LargePhotonCount),
            dead_range,
            max_returns: if max_returns > 0 { max_returns as usize } else { usize::MAX },
        })
    }

    /// Share of the threshold from which on echoes have a chance to be detected.
    pub fn lowest_share(&self) -> f64 {
        let Some(PhotonStatistics { threshold, .. }) = self.photons else { return 1.0 };
        if threshold > MAX_POISSON_MEAN {
            let root = 0.5 * (sqrt(MAX_DEVIATIONS * MAX_DEVIATIONS + 4.0 * threshold) - MAX_DEVIATIONS);
            return root * root / threshold;
        }
        let (mut low, mut high) = (0.0, threshold);
        for _ in 0..40 {
            let mean = 0.5 * (low + high);
            if 1.0 - poisson_below(threshold as u32, mean) > MIN_DETECTION { high = mean } else { low = mean }
        }
        low / threshold
    }

    /// Removes the returns of a pulse, in the order of range, that the receiver does not report. Amplitudes
    /// become those of the photons that arrived.
    pub fn select(&self, (device, pulse): (u32, u64), returns: &mut Vec<Return>) {
        let (mut number, mut last, mut kept) = (0, f64::NEG_INFINITY, 0);
        returns.retain_mut(|found| {
            let draw = self.stream.bits(device, pulse, number);
            number += 1;
            if rng::open_unit(draw[2], draw[3]) <= self.dropout_rate && !found.is_noise {
                return false;
            }
            if let Some(statistics) = &self.photons
                && !found.is_noise
            {
                let normal = || self.normals.normal(device, pulse, number - 1);
                let count = statistics.draw(found.amplitude, [draw[0], draw[1]], normal);
                if count < statistics.threshold {
                    return false;
                }
                found.amplitude = count / statistics.per_amplitude;
            }
            if found.range - last < self.dead_range || kept == self.max_returns {
                return false;
            }
            (last, kept) = (found.range, kept + 1);
            true
        });
    }
}

impl PhotonStatistics {
    /// Number of photoelectrons of an echo of that amplitude.
    fn draw(&self, amplitude: f64, uniform: [u32; 2], normal: impl Fn() -> f64) -> f64 {
        let mean = amplitude * self.per_amplitude;
        if mean > MAX_POISSON_MEAN {
            let count = mean + sqrt(mean) * normal();
            return floor(count + 0.5).max(0.0);
        }
        poisson_quantile(rng::open_unit(uniform[0], uniform[1]), mean)
    }
}

/// Probability of fewer than `count` events, of which there are `mean` on average.
fn poisson_below(count: u32, mean: f64) -> f64 {
    let (mut term, mut sum) = (exp(-mean), 0.0);
    for k in 0..count {
        sum += term;
        term *= mean / f64::from(k + 1);
    }
    sum
}

/// The smallest number of events whose distribution function reaches `probability`.
fn poisson_quantile(probability: f64, mean: f64) -> f64 {
    let (mut term, mut sum, mut count) = (exp(-mean), 0.0, 0.0);
    // Beyond the last term that counts the sum stays below a probability of 1 by rounding.
    while count < 4.0 * MAX_POISSON_MEAN {
        sum += term;
        if sum >= probability {
            break;
        }
        count += 1.0;
        term *= mean / count;
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;

    fn selection(receiver: &Receiver, max_returns: u32) -> ReturnSelection {
        ReturnSelection::new(receiver, 2.0, max_returns, 3).expect("a selection")
    }

    fn returns(of: &[(f64, f64)]) -> Vec<Return> {
        let found = |&(range, amplitude)| Return { range, amplitude, width: 0.0, is_noise: false };
        of.iter().map(found).collect()
    }

    #[test]
    fn echoes_are_detected_by_the_poisson_law() {
        // P(at least 10 of a mean of 10) = 0.5421, of 5: 0.0318, of 20: 0.9950; of 200 by 200: 0.509 (Poisson
        // tables).
        for (threshold, share, expected) in
            [(10, 1.0, 0.5421), (10, 0.5, 0.0318), (10, 2.0, 0.9950), (200, 1.0, 0.509)]
        {
            let selection =
                selection(&Receiver { threshold_photons: Some(threshold), ..Receiver::default() }, 0);
            let n = 20_000;
            let (mut seen, mut sum) = (0.0, 0.0);
            for pulse in 0..n {
                let mut found = returns(&[(10.0, 2.0 * share)]);
                selection.select((0, pulse), &mut found);
                seen += found.len() as f64;
                sum += found.first().map_or(0.0, |r| r.amplitude);
            }
            let sigma = f64::sqrt(expected * (1.0 - expected) / n as f64);
            assert!((seen / n as f64 - expected).abs() < 4.0 * sigma + 0.002, "{threshold} {share}: {seen}");
            assert!(sum / seen >= 2.0, "what is detected is above the threshold");
        }
    }

    #[test]
    fn echoes_are_looked_for_where_they_have_a_chance() {
        for threshold in [1, 2, 10, 100, 128, 129, 10_000] {
            let selection =
                selection(&Receiver { threshold_photons: Some(threshold), ..Receiver::default() }, 0);
            let share = selection.lowest_share();
            assert!(share > 0.0 && share < 1.0, "{threshold}: {share}");
            if threshold <= 128 {
                let chance = 1.0 - poisson_below(threshold, share * f64::from(threshold));
                assert!((0.5e-6..2e-6).contains(&chance), "{threshold}: {chance}");
            }
        }
        assert_eq!(selection(&Receiver { dead_time: 1.0, ..Receiver::default() }, 0).lowest_share(), 1.0);
    }

    #[test]
    fn the_receiver_is_blind_after_an_echo() {
        // 10 ns are 1.499 m; the receiver counts from the last echo that it saw, not from those in its dead
        // time.
        let receiver = Receiver { dead_time: 10.0, ..Receiver::default() };
        let all = [(10.0, 3.0), (11.0, 3.0), (11.6, 3.0), (12.9, 3.0), (13.2, 3.0)];
        let ranges = |max_returns: u32| {
            let mut found = returns(&all);
            selection(&receiver, max_returns).select((0, 1), &mut found);
            found.iter().map(|r| r.range).collect::<Vec<_>>()
        };
        assert_eq!(ranges(0), [10.0, 11.6, 13.2]);
        assert_eq!(ranges(2), [10.0, 11.6]);
        assert!(ReturnSelection::new(&Receiver::default(), 2.0, 5, 3).is_none());
    }

    #[test]
    fn quantiles_invert_the_distribution() {
        for mean in [0.0, 0.01, 1.0, 30.0, 128.0] {
            for probability in [1e-9, 0.01, 0.5, 0.99, 1.0] {
                let count = poisson_quantile(probability, mean);
                assert!(
                    poisson_below(count as u32, mean) < probability || count == 0.0,
                    "{mean} {probability}"
                );
                assert!(poisson_below(count as u32 + 1, mean) > probability - 1e-12, "{mean} {probability}");
            }
        }
    }
}
