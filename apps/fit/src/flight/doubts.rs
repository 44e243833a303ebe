//! Estimates that are not plausible: their keys are comments in the pipeline file, with the reason.

use super::ground::RangeScatter;
use super::rate::MAX_LOST_SHARE;
use super::{DOUBTFUL_RESIDUAL, FlightFit};
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_geom::degrees;

/// Minimum share of lost pulses that is checked, and its maximum standard deviation over the share.
const MIN_LOST: f64 = 0.005;
const MAX_LOST_DEVIATION: f64 = 0.5;
/// Share of the pulses without their first return above which points have been removed from the cloud.
const MAX_PARTIAL: f64 = 0.02;
/// Scan angle near the horizon, degrees, and the share of the pulses beyond it above which pulses may be
/// missing because they meet nothing.
const SLANT: f64 = 75.0;
const MAX_SLANTED: f64 = 0.01;
/// Relative standard deviation of the speed by unseen changes of the pitch above which it is doubtful.
const MAX_SPEED_DEVIATION: f64 = 0.01;
/// ASPRS class of ground.
const GROUND: u8 = 2;

/// A key of the pipeline file whose estimate is not plausible.
#[derive(Clone, Debug)]
pub(super) struct Doubt {
    pub key: &'static str,
    pub reason: String,
}

impl FlightFit {
    /// The keys whose estimates are not plausible, in the order of the pipeline file.
    pub(super) fn doubts(&self) -> Vec<Doubt> {
        let mut doubts = Vec::new();
        let miss = self.miss();
        let noise_doubt = |noise: &RangeScatter| noise.doubt().or_else(|| miss.clone());
        if let Some(reason) = self.noise.as_ref().and_then(noise_doubt) {
            doubts.push(Doubt { key: "accuracy_m", reason });
        }
        let rate = &self.rate;
        let is_uncertain = rate.lost_deviation > MAX_LOST_DEVIATION * rate.lost;
        let uncertain = || {
            is_uncertain.then(|| {
                format!(
                    "the share of lost pulses, {:.2} %, is uncertain by {:.2} %",
                    100.0 * rate.lost,
                    100.0 * rate.lost_deviation
                )
            })
        };
        let is_checked = (MIN_LOST..MAX_LOST_SHARE).contains(&rate.lost);
        let reason = self.missing_points().or_else(uncertain).filter(|_| is_checked);
        if let Some(reason) = reason.or_else(|| miss.clone().filter(|_| self.has_dropouts())) {
            doubts.push(Doubt { key: "dropout_rate", reason });
        }
        if self.has_varying_rate() && !rate.has_plausible_range() {
            let (low, high) = rate.range;
            let reason = format!(
                "pulse rates from {low:.0} to {high:.0} per second in a revolution are not plausible; the \
                 mean rate is written"
            );
            doubts.push(Doubt { key: "pulse_times", reason });
        } else if let Some(reason) = miss.filter(|_| self.has_varying_rate()) {
            doubts.push(Doubt { key: "pulse_times", reason });
        }
        doubts
    }

    /// True if the times of pulses are written.
    pub(super) fn has_pulse_times(&self) -> bool {
        self.has_varying_rate() && self.rate.has_plausible_range() && self.miss().is_none()
    }

    /// The reason against estimates that depend on directions of beams, if the flight misses its points.
    fn miss(&self) -> Option<String> {
        let residual = self.solution.residual;
        (residual > DOUBTFUL_RESIDUAL)
            .then(|| format!("the fitted flight misses its points by {residual:.2} m on the ground"))
    }

    /// The reason why the pulse rate, which the pipeline file needs, may be wrong.
    pub(super) fn doubt_of_rate(&self) -> Option<String> {
        let coarse = |step: f64| {
            format!("GPS times have steps of {:.3} µs, too coarse for the intervals of pulses", 1e6 * step)
        };
        let reason = self.rate.coarse_step.map(coarse).or_else(|| self.miss());
        reason.map(|reason| format!("doubtful: {reason}"))
    }

    /// The reason why the speed may be wrong.
    pub(super) fn doubt_of_speed(&self) -> Option<String> {
        let share = self.speed_by_pitch / self.solution.model.speed();
        (share > MAX_SPEED_DEVIATION).then(|| {
            format!(
                "the speed is known to {:.0} % only: over ground as flat as this, a pitch that changes \
                 steadily moves the points of these scan lines as another speed does",
                100.0 * share
            )
        })
    }

    /// True if the file has the share of lost pulses, at least as a comment. A small and uncertain share,
    /// such as that of a single gap, is left out.
    pub(super) fn has_dropouts(&self) -> bool {
        let rate = &self.rate;
        let is_insignificant = rate.lost < MIN_LOST && rate.lost_deviation > MAX_LOST_DEVIATION * rate.lost;
        rate.lost > 0.0 && rate.lost < MAX_LOST_SHARE && !is_insignificant
    }

    /// The reason why pulses may be missing that were not lost: their points have been removed from the
    /// cloud, or they met nothing.
    fn missing_points(&self) -> Option<String> {
        let recording = &self.recording;
        let slanted = recording.pulses.angles().filter(|angle| degrees(angle.abs()) > SLANT);
        let slanted = slanted.count() as f64 / recording.pulses.len() as f64;
        if slanted > MAX_SLANTED {
            return Some(format!(
                "{:.0} % of the pulses are beyond {SLANT}° from the vertical, where others may meet nothing",
                100.0 * slanted
            ));
        }
        if recording.partial > MAX_PARTIAL {
            let share = 100.0 * recording.partial;
            return Some(format!(
                "{share:.0} % of the pulses lack their first return: points have been removed from the cloud"
            ));
        }
        recording.pulses.iter().all(|pulse| pulse.class == GROUND).then(|| {
            "all points are of class 2 (ground): points of other surfaces may have been removed from the \
             cloud"
                .to_owned()
        })
    }

    /// Warns of each key that is left out.
    pub(super) fn warn_of_doubts(&self, found: &mut Diagnostics) {
        for doubt in self.doubts() {
            let message = format!("`{}` is left out: {}", doubt.key, doubt.reason);
            found
                .warn(Some(Place::of_file(&self.cloud)), message)
                .help("the pipeline file has the key as a comment; set the value of the instrument there");
        }
    }
}
