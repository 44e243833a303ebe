//! Fog, rain and dust in complete pulses.

use super::*;
use crate::pulse::{Echo, PathKind};
use vlscan_survey::{AirState, Beam, Weather, pulse_length_of_width};

/// Fog of this extinction, 1/m.
fn fog(extinction: f64) -> Weather {
    Weather { air: AirState { fog: extinction, ..AirState::default() }, ..Weather::CLEAR }
}

fn rain(rate: f64) -> Weather {
    Weather { air: AirState { rain: rate, ..AirState::default() }, ..Weather::CLEAR }
}

/// An instrument with pulses of 20 ns and a low threshold, in air without haze.
fn survey_in(weather: Weather, change: impl Fn(&mut Device)) -> Survey {
    let mut survey = tls_with(|device| {
        let pulse_length = pulse_length_of_width(20.0);
        device.beam = Beam { pulse_length, visibility: 1e30, ..device.beam };
        (device.detector.range_min, device.waveform.quality) = (0.0, 1);
        (device.detector.threshold, device.detector.threshold_given) = (1e-12, true);
        change(device);
    });
    survey.legs[0].scanner.weather = weather;
    survey
}

fn wall_at(range: f64) -> Scene {
    rectangles(half_white(), &[[DVec3::new(-600.0, range, -300.0), DVec3::X * 1200.0, DVec3::Z * 600.0]])
}

fn recorded() -> PhysicsOptions {
    PhysicsOptions { record_truth: true, ..PhysicsOptions::refined() }
}

/// Echoes of a wall with the kinds of their ways.
fn echoes(range: f64, survey: &Survey, pulses: &[Pulse]) -> Vec<(Echo, PathKind)> {
    let batch = simulate_pulses(&wall_at(range), survey, recorded(), 0, pulses);
    let alike = |echo: &Echo| Echo { truth_index: 0, ..*echo };
    batch.echoes.iter().map(|echo| (alike(echo), echo.truth(&batch.truths).path.kind)).collect()
}

/// Amplitude of a half-white wall at 100 m in clear air.
fn at_100_m() -> f64 {
    echoes(100.0, &survey_in(Weather::CLEAR, |_| ()), &pulses(1))[0].0.intensity
}

#[test]
fn fog_outshines_walls_at_the_ranges_of_the_integral() {
    let bright = at_100_m();
    for (lidar_ratio, reflectance, expected) in
        [(65.1246, 0.1, 5.5650), (65.1246, 0.5, 9.7060), (18.5, 0.1, 3.3812), (18.5, 0.5, 6.3334)]
    {
        let found = echoes(400.0, &survey_in(Weather { lidar_ratio, ..fog(0.06) }, |_| ()), &pulses(1));
        let [(of_fog, PathKind::Air)] = found[..] else { panic!("{found:?}") };
        assert!((of_fog.range - 1.642).abs() < 0.02, "{}", of_fog.range);
        assert_eq!((of_fog.classification, of_fog.part, of_fog.primitive), (18, u32::MAX, u32::MAX));
        let of_wall = |range: f64| {
            bright * reflectance / 0.5 * (100.0 / range) * (100.0 / range) * libm::exp(-0.12 * range)
        };
        let (mut near, mut far) = (1.0, 100.0);
        for _ in 0..60 {
            let range = 0.5 * (near + far);
            if of_wall(range) > of_fog.intensity { near = range } else { far = range }
        }
        assert!((near / expected - 1.0).abs() < 0.01, "{near} is not {expected}");
    }
}

#[test]
fn weather_dims_what_lies_behind_it() {
    let (bright, wall) = (at_100_m(), |weather: Weather, pulses: &[Pulse]| {
        let found = echoes(100.0, &survey_in(weather, |_| ()), pulses);
        let (echo, kind) = *found.last().unwrap();
        assert!(kind == PathKind::Direct && (echo.range - 100.0).abs() < 0.05, "{found:?}");
        assert_eq!((echo.classification, echo.part), (0, 0));
        echo.intensity
    });
    // The fog before the wall adds a little.
    let share = |weather: Weather| wall(weather, &pulses(1)) / bright;
    assert!((share(fog(0.005)) / libm::exp(-1.0) - 1.0).abs() < 0.01);
    let dust = Weather { air: AirState { dust: 0.005, ..AirState::default() }, ..Weather::CLEAR };
    assert_eq!(share(dust), share(fog(0.005)));
    assert!((share(rain(10.0)) / libm::exp(-0.2 * 1.555565) - 1.0).abs() < 0.01);
    // Kruse's haze by leg, at 1064 nm: 3.91/V·(λ/0.55)^(−q) with q = 0.585·V^0.33.
    let hazy = Weather { visibility: Some(1.0), ..Weather::CLEAR };
    let extinction = 3.91e-3 * libm::pow(1.064 / 0.55, -0.585);
    assert!((share(hazy) / libm::exp(-200.0 * extinction) - 1.0).abs() < 1e-6);
    // Half of the fog five seconds after clear air and five before it is complete.
    let rows = [(100.0, AirState::default()), (110.0, fog(0.01).air)];
    let growing = Weather { over_time: Some(rows.into()), ..Weather::CLEAR };
    let at = |seconds: f64| [Pulse { time_ns: seconds * 1e9, ..pulse(Rotation::IDENTITY) }];
    assert_eq!(wall(growing.clone(), &at(99.0)), bright);
    assert_eq!(wall(growing, &at(105.0)), wall(fog(0.005), &pulses(1)));
}

