//! Recordings from which no sensor can be estimated.

use super::MIN_PLANES;
use vlscan_base::diag::Problem;

/// A recording from which noise and detection of a sensor cannot be estimated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SpinningError {
    /// Too few planes.
    #[error(
        "{0} planes were found, expected at least {min}; record walls, floors or roads",
        min = MIN_PLANES
    )]
    FewPlanes(usize),
    /// Planes without a reflectivity from which the maximum range follows.
    #[error("no plane has a reflectivity from 4 to 100, from which the maximum range follows")]
    NoReflectivity,
}

impl Problem for SpinningError {}
