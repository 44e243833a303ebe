//! Whole pulses over small scenes: the worked examples of spec pulse-physics §4.12, §5.6 and of the traps.

mod beam;
mod continuum;
mod foliage;
mod moving;
mod ranges;
mod receivers;
mod slabs;
mod truth;

use super::testkit::*;
use super::{Corrections, Physics, PhysicsOptions, PulseSimulator};
use crate::geom::{Aabb, DVec3, Rotation, radians};
use crate::pulse::Batch;
use crate::scene::{Material, Reflection, Scene};
use crate::survey::{Device, Survey};
use proptest::prelude::*;

fn legacy() -> PhysicsOptions {
    PhysicsOptions { legacy_energy: true, ..PhysicsOptions::helios() }
}

fn with(base: PhysicsOptions, name: &str) -> PhysicsOptions {
    let mut o = base;
    *o.corrections.by_name(name).expect("a correction's name") = true;
    o
}

fn plane_at_100() -> Scene {
    rectangles(half_white(), &[wall(-20.0, 20.0, 100.0)])
}

fn tls() -> Survey {
    survey(vec![tls_device(5.0)])
}

fn tls_with(change: impl Fn(&mut Device)) -> Survey {
    let mut device = tls_device(5.0);
    change(&mut device);
    survey(vec![device])
}

fn assert_echoes(batch: &Batch, expected: &[(f64, f64)], tolerance: f64) {
    let found = measured(&batch.echoes);
    assert_eq!(found.len(), expected.len(), "{found:?} is not {expected:?}");
    for (f, e) in found.iter().zip(expected) {
        assert!(
            (f.0 - e.0).abs() < 5.1e-5 && (f.1 / e.1 - 1.0).abs() < tolerance,
            "{found:?} is not {expected:?}"
        );
    }
}

#[test]
fn a_plane_across_the_beam_keeps_four_of_nineteen_subrays() {
    // spec pulse-physics §4.12 (b)
    let options = PhysicsOptions { record_waveforms: true, echo_width: true, ..legacy() };
    let batch = fire(&plane_at_100(), &tls(), options);
    let w = batch.waveforms[0];
    assert_eq!(w.samples, 21);
    assert!((w.start_ns - 332.0640951981521).abs() < 1e-12 && (w.end_ns - 337.0640951981521).abs() < 1e-12);
    let f = &batch.samples[w.first_sample..][..w.samples];
    let expected = [
        0.0,
        41.625025515,
        117.330638858,
        186.033383466,
        233.058683766,
        256.615122899,
        260.400413878,
        249.765345574,
    ];
    for (f, e) in f.iter().zip(expected) {
        assert!((f - e).abs() < 1e-8, "{f} is not {e}");
    }
    assert!((f[19] - 27.593480184).abs() < 1e-8 && f[20] == 0.0);
    assert_echoes(&batch, &[(100.0, 260.400413878)], 1e-10);
    assert!((batch.echoes[0].echo_width - 1.3085).abs() < 5e-5);

    let batch =
        fire(&plane_at_100(), &tls(), PhysicsOptions { echo_width: true, ..PhysicsOptions::helios() });
    assert_echoes(&batch, &[(100.0, 0.002654091)], 2e-7);
    assert!((batch.echoes[0].echo_width - 0.4041).abs() < 5e-5);
}

#[test]
fn all_subrays_of_the_plane_count_when_equal_ranges_add() {
    assert_echoes(
        &fire(&plane_at_100(), &tls(), with(legacy(), "sum_equal_ranges")),
        &[(100.0, 1066.055)],
        1e-6,
    );
    let improved = fire(&plane_at_100(), &tls(), with(PhysicsOptions::helios(), "sum_equal_ranges"));
    assert_echoes(&improved, &[(100.0, 0.01327)], 1e-4);
}

