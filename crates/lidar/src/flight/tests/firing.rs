//! Channels that fire one after the other within a pulse period.

use crate::flight::testing::*;
use crate::flight::{FlightOptions, FlightState, Pulse};
use crate::platform::Pose;
use vlscan_base::corrections::Corrections;
use vlscan_geom::{DVec3, degrees, radians};
use vlscan_survey::*;

fn options(kinematics: Corrections) -> FlightOptions {
    FlightOptions { gps_start_ns: 1000e9, kinematics, ..FlightOptions::default() }
}

/// All pulses with the corrected kinematics.
fn corrected(survey: &Survey) -> Vec<Pulse> {
    fly_plan(&plan_with(survey, options(Corrections::MOTION))).into_iter().flat_map(|l| l.pulses).collect()
}

/// `survey` with copies of its device that fire `offsets` seconds after the start of the period.
fn in_turn(mut survey: Survey, offsets: &[f64]) -> Survey {
    let device = survey.scanner.devices.remove(0);
    let channel = |&firing_offset: &f64| Device { firing_offset, ..device.clone() };
    survey.scanner.devices = offsets.iter().map(channel).collect();
    survey
}

/// A device in flight that turns its head, at `frequency` Hz.
fn moving(deflector: Deflector, frequency: u32) -> Survey {
    let scan = |l: &mut Leg| {
        l.scanner.pulse_freq = frequency;
        (l.scanner.scan_freq, l.scanner.scan_angle) = (0.5, radians(20.0));
        turn_head(l, 90.0, 45.0);
    };
    let legs = [[0.0; 3], [300.0, 0.0, 0.0]].map(|p| leg(p, 30.0, scan)).to_vec();
    let mut s = survey(PlatformKind::LinearPath, mount([0.0, 0.5, -1.0]), deflector, legs);
    s.scanner.devices[0].head.max_rate = 10.0;
    s.scanner.devices[0].scan_freq = (0.0, 10.0);
    s.legs[1].scanner.active = false;
    s
}

#[test]
fn four_channels_in_turn_draw_the_pattern_of_one_at_four_times_the_rate() {
    let prism = |rotor_freq| Prism { rotor_freq, angle: radians(18.0), index: 1.51 };
    let risley = || Deflector::Risley { prisms: vec![prism(3.0), prism(-2.0)], air: 1.0, incident: DVec3::Y };
    for deflector in [polygon(), Deflector::Conic, risley()] {
        let is_prism = matches!(deflector, Deflector::Risley { .. });
        let flown = |rate| {
            let mut survey = moving(deflector.clone(), rate);
            // A head is on time where prisms are a step ahead.
            for leg in survey.legs.iter_mut().filter(|_| is_prism) {
                (leg.scanner.head_rate, leg.scanner.head_stop) = (0.0, leg.scanner.head_start);
            }
            survey
        };
        let fast = corrected(&flown(400));
        let quarters = [0.0, 0.0025, 0.005, 0.0075];
        let four = corrected(&in_turn(flown(100), &quarters));
        assert!(four.len() > 500, "{deflector:?}: {}", four.len());
        // Prisms are at their phase a step before the first pulse, which is four steps at the higher rate.
        let later = if is_prism { 7.5e6 } else { 0.0 };
        let mut compared = 0;
        for pulse in &four {
            let k = ((pulse.time_ns - 1000e9) / 2.5e6).round();
            let Some(here) = fast.iter().find(|p| (p.time_ns - pulse.time_ns).abs() < 1.0) else { continue };
            let Some(turned) = fast.iter().find(|p| (p.time_ns - pulse.time_ns - later).abs() < 1.0) else {
                continue;
            };
            compared += 1;
            assert!((here.origin - pulse.origin).length() < 1e-9, "{deflector:?}, {k}: {}", pulse.origin);
            let off = (turned.attitude.forward() - pulse.attitude.forward()).length();
            assert!(off < 1e-9, "{deflector:?}, {k}: off by {off}");
            assert!((turned.scan_angle - pulse.scan_angle).abs() < 1e-9, "{deflector:?}, {k}");
        }
        assert!(compared > 500, "{deflector:?}: {compared}");
    }
}

#[test]
fn a_turning_head_smears_the_channels() {
    let offsets: Vec<f64> = (0..16).map(|i| 2.304e-6 * f64::from(i)).collect();
    let scan = |l: &mut Leg| {
        l.scanner.pulse_freq = 18_000;
        turn_head(l, 3600.0, 720.0);
    };
    let still =
        survey(PlatformKind::Static, Mount::IDENTITY, straight(), vec![leg([1.0, 2.0, 3.0], 0.0, scan)]);
    let pulses = corrected(&in_turn(still.clone(), &offsets));
    for cycle in pulses.chunks(16).take(500) {
        let azimuth = |p: &Pulse| degrees(libm::atan2(-p.attitude.forward().x, p.attitude.forward().y));
        for (pulse, offset) in cycle.iter().zip(&offsets) {
            let turned = (azimuth(pulse) - azimuth(&cycle[0])).rem_euclid(360.0);
            assert!((turned - 3600.0 * offset).abs() < 1e-9, "{turned}");
            assert!((pulse.time_ns - cycle[0].time_ns - offset * 1e9).abs() < 1e-3);
            assert_eq!((pulse.origin, pulse.number), (cycle[0].origin, cycle[0].number));
        }
    }
    // The reference fires all at once.
    let at_once = in_turn(still, &[0.0; 16]);
    let helios = |s: &Survey| fly_plan(&plan_with(s, options(Corrections::NONE))).remove(0).pulses;
    assert_eq!(helios(&in_turn(at_once.clone(), &offsets)), helios(&at_once));
}

