//! Surveys of virtual laser scanning as plain values, with every template, default and unit resolved: from
//! HELIOS++ XML and from TOML. Geometry is not loaded here.
//!
//! * [`read_survey`] reads an XML survey, [`read_pipeline_survey`] a pipeline file. Both return a [`Survey`]:
//!   a [`Scanner`], a [`Platform`], [`Leg`]s and a [`SceneRecipe`].
//! * [`read_scene`], [`find_scanner`] and [`find_platform`] read only one of these,
//!   [`catalogue`](fn@catalogue) reads all built-in scanners and platforms.
//! * Every reader returns its value with warnings, or one error that lists all problems of all files, each
//!   with its place, the found and the expected value.
//! * [`INSTRUMENT_KEYS`] and [`SURVEY_TABLES`] list all settings, with their names in both formats and their
//!   bounds.
//!
//! Angles are radians, lengths metres, frequencies hertz, positions world coordinates. Comments cite sections
//! of `docs/dev/spec`, for example `spec input-formats §2.5`; *the reference* is HELIOS++, whose behaviour
//! these pages describe.
//!
//! | file | what it does |
//! |---|---|
//! | `model` | the plain values that every reader produces |
//! | `text`, `xml`, `xml_limits` | bytes to text; XML as owned elements with their places in the file; how large it may be |
//! | `shipped`, `assets`, `catalogue` | the built-in files; the search path; the built-in scanners and platforms |
//! | `keys` | names, bounds and use of every setting, in XML and TOML |
//! | `context`, `fields`, `documents` | the problems of one run of a reader; typed values of an element or a table; documents and references |
//! | `read` | the entry points: a survey, a scene, a scanner |
//! | `sources` | references and templates of a survey in XML |
//! | `survey_xml`, `settings`, `templates`, `legs`, `trajectories` | the `<survey>` element: templates, legs, trajectories |
//! | `toml` | pipeline files |
//! | `follow` | surveys that follow a stream of poses; scanners and legs with default settings |
//! | `checks`, `effects` | checks that need the complete survey: limits, legs that never end; settings that are limited or have no effect |
//! | `instrument`, `device`, `deflector`, `scan_motion`, `receiver`, `pulse_file` | instruments of both formats |
//! | `pulse_times` | times at which pulses leave, in place of a constant rate |
//! | `beams` | channels that differ by the directions of their beams |
//! | `weather` | fog, rain, snow and dust along the beam |
//! | `rings` | rows of channels, by elevation |
//! | `rows` | text files of a few columns of numbers |
//! | `pattern` | scan patterns of tables, correction files of spinning sensors |
//! | `ouster` | calibration files of Ouster sensors as instruments |
//! | `platform_xml` | platforms |
//! | `scene_xml`, `loaders`, `instances`, `motions` | the parts of a scene |
//! | `rasters`, `vrt` | files of terrain rasters: tiles in folders, virtual rasters of GDAL |
//! | `formula`, `seed` | formulas of calibration errors; the formats of a seed |

#![deny(unsafe_code)]

mod assets;
mod beams;
mod catalogue;
mod checks;
mod context;
mod deflector;
mod device;
mod documents;
mod effects;
mod fields;
mod follow;
pub mod formula;
mod instances;
mod instrument;
mod keys;
mod legs;
mod loaders;
mod model;
mod motions;
mod ouster;
mod pattern;
mod platform_xml;
mod pulse_file;
mod pulse_times;
mod rasters;
mod read;
mod receiver;
mod rings;
mod rows;
mod scan_motion;
mod scene_xml;
mod seed;
mod settings;
mod shipped;
mod sources;
mod survey_xml;
mod templates;
#[cfg(any(test, feature = "testkit"))]
#[doc(hidden)]
pub mod testkit;
#[cfg(test)]
mod tests;
mod text;
mod toml;
mod trajectories;
mod vrt;
mod weather;
mod xml;
mod xml_limits;

pub use self::toml::{ChosenScanner, PipelineSurvey, Source, Tables, field_names, read_pipeline_survey};
pub use catalogue::{Catalogue, catalogue, catalogue_files};
pub use context::{NumberColumns, ReadOptions, SceneChoice};
pub use documents::CATALOGUE;
pub use formula::{Formula, FormulaError};
pub use keys::{
    INSTRUMENT_KEYS, Key, KeyTable, KeyUse, SURVEY_TABLES, WrittenKey, key_named, named_as_in,
    warn_of_unused_keys,
};
pub use model::*;
pub use motions::rounded_steps;
pub use rasters::{find_raster, names_raster};
pub use read::{find_platform, find_scanner, read_scene, read_survey, read_survey_text};
pub use seed::{SeedError, parse_seed};
pub use sources::{LegTemplates, SurveySources, survey_sources};
pub use text::{NotText, decode_table};
pub use xml_limits::MAX_DOCUMENT_BYTES;

/// The example in the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
pub struct Readme;
