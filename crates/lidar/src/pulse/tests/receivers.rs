//! Receivers that are not ideal, compared with closed forms: complete pulses at a wall that faces the beam.

use super::*;
use crate::pulse::{Echo, Physics};
use libm::erfc;
use std::sync::Arc;
use vlscan_survey::{AmplifierNoise, PulseSamples, Ranging, Receiver, ReferenceTarget, ShotNoise};

/// Amplitude of half-white walls at 100 m in clear air, nW: 4/e²·P_t·ρ·D²·η/(4R²) with P_t = 4 W at 100 kHz.
const AT_100_M: f64 = 0.541_341_132_946_45 * 4e9 * 0.5 * 0.15 * 0.15 * 0.99 / 4e4;

/// An instrument of 4 ns, 100 kHz and 1 ring in air without haze.
fn instrument(change: impl Fn(&mut Device)) -> Survey {
    let mut device = tls_device(4.0);
    (device.beam.visibility, device.waveform.quality) = (1e30, 1);
    (device.detector.threshold, device.detector.threshold_given) = (1e-12, true);
    change(&mut device);
    let mut survey = survey(vec![device]);
    survey.scanner.pulse_freqs = vec![100_000];
    survey.legs[0].scanner.pulse_freq = 100_000;
    survey
}

/// The records of `count` pulses in the refined physics.
fn refined(scene: &Scene, survey: &Survey, count: u64) -> Batch {
    simulate_pulses(scene, survey, PhysicsOptions::refined(), 0, &pulses(count))
}

fn wall_at(range: f64) -> Scene {
    rectangles(half_white(), &[wall(-20.0, 20.0, range)])
}

fn one(range: f64, survey: &Survey) -> Option<Echo> {
    simulate(&wall_at(range), survey, PhysicsOptions::refined()).echoes.first().copied()
}

fn moments(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let n = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / n;
    (mean, (values.map(|v| (v - mean) * (v - mean)).sum::<f64>() / n).sqrt())
}

fn noisy(nep: f64) -> impl Fn(&mut Device) {
    move |d: &mut Device| d.receiver.noise = Some(AmplifierNoise::Power(nep * 1e-9))
}

#[test]
fn the_maximum_range_is_that_of_the_data_sheet() {
    let target = |pulse_freq| ReferenceTarget { range: 300.0, reflectance: 0.5, pulse_freq };
    let mut survey = instrument(|d| d.receiver.max_range = Some(target(None)));
    assert!(one(298.0, &survey).is_some() && one(302.0, &survey).is_none());
    // At 1/4 of the pulse rate pulses have four times the energy and reach twice as far.
    survey.legs[0].scanner.pulse_freq = 25_000;
    assert!(one(596.0, &survey).is_some() && one(604.0, &survey).is_none());
    let survey = instrument(|d| d.receiver.max_range = Some(target(Some(25_000.0))));
    assert!(one(149.0, &survey).is_some() && one(151.0, &survey).is_none());
}

#[test]
fn noise_of_a_signal_to_noise_ratio_shows_in_amplitudes_and_ranges() {
    let (ratio, n) = (20.0, 4000);
    let target = ReferenceTarget { range: 100.0, reflectance: 0.5, pulse_freq: None };
    let survey = instrument(|d| {
        d.receiver.noise = Some(AmplifierNoise::Ratio { target, value: ratio });
        d.detector.threshold_given = false;
    });
    let echoes = refined(&wall_at(100.0), &survey, n).echoes;
    assert_eq!(echoes.len() as u64, n, "no pulse is lost, none has two echoes");
    let (mean, sigma) = moments(echoes.iter().map(|e| e.intensity));
    assert!(
        (mean / AT_100_M - 1.0).abs() < 0.01 && (sigma * ratio / AT_100_M - 1.0).abs() < 0.05,
        "{mean} ± {sigma}"
    );
    // The peak moves by n'/(A·s''): n' has the standard deviation σ/(√2σ_h), the raised cosine the relative
    // curvature π²/(2·fwhm²) at its peak, and the matched receiver √2σ_h = fwhm/√(8·ln 2).
    let fwhm = 3.394_680_67 * 4.0 / 7.0;
    let correlation = fwhm / (8.0 * 2f64.ln()).sqrt();
    let curvature = std::f64::consts::PI.powi(2) / (2.0 * fwhm * fwhm);
    let expected = 0.149_896_229 / curvature / correlation / ratio;
    let (mean, sigma) = moments(echoes.iter().map(|e| e.range));
    assert!(
        (mean - 100.0).abs() < 1e-3 && (sigma / expected - 1.0).abs() < 0.1,
        "{mean} ± {sigma}, not {expected}"
    );
}

