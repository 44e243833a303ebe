//! The survey model: a survey after every template, default and unit has been resolved. Angles are radians,
//! lengths metres, frequencies hertz, positions world coordinates.
//!
//! | file | what it does |
//! |---|---|
//! | `scene`, `mesh`, `raster` | parts of a scene: loaders, transforms, motions, swaps; meshes in memory; files of rasters |
//! | `platform`, `legs`, `scanner` | platforms; legs and their settings; instruments |
//! | `identity` | identities of values in memory |
//! | `poses` | recorded trajectories |
//! | `navigation` | errors of navigation |
//! | `scan_motion` | sense, phase, tilt, wander and swing of deflectors |
//! | `pattern` | scan patterns of tables |
//! | `pulse_times` | times at which pulses leave, in place of a constant rate |
//! | `receiver` | pulse shape, noise and detector of a receiver |
//! | `weather` | fog, rain, snow and dust along the beam |

mod identity;
mod legs;
mod mesh;
mod navigation;
mod pattern;
mod platform;
mod poses;
mod pulse_times;
mod raster;
mod receiver;
mod scan_motion;
mod scanner;
mod scene;
mod weather;

use std::path::PathBuf;

pub use identity::{Identity, MaterialChanges};
pub use legs::*;
pub use mesh::{
    ColourDefinition, MaterialChange, MaterialDefinition, Mesh, MeshColours, OpticsDefinition, Replaced,
    TextureDefinition, TextureImage, TextureWrap, UnusedOptics, WaterDefinition,
};
pub use navigation::{NavigationErrors, NavigationKeyError, NavigationProblem};
pub use pattern::{PatternBeam, PatternTable};
pub use platform::*;
pub use poses::*;
pub use pulse_times::PulseTimes;
pub use raster::{PixelType, RasterFiles, VirtualRaster, VirtualSource};
pub use receiver::*;
pub use scan_motion::{AngleTable, ScanMotion, Swing, Wander};
pub use scanner::*;
pub use scene::*;
pub use weather::{AirState, Weather};

/// A complete survey: scanner, platform, legs and scene.
#[derive(Clone, Debug)]
pub struct Survey {
    /// Name of the survey and of its output folder.
    pub name: String,
    /// The file that was read.
    pub path: PathBuf,
    /// The seed in the survey file, if there is one.
    pub seed: Option<u64>,
    /// The platform that carries the scanner.
    pub platform: Platform,
    /// The instrument.
    pub scanner: Scanner,
    /// The scanned scene; not loaded yet.
    pub scene: SceneRecipe,
    /// Legs in document order, inactive ones included.
    pub legs: Vec<Leg>,
    /// Mean and standard deviation (m) of a random vector added to each leg's position.
    pub leg_offset: Option<(f64, f64)>,
    /// Coordinate reference system of the world coordinates as WKT, when the input names one.
    pub crs_wkt: Option<String>,
}