/// A wall through (0, 100, 0), turned by 45° about z.
fn tilted_plane(material: Material) -> Scene {
    let along = DVec3::new(40.0, 40.0, 0.0);
    let corner = DVec3::new(0.0, 100.0, -20.0) - along * 0.5;
    rectangles(material, &[[corner, along, DVec3::new(0.0, 0.0, 40.0)]])
}

#[test]
fn a_tilted_plane_spreads_the_echo() {
    // spec pulse-physics §4.12 (c)
    let survey = tls_with(|d| {
        d.beam.divergence = 0.01;
        (d.waveform.quality, d.waveform.bin) = (5, 0.3);
    });
    let options = PhysicsOptions { record_waveforms: true, echo_width: true, ..legacy() };
    let batch = fire(&tilted_plane(half_white()), &survey, options);
    let w = batch.waveforms[0];
    assert!((w.start_ns - 329.4325).abs() < 5e-5 && (w.end_ns - 339.6325).abs() < 5e-5);
    assert_eq!(w.samples, 35);
    assert_echoes(&batch, &[(100.1104, 352.904730959)], 1e-10);
    assert!((batch.echoes[0].echo_width - 2.5222).abs() < 5e-5);
    let improved =
        fire(&tilted_plane(half_white()), &survey, PhysicsOptions { echo_width: true, ..Default::default() });
    assert_echoes(&improved, &[(100.1104, 0.030266230)], 1e-7);
    assert!((improved.echoes[0].echo_width - 3.0390).abs() < 5e-5);
}

#[test]
fn materials_and_angles_change_the_amplitude() {
    // spec pulse-physics §3.6
    let survey = tls_with(|d| d.waveform.quality = 1);
    let phong = Reflection::Phong { specularity: 0.5, exponent: 10.0 };
    let shiny = Material { reflection: phong, ..half_white() };
    assert_echoes(&fire(&tilted_plane(half_white()), &survey, legacy()), &[(100.0, 1333.6886)], 1e-7);
    assert_echoes(&fire(&tilted_plane(shiny), &survey, legacy()), &[(100.0, 666.8443)], 1e-7);
    let facing = PhysicsOptions { fixed_incidence: true, ..legacy() };
    assert_echoes(&fire(&tilted_plane(half_white()), &survey, facing), &[(100.0, 1886.1205)], 1e-7);
    assert_echoes(&fire(&plane_at_100(), &survey, legacy()), &[(100.0, 1886.1205)], 1e-7);
}

/// Two half-planes with their edge 1 mm beside the axis, which meets the one farther away.
fn step(near: f64, far: f64) -> Scene {
    rectangles(half_white(), &[wall(1e-3, 20.0, near), wall(-20.0, 1e-3, far)])
}

fn step_survey(change: impl Fn(&mut Device)) -> Survey {
    tls_with(|d| {
        d.beam.divergence = 0.01;
        change(d);
    })
}

#[test]
fn an_edge_gives_two_echoes() {
    // spec pulse-physics §4.12 (h)
    let (first, second) = ((100.0006, 281.4337), (104.9471, 273.1807));
    let scene = step(100.0, 105.0);
    let both = fire(&scene, &step_survey(|_| ()), legacy());
    assert_echoes(&both, &[first, second], 1e-6);
    assert_eq!((both.echoes[0].return_number, both.echoes[1].return_number), (1, 2));
    assert_eq!((both.echoes[0].part, both.echoes[1].part), (0, 1));
    let one = fire(&scene, &step_survey(|d| d.detector.max_returns = 1), legacy());
    assert_echoes(&one, &[first], 1e-6);
    assert_eq!(one.echoes[0].number_of_returns, 1);
    let near = fire(&scene, &step_survey(|d| d.detector.range_max = 102.0), legacy());
    assert_echoes(&near, &[first], 1e-6);
    let short = step_survey(|d| d.waveform.max_range = 10.0);
    assert_echoes(&fire(&scene, &short, legacy()), &[], 0.0);
    let long = step_survey(|d| d.waveform.max_range = 400.0);
    assert_echoes(&fire(&scene, &long, legacy()), &[first, second], 1e-6);
    assert_echoes(&fire(&scene, &short, with(legacy(), "limit_from_first")), &[first], 1e-6);
}

