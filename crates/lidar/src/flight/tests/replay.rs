//! Flights replayed in chunks, repeated, and along streams of poses.

use crate::flight::clock::WEEK_NS;
use crate::flight::testing::*;
use crate::flight::{FlightOptions, FlightPlan, FlightState, PoseSample, Pulse, Step};
use crate::platform::Pose;
use crate::scanner::DeviceState;
use vlscan_geom::{DVec3, Rotation, radians};
use vlscan_survey::{
    Deflector, Leg, Mount, Noise, NoiseKind, PlatformKind, PoseStream, ScanMotion, Survey, Swing, Wander,
};

fn busy_survey() -> Survey {
    let scan = |l: &mut Leg| {
        (l.scanner.scan_freq, l.scanner.scan_angle) = (10.0, radians(120.0));
        l.scanner.trajectory_interval = 0.03;
        l.scanner.warmup = 0.02;
        turn_head(l, 36.0, 5.0);
    };
    let legs = [[0.0, 0.0, 10.0], [7.0, 3.0, 10.0], [9.0, -8.0, 12.0]].map(|p| leg(p, 10.0, scan)).to_vec();
    let mut s = survey(PlatformKind::LinearPath, mount([0.0, 0.1, 0.2]), polygon(), legs);
    s.platform.noise.position[2] =
        Some(Noise { kind: NoiseKind::Normal { mean: 0.0, stdev: 0.1 }, clip: None, lifespan: 3 });
    let mut second = s.scanner.devices[0].clone();
    second.deflector = Deflector::Oscillating { scan_product: 1e6 };
    s.scanner.devices.push(second);
    s
}

/// Produces chunks of up to `size` pulses, cut at legs as well, and replays each from its snapshot.
fn in_chunks(plan: &FlightPlan, size: u64) -> Keep {
    let mut state = FlightState::start(plan);
    let mut all = Keep::default();
    let mut ended = false;
    while !ended {
        let snapshot = state.clone();
        let (mut count, mut steps) = (Count::default(), 0);
        loop {
            steps += 1;
            let step = state.step(plan, &mut count).unwrap();
            ended = step == Step::Ended;
            if step != Step::Advanced || count.pulses >= size {
                break;
            }
        }
        let mut worker = snapshot;
        let mut keep = Keep::default();
        (0..steps).for_each(|_| _ = worker.step(plan, &mut keep).unwrap());
        assert_eq!((keep.pulses.len() as u64, keep.poses.len() as u64), (count.pulses, count.poses));
        all.pulses.extend(keep.pulses);
        all.poses.extend(keep.poses);
    }
    all
}

#[test]
fn replayed_chunks_equal_the_flight() {
    let mut wandering = busy_survey();
    for device in &mut wandering.scanner.devices {
        let wander = Some(Wander::Sine { amplitude: 0.5, freq: 0.7, phase: 0.0 });
        let (axis_tilt, swing) = ([0.1, 0.2], Swing::default());
        device.scan_motion = ScanMotion { is_reversed: true, phase: 1.0, axis_tilt, wander, swing };
    }
    [busy_survey(), wandering].iter().for_each(replay_in_chunks);
}

fn replay_in_chunks(s: &Survey) {
    let (plan, _) = plan_of(s).unwrap();
    let whole = fly(s);
    let pulses: Vec<Pulse> = whole.iter().flat_map(|l| l.pulses.clone()).collect();
    let poses: Vec<PoseSample> = whole.iter().flat_map(|l| l.poses.clone()).collect();
    assert!(pulses.len() > 100 && poses.len() > 50);
    for size in [1, 7, 64, 10_000] {
        let chunked = in_chunks(&plan, size);
        assert!(chunked.pulses == pulses && chunked.poses == poses, "chunks of {size}");
    }
}

#[test]
fn snapshots_are_small() {
    assert!(size_of::<FlightState>() <= 512, "{}", size_of::<FlightState>());
    assert!(size_of::<DeviceState>() <= 288, "{}", size_of::<DeviceState>());
}

#[test]
fn a_repetition_flies_the_same_path_later() {
    let mut s = busy_survey();
    s.platform.noise = Default::default();
    let (plan, _) = plan_of(&s).unwrap();
    let mut state = FlightState::start(&plan);
    let first = fly_on(&plan, &mut state);
    assert_eq!(state.step(&plan, &mut Count::default()).unwrap(), Step::Ended);
    let (time, numbers) = (state.time_ns(), first.iter().map(|l| l.pulses.len()).sum::<usize>());
    state.repeat(&plan);
    assert_eq!((state.steps(), state.leg_index()), (0, 0));
    let second = fly_on(&plan, &mut state);
    let polygons = |legs: &[FlownLeg]| *legs[0].pulses.iter().find(|p| p.device == 0).unwrap();
    let (a, b) = (polygons(&first), polygons(&second));
    assert_eq!(a.origin, b.origin);
    assert!((a.attitude.forward() - b.attitude.forward()).length() < 1e-6);
    assert_eq!(b.time_ns - time, a.time_ns - START_NS);
    let twice: usize = second.iter().map(|l| l.pulses.len()).sum();
    let device_0 = second.iter().flat_map(|l| &l.pulses).rfind(|p| p.device == 0).unwrap();
    assert!(device_0.number as usize > numbers / 4 && twice == numbers);
}

