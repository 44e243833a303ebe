//! Generates scenes of a chosen size, with the surveys that scan them.
//!
//! A forest, hills or a room is written as OBJ and MTL files with `scene.xml`, `scanners.xml`,
//! `platforms.xml` and `survey.xml`, ready to run. The same options give the same bytes on every machine: all
//! random numbers come from [`vlscan_base::rng`], all transcendental functions from `libm`, and coordinates
//! are written with four decimals.
//!
//! | file | what it does |
//! |---|---|
//! | `forest`, `tree`, `crowns` | forests: ground and undergrowth, trees, foliage as voxels |
//! | `terrain`, `room` | hills with houses and boulders; a furnished room |
//! | `survey` | the XML files |
//! | `stand` | tree models placed by an inventory |
//! | `solid`, `obj` | meshes of shapes; writes OBJ files |
//! | `random` | random numbers and noise |

#![allow(
    rustdoc::broken_intra_doc_links,
    reason = "comments on options are shown as help, where defaults stand in brackets"
)]

mod crowns;
mod forest;
mod obj;
mod random;
mod room;
mod solid;
mod stand;
mod survey;
mod terrain;
mod tree;

use crate::args;
use obj::Mesh;
use std::path::{Path, PathBuf};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::is_taken;
use vlscan_geom::Aabb;

pub use obj::SceneFolder;
pub use stand::{Development, StandMade, StandOptions, Substitute, make_stand};

/// Kinds of scenes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum SceneKind {
    /// Trees on rolling ground, scanned from an aeroplane.
    Forest,
    /// Hills, scanned from an aeroplane.
    Terrain,
    /// A furnished room, scanned from two tripod positions.
    Room,
}

impl SceneKind {
    /// All kinds.
    pub const ALL: [SceneKind; 3] = [SceneKind::Forest, SceneKind::Terrain, SceneKind::Room];

    /// Name on the command line, of the scene and of the survey.
    pub fn name(self) -> &'static str {
        self.traits().name
    }

    fn traits(self) -> &'static Traits {
        &TRAITS[self as usize]
    }
}

/// Traits of a kind of scenes.
struct Traits {
    name: &'static str,
    min_triangles: u64,
    /// Least and largest extent, m.
    extents: [f64; 2],
    material_file: &'static str,
    materials: Materials,
    write: fn(&SceneOptions, f64, &SceneFolder) -> Result<SceneFiles>,
}

/// In the order of [`SceneKind`].
static TRAITS: [Traits; 3] = [
    Traits {
        name: "forest",
        min_triangles: 500,
        extents: [20.0, 100_000.0],
        material_file: forest::MATERIAL_FILE,
        materials: forest::MATERIALS,
        write: forest::write,
    },
    Traits {
        name: "terrain",
        min_triangles: 500,
        extents: [20.0, 100_000.0],
        material_file: terrain::MATERIAL_FILE,
        materials: terrain::MATERIALS,
        write: terrain::write,
    },
    Traits {
        name: "room",
        min_triangles: 1000,
        extents: [6.0, 60.0],
        material_file: room::MATERIAL_FILE,
        materials: room::MATERIALS,
        write: room::write,
    },
];

/// Choices for [`write_scene`].
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct SceneOptions {
    /// Kind of scene to make.
    pub kind: SceneKind,
    /// Number of triangles, to within about one per cent; 250k and 10M are understood.
    #[arg(short = 'n', long, value_name = "N", default_value = "100k", value_parser = args::count)]
    pub triangles: u64,
    /// Seed; another seed makes another scene.
    #[arg(long, value_name = "SEED", default_value_t = 1, value_parser = args::seed)]
    pub seed: u64,
    /// Edge length of the scene in metres.
    #[arg(long, value_name = "METRES")]
    pub extent: Option<f64>,
    /// Approximate number of pulses of the survey.
    #[arg(long, value_name = "N", value_parser = args::count)]
    pub pulses: Option<u64>,
    /// Forest: make every tree a separate part, so that points have the number of their tree.
    #[arg(long)]
    pub separate_trees: bool,
    /// Forest: make this many different trees and place each --copies times; -n 1G --models 50 --copies 1000
    /// is a forest of a billion triangles.
    #[arg(long, value_name = "N", conflicts_with = "separate_trees")]
    pub models: Option<u64>,
    /// Forest: add this many opaque voxels of 0.25 m to the crowns.
    #[arg(long, value_name = "N", conflicts_with = "models", value_parser = args::count)]
    pub voxels: Option<u64>,
    /// Forest with --models: copies of each tree. [default: 100]
    #[arg(long, value_name = "N", requires = "models")]
    pub copies: Option<u64>,
    /// Replace existing files.
    #[arg(id = "force", long = "force")]
    pub overwrite: bool,
}

