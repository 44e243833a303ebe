//! Runs of the whole program, and checks of the project's files. One program, since each would be linked with the whole
//! library.

mod common;

mod bench;
mod campaign;
mod catalogue;
mod citations;
mod conformance;
mod damage;
mod dependencies;
mod determinism;
mod endurance;
mod examples;
mod faults;
mod files;
mod fixtures;
mod formats;
mod fuzz;
mod helios_options;
mod hostile;
mod instruments;
mod interruption;
mod limits;
mod manual;
mod navigation;
mod noise;
mod parts;
mod pipes;
mod plausibility;
mod preview;
mod scenes;
mod stages;
mod structure;
mod trajectories;
