//! Plans surveys: legs from an area, a plot or a line, with overlap, density, spacing and height above the
//! ground. What an instrument sees is sampled from the optics that the simulator turns, and a sample of the
//! planned flight is flown to check the plan's figures. A plan is written as a pipeline file with its figures
//! in comments.
//!
//! | file | what it does |
//! |---|---|
//! | `error` | problems of plans |
//! | `area`, `corridor` | polygons and boxes; areas beside a line |
//! | `area_file`, `geometries` | areas and lines from files, in the scene's coordinates; GeoJSON, KML, GPX, well-known text |
//! | `vector` | shapefiles, GeoPackages, KMZ |
//! | `swath` | scans within the limits of an instrument |
//! | `beams` | where the beams of a scan meet flat ground; mounts that point them there |
//! | `reach` | how far a device measures ground |
//! | `line`, `bends` | flight lines and the turns between them; lines that follow bends |
//! | `height` | the ground below a flight, heights that follow it |
//! | `airborne`, `requirements` | parallel flight lines, cross lines, lines beside a line; what is required of them |
//! | `choice`, `report` | their speed, distance, scan and pulse rate; what such a plan promises |
//! | `flown` | a sample of a planned flight against its promise |
//! | `terrestrial` | positions of a tripod on a grid or around a plot |
//! | `mobile` | a vehicle along a line |
//! | `document` | the pipeline file |
//! | `lines` | lines and positions as GeoJSON, KML and CSV |
//! | `request` | what a survey is planned from |

#![allow(
    rustdoc::broken_intra_doc_links,
    reason = "comments on options are shown as help, where defaults stand in brackets"
)]

mod airborne;
mod area;
mod area_file;
mod beams;
mod bends;
mod choice;
mod corridor;
mod document;
mod error;
mod flown;
mod geometries;
mod height;
mod line;
mod lines;
mod mobile;
mod reach;
mod report;
mod request;
mod requirements;
mod swath;
mod terrestrial;
#[cfg(test)]
mod testing;
mod vector;

pub use airborne::{plan_airborne, plan_corridor};
pub use area::{Area, AreaError};
pub use area_file::{read_area, read_corridor, read_line};
pub use beams::QuarterTurns;
pub use document::{PlannedSurvey, Promise, Turned, Waypoint};
pub use error::{PlanError, Resolution};
pub use flown::{Flown, fly_sample};
pub use height::PlanGround;
pub use lines::{LineFormat, PlanLine, lines_of, plan_lines};
pub use mobile::{MobileOptions, plan_mobile};
pub use reach::{Reach, Seen};
pub use request::{AirborneRequest, AreaSource, MobileRequest, PlanRequest, PlanSetup, TerrestrialRequest};
pub use requirements::{AirborneOptions, Carrier};
pub use swath::{Scan, SwathModel};
pub use terrestrial::{TerrestrialOptions, check_terrestrial, plan_terrestrial};
