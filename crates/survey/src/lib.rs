//! Surveys and scenes as their files describe them, with every template, default and unit resolved. Geometry is not
//! loaded here.
//!
//! | file | what it does |
//! |---|---|
//! | `model` | the plain values that every reader produces |
//! | `text`, `xml`, `xml_limits` | bytes to text; XML as owned elements with their places in the file; how large it may be |
//! | `shipped`, `assets`, `catalogue` | the built-in files; the search path; the built-in scanners and platforms |
//! | `context`, `fields`, `documents` | the problems of one run of a reader; typed attributes of an element; documents and references |
//! | `read` | the entry points: a survey, a scene, a scanner |
//! | `survey_xml`, `settings`, `templates`, `legs`, `trajectories` | the `<survey>` element: templates, legs, trajectories |
//! | `follow` | surveys that follow a stream of poses; devices, scanners and legs with default settings |
//! | `checks`, `effects` | checks that need the complete survey: limits, legs that never end; settings that are limited or have no effect |
//! | `scanner_xml`, `deflector_xml`, `receiver_xml`, `pulse_file`, `platform_xml` | instruments and platforms |
//! | `scene_xml`, `params`, `loaders`, `instances`, `motions` | the parts of a scene |
//! | `pipeline` | pipeline files |
//! | `foreign` | endings of mesh files, and mesh formats that are not read |
//! | `formula`, `seed` | formulas of calibration errors; the formats of a seed |

#![deny(unsafe_code)]

mod assets;
mod catalogue;
mod checks;
mod context;
mod deflector_xml;
mod documents;
mod effects;
mod fields;
mod follow;
mod foreign;
pub mod formula;
mod instances;
mod legs;
mod loaders;
mod model;
mod motions;
mod params;
mod pipeline;
mod platform_xml;
mod pulse_file;
mod read;
mod receiver_xml;
mod scanner_xml;
mod scene_xml;
mod seed;
mod settings;
mod shipped;
mod survey_xml;
mod templates;
#[cfg(any(test, feature = "testkit"))]
#[doc(hidden)]
pub mod testkit;
#[cfg(test)]
mod tests;
mod text;
mod trajectories;
mod xml;
mod xml_limits;

pub use catalogue::catalogue;
pub use context::{ReadOptions, SceneChoice};
pub use foreign::foreign_format;
pub use formula::Formula;
pub use model::*;
pub use motions::rounded_steps;
pub use pipeline::{KeyTable, SURVEY_TABLES, Source, Tables, field_names, read_pipeline_survey};
pub use read::{find_platform, find_scanner, read_scene, read_survey};
pub use seed::parse_seed;
pub use text::decode_table;
pub use xml_limits::MAX_DOCUMENT_BYTES;
