//! A mixed forest on rolling ground.

use super::obj::{Mesh, ObjFile, SceneFolder};
use super::random::{Octave, Random, Relief, Topic};
use super::solid::{ground, ground_cells};
use super::tree::{MIN_TREE_TRIANGLES, Species, Tree, shrub};
use super::{Materials, Part, SceneFiles, SceneOptions, crowns};
use vlscan_base::error::Result;
use vlscan_geom::DVec3;

pub(super) const MATERIAL_FILE: &str = "forest.mtl";
pub(super) const MATERIALS: Materials = Materials {
    comment: "helios_reflectance: 0 to 1, at 1064 nm. Classes: 2 ground, 3 low vegetation, 4 wood, 5 leaves \
              and needles.",
    all: &[
        ("forest_floor", "0.36 0.29 0.20", 0.35, 2, true),
        ("undergrowth", "0.25 0.48 0.18", 0.48, 3, false),
        ("spruce_bark", "0.33 0.24 0.17", 0.38, 4, false),
        ("spruce_needles", "0.12 0.32 0.16", 0.42, 5, false),
        ("beech_bark", "0.48 0.46 0.42", 0.45, 4, false),
        ("beech_leaves", "0.24 0.52 0.14", 0.56, 5, false),
        ("birch_bark", "0.82 0.80 0.76", 0.62, 4, false),
        ("birch_leaves", "0.42 0.60 0.18", 0.54, 5, false),
    ],
};

/// Default edge of the square, m: 1 M triangles cover 200 m × 200 m.
pub(super) fn default_extent(triangles: u64) -> f64 {
    (200.0 * (triangles as f64 / 1e6).sqrt()).max(40.0)
}

/// Edge of a square forest with this number of trees, m.
pub(super) fn extent_of_stand(trees: u64) -> f64 {
    (trees as f64 / TREES_PER_SQUARE_METRE).sqrt().max(40.0)
}

/// Minimum number of triangles per tree of a forest of models; the ground takes some of them.
pub(super) const MIN_MODEL_TRIANGLES: u64 = 2 * MIN_TREE_TRIANGLES;

/// Maximum number of triangles of the ground and the undergrowth together in a forest of models.
const MAX_TRIANGLES_BELOW_MODELS: u64 = 4_000_000;

const RELIEF: [Octave; 6] = [
    Octave { wavelength: 240.0, amplitude: 9.0 },
    Octave { wavelength: 90.0, amplitude: 3.5 },
    Octave { wavelength: 38.0, amplitude: 1.2 },
    Octave { wavelength: 15.0, amplitude: 0.35 },
    Octave { wavelength: 6.0, amplitude: 0.12 },
    Octave { wavelength: 2.4, amplitude: 0.05 },
];
const TREES_PER_SQUARE_METRE: f64 = 0.042;
const TRIANGLES_PER_TREE: u64 = 150;

/// How the number of triangles is divided.
struct Budget {
    cells: u64,
    shrub_pairs: u64,
    tree_pairs: u64,
}

impl Budget {
    fn of(triangles: u64) -> Budget {
        let cells = ground_cells(triangles * 6 / 100);
        let rest = triangles / 2 - cells * cells;
        let shrub_pairs = rest * 3 / 100;
        Budget { cells, shrub_pairs, tree_pairs: rest - shrub_pairs }
    }
}

/// Writes the ground, the undergrowth, the trees and, if requested, the voxels.
pub(super) fn write(options: &SceneOptions, extent: f64, folder: &SceneFolder) -> Result<SceneFiles> {
    if let Some((models, copies)) = options.instances() {
        return write_models(options, (models, copies), extent, folder);
    }
    let budget = Budget::of(options.triangles);
    let relief = Relief::new(options.seed, &RELIEF, extent / budget.cells as f64);
    let stand = ForestStand::plant(options.seed, extent, &relief, budget.tree_pairs);
    let mut files = SceneFiles::default();
    files.add("ground", write_ground(&relief, extent, budget.cells, folder)?);
    files.add("undergrowth", stand.undergrowth(options.seed, &relief, extent, folder, budget.shrub_pairs)?);
    if options.separate_trees {
        stand.write_separately(options.seed, folder, budget.tree_pairs, &mut files)?;
    } else {
        stand.write_by_species(options.seed, folder, budget.tree_pairs, &mut files)?;
    }
    if let Some(count) = options.voxels {
        files.add_cells(crowns::write(&stand.trees, options.seed, count, folder)?);
    }
    Ok(files)
}

