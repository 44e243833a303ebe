//! Surveys before they are flown, and by the hundred: plans that are checked, flights drawn over their scene,
//! data sets of many runs.
//!
//! | module | what it does |
//! |---|---|
//! | `named_scene` | scenes as commands name them |
//! | `planning` | plans surveys and checks them by a dry run |
//! | `sketch` | a survey over its scene, as points and as a picture |
//! | `campaign` | data sets of many runs |
//!
//! The parts that need no session are in [`vlscan_tools`].

#![deny(unsafe_code)]

mod campaign;
mod named_scene;
mod planning;
mod sketch;

#[doc(hidden)]
pub use campaign::options_of_campaigns;
pub use campaign::{Campaign, CampaignEvent, CampaignOptions, CampaignReport, FailedCell};
pub use named_scene::{NamedScene, Scanning};
pub use planning::plan_survey;
pub use sketch::{SurveySketch, scene_points, session_points, survey_points};