#[test]
fn a_near_surface_kills_the_pulse_or_only_its_own_subrays() {
    // spec pulse-physics §4.12 (i)
    let survey = step_survey(|_| ());
    let ranges = |near, options| -> Vec<f64> {
        fire(&step(near, 50.0), &survey, options)
            .echoes
            .iter()
            .map(|e| (e.range * 1e4).round() / 1e4)
            .collect()
    };
    assert_eq!(ranges(2.0, legacy()), [2.0, 49.9668]);
    assert_eq!(ranges(1.9, legacy()), [0.0; 0]);
    assert_eq!(ranges(1.4, legacy()), [50.0]);
    let clipped = ranges(1.9, with(legacy(), "clip_dead_zone"));
    assert_eq!(clipped.len(), 2);
    assert!((clipped[0] - 1.9).abs() < 0.08 && (clipped[1] - 50.0).abs() < 0.08, "{clipped:?}");
}

#[test]
fn what_is_behind_a_near_surface_shows_when_asked_for() {
    let scene = rectangles(half_white(), &[wall(-20.0, 20.0, 1.0), wall(-20.0, 20.0, 30.0)]);
    assert_echoes(&fire(&scene, &tls(), legacy()), &[], 0.0);
    let batch = fire(&scene, &tls(), with(legacy(), "see_through_near"));
    assert_eq!((batch.echoes.len(), batch.echoes[0].part), (1, 1));
    assert!((batch.echoes[0].range - 30.0).abs() < 1e-9);
}

#[test]
fn channels_have_their_own_settings_and_never_the_legacy_model() {
    // spec pulse-physics §5.6
    let mut first = tls_device(4.0);
    first.waveform.quality = 1;
    let survey = survey(vec![first, tls_device(5.0)]);
    let options = PhysicsOptions { record_waveforms: true, ..legacy() };
    let batch = fire(&plane_at_100(), &survey, options);
    let w = batch.waveforms[0];
    assert!((w.start_ns - 332.3141).abs() < 5e-5 && (w.end_ns - 336.3141).abs() < 5e-5);
    assert_echoes(&batch, &[(100.0, 0.013192961)], 1e-7);
    let tilted = crate::flight::Pulse { device: 1, ..pulse(Rotation::about_x(radians(1.0))) };
    let batch = fire_as(&plane_at_100(), &survey, options, 0, &tilted);
    assert!((batch.echoes[0].intensity / 0.010431430 - 1.0).abs() < 1e-7);
    assert_eq!(batch.echoes[0].device, 1);
}

#[test]
fn a_later_leg_s_divergence_is_half_applied_unless_corrected() {
    // spec pulse-physics §9, trap 8
    let mut survey = tls();
    survey.legs.push(survey.legs[0].clone());
    survey.legs[1].scanner.beam_divergence = 2e-3;
    let of_leg = |survey: &Survey, options, leg| {
        fire_as(&plane_at_100(), survey, options, leg, &pulse(Rotation::IDENTITY)).echoes[0].intensity
    };
    let near = |value: f64, expected: f64, tolerance: f64| {
        assert!((value / expected - 1.0).abs() < tolerance, "{value}")
    };
    near(of_leg(&survey, legacy(), 0), 260.4004, 1e-6);
    near(of_leg(&survey, legacy(), 1), 8.8347, 1e-5);
    let improved = PhysicsOptions::helios();
    near(of_leg(&survey, improved, 1), of_leg(&survey, improved, 0), 1e-15);
    let wide = tls_with(|d| d.beam.divergence = 2e-3);
    near(of_leg(&wide, legacy(), 0), 339.8929, 1e-6);
    near(of_leg(&wide, improved, 0), 0.0238, 3e-3);
    let corrected = with(legacy(), "divergence_per_leg");
    near(of_leg(&survey, corrected, 1), of_leg(&wide, legacy(), 0), 1e-15);
}

