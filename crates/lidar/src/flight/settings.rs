//! Checks of a survey before it is flown.

use super::leg::PlannedLeg;
use crate::platform::{Motion, PlatformPlan};
use crate::scanner::{DevicePlan, firing_window};
use std::f64::consts::{FRAC_PI_2, PI};
use vlscan_base::corrections::Corrections;
use vlscan_base::diag::Diagnostics;
use vlscan_base::quantity::{COORDINATE, MAX_DURATION, number};
use vlscan_geom::degrees;
use vlscan_survey::{Deflector, Leg, PlatformKind, PulseTimes, Survey, named_as_in};

/// Limit of steps of a warm-up: a quarter of an hour at 1 MHz.
const MAX_WARMUP_STEPS: f64 = 1e9;

/// Checks the numbers on which planning relies; `false` if the survey cannot be planned.
pub(super) fn check_numbers(survey: &Survey, problems: &mut Diagnostics) -> bool {
    let before = problems.items().len();
    if survey.legs.is_empty() {
        problems.error(None, "the survey has no legs");
    }
    if survey.scanner.devices.is_empty() {
        problems.error(None, format!("scanner `{}` has no device", survey.scanner.id));
    }
    if matches!(survey.platform.kind, PlatformKind::Stream(_)) && survey.legs.len() != 1 {
        let message = format!("a stream of poses has one leg, the survey has {}", survey.legs.len());
        problems.error(None, message);
    }
    for (name, value) in platform_numbers(survey) {
        if !value.is_finite() || (name == "drag" && value < 0.0) {
            let bound = if name == "drag" { " of at least 0" } else { "" };
            let id = &survey.platform.id;
            let value = number(value);
            let message = format!("platform `{id}`: {name} is {value}, expected a finite number{bound}");
            problems.error(None, message);
        }
    }
    for leg in &survey.legs {
        check_leg_numbers(leg, problems);
    }
    problems.items().len() == before
}

fn platform_numbers(survey: &Survey) -> Vec<(&'static str, f64)> {
    let mut numbers = match &survey.platform.kind {
        PlatformKind::GroundVehicle { drag } => vec![("drag", *drag)],
        PlatformKind::Multicopter(m) => vec![
            ("drag", m.drag),
            ("engine_max_force", m.engine_max_force),
            ("speedup_magnitude", m.speedup),
            ("slowdown_magnitude", m.slowdown),
            ("base_pitch_deg", m.base_pitch),
            ("pitch_speed_deg", m.pitch_speed),
            ("roll_speed_deg", m.roll_speed),
            ("yaw_speed_deg", m.yaw_speed),
            ("pitch_offset_deg", m.pitch_offset),
            ("roll_offset_deg", m.roll_offset),
        ],
        _ => Vec::new(),
    };
    if let Some((mean, stdev)) = survey.leg_offset {
        numbers.extend([("the mean leg offset", mean), ("the deviation of leg offsets", stdev)]);
    }
    numbers
}

fn check_leg_numbers(leg: &Leg, problems: &mut Diagnostics) {
    let n = leg.number;
    let s = &leg.scanner;
    if s.pulse_freq == 0 {
        let message = format!("leg {n}: the pulse frequency is 0, expected at least 1 Hz");
        problems.error(leg.place.clone(), message);
    }
    let p = leg.platform.position;
    if !p.to_array().iter().all(|&coordinate| COORDINATE.contains(coordinate)) {
        let message = format!(
            "leg {n}: not a position on Earth: x {} y {} z {}",
            number(p.x),
            number(p.y),
            number(p.z)
        );
        problems.error(leg.place.clone(), message);
    }
    let numbers = [
        ("speed", leg.platform.speed),
        ("yaw at departure", leg.platform.yaw_at_departure.unwrap_or(0.0)),
        ("scan frequency", s.scan_freq),
        ("scan angle", s.scan_angle),
        ("lowest vertical angle", s.vertical_min.unwrap_or(0.0)),
        ("highest vertical angle", s.vertical_max.unwrap_or(0.0)),
        ("head speed", s.head_rate),
        ("head start", s.head_start),
        ("head stop", s.head_stop),
        ("trajectory interval", s.trajectory_interval),
        ("greatest duration", s.max_duration.unwrap_or(0.0)),
        ("warm-up", s.warmup),
    ];
    for (name, value) in numbers.into_iter().filter(|(_, v)| !v.is_finite()) {
        problems
            .error(leg.place.clone(), format!("leg {n}: the {name} is {value}, expected a finite number"));
    }
    if s.max_duration.is_some_and(|duration| duration > MAX_DURATION) {
        let message = format!(
            "leg {n}: a greatest duration of {} s, expected at most {MAX_DURATION} s (31 days)",
            number(s.max_duration.unwrap_or_default())
        );
        problems.error(leg.place.clone(), message);
    }
    if s.warmup * s.pulse_rate() > MAX_WARMUP_STEPS {
        let message =
            format!("leg {n}: a warm-up of {} s at {} Hz takes too long", number(s.warmup), s.pulse_freq);
        problems.error(leg.place.clone(), message).help("warm-ups take seconds at most");
    }
}

