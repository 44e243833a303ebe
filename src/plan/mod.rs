//! Plans surveys: legs from an area, a plot or a line, with overlap, density, spacing and height above the ground, by the
//! closed formulas of survey planning. A plan is written as a pipeline file that tells its figures in comments.
//!
//! | file | what it does |
//! |---|---|
//! | `area` | polygons and lines, from GeoJSON, well-known text and boxes |
//! | `swath` | what an instrument does in a straight flight over flat ground: swath, rates, spacing, density |
//! | `line` | flight lines and the turns between them |
//! | `height` | the ground below a flight, heights that follow it |
//! | `airborne` | parallel flight lines, cross lines |
//! | `terrestrial` | positions of a tripod on a grid or around a plot |
//! | `mobile` | a vehicle along a line |
//! | `document` | the pipeline file |

mod airborne;
mod area;
mod document;
mod height;
mod line;
mod mobile;
mod swath;
mod terrestrial;

pub use airborne::{AirborneOptions, plan_airborne};
pub use area::{Area, read_area, read_line};
pub use document::Document;
pub use height::Ground;
pub use mobile::{MobileOptions, plan_mobile};
pub use swath::Instrument;
pub use terrestrial::{Arrangement, TerrestrialOptions, plan_terrestrial};
