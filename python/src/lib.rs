//! The compiled part of the Python module `vlscan`: scenes, runs and tables over the engine's sessions. The
//! classes that users see are in `python/vlscan`.
//!
//! | file | what it does |
//! |---|---|
//! | `errors` | errors and warnings of the engine as Python exceptions |
//! | `options` | options of runs as values |
//! | `numbers` | numbers of other libraries as numbers that the engine reads |
//! | `table` | record batches as NumPy columns and by the Arrow C data interface |
//! | `scene` | scenes of files and of arrays |
//! | `recipes` | parts of scene files and materials of files |
//! | `changes` | changes of the materials of parts |
//! | `cast` | rays without an instrument |
//! | `geometry` | primitives of scenes |
//! | `run` | runs: to memory, to files, batch by batch; Ctrl-C and progress |
//! | `batches` | runs whose points are taken while they are measured |
//! | `contents` | contents of the files of surveys |
//! | `catalogue` | lists of instruments, options and columns |
//! | `preview` | pictures and pages of points |
//! | `stages` | around a run: what it will cost, its poses and pulses, its shares |
//! | `read_points` | points of a file as a table |
//! | `clouds` | point clouds: files as tables, what they are, their rasters and frames |
//! | `tools` | plans, campaigns, comparisons |
//! | `make` | scenes that are made; the figures of instruments |
//! | `watch` | work on another thread, which Ctrl-C ends |

use pyo3::prelude::*;

mod batches;
mod cast;
mod catalogue;
mod changes;
mod clouds;
mod contents;
mod errors;
mod geometry;
mod make;
mod numbers;
mod options;
mod preview;
mod read_points;
mod recipes;
mod run;
mod scene;
mod stages;
mod table;
mod tools;
mod watch;

/// The engine of vlscan; use the package `vlscan`.
#[pymodule]
mod _vlscan {
    #[pymodule_export]
    use super::batches::BatchIterator;
    #[pymodule_export]
    use super::catalogue::{catalogue, catalogue_files, columns, keys, options, spectra};
    #[pymodule_export]
    use super::changes::Changes;
    #[pymodule_export]
    use super::clouds::{cloud_info, raster, read_points, write_frames};
    #[pymodule_export]
    use super::command;
    #[pymodule_export]
    use super::contents::contents;
    #[pymodule_export]
    use super::geometry::scene_geometry;
    #[pymodule_export]
    use super::make::{figures, make_scene, make_stand, platform_kind, scanner_figures, unzip};
    #[pymodule_export]
    use super::preview::{page, picture, preview};
    #[pymodule_export]
    use super::recipes::{materials_of_file, parts_of_scene};
    #[pymodule_export]
    use super::run::{Outcome, Request, run, run_batches};
    #[pymodule_export]
    use super::scene::{Mesh, Part, Scene};
    #[pymodule_export]
    use super::stages::{dry_run, fly, merge_shards, run_shard};
    #[pymodule_export]
    use super::table::{Column, Table};
    #[pymodule_export]
    use super::tools::{
        campaign_cells, compare, fit_flight, fit_sensor, plan, reconstruct, run_campaign, write_lines,
    };
    #[pymodule_export]
    use super::version;
}

/// Runs the command line with these words, the first of which is the program's name, and returns its exit
/// status.
#[pyfunction]
fn command(py: Python<'_>, words: Vec<std::ffi::OsString>) -> u8 {
    py.detach(|| vlscan::main(words))
}

/// Version of the engine.
#[pyfunction]
fn version() -> &'static str {
    env!("CARGO_PKG_VERSION")
}