/// Warns of optics that fire nothing or backwards, and of recorded wander that is shorter than the leg, which
/// takes `seconds` if that is known.
pub(super) fn check_optics(
    leg: &PlannedLeg,
    devices: &[DevicePlan],
    seconds: Option<f64>,
    problems: &mut Diagnostics,
) {
    for (i, device) in devices.iter().enumerate().filter(|_| leg.settings.active) {
        let which = if devices.len() > 1 { format!(", channel {i}") } else { String::new() };
        let angle = device.scan_angle(leg.settings.scan_angle);
        if let Some((from, to)) = device.motion.wander.as_ref().and_then(|wander| wander.span())
            && (from > 0.0 || seconds.is_some_and(|seconds| seconds > to + 1.0 / leg.frequency))
        {
            let until = seconds.map_or(String::new(), |seconds| format!(" of its {} s", number(seconds)));
            let message = format!(
                "leg {}{which}: the wander of the deflector is stated from {} s to {} s{until}; its first \
                 and last angle are held before and after",
                leg.number,
                number(from),
                number(to)
            );
            problems.warn(leg.place.clone(), message);
        }
        if matches!(device.deflector, Deflector::Conic | Deflector::EllipticConic { .. }) && angle > FRAC_PI_2
        {
            let (angle, other) = (number(degrees(angle)), number(degrees(PI - angle)));
            let message = format!(
                "leg {}{which}: with a half angle of {angle}°, above 90°, the beam leaves backwards, as a \
                 cone of {other}° about the opposite direction that turns the other way",
                leg.number
            );
            problems.warn(leg.place.clone(), message).help(format!(
                "for a circle that turns the other way give {other}° and scan_reverse = true \
                 (scanReverse=\"true\")"
            ));
        }
        let Deflector::Polygon { effective_max, .. } = device.deflector else { continue };
        let (lower, upper) = firing_window(effective_max, angle, &leg.settings);
        if lower >= upper {
            let range = format!("{}° to {}°", number(degrees(lower)), number(degrees(upper)));
            let message =
                format!("leg {}{which}: no pulse fires between vertical angles {range}", leg.number);
            let help =
                "set verticalAngleMin_deg, verticalAngleMax_deg, or the scanner's scanAngleEffectiveMax_deg";
            problems.warn(leg.place.clone(), message).help(named_as_in(leg.place.as_ref(), help));
        }
    }
}

/// Refuses pulse times with platforms that are integrated in equal steps, and warns of times after the end of
/// the leg, which takes `seconds` if that is known.
pub(super) fn check_pulse_times(
    leg: &PlannedLeg,
    platform: &PlatformPlan,
    seconds: Option<f64>,
    problems: &mut Diagnostics,
) {
    let Some(times) = &leg.times else { return };
    if platform.is_physical() {
        let message =
            format!("leg {}: vehicles and multicopters move in steps of a constant pulse rate", leg.number);
        let help = "pulse_times and pulse_intervals_us need a platform that stands, flies straight or \
                    follows a trajectory";
        problems.error(leg.place.clone(), message).help(help);
    }
    if let (Some(count), Some(seconds)) = (times.count(), seconds) {
        let fired = times.first_from(seconds).min(count);
        if fired < count {
            let message = format!(
                "leg {}: it ends after {} s, before the last {} of its {count} pulse times",
                leg.number,
                number(seconds),
                count - fired
            );
            problems.warn(leg.place.clone(), message);
        }
    }
}

