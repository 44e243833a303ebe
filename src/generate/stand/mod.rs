//! Stands: tree models placed by an inventory.
//!
//! | file | what it does |
//! |---|---|
//! | `inventory` | reads the table of trees |
//! | `models` | the tree models of a folder: species, height, crown |
//! | `choose` | which model stands for a tree, how large and how turned |
//! | `epochs` | growth, thinning and storm from epoch to epoch |
//! | `write` | the scene, the tables of instances and of labels |

mod choose;
mod epochs;
mod inventory;
mod models;
mod write;

pub use epochs::Development;
pub use inventory::Inventory;
pub use models::Models;
pub use write::{StandOptions, write_stand};
