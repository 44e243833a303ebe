//! Pulses at times of their own.

use crate::flight::testing::*;
use crate::flight::{FlightOptions, FlightState, Pulse, Step};
use crate::platform::Pose;
use std::f64::consts::TAU;
use vlscan_base::corrections::Corrections;
use vlscan_geom::{DVec3, Rotation, radians};
use vlscan_survey::*;

const INTERVALS: [f64; 4] = [0.0054, 0.0066, 0.0084, 0.0196];

/// An active leg with these pulse times and a conic scanner of 7 turns a second.
fn timed_leg(position: [f64; 3], speed: f64, times: PulseTimes) -> Leg {
    leg(position, speed, |l| {
        (l.scanner.scan_freq, l.scanner.scan_angle) = (7.0, radians(20.0));
        l.scanner.pulse_freq = times.mean_rate().round() as u32;
        l.scanner.pulse_times = Some(times);
    })
}

fn recorded_times() -> PulseTimes {
    PulseTimes::Recorded([0.25, 0.2500005, 0.3, 0.9, 0.90001, 1.5, 7.0].into())
}

fn fly_timed(s: &Survey, kinematics: Corrections) -> Vec<Vec<Pulse>> {
    let options = FlightOptions { kinematics, ..options() };
    fly_plan(&plan_with(s, options)).into_iter().map(|leg| leg.pulses).collect()
}

/// Asserts that a conic scanner on a head that turns by `rate` degrees per second fired at these times of a
/// leg that began at `start` seconds.
fn assert_times(pulses: &[Pulse], start: f64, times: &[f64], rate: f64, place: impl Fn(f64) -> DVec3) {
    assert_eq!(pulses.len(), times.len());
    for (pulse, time) in pulses.iter().zip(times) {
        assert!((seconds(pulse) - start - time).abs() < 1e-9, "{} is not {time}", seconds(pulse) - start);
        assert!((pulse.origin - place(*time)).length() < 1e-9, "{} at {time}", pulse.origin);
        let head = Rotation::about_z(radians(rate) * time);
        let beam = head.after(Rotation::about_y(TAU * 7.0 * time)).after(Rotation::about_x(radians(20.0)));
        assert!((pulse.attitude.forward() - beam.forward()).length() < 1e-9, "at {time}");
    }
}

#[test]
fn pulses_of_a_flight_leave_at_their_times_from_where_it_is() {
    let points = [[0.0, 0.0, 5.0], [0.0, 10.0, 5.0], [0.0, 20.0, 5.0]];
    let cycle = PulseTimes::of_intervals(&INTERVALS);
    let legs = [recorded_times(), cycle.clone(), cycle.clone()];
    let legs = points.iter().zip(legs).map(|(p, times)| timed_leg(*p, 5.0, times)).collect();
    let mut s = survey(PlatformKind::LinearPath, Mount::IDENTITY, Deflector::Conic, legs);
    s.legs[2].scanner.active = false;
    let flown = fly_timed(&s, Corrections::MOTION);
    // Two seconds to the next waypoint: the time at 7 s is never reached.
    let times = [0.25, 0.2500005, 0.3, 0.9, 0.90001, 1.5];
    assert_times(&flown[0], 0.0, &times, 0.0, |t| DVec3::new(0.0, 5.0 * t, 5.0));
    // The leg begins a mean period after the last step, and the platform where it is then; the deflector goes
    // on.
    let begin = seconds(&flown[1][0]);
    assert!((begin - 1.5 - 1.0 / recorded_times().mean_rate()).abs() < 1e-9, "{begin}");
    let expected = (4.0 - begin) * cycle.mean_rate();
    assert!((flown[1].len() as f64 - expected).abs() < 3.0, "{} is not {expected}", flown[1].len());
    assert!((flown[1][0].origin.y - 5.0 * begin).abs() < 1e-9, "{}", flown[1][0].origin.y);
    for (k, pulse) in flown[1].iter().enumerate() {
        assert!((seconds(pulse) - begin - cycle.at(k as u64)).abs() < 1e-9);
        let ahead = flown[1][0].origin.y + 5.0 * cycle.at(k as u64);
        assert!((pulse.origin.y - ahead).abs() < 1e-9, "{} is not {ahead}", pulse.origin.y);
    }
    // The clock of the reference, too.
    let helios = fly_timed(&s, Corrections::NONE);
    assert!(helios[0].iter().zip(times).all(|(pulse, time)| (seconds(pulse) - time).abs() < 1e-9));
}

