//! Writes a stand: `stand.xml` with a scene per epoch, the tables of its trees, and what their labels mean.

use super::choose::{choose, stream};
use super::epochs::{Development, next_epoch};
use super::inventory::{Inventory, Tree};
use super::models::{Model, Models};
use crate::columns::quoted;
use crate::error::{Error, Result};
use crate::files::{FileWriter, NewFolder, Patched};
use crate::markup::escaped;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// What a stand is made of.
pub struct StandOptions<'o> {
    /// Seed of choice, yaw, thinning and storm.
    pub seed: u64,
    /// Files of the terrain: meshes (.obj) and rasters (.tif).
    pub terrain: &'o [PathBuf],
    /// Height of the ground at x, y, m; `None` leaves z as the inventory has it.
    pub ground: &'o dyn Fn(f64, f64) -> Option<f64>,
    /// Whether a tree at x, y stands. Others keep their numbers, so that those that stand are the same models without them.
    pub stands: &'o dyn Fn([f64; 2]) -> bool,
    /// Number of epochs, at least 1.
    pub epochs: u32,
    pub development: Development,
    /// Replaces files that exist.
    pub overwrite: bool,
}

/// What was made.
#[derive(Clone, Debug)]
pub struct StandMade {
    /// The scene's file.
    pub scene: PathBuf,
    /// Trees in each epoch.
    pub trees: Vec<usize>,
    /// Trees of species of which there is no model, by species.
    pub unmatched_species: Vec<(String, usize)>,
    /// Trees where the terrain has no ground.
    pub off_terrain: usize,
}

/// Writes a stand into `folder`.
///
/// # Errors
/// [`Error::Io`], [`Error::Input`] if a file exists or a name is not UTF-8.
pub fn write_stand(
    inventory: &Inventory,
    models: &Models,
    options: &StandOptions,
    folder: &Path,
) -> Result<StandMade> {
    let terrain: Vec<String> = options.terrain.iter().map(|path| absolute(path)).collect::<Result<_>>()?;
    let meshes: Vec<String> =
        models.models.iter().map(|model| absolute(&model.path)).collect::<Result<_>>()?;
    let kept = NewFolder::create_all(folder).map_err(|e| Error::io("create", folder, e))?;
    let mut made = StandMade {
        scene: folder.join("stand.xml"),
        trees: Vec::new(),
        unmatched_species: Vec::new(),
        off_terrain: 0,
    };
    let all = inventory.trees.iter().cloned().enumerate();
    let mut trees: Vec<(usize, Tree)> =
        all.filter(|(_, tree)| (options.stands)([tree.position[0], tree.position[1]])).collect();
    let mut scenes = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<document>\n");
    for epoch in 0..options.epochs {
        if epoch > 0 {
            trees = next_epoch(&trees, &options.development, epoch, options.seed);
        }
        if trees.is_empty() && terrain.is_empty() {
            return Err(Error::input(format!("no tree is left in epoch {epoch}, and there is no terrain")));
        }
        let suffix = if options.epochs > 1 { format!("_{epoch}") } else { String::new() };
        let table = Tables::of(
            &trees,
            &models.models,
            &meshes,
            options,
            terrain.len(),
            (epoch == 0).then_some(&mut made),
        );
        save(&folder.join(format!("trees{suffix}.csv")), &table.instances, options.overwrite)?;
        save(&folder.join(format!("labels{suffix}.csv")), &table.labels, options.overwrite)?;
        let instances = (!trees.is_empty()).then(|| format!("trees{suffix}.csv"));
        scene(&mut scenes, &format!("stand{suffix}"), &terrain, instances.as_deref());
        made.trees.push(trees.len());
    }
    scenes.push_str("</document>\n");
    save(&made.scene, &scenes, options.overwrite)?;
    kept.keep();
    Ok(made)
}

/// A path that is found from every folder.
fn absolute(path: &Path) -> Result<String> {
    let whole = std::path::absolute(path).map_err(|e| Error::open(path, e))?;
    let name = whole.to_str().filter(|name| !name.contains([',', '\n']));
    name.map(str::to_owned).ok_or_else(|| {
        Error::input(format!(
            "{}: a name with a comma or bytes that are no UTF-8 cannot stand in a table",
            path.display()
        ))
    })
}

