//! Errors of navigation: the difference between the pose that a platform reports and the one that it flew.

use vlscan_base::quantity;
use vlscan_geom::radians;

/// Errors of position and attitude as the navigation system reports them, and of the scanner's calibration.
/// The beam is traced from the true pose; points are georeferenced with the reported pose. All 0 means no
/// error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NavigationErrors {
    /// Standard deviation of the position to the east, north and up, m.
    pub position: [f64; 3],
    /// Correlation time of the position's errors, s.
    pub position_correlation: f64,
    /// Constant error of the position, m.
    pub position_bias: [f64; 3],
    /// Standard deviation of roll, pitch and heading, rad.
    pub attitude: [f64; 3],
    /// Correlation time of the attitude's errors, s.
    pub attitude_correlation: f64,
    /// Constant error of roll, pitch and heading, rad.
    pub attitude_bias: [f64; 3],
    /// Growth of the error of roll, pitch and heading from the flight's start, rad/s.
    pub attitude_drift: [f64; 3],
    /// Error of the boresight: roll, pitch, heading, rad.
    pub boresight: [f64; 3],
    /// Standard deviation of a boresight error that is drawn once per run, rad.
    pub boresight_sigma: [f64; 3],
    /// Error of the lever arm to the right, forward and up, m.
    pub lever_arm: [f64; 3],
    /// Standard deviation of a lever arm error that is drawn once per run, m.
    pub lever_arm_sigma: [f64; 3],
}

/// Keys of `[navigation_errors]` and of `--navigation-error`, and their meanings.
const KEYS: [(&str, &str); 11] = [
    ("position_m", "Standard deviation of the position to the east, north and up, m."),
    ("position_correlation_s", "Correlation time of the position's errors, s. Default: 300."),
    ("position_bias_m", "Constant error of the position to the east, north and up, m."),
    ("attitude_deg", "Standard deviation of roll, pitch and heading, degrees."),
    ("attitude_correlation_s", "Correlation time of the attitude's errors, s. Default: 60."),
    ("attitude_bias_deg", "Constant error of roll, pitch and heading, degrees."),
    (
        "attitude_drift_deg_per_h",
        "Growth of the error of roll, pitch and heading from the flight's start, degrees per hour.",
    ),
    ("boresight_deg", "Error of the boresight, degrees: roll, pitch, heading."),
    (
        "boresight_sigma_deg",
        "Standard deviation of a boresight error that is drawn once for the run, degrees.",
    ),
    ("lever_arm_m", "Error of the lever arm to the right, forward and up, m."),
    ("lever_arm_sigma_m", "Standard deviation of a lever arm error that is drawn once for the run, m."),
];

impl NavigationErrors {
    /// No errors; the correlation times are typical of a processed GNSS solution and of a tactical IMU aided
    /// by it.
    pub const NONE: NavigationErrors = NavigationErrors {
        position: [0.0; 3],
        position_correlation: 300.0,
        position_bias: [0.0; 3],
        attitude: [0.0; 3],
        attitude_correlation: 60.0,
        attitude_bias: [0.0; 3],
        attitude_drift: [0.0; 3],
        boresight: [0.0; 3],
        boresight_sigma: [0.0; 3],
        lever_arm: [0.0; 3],
        lever_arm_sigma: [0.0; 3],
    };

    /// Names of all keys, and their meanings. Standard deviations belong to first-order Gauss-Markov
    /// processes, whose correlation falls by a factor e within the correlation time. Every key but the
    /// correlation times takes one number for all three components, or three numbers.
    pub const KEYS: &[(&str, &str)] = &KEYS;

    /// True if any error, bias, drift or misalignment is not 0; correlation times do not count.
    pub fn any(&self) -> bool {
        let vectors = [
            self.position,
            self.position_bias,
            self.attitude,
            self.attitude_bias,
            self.attitude_drift,
            self.boresight,
            self.boresight_sigma,
            self.lever_arm,
            self.lever_arm_sigma,
        ];
        vectors.iter().flatten().any(|v| *v != 0.0)
    }

