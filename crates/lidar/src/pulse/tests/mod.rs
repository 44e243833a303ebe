//! Complete pulses over small scenes: the worked examples of spec pulse-physics §4.12, §5.6 and of the traps.

mod beam;
mod continuum;
mod foliage;
mod moving;
mod paths;
mod ranges;
mod receivers;
mod robustness;
mod scene_box;
mod slabs;
mod truth;
mod velocity;
mod water;
mod weather;

use super::testkit::*;
use super::{Corrections, Physics, PhysicsOptions, PulseSimulator};
use crate::flight::Pulse;
use crate::pulse::Batch;
use vlscan_geom::{Aabb, DVec3, Rotation, radians};
use vlscan_scene::{Material, Reflection, Scene};
use vlscan_survey::{Device, Survey};

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
    let batch = simulate(&plane_at_100(), &tls(), options);
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
        simulate(&plane_at_100(), &tls(), PhysicsOptions { echo_width: true, ..PhysicsOptions::helios() });
    assert_echoes(&batch, &[(100.0, 0.002654091)], 2e-7);
    assert!((batch.echoes[0].echo_width - 0.4041).abs() < 5e-5);
}

#[test]
fn all_subrays_of_the_plane_count_when_equal_ranges_add() {
    assert_echoes(
        &simulate(&plane_at_100(), &tls(), with(legacy(), "sum_equal_ranges")),
        &[(100.0, 1066.055)],
        1e-6,
    );
    let improved = simulate(&plane_at_100(), &tls(), with(PhysicsOptions::helios(), "sum_equal_ranges"));
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
    let batch = simulate(&tilted_plane(half_white()), &survey, options);
    let w = batch.waveforms[0];
    assert!((w.start_ns - 329.4325).abs() < 5e-5 && (w.end_ns - 339.6325).abs() < 5e-5);
    assert_eq!(w.samples, 35);
    assert_echoes(&batch, &[(100.1104, 352.904730959)], 1e-10);
    assert!((batch.echoes[0].echo_width - 2.5222).abs() < 5e-5);
    let improved = simulate(
        &tilted_plane(half_white()),
        &survey,
        PhysicsOptions { echo_width: true, ..Default::default() },
    );
    assert_echoes(&improved, &[(100.1104, 0.030266230)], 1e-7);
    assert!((improved.echoes[0].echo_width - 3.0390).abs() < 5e-5);
}

#[test]
fn materials_and_angles_change_the_amplitude() {
    // spec pulse-physics §3.6
    let survey = tls_with(|d| d.waveform.quality = 1);
    let phong = Reflection::Phong { specularity: 0.5, exponent: 10.0 };
    let shiny = Material { reflection: phong, ..half_white() };
    assert_echoes(&simulate(&tilted_plane(half_white()), &survey, legacy()), &[(100.0, 1333.6886)], 1e-7);
    assert_echoes(&simulate(&tilted_plane(shiny), &survey, legacy()), &[(100.0, 666.8443)], 1e-7);
    let facing = PhysicsOptions { fixed_incidence: true, ..legacy() };
    assert_echoes(&simulate(&tilted_plane(half_white()), &survey, facing), &[(100.0, 1886.1205)], 1e-7);
    assert_echoes(&simulate(&plane_at_100(), &survey, legacy()), &[(100.0, 1886.1205)], 1e-7);
}

/// Two half-planes with their edge 1 mm beside the axis, which hits the farther one.
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
    let both = simulate(&scene, &step_survey(|_| ()), legacy());
    assert_echoes(&both, &[first, second], 1e-6);
    assert_eq!((both.echoes[0].return_number, both.echoes[1].return_number), (1, 2));
    assert_eq!((both.echoes[0].part, both.echoes[1].part), (0, 1));
    let one = simulate(&scene, &step_survey(|d| d.detector.max_returns = 1), legacy());
    assert_echoes(&one, &[first], 1e-6);
    assert_eq!(one.echoes[0].number_of_returns, 1);
    let near = simulate(&scene, &step_survey(|d| d.detector.range_max = 102.0), legacy());
    assert_echoes(&near, &[first], 1e-6);
    let short = step_survey(|d| d.waveform.max_range = 10.0);
    assert_echoes(&simulate(&scene, &short, legacy()), &[], 0.0);
    let long = step_survey(|d| d.waveform.max_range = 400.0);
    assert_echoes(&simulate(&scene, &long, legacy()), &[first, second], 1e-6);
    assert_echoes(&simulate(&scene, &short, with(legacy(), "limit_from_first")), &[first], 1e-6);
}

