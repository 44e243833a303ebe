//! The clock of a survey: legs, steps and pulses. Platform and scanner move here, one step per pulse period.

mod pulse;

pub use pulse::{FlightSink, PoseSample, Pulse};
