//! A scene from a classified point cloud: terrain, roofs with walls, foliage as voxels, and the instrument
//! parameters observable from the returns.
//!
//! The classes are those of the LAS specification 1.4. Ground, water, roads and rails become the terrain;
//! buildings and bridges become roofs with walls; all other points become foliage, of the class of its
//! points. Everything is estimated from the cloud.
//!
//! | file | what it does |
//! |---|---|
//! | `recording` | returns as pulses and flight lines |
//! | `thinning` | even samples of pulses |
//! | `sensor` | positions of the instrument |
//! | `standing` | instruments that were not in the air, which are rejected |
//! | `terrain`, `roofs`, `outline` | surfaces |
//! | `solids` | vehicles and other solid things of no class |
//! | `foliage`, `smoothing` | leaf area densities; means over neighbouring columns |
//! | `receiver` | resolution and threshold of the receiver, size of the elements of foliage |
//! | `echoes` | returns of pulses that are sent through the foliage again |
//! | `write` | the files of the scene |

mod echoes;
mod foliage;
mod outline;
mod receiver;
mod recording;
mod roofs;
mod sensor;
mod smoothing;
mod solids;
mod standing;
mod terrain;
mod thinning;
mod write;

pub use foliage::{Foliage, LeafVoxel};
pub use receiver::{Layer, Receiver};
pub use roofs::Roofs;
pub use sensor::{PathSource, SensorPath};
pub use terrain::Terrain;

use crate::limit::PointLimit;
use rayon::prelude::*;
use recording::{POINT_BYTES, Recording, Return, Target};
use std::path::{Path, PathBuf};
use std::time::Instant;
use vlscan_base::Observer;
use vlscan_base::diag::{Diagnostics, Notice, Place, listed};
use vlscan_base::error::Result;
use vlscan_base::quantity::{amount, counted, duration, parse_bytes};
use vlscan_geom::DVec3;

/// Edge of voxels over the distance between pulses, and its minimum and maximum, m.
const VOXEL_PER_SPACING: f64 = 1.0;
const VOXEL_SIZES: [f64; 2] = [0.3, 0.75];
/// Bytes of the limit of memory for each voxel. They take 49 bytes each, and not all of the memory.
const MEMORY_PER_VOXEL: f64 = 128.0;
/// Minimum and maximum edge of the cells of roofs, m.
const ROOF_CELLS: [f64; 2] = [0.25, 2.0];
/// Maximum number of flight lines that a message names.
const MAX_LISTED_LINES: usize = 5;
/// Unclassified points within this many standard deviations of the terrain count as terrain.
const MAX_TERRAIN_DEVIATIONS: f64 = 3.0;

/// Source and settings of a reconstruction.
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct ReconstructOptions {
    /// The point cloud, LAS or LAZ with classes, return numbers and times. Class 2 is ground, 6 buildings, 9
    /// water; 7 and 18 are noise; other points are foliage
    pub cloud: PathBuf,
    /// Edge of the voxels of foliage in metres. [default: the mean distance between pulses, 0.3 to 0.75]
    #[arg(long, value_name = "METRES", value_parser = voxel_size)]
    pub voxel: Option<f64>,
    /// Divergence of the beam that recorded the cloud, full angle at 1/e² of the intensity, rad
    #[arg(long, value_name = "RAD", default_value_t = 0.00025, value_parser = divergence)]
    pub divergence: f64,
    /// Use fewer pulses, evenly chosen, and larger voxels if they need more memory than this, e.g. 8G, at
    /// about 160 bytes for each point. [default: no limit]
    #[arg(long, value_name = "SIZE", value_parser = memory)]
    pub max_memory: Option<u64>,
    /// Replace files that exist.
    #[arg(id = "force", long = "force")]
    pub overwrite: bool,
}

/// A value of an option that is not a number within its bounds.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("expected {unit} from {low} to {high}")]
struct OutOfBounds {
    unit: &'static str,
    low: f64,
    high: f64,
}

impl OutOfBounds {
    /// The number in `text`, if it is within these bounds.
    fn check(self, text: &str) -> Result<f64, OutOfBounds> {
        text.parse::<f64>().ok().filter(|value| (self.low..=self.high).contains(value)).ok_or(self)
    }
}

/// A value of an option that is not a size of memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected a number of bytes such as 8000000000 or 8G")]
struct NoMemorySize;

fn memory(text: &str) -> Result<u64, NoMemorySize> {
    parse_bytes(text).ok_or(NoMemorySize)
}

fn voxel_size(text: &str) -> Result<f64, OutOfBounds> {
    OutOfBounds { unit: "metres", low: 0.05, high: 20.0 }.check(text)
}

fn divergence(text: &str) -> Result<f64, OutOfBounds> {
    OutOfBounds { unit: "rad", low: 1e-6, high: 0.1 }.check(text)
}

