//! The wiring of the whole program. A [`Session`] is given resolved [`Settings`]; it loads the scene, builds the tree, and
//! flies the survey over it or traces a stream of pulses, once for every epoch of a scene with swapped parts:
//!
//! ```text
//! Settings ─► Session::open ─► run ────────────────► fly ──┐ pass over   ┌─► next epoch
//!                            ├ trace(stream of pulses) ────┴─ an epoch ──┴─► Report
//!                            └ into_emission ─► emit: poses or pulses without tracing
//! ```
//!
//! | file | what it does |
//! |---|---|
//! | `settings` | everything that is chosen before the start |
//! | `session` | loading, the loop over epochs, the report |
//! | `fly`, `pass` | the wiring of a pass over one epoch, and what it needs |
//! | `load` | scene and tree of an epoch, refused if they need too much memory |
//! | `chunk` | the producer: steps of the flight become chunks |
//! | `stream` | the other producer: rows of a stream of pulses |
//! | `worker`, `moving` | the computing stage, and the moving parts that its pulses see |
//! | `collector` | the last stage: encoded pieces to the outputs, in order |
//! | `emit` | the flight alone, written as poses or pulses |
//! | `plausibility`, `aim` | inputs that are valid but can hardly be meant |
//! | `progress` | what has been done so far |

mod aim;
mod chunk;
mod collector;
mod emit;
mod fly;
mod load;
mod moving;
mod pass;
mod plausibility;
mod progress;
mod session;
mod settings;
mod stream;
mod worker;

pub use collector::Ended;
pub use emit::{Emission, Emitted, emit};
pub use fly::fly;
pub use pass::{Control, Pass};
pub use plausibility::target;
pub use progress::{Progress, Snapshot};
pub use session::{Report, Session};
pub use settings::{DEFAULT_CHUNK_SIZE, DEFAULT_LATENCY, DEFAULT_WAREHOUSE_FACTOR, Settings};
pub use stream::LegRule;
