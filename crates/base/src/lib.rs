//! Foundations of every stage of vlscan: errors with the place of each problem, files, random numbers.
//!
//! | module | what it does |
//! |---|---|
//! | `error`, `diag` | errors; problems with file, line and the text that is marked |
//! | `corrections` | departures from the reference's physics, materials and kinematics |
//! | `observer` | the receiver of warnings, notes and times |
//! | `rng` | counter-based random numbers |
//! | `quantity`, `markup`, `aligned` | bounds of numbers, counts and sizes as text; text in XML and HTML, in aligned columns |
//! | `columns` | separators of columns and quoted fields |
//! | `files` | files named when complete, files that are read |
//! | `damage`, `machine` | panics of decoders caught; threads and memory of the machine |
//! | `recognise` | kinds of files by first bytes and ending, and what to do with each |
//! | `store` | files of arrays with checksums, the bytes of files |

#![deny(unsafe_code)]

pub mod aligned;
pub mod columns;
pub mod corrections;
pub mod damage;
pub mod diag;
pub mod error;
pub mod files;
pub mod machine;
pub mod markup;
pub mod observer;
pub mod quantity;
pub mod recognise;
pub mod rng;
pub mod store;

pub use error::{Error, Result};
pub use observer::Observer;