/// Warns of settings of a leg that the reference replaces by those of the scanner or of the first leg.
pub(super) fn check_reference(
    leg: &PlannedLeg,
    devices: &[DevicePlan],
    kinematics: &Corrections,
    problems: &mut Diagnostics,
) {
    let s = &leg.settings;
    if s.pulse_rate() != leg.frequency {
        let message = format!(
            "leg {}: its time passes as if its pulse rate of {} Hz were {} Hz, that of the first leg, as in \
             HELIOS++",
            leg.number,
            s.pulse_freq,
            number(leg.frequency)
        );
        problems
            .warn(leg.place.clone(), message)
            .help("--physics refined, or --correct leg_pulse_rate, has a clock for each leg");
    }
    for device in devices.iter().filter(|_| s.active) {
        let (max, name) = (device.scan_freq_max, leg.number);
        if matches!(device.deflector, Deflector::Conic)
            && !kinematics.conic_at_leg_frequency
            && s.scan_freq != max
        {
            let (requested, used) = (number(s.scan_freq), number(max));
            let message = format!(
                "leg {name}: conic optics turn with {used} Hz, the scanner's scanFreqMax_Hz, not with \
                 {requested} Hz, as in HELIOS++"
            );
            problems.warn(leg.place.clone(), named_as_in(leg.place.as_ref(), &message)).help(
                "--physics refined, or --correct conic_at_leg_frequency, turns them with the frequency of \
                 the leg",
            );
        }
        let (requested, used) = (s.scan_angle, device.scan_angle(s.scan_angle));
        if matches!(device.deflector, Deflector::Oscillating { .. }) && requested > used {
            let (requested, used) = (number(degrees(requested)), number(degrees(used)));
            let message = format!(
                "leg {name}: a scan angle of {requested} degrees is beyond the scanner's {used}, which is \
                 used"
            );
            problems.warn(leg.place.clone(), message);
        } else if matches!(device.deflector, Deflector::Oscillating { .. })
            && device.scan_angle_max > 0.0
            && requested > device.scan_angle_max
        {
            let (requested, max) = (number(degrees(requested)), number(degrees(device.scan_angle_max)));
            let message = format!(
                "leg {name}: a scan angle of {requested} degrees is beyond the scanner's {max}, which limits \
                 no oscillating mirror in HELIOS++"
            );
            problems.warn(leg.place.clone(), message).help("--physics refined limits it");
        }
    }
}

/// Warns of oscillating mirrors whose period in this leg is shorter than in the leg before: the reference
/// goes on counting and may miss the turn, so that its angle runs away. Here the mirror begins a new period.
pub(super) fn check_shorter_periods(
    [before, leg]: [&PlannedLeg; 2],
    devices: &[DevicePlan],
    kinematics: &Corrections,
    problems: &mut Diagnostics,
) {
    let is_oscillating =
        devices.iter().any(|device| matches!(device.deflector, Deflector::Oscillating { .. }));
    let period = |leg: &PlannedLeg| leg.frequency / leg.settings.scan_freq;
    let is_shorter = before.settings.active && leg.settings.active && period(leg) < period(before);
    if is_oscillating && is_shorter && !kinematics.oscillation_at_leg_frequency {
        let message = format!(
            "leg {}: a period of the mirror takes fewer pulses than in the leg before ({:.0} after {:.0}); \
             it begins a new period, where the angle of HELIOS++ can run away",
            leg.number,
            period(leg),
            period(before)
        );
        problems
            .warn(leg.place.clone(), message)
            .help("put that leg first, or use --physics refined, whose mirrors begin each leg anew");
    }
}

/// Lets all channels fire at once, with a warning, where the last one would fire in the next pulse period.
pub(super) fn check_firing(leg: &mut PlannedLeg, devices: &[DevicePlan], problems: &mut Diagnostics) {
    let last = devices.iter().map(|device| device.firing_offset).fold(0.0, f64::max);
    let period = leg.times.as_ref().map_or(1.0 / leg.frequency, PulseTimes::shortest_interval);
    leg.fires_at_once = last * leg.frequency >= 1.0 || last >= period;
    if leg.fires_at_once && leg.settings.active {
        let message = format!(
            "leg {}: all channels fire at once, because the last one fires {:.3} µs after the first, which \
             is not within a period of {} Hz",
            leg.number,
            last * 1e6,
            number(leg.frequency)
        );
        let help = format!("the instrument fires with a pulse rate below {:.0} Hz", 1.0 / last);
        problems.warn(leg.place.clone(), message).help(help);
    }
}