#[test]
fn the_probability_of_detection_is_the_tail_beyond_the_threshold() {
    let n = 4000;
    for over in [-1.5, -0.5, 0.0, 1.0] {
        let sigma = AT_100_M / 12.0;
        let survey = instrument(|d| {
            noisy(sigma)(d);
            d.detector.threshold = (AT_100_M + over * sigma) * 1e-9;
        });
        let seen = refined(&wall_at(100.0), &survey, n).echoes.len() as f64;
        let expected = 0.5 * erfc(over / std::f64::consts::SQRT_2);
        assert!(
            (seen / n as f64 - expected).abs() < 0.05,
            "T = A + {over}σ: {} for {expected}",
            seen / n as f64
        );
    }
}

#[test]
fn noise_alone_makes_echoes_of_nothing() {
    // Nothing but a wall behind the instrument.
    let scene = rectangles(half_white(), &[wall(-20.0, 20.0, -50.0)]);
    let survey = instrument(|d| {
        noisy(1.0)(d);
        d.detector.threshold = 4e-9;
    });
    let n = 1000;
    let batch = refined(&scene, &survey, n);
    // √(−ρ''(0))/2π·exp(−T²/2σ²) per ns, from the minimum range of 1.5 m to the next pulse 10 µs later.
    let correlation = 3.394_680_67 * (4.0 / 7.0) / (8.0 * 2f64.ln()).sqrt();
    let gate = 1e4 - 1.5 / 0.149_896_229;
    let expected = n as f64 * gate * (-8f64).exp() / (2.0 * std::f64::consts::PI * correlation);
    let found = batch.echoes.len() as f64;
    assert!((found - expected).abs() < 4.0 * expected.sqrt(), "{found} for {expected}");
    for e in &batch.echoes {
        assert!((e.part, e.primitive) == (u32::MAX, u32::MAX) && e.intensity >= 4.0 && e.return_number >= 1);
        assert!((e.position - (e.origin + e.direction * e.range)).length() < 1e-9 && e.range >= 1.5);
    }
    let again = refined(&scene, &survey, n);
    assert_eq!(again.echoes, batch.echoes);
    // The range and the number of returns limit them.
    let near = instrument(|d| {
        noisy(1.0)(d);
        (d.detector.threshold, d.detector.range_max, d.detector.max_returns) = (3e-9, 150.0, 1);
    });
    let few = refined(&scene, &near, n).echoes;
    assert!(!few.is_empty() && few.iter().all(|e| e.range <= 150.0 && e.number_of_returns == 1));
}

#[test]
fn a_threshold_within_the_noise_is_refused() {
    let mut survey = instrument(|d| {
        noisy(1.0)(d);
        d.detector.threshold = 1e-9;
    });
    survey.legs[0].scanner.pulse_freq = 1000;
    let scene = wall_at(100.0);
    let error = Physics::new(&scene, &tree(&scene), &survey, PhysicsOptions::refined()).unwrap_err();
    assert!(error.to_string().contains("false alarms per pulse"), "{error}");
}

#[test]
fn without_a_threshold_of_its_own_a_noisy_receiver_stays_above_its_noise() {
    let at = |sigma: f64| {
        let survey = instrument(|d| {
            noisy(sigma)(d);
            d.detector.threshold_given = false;
        });
        refined(&wall_at(100.0), &survey, 200).echoes.len()
    };
    assert_eq!((at(AT_100_M / 12.0), at(AT_100_M / 2.0)), (200, 0));
}

#[test]
fn background_light_makes_shot_noise() {
    // 2qB·P/r: of 1 µW of sunlight and the echo's own light at 0.5 A/W and 200 MHz.
    let survey = instrument(|d| {
        d.receiver.shot = Some(ShotNoise { background: 1e-6, responsivity: 0.5 });
        d.receiver.bandwidth = Some(2e8);
        d.detector.threshold_given = false;
    });
    let echoes = refined(&wall_at(100.0), &survey, 4000).echoes;
    let expected = (2.0 * 1.602_176_634e-19 * 2e8 * (1e-6 + AT_100_M * 1e-9) / 0.5).sqrt() * 1e9;
    let (_, sigma) = moments(echoes.iter().map(|e| e.intensity));
    assert!((sigma / expected - 1.0).abs() < 0.06, "{sigma} is not {expected}");
}

