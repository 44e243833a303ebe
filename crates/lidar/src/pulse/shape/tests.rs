//! Tests of pulse shapes.

use super::*;

fn shape(length: f64, bin: f64) -> PulseShape {
    PulseShape::new(length, false, &WaveformSettings { bin, window: 1.0, quality: 1, max_range: 0.0 })
}

#[test]
fn tables_of_the_worked_example() {
    // spec pulse-physics §4.12 (a)
    let table = [
        (4.0, 0.25, 16, 5, 0.536879652),
        (5.0, 0.25, 20, 6, 0.540032849),
        (5.0, 0.20, 25, 7, 0.541121710),
        (4.0, 0.50, 8, 2, 0.532182702),
        (2.0, 0.25, 8, 2, 0.532182702),
    ];
    for (length, bin, n, peak, top) in table {
        let s = shape(length, bin);
        assert_eq!((s.samples.len(), s.peak), (n, peak), "{length} ns in bins of {bin} ns");
        assert!((s.samples[peak] - top).abs() < 1e-9);
    }
    let expected = [
        0.0, 0.123581, 0.319160, 0.463647, 0.532183, 0.536880, 0.499155, 0.438657, 0.369918, 0.302278,
        0.240945, 0.188235, 0.144635, 0.109596, 0.082065, 0.060825,
    ];
    for (s, e) in shape(4.0, 0.25).samples.iter().zip(expected) {
        assert!((s - e).abs() < 5e-7, "{s} is not {e}");
    }
}

#[test]
fn a_pulse_that_starts_late_is_the_curve_shifted() {
    let s = shape(4.0, 0.25);
    let (by, tau) = (0.3, 4.0 / 7.0);
    let [a, b, c] = s.late(&[by; LANES]).map(|f| f[0]);
    let late: Vec<f64> =
        (0..16).map(|k| a * s.samples[k] + b * s.lateness[0][k] + c * s.lateness[1][k]).collect();
    for (k, f) in late.iter().enumerate().skip(1) {
        let t = (k as f64 - by) * 0.25 / tau;
        assert!((f - t * t * exp(-t)).abs() < 1e-13);
    }
    assert_eq!(late[0], 0.0);
    for (samples, by) in [(&late, by), (&s.samples, 0.0)] {
        let found = s.maximum([samples[4], samples[5], samples[6]]);
        let time = (5.0 + found.offset - by) * s.bin;
        assert!((time - s.top_time).abs() < 1e-11 && (found.amplitude / s.top - 1.0).abs() < 1e-11);
    }
}

#[test]
fn the_series_are_exact() {
    for i in 0..=1000 {
        let x = f64::from(i) * 1e-3;
        let (versine, sine) = cosine_series(x);
        assert!((versine - (1.0 - cos(x))).abs() < 1e-12 && (sine - libm::sin(x)).abs() < 1e-12, "{x}");
    }
    for i in 0..2000 {
        let x = f64::from(i) * 5e-4;
        assert!((exp_series(x) / exp(x) - 1.0).abs() < if x < 0.5 { 2e-12 } else { 3e-9 }, "{x}");
    }
}

#[test]
fn a_measured_shape_has_its_own_width_and_energy() {
    // A triangle of base 6 ns: width and area 3 ns.
    let pulse = PulseSamples { times: vec![0.0, 2.0, 6.0], powers: vec![0.0, 1.0, 0.0] };
    let s = PulseShape::measured(&pulse, 0.25);
    assert_eq!((s.peak, s.top, s.samples[s.peak], s.duration), (8, 1.0, 1.0, 6.0));
    assert!((s.width() - 3.0).abs() < 1e-12 && (s.length_of_equal_energy() - 10.5).abs() < 1e-12);
    let late = s.late(&[0.5; LANES]).map(|factor| factor[0]);
    assert!((s.late_sample(4, &late) - 3.5 / 8.0).abs() < 1e-12);
    // The default shape in its own terms.
    let s = shape(4.0, 0.25);
    let area: f64 =
        (0..4000).map(|i| f64::from(i) * 0.01 / (4.0 / 7.0)).map(|x| x * x * exp(-x) * 0.01).sum();
    assert!((s.length_of_equal_energy() - 4.0).abs() < 1e-15 && (area * 3.5 - 4.0).abs() < 1e-4);
    let half = |t: f64| (7.0 * t / 4.0).powi(2) * exp(-7.0 * t / 4.0) - 0.5 * s.top;
    assert!(half(0.43499) < 1e-5 && half(0.43499 + s.width()).abs() < 1e-4, "{}", s.width());
}

