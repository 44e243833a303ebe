//! Reasons why no flight is fitted to a recording.

use std::fmt;
use vlscan_base::diag::Problem;

/// A recording that no flight matches.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FlightError {
    /// Pulse times without the pattern of a mirror.
    #[error("the pulse times show neither circles nor lines across the track")]
    NoPattern,
    /// Solutions that do not explain the points, one for each kind of mirror.
    #[error("{}", joined(.0))]
    Unexplained(Vec<Misfit>),
}

impl Problem for FlightError {}

/// The reason against a kind of mirror.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Misfit {
    /// The kind of mirror, with channels and facets.
    pub mirror: String,
    /// The rest of a sentence about the solution with this mirror.
    pub reason: String,
}

impl fmt::Display for Misfit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.mirror, self.reason)
    }
}

fn joined(misfits: &[Misfit]) -> String {
    misfits.iter().map(Misfit::to_string).collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reason_against_each_mirror_is_named() {
        let misfit = |mirror: &str, reason: &str| Misfit { mirror: mirror.into(), reason: reason.into() };
        let all =
            vec![misfit("a cone", "misses them"), misfit("a polygon", "needs a mirror that hardly moves")];
        let text = FlightError::Unexplained(all).to_string();
        assert_eq!(text, "a cone misses them; a polygon needs a mirror that hardly moves");
    }
}
