//! Writes pulses and poses as comma-separated values: a header of names and units, then one row per line.
//! Every number has the minimum number of digits that restores its bits.

use super::columns::{ENTRIES, PulseColumn};
use super::row::{ATTITUDE, ColumnSet, DIRECTION, EXACT, LOW, ORIGIN, ORIGIN_ERROR, PulseRow, REPORTED};
use super::table::pose_values;
use vlscan_geom::DVec3;
use vlscan_lidar::flight::PoseSample;
use vlscan_tables::Dimension;

/// Header line of a stream of poses.
pub const POSE_HEADER: &str = "time[s],x[m],y[m],z[m],roll[deg],pitch[deg],yaw[deg]\n";

/// The columns that are written for every pulse.
pub fn default_columns() -> ColumnSet {
    let single = [
        PulseColumn::Time,
        PulseColumn::Leg,
        PulseColumn::Device,
        PulseColumn::Pulse,
        PulseColumn::Step,
        PulseColumn::ScanAngle,
    ];
    let all = single.iter().chain(&ORIGIN).chain(&DIRECTION).chain(&ATTITUDE).chain(&LOW);
    all.fold(ColumnSet::default(), |p, c| p.with(*c))
}

/// Adds the columns of mechanical errors.
pub fn with_errors(present: ColumnSet) -> ColumnSet {
    EXACT.iter().fold(present.with(PulseColumn::RangeError), |p, c| p.with(*c))
}

/// Adds the columns of a reported pose that differs from the true one.
pub fn with_reported(present: ColumnSet) -> ColumnSet {
    REPORTED.iter().chain(&ORIGIN_ERROR).fold(present, |p, c| p.with(*c))
}

/// The line of names of a stream of pulses.
pub fn header(present: ColumnSet) -> String {
    let headings: Vec<String> =
        ENTRIES.iter().filter(|e| present.has(e.column)).map(|e| e.heading()).collect();
    headings.join(",") + "\n"
}

/// Appends a pulse as a line; `shift` is the world position of the scene frame's origin.
pub fn push_pulse(out: &mut Vec<u8>, row: &PulseRow, present: ColumnSet, shift: DVec3) {
    let values = row.values(shift);
    for entry in ENTRIES.iter().filter(|e| present.has(e.column)) {
        let value = values[entry.column as usize];
        match entry.dimension() {
            Dimension::Count => push_count(out, value as u64),
            _ => push_number(out, value),
        }
        out.push(b',');
    }
    end_line(out);
}

/// Appends a pose as a line: seconds, metres, degrees (heading, pitch, roll innermost). `frame` is the world
/// position of the scene frame's origin and the time that times count from, s.
pub fn push_pose(out: &mut Vec<u8>, pose: &PoseSample, frame: (DVec3, f64)) {
    for number in pose_values(pose, frame) {
        push_number(out, number);
        out.push(b',');
    }
    end_line(out);
}

/// Replaces the last comma by the end of the line.
fn end_line(out: &mut [u8]) {
    if let Some(last) = out.last_mut() {
        *last = b'\n';
    }
}

fn push_count(out: &mut Vec<u8>, count: u64) {
    out.extend_from_slice(itoa::Buffer::new().format(count).as_bytes());
}

/// Appends the shortest text that is parsed to the same number.
fn push_number(out: &mut Vec<u8>, value: f64) {
    let mut buffer = zmij::Buffer::new();
    let text = buffer.format(value);
    out.extend_from_slice(text.strip_suffix(".0").unwrap_or(text).as_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn numbers_read_back_with_all_bits(value in prop::num::f64::NORMAL | prop::num::f64::SUBNORMAL | prop::num::f64::ZERO) {
            let mut out = Vec::new();
            push_number(&mut out, value);
            let back: f64 = std::str::from_utf8(&out).unwrap().parse().unwrap();
            prop_assert_eq!(back.to_bits(), value.to_bits());
        }
    }

    #[test]
    fn the_header_names_units() {
        assert!(
            header(default_columns())
                .starts_with("time[ns],x[m],y[m],z[m],dx,dy,dz,leg,device,pulse,step,qw,")
        );
        assert!(
            header(with_errors(default_columns())).ends_with("exact_qx,exact_qy,exact_qz,range_error[m]\n")
        );
        let mut out = Vec::new();
        push_number(&mut out, 86_391e9);
        assert_eq!(out, b"86391000000000");
    }
}
