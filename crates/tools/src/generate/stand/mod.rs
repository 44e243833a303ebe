//! Stands: tree models placed by an inventory.
//!
//! | file | what it does |
//! |---|---|
//! | `inventory`, `headings` | reads the table of trees; its headings in English and German |
//! | `models` | the tree models of a folder: species, height, crown |
//! | `choose` | which model stands for a tree, how large and how turned |
//! | `epochs` | growth, thinning and storm from epoch to epoch |
//! | `write` | the scene, the tables of instances and of labels |

mod choose;
mod epochs;
mod headings;
mod inventory;
mod models;
mod write;

pub use epochs::Development;
pub use headings::PROJECT;
pub use inventory::Inventory;
pub use models::Models;
pub use write::{StandMade, StandOptions, Terrain, TerrainSurface, write_stand};
