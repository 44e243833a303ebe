//! `vlscan scene info`: contents and memory of a scene.

use super::Console;
use super::args::InfoArgs;
use super::watch::during;
use serde_json::json;
use std::fmt::Write as _;
use std::time::Instant;
use vlscan_base::diag::{Diagnostics, Severity};
use vlscan_base::error::{Error, Result};
use vlscan_base::machine;
use vlscan_base::quantity::{bytes, fixed, number};
use vlscan_campaign::{NamedScene, Scanning};
use vlscan_crs as crs;
use vlscan_scene::{
    Inventory, LoadOptions, Material, MaterialArea, Pack, Part, PartFacts, Scene, TileOptions, material_areas,
};
use vlscan_session::output::ObjectIds;
use vlscan_session::{LoadedScene, check_raster_memory};
use vlscan_survey::SceneRecipe;
use vlscan_trace::{BuildOptions, Tree};

/// Maximum number of parts listed as text; `--json` lists all.
const MAX_LISTED_PARTS: usize = 40;

struct Facts<'a> {
    scene: &'a Scene,
    tree: &'a Tree,
    inventory: Inventory,
    parts: Vec<PartFacts>,
    warnings: &'a Diagnostics,
    seconds: [f64; 2],
}

pub fn run(args: &InfoArgs, console: &Console) -> Result<()> {
    let name = NamedScene { name: &args.scene, assets: &args.assets };
    let (recipe, scanning, mut warnings) = name.recipe()?;
    let started = Instant::now();
    let options = options(&recipe, &scanning, args.verify)?;
    let build = BuildOptions::default();
    check_raster_memory(&recipe, &options, build.builder, &|_| ())?;
    let (scene, found) = during(console, "loading the scene", || vlscan_scene::load(&recipe, &options))?;
    warnings.extend(found);
    let loaded = started.elapsed().as_secs_f64();
    // Before the tree: duplicates are found by 8 bytes for each triangle.
    let (inventory, parts) = (Inventory::of(&scene), PartFacts::of_scene(&scene));
    let started = Instant::now();
    let tree = during(console, "building the tree", || scene.tree(&build));
    let built = started.elapsed().as_secs_f64();
    let facts =
        Facts { scene: &scene, tree: &tree, inventory, parts, warnings: &warnings, seconds: [loaded, built] };
    // JSON holds them.
    match args.json {
        true => warnings.clone().finish(console.is_strict()).map(drop)?,
        false => console.warnings(&warnings)?,
    }
    let text = if args.json { facts.json()? } else { facts.text() };
    if let Some(tiles) = &scene.tiles {
        tiles.check()?;
    }
    vlscan_base::files::write_stdout(&text)
}

/// Returns the options under which a scene loads; for a packed scene those that it was packed with.
pub(super) fn options(recipe: &SceneRecipe, scanning: &Scanning, verify: bool) -> Result<LoadOptions> {
    let options = LoadOptions {
        wavelength_nm: scanning.wavelength_nm,
        further_wavelengths_nm: scanning.further_wavelengths_nm.clone(),
        rules: scanning.corrections,
        max_memory: machine::memory(),
        ..LoadOptions::default()
    };
    let Some(path) = &recipe.packed else {
        if verify {
            return Err(Error::input("--verify applies to packed scenes (.vlscene) only"));
        }
        return Ok(options);
    };
    let pack = Pack::open(path)?;
    if verify {
        pack.verify()?;
    }
    // A scene can be larger than the memory if its tiles are loaded one after the other.
    let memory = options.max_memory.map_or(u64::MAX, |limit| limit / 2);
    let tiles = pack.has_tiles(0).then(|| TileOptions { memory, trees: BuildOptions::default() });
    Ok(LoadOptions { tiles, ..pack.load_options(options) })
}