#[test]
fn pulses_of_a_tripod_and_its_head() {
    let cycle = PulseTimes::of_intervals(&INTERVALS);
    let mut leg = timed_leg([1.0, 2.0, 3.0], 0.0, cycle.clone());
    turn_head(&mut leg, 90.0, 45.0);
    let mut s = survey(PlatformKind::Static, Mount::IDENTITY, Deflector::Conic, vec![leg]);
    // Until the head has turned through 45 degrees, at 0.5 s.
    let times: Vec<f64> = (0..51).map(|k| cycle.at(k)).collect();
    let flown = fly_timed(&s, Corrections::MOTION).remove(0);
    assert_times(&flown, 0.0, &times, 90.0, |_| DVec3::new(1.0, 2.0, 3.0));
    // A longest duration counts from the start of the leg.
    s.legs[0].scanner.pulse_times = Some(recorded_times());
    (s.legs[0].scanner.head_rate, s.legs[0].scanner.max_duration) = (0.0, Some(1.2));
    let flown = fly_timed(&s, Corrections::MOTION).remove(0);
    assert_times(&flown, 0.0, &[0.25, 0.2500005, 0.3, 0.9, 0.90001], 0.0, |_| DVec3::new(1.0, 2.0, 3.0));
    // After the last time nothing fires.
    s.legs[0].scanner.max_duration = Some(30.0);
    assert_eq!(fly_timed(&s, Corrections::MOTION)[0].len(), 7);
}

#[test]
fn pulses_along_recorded_and_streamed_poses() {
    let mut leg = recorded_leg(100.5, 104.0, false);
    leg.scanner.pulse_times = Some(recorded_times());
    let (s, _folder) = recorded(0.0, true, vec![leg]);
    let pulses = fly_timed(&s, Corrections::MOTION).concat();
    assert_eq!(pulses.len(), 6);
    for (pulse, time) in pulses.iter().zip([0.25, 0.2500005, 0.3, 0.9, 0.90001, 1.5]) {
        assert!((pulse.time_ns - (100.5 + time) * 1e9).abs() < 1.0);
        assert!((pulse.origin.x - 5.0 - 10.0 * time).abs() < 1e-9, "{}", pulse.origin.x);
    }
    // No pose for a second: pulses are lost there, and the others stay at their times.
    let kind = PlatformKind::Stream(PoseStream { max_gap: 0.5, ..PoseStream::at("-") });
    let streamed =
        survey(kind, Mount::IDENTITY, Deflector::Conic, vec![timed_leg([0.0; 3], 0.0, recorded_times())]);
    let plan = plan_with(&streamed, FlightOptions { kinematics: Corrections::MOTION, ..options() });
    let poses: Vec<Pose> = [0.0, 0.2, 0.5, 1.4, 1.6, 2.0]
        .map(|t| Pose { time: 1000.0 + t, position: DVec3::X * (3.0 * t), attitude: Rotation::IDENTITY })
        .to_vec();
    for block in [1, 6] {
        let (mut state, mut keep) = (FlightState::start(&plan), Keep::default());
        for block in poses.chunks(block) {
            state.feed(&plan, block.to_vec());
            while state.step(&plan, &mut keep).unwrap() == Step::Advanced {}
        }
        let times = [0.25, 0.2500005, 0.3, 1.5];
        assert_times(&keep.pulses, 1000.0 - START_NS * 1e-9, &times, 0.0, |t| DVec3::X * (3.0 * t));
    }
}

#[test]
fn channels_fire_after_each_time() {
    let cycle = PulseTimes::of_intervals(&INTERVALS);
    let mut leg = timed_leg([0.0; 3], 0.0, cycle.clone());
    leg.scanner.max_duration = Some(1.0);
    let mut s = survey(PlatformKind::Static, Mount::IDENTITY, Deflector::Conic, vec![leg]);
    let late = Device { firing_offset: 0.002, ..s.scanner.devices[0].clone() };
    s.scanner.devices.push(late);
    let pulses = fly_timed(&s, Corrections::MOTION).remove(0);
    let of = |device: u32| pulses.iter().filter(|p| p.device == device).copied().collect::<Vec<Pulse>>();
    let times: Vec<f64> = (0..100).map(|k| cycle.at(k)).collect();
    let later: Vec<f64> = times.iter().map(|time| time + 0.002).collect();
    assert_times(&of(0)[..100], 0.0, &times, 0.0, |_| DVec3::ZERO);
    assert_times(&of(1)[..100], 0.0, &later, 0.0, |_| DVec3::ZERO);
    // An offset beyond the shortest interval is not possible.
    s.scanner.devices[1].firing_offset = 0.006;
    let options = FlightOptions { kinematics: Corrections::MOTION, ..options() };
    let (_, warnings) = crate::flight::FlightPlan::new(&s, DVec3::ZERO, &|_, _| None, &options).unwrap();
    assert!(warnings.text().contains("all channels fire at once"));
}

#[test]
fn what_cannot_have_pulse_times_says_so() {
    let of = |kind: PlatformKind| {
        let legs = [[0.0; 3], [0.0, 10.0, 0.0]].map(|p| timed_leg(p, 5.0, recorded_times()));
        survey(kind, Mount::IDENTITY, Deflector::Conic, legs.to_vec())
    };
    for kind in [PlatformKind::GroundVehicle { drag: 0.005 }, PlatformKind::Multicopter(MULTICOPTER)] {
        let report = refusal(&of(kind));
        assert!(report.contains("steps of a constant pulse rate"), "{report}");
    }
    let warnings = plan_of(&of(PlatformKind::LinearPath)).unwrap().1.text();
    assert!(warnings.contains("it ends after 2 s, before the last 1 of its 7 pulse times"), "{warnings}");
}
