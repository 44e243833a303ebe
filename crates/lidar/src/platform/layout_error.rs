//! Errors of the columns of poses.

use vlscan_base::diag::Problem;

/// Maximum number of columns.
pub(super) const MAX_COLUMNS: usize = 1000;
/// Names of columns that can be chosen.
const CHOICES: &str = "time, x, y, z, roll, pitch, yaw, lat, lon, qx, qy, qz, qw";

/// Columns of a table that are not those of poses.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PoseLayoutError {
    /// A column of other values than numbers.
    #[error("column `{column}` holds {holds}, expected numbers")]
    NotNumbers {
        /// The heading of the column.
        column: String,
        /// Description of its values.
        holds: &'static str,
    },
    /// A heading with a unit of another quantity.
    #[error("{what}")]
    Unit {
        /// The heading, its unit and the expected units.
        what: String,
    },
    /// Units below a heading that cannot be assigned to its columns.
    #[error("the units `{text}` are not one for each column; write them behind the names: x[ft]")]
    Units {
        /// The line of units.
        text: String,
    },
    /// Two columns of the same quantity.
    #[error(
        "columns `{earlier}` and `{name}` have the same meaning; rename one, or choose with \
         --trajectory-columns"
    )]
    Duplicate {
        /// The heading of the first column.
        earlier: String,
        /// The heading of the second column.
        name: String,
    },
    /// Quantities without a column.
    #[error("no column for {}{}", .quantities.join(", "), suggested(.suggestion))]
    Missing {
        /// Names of the quantities.
        quantities: Vec<&'static str>,
        /// A question about a heading that may be misspelt.
        suggestion: Option<String>,
    },
    /// Headings without any component of a pose.
    #[error("none of these names is that of a component of a pose")]
    NoNames,
    /// A table without names whose time is not known.
    #[error("no column is named as the time")]
    NoTime,
    /// A directive with another word than the number of a column.
    #[error("expected the number of a column below {MAX_COLUMNS}, found `{found}`")]
    TimeColumn {
        /// The word.
        found: String,
    },
    /// A chosen column without a number among others that have one.
    #[error("`{column}` has no number as the others have")]
    NoNumber {
        /// The choice.
        column: String,
    },
    /// A chosen column with an invalid number.
    #[error("`{column}`: expected a name and a number from 1 to {MAX_COLUMNS}, such as time=1")]
    Number {
        /// The choice.
        column: String,
    },
    /// A chosen column of an unknown quantity.
    #[error("`{name}` is none of {CHOICES}")]
    Unknown {
        /// The chosen name.
        name: String,
    },
    /// Two chosen columns of the same quantity.
    #[error("`{earlier}` and `{name}` have the same meaning")]
    DuplicateChoice {
        /// The first chosen name.
        earlier: String,
        /// The second chosen name.
        name: String,
    },
    /// Two quantities in the same column.
    #[error("{one} and {other} are both column {column}")]
    SameColumn {
        /// Name of the first quantity.
        one: &'static str,
        /// Name of the second quantity.
        other: &'static str,
        /// Number of the column, from 1.
        column: usize,
    },
    /// A chosen column that has no effect.
    #[error("`{name}` would not be read beside the other columns")]
    Unread {
        /// The chosen name.
        name: String,
    },
    /// An unknown number of columns without names.
    #[error(
        "{0} columns without names, expected 7: time, x, y, z, roll, pitch, yaw; or 8: time, x, y, z, qx, \
         qy, qz, qw with a quaternion of length 1"
    )]
    Count(usize),
    /// Positions and quaternions without times.
    #[error("columns 4 to 7 are a quaternion of length 1, and there is no time")]
    QuaternionWithoutTime,
    /// Matrices without times.
    #[error("3 × 4 matrices have no times")]
    MatrixWithoutTime,
    /// Times of matrices that cannot be read.
    #[error("{what}")]
    Times {
        /// The file and the reason.
        what: String,
    },
    /// A convention of angles for quaternions or matrices, or the reverse.
    #[error("{what}")]
    Convention {
        /// The convention and the columns.
        what: &'static str,
    },
}

fn suggested(question: &Option<String>) -> String {
    question.as_ref().map_or_else(String::new, |question| format!("; {question}"))
}

impl Problem for PoseLayoutError {}