#[test]
fn dark_air_dims_surfaces_and_returns_nothing() {
    let survey = survey_in(rain(25.0), |device| device.beam.divergence = 0.003);
    let options = PhysicsOptions { dark_air: true, ..recorded() };
    let batch = simulate_pulses(&wall_at(100.0), &survey, options, 0, &pulses(300));
    assert_eq!(batch.echoes.len(), 300);
    let clear = simulate_pulses(
        &wall_at(100.0),
        &survey_in(Weather::CLEAR, |device| device.beam.divergence = 0.003),
        recorded(),
        0,
        &pulses(1),
    );
    let share = batch.echoes[0].intensity / clear.echoes[0].intensity;
    assert!((share / libm::exp(-0.2 * 2.770706) - 1.0).abs() < 1e-3, "{share}");
    assert!(batch.echoes.iter().all(|echo| echo.part == 0));
}

#[test]
fn raindrops_are_labelled_and_each_pulse_meets_others() {
    let survey = survey_in(rain(25.0), |device| {
        (device.beam.divergence, device.waveform.quality) = (0.003, 2);
        device.beam.pulse_length = pulse_length_of_width(4.0);
    });
    let all = echoes(60.0, &survey, &pulses(300));
    let drops: Vec<&Echo> = all.iter().filter(|e| e.1 == PathKind::Drop).map(|e| &e.0).collect();
    assert!(drops.len() > 100, "{}", drops.len());
    for drop in &drops {
        assert!((0.8..59.0).contains(&drop.range) && drop.classification == 18, "{drop:?}");
        assert_eq!((drop.part, drop.primitive), (u32::MAX, u32::MAX));
    }
    assert_eq!(all.iter().filter(|e| e.1 == PathKind::Direct).count(), 300);
    // The echoes of a pulse do not depend on the pulses beside it.
    let alone = echoes(60.0, &survey, &pulses(77)[76..]);
    let among: Vec<_> = all.iter().filter(|e| e.0.pulse_number == 77).copied().collect();
    assert_eq!(alone, among);
    // Other records of the same light.
    let options = PhysicsOptions { record_subrays: true, record_waveforms: true, ..recorded() };
    let batch = simulate_pulses(&wall_at(60.0), &survey, options, 0, &pulses(20));
    assert!(batch.echoes.iter().any(|echo| echo.part == u32::MAX));
    assert_eq!(batch.echoes.iter().filter(|echo| echo.part == 0).count() % 20, 0);
}

#[test]
fn labels_and_class_of_an_echo_are_of_the_same_surface() {
    let survey = survey_in(rain(25.0), |device| {
        (device.beam.divergence, device.waveform.quality) = (0.001, 4);
    });
    let batch = simulate_pulses(&wall_at(4.0), &survey, recorded(), 0, &pulses(3000));
    assert!(batch.echoes.len() >= 3000, "{}", batch.echoes.len());
    for echo in &batch.echoes {
        let truth = echo.truth(&batch.truths);
        let is_air = truth.path.kind.is_air();
        assert_eq!(is_air, echo.classification == 18, "{echo:?} {truth:?}");
        assert_eq!(is_air, echo.part == u32::MAX, "{echo:?} {truth:?}");
        assert!(is_air || truth.fraction <= 1.0 + 1e-9, "{truth:?}");
    }
}

#[test]
fn pulses_into_the_sky_meet_fog() {
    let away = [pulse(Rotation::about_z(radians(180.0)))];
    for width in [1.0, 4.0, 20.0] {
        let survey = survey_in(fog(0.03), |device| device.beam.pulse_length = pulse_length_of_width(width));
        let found = echoes(50.0, &survey, &away);
        assert!(matches!(found[..], [(_, PathKind::Air)]), "{found:?}");
    }
    assert!(echoes(50.0, &survey_in(Weather::CLEAR, |_| ()), &away).is_empty());
}

#[test]
fn clear_air_and_the_physics_of_helios_change_nothing() {
    let scene = wall_at(40.0);
    let of = |weather: Weather, options: PhysicsOptions| {
        simulate_pulses(&scene, &survey_in(weather, |_| ()), options, 0, &pulses(20)).echoes
    };
    let dry = Weather { over_time: Some([(1.0, AirState::default())].into()), ..Weather::CLEAR };
    let refined = PhysicsOptions::refined();
    for weather in [dry, Weather { lidar_ratio: 30.0, ..Weather::CLEAR }] {
        assert_eq!(of(weather, refined), of(Weather::CLEAR, refined));
    }
    let helios = PhysicsOptions::helios();
    assert_eq!(of(fog(0.1), helios), of(Weather::CLEAR, helios));
}
