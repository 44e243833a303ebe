//! Pipeline files: a complete run in one TOML file. The options of the run are read by the program, the
//! survey here.
//!
//! | file | what it does |
//! |---|---|
//! | `source` | the text and its tables; all problems of one file at once |
//! | `scanners` | one of several `[[scanner]]` tables in the place of all |
//! | `words` | errors of TOML in the words of its users |
//! | `build`, `parts` | builds the survey and its scene from the keys |

mod build;
mod parts;
mod scanners;
pub(crate) mod source;
pub(crate) mod words;

pub use scanners::ChosenScanner;
pub use source::{Source, Tables, field_names};

use super::Survey;
use super::context::{Context, ReadOptions};
use super::fields::Fields;
use super::keys::SurveyKeys;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::Result;

/// The survey of a pipeline file.
#[derive(Clone, Debug)]
pub struct PipelineSurvey {
    /// The survey.
    pub survey: Survey,
    /// True if the file itself describes a flight, instead of taking that of a survey file.
    pub has_own_flight: bool,
    /// True if the file changes the survey of an XML file, instead of describing its own.
    pub is_of_survey: bool,
}

/// Reads the survey of a pipeline file from the tables whose other keys have been taken. The second value
/// contains the warnings to be shown.
///
/// # Errors
/// All problems of all files at once as [`vlscan_base::Error::Input`]; limits of the scanner as
/// [`vlscan_base::Error::Limits`]; [`vlscan_base::Error::Io`] when a file cannot be read.
pub fn read_pipeline_survey(tables: Tables, options: &ReadOptions) -> Result<(PipelineSurvey, Diagnostics)> {
    let source = tables.source();
    let (root, names, problems) = tables.finish();
    let context = Context::new(options);
    context.take(problems);
    let mut fields = Fields::of_table(&context, source, &root, 0..0);
    let survey = build::read_survey(&mut fields, source, options).map(|(survey, has_legs)| {
        let is_of_survey = fields.has(SurveyKeys::KEYS.survey);
        let has_own_flight = !is_of_survey || has_legs;
        PipelineSurvey { survey, has_own_flight, is_of_survey }
    });
    fields.suggest(&names);
    fields.ignore(SurveyKeys::ALL);
    fields.done(&[]);
    context.finish(survey)
}