#[test]
fn a_near_surface_discards_the_pulse_or_only_its_own_subrays() {
    // spec pulse-physics §4.12 (i)
    let survey = step_survey(|_| ());
    let ranges = |near, options| -> Vec<f64> {
        simulate(&step(near, 50.0), &survey, options)
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
fn pulses_from_the_dead_zone_are_counted_apart_from_weak_ones() {
    let survey = step_survey(|_| ());
    for record_waveforms in [false, true] {
        let run = |near, options| {
            let options = PhysicsOptions { record_waveforms, ..options };
            simulate(&rectangles(half_white(), &[wall(-20.0, 20.0, near)]), &survey, options)
        };
        let batch = run(1.9, legacy());
        assert_eq!((batch.echoes.len(), batch.near.count, batch.weak.count), (0, 1, 0));
        // The peak of a pulse of 5 ns comes 6 bins of 0.25 ns, 0.45 m, after its start.
        let near = batch.near;
        assert!((near.nearest - 1.9).abs() < 1e-3 && near.range_min == 1.5, "{near:?}");
        assert!((near.dead_zone - (1.5 + 1.5 * 0.299792458)).abs() < 1e-9, "{near:?}");
        for seen in [run(2.0, legacy()), run(1.9, with(legacy(), "clip_dead_zone"))] {
            assert_eq!((seen.echoes.len(), seen.near.count), (1, 0));
        }
        let too_near = run(1.4, legacy());
        assert_eq!((too_near.echoes.len(), too_near.near.count, too_near.weak.count), (0, 0, 0));
    }
}

#[test]
fn what_is_behind_a_near_surface_shows_when_asked_for() {
    let scene = rectangles(half_white(), &[wall(-20.0, 20.0, 1.0), wall(-20.0, 20.0, 30.0)]);
    assert_echoes(&simulate(&scene, &tls(), legacy()), &[], 0.0);
    let batch = simulate(&scene, &tls(), with(legacy(), "see_through_near"));
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
    let batch = simulate(&plane_at_100(), &survey, options);
    let w = batch.waveforms[0];
    assert!((w.start_ns - 332.3141).abs() < 5e-5 && (w.end_ns - 336.3141).abs() < 5e-5);
    assert_echoes(&batch, &[(100.0, 0.013192961)], 1e-7);
    let tilted = Pulse { device: 1, ..pulse(Rotation::about_x(radians(1.0))) };
    let batch = simulate_pulses(&plane_at_100(), &survey, options, 0, &[tilted]);
    assert!((batch.echoes[0].intensity / 0.010431430 - 1.0).abs() < 1e-7);
    assert_eq!(batch.echoes[0].device, 1);
}

#[test]
fn channels_meet_the_reflectance_at_their_own_wavelength() {
    let mut second = tls_device(4.0);
    second.beam.wavelength = 532.0;
    let two = survey(vec![tls_device(4.0), second.clone(), second]);
    let material =
        |reflection, further| Material { reflection, further_reflectances: further, ..half_white() };
    let shiny = Reflection::Lobes { specularity: 0.3, exponent: 5.0, roughness: 0.1 };
    for reflection in [Reflection::Lambert, Reflection::Uniform, shiny] {
        let of_device = |device, further: Vec<f64>, options| {
            let scene = rectangles(material(reflection, further), &[wall(-20.0, 20.0, 100.0)]);
            let pulse = Pulse { device, ..pulse(Rotation::IDENTITY) };
            simulate_pulses(&scene, &two, options, 0, &[pulse]).echoes[0].intensity
        };
        let refined = PhysicsOptions::refined();
        for device in [0, 1, 2] {
            let factor = if device > 0 { 0.25 } else { 1.0 };
            let plain = of_device(device, Vec::new(), refined);
            let found = of_device(device, vec![0.125], refined) / plain;
            assert!((found - factor).abs() < 1e-9, "{reflection:?}, device {device}: {found}");
        }
        let as_reference = PhysicsOptions::helios();
        assert_eq!(of_device(1, vec![0.125], as_reference), of_device(1, Vec::new(), as_reference));
    }
}

#[test]
fn a_later_leg_s_divergence_is_half_applied_unless_corrected() {
    // spec pulse-physics §9, trap 8
    let mut survey = tls();
    survey.legs.push(survey.legs[0].clone());
    survey.legs[1].scanner.beam_divergence = 2e-3;
    let of_leg = |survey: &Survey, options, leg| {
        simulate_pulses(&plane_at_100(), survey, options, leg, &pulses(1)).echoes[0].intensity
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
fn beams_without_divergence_or_minimum_range_have_one_echo() {
    // The reference computes NaN for the one and nothing for the other (spec pulse-physics §9, traps 21 and
    // 4).
    for options in [legacy(), PhysicsOptions::helios(), PhysicsOptions::refined()] {
        for (divergence, range_min) in [(0.0, 1.5), (3e-4, 0.0), (0.0, 0.0)] {
            let survey = tls_with(|d| (d.beam.divergence, d.detector.range_min) = (divergence, range_min));
            let echoes = simulate(&plane_at_100(), &survey, options).echoes;
            assert_eq!(echoes.len(), 1, "{divergence} rad, from {range_min} m");
            assert!((echoes[0].range - 100.0).abs() < 1e-4 && echoes[0].intensity > 0.0, "{:?}", echoes[0]);
        }
    }
}

#[test]
fn positions_lie_on_the_exact_axis_and_errors_count() {
    let mut p = pulse(Rotation::IDENTITY);
    p.exact_attitude = Rotation::about_x(radians(1.0));
    p.reported_attitude = p.exact_attitude;
    p.range_error = 0.25;
    p.origin = DVec3::new(0.0, 10.0, 0.0);
    let batch = simulate_pulses(
        &plane_at_100(),
        &tls(),
        PhysicsOptions { record_waveforms: true, ..legacy() },
        0,
        &[p],
    );
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
        let batch = simulate_pulses(&step(2.0, 50.0), &survey, options, 0, &[p]);
        batch.echoes.iter().map(|e| (e.return_number, e.number_of_returns)).collect()
    };
    assert_eq!(numbers(legacy()), [(2, 2)]);
    assert_eq!(numbers(with(legacy(), "count_kept_returns")), [(1, 1)]);
}

#[test]
fn the_refined_physics_sees_the_plane_where_it_is_and_loses_nothing_to_ties() {
    let batch = simulate(&plane_at_100(), &tls(), PhysicsOptions::refined());
    assert_eq!(batch.echoes.len(), 1);
    assert!((batch.echoes[0].range - 100.0).abs() < 1e-4);
    let tilted = simulate(&tilted_plane(half_white()), &tls(), PhysicsOptions::refined());
    assert!((tilted.echoes[0].range - 100.0).abs() < 2e-3, "{}", tilted.echoes[0].range);
    let without = PhysicsOptions { corrections: Corrections::NONE, ..PhysicsOptions::refined() };
    assert_eq!(without, PhysicsOptions::helios());
}

#[test]
fn the_two_way_time_base_doubles_times_and_keeps_ranges() {
    let options = PhysicsOptions { record_waveforms: true, ..with(legacy(), "two_way_time") };
    let batch = simulate(&plane_at_100(), &tls(), options);
    assert!((batch.echoes[0].range - 100.0).abs() < 1e-9);
    let peak = batch.waveforms[0].start_ns + 6.0 * 0.25;
    assert!((peak - 200.0 / vlscan_geom::LIGHT_SPEED).abs() < 1e-6);
}