/// Explains why leg `index` cannot end and how to fix it, as far as this is known before the flight; `None`
/// for legs with a maximum duration.
pub(super) fn why_endless(
    index: usize,
    legs: &[PlannedLeg],
    platform: &PlatformPlan,
    device: &DevicePlan,
) -> Option<(String, &'static str)> {
    let leg = &legs[index];
    if leg.max_duration > 0.0 || platform.is_stream() {
        return None;
    }
    if leg.still {
        return Some((
            "the platform stands still and the head does not turn".to_owned(),
            "give the leg a maxDuration_s or a headRotatePerSec_deg with start and stop",
        ));
    }
    why_head_never_stops(leg, device).or_else(|| why_never_arrives(index, platform))
}

fn why_head_never_stops(leg: &PlannedLeg, device: &DevicePlan) -> Option<(String, &'static str)> {
    let s = &leg.settings;
    let rate = device.head_rate(s.head_rate);
    let left = if rate < 0.0 { s.head_start - s.head_stop } else { s.head_stop - s.head_start };
    if left <= 0.0 {
        return None;
    }
    let step = rate.abs() / s.pulse_rate();
    let max_angle = s.head_start.abs().max(s.head_stop.abs());
    if left / rate.abs() <= MAX_DURATION && step > max_angle * f64::EPSILON {
        return None;
    }
    let reason = format!(
        "the head turns at {} °/s and never comes from {}° to {}°",
        number(degrees(rate)),
        number(degrees(s.head_start)),
        number(degrees(s.head_stop))
    );
    let help = if s.head_rate != 0.0 && rate == 0.0 {
        "the scanner's headRotatePerSecMax_deg is 0, so its head cannot turn"
    } else {
        "set headRotatePerSec_deg, or headRotateStop_deg equal to headRotateStart_deg"
    };
    Some((reason, help))
}

fn why_never_arrives(index: usize, platform: &PlatformPlan) -> Option<(String, &'static str)> {
    let courses = &platform.legs;
    let here = &courses[index];
    let next = courses.get(index + 1);
    let way = next.map_or(0.0, |next| (next.position - here.position).length());
    if here.speed > 0.0 && way / here.speed > MAX_DURATION {
        let reason =
            format!("{way:.0} m at {} m/s take more than {MAX_DURATION} s (31 days)", number(here.speed));
        return Some((reason, "set movePerSec_m higher"));
    }
    if matches!(platform.motion, Motion::Linear) {
        // The last leg's target is reached when it starts; a single leg flies to the centre of the scene.
        let moves = next.is_some_and(|n| n.position != here.position) || courses.len() == 1;
        return (moves && here.speed <= 0.0)
            .then(|| (format!("its speed is {} m/s", number(here.speed)), "set movePerSec_m above 0"));
    }
    if matches!(platform.motion, Motion::GroundVehicle { .. }) {
        let cap = if here.speed > 0.0 { here.speed } else { f64::INFINITY };
        let max_step = cap.min(platform.terminal_speed()) / here.frequency;
        let next = next?.position;
        if platform.kinematics.vehicle_heights {
            let way = next - here.position;
            let is_vertical = way.x == 0.0 && way.y == 0.0 && way.z.abs() >= max_step;
            return is_vertical.then(|| {
                let reason = format!(
                    "the next waypoint is {:.3} m {} the last one, where a ground vehicle cannot drive",
                    way.z.abs(),
                    if way.z > 0.0 { "straight above" } else { "straight below" }
                );
                (reason, "move one of them aside, or give them the same height")
            });
        }
        let climb = (next.z - courses[0].position.z).abs();
        return (climb >= max_step).then(|| {
            (
                format!("a ground vehicle keeps its height and the next waypoint is {climb:.3} m off it"),
                "`--correct vehicle-heights`, which is part of `--physics refined`, drives up and down; or \
                 give all legs the same height, or the platform the type `linearpath`",
            )
        });
    }
    None
}

#[cfg(test)]
mod tests {
    use crate::flight::FlightOptions;
    use crate::flight::testing::*;
    use std::sync::Arc;
    use vlscan_base::corrections::Corrections;
    use vlscan_geom::{DVec3, radians};
    use vlscan_survey::{AngleTable, Deflector, Leg, Mount, Multicopter, PlatformKind, Survey, Wander};

    fn flight(change: impl Fn(&mut Leg)) -> Survey {
        let legs = vec![leg([0.0, 0.0, 10.0], 30.0, &change), leg([50.0, 0.0, 10.0], 30.0, &change)];
        survey(PlatformKind::LinearPath, Mount::IDENTITY, straight(), legs)
    }