/// The facts of a loaded scene as `vlscan scene info --json` writes them, without the times of loading.
///
/// # Errors
/// [`Error::Input`] when the tree over the scene would exceed the memory limit.
pub fn scene_json(loaded: &LoadedScene) -> Result<String> {
    let (scene, warnings) = (loaded.scene(), Diagnostics::default());
    let (inventory, parts) = (Inventory::of(scene), PartFacts::of_scene(scene));
    let tree = loaded.tree(&|_| ())?;
    Facts { scene, tree, inventory, parts, warnings: &warnings, seconds: [0.0; 2] }.json()
}

impl Facts<'_> {
    fn per_primitive(&self, bytes: usize) -> f64 {
        bytes as f64 / (self.inventory.primitives() as f64).max(1.0)
    }

    fn text(&self) -> String {
        let (i, mut out) = (&self.inventory, String::new());
        let mut line = |name: &str, text: String| {
            let _ = writeln!(out, "{name:<12}{text}");
        };
        line(
            "primitives",
            format!(
                "{} ({} triangles, {} voxels)",
                i.primitives(),
                i.triangles + i.instanced_triangles,
                i.cubes
            ),
        );
        if i.instances > 0 {
            line(
                "instances",
                format!("{} of {} meshes, {} triangles", i.instances, i.models, i.instanced_triangles),
            );
        }
        let (b, size) = (i.bounds, i.bounds.size());
        for (name, lo, hi, size) in [
            ("x", b.min.x, b.max.x, size.x),
            ("y", b.min.y, b.max.y, size.y),
            ("z", b.min.z, b.max.z, size.z),
        ] {
            line(name, format!("{} to {} m ({size:.3} m)", fixed(lo, 3), fixed(hi, 3)));
        }
        let crs = self.scene.crs.as_deref().map(crs::name);
        line("coordinates", crs.unwrap_or_else(|| i.coordinates().to_owned()));
        let (scene, tree) = (self.scene.memory(), self.tree.memory());
        let memory = |size: usize, seconds: f64| {
            format!("{}, {:.1} B per primitive, {seconds:.2} s", bytes(size as u64), self.per_primitive(size))
        };
        line("scene", memory(scene, self.seconds[0]));
        line("tree", memory(tree, self.seconds[1]));
        line(
            "together",
            format!(
                "{}, {:.1} B per primitive",
                bytes((scene + tree) as u64),
                self.per_primitive(scene + tree)
            ),
        );
        let s = self.tree.statistics();
        if let Some(tiles) = &self.scene.tiles {
            let (count, all) = (tiles.facts().len(), bytes(tiles.bytes()));
            line("tiles", format!("{count}, {all} if all are in memory"));
        }
        line("", format!("{} leaves, {} nodes, depth {}", s.leaves, s.interior, s.max_depth));
        self.write_materials(&mut out);
        self.write_parts(&mut out);
        for fault in self.inventory.faults() {
            let _ = writeln!(out, "\nwarning: {fault}");
        }
        out
    }

    /// Writes the table of materials.
    fn write_materials(&self, out: &mut String) {
        let _ = writeln!(
            out,
            "\nmaterials   {:>12}  {:>12}  {:>12}  {:>11}  {:>5}  ground  name",
            "primitives", "area, m²", "leaves, m²", "reflectance", "class"
        );
        let areas = material_areas(self.scene, &self.parts);
        for ((m, count), area) in self.scene.materials.iter().zip(&self.inventory.of_material).zip(&areas) {
            let ground = if m.is_ground { "yes" } else { "no" };
            let (all, leaves) = (number(area.total()), known(area.leaves(m)));
            let _ = writeln!(
                out,
                "            {count:>12}  {all:>12}  {leaves:>12}  {:>11}  {:>5}  {ground:<6}  {}",
                m.reflectance, m.classification, m.name
            );
        }
    }

    /// Writes the table of parts.
    fn write_parts(&self, out: &mut String) {
        let _ = writeln!(out, "\nparts       {:>12}  {:>12}  id  name", "primitives", "leaves, m²");
        let parts = self.scene.parts.iter().zip(&self.inventory.of_part).zip(&self.parts);
        for ((part, count), facts) in parts.take(MAX_LISTED_PARTS) {
            let leaves = known(facts.leaf_area(self.scene));
            let _ = writeln!(out, "            {count:>12}  {leaves:>12}  {}  {}", part.id, part.name);
        }
        if let Some(more) = self.scene.parts.len().checked_sub(MAX_LISTED_PARTS).filter(|n| *n > 0) {
            let _ = writeln!(out, "            and {more} more; --json lists all");
        }
    }

    /// The parts as objects of JSON.
    fn parts_json(&self) -> Vec<serde_json::Value> {
        let ids: Vec<String> = self.scene.parts.iter().map(|part| part.id.clone()).collect();
        let objects = ObjectIds::new(&ids);
        let part = |(index, (part, facts)): (u32, (&Part, &PartFacts))| {
            let (b, is_empty) = (facts.bounds, facts.primitives == 0);
            json!({
                "id": part.id,
                "name": part.name,
                "object": objects.of_part(index),
                "primitives": facts.primitives,
                "class": facts.class(self.scene), "materials": facts.material_names(self.scene),
                "areas_m2": facts.areas.iter().map(MaterialArea::total).collect::<Vec<_>>(),
                "leaf_area_m2": facts.leaf_area(self.scene),
                "position_m": (!is_empty).then(|| [b.centre().x, b.centre().y, b.min.z]),
                "height_m": (!is_empty).then(|| b.size().z),
            })
        };
        (0..).zip(self.scene.parts.iter().zip(&self.parts)).map(part).collect()
    }

    fn json(&self) -> Result<String> {
        let i = &self.inventory;
        let point = |p: vlscan_geom::DVec3| [p.x, p.y, p.z];
        let material = |((m, n), area): ((&Material, &u64), MaterialArea)| {
            json!({
                "name": m.name,
                "reflectance": m.reflectance,
                "class": m.classification,
                "ground": m.is_ground,
                "primitives": n, "area_m2": area.total(), "leaf_area_m2": area.leaves(m),
            })
        };
        let areas = material_areas(self.scene, &self.parts);
        let materials: Vec<_> =
            self.scene.materials.iter().zip(&i.of_material).zip(areas).map(material).collect();
        let messages = |severity| {
            let found = self.warnings.items().iter().filter(move |d| d.severity == severity);
            found.map(|d| d.message.clone())
        };
        let warnings: Vec<_> = messages(Severity::Warning).chain(self.inventory.faults()).collect();
        let notes: Vec<_> = messages(Severity::Note).collect();
        let (scene, tree, s) = (self.scene.memory(), self.tree.memory(), self.tree.statistics());
        let leaves = self.parts.iter().filter_map(|facts| facts.leaf_area(self.scene));
        let leaf_area = leaves.reduce(|sum, area| sum + area);
        let facts = json!({
            "primitives": i.primitives(),
            "triangles": i.triangles + i.instanced_triangles,
            "voxels": i.cubes,
            "instances": i.instances,
            "models": i.models,
            "instanced_triangles": i.instanced_triangles,
            "bounds_m": { "min": point(i.bounds.min), "max": point(i.bounds.max) },
            "coordinates": i.coordinates(),
            "crs": self.scene.crs,
            "memory_bytes": {
                "scene": scene,
                "tree": tree,
                "per_primitive": self.per_primitive(scene + tree),
            },
            "seconds": { "load": self.seconds[0], "tree": self.seconds[1] },
            "tree": { "leaves": s.leaves, "nodes": s.interior, "depth": s.max_depth },
            "tiles": self.scene.tiles.as_ref().map_or(0, |tiles| tiles.facts().len()),
            "slivers": i.slivers,
            "duplicates": i.duplicates,
            "duplicate_voxels": i.duplicate_cubes,
            "duplicate_instances": i.duplicate_instances,
            "leaf_area_m2": leaf_area,
            "parts": self.parts_json(),
            "materials": materials,
            "warnings": warnings,
            "notes": notes,
        });
        let text = serde_json::to_string_pretty(&facts).map_err(|e| Error::Internal(e.to_string()))?;
        Ok(text + "\n")
    }
}

/// A leaf area for a column.
fn known(area: Option<f64>) -> String {
    area.map_or("unknown".to_owned(), number)
}
