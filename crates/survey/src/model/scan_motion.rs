//! Motion of a deflector, in addition to its frequency: sense, phase, tilt of its axis, wander.

use std::sync::Arc;
use vlscan_geom::radians;

/// Motion of a deflector. The default is the reference's: forward, from phase 0, about an axis of the
/// emitter, evenly.
///
/// Phases are angles, rad, in which 2π are a revolution (`conic`), a facet (`rotating`), a period
/// (`oscillating`), a sequence of fibres (`line`) or a turn of the first prism that turns (`risley`). Scan
/// patterns of a program have a tilt only.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ScanMotion {
    /// True if the deflector turns, swings or steps the other way.
    pub is_reversed: bool,
    /// Phase at the first pulse of a leg, where the deflector restarts, rad from 0 to 2π.
    pub phase: f64,
    /// Tilt of the axis, rad: angles about the emitter's x axis and then about its z axis by which the
    /// deflected beam is turned.
    pub axis_tilt: [f64; 2],
    /// Angle that is added to the phase over time.
    pub wander: Option<Wander>,
    /// Motion of an oscillating mirror.
    pub swing: Swing,
}

/// Motion of an oscillating mirror from one side to the other.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Swing {
    /// Evenly between reversals of constant acceleration, which take 50 pulses at each end as in the
    /// reference.
    #[default]
    TurningPulses,
    /// Evenly between reversals of constant acceleration, which take this share of the time of a sweep, half
    /// of it at each end, 0 to 1.
    TurningPart(f64),
    /// As a sine of the time.
    Sine,
}

/// An angle as a function of the time since the start of a leg.
#[derive(Clone, Debug, PartialEq)]
pub enum Wander {
    /// `amplitude · sin(2π · freq · t + phase)`.
    Sine {
        /// rad.
        amplitude: f64,
        /// Hz.
        freq: f64,
        /// rad.
        phase: f64,
    },
    /// Recorded angles, linear between two times and constant before the first and after the last one.
    Table(Arc<AngleTable>),
}

/// Angles at ascending times.
#[derive(Clone, Debug, PartialEq)]
pub struct AngleTable {
    /// Times since the start of the leg, s, ascending; at least one.
    pub times: Vec<f64>,
    /// Angles at these times, degrees.
    pub degrees: Vec<f64>,
}

impl Wander {
    /// The angle `time` seconds after the start of the leg, rad.
    pub fn at(&self, time: f64) -> f64 {
        match self {
            Wander::Sine { amplitude, freq, phase } => {
                amplitude * libm::sin(std::f64::consts::TAU * (freq * time).fract() + phase)
            }
            Wander::Table(table) => radians(table.at(time)),
        }
    }

    /// The times, s, between which it is stated; `None` if it is for all times.
    pub fn span(&self) -> Option<(f64, f64)> {
        match self {
            Wander::Sine { .. } => None,
            Wander::Table(table) => table.times.first().copied().zip(table.times.last().copied()),
        }
    }
}

impl AngleTable {
    fn at(&self, time: f64) -> f64 {
        let next = self.times.partition_point(|t| *t <= time);
        let Some(before) = next.checked_sub(1) else { return self.degrees[0] };
        let (Some(t1), Some(a1)) = (self.times.get(next), self.degrees.get(next)) else {
            return self.degrees[before];
        };
        let (t0, a0) = (self.times[before], self.degrees[before]);
        a0 + (a1 - a0) * ((time - t0) / (t1 - t0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_linear_between_times_and_constant_beyond() {
        let table = AngleTable { times: vec![0.0, 1.0, 3.0], degrees: vec![2.0, 4.0, 0.0] };
        let wander = Wander::Table(Arc::new(table));
        for (time, degrees) in
            [(-1.0, 2.0), (0.0, 2.0), (0.25, 2.5), (1.0, 4.0), (2.5, 1.0), (3.0, 0.0), (9.0, 0.0)]
        {
            assert!((wander.at(time) - radians(degrees)).abs() < 1e-15, "{time}");
        }
        assert_eq!(wander.span(), Some((0.0, 3.0)));
    }

    #[test]
    fn sines_begin_at_their_phase() {
        let wander = Wander::Sine { amplitude: 0.1, freq: 4.0, phase: radians(30.0) };
        assert!((wander.at(0.0) - 0.05).abs() < 1e-15);
        // A third of 90 degrees later: 120 degrees.
        let later = wander.at(0.25 * 0.25);
        assert!((later - 0.1 * libm::cos(radians(30.0))).abs() < 1e-15, "{later}");
        assert!((wander.at(1e6) - 0.05).abs() < 1e-15);
    }
}
