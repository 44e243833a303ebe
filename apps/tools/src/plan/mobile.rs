//! Mobile surveys: a vehicle along a line.

use super::beams::{Beams, turned_across};
use super::document::{PlannedSurvey, Turned, Waypoint};
use super::error::PlanError;
use super::requirements::Carrier;
use super::swath::{Scan, SwathModel};
use crate::args;
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity::{POSITIVE, amount, duration, metres, number};
use vlscan_geom::DVec3;

/// Most waypoints of a plan.
const MAX_WAYPOINTS: f64 = 1e6;
/// Distance for which the spacing of points is reported, m.
const POINT_DISTANCE: f64 = 10.0;

/// Requirements of a mobile survey.
#[derive(Clone, Debug, clap::Args)]
pub struct MobileOptions {
    /// Speed, m/s.
    #[arg(long, value_name = "M/S", default_value = "10", value_parser = args::positive)]
    pub speed: f64,
    /// Half opening angle, degrees. [default: the scanner's]
    #[arg(long, value_name = "DEG", value_parser = args::positive)]
    pub scan_angle: Option<f64>,
    /// Scan frequency in Hz; for spinning scanners revolutions per second. [default: equal spacing along and
    /// across at 10 m; 10]
    #[arg(long, value_name = "HZ", value_parser = args::positive)]
    pub scan_freq: Option<f64>,
    /// Maximum distance between waypoints, where the vehicle is placed on the scene's ground, m.
    #[arg(long, value_name = "M", default_value = "20", value_parser = args::positive)]
    pub step: f64,
}

/// Plans a drive along a line, at the height `level`, m, or on the ground of the scene. Where the carrier's
/// mount makes the instrument scan along the road, the plan turns it to scan across, if it may.
///
/// # Errors
/// [`Error::Input`]: options that exceed the instrument, a line that is too long for the step, a mount with
/// which the instrument scans along the road.
pub fn plan_mobile(
    line: &[[f64; 2]],
    instrument: &SwathModel,
    carrier: &Carrier,
    options: &MobileOptions,
    level: f64,
    on_ground: bool,
) -> Result<PlannedSurvey> {
    plan(line, instrument, carrier, options, level, on_ground).map_err(Error::from)
}

fn plan(
    line: &[[f64; 2]],
    instrument: &SwathModel,
    carrier: &Carrier,
    options: &MobileOptions,
    level: f64,
    on_ground: bool,
) -> Result<PlannedSurvey, PlanError> {
    args::check([
        ("speed", Some(options.speed), POSITIVE),
        ("scan-angle", options.scan_angle, POSITIVE),
        ("scan-freq", options.scan_freq, POSITIVE),
        ("step", Some(options.step), POSITIVE),
    ])?;
    let half_angle = instrument.mobile_half_angle(options.scan_angle)?;
    let pulse_rate = instrument.pulse_rate()?;
    // Lines as far apart as the points on them at that distance, unless a frequency is given: v / f = 2·θ·R·f
    // / N.
    let opening = 2.0 * half_angle.unwrap_or(1.0) * POINT_DISTANCE;
    let lines = |fired: f64| (options.speed * f64::from(pulse_rate) * fired / opening).sqrt();
    let scan_of = |fired: f64| instrument.scan(half_angle, pulse_rate, options.scan_freq, lines(fired));
    let scan = scan_of(instrument.beams(&scan_of(1.0)?)?.fired)?;
    let beams = instrument.beams(&scan)?;
    let turned = turned(instrument, &beams, carrier)?;
    let (places, total) = places_along(line, options.step)?;
    let last = places.len() - 1;
    let waypoints = places
        .iter()
        .enumerate()
        .map(|(i, [x, y])| Waypoint {
            position: DVec3::new(*x, *y, level),
            speed: Some(options.speed),
            active: i < last,
            on_ground,
            strip: (i < last).then(|| "drive".to_owned()),
        })
        .collect();
    let mut comments = described(instrument, options, &scan, &beams, total);
    comments.extend(turned.map(|Turned { turns, .. }| {
        format!("mount      {}, because on the platform's mount it scans along the road", turns.text())
    }));
    Ok(PlannedSurvey {
        waypoints,
        scanner: instrument.reference.clone(),
        turned,
        settings: scan.settings(),
        comments,
        ..PlannedSurvey::default()
    })
}

/// The turned mount, where that of the platform makes the instrument scan along the road.
fn turned(instrument: &SwathModel, beams: &Beams, carrier: &Carrier) -> Result<Option<Turned>, PlanError> {
    match turned_across(beams, &carrier.mount) {
        None => Ok(None),
        Some(turns) if carrier.may_turn => Ok(Some(Turned { offset: carrier.mount.offset, turns })),
        Some(turns) => {
            Err(PlanError::AlongRoad { instrument: instrument.name().to_owned(), turns: turns.text() })
        }
    }
}

