//! Stands: tree models placed by an inventory.
//!
//! | file | what it does |
//! |---|---|
//! | `inventory`, `headings` | reads the table of trees; its headings in English and German |
//! | `models` | the tree models of a folder: species, height, crown |
//! | `stems` | stem diameters of tree models |
//! | `choose` | which model stands for a tree, how large and how turned |
//! | `epochs` | growth, thinning and storm from epoch to epoch |
//! | `make` | reads inventory, models and terrain, and has the stand written |
//! | `write` | the scene, the tables of instances and of labels |

mod choose;
mod epochs;
mod headings;
mod inventory;
mod make;
mod models;
mod stems;
mod write;

pub use epochs::Development;
pub use make::{StandOptions, make_stand};
pub use write::{StandMade, Substitute};