/// Places of each tree of a forest of models, if no number is given.
const DEFAULT_COPIES: u64 = 100;

impl SceneOptions {
    /// A scene of `triangles` triangles with defaults for everything else.
    pub fn new(kind: SceneKind, triangles: u64) -> SceneOptions {
        SceneOptions {
            kind,
            triangles,
            seed: 1,
            extent: None,
            pulses: None,
            separate_trees: false,
            models: None,
            voxels: None,
            copies: None,
            overwrite: false,
        }
    }

    /// Number of tree models, and number of instances of each.
    fn instances(&self) -> Option<(u64, u64)> {
        self.models.map(|models| (models, self.copies.unwrap_or(DEFAULT_COPIES)))
    }
}

/// Summary of what [`write_scene`] wrote.
#[derive(Clone, Debug, PartialEq)]
pub struct GeneratedScene {
    /// Path of the survey file.
    pub survey: PathBuf,
    /// All files written, the survey last.
    pub files: Vec<PathBuf>,
    /// Number of triangles of the scene.
    pub triangles: u64,
    /// Number of voxels of the scene; 0 without voxel files.
    pub voxels: u64,
    /// Box around the scene, m.
    pub bounds: Aabb,
    /// Number of pulses that the survey emits, accurate to 1 %.
    pub pulses: u64,
}

/// Writes a scene and its survey into `folder`, which is created if it does not exist. The files appear under
/// their names when all are complete.
///
/// # Errors
/// [`Error::Input`] for impossible sizes and for existing files (unless [`SceneOptions::overwrite`]);
/// [`Error::Io`] when writing fails.
pub fn write_scene(options: &SceneOptions, folder: &Path) -> Result<GeneratedScene> {
    let extent = check(options)?;
    if !options.overwrite {
        refuse_existing(folder)?;
    }
    let folder = SceneFolder::create(folder, options.overwrite)?;
    let Traits { material_file, materials, write, .. } = options.kind.traits();
    let materials = folder.write(material_file, materials.text().as_bytes())?;
    let mut scene = write(options, extent, &folder)?;
    let texts = survey::survey_texts(options.kind, extent, scene.ground_height, options.pulses);
    scene.files.push(materials);
    scene.files.push(folder.write("scene.xml", survey::scene_text(options.kind, &scene.parts).as_bytes())?);
    scene.files.push(folder.write("scanners.xml", texts.scanners.as_bytes())?);
    scene.files.push(folder.write("platforms.xml", texts.platforms.as_bytes())?);
    let survey = folder.write("survey.xml", texts.survey.as_bytes())?;
    scene.files.push(survey.clone());
    folder.commit()?;
    let SceneFiles { files, triangles, voxels, bounds, .. } = scene;
    Ok(GeneratedScene { survey, files, triangles, voxels, bounds, pulses: texts.pulses })
}

/// The materials of a scene, as written to its MTL file.
struct Materials {
    comment: &'static str,
    /// Name, colour, reflectance, class, whether it is ground.
    all: &'static [(&'static str, &'static str, f64, u8, bool)],
}

impl Materials {
    fn text(&self) -> String {
        let material = |&(name, colour, reflectance, class, is_ground): &_| {
            format!(
                "newmtl {name}\nKd {colour}\nhelios_reflectance {reflectance}\n\
                 helios_classification {class}\n\
                 helios_isGround {is_ground}\n"
            )
        };
        let all: Vec<String> = self.all.iter().map(material).collect();
        format!("# {}\n{}", self.comment, all.join("\n"))
    }
}