fn save(path: &Path, text: &str, overwrite: bool) -> Result<()> {
    if path.exists() && !overwrite {
        return Err(Error::input(format!("{} exists; --force overwrites it", path.display())));
    }
    let mut file = FileWriter::create(path, overwrite, Patched::Never)?;
    file.append(text.as_bytes())?;
    file.finish().map(|_| ())
}

/// The tables of one epoch.
struct Tables {
    instances: String,
    labels: String,
}

impl Tables {
    fn of(
        trees: &[(usize, Tree)],
        models: &[Model],
        meshes: &[String],
        options: &StandOptions,
        first_part: usize,
        mut made: Option<&mut StandMade>,
    ) -> Tables {
        let stream = stream(options.seed);
        let mut tables = Tables {
            instances: "file,x,y,z,yaw,scale\n".to_owned(),
            labels: "part,id,species,model,x,y,z,height,crown,dbh\n".to_owned(),
        };
        for (row, (number, tree)) in trees.iter().enumerate() {
            let choice = choose(tree, *number, models, &stream);
            let model = &models[choice.model];
            let [x, y, own_z] = tree.position;
            let ground = (options.ground)(x, y);
            if let Some(made) = made.as_deref_mut() {
                made.off_terrain += usize::from(!options.terrain.is_empty() && ground.is_none());
                if !choice.same_species {
                    made.count_unmatched(tree.species.as_deref().unwrap_or_default());
                }
            }
            let z = ground.unwrap_or(own_z);
            // The foot of the model comes to lie on the place of the tree.
            let (sin, cos) = libm::sincos(choice.yaw.to_radians());
            let [fx, fy, fz] = model.foot.map(|v| v * choice.scale);
            let place = [x - (cos * fx - sin * fy), y - (sin * fx + cos * fy), z - fz];
            // Writing to a string does not fail.
            let _ = writeln!(
                tables.instances,
                "{},{:.4},{:.4},{:.4},{:.3},{:.6}",
                meshes[choice.model], place[0], place[1], place[2], choice.yaw, choice.scale
            );
            let optional = |value: Option<f64>| value.map(|v| format!("{v:.3}")).unwrap_or_default();
            let _ = writeln!(
                tables.labels,
                "{},{},{},{},{x:.4},{y:.4},{z:.4},{:.3},{},{}",
                first_part + row,
                quoted(&tree.id),
                quoted(tree.species.as_deref().unwrap_or(&model.species)),
                quoted(&model.path.file_stem().unwrap_or_default().to_string_lossy()),
                tree.height,
                optional(tree.crown),
                optional(tree.stem),
            );
        }
        tables
    }
}

impl StandMade {
    fn count_unmatched(&mut self, species: &str) {
        match self.unmatched_species.iter_mut().find(|(name, _)| name == species) {
            Some((_, count)) => *count += 1,
            None => self.unmatched_species.push((species.to_owned(), 1)),
        }
    }
}

/// Adds a scene of the terrain and of a table of instances.
fn scene(out: &mut String, id: &str, terrain: &[String], instances: Option<&str>) {
    let _ = writeln!(out, "  <scene id=\"{id}\" name=\"{id}\">");
    for path in terrain {
        let is_raster = Path::new(path).extension().is_some_and(|e| !e.eq_ignore_ascii_case("obj"));
        let loader = if is_raster { "geotiffloader" } else { "objloader" };
        let _ = writeln!(
            out,
            "    <part>\n      <filter type=\"{loader}\"><param type=\"string\" key=\"filepath\" value=\"{}\"/></filter>\n    </part>",
            escaped(path)
        );
    }
    if let Some(table) = instances {
        let _ = writeln!(
            out,
            "    <part>\n      <filter type=\"instances\"><param type=\"string\" key=\"filepath\" value=\"{table}\"/></filter>\n    </part>"
        );
    }
    out.push_str("  </scene>\n");
}
