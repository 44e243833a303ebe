//! Pulses of measured shape.

use vlscan_survey::PulseSamples;

/// Power at a time (ns after the first sample): linear between samples, 0 outside.
pub(super) fn power_at(pulse: &PulseSamples, time: f64) -> f64 {
    let after = pulse.times.partition_point(|t| *t < time);
    match (after.checked_sub(1), pulse.times.get(after)) {
        (Some(before), Some(next)) => {
            let (from, to) = (pulse.powers[before], pulse.powers[after]);
            let part = (time - pulse.times[before]) / (next - pulse.times[before]);
            from + (to - from) * part
        }
        (None, Some(first)) if *first == time => pulse.powers[0],
        _ => 0.0,
    }
}

/// Time from the first sample to the last, ns.
pub(super) fn duration(pulse: &PulseSamples) -> f64 {
    pulse.times.last().copied().unwrap_or_default()
}

/// Integral of the power relative to its peak, ns.
pub(super) fn integral(pulse: &PulseSamples) -> f64 {
    let steps = pulse.times.windows(2).zip(pulse.powers.windows(2));
    steps.map(|(t, p)| (t[1] - t[0]) * (p[0] + p[1]) * 0.5).sum()
}

/// Full width at half maximum, ns: from the first time that the power reaches half of its peak to the last.
pub(super) fn width(pulse: &PulseSamples) -> f64 {
    let crossings = pulse.times.windows(2).zip(pulse.powers.windows(2)).filter_map(|(t, p)| {
        let differs = (p[0] < 0.5) != (p[1] < 0.5);
        differs.then(|| t[0] + (0.5 - p[0]) / (p[1] - p[0]) * (t[1] - t[0]))
    });
    let last = duration(pulse);
    // Samples may begin or end in the middle of a pulse.
    let begin = pulse.powers.first().filter(|p| **p >= 0.5).map(|_| 0.0);
    let end = pulse.powers.last().filter(|p| **p >= 0.5).map(|_| last);
    let all: Vec<f64> = begin.into_iter().chain(crossings).chain(end).collect();
    match (all.first(), all.last()) {
        (Some(first), Some(last)) => last - first,
        _ => 0.0,
    }
}

/// The pulse in bins of `bin` ns: samples, and the coefficients of late starts. The pulse that starts φ bins
/// late, 0 to 1, has the sample `samples[k] + lateness[0][k]·φ + lateness[1][k]·φ²`: the parabola through the
/// pulse at kΔ, (k − ½)Δ and (k − 1)Δ.
pub(super) fn digitise(pulse: &PulseSamples, bin: f64) -> (Vec<f64>, [Vec<f64>; 2]) {
    // One more bin for the end of pulses that start late.
    let count = (duration(pulse) / bin).ceil() as usize + 2;
    let at = |k: f64| power_at(pulse, k * bin);
    let (mut samples, mut slope, mut bend) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..count {
        let k = k as f64;
        let (now, middle, before) = (at(k), at(k - 0.5), at(k - 1.0));
        samples.push(now);
        slope.push(4.0 * middle - 3.0 * now - before);
        bend.push(2.0 * (now - 2.0 * middle + before));
    }
    (samples, [slope, bend])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A triangle from 0 over 1 at 2 ns to 0 at 6 ns.
    fn triangle() -> PulseSamples {
        PulseSamples { times: vec![0.0, 2.0, 6.0], powers: vec![0.0, 1.0, 0.0] }
    }

    #[test]
    fn a_triangle_has_half_its_base_as_width_and_area() {
        assert_eq!((width(&triangle()), integral(&triangle())), (3.0, 3.0));
        for (time, power) in
            [(-1.0, 0.0), (0.0, 0.0), (1.0, 0.5), (2.0, 1.0), (4.0, 0.5), (6.0, 0.0), (7.0, 0.0)]
        {
            assert_eq!(power_at(&triangle(), time), power, "at {time} ns");
        }
        let cut = PulseSamples { times: vec![0.0, 1.0, 2.0], powers: vec![1.0, 0.75, 0.0] };
        assert!((width(&cut) - 4.0 / 3.0).abs() < 1e-12);
        assert_eq!(power_at(&cut, 0.0), 1.0);
    }

    #[test]
    fn a_late_pulse_is_shifted() {
        let gaussian = |t: f64| (-0.5 * ((t - 5.0) / 0.9) * ((t - 5.0) / 0.9)).exp();
        let times: Vec<f64> = (0..=1000).map(|i| f64::from(i) * 0.01).collect();
        let pulse = PulseSamples { powers: times.iter().map(|t| gaussian(*t)).collect(), times };
        let (samples, lateness) = digitise(&pulse, 0.25);
        for by in [0.0, 0.2, 0.5, 0.9, 1.0] {
            for k in 1..40 {
                let late = samples[k] + lateness[0][k] * by + lateness[1][k] * by * by;
                let expected = gaussian((k as f64 - by) * 0.25);
                assert!((late - expected).abs() < 3e-4, "{by} bins late, bin {k}: {late} is not {expected}");
            }
        }
        // The energy stays.
        let sum = |by: f64| -> f64 {
            (0..samples.len()).map(|k| samples[k] + lateness[0][k] * by + lateness[1][k] * by * by).sum()
        };
        assert!(
            (sum(0.3) / sum(0.0) - 1.0).abs() < 1e-6
                && (sum(0.0) * 0.25 / integral(&pulse) - 1.0).abs() < 1e-6
        );
    }
}
