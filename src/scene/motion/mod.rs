//! Moving parts (spec input-formats §3.7, pulse-physics §6).
//!
//! ```text
//! SceneRecipe, Scene ─► Movers (what moves how and when; shared)
//!                          │ start, step: one call for every simulation step
//!                          ▼
//!                      MoverState (small; a chunk holds the one it begins with) ─► Stage (a worker's copy of the moving
//!                                                                                   parts, where rays see them)
//! ```
//!
//! A part's motions are multiplied up, step by step, to one map of the part as it stood at first, so that a state is small
//! and its copies go on alike wherever they are replayed.

mod plan;
mod stage;
mod state;
#[cfg(test)]
mod tests;

pub use plan::Movers;
pub use stage::{Actor, Change, Stage};
pub use state::MoverState;