fn write_ground(relief: &Relief, extent: f64, cells: u64, folder: &SceneFolder) -> Result<Mesh> {
    let mut out = ObjFile::create(folder, "ground.obj", MATERIAL_FILE)?;
    out.material("forest_floor");
    ground(&mut out, relief, extent, cells)?;
    out.finish()
}

/// All trees, in rows from south to north.
struct ForestStand {
    trees: Vec<Tree>,
    leaf_area: f64,
}

impl ForestStand {
    fn plant(seed: u64, extent: f64, relief: &Relief, pairs: u64) -> ForestStand {
        let affordable = (2 * pairs / TRIANGLES_PER_TREE).max(1);
        let wanted = (TREES_PER_SQUARE_METRE * extent * extent).min(affordable as f64);
        let cells = (wanted.sqrt().round() as u64).max(1);
        let step = extent / cells as f64;
        // Noise that groups the species and leaves clearings.
        let groups = Relief::new(seed ^ 0x5EED, &[Octave { wavelength: 45.0, amplitude: 1.0 }], 0.0);
        let mut trees = Vec::new();
        for number in 0..cells * cells {
            let mut random = Random::new(seed, Topic::Stand, number);
            let place = |cell: u64, random: &mut Random| {
                let at = (cell as f64 + 0.5 + 0.6 * (2.0 * random.unit() - 1.0)) * step - 0.5 * extent;
                at.clamp(1.5 - 0.5 * extent, 0.5 * extent - 1.5)
            };
            let (x, y) = (place(number % cells, &mut random), place(number / cells, &mut random));
            let group = groups.height(x, y) + 0.25 * random.bell();
            let clearing = groups.height(x + 1000.0, y) + 0.1 * random.bell();
            if clearing > 0.62 && number > 0 {
                continue;
            }
            let species = match group {
                g if g < -0.04 => Species::Spruce,
                g if g < 0.3 => Species::Beech,
                _ => Species::Birch,
            };
            trees.push(Tree::new(seed, number, species, DVec3::new(x, y, relief.height(x, y))));
        }
        let leaf_area = trees.iter().map(Tree::leaf_area).sum();
        ForestStand { trees, leaf_area }
    }

    /// Each tree with its number of triangles, in proportion to its leaf area; the numbers add up to exactly
    /// 2·`pairs`.
    fn shares(&self, pairs: u64) -> impl Iterator<Item = (&Tree, u64)> {
        let smallest = MIN_TREE_TRIANGLES / 2;
        let spare = (pairs - smallest * self.trees.len() as u64) as f64;
        let last = self.trees.len() - 1;
        let (mut area, mut given) = (0.0, 0);
        self.trees.iter().enumerate().map(move |(i, tree)| {
            area += tree.leaf_area();
            let until = if i == last { spare as u64 } else { (spare * (area / self.leaf_area)) as u64 };
            let share = until - given;
            given = until;
            (tree, 2 * (share + smallest))
        })
    }

    fn undergrowth(
        &self,
        seed: u64,
        relief: &Relief,
        extent: f64,
        folder: &SceneFolder,
        pairs: u64,
    ) -> Result<Mesh> {
        let mut out = ObjFile::create(folder, "undergrowth.obj", MATERIAL_FILE)?;
        out.material("undergrowth");
        let shrubs = (self.trees.len() as u64 * 3 / 4).min(pairs / 8).max(1);
        for i in 0..shrubs {
            let mut random = Random::new(seed, Topic::Shrub, shrubs + i);
            let mut at = || 0.49 * extent * (2.0 * random.unit() - 1.0);
            let (x, y) = (at(), at());
            let share = pairs * (i + 1) / shrubs - pairs * i / shrubs;
            shrub(&mut out, seed, i, DVec3::new(x, y, relief.height(x, y)), share)?;
        }
        out.finish()
    }

