//! Pulses under odd settings, alone and together, on every instruction set, and with noise of ranges and
//! waveforms.

use super::*;
use proptest::prelude::*;

#[test]
fn range_noise_has_device_0_s_spread_and_depends_on_the_pulse_alone() {
    let mut first = tls_device(5.0);
    first.detector.accuracy = 0.05;
    let survey = survey(vec![first, tls_device(5.0)]);
    let scene = plane_at_100();
    let spread = |options: PhysicsOptions, device| {
        let of_device: Vec<_> = pulses(2000).into_iter().map(|p| Pulse { device, ..p }).collect();
        let batch = simulate_pulses(&scene, &survey, options, 0, &of_device);
        let off: Vec<f64> = batch.echoes.iter().map(|e| e.range - 100.0).collect();
        assert_eq!(off.len(), 2000);
        assert!((off.iter().sum::<f64>() / 2000.0).abs() < 0.005);
        (off.iter().map(|o| o * o).sum::<f64>() / 2000.0).sqrt()
    };
    for device in [0, 1] {
        assert!((spread(PhysicsOptions::helios(), device) - 0.05).abs() < 0.004);
    }
    assert!(spread(with(PhysicsOptions::helios(), "own_accuracy"), 1) < 1e-9);
    let again = |seed| {
        let p = Pulse { number: 77, ..pulse(Rotation::IDENTITY) };
        simulate_pulses(&scene, &survey, PhysicsOptions { seed, ..PhysicsOptions::helios() }, 0, &[p]).echoes
            [0]
        .range
    };
    assert_eq!(again(5), again(5));
    assert_ne!(again(5), again(6));
}

#[test]
fn noise_puts_no_point_outside_the_range_limits() {
    // A wall 1 cm behind the minimum range of 1.5 m and one 1 cm before the maximum range, σ 5 cm: normal
    // noise leaves Q(−0.2) = 0.579 of either within the limits. The rest is not reported, and what is left is
    // counted anew.
    let survey = |accuracy| {
        tls_with(|d| {
            (d.detector.accuracy, d.detector.range_max) = (accuracy, 30.0);
            d.beam.divergence = 0.01;
        })
    };
    let walls =
        |near: f64, far: f64| rectangles(half_white(), &[wall(0.0, 20.0, near), wall(-20.0, 20.0, far)]);
    let options = PhysicsOptions { record_waveforms: true, record_truth: true, ..PhysicsOptions::refined() };
    let n = 4000;
    let batch = simulate_pulses(&walls(1.51, 29.99), &survey(0.05), options, 0, &pulses(n));
    let (mut near, mut far) = (0, 0);
    for (i, e) in batch.echoes.iter().enumerate() {
        assert!((1.5..=30.0).contains(&e.range), "{}", e.range);
        assert!(((e.position - e.origin).dot(DVec3::Y) - e.range).abs() < 1e-9);
        *(if e.range < 10.0 { &mut near } else { &mut far }) += 1;
        let before = if e.return_number == 2 { batch.echoes[i - 1].pulse_number } else { 0 };
        assert!(e.return_number <= e.number_of_returns && (before == 0 || before == e.pulse_number));
    }
    for count in [near, far] {
        assert!((f64::from(count) / n as f64 - 0.579).abs() < 0.03, "{count}");
    }
    let with_echo: std::collections::HashSet<u64> = batch.echoes.iter().map(|e| e.pulse_number).collect();
    let recorded: Vec<u64> = batch.waveforms.iter().map(|w| w.pulse_number).collect();
    assert_eq!(recorded.len(), with_echo.len());
    assert!(recorded.iter().all(|pulse| with_echo.contains(pulse)));
    // Without the gate all are there, some behind the scanner, as in the reference.
    let mut open = options;
    open.corrections.range_gate = false;
    let all = simulate_pulses(&walls(1.51, 29.99), &survey(5.0), open, 0, &pulses(n)).echoes;
    assert_eq!(all.len() as u64, 2 * n);
    assert!(all.iter().any(|e| e.range < 0.0));
    // Far from the limits the gate changes nothing.
    let inside = |options| simulate_pulses(&walls(10.0, 20.0), &survey(0.05), options, 0, &pulses(100));
    assert_eq!(inside(options).echoes, inside(open).echoes);
}

#[test]
fn waveform_noise_changes_the_record_and_not_the_points() {
    let survey = tls_with(|d| d.detector.accuracy = 0.02);
    let run = |waveform_noise| {
        let options = PhysicsOptions { record_waveforms: true, waveform_noise, ..legacy() };
        simulate(&plane_at_100(), &survey, options)
    };
    let (clean, noisy) = (run(false), run(true));
    assert_eq!(clean.echoes, noisy.echoes);
    assert_eq!(clean.samples.len(), noisy.samples.len());
    let off: Vec<f64> = clean.samples.iter().zip(&noisy.samples).map(|(a, b)| b - a).collect();
    assert!(off.iter().all(|o| *o != 0.0 && o.abs() < 0.06), "σ is half the accuracy: {off:?}");
}

#[test]
fn a_waveform_too_long_to_record_is_an_error_and_its_points_are_not() {
    let mut scene = step(100.0, 1e8);
    for v in &mut scene.geometry.vertices {
        if v.y > 1e7 {
            (v.x, v.z) = (v.x * 1e6, v.z * 1e6);
        }
    }
    scene.bounds = scene.geometry.bounds();
    let survey = step_survey(|_| ());
    assert_eq!(simulate(&scene, &survey, legacy()).echoes.len(), 1, "the far one is too weak");
    let tree = tree(&scene);
    let options = PhysicsOptions { record_waveforms: true, ..legacy() };
    let physics = Physics::new(&scene, &tree, &survey, options).unwrap();
    let error = PulseSimulator::new(&physics)
        .simulate(0, &[in_frame(&scene, &pulse(Rotation::IDENTITY))], &mut Batch::default())
        .unwrap_err();
    assert!(error.to_string().contains("maxFullwaveRange_ns"), "{error}");
}