#[test]
fn without_divergence_every_bin_is_an_echo_of_nan() {
    // spec pulse-physics §9, trap 21
    let survey = tls_with(|d| d.beam.divergence = 0.0);
    for options in [legacy(), PhysicsOptions::helios()] {
        let batch = fire(&plane_at_100(), &survey, options);
        assert_eq!(batch.echoes.len(), 16);
        assert!(batch.echoes.iter().all(|e| e.intensity.is_nan()));
        let corrected = fire(&plane_at_100(), &survey, with(options, "collimated_energy"));
        assert_eq!(corrected.echoes.len(), 1);
        assert!(corrected.echoes[0].intensity > 1000.0);
    }
}

#[test]
fn the_axis_must_meet_the_scene_s_box_unless_corrected() {
    let scene = rectangles(half_white(), &[wall(5e-3, 20.0, 100.0)]);
    let survey = step_survey(|_| ());
    let options = PhysicsOptions { record_pulses: true, ..legacy() };
    let batch = fire(&scene, &survey, options);
    assert_eq!((batch.echoes.len(), batch.pulses.len()), (0, 1), "the pulse is recorded all the same");
    assert_eq!(batch.pulses[0].direction, DVec3::Y);
    assert_eq!(fire(&scene, &survey, with(options, "no_axis_gate")).echoes.len(), 1);
}

#[test]
fn a_box_behind_the_scanner_is_not_met_and_one_around_it_is() {
    let behind = rectangles(half_white(), &[wall(-20.0, 20.0, -10.0)]);
    assert_eq!(fire(&behind, &tls(), legacy()).echoes.len(), 0);
    let around = rectangles(half_white(), &[wall(-20.0, 20.0, -10.0), wall(-20.0, 20.0, 10.0)]);
    assert_eq!(fire(&around, &tls(), legacy()).echoes.len(), 1);
}

#[test]
fn what_moved_out_of_the_scene_s_box_vanishes_unless_corrected() {
    // spec pulse-physics §6: a plate that leaves the initial box of y from 100 to 120
    let mut scene = rectangles(half_white(), &[wall(-20.0, 20.0, 99.5), wall(-20.0, 20.0, 120.0)]);
    scene.bounds = Aabb { min: DVec3::new(-20.0, 100.0, -20.0), max: DVec3::new(20.0, 120.0, 20.0) }
        .translated(-scene.shift);
    let range = |options| fire(&scene, &tls(), options).echoes[0].range;
    assert!((range(legacy()) - 120.0).abs() < 1e-9);
    assert!((range(with(legacy(), "unbounded_scene")) - 99.5).abs() < 1e-9);
    scene.bounds.max.y -= 10.0;
    assert_eq!(fire(&scene, &tls(), legacy()).echoes.len(), 0, "nothing within the box");
}

#[test]
fn positions_lie_on_the_exact_axis_and_errors_count() {
    let mut p = pulse(Rotation::IDENTITY);
    p.exact_attitude = Rotation::about_x(radians(1.0));
    p.reported_attitude = p.exact_attitude;
    p.range_error = 0.25;
    p.origin = DVec3::new(0.0, 10.0, 0.0);
    let batch =
        fire_as(&plane_at_100(), &tls(), PhysicsOptions { record_waveforms: true, ..legacy() }, 0, &p);
    let e = batch.echoes[0];
    assert!((e.range - 90.25).abs() < 1e-9);
    assert!((e.position - (e.origin + p.exact_attitude.forward() * e.range)).length() < 1e-12);
    assert_eq!(batch.waveforms[0].direction, DVec3::Y, "waveforms tell the traced direction");
}

