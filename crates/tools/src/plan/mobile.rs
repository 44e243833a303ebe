//! Mobile surveys: a vehicle along a line.

use super::document::{Document, Waypoint};
use super::swath::Instrument;
use vlscan_base::quantity::{amount, duration, metres, number};
use vlscan_geom::DVec3;

/// Most waypoints of a plan.
const MAX_WAYPOINTS: f64 = 1e6;
/// Distance for which the spacing of points is told, m.
const POINT_DISTANCE: f64 = 10.0;

/// What a mobile survey shall be.
#[derive(Clone, Debug)]
pub struct MobileOptions {
    /// m/s.
    pub speed: f64,
    /// Half opening angle, degrees.
    pub scan_angle: Option<f64>,
    /// Pulses per second.
    pub pulse_rate: Option<u32>,
    /// Hz.
    pub scan_freq: Option<f64>,
    /// Maximum distance of waypoints, at which the vehicle is set on the ground, m.
    pub step: f64,
    /// Height of the ground where there is no scene, m.
    pub level: f64,
    /// Whether there is a scene whose ground the vehicle follows.
    pub on_ground: bool,
}

/// Plans a drive along a line.
///
/// # Errors
/// A sentence: options that exceed the instrument, a line that is too long for the step.
pub fn plan_mobile(
    line: &[[f64; 2]],
    instrument: &Instrument,
    options: &MobileOptions,
) -> Result<Document, String> {
    let half_angle = instrument.mobile_half_angle(options.scan_angle)?;
    let pulse_rate = instrument.pulse_rate(options.pulse_rate)?;
    // Lines as far apart as the points on them at that distance, unless a frequency is given: v / f = 2·θ·R·f / N.
    let opening = 2.0 * half_angle.unwrap_or(1.0) * POINT_DISTANCE;
    let lines = |fired: f64| (options.speed * f64::from(pulse_rate) * fired / opening).sqrt();
    let scan_of = |fired: f64| instrument.scan(half_angle, pulse_rate, options.scan_freq, lines(fired));
    let scan = scan_of(instrument.beams(&scan_of(1.0)?)?.fired)?;
    let beams = instrument.beams(&scan)?;
    let fired_rate = f64::from(pulse_rate) * beams.fired * instrument.devices();
    let mut document = Document::default();
    let mut total = 0.0;
    let mut places = vec![line[0]];
    for pair in line.windows(2) {
        let length = libm::hypot(pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]);
        total += length;
        if total / options.step + places.len() as f64 > MAX_WAYPOINTS {
            return Err(format!("more than {MAX_WAYPOINTS} waypoints; a larger --step is needed"));
        }
        let steps = (length / options.step).ceil().max(1.0);
        places.extend((1..=steps as usize).map(|i| {
            let t = i as f64 / steps;
            [0, 1].map(|axis| pair[0][axis] + t * (pair[1][axis] - pair[0][axis]))
        }));
    }
    let last = places.len() - 1;
    document.waypoints = places
        .iter()
        .enumerate()
        .map(|(i, [x, y])| Waypoint {
            position: DVec3::new(*x, *y, options.level),
            speed: Some(options.speed),
            active: i < last,
            on_ground: options.on_ground,
            strip: (i < last).then(|| "drive".to_owned()),
        })
        .collect();
    document.scanner.clone_from(&instrument.reference);
    document.settings = scan.settings();
    let seconds = total / options.speed;
    document.comments = vec![
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
        let lines = if instrument.spins() { "from turn to turn" } else { "from line to line" };
        document.comments.push(format!(
            "spacing    v/f = {:.4} m {lines}, {:.4} m from point to point on a line at {POINT_DISTANCE} m",
            options.speed / scan.line_rate,
            POINT_DISTANCE * beams.step_angle()
        ));
    }
    Ok(document)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::testing::instrument;

    #[test]
    fn waypoints_are_no_farther_apart_than_the_step() {
        let instrument = instrument("vlp16");
        let options = MobileOptions {
            speed: 8.0,
            scan_angle: None,
            pulse_rate: None,
            scan_freq: None,
            step: 10.0,
            level: 2.0,
            on_ground: false,
        };
        let plan = plan_mobile(&[[0.0, 0.0], [35.0, 0.0], [35.0, 5.0]], &instrument, &options).unwrap();
        let x: Vec<f64> = plan.waypoints.iter().map(|w| w.position.x).collect();
        assert_eq!(x, [0.0, 8.75, 17.5, 26.25, 35.0, 35.0]);
        assert!(plan.waypoints.iter().all(|w| w.position.z == 2.0));
        assert!(!plan.waypoints[5].active && plan.waypoints[4].active);
        assert!((plan.length() - 40.0).abs() < 1e-9);
    }
}
