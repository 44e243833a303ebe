//! `vlscan raster`: terrain, surface, canopy height and densities of point clouds as GeoTIFF.

use super::args::RasterArgs;
use super::cloud_info::check_clouds;
use super::watch::during;
use super::{Console, messages};
use std::io::IsTerminal as _;
use std::path::Path;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileGroup, FileWriter, Patched, means_stdout, reads, refuse_unwritable};
use vlscan_base::machine;
use vlscan_base::quantity::{amount_of, number};
use vlscan_crs as crs;
use vlscan_tools::cloud::CloudSource;
use vlscan_tools::raster::{CloudRasters, RasterKind, RasterOptions};

pub fn run(args: &RasterArgs, console: &Console) -> Result<()> {
    let requested = args.files.requested();
    check(args, &requested)?;
    check_clouds(&args.clouds, console)?;
    if args.options.fill != RasterOptions::default().fill && !requested.iter().any(|(k, _)| k.needs_ground())
    {
        let mut found = Diagnostics::default();
        found.warn(None, "--fill has no effect: it is for --dtm and --chm");
        console.warnings(&found)?;
    }
    let crs = args.crs.as_ref().map(vlscan_options::Crs::wkt).transpose()?;
    let kinds: Vec<RasterKind> = requested.iter().map(|(kind, _)| *kind).collect();
    let clouds = CloudSource::files(&args.clouds);
    let max_memory = args.max_memory.map(|bytes| bytes.0);
    let max_bytes = max_memory.or_else(|| machine::memory().map(|bytes| bytes / 2));
    let read = || CloudRasters::read(&clouds, &kinds, &args.options, crs, max_bytes);
    let (rasters, found) = during(console, "reading points", read)?;
    console.warnings(&found)?;
    let [columns, rows] = rasters.size();
    let system = match rasters.crs().map(|wkt| (wkt, crs::projected_epsg(wkt))) {
        Some((_, Some(code))) => format!("EPSG:{code}"),
        Some((wkt, None)) => format!("no coordinate system: {} has no EPSG code", crs::name(wkt)),
        None => "no coordinate system: the clouds name none; add it with --crs EPSG:25832".to_owned(),
    };
    let noise = match rasters.noise {
        0 => String::new(),
        count => format!(", without {} of noise (classes 7 and 18)", amount_of(count as f64, "point")),
    };
    let misses = match rasters.misses {
        0 => String::new(),
        count => format!(", without {} that returned nothing", amount_of(count as f64, "pulse")),
    };
    let mut group = FileGroup::default();
    for (kind, path) in requested.iter().filter(|(_, path)| !means_stdout(path)) {
        let raster = during(console, "making rasters", || rasters.geotiff(*kind))?;
        group.write(path, args.force, &raster)?;
    }
    for (kind, _) in requested.iter().filter(|(_, path)| means_stdout(path)) {
        FileWriter::stdout(Patched::Never)?.append(&rasters.geotiff(*kind)?)?;
    }
    group.commit()?;
    for (kind, path) in &requested {
        let text = format!(
            "{}: {} of {}, {columns} by {rows} cells of {} m, {system}{noise}{misses}{}",
            if means_stdout(path) { "stdout".to_owned() } else { path.display().to_string() },
            kind.name(),
            amount_of(rasters.points as f64, "point"),
            number(rasters.side()),
            terrain_reach(*kind, &rasters),
        );
        console.wrote(messages::written(path, kind.name()), text);
    }
    Ok(())
}

/// The distance from ground points up to which a raster has terrain; empty for others.
fn terrain_reach(kind: RasterKind, rasters: &CloudRasters) -> String {
    match kind.needs_ground() {
        true => format!(", terrain up to {} m from ground points (--fill)", number(rasters.fill())),
        false => String::new(),
    }
}

/// Rejects files that would replace others, before anything is read.
fn check(args: &RasterArgs, requested: &[(RasterKind, &Path)]) -> Result<()> {
    if requested.is_empty() {
        return Err(Error::input(
            "no raster requested: give at least one of --dtm, --dsm, --chm, --density, --pulse-density",
        ));
    }
    for (i, (kind, path)) in requested.iter().enumerate() {
        if let Some((other, _)) = requested[..i].iter().find(|(_, other)| other == path) {
            let (one, other, path) = (other.name(), kind.name(), path.display());
            return Err(Error::input(format!("--{one} and --{other} are both {path}")));
        }
        if means_stdout(path) {
            if std::io::stdout().is_terminal() && !args.force {
                let name = kind.name();
                return Err(Error::input(format!(
                    "a raster is not written to a terminal: use --{name} {name}.tif, or --force"
                )));
            }
            continue;
        }
        let ending = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        if !["tif", "tiff"].contains(&&*ending) {
            let (name, path) = (kind.name(), path.display());
            return Err(Error::input(format!("--{name} {path}: expected a name that ends in .tif")));
        }
        refuse_unwritable(path, args.force)?;
        reads::refuse_input_of(path, &args.clouds)?;
    }
    Ok(())
}
