//! Laws of sweeps.

use super::super::beams::tests::pulse;
use super::*;
use vlscan_lidar::flight::FlightOptions;
use vlscan_lidar::pulse::PulseRecord;
use vlscan_survey::{Deflector, PlatformKind, testkit};

/// A measured beam from the origin, which meets a surface at right angles.
fn node(number: u64, place: DVec3) -> Node {
    let pulse = pulse(number, Rotation::between(DVec3::Y, place));
    Node { pulse, echoes: vec![echo(&pulse, place)] }
}

fn echo(pulse: &Pulse, position: DVec3) -> Echo {
    let record = PulseRecord {
        origin: pulse.origin,
        direction: pulse.attitude.forward(),
        time_ns: pulse.time_ns,
        number: pulse.number,
        device: pulse.device,
        scan_angle: 0.0,
    };
    let first = Echo { return_number: 1, number_of_returns: 1, part: 0, ..Echo::miss(&record) };
    Echo { position, incidence_cosine: 1.0, ..first }
}

#[test]
fn sweeps_stand_for_all_pulses_with_their_directions() {
    let mut survey = testkit::survey(vec![testkit::device()]);
    survey.platform.kind = PlatformKind::LinearPath;
    // Lines of 100 pulses, 0.02 rad from each other.
    let mirror = Deflector::Polygon { effective_max: 1.0, facet_tilts: Vec::new() };
    survey.scanner.devices[0].deflector = mirror;
    survey.legs = (0..2).map(|i| testkit::leg(i, testkit::scanner_settings(1000))).collect();
    for (leg, x) in survey.legs.iter_mut().zip([0.0, 100.0]) {
        leg.platform.position.x = x;
        leg.platform.speed = 10.0;
        (leg.scanner.scan_freq, leg.scanner.scan_angle) = (10.0, 1.0);
    }
    let plan = FlightPlan::new(&survey, DVec3::ZERO, &|_, _| None, &FlightOptions::default());
    let (flight, _) = plan.unwrap();
    let (chunk, _) = Chunk::take_steps(&flight, &mut FlightState::start(&flight), None, 500).unwrap();
    let mut all = Pulses { pulses: Vec::new(), has_velocities: false };
    let mut state = chunk.start.clone();
    for _ in 0..chunk.steps {
        state.step(&flight, &mut all).unwrap();
    }
    for (every, phase) in [(4, 1), (5, 0), (7, 3)] {
        let sweeps = take(&flight, &chunk, (every, phase), false).unwrap().unwrap();
        let mut expected = all.pulses.iter();
        for (sweep, i) in sweeps.iter().flat_map(|sweep| (0..sweep.nodes.len()).map(move |i| (sweep, i))) {
            for swing in sweep.swings(i) {
                let pulse = expected.next().unwrap();
                let off = sweep.nodes[i].beam().direction + swing - pulse.attitude.forward();
                assert!(off.length() < 0.02, "pulse {}, one in {every}: {off}", pulse.number);
            }
        }
        assert!(expected.next().is_none(), "one in {every}");
    }
    // Steps without pulses of their own.
    assert!(take(&flight, &chunk, (1000, 999), false).unwrap().is_none());
}

#[test]
fn pulses_lie_evenly_on_a_surface_between_two_beams() {
    // A wall 10 m away, along which pulses are 0.5 m from each other.
    let nodes = vec![node(10, DVec3::new(0.0, 10.0, 0.0)), node(20, DVec3::new(5.0, 10.0, 0.0))];
    let sweep = Sweep { nodes, first: 8, last: 23 };
    let steps = |from: i32, to: i32| (from..=to).map(|n| [0.5 * f64::from(n), 0.0]).collect::<Vec<_>>();
    assert_eq!((sweep.offsets(0), sweep.offsets(1)), (steps(-2, 5), steps(-4, 3)));
    assert!(gaps(&[sweep], 9).is_empty());
}

#[test]
fn the_beam_between_two_surfaces_is_measured() {
    // A wall 10 m away, which ends, and another one 40 m away.
    let near = |x: f64| DVec3::new(x, 10.0, 0.0);
    let nodes = vec![node(10, near(0.0)), node(14, near(0.4)), node(20, DVec3::new(4.0, 40.0, 0.0))];
    let mut sweeps = [Sweep { nodes, first: 10, last: 20 }];
    // The pulses behind number 14 are on the first wall, the ones before number 20 on a level plane.
    let before = sweeps[0].offsets(1);
    assert_eq!(before.len(), 5);
    assert!((before[4][0] - 0.3).abs() < 1e-9 && before[4][1].abs() < 1e-9, "{before:?}");
    let found = gaps(&sweeps, 9);
    assert_eq!(found.len(), 1);
    let pulse = found[0].pulse;
    assert_eq!(pulse.number, 17);
    let expected = 0.5 * (libm::atan(0.04) + libm::atan(0.1));
    assert!((libm::atan2(pulse.attitude.forward().x, pulse.attitude.forward().y) - expected).abs() < 1e-3);
    let place = near(0.7);
    fill(&mut sweeps, found, &[echo(&pulse, place)]);
    let numbers: Vec<u64> = sweeps[0].nodes.iter().map(|node| node.pulse.number).collect();
    assert_eq!(numbers, [10, 14, 17, 20]);
    // The next gap is narrower, and none is looked into without a budget.
    let next: Vec<u64> = gaps(&sweeps, 9).iter().map(|gap| gap.pulse.number).collect();
    assert_eq!((next, gaps(&sweeps, 0).len()), (vec![18], 0));
    // All pulses have one place each.
    let pulses: usize = (0..4).map(|i| sweeps[0].offsets(i).len()).sum();
    assert_eq!(pulses, 11);
}
