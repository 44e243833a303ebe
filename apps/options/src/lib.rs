//! The options of a run, each defined once: its doc comment is the help of the command line, the manual page
//! and the documentation of the key in a pipeline file; its type parses the value wherever it is written.
//!
//! | file | what it does |
//! |---|---|
//! | `values` | types of values with a syntax of their own: counts, bytes, seeds, vectors |
//! | `systems` | coordinate reference systems and UTM zones |
//! | `choice` | values with names on the command line |
//! | `precedence` | the command line over the file over the default |
//! | `switch` | options without a value, and their opposites |
//! | `groups` | the groups of options, each a table of a pipeline file or a part of one |
//! | `trajectory` | options of recorded trajectories |
//! | `outputs` | the outputs of a pipeline file; from options to what is written |
//! | `scanners` | several scanners on one platform, and options that cannot serve all of them |
//! | `file` | reads surveys and pipeline files together with the options that they hold |
//! | `resolve` | from options to the settings of a session, with every choice resolved |
//! | `words` | options from words, and their list, for programs |
//! | `given` | options from values, for programs |
//! | `python` | options as a type of the Python package |
//! | `keys` | the documentation of every key of a pipeline file |
//! | `schema` | options and pipeline files as JSON Schema |

#![allow(
    rustdoc::broken_intra_doc_links,
    reason = "comments are shown as help, where units stand in brackets"
)]
#![deny(unsafe_code)]

mod choice;
mod file;
mod given;
mod groups;
mod keys;
pub mod outputs;
mod precedence;
mod python;
mod resolve;
mod scanners;
mod schema;
mod switch;
mod systems;
#[cfg(test)]
mod tests;
mod trajectory;
pub mod values;
mod words;

pub use choice::choice;
pub use file::{holds_survey, read_scanners, read_survey, read_survey_text};
pub use given::OptionValues;
pub use groups::{
    EchoOptions, InputOptions, NavigationOptions, NoiseOptions, Options, OriginOptions, OutputOptions,
    ProfileOptions, ScheduleOptions, TreeOptions,
};
pub use keys::{PipelineKey, PipelineTable, pipeline_keys};
#[doc(hidden)]
pub use precedence::Precedence;
#[doc(hidden)]
pub use python::python_module;
pub use resolve::{ResolvedRun, policy, schedule_of};
pub use scanners::ScannerSurvey;
#[doc(hidden)]
pub use schema::command_schema;
pub use schema::pipeline_schema;
pub use switch::Switch;
pub use trajectory::TrajectoryOptions;
pub use values::{
    Bytes, ChunkSize, Count, Crs, Divergence, MaxOrder, NotNegative, Positive, Seed, ValueError,
    WarehouseFactor,
};
pub use vlscan_session::shards::{OneOf, OneOfError};
pub use words::OptionName;
#[doc(hidden)]
pub use words::with_negative_numbers;