impl ReconstructOptions {
    /// The defaults for a cloud.
    pub fn new(cloud: PathBuf) -> ReconstructOptions {
        ReconstructOptions { cloud, voxel: None, divergence: 0.00025, max_memory: None, overwrite: false }
    }
}

/// A scene that was estimated from a point cloud.
#[derive(Clone, Debug)]
pub struct ReconstructedScene {
    /// Number of points and pulses that were used.
    pub points: usize,
    /// Number of pulses.
    pub pulses: usize,
    /// One of this many pulses of the cloud was used: more than 1 if the memory is limited.
    pub one_of: u64,
    /// Points of the noise classes 7 and 18, which are left out.
    pub noise: usize,
    /// Pulses of the cloud per square metre.
    pub density: f64,
    /// The paths of the instrument, by flight line.
    pub paths: Vec<SensorPath>,
    /// Mean distance from the instrument to the points, m.
    pub mean_range: f64,
    /// The terrain.
    pub terrain: Terrain,
    /// Buildings.
    pub roofs: Roofs,
    /// Foliage; without voxels where there is none.
    pub foliage: Foliage,
    /// Length of beams, m, that the surroundings of a voxel weigh in its density.
    pub prior: f64,
    /// True if the surroundings lie along the canopy rather than along the ground.
    pub along_canopy: bool,
    /// Receiver and grain of foliage.
    pub receiver: Receiver,
    /// Divergence of the beam that was assumed, rad.
    pub divergence: f64,
}

/// Reports the result and the duration of each stage.
struct Stages<'a> {
    observer: &'a Observer,
    begun: Instant,
}

impl Stages<'_> {
    fn done(&mut self, made: String) {
        let took = duration(self.begun.elapsed().as_secs_f64());
        self.observer.notify(Notice::Timing(format!("{made} in {took}")));
        self.begun = Instant::now();
    }
}

/// Estimates a scene from a classified point cloud. `observer` receives warnings of doubtful results.
///
/// # Errors
/// [`vlscan_base::Error::Io`]; [`vlscan_base::Error::Input`] for files that are not point clouds, have no
/// ground or were not recorded from the air, and for warnings of a strict observer.
pub fn reconstruct(options: &ReconstructOptions, observer: &Observer) -> Result<ReconstructedScene> {
    let mut found = Diagnostics::default();
    let mut stages = Stages { observer, begun: Instant::now() };
    let limit = PointLimit::new(options.max_memory, POINT_BYTES);
    let recording = stages.read(&options.cloud, limit, &mut found)?;
    let paths = stages.paths(&recording);
    standing::reject(&options.cloud, &recording, &paths)?;
    warn_of_nadir_paths(&options.cloud, &paths, &mut found);
    observer.warnings(found)?;
    let spacing = 1.0 / recording.density().sqrt();
    let (terrain, roofs, is_leaf) = stages.surfaces(&recording, spacing);
    observer.step("estimating the density of leaves");
    let size = options.voxel.unwrap_or((VOXEL_PER_SPACING * spacing).clamp(VOXEL_SIZES[0], VOXEL_SIZES[1]));
    let max_voxels = options.max_memory.map_or(f64::INFINITY, |bytes| bytes as f64 / MEMORY_PER_VOXEL);
    let voxels = (size, max_voxels);
    let extinctions = foliage::extinctions(&recording, &paths, &is_leaf, voxels, |x, y| terrain.height(x, y));
    let leaves = is_leaf.iter().filter(|is_leaf| **is_leaf).count();
    stages.done(format!("densities of foliage from {} returns of leaves", amount(leaves as f64)));
    observer.step("estimating the receiver");
    let instrument = (&paths[..], options.divergence);
    let by_rest = extinctions.as_ref().map(|[_, rest]| rest);
    let receiver = receiver::receiver(&recording, instrument, by_rest, &is_leaf, &terrain);
    stages.done(format!("receiver from {} pulses through foliage", amount(receiver.samples as f64)));
    let along_canopy = extinctions.as_ref().is_some_and(|[all, _]| all.along_canopy);
    let prior = extinctions.as_ref().map_or(0.0, |[all, _]| all.prior);
    let foliage = extinctions.map_or_else(Foliage::default, |[all, _]| {
        all.foliage(|p| receiver.factor_at(p.z - terrain.height(p.x, p.y)))
    });
    if foliage.size > size * 1.001 {
        observer.note(format!("voxels of {size:.2} m would be too many; they have {:.2} m", foliage.size));
    }
    Ok(ReconstructedScene {
        points: recording.returns.len(),
        pulses: recording.pulses(),
        noise: recording.noise,
        one_of: recording.one_of,
        density: recording.density() * recording.one_of as f64,
        mean_range: mean_range(&recording, &paths),
        paths,
        terrain,
        roofs,
        foliage,
        prior,
        along_canopy,
        receiver,
        divergence: options.divergence,
    })
}

