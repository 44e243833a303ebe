//! Pulses under odd settings, alone and together, on every instruction set, and with noise of ranges and waveforms.

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
    for level in crate::tree::simd::Level::available() {
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