#[test]
fn echoes_nearer_than_the_minimum_range_leave_gaps_in_the_numbers_unless_corrected() {
    // A range error of −1 m moves the first of two echoes below the minimum range of 1.5 m.
    let survey = step_survey(|_| ());
    let mut p = pulse(Rotation::IDENTITY);
    p.range_error = -1.0;
    let numbers = |options| -> Vec<(u32, u32)> {
        let batch = fire_as(&step(2.0, 50.0), &survey, options, 0, &p);
        batch.echoes.iter().map(|e| (e.return_number, e.number_of_returns)).collect()
    };
    assert_eq!(numbers(legacy()), [(2, 2)]);
    assert_eq!(numbers(with(legacy(), "count_kept_returns")), [(1, 1)]);
}

#[test]
fn range_noise_has_device_0_s_spread_and_depends_on_the_pulse_alone() {
    let mut first = tls_device(5.0);
    first.detector.accuracy = 0.05;
    let survey = survey(vec![first, tls_device(5.0)]);
    let (scene, tree) = (plane_at_100(), tree(&plane_at_100()));
    let spread = |options: PhysicsOptions, device| {
        let physics = Physics::new(&scene, &tree, &survey, options).unwrap();
        let mut simulator = PulseSimulator::new(&physics);
        let mut batch = Batch::default();
        for number in 1..=2000 {
            let p = crate::flight::Pulse { number, device, ..pulse(Rotation::IDENTITY) };
            simulator.simulate(0, &[in_frame(&scene, &p)], &mut batch).unwrap();
        }
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
        let p = crate::flight::Pulse { number: 77, ..pulse(Rotation::IDENTITY) };
        fire_as(&scene, &survey, PhysicsOptions { seed, ..PhysicsOptions::helios() }, 0, &p).echoes[0].range
    };
    assert_eq!(again(5), again(5));
    assert_ne!(again(5), again(6));
}

#[test]
fn waveform_noise_changes_the_record_and_not_the_points() {
    let survey = tls_with(|d| d.detector.accuracy = 0.02);
    let run = |waveform_noise| {
        let options = PhysicsOptions { record_waveforms: true, waveform_noise, ..legacy() };
        fire(&plane_at_100(), &survey, options)
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
    assert_eq!(fire(&scene, &survey, legacy()).echoes.len(), 1, "the far one is too weak");
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
            let p = crate::flight::Pulse { number: i as u64 / 2 + 1, device: i as u32 % 2, ..pulse(turn) };
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
    for level in crate::tree::Level::available() {
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
        assert_eq!(fire(&empty, &tls(), options).echoes.len(), 0);
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut p = pulse(Rotation::IDENTITY);
            p.origin.x = bad;
            assert_eq!(fire_as(&plane_at_100(), &tls(), options, 0, &p).echoes.len(), 0);
            let mut p = pulse(Rotation::IDENTITY);
            p.attitude.w = bad;
            assert_eq!(fire_as(&plane_at_100(), &tls(), options, 0, &p).echoes.len(), 0);
        }
    }
}

#[test]
fn the_refined_physics_sees_the_plane_where_it_is_and_loses_nothing_to_ties() {
    let batch = fire(&plane_at_100(), &tls(), PhysicsOptions::refined());
    assert_eq!(batch.echoes.len(), 1);
    assert!((batch.echoes[0].range - 100.0).abs() < 1e-4);
    let tilted = fire(&tilted_plane(half_white()), &tls(), PhysicsOptions::refined());
    assert!((tilted.echoes[0].range - 100.0).abs() < 2e-3, "{}", tilted.echoes[0].range);
    let without = PhysicsOptions { corrections: Corrections::NONE, ..PhysicsOptions::refined() };
    assert_eq!(without, PhysicsOptions::helios());
}

#[test]
fn the_two_way_time_base_doubles_times_and_keeps_ranges() {
    let options = PhysicsOptions { record_waveforms: true, ..with(legacy(), "two_way_time") };
    let batch = fire(&plane_at_100(), &tls(), options);
    assert!((batch.echoes[0].range - 100.0).abs() < 1e-9);
    let peak = batch.waveforms[0].start_ns + 6.0 * 0.25;
    assert!((peak - 200.0 / crate::geom::LIGHT_SPEED).abs() < 1e-6);
}

/// Values that no instrument has, among some that one may have.
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