#[test]
fn ranges_and_amplitudes_are_exact_in_bins_up_to_the_width_of_the_pulse() {
    // Two walls, each half in the beam: the second echo begins anywhere within a bin. 4 ns are 1.94 ns at
    // half maximum. In bins of 1.9 ns the pulse reaches a third sample from 4 % of the starts only. Then its
    // maximum is on the sample between, both neighbours hold a thousandth of it, and the third one, a law of
    // two terms, is exact at the ends of these starts alone: half a millimetre. All other starts are read as
    // exactly as in narrower bins.
    for (bin, tolerance) in [(0.05, 1e-5), (0.25, 1e-5), (0.5, 1e-5), (0.97, 1e-5), (1.9, 5e-4)] {
        let mut exact = 0;
        for by in 0..40 {
            let far = 130.0 + f64::from(by) * bin * 0.15 / 40.0;
            let scene = rectangles(half_white(), &[wall(0.0, 20.0, 100.0), wall(-20.0, 20.0, far)]);
            let survey = instrument(|d| {
                (d.waveform.bin, d.waveform.quality) = (bin, 3);
                d.beam.divergence = 3e-4;
            });
            let echoes = simulate(&scene, &survey, PhysicsOptions::refined()).echoes;
            assert_eq!(echoes.len(), 2, "bins of {bin} ns");
            for (echo, range) in echoes.iter().zip([100.0, far]) {
                exact += i32::from((echo.range - range).abs() < 1e-5);
                assert!(
                    (echo.range - range).abs() < tolerance,
                    "bins of {bin} ns: {} is not {range}",
                    echo.range
                );
                let full = AT_100_M * 1e4 / (range * range);
                let eighths = echo.intensity / full * 16.0;
                assert!(
                    (eighths - eighths.round()).abs() < 10.0 * tolerance,
                    "bins of {bin} ns: {eighths}/16 of the beam"
                );
            }
        }
        assert!(exact >= 2 * 40 - 2, "bins of {bin} ns: {exact} of 80 echoes");
    }
}

#[test]
fn strong_echoes_saturate_and_stay_where_they_are() {
    for ranging in [Ranging::Peak, Ranging::Centroid, Ranging::Gaussian] {
        for (bin, clock) in [(0.1, false), (0.25, true), (0.97, true)] {
            let survey = instrument(|d| {
                d.receiver = Receiver {
                    saturation: Some(AT_100_M * 1e-9),
                    digitiser_clock: clock,
                    ranging,
                    ..Receiver::default()
                };
                d.waveform.bin = bin;
            });
            for (range, share) in [(1.6, 3906.25), (10.0, 100.0), (100.013, 0.999_74), (1000.0, 0.01)] {
                let echo = one(range, &survey).expect("an echo");
                let expected = AT_100_M * share / (1.0f64 + share * share).sqrt();
                assert!((echo.intensity / expected - 1.0).abs() < 1e-4, "{range} m: {} nW", echo.intensity);
                let error = echo.range - range;
                let tolerance = if ranging == Ranging::Peak { 1e-6 } else { 1.5e-3 };
                assert!(error.abs() < tolerance, "{ranging:?}, bins of {bin} ns, {range} m: {error}");
            }
        }
    }
}

#[test]
fn records_of_saturated_echoes_are_those_of_the_receiver_and_wider() {
    let options = PhysicsOptions { record_waveforms: true, echo_width: true, ..PhysicsOptions::refined() };
    let of = |saturation| {
        let survey = instrument(|d| d.receiver.saturation = saturation);
        simulate(&wall_at(20.0), &survey, options)
    };
    let (free, saturated) = (of(None), of(Some(AT_100_M * 1e-9)));
    let top = saturated.samples.iter().copied().fold(0.0, f64::max);
    assert!(top <= AT_100_M && (top / saturated.echoes[0].intensity - 1.0).abs() < 1e-3, "{top}");
    assert_eq!(saturated.samples.len(), free.samples.len());
    assert!(saturated.echoes[0].echo_width > 1.5 * free.echoes[0].echo_width);
}

