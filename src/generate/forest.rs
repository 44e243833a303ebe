//! A mixed forest on rolling ground.

use super::chance::{Dice, Octave, Relief, Topic};
use super::obj::{Mesh, NewFile, ObjFile};
use super::solid::{ground, ground_cells};
use super::tree::{SMALLEST_TREE, Species, Tree, shrub};
use super::{Assembly, Part, SceneOptions, crowns};
use crate::error::Result;
use crate::geom::DVec3;
use std::path::Path;

pub(super) const MATERIALS_FILE: &str = "forest.mtl";
pub(super) const MATERIALS: &str = "\
# helios_reflectance: per cent at 1064 nm. Classes: 2 ground, 3 low vegetation, 4 wood, 5 leaves and needles.
newmtl forest_floor
Kd 0.36 0.29 0.20
helios_reflectance 35
helios_classification 2
helios_isGround true

newmtl undergrowth
Kd 0.25 0.48 0.18
helios_reflectance 48
helios_classification 3
helios_isGround false

newmtl spruce_bark
Kd 0.33 0.24 0.17
helios_reflectance 38
helios_classification 4
helios_isGround false

newmtl spruce_needles
Kd 0.12 0.32 0.16
helios_reflectance 42
helios_classification 5
helios_isGround false

newmtl beech_bark
Kd 0.48 0.46 0.42
helios_reflectance 45
helios_classification 4
helios_isGround false

newmtl beech_leaves
Kd 0.24 0.52 0.14
helios_reflectance 56
helios_classification 5
helios_isGround false

newmtl birch_bark
Kd 0.82 0.80 0.76
helios_reflectance 62
helios_classification 4
helios_isGround false

newmtl birch_leaves
Kd 0.42 0.60 0.18
helios_reflectance 54
helios_classification 5
helios_isGround false
";

/// 1 M triangles are 200 m × 200 m.
pub(super) fn default_extent(triangles: u64) -> f64 {
    (200.0 * (triangles as f64 / 1e6).sqrt()).max(40.0)
}

/// The extent of a stand of so many trees.
pub(super) fn extent_of_stand(trees: u64) -> f64 {
    (trees as f64 / TREES_PER_SQUARE_METRE).sqrt().max(40.0)
}

/// Fewest triangles per tree of a forest of models: some of them go to the ground.
pub(super) const SMALLEST_MODEL: u64 = 2 * SMALLEST_TREE;

/// Most triangles that the ground and the undergrowth of a forest of models take together.
const MOST_BELOW_MODELS: u64 = 4_000_000;

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

/// What a number of triangles is spent on.
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

pub(super) fn write(
    options: &SceneOptions,
    extent: f64,
    folder: &Path,
    progress: &mut dyn FnMut(f64),
) -> Result<Assembly> {
    if let Some((models, copies)) = options.instances {
        return write_models(options, (models, copies), extent, folder, progress);
    }
    let budget = Budget::of(options.triangles);
    let relief = Relief::new(options.seed, &RELIEF, extent / budget.cells as f64);
    let stand = Stand::plant(options.seed, extent, &relief, budget.tree_pairs);
    let mut assembly = Assembly::default();

    let mut floor = ObjFile::create(&folder.join("ground.obj"), MATERIALS_FILE)?;
    floor.material("forest_floor");
    ground(&mut floor, &relief, extent, budget.cells, |done| progress(0.06 * done))?;
    assembly.add("ground", floor.finish()?);
    assembly
        .add("undergrowth", stand.undergrowth(options.seed, &relief, extent, folder, budget.shrub_pairs)?);
    let trees_progress = &mut |done: f64| progress(0.1 + 0.9 * done);
    if options.separate_trees {
        stand.write_separately(options.seed, folder, budget.tree_pairs, &mut assembly, trees_progress)?;
    } else {
        stand.write_by_species(options.seed, folder, budget.tree_pairs, &mut assembly, trees_progress)?;
    }
    if let Some(count) = options.voxels {
        assembly.add_cells(crowns::write(&stand.trees, options.seed, count, folder)?);
    }
    Ok(assembly)
}