/// Checks the options and returns the extent of the scene, m.
fn check(options: &SceneOptions) -> Result<f64> {
    let (kind, triangles) = (options.kind.name(), options.triangles);
    let min = options.kind.traits().min_triangles;
    if triangles < min {
        return Err(Error::input(format!("a {kind} of {triangles} triangles: expected at least {min}")));
    }
    if let Some((models, copies)) = options.instances() {
        let possible = options.kind == SceneKind::Forest
            && (1..=10_000).contains(&models)
            && (1..=10_000_000).contains(&copies);
        let share = if possible { triangles / (models * copies) } else { 0 };
        if share < forest::MIN_MODEL_TRIANGLES || models * copies > 100_000_000 {
            return Err(Error::input(format!(
                "a {kind} of {triangles} triangles in {models} models of {copies} copies: only a forest has \
                 models, at most 10000, and every tree takes at least {} triangles",
                forest::MIN_MODEL_TRIANGLES
            )));
        }
    }
    if let Some(voxels) = options.voxels
        && (options.kind != SceneKind::Forest
            || options.models.is_some()
            || !(1..=1_000_000_000).contains(&voxels))
    {
        return Err(Error::input(format!(
            "a {kind} with {voxels} voxels: only a forest without models has voxels, at most 1000000000"
        )));
    }
    if triangles > 4_000_000_000 {
        return Err(Error::input(format!(
            "a {kind} of {triangles} triangles: at most 4000000000 can be made"
        )));
    }
    let extent = options.extent.unwrap_or_else(|| match options.kind {
        SceneKind::Forest => match options.instances() {
            Some((models, copies)) => forest::extent_of_stand(models * copies),
            None => forest::default_extent(triangles),
        },
        SceneKind::Terrain => terrain::default_extent(triangles),
        SceneKind::Room => room::DEFAULT_EXTENT,
    });
    let [min, max] = options.kind.traits().extents;
    if !(min..=max).contains(&extent) {
        return Err(Error::input(format!("an extent of {extent} m: a {kind} can have {min} to {max} m")));
    }
    if options.pulses == Some(0) {
        return Err(Error::input("--pulses must be at least 1"));
    }
    Ok(extent)
}

fn refuse_existing(folder: &Path) -> Result<()> {
    let fixed = ["survey.xml", "scene.xml", "scanners.xml", "platforms.xml", "ground.obj", "shell.obj"];
    match fixed.iter().find(|name| is_taken(&folder.join(name))) {
        Some(name) => Err(Error::exists(folder.join(name))),
        None => Ok(()),
    }
}

/// A part of the scene and its file.
struct Part {
    file: String,
    name: &'static str,
}

/// The files of a scene written so far.
struct SceneFiles {
    files: Vec<PathBuf>,
    parts: Vec<Part>,
    triangles: u64,
    voxels: u64,
    bounds: Aabb,
    ground_height: f64,
}

impl Default for SceneFiles {
    fn default() -> SceneFiles {
        let (files, parts) = (Vec::new(), Vec::new());
        SceneFiles { files, parts, triangles: 0, voxels: 0, bounds: Aabb::EMPTY, ground_height: 0.0 }
    }
}

impl SceneFiles {
    /// Adds the mesh written as `name.obj`. The first mesh is the ground.
    fn add(&mut self, name: &'static str, mesh: Mesh) {
        self.add_part(Part { file: format!("{name}.obj"), name }, mesh);
    }

    fn add_cells(&mut self, cells: crowns::Cells) {
        self.voxels += cells.count;
        self.bounds = self.bounds.union(cells.bounds);
        self.files.push(cells.path);
        self.parts.push(Part { file: crowns::FILE.to_owned(), name: "crowns" });
    }

