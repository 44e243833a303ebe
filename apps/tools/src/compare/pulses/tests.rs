//! Tests of pulses.

use super::*;
use crate::cloud::Points;
use vlscan_formats::{AttributeSet, PointRow};
use vlscan_geom::DVec3;

/// Lines of 100 pulses of 1 µs, 10 ms apart, 0.5 m along and 2 m across; every fifth pulse has two
/// returns. Angles turn or jump.
pub fn recording(turns: bool, period: f64) -> Points {
    let mut points = Points::new(AttributeSet::of(|_| true));
    for (line, pulse) in (0..40).flat_map(|line| (0..100).map(move |pulse| (line, pulse))) {
        let is_back = turns && line % 2 == 1;
        let column = f64::from(if is_back { 99 - pulse } else { pulse });
        let number_of_returns = if pulse % 5 == 0 { 2 } else { 1 };
        for return_number in 1..=number_of_returns {
            let position = DVec3::new(0.5 * column, 2.0 * f64::from(line), 0.0);
            let time = 3e8 + f64::from(line) * period + f64::from(pulse) * 1e-6;
            let scan_angle = 0.2 * column - 10.0;
            let row = PointRow {
                position,
                time,
                scan_angle,
                return_number,
                number_of_returns,
                leg: 706,
                ..PointRow::default()
            };
            points.push(&row, None);
        }
    }
    points
}

pub fn cut(points: &Points) -> Cut<'_> {
    Cut::of(points, points.bounds().min, points.bounds().max)
}

#[test]
fn pulses_and_lines_are_those_that_were_flown() {
    // With gaps; without them, where angles turn, and where they jump back.
    for (turns, period) in [(false, 0.01), (true, 0.01), (true, 1e-4), (false, 1e-4)] {
        let points = recording(turns, period);
        let cut = cut(&points);
        let found = Pulses::of(&cut).unwrap();
        assert_eq!((found.count(), found.lines.len()), (4000, 40), "{turns} {period}");
        assert!(found.has_lines);
        assert_eq!(found.echoes().filter(|(returns, _)| *returns == 2).count(), 800);
        // The angle of a turn without a pause is that of the pulses before and after.
        assert!(found.lines.iter().all(|line| (99..=101).contains(&line.len())), "{turns} {period}");
        // Times of some 3e8 s have steps of 60 ns.
        assert!(found.intervals().all(|(time, _)| (time - 1e-6).abs() < 7e-8));
        assert!(found.line_intervals().iter().all(|(time, _)| (time - period).abs() < 1.1e-6));
        let along: Vec<f64> = found.spacings().map(|(d, _)| d).collect();
        assert!(along.iter().filter(|d| (**d - 0.5).abs() < 1e-9).count() > 39 * 98, "{turns} {period}");
        let across = found.line_spacings();
        assert!(across.len() > 800 && across.iter().all(|(d, _)| (d - 2.0).abs() < 1e-9));
    }
}

#[test]
fn lost_pulses_and_pauses_are_no_lines() {
    // Lines of 200 pulses of 2 µs every 5 ms, with gaps of up to 50 intervals, and a pause of ten
    // minutes.
    let mut times = Vec::new();
    for line in 0..100 {
        for i in (0..200).filter(|i| !(50..50 + line % 50).contains(i)) {
            let pause = if line < 50 { 0.0 } else { 600.0 };
            times.push(f64::from(line) * 5e-3 + f64::from(i) * 2e-6 + pause);
        }
    }
    assert_eq!(lines_of(&Track { times, angles: Vec::new() }).len(), 100);
}

#[test]
fn what_has_no_pulses_says_why() {
    let mut points = Points::new(AttributeSet::of(|a| vlscan_formats::Attribute::POSITION.contains(&a)));
    points.push(&PointRow::default(), None);
    assert!(Pulses::of(&cut(&points)).err() == Some(PulsesError::NoTimes));
    let mut points = Points::new(AttributeSet::of(|_| true));
    for i in 0..100 {
        let (return_number, number_of_returns) = (1, 1);
        let row = PointRow {
            position: DVec3::X * f64::from(i),
            time: f64::from(i / 10),
            return_number,
            number_of_returns,
            ..PointRow::default()
        };
        points.push(&row, None);
    }
    assert!(matches!(Pulses::of(&cut(&points)), Err(PulsesError::CoarseTimes(_))));
}