#[test]
fn a_threshold_that_saturation_hides_is_refused() {
    let survey = instrument(|d| {
        d.receiver.saturation = Some(1e-9);
        d.detector.threshold = 2e-9;
    });
    let scene = wall_at(100.0);
    let error = Physics::new(&scene, &tree(&scene), &survey, PhysicsOptions::refined()).unwrap_err();
    assert!(error.to_string().contains("saturation"), "{error}");
    // Just below it, an echo counts as soon as the saturated output reaches the threshold: v/√(1 + v²) = 0.6
    // at v = 0.75.
    let survey = instrument(|d| {
        d.receiver.saturation = Some(AT_100_M * 1e-9);
        d.detector.threshold = 0.6 * AT_100_M * 1e-9;
    });
    let farthest = 100.0 / 0.75f64.sqrt();
    assert!(one(farthest * 0.99, &survey).is_some() && one(farthest * 1.01, &survey).is_none());
}

#[test]
fn maxima_of_recorded_waveforms_lie_at_the_ranges_of_the_points() {
    let options = PhysicsOptions { record_waveforms: true, ..PhysicsOptions::refined() };
    let measured =
        Arc::new(PulseSamples { times: vec![0.0, 1.3, 2.1, 6.0], powers: vec![0.0, 1.0, 0.8, 0.0] });
    for (length, bin) in [(4.0, 0.25), (4.0, 0.1), (4.0, 0.5), (2.0, 0.25), (10.0, 1.0)] {
        for (clock, shape) in [(false, None), (true, None), (true, Some(measured.clone()))] {
            let survey = instrument(|d| {
                (d.beam.pulse_length, d.waveform.bin) = (length, bin);
                (d.receiver.digitiser_clock, d.receiver.pulse_shape) = (clock, shape.clone());
                d.beam.pulse_energy = Some(1e-6);
            });
            let batch = simulate(&wall_at(100.013), &survey, options);
            let range = batch.echoes[0].range;
            let tolerance = if shape.is_some() { 1e-4 } else { 1e-6 };
            assert!((range - 100.013).abs() < tolerance, "{length} {bin} {clock}: {range}");
            // Samples of a raised cosine of T are a constant and a cosine of T, whose phase three of them
            // tell.
            if shape.is_none() {
                let wave = batch.waveforms[0];
                let at = |k: usize| batch.samples[wave.first_sample + k];
                let omega = std::f64::consts::PI * bin / (3.394_680_67 * length / 7.0);
                let k = (std::f64::consts::PI / omega).ceil() as usize;
                let (sine, cosine) = (at(k + 1) - at(k - 1), 2.0 * at(k) - at(k + 1) - at(k - 1));
                let offset = (sine / cosine * (omega / 2.0).tan()).atan() / omega;
                let top = (wave.start_ns + (k as f64 + offset) * bin) * 0.149_896_229;
                assert!((top - range).abs() < 1e-6, "{length} {bin} {clock}: {top}");
            }
        }
    }
}

#[test]
fn weak_echoes_walk() {
    let survey = instrument(|d| {
        d.receiver.range_walk = 0.08;
        d.detector.threshold = AT_100_M * 1e-9 / 4.0;
    });
    for (range, walk) in [(100.0, 0.02), (50.0, 0.005), (190.0, 0.08 * 3.61 / 4.0)] {
        let echo = one(range, &survey).expect("an echo");
        assert!((echo.range - range - walk).abs() < 2e-3, "{range} m: {}", echo.range - range);
    }
}

#[test]
fn a_digitiser_with_its_own_clock_samples_on_its_grid() {
    let survey = instrument(|d| d.receiver.digitiser_clock = true);
    let options = PhysicsOptions { record_waveforms: true, ..PhysicsOptions::refined() };
    let mut tops = Vec::new();
    for i in 0..40 {
        let range = 100.0 + f64::from(i) * 0.0093;
        let batch = simulate(&wall_at(range), &survey, options);
        let ticks = batch.waveforms[0].start_ns / 0.25;
        assert_eq!(ticks, ticks.round());
        assert!((batch.echoes[0].range - range).abs() < 1e-6, "{range}: {}", batch.echoes[0].range);
        tops.push(batch.echoes[0].intensity * range * range);
    }
    // The amplitude is that of the maximum, wherever the samples lie.
    for top in tops {
        assert!((top / (AT_100_M * 1e4) - 1.0).abs() < 1e-6, "{top}");
    }
}