/// All trees, in rows from south to north.
struct Stand {
    trees: Vec<Tree>,
    leaf_area: f64,
}

impl Stand {
    fn plant(seed: u64, extent: f64, relief: &Relief, pairs: u64) -> Stand {
        let affordable = (2 * pairs / TRIANGLES_PER_TREE).max(1);
        let wanted = (TREES_PER_SQUARE_METRE * extent * extent).min(affordable as f64);
        let cells = (wanted.sqrt().round() as u64).max(1);
        let step = extent / cells as f64;
        // Where the species stand in groups, and where the clearings are.
        let groups = Relief::new(seed ^ 0x5EED, &[Octave { wavelength: 45.0, amplitude: 1.0 }], 0.0);
        let mut trees = Vec::new();
        for number in 0..cells * cells {
            let mut dice = Dice::new(seed, Topic::Stand, number);
            let place = |cell: u64, dice: &mut Dice| {
                let at = (cell as f64 + 0.5 + 0.6 * (2.0 * dice.unit() - 1.0)) * step - 0.5 * extent;
                at.clamp(1.5 - 0.5 * extent, 0.5 * extent - 1.5)
            };
            let (x, y) = (place(number % cells, &mut dice), place(number / cells, &mut dice));
            let group = groups.height(x, y) + 0.25 * dice.bell();
            let clearing = groups.height(x + 1000.0, y) + 0.1 * dice.bell();
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
        Stand { trees, leaf_area }
    }

    /// Each tree with its number of triangles, by leaf area; the shares add up to 2·`pairs` exactly.
    fn shares(&self, pairs: u64) -> impl Iterator<Item = (&Tree, u64)> {
        let smallest = SMALLEST_TREE / 2;
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
        folder: &Path,
        pairs: u64,
    ) -> Result<Mesh> {
        let mut out = ObjFile::create(&folder.join("undergrowth.obj"), MATERIALS_FILE)?;
        out.material("undergrowth");
        let shrubs = (self.trees.len() as u64 * 3 / 4).min(pairs / 8).max(1);
        for i in 0..shrubs {
            let mut dice = Dice::new(seed, Topic::Shrub, shrubs + i);
            let mut at = || 0.49 * extent * (2.0 * dice.unit() - 1.0);
            let (x, y) = (at(), at());
            let share = pairs * (i + 1) / shrubs - pairs * i / shrubs;
            shrub(&mut out, seed, i, DVec3::new(x, y, relief.height(x, y)), share)?;
        }
        out.finish()
    }

    fn write_by_species(
        &self,
        seed: u64,
        folder: &Path,
        pairs: u64,
        assembly: &mut Assembly,
        progress: &mut dyn FnMut(f64),
    ) -> Result<()> {
        let mut files = Vec::new();
        for species in Species::ALL.into_iter().filter(|s| self.trees.iter().any(|t| t.species == *s)) {
            let path = folder.join(format!("{}.obj", species.name()));
            files.push((species, ObjFile::create(&path, MATERIALS_FILE)?));
        }
        for (i, (tree, triangles)) in self.shares(pairs).enumerate() {
            if let Some((_, out)) = files.iter_mut().find(|(s, _)| *s == tree.species) {
                tree.write(out, seed, triangles)?;
            }
            progress((i + 1) as f64 / self.trees.len() as f64);
        }
        for (species, out) in files {
            assembly.add(species.name(), out.finish()?);
        }
        Ok(())
    }

    fn write_separately(
        &self,
        seed: u64,
        folder: &Path,
        pairs: u64,
        assembly: &mut Assembly,
        progress: &mut dyn FnMut(f64),
    ) -> Result<()> {
        let trees = folder.join(TREES_FOLDER);
        std::fs::create_dir_all(&trees).map_err(|e| crate::Error::io("create", &trees, e))?;
        for (i, (tree, triangles)) in self.shares(pairs).enumerate() {
            let name = format!("{TREES_FOLDER}/{:06}_{}.obj", i + 1, tree.species.name());
            let mut out = ObjFile::create(&folder.join(&name), &format!("../{MATERIALS_FILE}"))?;
            tree.write(&mut out, seed, triangles)?;
            assembly.add_part(Part { file: name, name: tree.species.name() }, out.finish()?);
            progress((i + 1) as f64 / self.trees.len() as f64);
        }
        Ok(())
    }
}

/// A forest of few trees that stand in many places.
fn write_models(
    options: &SceneOptions,
    (models, copies): (u64, u64),
    extent: f64,
    folder: &Path,
    progress: &mut dyn FnMut(f64),
) -> Result<Assembly> {
    let (seed, trees) = (options.seed, models * copies);
    let below = (options.triangles * 9 / 100).min(MOST_BELOW_MODELS);
    let cells = ground_cells(below * 2 / 3);
    let per_tree = (options.triangles - 2 * cells * cells) / trees / 2 * 2;
    let relief = Relief::new(seed, &RELIEF, extent / cells as f64);
    let mut assembly = Assembly::default();
    let mut floor = ObjFile::create(&folder.join("ground.obj"), MATERIALS_FILE)?;
    floor.material("forest_floor");
    ground(&mut floor, &relief, extent, cells, |done| progress(0.3 * done))?;
    assembly.add("ground", floor.finish()?);

    let models_folder = folder.join(TREES_FOLDER);
    std::fs::create_dir_all(&models_folder).map_err(|e| crate::Error::io("create", &models_folder, e))?;
    let mut names = Vec::new();
    let mut tallest = 0.0f64;
    for number in 0..models {
        let species = Species::ALL[(number % Species::ALL.len() as u64) as usize];
        let name = format!("{TREES_FOLDER}/{:04}_{}.obj", number + 1, species.name());
        let mut out = ObjFile::create(&folder.join(&name), &format!("../{MATERIALS_FILE}"))?;
        Tree::new(seed, number, species, DVec3::ZERO).write(&mut out, seed, per_tree)?;
        let mesh = out.finish()?;
        tallest = tallest.max(mesh.bounds.max.z);
        assembly.files.push(mesh.path);
        names.push(name);
        progress(0.3 + 0.5 * (number + 1) as f64 / models as f64);
    }

    let mut table = NewFile::create(&folder.join(TABLE))?;
    table.write(b"file,x,y,z,yaw,scale\n")?;
    let columns = ((trees as f64).sqrt().ceil() as u64).max(1);
    let step = extent / columns as f64;
    for number in 0..trees {
        let mut dice = Dice::new(seed, Topic::Stand, number);
        let mut at = |cell: u64| (cell as f64 + 0.5 + 0.8 * (dice.unit() - 0.5)) * step - 0.5 * extent;
        let (x, y) = (at(number % columns), at(number / columns));
        let name = &names[(dice.unit() * models as f64) as usize % names.len()];
        let (yaw, scale) = (360.0 * dice.unit(), 0.75 + 0.5 * dice.unit());
        let line = format!("{name},{x:.3},{y:.3},{:.3},{yaw:.1},{scale:.3}\n", relief.height(x, y));
        table.write(line.as_bytes())?;
    }
    assembly.files.push(table.finish()?);
    assembly.parts.push(Part { file: TABLE.to_owned(), name: "trees" });
    assembly.triangles += trees * per_tree;
    assembly.bounds.max.z += 1.25 * tallest;
    Ok(assembly)
}

/// Where the trees of a forest of models stand.
pub(super) const TABLE: &str = "trees.csv";

/// Where trees go that are parts of their own.
pub(super) const TREES_FOLDER: &str = "trees";