/// Positions along a line, at most `step` m apart, and the length of the line, m.
fn places_along(line: &[[f64; 2]], step: f64) -> Result<(Vec<[f64; 2]>, f64), PlanError> {
    let mut total = 0.0;
    let mut places = vec![line[0]];
    for pair in line.windows(2) {
        let length = libm::hypot(pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]);
        total += length;
        if total / step + places.len() as f64 > MAX_WAYPOINTS {
            return Err(PlanError::Waypoints(MAX_WAYPOINTS));
        }
        let steps = (length / step).ceil().max(1.0);
        places.extend((1..=steps as usize).map(|i| {
            let t = i as f64 / steps;
            [0, 1].map(|axis| pair[0][axis] + t * (pair[1][axis] - pair[0][axis]))
        }));
    }
    Ok((places, total))
}

/// The figures of a drive of `total` m as lines of text.
fn described(
    instrument: &SwathModel,
    options: &MobileOptions,
    scan: &Scan,
    beams: &Beams,
    total: f64,
) -> Vec<String> {
    let fired_rate = f64::from(scan.pulse_rate) * beams.fired * instrument.devices();
    let seconds = total / options.speed;
    let mut lines = vec![
        format!("{} along {} at {} m/s", instrument.name(), metres(total), number(options.speed)),
        format!("duration   {}", duration(seconds)),
        format!(
            "pulses     {} leave the instrument, {} per second",
            amount(seconds * fired_rate),
            amount(fired_rate)
        ),
    ];
    if scan.line_rate > 0.0 {
        // A spinning scanner draws a line per channel with each turn, over a full circle.
        let apart = if instrument.spins() { "from turn to turn" } else { "from line to line" };
        lines.push(format!(
            "spacing    v/f = {:.4} m {apart}, {:.4} m from point to point on a line at {POINT_DISTANCE} m",
            options.speed / scan.line_rate,
            POINT_DISTANCE * beams.step_angle()
        ));
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::beams::QuarterTurns;
    use crate::plan::testing::instrument;
    use vlscan_geom::Rotation;
    use vlscan_survey::Mount;

    /// A carrier whose mount is turned about z by that angle, rad.
    fn carrier(about_z: f64, may_turn: bool) -> Carrier {
        Carrier { mount: Mount { rotation: Rotation::about_z(about_z), ..Mount::IDENTITY }, may_turn }
    }

    const OPTIONS: MobileOptions =
        MobileOptions { speed: 8.0, scan_angle: None, scan_freq: None, step: 10.0 };

    #[test]
    fn waypoints_are_no_farther_apart_than_the_step() {
        let instrument = instrument("vlp16");
        let line = [[0.0, 0.0], [35.0, 0.0], [35.0, 5.0]];
        let plan = plan_mobile(&line, &instrument, &carrier(0.0, false), &OPTIONS, 2.0, false).unwrap();
        let x: Vec<f64> = plan.waypoints.iter().map(|w| w.position.x).collect();
        assert_eq!(x, [0.0, 8.75, 17.5, 26.25, 35.0, 35.0]);
        assert!(plan.waypoints.iter().all(|w| w.position.z == 2.0));
        assert!(!plan.waypoints[5].active && plan.waypoints[4].active);
        assert!((plan.length() - 40.0).abs() < 1e-9);
    }

    /// Mirrors scan across a road on a mount that is not turned, or turned by a quarter, as their axes lie.
    #[test]
    fn scanners_that_would_scan_along_the_road_are_turned_across_or_refused() {
        const QUARTER: f64 = std::f64::consts::FRAC_PI_2;
        let line = [[0.0, 0.0], [100.0, 0.0]];
        let plan = |id: &str, about_z: f64, may_turn: bool| {
            plan_mobile(&line, &instrument(id), &carrier(about_z, may_turn), &OPTIONS, 2.0, false)
        };
        for (id, across) in [
            ("riegl_vux-1ha22", 0.0),
            ("riegl_lms-q780", QUARTER),
            ("vlp16", 0.0),
            ("scanners_tls.xml#livox_mid-70", 0.0),
        ] {
            let plan = plan(id, across, false).unwrap();
            assert!(plan.turned.is_none(), "{id}");
        }
        for (id, along, turns, words) in [
            ("riegl_vux-1ha22", QUARTER, QuarterTurns([0.0; 3]), "not turned"),
            ("riegl_lms-q780", 0.0, QuarterTurns([0.0, 0.0, 90.0]), "turned by 90° about z"),
        ] {
            let turned = plan(id, along, true).unwrap();
            assert_eq!(turned.turned.unwrap().turns, turns, "{id}");
            let says = |line: &String| line.starts_with("mount ") && line.contains(words);
            assert!(turned.comments.iter().any(says), "{:?}", turned.comments);
            let said = plan(id, along, false).unwrap_err().to_string();
            assert!(said.contains("along the road") && said.contains(words), "{id}: {said}");
        }
    }
}
