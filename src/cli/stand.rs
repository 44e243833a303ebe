//! `vlscan scene stand`: tree models placed by an inventory.

use super::Console;
use super::args::StandArgs;
use super::ground::GroundModel;
use crate::diag::Diagnostics;
use crate::error::{Error, Result};
use crate::generate::{Development, Inventory, Models, StandOptions, write_stand};
use crate::machine;
use crate::scene::LoadOptions;
use crate::survey::{ReadOptions, read_scene};

pub fn run(args: &StandArgs, console: &Console) -> Result<()> {
    make(args, &|_| true, console)
}

/// Makes a stand of the trees of the inventory at places that `stands` accepts.
pub fn make(args: &StandArgs, stands: &dyn Fn([f64; 2]) -> bool, console: &Console) -> Result<()> {
    let inventory = Inventory::read(&args.inventory)?;
    let models = Models::read(&args.trees)?;
    let mut terrain = Vec::new();
    for path in &args.terrain {
        let is_known = path
            .extension()
            .is_some_and(|e| ["obj", "tif", "tiff"].iter().any(|k| e.eq_ignore_ascii_case(k)));
        let name = path.to_str().filter(|_| is_known).ok_or_else(|| {
            Error::input(format!(
                "{}: expected a mesh (.obj) or a raster (.tif) of the terrain",
                path.display()
            ))
        })?;
        let (recipe, warnings) = read_scene(name, &ReadOptions::default())?;
        console.warnings(&warnings);
        let options = LoadOptions { max_memory: machine::memory(), ..LoadOptions::default() };
        let (ground, warnings) = GroundModel::load(&recipe, &options)?;
        console.warnings(&warnings);
        terrain.push(ground);
    }
    let ground = |x: f64, y: f64| terrain.iter().filter_map(|part| part.height(x, y)).reduce(f64::max);
    let options = StandOptions {
        seed: args.seed,
        terrain: &args.terrain,
        ground: &ground,
        stands,
        epochs: args.epochs,
        development: Development { growth: args.growth, thinning: args.thinning, storm: args.storm },
        overwrite: args.force,
    };
    let made = write_stand(&inventory, &models, &options, &args.out)?;
    let mut warnings = Diagnostics::default();
    for (species, count) in &made.unmatched_species {
        let of =
            if species.is_empty() { "without species".to_owned() } else { format!("of species `{species}`") };
        warnings.warn(None, format!("{count} trees {of} stand as others: no model's name begins with it"));
    }
    if made.off_terrain > 0 {
        let all = made.trees.first().copied().unwrap_or_default();
        let message = format!(
            "{} of {all} trees are beside the terrain and keep the inventory's z, or 0",
            made.off_terrain
        );
        warnings.warn(None, message);
    }
    console.warnings(&warnings);
    let counts: Vec<String> = made.trees.iter().map(usize::to_string).collect();
    console.say(format!(
        "{}: {} trees of {} models{}; scan them with: vlscan run SURVEY --scene {0}",
        made.scene.display(),
        counts.join(", "),
        models.models.len(),
        if counts.len() > 1 { " in the epochs stand_0, stand_1 …" } else { "" },
    ));
    Ok(())
}
