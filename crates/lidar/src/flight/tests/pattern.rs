//! User-defined scan patterns, and those of tables.

use crate::flight::testing::*;
use crate::flight::{FlightOptions, FlightState, Step};
use std::f64::consts::TAU;
use std::sync::Arc;
use vlscan_base::corrections::Corrections;
use vlscan_geom::DVec3;
use vlscan_survey::*;

/// A circle of a turn per second, whose beam is off in the first quarter; the direction is `at_rest` then.
#[derive(Debug)]
struct Circle {
    at_rest: DVec3,
    is_off: bool,
}

impl ScanPattern for Circle {
    fn direction(&self, time: f64) -> DVec3 {
        if time.fract() < 0.25 {
            return self.at_rest;
        }
        let (sin, cos) = libm::sincos(TAU * time);
        DVec3::new(cos, 2.0, sin)
    }

    fn is_firing(&self, time: f64) -> bool {
        !self.is_off || time.fract() >= 0.25
    }
}

fn survey_of(pattern: Circle) -> Survey {
    let legs = [0.0, 5.0].map(|x| leg([x, 0.0, 0.0], 0.0, |leg| leg.scanner.max_duration = Some(2.0)));
    survey(PlatformKind::Static, Mount::IDENTITY, Deflector::Custom(Arc::new(pattern)), legs.into())
}

#[test]
fn beams_follow_the_pattern_from_the_begin_of_each_leg() {
    let flown = fly(&survey_of(Circle { at_rest: DVec3::new(0.0, 3.0, 0.0), is_off: false }));
    for leg in &flown[..2] {
        assert!((199..=201).contains(&leg.pulses.len()), "{}", leg.pulses.len());
        for (i, pulse) in leg.pulses.iter().enumerate() {
            let time = i as f64 * 0.01;
            let (sin, cos) = libm::sincos(TAU * time);
            let expected = if time.fract() < 0.25 { DVec3::Y } else { DVec3::new(cos, 2.0, sin).normalize() };
            let off = (pulse.attitude.forward() - expected).length();
            assert!(off < 1e-9, "pulse {i}: {:?}, expected {expected:?}", pulse.attitude.forward());
        }
    }
}

#[test]
fn what_does_not_fire_needs_no_direction() {
    let survey = survey_of(Circle { at_rest: DVec3::ZERO, is_off: true });
    let pulses: usize = fly(&survey).iter().map(|leg| leg.pulses.len()).sum();
    assert!((298..=304).contains(&pulses), "{pulses}");
    // Many steps at once are those of single steps.
    let plan = plan_with(&survey, options());
    let (mut quick, mut single) = (FlightState::start(&plan), FlightState::start(&plan));
    for _ in 0..7 {
        let (steps, pulses) = quick.advance(&plan, 23);
        let mut count = Count::default();
        (0..steps).for_each(|_| assert_eq!(single.step(&plan, &mut count).unwrap(), Step::Advanced));
        assert_eq!(count.pulses, u64::from(pulses));
        assert_eq!(format!("{quick:?}"), format!("{single:?}"));
        quick.step(&plan, &mut Count::default()).unwrap();
        single.step(&plan, &mut Count::default()).unwrap();
    }
}

#[test]
fn a_pulse_without_a_direction_is_an_error() {
    for at_rest in [DVec3::ZERO, DVec3::NAN, DVec3::X * f64::INFINITY] {
        let plan = plan_with(&survey_of(Circle { at_rest, is_off: false }), options());
        let error = FlightState::start(&plan).step(&plan, &mut Count::default()).unwrap_err();
        assert!(error.to_string().contains("scan pattern") && error.exit_status() == 2, "{error}");
    }
}

/// A pattern that has an error of its own.
#[derive(Debug)]
struct Broken;

impl ScanPattern for Broken {
    fn direction(&self, _: f64) -> DVec3 {
        DVec3::NAN
    }

    fn error(&self, time: f64) -> Option<Box<dyn std::error::Error + Send + Sync>> {
        Some(format!("the motor is off at {time} s").into())
    }
}

