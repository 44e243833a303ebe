//! What is to be flown: surveys and scenes as their files describe them, with every template, default and unit
//! resolved, and nothing loaded yet.
//!
//! | file | what it does |
//! |---|---|
//! | `model` | the plain values that everything below produces |
//! | `text`, `xml` | bytes to text; XML as owned elements that know their places |
//! | `assets`, `catalogue` | where files are looked for; the scanners and platforms that ship |
//! | `context`, `fields` | problems met, documents opened, references; typed attributes of one element |
//! | `survey_xml`, `settings`, `legs`, `trajectories` | the `<survey>` element, templates, merging, interpolated platforms |
//! | `checks` | what can only be judged when all is read: limits, endless runs |
//! | `scanner_xml`, `deflector_xml`, `receiver_xml`, `pulse_file`, `platform_xml` | instruments and what carries them |
//! | `scene_xml`, `filters`, `loaders`, `motions` | parts of a scene |
//! | `pipeline` | our own pipeline files |
//! | `formula`, `seed` | formulas of calibration errors; the forms of a seed |

mod assets;
mod catalogue;
mod checks;
mod context;
mod deflector_xml;
mod fields;
mod fly;
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
mod survey_xml;
mod templates;
#[cfg(test)]
pub(crate) mod testkit;
#[cfg(test)]
mod tests;
mod text;
mod trajectories;
mod xml;

pub use catalogue::catalogue;
pub use context::ReadOptions;
pub use formula::Formula;
pub use model::*;
pub use pipeline::{OutputSettings, RunSettings, read_pipeline};
pub use read::{find_scanner, read_scene, read_survey};
pub use seed::parse_seed;
