//! Flights that are flown by the model itself, over ground of known heights.

use super::choice::{Choice, misfit, trial};
use super::*;
use libm::{cos, sin};
use vlscan_geom::{DVec3, degrees, radians};

/// Pulses of a flight over rolling ground that fall into a square of 200 m; the mirror wanders by 2 mrad,
/// heights have noise of 2 cm and angles are rounded to 0.006°.
fn flown(model: &Model, interval: impl Fn(f64) -> f64, duration: f64) -> Vec<Pulse> {
    flown_by(model, 0, interval, duration)
}

/// Pulses of one of the channels.
fn flown_by(model: &Model, channel: usize, interval: impl Fn(f64) -> f64, duration: f64) -> Vec<Pulse> {
    flown_within(model, channel, interval, duration, 100.0)
}

/// Pulses of one of the channels that fall into a square with this half side, m.
fn flown_within(
    model: &Model,
    channel: usize,
    interval: impl Fn(f64) -> f64,
    duration: f64,
    reach: f64,
) -> Vec<Pulse> {
    let ground = |x: f64, y: f64| 3.0 * sin(x * 0.02) + 2.0 * cos(y * 0.03);
    let mut pulses = Vec::new();
    let (mut k, mut time) = (0, 0.0);
    while time < duration {
        k += 1;
        time += interval(time);
        let attitude = Attitude {
            roll: 1e-4 * sin(40.0 * time),
            pitch: 1e-4 * cos(31.0 * time),
            yaw: 2e-3 * sin(5.0 * time),
        };
        let mut height = 0.0;
        let mut at = model.footprint(&attitude, channel, time, height);
        if at.x.abs() > reach + 30.0 || at.y.abs() > reach + 30.0 {
            continue;
        }
        for _ in 0..6 {
            height = ground(at.x, at.y);
            at = model.footprint(&attitude, channel, time, height);
        }
        if at.x.abs() < reach && at.y.abs() < reach {
            let noise = 0.02 * noise(k);
            let angle = radians((degrees(at.angle) / 0.006).round() * 0.006);
            pulses.push(Pulse::on_ground(time, DVec3::new(at.x, at.y, height + noise), angle));
        }
    }
    pulses
}