    #[test]
    fn legs_that_cannot_end_are_refused() {
        let mut still = flight(|_| {});
        still.platform.kind = PlatformKind::Static;
        let report = refusal(&still);
        assert!(report.contains("leg 0 never ends") && report.contains("leg 1 never ends"), "{report}");
        assert!(refusal(&flight(|l| turn_head(l, 0.0, 90.0))).contains("the head turns at 0 °/s"));
        assert!(refusal(&flight(|l| turn_head(l, 1e-14, 90.0))).contains("never comes from 0°"));
        let mut stiff = flight(|l| turn_head(l, 10.0, 90.0));
        stiff.scanner.devices[0].head.max_rate = 0.0;
        assert!(refusal(&stiff).contains("headRotatePerSecMax_deg is 0"));
        assert!(refusal(&flight(|l| l.platform.speed = 0.0)).contains("its speed is 0 m/s"));
        let mut hilly = flight(|_| {});
        hilly.platform.kind = PlatformKind::GroundVehicle { drag: 0.005 };
        hilly.legs[1].platform.position.z = 11.0;
        let report = refusal(&hilly);
        assert!(report.contains("1.000 m off it") && report.contains("vehicle-heights"), "{report}");
        let corrected = FlightOptions { kinematics: Corrections::MOTION, ..options() };
        assert!(fly_plan(&plan_with(&hilly, corrected)).len() == 2);
        for endless in [still, stiff, hilly] {
            let mut timed = endless;
            timed.legs.iter_mut().for_each(|l| l.scanner.max_duration = Some(0.1));
            assert!(plan_of(&timed).is_ok());
        }
    }

    #[test]
    fn all_invalid_numbers_are_refused_at_once() {
        let report = refusal(&flight(|l| {
            l.scanner.pulse_freq = 0;
            l.scanner.head_rate = f64::NAN;
            l.platform.position = DVec3::new(1e300, 0.0, 0.0);
        }));
        for part in
            ["leg 0: the pulse frequency is 0", "leg 1: the head speed is NaN", "not a position on Earth"]
        {
            assert!(report.contains(part), "{part:?} is missing from\n{report}");
        }
        assert!(refusal(&flight(|l| l.scanner.warmup = 1e9)).contains("warm-up"));
        let mut heavy = flight(|_| {});
        heavy.platform.kind = PlatformKind::GroundVehicle { drag: -1.0 };
        assert!(refusal(&heavy).contains("drag is -1"));
        let mut copter = flight(|_| {});
        let crooked = Multicopter { base_pitch: f64::NAN, ..MULTICOPTER };
        copter.platform.kind = PlatformKind::Multicopter(crooked);
        assert!(refusal(&copter).contains("base_pitch_deg is NaN"));
        assert!(refusal(&Survey { legs: Vec::new(), ..flight(|_| {}) }).contains("no legs"));
        let mut headless = flight(|_| {});
        headless.scanner.devices.clear();
        assert!(refusal(&headless).contains("has no device"));
    }

    #[test]
    fn cones_that_point_backwards_and_short_records_of_wander_cause_warnings() {
        let warnings = |half_angle: f64, times: Vec<f64>| {
            let mut s = flight(|_| {});
            let device = &mut s.scanner.devices[0];
            device.deflector = Deflector::Conic;
            (device.scan_angle_max, device.scan_freq) = (radians(half_angle), (0.0, 0.0));
            let degrees = times.iter().map(|_| 0.1).collect();
            device.scan_motion.wander = Some(Wander::Table(Arc::new(AngleTable { times, degrees })));
            plan_of(&s).unwrap().1.text()
        };
        // The leg takes 50 m at 30 m/s.
        let long = vec![0.0, 1.7];
        assert_eq!(warnings(20.0, long.clone()), "");
        let backwards = warnings(160.0, long);
        assert!(backwards.contains("160°") && backwards.contains("give 20° and scan_reverse"), "{backwards}");
        for short in [vec![0.0, 1.6], vec![0.1, 5.0]] {
            let held = warnings(20.0, short);
            assert!(held.contains("leg 0: the wander") && held.contains("are held"), "{held}");
        }
    }

    #[test]
    fn empty_firing_windows_cause_warnings() {
        let with_window = |low: f64, high: f64| {
            let mut s = flight(|l| {
                l.scanner.vertical_min = Some(radians(low));
                l.scanner.vertical_max = Some(radians(high));
            });
            s.scanner.devices[0].deflector = polygon();
            s
        };
        let (_, warnings) = plan_of(&with_window(0.0, 0.0)).unwrap();
        assert!(warnings.text().contains("no pulse fires"));
        assert!(plan_of(&with_window(-50.0, 50.0)).unwrap().1.items().is_empty());
    }
}
