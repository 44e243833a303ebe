//! A platform that follows a table of recorded poses (spec kinematics §2.6).

use super::course::{Span, fraction};
use super::table::{PoseValues, TrajectoryTable};
use serde::{Deserialize, Serialize};
use vlscan_geom::{DVec3, Rotation};
use vlscan_survey::RotationSpec;

/// Position in a table of poses. Values advance by addition and are set to those of each row that is passed.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct InterpolatedState {
    /// Seconds after the first row.
    time: f64,
    values: PoseValues,
    row: usize,
    last_clock: f64,
    /// The step clock at the leg's start, and the leg's duration, s.
    leg_start: f64,
    leg_duration: f64,
    /// Tolerance by which the leg may end too early, s.
    slack: f64,
}

impl InterpolatedState {
    pub(super) fn new(table: &TrajectoryTable) -> InterpolatedState {
        let values = table.rows().first().map_or([0.0; 6], |r| r.values);
        let (time, last_clock, leg_start, leg_duration, slack) = (0.0, 0.0, 0.0, 0.0, 0.0);
        InterpolatedState { time, values, row: 0, last_clock, leg_start, leg_duration, slack }
    }

    /// Moves to the start of `span`; added legs have no span and end at once.
    pub(super) fn start_leg(&mut self, table: &TrajectoryTable, span: Option<Span>, clock: f64) {
        self.leg_start = clock;
        self.leg_duration = span.map_or(0.0, |s| s.end - s.start);
        let Some(span) = span else { return };
        if span.start < self.time {
            let InterpolatedState { last_clock, leg_start, leg_duration, .. } = *self;
            *self =
                InterpolatedState { last_clock, leg_start, leg_duration, ..InterpolatedState::new(table) };
        }
        self.advance(table, span.start - self.time);
    }

    /// Puts the first step of the leg at its start, and ends the leg after its duration less `slack` s for
    /// rounding. The reference also counts the time that the change of legs took (spec kinematics §2.6).
    pub(super) fn start_on_time(&mut self, clock: f64, slack: f64) {
        (self.last_clock, self.slack) = (clock, slack);
    }

    #[inline]
    pub(super) fn step(&mut self, table: &TrajectoryTable, clock: f64) {
        let elapsed = clock - self.last_clock;
        self.last_clock = clock;
        self.advance(table, elapsed);
    }

    /// The state `seconds` after the last step.
    pub(super) fn after(&self, table: &TrajectoryTable, seconds: f64) -> InterpolatedState {
        let mut later = self.clone();
        later.advance(table, seconds);
        later
    }

    /// Duration of the leg after `clock`, s.
    pub(crate) fn time_left(&self, clock: f64) -> f64 {
        self.leg_start + self.leg_duration - self.slack - clock
    }

    #[inline]
    fn advance(&mut self, table: &TrajectoryTable, mut elapsed: f64) {
        let rows = table.rows();
        let goal = self.time + elapsed;
        let last = rows.len().saturating_sub(2);
        let mut row = self.row;
        while row < last && rows[row + 1].time <= goal {
            row += 1;
        }
        if row != self.row {
            self.row = row;
            self.time = rows[row].time;
            self.values = rows[row].values;
            elapsed = goal - self.time;
        }
        let slopes = &rows[row].slopes;
        for (value, slope) in self.values.iter_mut().zip(slopes) {
            *value += elapsed * slope;
        }
        self.time += elapsed;
    }

    pub(super) fn is_over(&self, clock: f64) -> bool {
        clock + self.slack >= self.leg_start + self.leg_duration
    }

    pub(super) fn progress(&self, clock: f64) -> f64 {
        fraction(clock - self.leg_start, self.leg_duration)
    }

    pub(super) fn position(&self) -> DVec3 {
        DVec3::new(self.values[3], self.values[4], self.values[5])
    }

    /// Velocity between the rows around the last step, m/s.
    pub(super) fn velocity(&self, table: &TrajectoryTable) -> DVec3 {
        let [.., x, y, z] = table.rows().get(self.row).map_or([0.0; 6], |row| row.slopes);
        DVec3::new(x, y, z)
    }

    pub(super) fn attitude(&self, spec: RotationSpec) -> Rotation {
        let [roll, pitch, yaw, ..] = self.values;
        composed(spec, roll, pitch, yaw)
    }
}

/// The attitude of recorded angles in radians.
pub(super) fn composed(spec: RotationSpec, roll: f64, pitch: f64, yaw: f64) -> Rotation {
    match spec {
        RotationSpec::Arinc705 => {
            Rotation::about_z(-yaw).after(Rotation::about_y(roll)).after(Rotation::about_x(pitch))
        }
        RotationSpec::Canonical => {
            Rotation::about_x(roll).after(Rotation::about_y(pitch)).after(Rotation::about_z(yaw))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_reset_at_rows_and_extrapolated_beyond_the_last() {
        let rows = [(0.0, 0.0), (1.0, 10.0), (2.0, 20.0), (4.0, 40.0)];
        let table =
            TrajectoryTable::new(rows.map(|(t, x)| (t, [0.0, 0.0, 0.0, x, 0.0, 0.0])).to_vec()).unwrap();
        let mut s = InterpolatedState::new(&table);
        s.start_leg(&table, Some(Span { start: 0.5, end: 9.0 }), 0.0);
        assert_eq!(s.position().x, 5.0);
        s.step(&table, 2.5);
        assert_eq!((s.position().x, s.row), (30.0, 2));
        s.step(&table, 4.5);
        assert_eq!(s.position().x, 50.0);
        s.start_leg(&table, Some(Span { start: 0.25, end: 9.0 }), 4.5);
        assert_eq!((s.position().x, s.row), (2.5, 0));
    }

    #[test]
    fn arinc_headings_turn_clockwise() {
        let east = composed(RotationSpec::Arinc705, 0.0, 0.0, 90f64.to_radians()).forward();
        assert!((east - DVec3::X).length() < 1e-12);
        let west = composed(RotationSpec::Canonical, 0.0, 0.0, 90f64.to_radians()).forward();
        assert!((west + DVec3::X).length() < 1e-12);
    }
}
