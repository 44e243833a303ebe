//! Runs of the whole program, and checks of the project's files. One program, since each would be linked with
//! the whole library.

use std::alloc::System;

mod common;

mod bench;
mod boxes;
mod campaign;
mod campaigns;
mod catalogue;
mod chains;
mod citations;
mod closed_form;
mod clouds;
mod colours;
mod compare;
mod conformance;
mod coverage;
mod crs;
mod damage;
mod dependencies;
mod determinism;
mod dry_run;
mod endurance;
mod examples;
mod faults;
mod files;
mod fit;
mod fixtures;
mod foreign;
mod formats;
mod formats_alone;
mod fuzz;
mod heights;
mod helios_options;
mod helios_surveys;
mod hostile;
mod instruments;
mod interruption;
mod library;
mod light;
mod limits;
mod manual;
mod mcap;
mod meshes;
mod messages;
mod mosaics;
mod mutation;
mod navigation;
mod noise;
mod patterns;
mod pipes;
mod plan;
mod plausibility;
mod point_formats;
mod preview;
mod profiles;
mod raster;
mod rasters;
mod reconstruct;
mod recording;
mod rig;
mod scenes;
mod shards;
mod spinning;
mod stages;
mod stand;
mod storage;
mod structure;
mod tiles;
mod trajectories;
mod voxels;

/// Counts what is allocated, for runs that must leave nothing behind.
#[global_allocator]
static ALLOCATOR: cap::Cap<System> = cap::Cap::new(System, usize::MAX);
