//! Ranging between bins: the position of an echo by its peak, its centroid or a Gaussian, for pulses of any
//! shape.
//!
//! Each method reads a position from the samples around the largest one that differs from the position of the
//! pulse, by an amount that depends on the pulse's shape and on its start within a bin. So the instrument is
//! calibrated: the reading is tabulated for a pulse of its own shape in small shifts, and the table is
//! inverted. Noiseless single echoes then have exact positions by any method; the methods differ in their
//! response to noise and to echoes that overlap.

use vlscan_survey::Ranging;

const STEPS_PER_BIN: usize = 64;
/// Iterations of the fit of a Gaussian, which converges in a few.
const ITERATIONS: usize = 8;
/// Full width at half maximum of a Gaussian of standard deviation 1: √(8·ln 2).
const GAUSSIAN_WIDTH: f64 = 2.354_820_045_030_949_3;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Method {
    Centroid,
    Gaussian,
}

#[derive(Clone, Debug)]
pub(super) struct RangeReader {
    method: Method,
    /// Bins on either side of the peak that are read.
    reach: i64,
    /// Standard deviation of a Gaussian as wide as the pulse, bins.
    width: f64,
    /// Readings of pulses that are shifted by −1 to 1 bins, ascending.
    readings: Vec<f64>,
}

impl RangeReader {
    /// The detector for pulses that are `width` bins wide at half maximum; `None` for the peak, see
    /// [`super::maximum`]. `pulse(k, by)` is sample `k` relative to the peak of a pulse that begins `by` bins
    /// (0 to 1) late, 0 where there is none.
    pub fn new(ranging: Ranging, width: f64, pulse: impl Fn(i64, f64) -> f64) -> Option<RangeReader> {
        let method = match ranging {
            Ranging::Peak | Ranging::Photons => return None,
            Ranging::Centroid => Method::Centroid,
            Ranging::Gaussian => Method::Gaussian,
        };
        let reach = ((REACH * width).ceil() as i64).clamp(1, MAX_REACH);
        let mut reader = RangeReader { method, reach, width: width / GAUSSIAN_WIDTH, readings: Vec::new() };
        let reading = |i: usize| {
            let shift = i as f64 / STEPS_PER_BIN as f64 - 1.0;
            // A pulse that starts early starts late in the previous bin.
            let whole = shift.floor();
            reader.read(|k| pulse(k - whole as i64, shift - whole))
        };
        let mut readings: Vec<f64> = (0..=2 * STEPS_PER_BIN).map(reading).collect();
        // Enforces the order against rounding and odd shapes.
        for i in 1..readings.len() {
            readings[i] = readings[i].max(readings[i - 1]);
        }
        reader.readings = readings;
        Some(reader)
    }

    /// Shift of a pulse relative to one that starts with a bin, bins, given its samples relative to the peak.
    pub fn offset(&self, sample: impl Fn(i64) -> f64) -> f64 {
        let reading = self.read(sample);
        let (first, last) = (self.readings[0], self.readings[2 * STEPS_PER_BIN]);
        let limit = self.reach as f64;
        // Beyond the table readings are extrapolated with slope 1.
        if reading < first {
            return (reading - first - 1.0).max(-limit);
        }
        if reading > last {
            return (reading - last + 1.0).min(limit);
        }
        let above = self.readings.partition_point(|r| *r < reading);
        let (Some(high), Some(low)) = (self.readings.get(above), above.checked_sub(1)) else {
            return if above == 0 { -1.0 } else { 0.0 };
        };
        let part = (reading - self.readings[low]) / (high - self.readings[low]);
        (low as f64 + part) / STEPS_PER_BIN as f64 - 1.0
    }

    /// Position relative to the largest sample, bins; 0 if the samples are not an echo.
    fn read(&self, sample: impl Fn(i64) -> f64) -> f64 {
        let position = match self.method {
            Method::Centroid => self.centroid(sample),
            Method::Gaussian => self.gaussian(sample),
        };
        if position.is_finite() {
            position.clamp(-2.0 * self.reach as f64, 2.0 * self.reach as f64)
        } else {
            0.0
        }
    }

    fn centroid(&self, sample: impl Fn(i64) -> f64) -> f64 {
        let (mut sum, mut moment) = (0.0, 0.0);
        for k in -self.reach..=self.reach {
            let s = sample(k);
            sum += s;
            moment += s * k as f64;
        }
        if sum > 0.0 { moment / sum } else { f64::NAN }
    }

    /// Centre of the Gaussian that fits the samples in the sense of least squares (Gauss–Newton; Wagner et
    /// al. 2006, "Gaussian decomposition and calibration of a novel small-footprint full-waveform digitising
    /// airborne laser scanner", §3).
    fn gaussian(&self, sample: impl Fn(i64) -> f64) -> f64 {
        let top = sample(0);
        let [mut height, mut centre, mut width] = [1.0, 0.0, self.width];
        for _ in 0..ITERATIONS {
            let (mut normal, mut gradient) = ([[0.0; 3]; 3], [0.0; 3]);
            for k in -self.reach..=self.reach {
                let x = (k as f64 - centre) / width;
                let gaussian = libm::exp(-0.5 * x * x);
                let slope = height * gaussian * x / width;
                let (by, rest) = ([gaussian, slope, slope * x], sample(k) / top - height * gaussian);
                for (row, a) in normal.iter_mut().zip(by) {
                    row.iter_mut().zip(by).for_each(|(sum, b)| *sum += a * b);
                }
                gradient.iter_mut().zip(by).for_each(|(sum, a)| *sum += a * rest);
            }
            let Some([dh, dc, dw]) = solve(normal, gradient) else { return f64::NAN };
            height += dh;
            centre += dc.clamp(-width, width);
            // The width stays positive and changes by a factor of two at most.
            width *= (1.0 + dw / width).clamp(0.5, 2.0);
        }
        if height > 0.0 { centre } else { f64::NAN }
    }
}

