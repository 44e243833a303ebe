//! Rejects recordings of instruments that stood or drove, whose beams come from within the place.

use super::recording::{Line, Recording};
use super::sensor::{PathSource, SensorPath};
use crate::flight::{self, Pulse, Pulses, steady_turn};
use std::path::Path;
use vlscan_base::error::{Error, Result};
use vlscan_geom::{degrees, radians};

/// Maximum share of the pulses of a flight that point above the horizon, and its scan angle, degrees.
const MAX_ABOVE: f64 = 0.01;
const HORIZON: f64 = 90.0;

/// Rejects recordings with a line of an instrument that was not in the air. Lines whose beams meet in a place
/// above the points are of an aircraft.
///
/// # Errors
/// [`Error::Input`]: scan lines turn on the spot, or beams point above the horizon.
pub(super) fn reject(cloud: &Path, recording: &Recording, paths: &[SensorPath]) -> Result<()> {
    let mut lines = recording.lines.iter().zip(paths).filter(|(_, path)| path.found_by != PathSource::Beams);
    let reason = |(line, _): (&Line, &SensorPath)| {
        above_horizon(recording, line).or_else(|| turning_lines(recording, line))
    };
    match lines.find_map(reason) {
        Some(reason) => Err(Error::input_with_help(
            format!("{}: {reason}", cloud.display()),
            "a scene is estimated from an airborne cloud, whose beams come from above all points",
        )),
        None => Ok(()),
    }
}

/// The reason against a line with beams that point upwards.
fn above_horizon(recording: &Recording, line: &Line) -> Option<String> {
    let angles = line.pulses.clone().map(|pulse| recording.of_pulse(pulse)[0].scan_angle);
    let above = angles.filter(|angle| angle.abs() > HORIZON).count() as f64 / line.pulses.len() as f64;
    (recording.has_scan_angles && above > MAX_ABOVE).then(|| {
        format!(
            "{:.0} % of the pulses of line {} have scan angles beyond {HORIZON}°, above the horizon: the \
             instrument was not in the air",
            100.0 * above,
            line.source
        )
    })
}

/// The reason against a line whose scan lines turn on the spot.
fn turning_lines(recording: &Recording, line: &Line) -> Option<String> {
    let first = |pulse: usize| recording.of_pulse(pulse)[0];
    let origin = first(line.pulses.start);
    let pulse = |pulse: usize| {
        let first = first(pulse);
        Pulse {
            time: first.time - origin.time,
            position: first.position - origin.position,
            angle: radians(first.scan_angle),
            returns: first.of,
            class: first.class,
            last: None,
            file_channel: 0,
            channel: 0,
        }
    };
    // The pulses of a line are in the order of time.
    let pulses: Pulses = line.pulses.clone().map(pulse).collect();
    let turn = steady_turn(&flight::Recording::of_pulses(pulses)?)?;
    Some(format!(
        "the scan lines of line {} turn steadily by {:.0}°, as those of a scanner on a tripod do: the \
         instrument was not in the air",
        line.source,
        degrees(turn)
    ))
}

#[cfg(test)]
mod tests {
    use super::super::{recording, sensor};
    use super::*;
    use crate::limit::PointLimit;
    use libm::{cos, sin, tan};
    use std::f64::consts::TAU;
    use std::fmt::Write as _;
    use vlscan_base::diag::Diagnostics;

    /// The problem of a cloud of 320 scan lines of 12 pulses, each in the direction and at the place along y
    /// that functions of its number give.
    fn problem(direction: impl Fn(u32) -> f64, y: impl Fn(u32) -> f64, angle: f64) -> Option<String> {
        let mut text = String::from("x,y,z,time,class,scan_angle,return_number,number_of_returns\n");
        for line in 0..320 {
            for k in 0..12 {
                let (range, time) = (20.0 * tan(0.08 * f64::from(k)), 0.02 * f64::from(line));
                let (x, y) = (range * cos(direction(line)), y(line) + range * sin(direction(line)));
                let (time, angle) = (time + 1e-4 * f64::from(k), angle + 4.0 * f64::from(k));
                writeln!(text, "{x:.4},{y:.4},0.0,{time:.6},2,{angle:.3},1,1").unwrap();
            }
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cloud.csv");
        std::fs::write(&path, text).unwrap();
        let recording = recording::read(&path, PointLimit::default(), &mut Diagnostics::default()).unwrap();
        match reject(&path, &recording, &sensor::paths(&recording)) {
            Ok(()) => None,
            Err(Error::Input(report)) => Some(report.text()),
            Err(other) => panic!("{other}"),
        }
    }

    #[test]
    fn scanners_on_tripods_are_rejected() {
        let text = problem(|line| TAU * f64::from(line) / 320.0, |_| 0.0, 0.0).unwrap();
        assert!(text.contains("turn steadily") && text.contains("not in the air"), "{text}");
    }

    #[test]
    fn beams_above_the_horizon_are_rejected_and_flights_are_not() {
        let along = |line: u32| 0.5 * f64::from(line);
        assert_eq!(problem(|_| 0.0, along, 0.0), None);
        let text = problem(|_| 0.0, along, 60.0).unwrap();
        assert!(text.contains("33 %") && text.contains("above the horizon"), "{text}");
    }
}