impl Stages<'_> {
    fn read(&mut self, cloud: &Path, limit: PointLimit, found: &mut Diagnostics) -> Result<Recording> {
        self.observer.step("reading the cloud");
        let recording = recording::read(cloud, limit, found)?;
        let (returns, pulses) = (amount(recording.returns.len() as f64), amount(recording.pulses() as f64));
        self.done(format!(
            "{returns} points of {pulses} pulses in {}",
            counted(recording.lines.len() as u64, "flight line")
        ));
        Ok(recording)
    }

    fn paths(&mut self, recording: &Recording) -> Vec<SensorPath> {
        self.observer.step("looking for the instrument");
        let paths = sensor::paths(recording);
        self.done(format!("paths of {}", counted(paths.len() as u64, "flight line")));
        paths
    }

    /// The terrain, the roofs, and whether returns are from foliage.
    fn surfaces(&mut self, recording: &Recording, spacing: f64) -> (Terrain, Roofs, Vec<bool>) {
        self.observer.step("making terrain and roofs");
        let returns = &recording.returns;
        let ground = returns.iter().filter(|r| r.target() == Target::Ground).map(|r| (r.position, r.class));
        let (ground, ground_classes): (Vec<DVec3>, Vec<u8>) = ground.unzip();
        let terrain = terrain::terrain(ground, &ground_classes, recording.bounds);
        let reach = MAX_TERRAIN_DEVIATIONS * terrain.spread;
        let is_terrain = |p: DVec3| (p.z - terrain.height(p.x, p.y)).abs() <= reach;
        let is_solid = solids::solids(recording, spacing, is_terrain);
        let is_roof = |(r, is_solid): &(&Return, &bool)| r.target() == Target::Roof || **is_solid;
        let on_roofs = returns.iter().zip(&is_solid).filter(is_roof).map(|(r, _)| (r.position, r.class));
        let (on_roofs, roof_classes): (Vec<DVec3>, Vec<u8>) = on_roofs.unzip();
        let others = returns.par_iter().zip(&is_solid).filter(|both| !is_roof(both));
        let others = others.map(|(r, _)| r.position);
        let cell = (1.5 * spacing).clamp(ROOF_CELLS[0], ROOF_CELLS[1]);
        let roofs = roofs::roofs(&on_roofs, &roof_classes, others, cell, &terrain);
        let mut is_leaf = foliage::leaf_returns(recording, is_terrain);
        is_leaf.iter_mut().zip(is_solid).for_each(|(is_leaf, is_solid)| *is_leaf &= !is_solid);
        self.done(format!(
            "terrain of {} by {} nodes, {} cells of roofs",
            terrain.nodes[0],
            terrain.nodes[1],
            amount(roofs.cells as f64)
        ));
        (terrain, roofs, is_leaf)
    }
}

/// Warns of flight lines whose instrument is assumed to be straight above.
fn warn_of_nadir_paths(cloud: &Path, paths: &[SensorPath], found: &mut Diagnostics) {
    let unknown = paths.iter().filter(|path| path.found_by == PathSource::Nadir);
    let unknown: Vec<String> = unknown.map(|path| path.source.to_string()).collect();
    if unknown.is_empty() {
        return;
    }
    let names: Vec<&str> = unknown.iter().map(String::as_str).collect();
    let (line, are) = if names.len() == 1 { ("line", "it is") } else { ("lines", "they are") };
    let message = format!(
        "neither returns nor scan angles of {line} {} show where the instrument was; {are} assumed to be \
         recorded from straight above",
        listed(&names, MAX_LISTED_LINES)
    );
    found.warn(Some(Place::of_file(cloud)), message);
}

/// Mean distance from the instrument to the first returns of all pulses, m.
fn mean_range(recording: &Recording, paths: &[SensorPath]) -> f64 {
    let ranges = recording.lines.iter().zip(paths).flat_map(|(line, path)| {
        line.pulses.clone().map(move |p| {
            (path.at(recording.of_pulse(p)[0].time) - recording.of_pulse(p)[0].position).length()
        })
    });
    ranges.sum::<f64>() / recording.pulses() as f64
}

impl ReconstructedScene {
    /// Writes the scene to a folder: `scene.xml` with its meshes, materials and voxels, `scene.toml` with
    /// scene and instrument for `vlscan trace --scanner` and `vlscan run`, `trajectory.csv`, `report.json`.
    /// Returns the path of `scene.toml`.
    ///
    /// # Errors
    /// [`vlscan_base::Error::Io`]; [`vlscan_base::Error::Input`] for files that exist, unless they may be
    /// replaced.
    pub fn write(&self, folder: &Path, overwrite: bool) -> Result<PathBuf> {
        write::write(self, folder, overwrite)
    }

    /// Estimates, their sources and their quality; `report.json`.
    pub fn report(&self) -> serde_json::Value {
        write::report(self)
    }
}
