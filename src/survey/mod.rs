//! What is to be flown: surveys and scenes as their files describe them, with every template, default and unit
//! resolved, and nothing loaded yet.

pub mod formula;
mod model;

pub use model::*;