#[test]
fn a_pattern_fails_with_its_own_error() {
    let legs = vec![leg([0.0; 3], 0.0, |leg| leg.scanner.max_duration = Some(2.0))];
    let survey = survey(PlatformKind::Static, Mount::IDENTITY, Deflector::Custom(Arc::new(Broken)), legs);
    let plan = plan_with(&survey, options());
    let error = FlightState::start(&plan).step(&plan, &mut Count::default()).unwrap_err();
    assert!(error.to_string().starts_with("the motor is off at") && error.exit_status() == 1, "{error}");
}

/// A table of these beams, in degrees, in legs of two seconds at 100 Hz.
fn table_survey(beams: &[(u32, f64, f64)], steps: u32, repeats: bool) -> Survey {
    let beam = |(step, azimuth, elevation): &(u32, f64, f64)| PatternBeam {
        step: *step,
        azimuth: azimuth.to_radians(),
        elevation: elevation.to_radians(),
        origin: DVec3::new(0.0, 0.0, 0.1 * f64::from(*step)),
    };
    let beams: Vec<PatternBeam> = beams.iter().map(beam).collect();
    let legs = [0.0, 5.0].map(|x| leg([x, 0.0, 0.0], 0.0, |leg| leg.scanner.max_duration = Some(2.0)));
    let table = Arc::new(PatternTable::new(&beams, steps, repeats));
    survey(PlatformKind::Static, Mount::IDENTITY, Deflector::Pattern(table), legs.into())
}

#[test]
fn pulses_take_the_rows_of_a_table_from_the_first_one_in_each_leg() {
    let rows = [(0, 0.0, 0.0), (1, 90.0, 10.0), (2, -179.9, -89.0), (3, 359.0, 45.0), (4, 180.0, 0.0)];
    for kinematics in [Corrections::NONE, Corrections::MOTION] {
        let survey = table_survey(&rows, 5, true);
        let flown = fly_plan(&plan_with(&survey, FlightOptions { kinematics, ..options() }));
        for (leg, x) in flown[..2].iter().zip([0.0, 5.0]) {
            assert!((199..=202).contains(&leg.pulses.len()), "{}", leg.pulses.len());
            for (i, pulse) in leg.pulses.iter().enumerate() {
                let (step, azimuth, elevation) = rows[i % 5];
                let (sin, cos) = f64::to_radians(azimuth).sin_cos();
                let (up, level) = f64::to_radians(elevation).sin_cos();
                let off = pulse.attitude.forward() - DVec3::new(level * sin, level * cos, up);
                assert!(off.length() < 1e-12, "pulse {i}: {}", off.length());
                let origin = DVec3::new(x, 0.0, 0.1 * f64::from(step));
                assert!((pulse.origin - origin).length() < 1e-12, "pulse {i} leaves from {}", pulse.origin);
            }
        }
    }
}

#[test]
fn a_table_that_does_not_repeat_leaves_the_rest_of_a_leg_without_pulses() {
    let rows = [(0, 0.0, 0.0), (2, 90.0, 10.0), (3, 10.0, -10.0)];
    let pulses: Vec<usize> = fly(&table_survey(&rows, 5, false)).iter().map(|leg| leg.pulses.len()).collect();
    assert_eq!(pulses[..2], [3, 3]);
    let repeated: usize = fly(&table_survey(&rows, 5, true)).iter().map(|leg| leg.pulses.len()).sum();
    assert!((238..=244).contains(&repeated), "{repeated}");
}

#[test]
fn a_table_with_times_fires_at_them() {
    let mut survey = table_survey(&[(0, 0.0, 0.0), (1, 45.0, 0.0), (2, 90.0, 0.0)], 3, true);
    let times = PulseTimes::of_intervals(&[0.25, 0.5, 0.0625]);
    for leg in &mut survey.legs {
        leg.scanner.pulse_freq = times.mean_rate().round() as u32;
        leg.scanner.pulse_times = Some(times.clone());
    }
    let flown = fly(&survey);
    for (i, pulse) in flown[0].pulses.iter().enumerate() {
        let (sin, cos) = f64::to_radians([0.0, 45.0, 90.0][i % 3]).sin_cos();
        assert!((pulse.attitude.forward() - DVec3::new(sin, cos, 0.0)).length() < 1e-12);
        assert!((seconds(pulse) - times.at(i as u64)).abs() < 1e-6, "pulse {i} at {}", seconds(pulse));
    }
    assert!(flown[0].pulses.len() > 6);
}
