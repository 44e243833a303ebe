//! The clock of a survey: legs, steps and pulses. Platform and scanner move here, one step per pulse period.
//!
//! A [`FlightPlan`] is made once from a survey. A [`FlightState`] is a snapshot of a flight: the producer of
//! chunks steps one and clones it from time to time, and workers replay the same steps from the clones. Both
//! run the same arithmetic, so that the pulses do not depend on where the chunks were cut.
//!
//! | file | what it does |
//! |---|---|
//! | `plan`, `leg`, `settings` | the plan, its legs, checks of the survey |
//! | `state`, `advance` | steps: clocks, changes of legs, devices; many steps at once |
//! | `clock`, `step_clock` | GPS time; the clock by which platforms move |
//! | `guard` | detects legs that never end |
//! | `pulse`, `emission` | pulses and trajectory samples; how a pulse is composed |
//! | `noise`, `navigation` | noise of the pose, errors of the reported pose |
//! | `positions`, `beams`, `jump` | positions along a flight and its beams before it is flown; states far ahead for forecasts |

mod advance;
mod beams;
mod clock;
mod emission;
mod guard;
mod jump;
mod leg;
mod navigation;
mod noise;
mod plan;
mod positions;
mod pulse;
mod settings;
mod state;
mod step_clock;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;

pub use advance::Skipped;
pub use clock::{DEFAULT_DAY, TimeError, calendar_day, default_gps_start, gps_start};
pub use jump::LegClock;
pub use plan::{FlightOptions, FlightPlan};
pub use positions::PlannedPosition;
pub use pulse::{FlightSink, PoseSample, Pulse};
pub use state::{FlightState, Step};
