//! Writes a stand: `stand.xml` with a scene per epoch, the tables of its trees, and what their labels mean.

use super::choose::{Choice, choose, stream};
use super::epochs::next_epoch;
use super::inventory::{Inventory, Tree};
use super::make::StandOptions;
use super::models::{MODEL_FOLDER, Model, is_own_name, make_models, stands_for};
use super::stems::BREAST_HEIGHT;
use crate::generate::obj::SceneFolder;
use crate::generate::survey::DOCUMENT;
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use vlscan_base::columns::quoted;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::reads;
use vlscan_base::markup::escaped;
use vlscan_base::rng::Stream;
use vlscan_tables::input::read_file;

/// Output files of a stand, and its terrain.
pub(super) struct StandSite<'o> {
    /// Output folder.
    pub folder: &'o Path,
    /// The terrain files, which become parts of the scene.
    pub terrain: &'o [Terrain],
    /// Height of the ground at x, y, m; `None` leaves z as the inventory has it.
    pub ground: &'o dyn Fn(f64, f64) -> Option<f64>,
    /// True if a tree at x, y stands. Others keep their numbers, so that those that stand are the same models
    /// without them.
    pub stands: &'o dyn Fn([f64; 2]) -> bool,
    /// Called with the trees of the first epoch, by their number, before anything is written.
    pub told: &'o dyn Fn(usize, &StandMade) -> Result<()>,
}

/// A file of the terrain.
#[derive(Clone, Debug)]
pub(super) struct Terrain {
    /// Path of the mesh or raster.
    pub path: PathBuf,
    /// The material of the surface.
    pub surface: TerrainSurface,
}

/// Surface of a terrain.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum TerrainSurface {
    /// The materials that its file has.
    Own,
    /// Bare soil, which is part of the stand.
    Soil,
    /// A rectangle of bare soil without a file.
    Flat {
        /// Its lower corner, x and y in m.
        low: [f64; 2],
        /// Its upper corner, x and y in m.
        high: [f64; 2],
        /// Its height, m.
        height: f64,
    },
    /// A material of a file.
    Material {
        /// Path of the MTL file.
        file: PathBuf,
        /// Name of the material in that file.
        name: String,
    },
}

/// Heading of the labels: measures of the geometry as placed, then those of the inventory.
const LABELS: &str =
    "part,id,species,model,x,y,z,height,crown,dbh,species_given,height_given,crown_given,dbh_given\n";
/// Material file of a stand whose terrain has no ground of its own.
const SOIL_FILE: &str = "terrain.mtl";
/// Mesh of flat ground.
const FLAT_FILE: &str = "ground.obj";
const SOIL_NAME: &str = "soil";
const SOIL: &str = "# helios_reflectance: 0 to 1. Class 2: ground.\nnewmtl soil\nKd 0.42 0.34 0.25\n\
                    helios_reflectance 0.3\n\
                    helios_classification 2\nhelios_isGround true\n";

/// The models of trees of a species that has none of its own.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Substitute {
    /// The species of the trees, as written.
    pub species: String,
    /// Number of trees.
    pub trees: usize,
    /// The species of their models.
    pub models: BTreeSet<String>,
    /// True if these models represent the species.
    pub is_meant: bool,
}

/// Files and counts of a generated stand.
#[derive(Clone, Debug)]
pub struct StandMade {
    /// The scene's file.
    pub scene: PathBuf,
    /// Trees in each epoch.
    pub trees: Vec<usize>,
    /// Tree models that were there to choose from.
    pub models: usize,
    /// Trees of species of which there is no model, by species.
    pub substitutes: Vec<Substitute>,
    /// Trees where the terrain has no ground.
    pub off_terrain: usize,
}