#[test]
fn an_oscillating_mirror_swings_on() {
    let deflector = Deflector::Oscillating { scan_product: 1e6 };
    let pulses = corrected(&in_turn(moving(deflector, 100), &[0.0, 0.005]));
    for pair in pulses.windows(3).step_by(2) {
        let mean = 0.5 * (pair[0].scan_angle + pair[2].scan_angle);
        assert!((pair[1].scan_angle - mean).abs() < 1e-12);
    }
}

#[test]
fn recorded_poses_go_on_past_a_row() {
    // Rows at 100, 101, 102 s; 10 m and 20° per second after 101 s, 10 m and 10° before.
    let (s, _dir) = recorded(0.0, true, vec![recorded_leg(100.5, 101.5, false)]);
    let pulses = corrected(&in_turn(s, &[0.0, 0.07]));
    assert_eq!(pulses.len(), 20);
    for pulse in &pulses {
        let time = pulse.time_ns * 1e-9;
        assert!((pulse.origin.x - 10.0 * (time - 100.0)).abs() < 1e-9, "{} at {time}", pulse.origin);
        let yaw = if time < 101.0 { 10.0 * (time - 100.0) } else { 10.0 + 20.0 * (time - 101.0) };
        let beam = pulse.attitude.forward();
        assert!((degrees(libm::atan2(beam.x, beam.y)) - yaw).abs() < 1e-9, "at {time}");
    }
}

#[test]
fn streamed_poses_go_on_whatever_their_blocks() {
    let poses: Vec<Pose> = (0..30)
        .map(|i| {
            let time = 0.13 * f64::from(i);
            let attitude = vlscan_geom::Rotation::about_z(0.3 * time);
            Pose { time: 1000.0 + time, position: DVec3::new(5.0 * time, 0.0, 0.0), attitude }
        })
        .collect();
    let stream = survey(
        PlatformKind::Stream(PoseStream::at("-")),
        Mount::IDENTITY,
        straight(),
        vec![leg([0.0; 3], 0.0, |l| l.scanner.pulse_freq = 10)],
    );
    let plan = plan_with(&in_turn(stream, &[0.0, 0.09]), options(Corrections::MOTION));
    let fly = |block: usize| {
        let (mut state, mut keep) = (FlightState::start(&plan), Keep::default());
        for block in poses.chunks(block) {
            state.feed(&plan, block.to_vec());
            while state.step(&plan, &mut keep).unwrap() == crate::flight::Step::Advanced {}
        }
        keep.pulses
    };
    let all = fly(30);
    assert_eq!(all.len(), 76);
    for pulse in &all[2..] {
        let time = pulse.time_ns * 1e-9 - 1000.0;
        assert!((pulse.origin.x - 5.0 * time).abs() < 1e-9, "{} at {time}", pulse.origin);
        let beam = pulse.attitude.forward();
        assert!((libm::atan2(-beam.x, beam.y) - 0.3 * time).abs() < 1e-9, "at {time}");
    }
    for block in [1, 2, 7] {
        assert!(fly(block) == all, "blocks of {block}");
    }
}

#[test]
fn stamps_stay_within_the_week() {
    let l = leg([0.0; 3], 0.0, |l| l.scanner.max_duration = Some(0.015));
    let s = in_turn(survey(PlatformKind::Static, Mount::IDENTITY, straight(), vec![l]), &[0.0, 0.004]);
    let options = FlightOptions { gps_start_ns: 604_799.998e9, ..options(Corrections::MOTION) };
    let stamps: Vec<f64> = fly_plan(&plan_with(&s, options))[0].pulses.iter().map(|p| p.time_ns).collect();
    for (stamp, expected) in stamps.iter().zip([604_799.998e9, 0.002e9, 0.008e9, 0.012e9]) {
        assert!((stamp - expected).abs() < 1.0, "{stamps:?}");
    }
}

#[test]
fn all_channels_fire_at_once_where_the_period_is_too_short() {
    let still = |frequency| {
        let l = leg([0.0; 3], 0.0, |l| {
            l.scanner.pulse_freq = frequency;
            l.scanner.max_duration = Some(0.05);
        });
        in_turn(survey(PlatformKind::Static, Mount::IDENTITY, straight(), vec![l]), &[0.0, 0.002])
    };
    let plan = |frequency| {
        let options = options(Corrections::MOTION);
        crate::flight::FlightPlan::new(&still(frequency), DVec3::ZERO, &|_, _| None, &options).unwrap()
    };
    for (frequency, apart_ns) in [(499, 2e6), (500, 0.0), (10_000, 0.0)] {
        let (plan, warnings) = plan(frequency);
        let pulses = fly_plan(&plan).remove(0).pulses;
        assert!((pulses[1].time_ns - pulses[0].time_ns - apart_ns).abs() < 1e-3, "{frequency}");
        let is_reported = warnings.text().contains("leg 0: all channels fire at once");
        assert_eq!(is_reported, apart_ns == 0.0, "{frequency}");
    }
}