/// Nearly normal deviates.
fn noise(k: u64) -> f64 {
    let mut sum = -6.0;
    for j in 0..12 {
        // A multiplicative hash as uniform numbers.
        let mixed = (k * 12 + j).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        sum +=
            ((mixed ^ (mixed >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 11) as f64 / (1u64 << 53) as f64;
    }
    sum
}

/// A flight with a mirror of this angle (rad) and rate.
fn model(mirror: Mirror, angle: f64, rate: f64) -> Model {
    let parameters = Parameters {
        position: DVec3::new(-40.0, 350.0, 1200.0),
        velocity: DVec3::new(60.0, 4.0, 0.0),
        mirror: MirrorParameters { angle, rate, ..MirrorParameters::default() },
        channels: vec![Channel { phase: 1.0, ..Channel::default() }],
        ..Parameters::default()
    };
    Model { mirror, parameters }
}

/// A model that is known, without attitudes.
fn known(model: &Model) -> Solution {
    Solution {
        model: model.clone(),
        deviations: model.parameters.filled(0.0),
        times: Vec::new(),
        attitudes: Vec::new(),
        residual: 0.0,
        angle_residual: 0.0,
    }
}

/// Checks the estimates of a flight, and that they predict the lines that were left out.
fn check(truth: &Model, rate: f64) -> Solution {
    let recording = Recording::new(flown(truth, |_| 1.0 / rate, 3.0)).unwrap();
    let mut fitted = recording.clone();
    // Blocks of lines, so that neither the repetition nor the motion is lost.
    fitted.lines =
        recording.lines.iter().enumerate().filter(|(k, _)| k % 3 != 1).map(|(_, l)| l.clone()).collect();
    let solution = best_solution(&fitted).unwrap();
    assert_eq!(solution.model.mirror, truth.mirror);
    let height = solution.model.parameters.position.z;
    assert!((height / 1200.0 - 1.0).abs() < 0.005, "height {height}");
    let frequency = solution.model.parameters.mirror.rate.abs();
    let expected = truth.parameters.mirror.rate.abs();
    assert!((frequency / expected - 1.0).abs() < 1e-4, "frequency {frequency}");
    let (mut squares, mut count) = (0.0, 0.0);
    for line in recording.lines.iter().enumerate().filter(|(k, _)| k % 3 == 1).map(|(_, line)| line.clone()) {
        for pulse in recording.pulses.range(line) {
            let at = solution.model.footprint(
                &solution.attitude(pulse.time),
                usize::from(pulse.channel),
                pulse.time,
                pulse.position.z,
            );
            squares += (at.x - pulse.position.x).powi(2) + (at.y - pulse.position.y).powi(2);
            count += 1.0;
        }
    }
    let error = f64::sqrt(squares / count);
    assert!(error < 0.06, "lines left out: {error} m");
    let rate_fitted = PulseRate::of(&recording, &solution);
    assert!((rate_fitted.mean / rate - 1.0).abs() < 1e-4 && rate_fitted.is_constant());
    let noise = ground::range_noise(&recording, &solution).unwrap().value;
    assert!((noise / 0.02 - 1.0).abs() < 0.2, "noise {noise}");
    solution
}

#[test]
fn a_cone_is_found_in_either_sense_from_a_part_of_its_circle() {
    for rate in [-140.0, 140.0] {
        let solution = check(&model(Mirror::Cone, radians(20.0), rate), 400_000.0);
        let half_angle = degrees(solution.model.parameters.mirror.angle);
        assert!((half_angle - 20.0).abs() < 0.1, "{half_angle}");
        assert_eq!(solution.model.parameters.mirror.rate.signum(), rate.signum());
    }
}

#[test]
fn lines_of_a_polygon_mirror_are_found() {
    let solution = check(&model(Mirror::Polygon, radians(58.0), 90.0), 200_000.0);
    assert!((degrees(solution.model.parameters.mirror.angle) - 58.0).abs() < 0.5);
}

/// The climb changes from −2.5 to 2.5 m/s.
#[test]
fn a_climb_that_changes_is_found() {
    let mut truth = model(Mirror::Polygon, radians(58.0), 60.0);
    let start = DVec3::new(-200.0, -13.0, 400.0);
    truth.parameters = Parameters { position: start, ..truth.parameters };
    truth.parameters.velocity.z = -2.5;
    truth.parameters.acceleration.z = 0.7;
    let mut recording = Recording::new(flown_within(&truth, 0, |_| 2e-5, 7.0, 400.0)).unwrap();
    recording.lines = sweeps::of_undivided(&recording).unwrap();
    let solution = best_solution(&recording).unwrap();
    let (found, deviations) = (&solution.model.parameters, &solution.deviations);
    assert!((found.epoch / 3.5 - 1.0).abs() < 0.02, "{}", found.epoch);
    assert!((found.acceleration.z / 0.7 - 1.0).abs() < 0.02, "{found:?}");
    let expected = truth.parameters.with_epoch(found.epoch);
    assert!((found.velocity.z - expected.velocity.z).abs() < 0.02, "{found:?}");
    let error = (found.velocity - expected.velocity).truncate().length();
    let deviation = deviations.velocity.truncate().length();
    let deviation = libm::hypot(deviation, trend::speed_deviation(&recording, &solution));
    assert!(error < 3.0 * deviation && deviation < 0.4, "{error} {deviation}");
    assert!((found.position.z / expected.position.z - 1.0).abs() < 0.003, "{found:?}");
}

/// Over flat ground a pitch looks like a place farther along the flight.
#[test]
fn a_pitch_over_flat_ground_is_uncertain() {
    let truth = model(Mirror::Polygon, radians(58.0), 90.0);
    let pulse = |k: u32| {
        let time = 5e-6 * f64::from(k);
        let at = truth.footprint(&Attitude::default(), 0, time, 0.0);
        (at.x.abs() < 100.0 && at.y.abs() < 100.0)
            .then(|| Pulse::on_ground(time, DVec3::new(at.x, at.y, 0.0), at.angle))
    };
    let recording = Recording::new((0..300_000).filter_map(pulse).collect()).unwrap();
    let solution = trial(&recording, &truth);
    let pitch = degrees(solution.deviations.pitch);
    assert!((0.5..2.1).contains(&pitch), "{pitch}");
}

#[test]
fn a_flight_is_found_from_some_of_its_seconds() {
    let truth = model(Mirror::Polygon, radians(58.0), 90.0);
    let sample = windows::Windows::one_of(2);
    let pulses = flown(&truth, |_| 5e-6, 3.0).into_iter().filter(|pulse| sample.has(pulse.time));
    let mut recording = Recording { windows: sample, ..Recording::new(pulses.collect()).unwrap() };
    let count = recording.lines.len();
    recording.leave_out_cut_lines();
    assert!(count - recording.lines.len() <= 4, "{count} {}", recording.lines.len());
    let solution = best_solution(&recording).unwrap();
    assert_eq!(solution.model.mirror, Mirror::Polygon);
    let p = &solution.model.parameters;
    assert!((p.position.z / 1200.0 - 1.0).abs() < 0.01, "{p:?}");
    assert!((p.mirror.rate.abs() / 90.0 - 1.0).abs() < 1e-4, "{p:?}");
}

#[test]
fn a_mirror_that_swings_is_found() {
    let solution = check(&model(Mirror::Oscillating, radians(25.0), 50.0), 200_000.0);
    assert!((degrees(solution.model.parameters.mirror.angle) - 25.0).abs() < 0.2);
}

/// Sweeps up to their ends, which no gap divides.
#[test]
fn mirrors_that_reverse_slowly_or_swing_as_a_sine_are_found() {
    for (mirror, turning) in [(Mirror::Turning, 0.4), (Mirror::Sine, 0.0)] {
        let mut truth = model(mirror, radians(20.0), 40.0);
        truth.parameters.mirror.turning = turning;
        let mut recording = Recording::new(flown_within(&truth, 0, |_| 1e-5, 3.0, 3000.0)).unwrap();
        assert_eq!(recording.lines.len(), 1);
        recording.lines = sweeps::of_undivided(&recording).unwrap();
        assert!(recording.lines.len().abs_diff(240) <= 2, "{}", recording.lines.len());
        let solution = best_solution(&recording).unwrap();
        assert_eq!(solution.model.mirror, mirror);
        let found = solution.model.parameters.mirror;
        assert!((degrees(found.angle) - 20.0).abs() < 0.1, "{mirror:?}: {}", degrees(found.angle));
        assert!((found.rate / 40.0 - 1.0).abs() < 1e-4, "{mirror:?}: {}", found.rate);
        assert!((found.turning - turning).abs() < 0.01, "{}", found.turning);
        assert!(solution.residual < 0.06, "{mirror:?}: {}", solution.residual);
        let rate = PulseRate::of(&recording, &solution);
        assert!((rate.mean * 1e-5 - 1.0).abs() < 1e-4, "{}", rate.mean);
    }
}

#[test]
fn the_rate_of_a_thinned_cloud_is_that_of_the_pulses_that_left() {
    let truth = model(Mirror::Polygon, radians(58.0), 90.0);
    let mut pulses = flown(&truth, |_| 5e-6, 3.0);
    let mut k = 0;
    pulses.retain(|_| {
        k += 1;
        noise(k) > 1.28
    });
    let recording = Recording::new(pulses).unwrap();
    let rate = PulseRate::of(&recording, &known(&truth));
    // Without gaps of more than 20 pulses.
    assert!((0.85..0.91).contains(&rate.lost), "{}", rate.lost);
    assert!((rate.mean / 200_000.0 - 1.0).abs() < 1e-4, "{}", rate.mean);
}

#[test]
fn the_rate_of_every_tenth_pulse_is_that_of_the_pulses_that_left() {
    let truth = model(Mirror::Polygon, radians(58.0), 90.0);
    let pulses = flown(&truth, |_| 5e-6, 3.0).into_iter().step_by(10).collect();
    let recording = Recording::new(pulses).unwrap();
    let rate = PulseRate::of(&recording, &known(&truth));
    assert!((rate.mean / 200_000.0 - 1.0).abs() < 1e-4 && rate.is_constant(), "{}", rate.mean);
    assert!((0.85..0.91).contains(&rate.lost), "{}", rate.lost);
}

#[test]
fn a_rate_that_follows_the_mirror_is_told() {
    let truth = model(Mirror::Cone, radians(20.0), 140.0);
    // Longer intervals in a part of the circle, which falls into the square.
    let is_slow = |time: f64| truth.fraction(0, time) < 0.28;
    let pulses = flown(&truth, |time| if is_slow(time) { 3.5e-6 } else { 2.5e-6 }, 3.0);
    let slow = pulses.iter().filter(|pulse| is_slow(pulse.time)).count() as f64 / pulses.len() as f64;
    assert!((0.1..0.9).contains(&slow), "{slow}");
    let recording = Recording::new(pulses).unwrap();
    let known = known(&truth);
    let rate = PulseRate::of(&recording, &known);
    assert!(!rate.is_constant() && (rate.range.1 / rate.range.0 - 1.4).abs() < 0.05, "{:?}", rate.range);
    let times: Vec<f64> = rate.times(&known, recording.duration()).take(1_000_000).collect();
    let share = times.len() as f64 / recording.pulses.len() as f64;
    // The whole part of the circle has pulses, of which some fall beside the square.
    assert!(times.windows(2).all(|pair| pair[1] > pair[0]) && (1.0..4.0).contains(&share), "{share}");
}

#[test]
fn intervals_that_repeat_are_found_in_times_that_are_rounded() {
    let truth = model(Mirror::Cone, radians(20.0), 140.0);
    let dither = [1.05, 1.02, 0.97, 0.94, 0.98, 1.01, 1.03];
    let count = std::cell::Cell::new(0);
    let interval = |_| {
        count.set(count.get() + 1);
        2.5e-6 * dither[count.get() % dither.len()]
    };
    let mut pulses = flown(&truth, interval, 2.0);
    // Two pulses of a hundred are lost, and times have steps of 240 ns.
    pulses = pulses.into_iter().enumerate().filter(|(k, _)| k % 50 != 7).map(|(_, pulse)| pulse).collect();
    pulses.iter_mut().for_each(|pulse| pulse.time = (pulse.time / 2.4e-7).round() * 2.4e-7);
    let recording = Recording::new(pulses).unwrap();
    let solution = best_solution(&recording).unwrap();
    let rate = PulseRate::of(&recording, &solution);
    assert!((rate.lost - 0.02).abs() < 0.002, "{}", rate.lost);
    assert_eq!(rate.dither.len(), dither.len(), "{:?}", rate.dither);
    let differs = |shift: usize| {
        let pairs =
            rate.dither.iter().enumerate().map(|(k, factor)| (factor - dither[(k + shift) % 7]).abs());
        pairs.fold(0.0, f64::max)
    };
    let difference = (0..7).map(differs).fold(f64::INFINITY, f64::min);
    assert!(difference < 0.006, "{difference}: {:?}", rate.dither);
    // A constant rate has no pattern.
    let recording = Recording::new(flown(&truth, |_| 2.5e-6, 2.0)).unwrap();
    assert!(PulseRate::of(&recording, &known(&truth)).dither.is_empty());
}

/// Levels that repeat after 10 lines are foreseen for lines that were left out.
#[test]
fn levels_of_lines_that_repeat_are_foreseen() {
    let truth = model(Mirror::Cone, radians(20.0), 140.0);
    let level = |time: f64| 1.0 + 0.02 * noise(((time * 140.0) as u64) % 10);
    let recording = Recording::new(flown(&truth, |time| 2.5e-6 * level(time), 3.0)).unwrap();
    let mut fitted = recording.clone();
    let kept = |k: usize| (k as u64).wrapping_mul(0x9e37_79b9) >> 7 & 3 == 0;
    fitted.lines =
        recording.lines.iter().enumerate().filter(|(k, _)| kept(*k)).map(|(_, line)| line.clone()).collect();
    let solution = known(&truth);
    let rate = PulseRate::of(&fitted, &solution);
    assert_eq!(rate.pattern.as_ref().unwrap().period, 10);
    let all = PulseRate::of(&recording, &solution);
    let values = |rate: &PulseRate| rate.pattern.as_ref().unwrap().values.clone();
    for (foreseen, recorded) in values(&rate).into_iter().zip(values(&all)) {
        assert!((foreseen.unwrap() - recorded.unwrap()).abs() < 0.003, "{foreseen:?} {recorded:?}");
    }
    let mut levels: Vec<f64> = values(&all).into_iter().flatten().collect();
    levels.sort_by(f64::total_cmp);
    assert!(levels[9] - levels[0] > 0.02, "{levels:?}");
}

/// A rate that falls along each arc to less than half of its highest value: no pulse is lost.
#[test]
fn slow_parts_of_an_arc_are_no_lost_pulses() {
    let truth = model(Mirror::Cone, radians(20.0), 100.0);
    let parts = flown(&truth, |_| 2e-5, 1.5).into_iter().map(|pulse| truth.fraction(0, pulse.time));
    let (low, high) = parts.fold((1.0, 0.0), |(low, high), part| (f64::min(low, part), f64::max(high, part)));
    assert!(high - low > 0.03 && high - low < 0.3, "{low} {high}");
    let interval = |time: f64| {
        let along = ((truth.fraction(0, time) - low) / (high - low)).clamp(0.0, 1.0);
        1.25e-6 * (1.0 + 2.0 * along)
    };
    let pulses = flown(&truth, interval, 1.5);
    let steps: Vec<f64> =
        pulses.windows(2).map(|pair| pair[1].time - pair[0].time).filter(|step| *step < 1e-4).collect();
    let mean = steps.iter().sum::<f64>() / steps.len() as f64;
    let longest = steps.iter().copied().fold(0.0, f64::max);
    assert!(longest > 2.5 * 1.25e-6, "{longest}");
    let recording = Recording::new(pulses).unwrap();
    let rate = PulseRate::of(&recording, &known(&truth));
    assert!(rate.lost < 1e-3 && (rate.mean * mean - 1.0).abs() < 1e-3, "{} {}", rate.lost, rate.mean * mean);
    assert!(rate.is_plausible() && rate.has_plausible_range(), "{:?}", rate.range);
}

/// Times in steps of nearly an interval do not determine the intervals of pulses, but the positions of the
/// points do.
#[test]
fn places_tell_the_rate_where_times_are_coarse() {
    let truth = model(Mirror::Polygon, radians(58.0), 90.0);
    let mut pulses = flown(&truth, |_| 5e-6, 2.0);
    pulses.iter_mut().for_each(|pulse| pulse.time = (pulse.time / 4e-6).round() * 4e-6);
    pulses.dedup_by_key(|pulse| pulse.time);
    let recording = Recording::new(pulses).unwrap();
    let rate = PulseRate::of(&recording, &known(&truth));
    assert!((rate.mean / 200_000.0 - 1.0).abs() < 0.003 && rate.lost < 0.02, "{} {}", rate.mean, rate.lost);
    assert!(rate.coarse_step.is_none());
}

/// Beams that fire in turn look like lines of a mirror that turns within a few pulses, which no section shows.
#[test]
fn guesses_that_turn_within_a_few_pulses_explain_nothing() {
    let truth = model(Mirror::Polygon, radians(58.0), 90.0);
    let recording = Recording::new(flown(&truth, |_| 5e-6, 1.0)).unwrap();
    let fast = trial(&recording, &model(Mirror::Polygon, radians(58.0), 90_000.0));
    assert!(!fast.has_sections());
    assert_eq!(misfit(&fast, &recording).unwrap(), "needs a mirror that turns within a few pulses");
    assert!(trial(&recording, &truth).has_sections());
}

/// Sections without pulses are passed over, however short they are.
#[test]
fn sections_hold_all_pulses_of_their_time() {
    let truth = model(Mirror::Polygon, radians(58.0), 90.0);
    let mut pulses = flown(&truth, |_| 5e-6, 0.2);
    let first = pulses[0].time;
    // Pauses within lines, which do not end them.
    pulses.retain(|pulse| ((pulse.time - first) / 4e-4).fract() < 0.6);
    let recording = Recording::new(pulses).unwrap();
    let middles = |max: f64| {
        let mut found = Vec::new();
        for line in &recording.lines {
            let pulses: Vec<Pulse> = recording.pulses.range(line.clone()).collect();
            let mut rest = &pulses[..];
            let (first, last) = (rest[0].time, rest[rest.len() - 1].time);
            let count = ((last - first) / max).ceil().max(1.0) as usize;
            for k in 1..=count {
                let until = first + (last - first) * k as f64 / count as f64;
                let end = rest.partition_point(|pulse| pulse.time <= until || k == count);
                let (section, others) = rest.split_at(end);
                rest = others;
                if section.len() >= 8 {
                    let used: Vec<&Pulse> = section.iter().step_by(section.len().div_ceil(40)).collect();
                    found.push(used.iter().map(|pulse| pulse.time).sum::<f64>() / used.len() as f64);
                }
            }
        }
        found.sort_by(f64::total_cmp);
        found
    };
    for max in [1e-2, 2.3e-4, 7.1e-5, 1e-7] {
        let found: Vec<f64> =
            sections::sections(&recording, max, usize::MAX).iter().map(|section| section.time).collect();
        assert_eq!(found, middles(max), "{max}");
        assert_eq!(found.is_empty(), max == 1e-7);
    }
}

/// Eight sections of a period, of which one of sixteen is chosen.
#[test]
fn chosen_sections_are_of_all_parts_of_a_period() {
    let truth = model(Mirror::Sine, radians(20.0), 40.0);
    let mut recording = Recording::new(flown_within(&truth, 0, |_| 1e-5, 4.0, 3000.0)).unwrap();
    recording.lines = sweeps::of_undivided(&recording).unwrap();
    let all = sections::sections(&recording, 1.0 / 320.0, usize::MAX);
    let chosen = sections::sections(&recording, 1.0 / 320.0, all.len() / 16);
    assert!(chosen.len().abs_diff(all.len() / 16) <= 5, "{} of {}", chosen.len(), all.len());
    assert!(chosen.windows(2).all(|pair| pair[0].time < pair[1].time));
    let mut of_part = [0; 8];
    chosen.iter().for_each(|section| of_part[(8.0 * truth.fraction(0, section.time)) as usize % 8] += 1);
    assert!(of_part.iter().all(|count| *count >= chosen.len() / 16), "{of_part:?}");
}

/// Seven seconds of an elliptic cone, all of it in the cloud.
fn elliptic() -> (Model, Recording) {
    let mut truth = model(Mirror::EllipticCone, radians(20.0), 40.0);
    truth.parameters.mirror.angle_along = radians(14.0);
    let recording = Recording::new(flown_within(&truth, 0, |_| 1e-4, 7.0, 3000.0)).unwrap();
    (truth, recording)
}

/// A fan of lines is no ellipse, however well a flat one meets the points.
#[test]
fn flat_ellipses_explain_nothing() {
    let (truth, recording) = elliptic();
    let mut solution = trial(&recording, &truth);
    assert_eq!(misfit(&solution, &recording), None);
    solution.model.parameters.mirror.angle_along = radians(0.001);
    let reason = misfit(&solution, &recording).unwrap();
    assert!(reason.ends_with("° by 0.001°, which is nearly a line"), "{reason}");
}

#[test]
fn circles_that_miss_successive_sections_are_not_solved_first() {
    let (truth, recording) = elliptic();
    let circle = model(Mirror::Cone, radians(17.0), 40.0);
    let choice = |candidates: &[&Model]| Choice {
        candidates: candidates.iter().map(|model| known(model)).collect(),
        failures: Vec::new(),
        is_doubtful: false,
        has_angles: false,
    };
    let both = choice(&[&circle, &truth]);
    assert_eq!(both.first(&recording).unwrap().model.mirror, Mirror::EllipticCone);
    assert!(choice(&[&circle]).first(&recording).is_none());
}

#[test]
fn solutions_do_not_depend_on_the_number_of_threads() {
    let (truth, recording) = elliptic();
    let solved = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let Solution { model, deviations, attitudes, residual, .. } =
            pool.install(|| trial(&recording, &truth));
        let vectors = [&model.parameters, &deviations].map(|p| p.to_vector(Mirror::EllipticCone));
        let attitudes = attitudes.iter().flat_map(|attitude| attitude.to_vector().to_array());
        let values = vectors.concat().into_iter().chain(attitudes).chain([residual]);
        values.map(f64::to_bits).collect::<Vec<u64>>()
    };
    assert_eq!(solved(1), solved(3));
}