/// Writes a stand. Without `models` they are generated.
///
/// # Errors
/// [`Error::Io`], [`Error::Input`] if a file exists or a name is not UTF-8.
pub(super) fn write_stand(
    inventory: &Inventory,
    models: Option<Vec<Model>>,
    options: &StandOptions,
    site: &StandSite,
) -> Result<StandMade> {
    let StandSite { folder, stands, told, .. } = *site;
    // No file is replaced before all are complete: the inventory, a model or the terrain may have one of
    // their names.
    let files = SceneFolder::create(folder, options.overwrite)?;
    let are_made = models.is_none();
    let (models, meshes) = match models {
        None => make_models(&files, options.seed)?,
        Some(models) if options.copy => {
            let names = copy_models(&models, &files)?;
            (models, names)
        }
        Some(models) => {
            let names = models.iter().map(|model| absolute(&model.path)).collect::<Result<_>>()?;
            (models, names)
        }
    };
    let set = ModelSet { models: &models, names: &meshes, are_made };
    let mut made = StandMade {
        scene: folder.join("stand.xml"),
        trees: Vec::new(),
        models: models.len(),
        substitutes: Vec::new(),
        off_terrain: 0,
    };
    let all = inventory.trees.iter().cloned().enumerate();
    let mut trees: Vec<(usize, Tree)> =
        all.filter(|(_, tree)| stands([tree.position[0], tree.position[1]])).collect();
    let mut terrain = Vec::new();
    let mut scenes = format!("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n{DOCUMENT}\n");
    for epoch in 0..options.epochs {
        if epoch > 0 {
            trees = next_epoch(&trees, &options.development, epoch, options.seed);
        }
        if trees.is_empty() && site.terrain.is_empty() {
            return Err(Error::input(format!("no tree is left in epoch {epoch}, and there is no terrain")));
        }
        let suffix = if options.epochs > 1 { format!("_{epoch}") } else { String::new() };
        let table = Tables::of(&trees, &set, options.seed, site, (epoch == 0).then_some(&mut made));
        if epoch == 0 {
            told(trees.len(), &made)?;
            terrain = write_terrain(site, &files, options.copy)?;
        }
        files.write(&format!("trees{suffix}.csv"), table.instances.as_bytes())?;
        files.write(&format!("labels{suffix}.csv"), table.labels.as_bytes())?;
        let instances = (!trees.is_empty()).then(|| format!("trees{suffix}.csv"));
        scene(&mut scenes, &format!("stand{suffix}"), &terrain, instances.as_deref());
        made.trees.push(trees.len());
    }
    scenes.push_str("</document>\n");
    files.write("stand.xml", scenes.as_bytes())?;
    files.commit()?;
    Ok(made)
}

/// A path that is found from every folder.
fn absolute(path: &Path) -> Result<String> {
    let whole = std::path::absolute(path).map_err(|e| Error::open(path, e))?;
    let name = whole.to_str().filter(|name| !name.contains([',', '\n']));
    name.map(str::to_owned).ok_or_else(|| {
        Error::input(format!(
            "{}: a name with a comma or invalid UTF-8 cannot be used in a table",
            path.display()
        ))
    })
}

/// The tables of one epoch.
struct Tables {
    instances: String,
    labels: String,
}

/// The tree models of a stand.
struct ModelSet<'m> {
    models: &'m [Model],
    /// Their names in the tables.
    names: &'m [String],
    /// True if they are those of the generator, which also represent trees of other species.
    are_made: bool,
}

impl ModelSet<'_> {
    /// Chooses the model for the tree with that number in the inventory, and returns true if it represents
    /// another species.
    fn choose(&self, tree: &Tree, number: usize, stream: &Stream) -> (Choice, bool) {
        let species = tree.species.as_deref().filter(|_| self.are_made).map(str::to_lowercase);
        let words = species.iter().flat_map(|species| species.split(|c: char| !c.is_alphabetic()));
        match words.filter_map(|word| Some((stands_for(word)?, is_own_name(word)))).next() {
            Some((species, is_own)) => {
                let tree = Tree { species: Some(species.to_owned()), ..tree.clone() };
                (choose(&tree, number, self.models, stream), !is_own)
            }
            None => (choose(tree, number, self.models, stream), false),
        }
    }
}