#[test]
fn progress_grows_to_one() {
    let (plan, _) = plan_of(&busy_survey()).unwrap();
    let mut state = FlightState::start(&plan);
    let (mut last, mut number) = (0.0, 0);
    loop {
        match state.step(&plan, &mut Count::default()).unwrap() {
            Step::Ended => break,
            Step::LegChanged => {
                assert!(last > 0.9, "leg {number} ended at {last}");
                (last, number) = (0.0, number + 1);
            }
            _ => {
                let now = state.progress(&plan);
                assert!((0.0..=1.0).contains(&now));
                last = now;
            }
        }
    }
    assert_eq!(state.progress(&plan), 1.0);
    let turn = leg([0.0; 3], 0.0, |l| turn_head(l, 36.0, 9.0));
    let (plan, _) = plan_of(&survey(PlatformKind::Static, Mount::IDENTITY, straight(), vec![turn])).unwrap();
    let mut state = FlightState::start(&plan);
    (0..5).for_each(|_| _ = state.step(&plan, &mut Count::default()));
    assert!((state.progress(&plan) - 0.2).abs() < 1e-9);
}

#[test]
fn durations_span_the_end_of_the_week() {
    let legs = vec![leg([0.0; 3], 0.0, |l| {
        l.scanner.max_duration = Some(3.0);
        l.scanner.trajectory_interval = 1.0;
    })];
    let s = survey(PlatformKind::Static, Mount::IDENTITY, straight(), legs);
    let options = FlightOptions { gps_start_ns: WEEK_NS - 1e9, ..Default::default() };
    let flown = fly_plan(&plan_with(&s, options));
    assert_eq!((flown[0].steps, flown[0].poses.len()), (300, 3));
    assert!(flown[0].pulses.iter().all(|p| (0.0..=WEEK_NS).contains(&p.time_ns)));
}

fn stream_survey(change: impl FnOnce(&mut Leg)) -> Survey {
    let kind = PlatformKind::Stream(PoseStream::at("-"));
    survey(kind, Mount::IDENTITY, polygon(), vec![leg([0.0; 3], 0.0, change)])
}

fn scanning(l: &mut Leg) {
    (l.scanner.scan_freq, l.scanner.scan_angle) = (10.0, radians(120.0));
    l.scanner.trajectory_interval = 0.1;
}

/// Flies along `poses`, which arrive in blocks of `cut`.
fn fly_stream(s: &Survey, poses: &[Pose], cut: usize) -> Keep {
    let (plan, _) = plan_of(s).unwrap();
    let (mut state, mut blocks, mut keep) = (FlightState::start(&plan), poses.chunks(cut), Keep::default());
    loop {
        let before = format!("{state:?}");
        match state.step(&plan, &mut keep).unwrap() {
            Step::NeedsPoses => {
                assert_eq!(before, format!("{state:?}"), "a step without poses changes nothing");
                match blocks.next() {
                    Some(block) => state.feed(&plan, block.to_vec()),
                    None => state.end_poses(),
                }
            }
            Step::Ended => return keep,
            _ => {}
        }
    }
}

fn poses() -> Vec<Pose> {
    let pose = |i: i32| Pose {
        time: 1000.0 + f64::from(i) * 0.03,
        position: DVec3::new(f64::from(i), 2.0, 3.0),
        attitude: Rotation::about_z(f64::from(i) * 0.1),
    };
    (0..60).map(pose).collect()
}

#[test]
fn a_flight_does_not_depend_on_the_blocks_in_which_poses_arrive() {
    let s = stream_survey(scanning);
    let whole = fly_stream(&s, &poses(), 1000);
    assert_eq!(whole.pulses[0].time_ns, 1000e9);
    // 59 intervals of 0.03 s at 100 Hz: 178 steps, 5 of the first 11 fire
    assert!(
        whole.pulses.len() > 70 && whole.poses.len() == 18,
        "{} {}",
        whole.pulses.len(),
        whole.poses.len()
    );
    let halfway = whole.poses[3];
    assert!((halfway.position.x - 10.0).abs() < 1e-9, "{}", halfway.position);
    for cut in [1, 2, 13] {
        let cut_up = fly_stream(&s, &poses(), cut);
        assert!(cut_up.pulses == whole.pulses && cut_up.poses == whole.poses, "blocks of {cut}");
    }
}

#[test]
fn a_stream_may_be_empty_or_longer_than_the_flight() {
    assert!(fly_stream(&stream_survey(scanning), &[], 1).pulses.is_empty());
    let short = stream_survey(|l| {
        scanning(l);
        l.scanner.max_duration = Some(0.5);
    });
    let kept = fly_stream(&short, &poses(), 7);
    assert_eq!(kept.poses.len(), 5);
}
