//! Poses and pulses of a flight as rows of text or of an Arrow table.

use super::emit::{Emission, Emitted, emit};
use super::pass::RunContext;
use super::session::Session;
use super::settings::Settings;
use crate::streams::{
    ColumnSet, POSE_HEADER, PulseColumn, PulseRow, TableColumn, TableWriter, default_columns, header,
    pose_columns, pulse_columns, push_pose, push_pose_row, push_pulse, push_pulse_row, with_errors,
    with_reported,
};
use vlscan_base::diag::Notice;
use vlscan_base::error::{Error, Result};
use vlscan_geom::DVec3;
use vlscan_survey::Survey;

/// Default interval between poses, s.
const POSE_INTERVAL: f64 = 0.05;

/// The rows that a flight is written as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlightRows {
    /// Poses of the platform.
    Poses,
    /// Emitted pulses.
    Pulses,
}

impl FlightRows {
    /// Changes a survey so that it is flown for these rows: `interval` is the time from pose to pose, by
    /// default that of each leg or else 0.05 s; no poses are emitted with pulses.
    pub fn prepare(self, survey: &mut Survey, interval: Option<f64>) {
        for leg in &mut survey.legs {
            let own = leg.scanner.trajectory_interval;
            leg.scanner.trajectory_interval = match self {
                FlightRows::Poses => interval.unwrap_or(if own > 0.0 { own } else { POSE_INTERVAL }),
                FlightRows::Pulses => 0.0,
            };
        }
    }

    /// The line of names.
    pub fn header(self, flight: &Flight) -> String {
        match self {
            FlightRows::Poses => POSE_HEADER.to_owned(),
            FlightRows::Pulses => header(flight.columns),
        }
    }

    /// The columns of a table.
    pub fn columns(self, flight: &Flight) -> Vec<TableColumn> {
        match self {
            FlightRows::Poses => pose_columns(),
            FlightRows::Pulses => pulse_columns(flight.columns),
        }
    }

    /// Appends the emitted rows as lines of text, or as values for [`TableWriter`].
    pub fn push(self, flight: &Flight, emitted: &Emitted, as_text: bool, out: &mut Vec<u8>) {
        match self {
            FlightRows::Poses => {
                let push = if as_text { push_pose } else { push_pose_row };
                for pose in &emitted.poses {
                    push(
                        out,
                        &if flight.as_flown { pose.as_flown() } else { *pose },
                        (flight.shift, emitted.time_origin),
                    );
                }
            }
            FlightRows::Pulses => {
                let push = if as_text { push_pulse } else { push_pulse_row };
                let divergence = flight.divergences.get(emitted.leg as usize).copied();
                let (leg, epoch) = (emitted.leg, emitted.epoch);
                for &(mut pulse, step) in &emitted.pulses {
                    pulse.time_ns += emitted.time_origin * 1e9;
                    let row = PulseRow { pulse, leg, step, epoch, divergence };
                    push(out, &row, flight.columns, flight.shift);
                }
            }
        }
    }
}

/// Properties of the flight that the rows depend on.
pub struct Flight {
    shift: DVec3,
    columns: ColumnSet,
    /// True if poses are true poses, not reported ones.
    as_flown: bool,
    /// Divergence at the start of the survey and in the leg, by leg, rad.
    divergences: Vec<[f64; 2]>,
}

impl Flight {
    /// The properties of `emission`; streams with navigation errors have columns for them.
    pub fn new(emission: &Emission, has_errors: bool, as_flown: bool) -> Flight {
        let (survey, shift) = (&emission.survey, emission.shift);
        let own = survey.scanner.devices[0].beam.divergence;
        let of_legs: Vec<f64> = survey.legs.iter().map(|l| l.scanner.beam_divergence).collect();
        let start = of_legs.first().copied().unwrap_or(own);
        let mut columns = default_columns();
        if survey.scanner.devices.iter().any(|d| d.errors.any()) {
            columns = with_errors(columns);
        }
        if has_errors {
            columns = with_reported(columns);
        }
        if of_legs.iter().any(|d| *d != own) {
            columns = columns.with(PulseColumn::Divergence).with(PulseColumn::StartDivergence);
        }
        if emission.epochs > 1 {
            columns = columns.with(PulseColumn::Epoch);
        }
        Flight {
            shift,
            columns,
            as_flown,
            divergences: of_legs.into_iter().map(|leg| [start, leg]).collect(),
        }
    }
}

/// Flies a survey and returns its poses or pulses as an Arrow IPC stream, with the columns of
/// `vlscan trajectory` and `vlscan pulses`. `interval` is the time from pose to pose, s; `as_flown` asks for
/// true poses, without errors of navigation.
///
/// # Errors
/// The errors of [`Session::open_for_flight`] and of [`emit`](super::emit()); [`Error::Interrupted`].
pub fn flight_table(
    mut settings: Settings,
    rows: FlightRows,
    (interval, as_flown): (Option<f64>, bool),
    observer: impl Fn(Notice) + Send + Sync + 'static,
    control: RunContext<'_>,
) -> Result<Vec<u8>> {
    rows.prepare(&mut settings.survey, interval);
    let has_errors = settings.flight.navigation.any();
    let stop = control.stop;
    let emission = Session::open_for_flight(settings, observer)?.into_emission()?;
    let flight = Flight::new(&emission, has_errors, as_flown);
    let failed = |e| Error::io("write", "a table in memory", e);
    let out = TableWriter::begin(rows.columns(&flight), false, Vec::new()).map_err(failed)?;
    let encode = |emitted: &Emitted, out: &mut Vec<u8>| rows.push(&flight, emitted, false, out);
    let out = emit(emission, control, encode, out)?;
    if stop.is_requested() {
        return Err(Error::Interrupted);
    }
    out.finish().map_err(failed)
}