impl Tables {
    fn of(
        trees: &[(usize, Tree)],
        set: &ModelSet,
        seed: u64,
        site: &StandSite,
        mut made: Option<&mut StandMade>,
    ) -> Tables {
        let stream = stream(seed);
        let mut tables =
            Tables { instances: "file,x,y,z,yaw,scale,scale_xy\n".to_owned(), labels: LABELS.to_owned() };
        for (row, (number, tree)) in trees.iter().enumerate() {
            let (choice, is_meant) = set.choose(tree, *number, &stream);
            let model = &set.models[choice.model];
            let [x, y, own_z] = tree.position;
            let ground = (site.ground)(x, y);
            if let Some(made) = made.as_deref_mut() {
                made.off_terrain += usize::from(!site.terrain.is_empty() && ground.is_none());
                if is_meant || !choice.same_species {
                    let species = tree.species.as_deref().unwrap_or_default();
                    made.count_substitute(species, &model.species, is_meant);
                }
            }
            let z = ground.unwrap_or(own_z);
            let place = placed(model, &choice, [x, y, z]);
            // Writing to a string does not fail.
            let _ = writeln!(
                tables.instances,
                "{},{:.4},{:.4},{:.4},{:.3},{:.6},{:.6}",
                set.names[choice.model],
                place[0],
                place[1],
                place[2],
                choice.yaw,
                choice.scale,
                choice.scale_xy
            );
            // Another model's geometry is not that of the tree's species.
            let given = tree.species.as_deref();
            let species = given.filter(|_| choice.same_species && !is_meant).unwrap_or(&model.species);
            let dbh = model.stem.diameter(BREAST_HEIGHT / (model.height * choice.scale));
            let dbh = dbh.map(|diameter| diameter * choice.scale_xy);
            let optional = |value: Option<f64>| value.map(|v| format!("{v:.3}")).unwrap_or_default();
            let _ = writeln!(
                tables.labels,
                "{},{},{},{},{x:.4},{y:.4},{z:.4},{:.3},{:.3},{},{},{:.3},{},{}",
                site.terrain.len() + row,
                quoted(&tree.id),
                quoted(species),
                quoted(&model.path.file_stem().unwrap_or_default().to_string_lossy()),
                model.height * choice.scale,
                model.crown * choice.scale_xy,
                optional(dbh),
                quoted(given.unwrap_or_default()),
                tree.height,
                optional(tree.crown),
                optional(tree.stem),
            );
        }
        tables
    }
}

/// The position of a model whose foot comes to lie on a place.
fn placed(model: &Model, choice: &Choice, [x, y, z]: [f64; 3]) -> [f64; 3] {
    let (sin, cos) = libm::sincos(choice.yaw.to_radians());
    let [fx, fy, fz] = model.foot;
    let [fx, fy, fz] = [fx * choice.scale_xy, fy * choice.scale_xy, fz * choice.scale];
    [x - (cos * fx - sin * fy), y - (sin * fx + cos * fy), z - fz]
}

impl StandMade {
    fn count_substitute(&mut self, species: &str, model: &str, is_meant: bool) {
        let models = BTreeSet::from([model.to_owned()]);
        match self.substitutes.iter_mut().find(|known| known.species == species) {
            Some(known) => {
                known.trees += 1;
                known.models.extend(models);
            }
            None => {
                self.substitutes.push(Substitute { species: species.to_owned(), trees: 1, models, is_meant });
            }
        }
    }
}

/// Copies all files of the folder of the models, among them their materials. Returns the names of the models
/// in the stand.
fn copy_models(models: &[Model], files: &SceneFolder) -> Result<Vec<String>> {
    files.add_folder(MODEL_FOLDER)?;
    let folder = models.first().and_then(|model| model.path.parent()).unwrap_or(Path::new("."));
    for path in reads::list(folder).map_err(|e| Error::open(folder, e))?.iter().filter(|path| path.is_file())
    {
        files.write(&in_folder(MODEL_FOLDER, path)?, &content(path)?)?;
    }
    models.iter().map(|model| in_folder(MODEL_FOLDER, &model.path)).collect()
}

/// Copies a file of the terrain, with the material files beside it that an OBJ file names. Returns its name
/// in the stand.
fn copy_terrain(path: &Path, number: usize, files: &SceneFolder) -> Result<String> {
    let folder = format!("terrain_{}", number + 1);
    files.add_folder(&folder)?;
    let content = content(path)?;
    for line in content.split(|byte| *byte == b'\n').filter(|_| is_obj(path)) {
        let line = String::from_utf8_lossy(line);
        let Some(name) = line.trim().strip_prefix("mtllib ") else { continue };
        let materials = path.with_file_name(name.trim());
        if materials.is_file() {
            files.write(&in_folder(&folder, &materials)?, &self::content(&materials)?)?;
        }
    }
    let name = in_folder(&folder, path)?;
    files.write(&name, &content)?;
    Ok(name)
}

fn content(path: &Path) -> Result<Vec<u8>> {
    read_file(path, u64::MAX - 1).map_err(|e| Error::open(path, e))
}

/// The name of a copy of a file in a folder of the stand.
fn in_folder(folder: &str, path: &Path) -> Result<String> {
    let name = path.file_name().and_then(|name| name.to_str()).filter(|name| !name.contains([',', '\n']));
    name.map(|name| format!("{folder}/{name}"))
        .ok_or_else(|| Error::input(format!("{}: its name has a comma or invalid UTF-8", path.display())))
}