#[test]
fn a_raised_cosine_is_shifted_exactly() {
    // Bins of all widths, among them one that divides the pulse.
    for bin in [0.05, 0.25, 3.88 / 16.0, 0.97, 1.9] {
        let s = PulseShape::raised_cosine(4.0, bin);
        assert!(
            (s.width() - shape(4.0, 0.25).width()).abs() < 1e-15
                && (s.duration - 2.0 * s.width()).abs() < 1e-12
        );
        assert!((s.length_of_equal_energy() - 3.5 * s.width()).abs() < 1e-12);
        assert!((duration_of(4.0, &Corrections::REFINED) - s.duration).abs() < 1e-12);
        for by in [0.0, 0.2, 0.5, 0.99] {
            let late = s.late(&[by; LANES]).map(|factor| factor[0]);
            for k in 0..s.samples.len() {
                let time = (k as f64 - by) * bin;
                let power = if (0.0..s.duration).contains(&time) {
                    0.5 - 0.5 * cos(TAU * time / s.duration)
                } else {
                    0.0
                };
                // The end of the pulse within a bin is approximate, and next to the peak exact where the
                // maximum needs it.
                let tolerance =
                    if k + 1 == s.samples.len() { 0.15 * (1.0 - cos(TAU * bin / s.duration)) } else { 1e-11 };
                let found = s.late_sample(k, &late);
                assert!((found - power).abs() < tolerance, "{bin} {by} {k}: {found} is not {power}");
            }
        }
    }
}

#[test]
fn echoes_of_slopes_are_read_at_their_mean_range() {
    // A slope spreads the light of a Gaussian beam normally.
    let (tau, bin) = (4.0 / 7.0, 0.25);
    let waveform = WaveformSettings { bin, window: 1.0, quality: 1, max_range: 0.0 };
    let pulses = [PulseShape::new(4.0, true, &waveform), PulseShape::raised_cosine(4.0, bin)];
    for depth in [0.1, 0.2, 0.5, 1.0, 2.0] {
        for phase in [0.0, 0.13, 0.37, 0.5, 0.81] {
            let bias = |pulse: &PulseShape| {
                let mean = 60.0 + phase;
                let mut echo = vec![0.0; 200];
                for step in -400..=400 {
                    let by = f64::from(step) * 0.01;
                    let start = mean + by * depth / bin;
                    let share = exp(-0.5 * by * by);
                    let late = pulse.late(&[start.fract(); LANES]).map(|factor| share * factor[0]);
                    pulse.add_late(&late, &mut echo[start as usize..]);
                }
                let top = index_of_max(&echo);
                let found = pulse.maximum([echo[top - 1], echo[top], echo[top + 1]]);
                (top as f64 + found.offset - mean) * bin - pulse.top_time
            };
            let [lopsided, symmetric] = [&pulses[0], &pulses[1]].map(bias);
            // A nanosecond there and back is 150 mm of range.
            assert!(symmetric.abs() * 150.0 < 0.1 + 0.1 * depth, "{depth} {phase}: {} mm", symmetric * 150.0);
            // To second order in the depth s a peak moves by −s²p‴/2p″: s²/2τ for (t/τ)²·e^(−t/τ), of
            // which the reading for the pulse itself takes a part back.
            if depth == 0.1 {
                let moved = lopsided / (depth * depth / (2.0 * tau));
                assert!((0.7..1.1).contains(&moved), "{lopsided}");
            }
            assert!(lopsided > 0.05 * depth, "{depth}: {lopsided}");
        }
    }
}

#[test]
fn only_powers_of_two_have_exact_inverses() {
    assert_eq!([0.25, 1.0, 8.0].map(exact_inverse), [Some(4.0), Some(1.0), Some(0.125)]);
    assert_eq!([0.2, 3.0, 0.0, f64::INFINITY, f64::NAN].map(exact_inverse), [None; 5]);
}

#[test]
fn a_pulse_shorter_than_a_bin_has_no_samples() {
    assert!(shape(0.1, 0.25).samples.is_empty());
}