    /// Sets the errors of `key` to one number (for all three components) or to three.
    ///
    /// # Errors
    /// [`NavigationKeyError`], which describes the expected value.
    pub fn set(&mut self, key: &str, numbers: &[f64]) -> Result<(), NavigationKeyError> {
        let error = |problem| NavigationKeyError { key: key.to_owned(), problem };
        let three = match numbers {
            [one] => [*one; 3],
            [a, b, c] => [*a, *b, *c],
            _ => return Err(error(NavigationProblem::Count(numbers.len()))),
        };
        if let Some(wrong) = numbers.iter().find(|v| !quantity::NUMBER.contains(**v)) {
            return Err(error(NavigationProblem::OutOfRange(*wrong)));
        }
        let sigma = || match three.iter().find(|v| **v < 0.0) {
            Some(wrong) => Err(error(NavigationProblem::Negative(*wrong))),
            None => Ok(three),
        };
        let seconds = || match numbers {
            [s] if quantity::POSITIVE.contains(*s) => Ok(*s),
            _ => Err(error(NavigationProblem::NoTime)),
        };
        match key {
            "position_m" => self.position = sigma()?,
            "position_correlation_s" => self.position_correlation = seconds()?,
            "position_bias_m" => self.position_bias = three,
            "attitude_deg" => self.attitude = sigma()?.map(radians),
            "attitude_correlation_s" => self.attitude_correlation = seconds()?,
            "attitude_bias_deg" => self.attitude_bias = three.map(radians),
            "attitude_drift_deg_per_h" => self.attitude_drift = three.map(|v| radians(v) / 3600.0),
            "boresight_deg" => self.boresight = three.map(radians),
            "boresight_sigma_deg" => self.boresight_sigma = sigma()?.map(radians),
            "lever_arm_m" => self.lever_arm = three,
            "lever_arm_sigma_m" => self.lever_arm_sigma = sigma()?,
            _ => return Err(error(NavigationProblem::Unknown)),
        }
        Ok(())
    }
}

/// Numbers that a key of [`NavigationErrors`] does not take.
#[derive(Clone, Debug, PartialEq)]
pub struct NavigationKeyError {
    /// The key.
    pub key: String,
    /// Problem with its numbers.
    pub problem: NavigationProblem,
}

/// Problem with a key of [`NavigationErrors`] and its numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NavigationProblem {
    /// There is no such key.
    Unknown,
    /// This many numbers, neither one nor three.
    Count(usize),
    /// A number that is not finite or too large.
    OutOfRange(f64),
    /// A standard deviation below 0.
    Negative(f64),
    /// No single time above 0.
    NoTime,
}

impl std::fmt::Display for NavigationKeyError {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let key = &self.key;
        match self.problem {
            NavigationProblem::Unknown => {
                let known = KEYS.map(|(name, _)| name).join(", ");
                write!(f, "no error of navigation is called `{key}`; there are {known}")
            }
            NavigationProblem::Count(found) => {
                write!(f, "{key}: expected one number or three, found {found}")
            }
            NavigationProblem::OutOfRange(found) => {
                write!(f, "{key}: expected finite numbers from -1e12 to 1e12, found {found:?}")
            }
            NavigationProblem::Negative(found) => {
                write!(f, "{key}: expected a standard deviation of at least 0, found {found}")
            }
            NavigationProblem::NoTime => write!(f, "{key}: expected one number of seconds above 0"),
        }
    }
}

impl std::error::Error for NavigationKeyError {}

impl Default for NavigationErrors {
    fn default() -> NavigationErrors {
        NavigationErrors::NONE
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_set_one_number_or_three_in_their_units() {
        let mut e = NavigationErrors::NONE;
        assert!(!e.any());
        for (key, _) in NavigationErrors::KEYS {
            assert!(e.set(key, &[1.0]).is_ok(), "{key}");
            assert!(e.set(key, &[f64::NAN]).is_err() && e.set(key, &[1.0, 2.0]).is_err(), "{key}");
        }
        assert!(e.any());
        e.set("attitude_drift_deg_per_h", &[3600.0, 0.0, -7200.0]).unwrap();
        assert_eq!(e.attitude_drift, [radians(1.0), 0.0, radians(-2.0)]);
        e.set("position_m", &[0.02]).unwrap();
        assert_eq!((e.position, e.boresight), ([0.02; 3], [radians(1.0); 3]));
        assert!(e.set("position_m", &[-1.0]).unwrap_err().to_string().contains("standard deviation"));
        assert!(e.set("position_correlation_s", &[0.0]).unwrap_err().to_string().contains("above 0"));
        assert!(e.set("pos", &[1.0]).unwrap_err().to_string().contains("position_bias_m"));
    }
}
