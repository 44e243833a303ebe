//! `vlscan scene pack`: a scene compiled to one file.

use super::args::PackArgs;
use super::coverage::has_extension;
use super::watch::during;
use super::{Console, messages};
use std::time::Instant;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{is_special, refuse_unwritable};
use vlscan_base::machine;
use vlscan_base::quantity::{amount, bytes};
use vlscan_campaign::NamedScene;
use vlscan_lidar::pulse::PhysicsProfile;
use vlscan_messages::WrittenFile;
use vlscan_scene::{LoadOptions, TileOptions};
use vlscan_trace::BuildOptions;

pub fn run(args: &PackArgs, console: &Console) -> Result<()> {
    let started = Instant::now();
    let name = NamedScene { name: &args.scene, assets: &args.assets };
    let (recipe, found, warnings) = name.recipe()?;
    console.warnings(&warnings)?;
    let out = args.out.clone().unwrap_or_else(|| recipe.path.with_extension("vlscene"));
    // Only such names are opened as scenes; pipes and devices have any name.
    if !has_extension(&out, &["vlscene"]) && !is_special(&out) {
        return Err(Error::input(format!("-o {}: expected a name that ends in .vlscene", out.display())));
    }
    refuse_unwritable(&out, args.force)?;
    let seed = args.seed.map(|seed| seed.0).or(found.seed).unwrap_or(0);
    let corrections = args.physics.map_or(found.corrections, PhysicsProfile::corrections);
    let tree = BuildOptions::of(args.tree.unwrap_or_default());
    let tiles = args.scene_memory.map(|bytes| TileOptions { memory: bytes.0, trees: tree.clone() });
    let options = LoadOptions {
        wavelength_nm: args.wavelength.map_or(found.wavelength_nm, |nm| nm.0),
        further_wavelengths_nm: match (args.wavelength, corrections.channel_spectra) {
            (None, true) => found.further_wavelengths_nm,
            _ => Vec::new(),
        },
        seed,
        rules: corrections,
        sharing: args.instances.unwrap_or_default(),
        max_memory: machine::memory(),
        tiles,
        colours: args.colours,
        ..LoadOptions::default()
    };
    let packed = during(console, "packing the scene", || {
        vlscan_scene::pack(&recipe, &options, &tree, &out, &|found| console.warnings(found))
    })?;
    let loaded = started.elapsed().as_secs_f64();
    let opens = packed.opens.map(|time| time.as_secs_f64());
    let loaded = loaded - opens.unwrap_or(0.0);
    let opens = opens.map_or(String::new(), |seconds| format!(", opens in {:.1} ms", seconds * 1e3));
    let epochs = if packed.epochs > 1 { format!(" in {} epochs", packed.epochs) } else { String::new() };
    let file = WrittenFile { bytes: Some(packed.bytes), ..messages::written(&out, "scene") };
    let text = format!(
        "{}  {} primitives{epochs}, {}; packed in {loaded:.1} s{opens}",
        out.display(),
        amount(packed.primitives as f64),
        bytes(packed.bytes)
    );
    console.wrote(file, text);
    Ok(())
}