/// Writes the soil and the meshes that get it. Returns the loader of each terrain.
fn write_terrain(site: &StandSite, files: &SceneFolder, copy: bool) -> Result<Vec<String>> {
    let named = |number: usize, path: &Path| match copy && path.is_file() {
        true => copy_terrain(path, number, files),
        false => absolute(path),
    };
    let is_soil =
        |surface: &TerrainSurface| matches!(surface, TerrainSurface::Soil | TerrainSurface::Flat { .. });
    if site.terrain.iter().any(|terrain| is_soil(&terrain.surface)) {
        files.write(SOIL_FILE, SOIL.as_bytes())?;
    }
    let loader = |(number, terrain): (usize, &Terrain)| {
        let (file, name) = match &terrain.surface {
            TerrainSurface::Own => return Ok(mesh_loader(&named(number, &terrain.path)?)),
            TerrainSurface::Soil => (SOIL_FILE.to_owned(), SOIL_NAME),
            TerrainSurface::Flat { low: [west, south], high: [east, north], height } => {
                let corners = [[west, south], [east, south], [east, north], [west, north]];
                let vertex = |[x, y]: [&f64; 2]| format!("v {x:.4} {y:.4} {height:.4}\n");
                let mesh = format!(
                    "mtllib {SOIL_FILE}\nusemtl {SOIL_NAME}\n{}f 1 2 3\nf 1 3 4\n",
                    corners.map(vertex).concat()
                );
                files.write(FLAT_FILE, mesh.as_bytes())?;
                return Ok(mesh_loader(FLAT_FILE));
            }
            TerrainSurface::Material { file, name } => (absolute(file)?, name.as_str()),
        };
        if !is_obj(&terrain.path) {
            return Ok(raster_loader(&named(number, &terrain.path)?, &file, name));
        }
        let copy = format!("terrain_{}.obj", number + 1);
        let mesh = content(&terrain.path)?;
        files.write(&copy, &with_material(&mesh, &file, name))?;
        Ok(mesh_loader(&copy))
    };
    site.terrain.iter().enumerate().map(loader).collect()
}

fn is_obj(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("obj"))
}

/// An OBJ file all of whose faces have one material.
fn with_material(mesh: &[u8], file: &str, name: &str) -> Vec<u8> {
    let mut out = format!("mtllib {file}\nusemtl {name}\n").into_bytes();
    let is_material =
        |line: &[u8]| [&b"mtllib"[..], b"usemtl"].iter().any(|k| line.trim_ascii_start().starts_with(k));
    let lines = mesh.split_inclusive(|byte| *byte == b'\n');
    lines.filter(|line| !is_material(line)).for_each(|line| out.extend_from_slice(line));
    out
}

fn mesh_loader(file: &str) -> String {
    format!("<filter type=\"meshloader\">{}</filter>", parameter("filepath", file))
}

fn raster_loader(file: &str, material_file: &str, material: &str) -> String {
    let parameters = [("filepath", file), ("matfile", material_file), ("matname", material)];
    let parameters = parameters.map(|(key, value)| format!("\n        {}", parameter(key, value)));
    format!("<filter type=\"geotiffloader\">{}\n      </filter>", parameters.concat())
}

fn parameter(key: &str, value: &str) -> String {
    format!("<param type=\"string\" key=\"{key}\" value=\"{}\"/>", escaped(value))
}

/// Adds a scene of the terrain and of a table of instances.
fn scene(out: &mut String, id: &str, terrain: &[String], instances: Option<&str>) {
    let _ = writeln!(out, "  <scene id=\"{id}\" name=\"{id}\">");
    let table = |name: &str| format!("<filter type=\"instances\">{}</filter>", parameter("filepath", name));
    for loader in terrain.iter().cloned().chain(instances.map(table)) {
        let _ = writeln!(out, "    <part>\n      {loader}\n    </part>");
    }
    out.push_str("  </scene>\n");
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_survey::MaterialDefinition;

    #[test]
    fn soil_is_that_of_rasters_by_themselves() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(SOIL_FILE);
        std::fs::write(&path, SOIL).unwrap();
        let (mut found, _) = vlscan_scene::read_materials(&path).unwrap();
        let soil = found.remove(0);
        assert_eq!(MaterialDefinition { place: None, colour: None, ..soil }, MaterialDefinition::soil());
    }
}
