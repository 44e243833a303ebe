//! Detects recordings of a scanner that turns at a fixed position: their scan lines turn steadily.

use super::phases::StraightLine;
use super::pulses::Pulses;
use super::recording::Recording;
use libm::{atan2, hypot, sqrt};
use std::f64::consts::TAU;
use std::ops::Range;
use vlscan_geom::DVec3;

/// Number of scan lines whose mean direction is compared with that of the next group.
const LINES: usize = 16;
/// Minimum number of pulses of a line with a direction.
const MIN_PULSES: usize = 8;
/// Minimum agreement of directions with a mean: 1 if all are equal and all points are on straight lines seen
/// from above.
const MIN_AGREEMENT: f64 = 0.8;
/// Smaller turns may be those of a curved flight, rad.
const MIN_TURN: f64 = TAU / 3.0;
/// Largest standard deviation from an even turn, as a share of the turn.
const MAX_UNEVEN: f64 = 0.1;

/// Total turn of the scan lines seen from above, rad, if they turn steadily and so far that no flight
/// explains them. A platform that flies straight draws lines or arcs whose directions stay, or recur.
pub fn steady_turn(recording: &Recording) -> Option<f64> {
    let Recording { pulses, lines, .. } = recording;
    let mut groups = Vec::new();
    for lines in lines.chunks(LINES) {
        let directions: Vec<[f64; 2]> =
            lines.iter().filter_map(|line| direction(pulses, line.clone())).collect();
        let count = directions.len() as f64;
        let [x, y] = [0, 1].map(|k| directions.iter().map(|d| d[k]).sum::<f64>() / count);
        // False for NaN, where no line has a direction.
        if hypot(x, y) >= MIN_AGREEMENT {
            groups.push((pulses.time(lines[0].start), atan2(y, x)));
        }
    }
    if 2 * LINES * groups.len() < lines.len() || groups.len() < 8 {
        return None;
    }
    groups.sort_by(|a, b| a.0.total_cmp(&b.0));
    // Twice the angle, without jumps.
    let mut doubled = vec![0.0];
    for pair in groups.windows(2) {
        let change = pair[1].1 - pair[0].1;
        doubled.push(doubled[doubled.len() - 1] + change - TAU * (change / TAU).round());
    }
    let times: Vec<f64> = groups.iter().map(|(time, _)| *time).collect();
    let even = StraightLine::through(&times, &doubled);
    let turn = 0.5 * (even.slope * (times[times.len() - 1] - times[0])).abs();
    let square = |(time, angle): (&f64, &f64)| (0.5 * (angle - even.at(*time))).powi(2);
    let uneven = sqrt(times.iter().zip(&doubled).map(square).sum::<f64>() / times.len() as f64);
    // False for NaN.
    (turn >= MIN_TURN && uneven <= MAX_UNEVEN * turn).then_some(turn)
}

/// Cosine and sine of twice the direction in which the points of a line spread, seen from above, times 1 for
/// a straight line to 0 for points that spread alike in all directions.
fn direction(pulses: &Pulses, line: Range<usize>) -> Option<[f64; 2]> {
    if line.len() < MIN_PULSES {
        return None;
    }
    let positions = || line.clone().map(|i| pulses.position(i));
    let mean = |of: fn(DVec3) -> f64| positions().map(of).sum::<f64>() / line.len() as f64;
    let (x0, y0) = (mean(|position| position.x), mean(|position| position.y));
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for position in positions() {
        let (x, y) = (position.x - x0, position.y - y0);
        (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
    }
    let size = xx + yy;
    (size > 0.0).then(|| [(xx - yy) / size, 2.0 * xy / size])
}

#[cfg(test)]
mod tests {
    use super::super::pulses::Pulse;
    use super::*;
    use libm::{cos, sin, tan};

    /// Lines of 50 pulses, each in the direction and at the place that a function of its number gives.
    fn recorded(count: usize, of_line: impl Fn(usize) -> (f64, DVec3)) -> Recording {
        let mut pulses = Vec::new();
        for line in 0..count {
            let (direction, place) = of_line(line);
            for k in 0..50 {
                let range = 10.0 * tan(0.02 * f64::from(k));
                let position = place + DVec3::new(range * cos(direction), range * sin(direction), 0.0);
                let time = 0.02 * line as f64 + 1e-4 * f64::from(k);
                pulses.push(Pulse {
                    time,
                    position,
                    angle: 0.02 * f64::from(k),
                    returns: 1,
                    class: 1,
                    last: None,
                    file_channel: 0,
                    channel: 0,
                });
            }
        }
        let lines = (0..count).map(|line| 50 * line..50 * (line + 1)).collect();
        Recording { lines, ..Recording::new(pulses).unwrap() }
    }

    #[test]
    fn a_scanner_that_turns_on_the_spot_is_no_flight() {
        for turns in [-1.0, 0.5, 1.0, 7.0] {
            let recording = recorded(2000, |line| (TAU * turns * line as f64 / 2000.0, DVec3::ZERO));
            let turn = steady_turn(&recording).unwrap();
            assert!((turn / (TAU * turns).abs() - 1.0).abs() < 0.02, "{turn} for {turns}");
        }
    }

    #[test]
    fn lines_of_flights_do_not_turn() {
        let along = |line: usize| DVec3::new(0.0, 0.4 * line as f64, 0.0);
        // Straight, with two channels that look ahead and back, with a wind that turns, in a curve of 60
        // degrees, as arcs.
        let flights: [&dyn Fn(usize) -> f64; 5] = [
            &|_| 0.3,
            &|line| if line % 2 == 0 { 0.25 } else { -0.25 },
            &|line| 0.05 * sin(0.01 * line as f64),
            &|line| 1.05 * line as f64 / 2000.0,
            &|line| 0.4 * f64::from(line as u32 % 8),
        ];
        for (number, flight) in flights.into_iter().enumerate() {
            let recording = recorded(2000, |line| (flight(line), along(line)));
            assert_eq!(steady_turn(&recording), None, "{number}");
        }
    }
}