#[test]
fn pulses_yield_the_same_alone_and_together() {
    let scene =
        rectangles(half_white(), &[wall(-20.0, 0.1, 100.0), wall(0.0, 20.0, 40.0), wall(-3.0, -1.0, 20.0)]);
    let mut second = tls_device(4.0);
    second.waveform.quality = 2;
    second.detector.accuracy = 0.01;
    let survey = survey(vec![tls_device(5.0), second]);
    let options = PhysicsOptions { record_waveforms: true, record_pulses: true, ..PhysicsOptions::helios() };
    let pulses: Vec<_> = (0..700)
        .map(|i| {
            let turn = Rotation::about_z(f64::from(i % 350) * 1e-3 - 0.2).after(Rotation::about_x(0.1));
            let p = Pulse { number: i as u64 / 2 + 1, device: i as u32 % 2, ..pulse(turn) };
            in_frame(&scene, &p)
        })
        .collect();
    let tree = tree(&scene);
    let physics = Physics::new(&scene, &tree, &survey, options).unwrap();
    let (mut together, mut alone) = (Batch::default(), Batch::default());
    PulseSimulator::new(&physics).simulate(0, &pulses, &mut together).unwrap();
    let mut simulator = PulseSimulator::new(&physics);
    for p in &pulses {
        simulator.simulate(0, std::slice::from_ref(p), &mut alone).unwrap();
    }
    assert!(together.echoes.len() > 500 && together.pulses.len() == 700);
    assert_eq!(together.echoes, alone.echoes);
    assert_eq!(together.waveforms, alone.waveforms);
    assert_eq!(together.samples, alone.samples);
    assert_eq!(together.pulses, alone.pulses);
    assert!(together.pulses.iter().zip(&pulses).all(|(r, p)| (r.number, r.device) == (p.number, p.device)));
    for level in vlscan_trace::simd::Level::available() {
        let (mut simulator, mut batch) = (PulseSimulator::new(&physics), Batch::default());
        simulator.level = level;
        simulator.simulate(0, &pulses, &mut batch).unwrap();
        assert_eq!(batch.echoes, alone.echoes, "{level:?}");
        assert_eq!(batch.samples, alone.samples, "{level:?}");
    }
}

#[test]
fn an_empty_scene_and_pulses_without_numbers_yield_nothing() {
    let empty = rectangles(half_white(), &[]);
    for options in [PhysicsOptions::helios(), PhysicsOptions::refined()] {
        assert_eq!(simulate(&empty, &tls(), options).echoes.len(), 0);
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut p = pulse(Rotation::IDENTITY);
            p.origin.x = bad;
            assert_eq!(simulate_pulses(&plane_at_100(), &tls(), options, 0, &[p]).echoes.len(), 0);
            let mut p = pulse(Rotation::IDENTITY);
            p.attitude.w = bad;
            assert_eq!(simulate_pulses(&plane_at_100(), &tls(), options, 0, &[p]).echoes.len(), 0);
        }
    }
}

/// Values that no instrument has, mixed with plausible ones.
fn odd() -> impl Strategy<Value = f64> {
    let values = [
        0.0,
        -0.0,
        1.0,
        -1.0,
        0.25,
        1e-9,
        1e-300,
        1e9,
        1e300,
        f64::MAX,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::NAN,
    ];
    prop::sample::select(values.to_vec())
}

proptest! {
    #[test]
    fn no_setting_makes_a_pulse_panic(
        beam in prop::array::uniform8(prop::option::weighted(0.2, odd())),
        detector in prop::array::uniform8(prop::option::weighted(0.2, odd())),
        quality in 0u32..6, refined: bool, legacy_energy: bool, echo_width: bool, record_waveforms: bool,
    ) {
        let survey = tls_with(|d| {
            let b = &mut d.beam;
            let (w, r) = (&mut d.waveform, &mut d.detector);
            let fields = [
                &mut b.divergence, &mut b.pulse_length, &mut b.wavelength, &mut b.atmosphere_wavelength,
                &mut b.average_power, &mut b.quality, &mut b.receiver_diameter, &mut b.visibility,
            ];
            fields.into_iter().zip(beam).for_each(|(f, v)| *f = v.unwrap_or(*f));
            let fields = [
                &mut r.accuracy, &mut r.range_min, &mut r.range_max, &mut r.threshold,
                &mut w.bin, &mut w.window, &mut w.max_range, &mut b.efficiency,
            ];
            fields.into_iter().zip(detector).for_each(|(f, v)| *f = v.unwrap_or(*f));
            w.quality = quality;
        });
        let base = if refined { PhysicsOptions::refined() } else { PhysicsOptions::helios() };
        let options = PhysicsOptions { legacy_energy, echo_width, record_waveforms, ..base };
        let scene = step(100.0, 105.0);
        let tree = tree(&scene);
        if let Ok(physics) = Physics::new(&scene, &tree, &survey, options) {
            let mut batch = Batch::default();
            if PulseSimulator::new(&physics).simulate(0, &[in_frame(&scene, &pulse(Rotation::IDENTITY))], &mut batch).is_ok() {
                prop_assert!(batch.echoes.iter().all(|e| e.return_number <= e.number_of_returns));
                prop_assert_eq!(batch.samples.len(), batch.waveforms.iter().map(|w| w.samples).sum::<usize>());
            }
        }
    }
}
