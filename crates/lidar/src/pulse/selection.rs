//! Selection of the returns that a receiver reports: photon statistics, dropouts, dead time, number of
//! returns.
//!
//! A receiver that counts photons detects an echo when at least N of its photoelectrons arrive. Their number
//! has the Poisson distribution around a mean that is proportional to the amplitude of the echo, N at the
//! threshold. So an echo at the threshold is detected every other time, and weaker ones now and then. After
//! an event the receiver is blind for its dead time, whatever arrives meanwhile (non-paralysable: Müller
//! 1973, "Dead-time problems").

use super::detector_settings::Return;
use super::fmcw::threshold_over_noise;
use libm::{exp, floor, log, sqrt};
use vlscan_base::rng::{self, Purpose, Stream};
use vlscan_survey::Receiver;

/// Means above which the Poisson distribution is taken as a normal one: its skewness is below 0.1.
const MAX_POISSON_MEAN: f64 = 128.0;
/// Probability of a detection below which an echo is not looked for.
const MIN_DETECTION: f64 = 1e-6;
/// Probability of a detection by speckle below which an echo is not looked for.
const MIN_SPECKLE_DETECTION: f64 = 1e-4;
/// Least share of the threshold at which an echo with speckle is looked for.
const MIN_SPECKLE_SHARE: f64 = 0.01;
/// Standard deviations of the number of photons below the threshold at which an echo is not looked for, where
/// it is normal.
const MAX_DEVIATIONS: f64 = 4.8;

/// The selection of returns, for receivers whose statistics or dead time decide on it.
#[derive(Clone, Debug)]
pub(super) struct ReturnSelection {
    photons: Option<PhotonStatistics>,
    speckle: Option<Speckle>,
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

/// Strengths of a single speckle: the power of light and noise has an exponential distribution (Swerling 1).
#[derive(Clone, Debug)]
struct Speckle {
    threshold: f64,
    /// Threshold over the mean power of the noise.
    over_noise: f64,
}

impl Speckle {
    /// Strength of an echo of that mean amplitude, by a uniform number in (0, 1].
    fn draw(&self, amplitude: f64, uniform: f64) -> f64 {
        -log(uniform) * (amplitude + self.threshold / self.over_noise)
    }

    /// Share of the threshold from which on echoes have a chance to be detected.
    fn lowest_share(&self) -> f64 {
        let share = (self.over_noise / -log(MIN_SPECKLE_DETECTION) - 1.0) / self.over_noise;
        share.clamp(MIN_SPECKLE_SHARE, 1.0)
    }
}

impl ReturnSelection {
    /// The selection of a receiver with the detection threshold `threshold`; `None` if it reports all
    /// returns. 0 `max_returns` are any number.
    pub fn new(receiver: &Receiver, threshold: f64, max_returns: u32, seed: u64) -> Option<ReturnSelection> {
        let photons = receiver.threshold_photons.filter(|_| threshold > 0.0).map(|count| PhotonStatistics {
            threshold: f64::from(count),
            per_amplitude: f64::from(count) / threshold,
        });
        let false_alarm = receiver.fmcw.and_then(|wave| wave.false_alarm);
        let speckle = false_alarm
            .filter(|_| threshold > 0.0)
            .map(|probability| Speckle { threshold, over_noise: threshold_over_noise(probability) });
        let dead_range = receiver.dead_time * vlscan_geom::LIGHT_SPEED * 0.5;
        let dropout_rate = receiver.dropout_rate;
        (photons.is_some() || speckle.is_some() || dead_range > 0.0 || dropout_rate > 0.0).then_some(
            ReturnSelection {
                photons,
                speckle,
                dropout_rate,
                stream: Stream::new(seed, Purpose::PhotonCount),
                normals: Stream::new(seed, Purpose::LargePhotonCount),
                dead_range,
                max_returns: if max_returns > 0 { max_returns as usize } else { usize::MAX },
            },
        )
    }

    /// Share of the threshold from which on echoes have a chance to be detected.
    pub fn lowest_share(&self) -> f64 {
        if let Some(speckle) = &self.speckle {
            return speckle.lowest_share();
        }
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
            if let Some(speckle) = &self.speckle
                && !found.is_noise
            {
                found.amplitude = speckle.draw(found.amplitude, rng::open_unit(draw[0], draw[1]));
                if found.amplitude < speckle.threshold {
                    return false;
                }
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
    use vlscan_survey::Fmcw;

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
    fn a_single_speckle_is_detected_by_the_law_of_swerling() {
        let wave = Fmcw {
            bandwidth: 1e9,
            chirp: 1e-5,
            sample_rate: None,
            has_quadrature: false,
            false_alarm: Some(1e-6),
        };
        let selection = selection(&Receiver { fmcw: Some(wave), ..Receiver::default() }, 0);
        // The threshold is 13.8 times the noise; the signal is 10 times.
        let amplitude = 2.0 * 10.0 / threshold_over_noise(1e-6);
        let n = 40_000;
        let seen = |pulse: u64| {
            let mut found = returns(&[(10.0, amplitude)]);
            selection.select((0, pulse), &mut found);
            found.len() as f64
        };
        let share = (0..n).map(seen).sum::<f64>() / n as f64;
        assert!((share - 0.284804).abs() < 0.009, "{share}");
        let chance = exp(-threshold_over_noise(1e-6) / (1.0 + selection.lowest_share() * 13.815510557964274));
        assert!((chance / 1e-4 - 1.0).abs() < 1e-9, "{chance}");
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