#[test]
fn every_detector_finds_walls_with_pulses_of_any_shape() {
    // A triangle of 1 µJ: 1 µJ/3 ns = 333 W at the peak.
    let pulse = Arc::new(PulseSamples { times: vec![0.0, 2.0, 6.0], powers: vec![0.0, 1.0, 0.0] });
    for ranging in [Ranging::Peak, Ranging::Centroid, Ranging::Gaussian] {
        for clock in [false, true] {
            for shape in [None, Some(pulse.clone())] {
                let survey = instrument(|d| {
                    d.receiver = Receiver {
                        ranging,
                        digitiser_clock: clock,
                        pulse_shape: shape.clone(),
                        ..Receiver::default()
                    };
                    d.beam.pulse_energy = Some(1e-6);
                });
                for range in [20.0, 100.013, 333.1] {
                    let echo = one(range, &survey).expect("an echo");
                    let error = echo.range - range;
                    assert!(error.abs() < 1e-3, "{ranging:?} {clock} at {range}: {error}");
                    if shape.is_some() {
                        let top = 1e-6 / 3e-9 * 1e9 * 0.5 * 0.15 * 0.15 * 0.99 / (4.0 * range * range);
                        let seen = echo.intensity / top;
                        assert!((seen - 1.0).abs() < 2e-3, "{range} m: {seen} of the peak");
                    }
                }
            }
        }
    }
}

#[test]
fn recorded_waveforms_have_the_noise_of_the_stated_accuracy() {
    // 4 ns: 1.9398 ns at half maximum, 0.12347 m of standard deviation; 5 mm of it in an echo need a ratio of
    // 24.69.
    let options =
        PhysicsOptions { record_waveforms: true, waveform_noise: true, ..PhysicsOptions::refined() };
    let of = |accuracy: f64, change: &dyn Fn(&mut Device)| {
        let survey = instrument(|d| {
            d.detector.accuracy = accuracy;
            change(d);
        });
        simulate_pulses(&wall_at(100.0), &survey, options, 0, &pulses(1000)).samples
    };
    let (noisy_samples, clean) = (of(0.005, &|_| ()), of(0.0, &|_| ()));
    let (_, sigma) = moments(noisy_samples.iter().zip(&clean).map(|(a, b)| a - b));
    let top = clean.iter().copied().fold(0.0, f64::max);
    assert!((top / sigma / 24.69 - 1.0).abs() < 0.02, "{}", top / sigma);
    // A receiver with noise settings gets no additional noise.
    let own = |d: &mut Device| {
        noisy(10.0)(d);
        d.detector.threshold_given = false;
    };
    assert_eq!(of(0.005, &own), of(0.0, &own));
}

#[test]
fn the_reference_has_no_receiver() {
    let change = |d: &mut Device| {
        noisy(1e3)(d);
        d.receiver.max_range = Some(ReferenceTarget { range: 1.0, reflectance: 0.5, pulse_freq: None });
        d.receiver.saturation = Some(1e-12);
        (d.receiver.digitiser_clock, d.receiver.range_walk, d.receiver.ranging) =
            (true, 1.0, Ranging::Gaussian);
        d.beam.pulse_energy = Some(1.0);
    };
    let options = PhysicsOptions { record_waveforms: true, ..PhysicsOptions::helios() };
    let (with, without) = (
        simulate(&wall_at(100.0), &instrument(change), options),
        simulate(&wall_at(100.0), &instrument(|_| ()), options),
    );
    assert_eq!((with.echoes, with.samples), (without.echoes, without.samples));
    let mut options = PhysicsOptions::refined();
    options.corrections.receiver = false;
    let without_energy = |d: &mut Device| {
        change(d);
        d.beam.pulse_energy = None;
    };
    let switched_off = simulate(&wall_at(100.0), &instrument(without_energy), options).echoes;
    assert_eq!(
        switched_off,
        simulate(&wall_at(100.0), &instrument(|_| ()), PhysicsOptions::refined()).echoes
    );
}

