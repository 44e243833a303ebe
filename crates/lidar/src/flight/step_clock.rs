//! The clock by which platforms move.

use vlscan_survey::PulseTimes;

/// The step clock at a step.
#[derive(Clone, Copy, Debug)]
pub(super) enum StepClock<'p> {
    /// Counts the ticks of the run, of `period` seconds.
    Run { ticks: u64, period: f64 },
    /// Counts the ticks of a leg from `base` seconds on.
    Leg { base: f64, ticks: u64, frequency: f64 },
    /// Has times of a leg from `base` seconds on.
    Times { base: f64, ticks: u64, times: &'p PulseTimes },
}

impl StepClock<'_> {
    /// Time after `steps` more steps, s.
    #[inline]
    pub fn after(self, steps: u32) -> f64 {
        match self {
            StepClock::Run { ticks, period } => (ticks + u64::from(steps)) as f64 * period,
            StepClock::Leg { base, ticks, frequency } => base + (ticks + u64::from(steps)) as f64 / frequency,
            StepClock::Times { base, ticks, times } => base + times.at(ticks + u64::from(steps)),
        }
    }
}
