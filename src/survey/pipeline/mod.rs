//! Pipeline files: a whole run in one TOML file.
//!
//! | file | what it does |
//! |---|---|
//! | `keys` | every key of a pipeline file, documented |
//! | `source` | the text with its places; all problems of one file at once |
//! | `build` | keys to a survey |
//! | `instrument` | the `[scanner]` table |
//! | `trajectory` | the `[trajectory]` table |
//! | `run` | keys to run settings |
//! | `output` | those of them that say what is written |

mod build;
mod instrument;
pub mod keys;
mod output;
mod receiver;
mod run;
mod source;
mod trajectory;

pub use keys::PipelineKeys;
pub use output::OutputSettings;
pub use run::RunSettings;

use super::Survey;
use super::context::{Context, ReadOptions};
use crate::diag::Diagnostics;
use crate::error::{Error, Result};
use source::Source;
use std::path::Path;

/// What a pipeline file describes.
#[derive(Clone, Debug)]
pub struct Pipeline {
    /// What is flown and scanned.
    pub survey: Survey,
    /// How it is run; the command line overrides each of them.
    pub settings: RunSettings,
}

/// Reads a pipeline file (see [`PipelineKeys`] for its keys). The second value holds warnings to be shown.
///
/// # Errors
/// All problems of all files at once as [`Error::Input`]; limits of the scanner as [`Error::Limits`]; [`Error::Io`] when
/// the file cannot be read.
pub fn read_pipeline(path: &Path, options: &ReadOptions) -> Result<(Pipeline, Diagnostics)> {
    let bytes = std::fs::read(path).map_err(|e| Error::io("read", path, e))?;
    let mut problems = Diagnostics::default();
    let read = Source::new(path, &bytes, &mut problems).and_then(|source| {
        let keys = source.keys(&mut problems)?;
        Some((source, keys))
    });
    let Some((source, keys)) = read else {
        return Err(problems
            .finish(true)
            .err()
            .unwrap_or_else(|| Error::Internal("a silent refusal".to_owned())));
    };
    let context = Context::new(&options_with(options, &keys, source.folder()));
    context.take(problems);
    let settings = run::read_settings(&context, &source, &keys);
    let survey = build::read_survey(&context, &source, &keys, options);
    let pipeline = survey.map(|survey| Pipeline {
        survey: Survey { crs_wkt: settings.crs.clone().or(survey.crs_wkt), ..survey },
        settings,
    });
    context.finish(pipeline)
}

/// The options of the caller with what the file adds.
fn options_with(options: &ReadOptions, keys: &PipelineKeys, folder: &Path) -> ReadOptions {
    let mut options = options.clone();
    options.assets.push(folder.to_path_buf());
    options.assets.extend(keys.assets.iter().map(|a| folder.join(a)));
    options.strict |= keys.strict.unwrap_or(false);
    options.max_memory = options.max_memory.or_else(|| run::max_memory(keys));
    options
}
