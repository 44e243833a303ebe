//! A table of recorded poses over time (spec kinematics §2.6).

use super::interpolated::composed;
use std::f64::consts::TAU;
use vlscan_geom::{DVec3, Rotation, UtmZone};
use vlscan_survey::RotationSpec;

/// Roll, pitch, yaw (rad) and x, y, z (m, scene frame).
pub(super) type PoseValues = [f64; 6];

/// Rows of poses by ascending time with the slopes between them.
#[derive(Clone, Debug)]
pub struct TrajectoryTable {
    /// Time of the first row in the files' own scale, s.
    first_time: f64,
    rows: Vec<TableRow>,
    /// UTM zone that its positions were projected to.
    zone: Option<UtmZone>,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct TableRow {
    /// Seconds after the first row.
    pub time: f64,
    pub values: PoseValues,
    /// Change per second until the next row; 0 within a jump.
    pub slopes: PoseValues,
}

impl TrajectoryTable {
    /// The table of `rows` (time in the files' own scale, values) in any order. Rows of equal time keep their
    /// order and make a jump. `None` if there is no row.
    pub fn new(mut rows: Vec<(f64, PoseValues)>) -> Option<TrajectoryTable> {
        rows.sort_by(|a, b| a.0.total_cmp(&b.0));
        TrajectoryTable::from_sorted(rows)
    }

    fn from_sorted(rows: Vec<(f64, PoseValues)>) -> Option<TrajectoryTable> {
        let first_time = rows.first()?.0;
        let mut table: Vec<TableRow> = rows
            .iter()
            .map(|&(time, values)| TableRow { time: time - first_time, values, slopes: [0.0; 6] })
            .collect();
        for i in 1..table.len() {
            let (time, values) = (table[i].time, table[i].values);
            let before = &mut table[i - 1];
            let span = time - before.time;
            if span > 0.0 {
                before.slopes = std::array::from_fn(|c| (values[c] - before.values[c]) / span);
            }
        }
        Some(TrajectoryTable { first_time, rows: table, zone: None })
    }

    /// This table with every angle within half a turn of the previous one, so that rotations take the shorter
    /// path.
    pub fn unwrapped(self) -> TrajectoryTable {
        self.map_rows(|rows| {
            for i in 1..rows.len() {
                let before = rows[i - 1].1;
                unwrap_angles(&mut rows[i].1, &before);
            }
        })
    }

    /// This table with yaws along the path from the previous row to the next, for tables of positions only.
    /// `sense` is 1 where yaw is a heading, −1 where it is counter-clockwise.
    pub fn heading_along(self, sense: f64) -> TrajectoryTable {
        self.map_rows(|rows| {
            let positions: Vec<[f64; 2]> = rows.iter().map(|r| [r.1[3], r.1[4]]).collect();
            let mut heading = None;
            for i in 0..rows.len() {
                let (a, b) = (positions[i.saturating_sub(1)], positions[(i + 1).min(positions.len() - 1)]);
                let (east, north) = (b[0] - a[0], b[1] - a[1]);
                if east != 0.0 || north != 0.0 {
                    heading = Some(libm::atan2(east, north));
                }
                rows[i].1[2] = sense * heading.unwrap_or(0.0);
            }
        })
    }

    fn map_rows(self, change: impl FnOnce(&mut [(f64, PoseValues)])) -> TrajectoryTable {
        let (first, zone) = (self.first_time, self.zone);
        let mut rows: Vec<(f64, PoseValues)> = self.rows.iter().map(|r| (r.time, r.values)).collect();
        change(&mut rows);
        let table = TrajectoryTable::from_sorted(rows);
        table.map_or(self, |table| TrajectoryTable { first_time: first, zone, ..table })
    }

    pub(crate) fn shifted(mut self, shift: DVec3) -> TrajectoryTable {
        for row in &mut self.rows {
            row.values[3] -= shift.x;
            row.values[4] -= shift.y;
            row.values[5] -= shift.z;
        }
        self
    }

    /// This table with the UTM zone that its positions were projected to.
    pub fn in_zone(self, zone: Option<UtmZone>) -> TrajectoryTable {
        TrajectoryTable { zone, ..self }
    }

    /// UTM zone that its positions were projected to.
    pub fn zone(&self) -> Option<UtmZone> {
        self.zone
    }

    /// Time of the first row in the files' own scale, s.
    pub fn first_time(&self) -> f64 {
        self.first_time
    }

    /// Time of the last row, s after the first.
    pub fn duration(&self) -> f64 {
        self.rows.last().map_or(0.0, |r| r.time)
    }