    fn add_part(&mut self, part: Part, mesh: Mesh) {
        if self.parts.is_empty() {
            self.ground_height = mesh.bounds.centre().z;
        }
        self.triangles += mesh.triangles;
        self.bounds = self.bounds.union(mesh.bounds);
        self.files.push(mesh.path);
        self.parts.push(part);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(options: &SceneOptions) -> (tempfile::TempDir, GeneratedScene) {
        let folder = tempfile::tempdir().unwrap();
        let summary = write_scene(options, folder.path()).unwrap();
        (folder, summary)
    }

    /// Counts the triangles of the written files with an independent reader; all need a material and an area.
    fn read_back(summary: &GeneratedScene) -> u64 {
        let mut triangles = 0;
        for path in summary.files.iter().filter(|p| p.extension().is_some_and(|e| e == "obj")) {
            let options = tobj::LoadOptions { triangulate: true, ..Default::default() };
            let (models, materials) = tobj::load_obj(path, &options).unwrap();
            assert!(!materials.unwrap().is_empty(), "{} has no materials", path.display());
            for m in models {
                assert!(m.mesh.material_id.is_some(), "{}: a face without material", path.display());
                let corner = |i: u32| {
                    let at = 3 * i as usize;
                    vlscan_geom::DVec3::from_slice(&m.mesh.positions[at..at + 3])
                };
                for t in m.mesh.indices.chunks_exact(3) {
                    let (a, b, c) = (corner(t[0]), corner(t[1]), corner(t[2]));
                    assert!((b - a).cross(c - a).length() > 1e-9, "{}: {a} {b} {c}", path.display());
                    triangles += 1;
                }
            }
        }
        triangles
    }

    #[test]
    fn the_triangles_asked_for_are_in_the_files() {
        for kind in SceneKind::ALL {
            for triangles in [kind.traits().min_triangles, 1000, 4321, 60_000] {
                let (_folder, summary) = made(&SceneOptions::new(kind, triangles));
                let found = read_back(&summary);
                assert_eq!(found, summary.triangles, "{kind:?}");
                let off = (found as f64 / triangles as f64 - 1.0).abs();
                assert!(off <= 0.01, "{kind:?}: {found} triangles instead of {triangles}");
            }
        }
    }

    #[test]
    fn the_same_options_give_the_same_bytes_and_another_seed_others() {
        for kind in SceneKind::ALL {
            let options = SceneOptions::new(kind, 3000);
            let bytes = |o: &SceneOptions| {
                let (_folder, summary) = made(o);
                summary.files.iter().flat_map(|f| std::fs::read(f).unwrap()).collect::<Vec<u8>>()
            };
            let first = bytes(&options);
            assert_eq!(first, bytes(&options), "{kind:?}");
            assert_ne!(first, bytes(&SceneOptions { seed: 2, ..options }), "{kind:?}");
        }
    }

    #[test]
    fn a_forest_keeps_its_extent_and_stands_on_the_ground() {
        let (_folder, summary) =
            made(&SceneOptions { extent: Some(60.0), ..SceneOptions::new(SceneKind::Forest, 20_000) });
        let size = summary.bounds.size();
        assert!(size.x >= 60.0 && size.x < 70.0 && size.y >= 60.0 && size.y < 70.0, "{size}");
        assert!(size.z > 15.0 && size.z < 60.0, "{size}");
    }

    #[test]
    fn trees_can_be_parts_of_their_own() {
        let options = SceneOptions { separate_trees: true, ..SceneOptions::new(SceneKind::Forest, 6000) };
        let (folder, summary) = made(&options);
        assert_eq!(read_back(&summary), summary.triangles);
        let scene = std::fs::read_to_string(folder.path().join("scene.xml")).unwrap();
        let parts = scene.matches("<part ").count();
        assert!(parts > 10, "{parts} parts");
        assert_eq!(parts, summary.files.iter().filter(|p| p.extension().is_some_and(|e| e == "obj")).count());
    }

    #[test]
    fn voxels_are_in_the_crowns_and_in_the_scene() {
        let options = SceneOptions { voxels: Some(3000), ..SceneOptions::new(SceneKind::Forest, 6000) };
        let (folder, summary) = made(&options);
        assert!((2700..=3000).contains(&summary.voxels), "{}", summary.voxels);
        let reading = vlscan_survey::ReadOptions::default();
        let (survey, warnings) = vlscan_survey::read_survey(&summary.survey, &reading).unwrap();
        assert!(warnings.is_empty(), "{warnings:?}");
        let (scene, _) = vlscan_scene::load(&survey.scene, &vlscan_scene::LoadOptions::default()).unwrap();
        assert_eq!(scene.geometry.cubes.len() as u64, summary.voxels);
        let ground = std::fs::read_to_string(folder.path().join("scene.xml")).unwrap();
        assert!(ground.contains("crowns.vox"));
        let crowded = SceneOptions { voxels: Some(100_000_000), overwrite: true, ..options.clone() };
        assert!(matches!(write_scene(&crowded, folder.path()), Err(Error::Input(_))));
        let room = SceneOptions { voxels: Some(10), ..SceneOptions::new(SceneKind::Room, 2000) };
        assert!(matches!(write_scene(&room, folder.path()), Err(Error::Input(_))));
    }

    #[test]
    fn nothing_is_overwritten_unasked() {
        let (folder, _) = made(&SceneOptions::new(SceneKind::Room, 1000));
        let again = SceneOptions::new(SceneKind::Room, 1000);
        assert!(matches!(write_scene(&again, folder.path()), Err(Error::Input(_))));
        write_scene(&SceneOptions { overwrite: true, ..again }, folder.path()).unwrap();
    }

    #[test]
    fn sizes_that_cannot_be_made_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let refuse = |options: SceneOptions| {
            assert!(matches!(write_scene(&options, folder.path()), Err(Error::Input(_))), "{options:?}");
        };
        refuse(SceneOptions::new(SceneKind::Forest, 10));
        refuse(SceneOptions::new(SceneKind::Terrain, u64::MAX));
        for extent in [f64::NAN, f64::INFINITY, -5.0, 0.0, 1e9] {
            refuse(SceneOptions { extent: Some(extent), ..SceneOptions::new(SceneKind::Forest, 5000) });
        }
        refuse(SceneOptions { pulses: Some(0), ..SceneOptions::new(SceneKind::Room, 5000) });
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