    fn write_by_species(
        &self,
        seed: u64,
        folder: &SceneFolder,
        pairs: u64,
        scene: &mut SceneFiles,
    ) -> Result<()> {
        let mut files = Vec::new();
        for species in Species::ALL.into_iter().filter(|s| self.trees.iter().any(|t| t.species == *s)) {
            let name = format!("{}.obj", species.name());
            files.push((species, ObjFile::create(folder, &name, MATERIAL_FILE)?));
        }
        for (tree, triangles) in self.shares(pairs) {
            if let Some((_, out)) = files.iter_mut().find(|(s, _)| *s == tree.species) {
                tree.write(out, seed, triangles)?;
            }
        }
        for (species, out) in files {
            scene.add(species.name(), out.finish()?);
        }
        Ok(())
    }

    fn write_separately(
        &self,
        seed: u64,
        folder: &SceneFolder,
        pairs: u64,
        scene: &mut SceneFiles,
    ) -> Result<()> {
        folder.add_folder(TREES_FOLDER)?;
        for (i, (tree, triangles)) in self.shares(pairs).enumerate() {
            let name = format!("{TREES_FOLDER}/{:06}_{}.obj", i + 1, tree.species.name());
            let mut out = ObjFile::create(folder, &name, &format!("../{MATERIAL_FILE}"))?;
            tree.write(&mut out, seed, triangles)?;
            scene.add_part(Part { file: name, name: tree.species.name() }, out.finish()?);
        }
        Ok(())
    }
}

/// Writes a forest of few tree models, each of which is placed many times.
fn write_models(
    options: &SceneOptions,
    (models, copies): (u64, u64),
    extent: f64,
    folder: &SceneFolder,
) -> Result<SceneFiles> {
    let (seed, trees) = (options.seed, models * copies);
    let below = (options.triangles * 9 / 100).min(MAX_TRIANGLES_BELOW_MODELS);
    let cells = ground_cells(below * 2 / 3);
    let per_tree = (options.triangles - 2 * cells * cells) / trees / 2 * 2;
    let relief = Relief::new(seed, &RELIEF, extent / cells as f64);
    let mut files = SceneFiles::default();
    files.add("ground", write_ground(&relief, extent, cells, folder)?);
    folder.add_folder(TREES_FOLDER)?;
    let mut names = Vec::new();
    let mut tallest = 0.0f64;
    for number in 0..models {
        let species = Species::ALL[(number % Species::ALL.len() as u64) as usize];
        let name = format!("{TREES_FOLDER}/{:04}_{}.obj", number + 1, species.name());
        let mut out = ObjFile::create(folder, &name, &format!("../{MATERIAL_FILE}"))?;
        Tree::new(seed, number, species, DVec3::ZERO).write(&mut out, seed, per_tree)?;
        let mesh = out.finish()?;
        tallest = tallest.max(mesh.bounds.max.z);
        files.files.push(mesh.path);
        names.push(name);
    }

    let mut table = folder.file(TABLE)?;
    table.write(b"file,x,y,z,yaw,scale\n")?;
    let columns = ((trees as f64).sqrt().ceil() as u64).max(1);
    let step = extent / columns as f64;
    for number in 0..trees {
        let mut random = Random::new(seed, Topic::Stand, number);
        let mut at = |cell: u64| (cell as f64 + 0.5 + 0.8 * (random.unit() - 0.5)) * step - 0.5 * extent;
        let (x, y) = (at(number % columns), at(number / columns));
        let name = &names[(random.unit() * models as f64) as usize % names.len()];
        let (yaw, scale) = (360.0 * random.unit(), 0.75 + 0.5 * random.unit());
        let line = format!("{name},{x:.3},{y:.3},{:.3},{yaw:.1},{scale:.3}\n", relief.height(x, y));
        table.write(line.as_bytes())?;
    }
    files.files.push(table.finish());
    files.parts.push(Part { file: TABLE.to_owned(), name: "trees" });
    files.triangles += trees * per_tree;
    files.bounds.max.z += 1.25 * tallest;
    Ok(files)
}

/// Table of tree positions in a forest of models.
pub(super) const TABLE: &str = "trees.csv";

/// Folder of the trees that are separate parts.
pub(super) const TREES_FOLDER: &str = "trees";