#[test]
fn range_noise_follows_the_strength_and_ranges_come_in_steps() {
    use vlscan_survey::RangeNoise;
    // The threshold is at 200 m: at 100 m echoes are four times as strong, at 50 m sixteen times.
    let target = ReferenceTarget { range: 200.0, reflectance: 0.5, pulse_freq: None };
    let noise = RangeNoise { constant: 0.01, shot: 0.04, amplifier: 0.08, footprint: 0.0 };
    for (range, expected) in [
        (100.0, (1e-4 + 16e-4 / 4.0 + 64e-4 / 16.0f64).sqrt()),
        (50.0, (1e-4 + 1e-4 + 64e-4 / 256.0f64).sqrt()),
    ] {
        let survey = instrument(|d| {
            (d.receiver.max_range, d.receiver.range_noise) = (Some(target), Some(noise));
            (d.receiver.range_step, d.detector.accuracy) = (0.008, 5.0);
        });
        let echoes = refined(&wall_at(range), &survey, 4000).echoes;
        let (mean, sigma) = moments(echoes.iter().map(|e| e.range));
        assert!((mean - range).abs() < 1e-3, "{mean}");
        // Steps add the variance of a uniform distribution.
        let with_steps = (expected * expected + 0.008 * 0.008 / 12.0).sqrt();
        assert!((sigma / with_steps - 1.0).abs() < 0.04, "{sigma} at {range} m, not {with_steps}");
        assert!(echoes.iter().all(|e| (e.range / 0.008 - (e.range / 0.008).round()).abs() < 1e-6));
        assert!(
            echoes.iter().all(|e| ((e.position - e.origin).length() - e.range).abs() < 1e-9),
            "points lie at their ranges"
        );
    }
}

#[test]
fn photons_decide_on_detection_and_dead_time_hides_what_follows() {
    let target = ReferenceTarget { range: 100.0, reflectance: 0.5, pulse_freq: None };
    let photons = |d: &mut Device| {
        (d.receiver.max_range, d.receiver.threshold_photons) = (Some(target), Some(10));
    };
    // P(at least 10) for means of 10, 2.5 and 40 (Poisson).
    for (range, expected) in [(100.0, 0.5421), (200.0, 0.0003), (50.0, 1.0)] {
        let seen = refined(&wall_at(range), &instrument(photons), 4000).echoes.len() as f64 / 4000.0;
        assert!((seen - expected).abs() < 0.03, "{seen} at {range} m, not {expected}");
    }
    // Amplitudes are those of the photons: mean and variance of the Poisson distribution of 40.
    let echoes = refined(&wall_at(50.0), &instrument(photons), 4000).echoes;
    let (mean, sigma) = moments(echoes.iter().map(|e| e.intensity));
    assert!((sigma / mean / 40f64.sqrt().recip() - 1.0).abs() < 0.05, "{mean} ± {sigma}");
    // Two walls, 1 m apart, each in a half of the beam.
    let halves = rectangles(half_white(), &[wall(-20.0, 0.0, 100.0), wall(-20.0, 20.0, 101.0)]);
    let count = |dead_time: f64| {
        let survey = instrument(|d| (d.waveform.quality, d.receiver.dead_time) = (3, dead_time));
        let batch = refined(&halves, &survey, 1);
        assert!(batch.echoes.iter().all(|e| e.number_of_returns as usize == batch.echoes.len()));
        batch.echoes.len()
    };
    assert_eq!([count(0.0), count(6.5), count(6.8)], [2, 2, 1]);
}

#[test]
fn texture_moves_ranges_on_slopes_and_echoes_drop_out() {
    use vlscan_survey::RangeNoise;
    // A wall at 45°: the depths within a beam of 2 mrad have the standard deviation 100 m · 0.5 mrad.
    let survey = instrument(|d| {
        d.receiver.range_noise = Some(RangeNoise { footprint: 0.8, ..RangeNoise::default() });
        d.receiver.dropout_rate = 0.1;
        d.beam.divergence = 2e-3;
    });
    let mut survey = survey;
    survey.legs[0].scanner.beam_divergence = 2e-3;
    let echoes = refined(&tilted_plane(half_white()), &survey, 4000).echoes;
    assert!((echoes.len() as f64 / 4000.0 - 0.9).abs() < 0.02, "{} of 4000", echoes.len());
    let (mean, sigma) = moments(echoes.iter().map(|e| e.range));
    assert!((mean - 100.0).abs() < 0.01 && (sigma / 0.04 - 1.0).abs() < 0.05, "{mean} ± {sigma}");
}