    /// The longest interval between two rows that overlaps `span` (s after the first row), and its start.
    pub fn longest_gap(&self, start: f64, end: f64) -> Option<(f64, f64)> {
        let pairs = self.rows.windows(2).filter(|pair| pair[0].time < end && pair[1].time > start);
        pairs.map(|pair| (pair[0].time, pair[1].time - pair[0].time)).max_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// The position at `time` seconds after the first row; beyond the ends it is extrapolated.
    pub fn position_at(&self, time: f64) -> DVec3 {
        let [.., x, y, z] = self.values_at(time);
        DVec3::new(x, y, z)
    }

    /// The position at `time` like [`position_at`](Self::position_at), and the attitude there.
    pub(crate) fn pose_at(&self, time: f64, spec: RotationSpec) -> (DVec3, Rotation) {
        let [roll, pitch, yaw, x, y, z] = self.values_at(time);
        (DVec3::new(x, y, z), composed(spec, roll, pitch, yaw))
    }

    fn values_at(&self, time: f64) -> PoseValues {
        let after = self.rows.partition_point(|r| r.time <= time);
        let row = &self.rows[after.saturating_sub(1).min(self.rows.len().saturating_sub(2))];
        std::array::from_fn(|c| row.values[c] + (time - row.time) * row.slopes[c])
    }

    /// Roll, pitch and yaw (rad) and position (m) of every row.
    pub fn poses(&self) -> impl Iterator<Item = ([f64; 3], DVec3)> {
        self.rows.iter().map(|row| {
            let [roll, pitch, yaw, x, y, z] = row.values;
            ([roll, pitch, yaw], DVec3::new(x, y, z))
        })
    }

    /// Time (s after the first row) and position (m) of every row.
    pub fn timed_positions(&self) -> impl Iterator<Item = (f64, DVec3)> {
        self.rows.iter().map(|row| {
            let [.., x, y, z] = row.values;
            (row.time, DVec3::new(x, y, z))
        })
    }

    pub(super) fn rows(&self) -> &[TableRow] {
        &self.rows
    }
}

/// Changes the angles of `values` by whole turns to be nearest to those of `before`.
pub(super) fn unwrap_angles(values: &mut PoseValues, before: &PoseValues) {
    for (angle, before) in values[..3].iter_mut().zip(before) {
        *angle += ((before - *angle) / TAU).round() * TAU;
    }
}

/// The slope filter (spec kinematics §2.6): drops rows where slopes hardly change. A row stays if the sum of
/// the changes of slope since the last kept row exceeds `threshold` in any column; the first, the last and
/// rows of jumps stay. `rows` are sorted by time.
pub(super) fn filter_slopes(rows: &[(f64, PoseValues)], threshold: f64) -> Vec<(f64, PoseValues)> {
    let slope = |i: usize| -> Option<PoseValues> {
        let (a, b) = (&rows[i], &rows[i + 1]);
        let span = b.0 - a.0;
        (span > 0.0).then(|| std::array::from_fn(|c| (b.1[c] - a.1[c]) / span))
    };
    let mut kept: Vec<(f64, PoseValues)> = rows.first().copied().into_iter().collect();
    let mut sum = [0.0; 6];
    for (i, row) in rows.iter().enumerate().take(rows.len().saturating_sub(1)).skip(1) {
        let (Some(before), Some(after)) = (slope(i - 1), slope(i)) else {
            kept.push(*row);
            sum = [0.0; 6];
            continue;
        };
        for ((sum, after), before) in sum.iter_mut().zip(after).zip(before) {
            *sum += after - before;
        }
        if sum.iter().any(|s| s.abs() > threshold) {
            kept.push(*row);
            sum = [0.0; 6];
        }
    }
    if rows.len() > 1 {
        kept.extend(rows.last());
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(time: f64, x: f64) -> (f64, PoseValues) {
        (time, [0.0, 0.0, 0.0, x, 0.0, 0.0])
    }

    #[test]
    fn the_slope_filter_keeps_bends() {
        // spec kinematics §2.8 example 6
        let rows: Vec<_> =
            [0.0, 1.0, 2.1, 3.0, 6.0, 9.0].iter().enumerate().map(|(t, &x)| row(t as f64, x)).collect();
        let kept: Vec<f64> = filter_slopes(&rows, 0.5).iter().map(|r| r.0).collect();
        assert_eq!(kept, [0.0, 3.0, 5.0]);
    }

    #[test]
    fn rows_are_sorted_and_jumps_have_no_slope() {
        let table =
            TrajectoryTable::new(vec![row(12.0, 5.0), row(10.0, 0.0), row(12.0, 9.0), row(11.0, 2.0)])
                .unwrap();
        assert_eq!((table.first_time(), table.duration()), (10.0, 2.0));
        assert_eq!(table.position_at(1.5).x, 3.5);
        assert_eq!(table.position_at(-1.0).x, -2.0);
        assert!(table.rows().iter().all(|r| r.slopes.iter().all(|s| s.is_finite())));
        assert!(TrajectoryTable::new(Vec::new()).is_none());
    }

    #[test]
    fn unwrapped_angles_take_the_shorter_way() {
        let rows = [350.0f64, 10.0, 355.0, 170.0, -170.0].map(f64::to_radians);
        let rows = rows.iter().enumerate().map(|(t, &yaw)| (t as f64, [0.0, 0.0, yaw, 0.0, 0.0, 0.0]));
        let table = TrajectoryTable::new(rows.collect()).unwrap().unwrapped();
        let yaws: Vec<f64> = table.rows().iter().map(|r| r.values[2].to_degrees().round()).collect();
        assert_eq!(yaws, [350.0, 370.0, 355.0, 530.0, 550.0]);
        assert!((table.rows()[0].slopes[2].to_degrees() - 20.0).abs() < 1e-9);
    }

    #[test]
    fn positions_alone_get_headings_along_their_way() {
        let place = |t: f64, x: f64, y: f64| (t, [0.0, 0.0, 0.0, x, y, 0.0]);
        let rows =
            vec![place(5.0, 0.0, 0.0), place(6.0, 0.0, 0.0), place(7.0, 3.0, 0.0), place(8.0, 3.0, -3.0)];
        let table = TrajectoryTable::new(rows).unwrap().heading_along(1.0);
        let yaws: Vec<f64> = table.rows().iter().map(|r| r.values[2].to_degrees().round()).collect();
        assert_eq!((yaws, table.first_time()), (vec![0.0, 90.0, 135.0, 180.0], 5.0));
    }
}