/// Reach on either side of a peak, in widths at half maximum: more would add noise, less would lose light.
const REACH: f64 = 0.75;
/// Longest reach, bins.
const MAX_REACH: i64 = 1 << 12;

/// Solution of a system of three equations by Cramer's rule; `None` if there is none.
fn solve(m: [[f64; 3]; 3], v: [f64; 3]) -> Option<[f64; 3]> {
    let determinant = |m: &[[f64; 3]; 3]| {
        m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0])
            + m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0])
    };
    let whole = determinant(&m);
    let solution = std::array::from_fn(|column| {
        let mut replaced = m;
        for (row, value) in replaced.iter_mut().zip(v) {
            row[column] = value;
        }
        determinant(&replaced) / whole
    });
    solution.iter().all(|x: &f64| x.is_finite()).then_some(solution)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pulse::noise::{PulseDraws, ReceiverNoise, matched_bandwidth};
    use vlscan_base::rng::{Purpose, Stream};

    const ALL: [Ranging; 2] = [Ranging::Centroid, Ranging::Gaussian];
    /// Sample of the peak.
    const PEAK: i64 = 40;

    /// A Gaussian of standard deviation `sigma` bins around [`PEAK`].
    fn gaussian(sigma: f64) -> impl Fn(f64) -> f64 {
        move |x| (-0.5 * ((x - PEAK as f64) / sigma).powi(2)).exp()
    }

    /// A lopsided pulse with its peak at [`PEAK`], (t/τ)²·e^(−t/τ) from 2τ before it on.
    fn gamma(tau: f64) -> impl Fn(f64) -> f64 {
        move |x| {
            let t = (x - PEAK as f64) / tau + 2.0;
            if t > 0.0 { t * t * (-t).exp() } else { 0.0 }
        }
    }

    fn reader(ranging: Ranging, width: f64, shape: &dyn Fn(f64) -> f64) -> RangeReader {
        RangeReader::new(ranging, width, |k, by| shape((PEAK + k) as f64 - by)).expect("a calibrated reader")
    }

    /// Start of the pulse as read from samples, bins; 0 if it begins with its bin.
    fn start(reader: &RangeReader, samples: &[f64]) -> f64 {
        let peak = (0..samples.len()).max_by(|a, b| samples[*a].total_cmp(&samples[*b])).unwrap() as i64;
        let at = |k: i64| usize::try_from(peak + k).ok().and_then(|i| samples.get(i)).copied().unwrap_or(0.0);
        (peak - PEAK) as f64 + reader.offset(at)
    }

    #[test]
    fn noiseless_echoes_are_where_they_are_by_every_detector() {
        type Shape = Box<dyn Fn(f64) -> f64>;
        let shapes: [(f64, Shape); 3] =
            [(7.8, Box::new(gaussian(3.3))), (7.8, Box::new(gamma(2.286))), (3.0, Box::new(gamma(0.9)))];
        for (width, shape) in &shapes {
            for ranging in ALL {
                let reader = reader(ranging, *width, shape);
                for i in 0..100 {
                    let by = f64::from(i) * 0.037;
                    let samples: Vec<f64> = (0..100).map(|k| 17.0 * shape(f64::from(k) - by)).collect();
                    let found = start(&reader, &samples);
                    assert!((found - by).abs() < 2e-3, "{ranging:?}, width {width}: {found} is not {by}");
                }
            }
        }
    }

    #[test]
    fn noise_shifts_a_range_by_the_pulse_length_over_the_signal_to_noise_ratio() {
        // The Cramér–Rao bound of the time of a Gaussian pulse behind a matched receiver is σ_p/SNR (Van
        // Trees 1968, part I, ch. 4: √(σ²/Σ(s')²) on white noise before the filter); the peak detector
        // reaches it, as it is the maximum of the matched filter's output. No detector may beat it.
        let (bin, fwhm) = (0.25, 2.0);
        let sigma = fwhm / bin / (8.0 * 2f64.ln()).sqrt();
        let shape = gaussian(sigma);
        for ratio in [20.0, 50.0, 200.0] {
            let noise = ReceiverNoise::new(1.0, 0.0, matched_bandwidth(fwhm), bin);
            for (ranging, worst) in [(Ranging::Centroid, 1.6), (Ranging::Gaussian, 1.6)] {
                let reader = reader(ranging, fwhm / bin, &shape);
                let (n, mut sum) = (3000, 0.0);
                for pulse in 0..n {
                    let by = pulse as f64 / n as f64;
                    let mut samples: Vec<f64> = (0..81).map(|k| ratio * shape(f64::from(k) - by)).collect();
                    let draws = PulseDraws {
                        samples: Stream::new(1, Purpose::ReceiverNoise),
                        alarms: Stream::new(1, Purpose::FalseAlarm),
                        device: 0,
                        pulse,
                    };
                    noise.add(&mut samples, 0, &draws, &mut Vec::new());
                    sum += (start(&reader, &samples) - by).powi(2);
                }
                let relative = (sum / n as f64).sqrt() / (sigma / ratio);
                assert!((0.9..worst).contains(&relative), "{ranging:?} at {ratio}: {relative} of the bound");
            }
        }
    }

    #[test]
    fn what_is_no_echo_moves_nothing() {
        for ranging in ALL {
            let reader = reader(ranging, 7.8, &gaussian(3.3));
            for value in [0.0, 1.0, f64::NAN, f64::INFINITY] {
                assert!(reader.offset(|_| value).abs() <= reader.reach as f64, "{ranging:?} of {value}");
            }
        }
    }
}
