//! Receivers that cannot be simulated.

use vlscan_base::diag::Problem;

/// A receiver that cannot be simulated.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ReceiverError {
    /// A counter of photons without a threshold.
    #[error(
        "a receiver that counts photons needs a threshold above 0, which tells how bright an echo of \
         `threshold_photons` is; state `max_range`"
    )]
    NoThreshold,
    /// Background light and dark counts that make too many returns.
    #[error(
        "{photons:.1e} photoelectrons a second of background light and dark counts make about {returns:.0} \
         returns per pulse, at most {max} are allowed; lower `background_w`, `dark_counts_hz` or `pixels`, \
         or limit the range with `range_max_m`"
    )]
    Background {
        /// Photoelectrons of background light and dark counts per second.
        photons: f64,
        /// Mean number of its returns per pulse.
        returns: f64,
        /// Maximum of that number.
        max: f64,
    },
    /// A threshold that the saturated output cannot reach.
    #[error(
        "the detection threshold of {threshold:.3e} W is not below the saturation at {saturation:.3e} W, so \
         that no echo can reach it; lower the threshold or raise the saturation"
    )]
    Saturation {
        /// Detection threshold, W.
        threshold: f64,
        /// Power at saturation, W.
        saturation: f64,
    },
    /// Noise that causes too many echoes.
    #[error(
        "a threshold of {threshold:.3e} W over noise of {noise:.3e} W makes about {alarms:.0} false alarms \
         per pulse, at most {max} are allowed; raise the threshold or limit the range"
    )]
    FalseAlarms {
        /// Detection threshold, W.
        threshold: f64,
        /// Standard deviation of the noise without light, W.
        noise: f64,
        /// Mean number of false alarms per pulse.
        alarms: f64,
        /// Maximum of that number.
        max: f64,
    },
}

impl Problem for ReceiverError {}
