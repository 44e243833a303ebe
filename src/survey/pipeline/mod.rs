//! Pipeline files: a whole run in one TOML file. Its options are read by `crate::options`, its survey here.
//!
//! | file | what it does |
//! |---|---|
//! | `keys` | every key that describes the survey, documented |
//! | `source` | the text and its tables; all problems of one file at once |
//! | `values` | values of keys: numbers within their bounds, poses, references |
//! | `build` | keys to a survey |
//! | `instrument`, `receiver` | the `[scanner]` table |

mod build;
mod instrument;
pub mod keys;
mod receiver;
mod source;
mod values;

pub(crate) use keys::key_table;
pub use keys::{KeyTable, SURVEY_TABLES};
pub use source::{Source, Tables, field_names};

use super::Survey;
use super::context::{Context, ReadOptions};
use crate::diag::Diagnostics;
use crate::error::Result;

/// A survey that a pipeline file describes.
#[derive(Clone, Debug)]
pub struct PipelineSurvey {
    /// What is flown and scanned.
    pub survey: Survey,
    /// Whether the file describes a flight of its own, and not that of a survey file.
    pub has_own_flight: bool,
}

/// Reads the survey of a pipeline file from what its other readers have left of its tables. The second value holds
/// warnings to be shown.
///
/// # Errors
/// All problems of all files at once as [`crate::Error::Input`]; limits of the scanner as [`crate::Error::Limits`];
/// [`crate::Error::Io`] when a file cannot be read.
pub fn read_pipeline_survey(tables: Tables, options: &ReadOptions) -> Result<(PipelineSurvey, Diagnostics)> {
    let source = tables.source();
    let (keys, problems) = tables.finish();
    let context = Context::new(options);
    context.take(problems);
    let survey = keys.and_then(|keys| {
        let has_own_flight = keys.survey.is_none() || !keys.leg.is_empty();
        let survey = build::read_survey(&context, source, &keys, options)?;
        Some(PipelineSurvey { survey, has_own_flight })
    });
    context.finish(survey)
}
