//! Tools around a run: scenes and surveys that are made, campaigns of many runs, clouds that are compared
//! and drawn.
//!
//! | module | what it does |
//! |---|---|
//! | `args` | values of options: bounds, texts |
//! | `generate` | procedural scenes with the surveys that scan them; stands from inventories |
//! | `plan` | survey planning: legs from an area, a plot or a line, by what the instrument's optics see |
//! | `geotiff` | rasters as GeoTIFF |
//! | `chart` | charts as SVG and as pixels |
//! | `catalogue` | figures of instruments with their sources, fields of view, scan patterns |
//! | `cloud` | point clouds in memory, waveforms of single pulses |
//! | `kd_tree` | the points of a cloud that are nearest to a place |
//! | `neighbours` | the nearest points to a place, and the plane through them |
//! | `raster` | terrain, surface, canopy height and densities from point clouds |
//! | `frames` | frames of a scanner in the layouts of KITTI and nuScenes |
//! | `preview` | draws point clouds as PNG and as pages for a browser, and waveforms |
//! | `compare` | two point clouds of one place: heights, returns, pulses, residuals, change |
//! | `campaign` | many runs: scenes × variants × seeds, shared by processes without a server |

#![deny(unsafe_code)]

mod args;
pub mod campaign;
pub mod catalogue;
pub mod chart;
pub mod cloud;
pub mod compare;
pub mod frames;
pub mod generate;
pub mod geotiff;
mod kd_tree;
pub mod neighbours;
pub mod plan;
pub mod preview;
pub mod raster;

pub use args::OptionError;
