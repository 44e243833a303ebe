//! The clock of a survey: legs, steps and pulses. Platform and scanner move here, one step per pulse period.
//!
//! A [`FlightPlan`] is made once from a survey. A [`FlightState`] is a snapshot of a run: the producer of chunks steps one
//! and clones it from time to time, and workers replay the same steps from the clones. Both run the same arithmetic, so
//! the pulses do not depend on where the chunks were cut.

mod clock;
mod guard;
mod navigation;
mod noise;
mod plan;
mod positions;
mod pulse;
mod settings;
mod state;

pub use clock::{calendar_day, gps_start};
pub use plan::{FlightOptions, FlightPlan};
pub use pulse::{FlightSink, PoseSample, Pulse};
pub use state::{FlightState, Step};

#[cfg(test)]
mod corrected;
#[cfg(test)]
mod golden;
#[cfg(test)]
mod reported;
#[cfg(test)]
mod testing;
