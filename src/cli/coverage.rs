//! `vlscan run --dry-run --coverage`: densities, strips, gaps, incidence and occlusion as files.

use super::args::DryRunArgs;
use super::rig::file_of;
use super::{Console, messages};
use std::path::{Path, PathBuf};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileGroup, identity, reads, refuse_unwritable};
use vlscan_base::quantity::{amount, number};
use vlscan_session::{CoverageBand, CoverageMap, Session};
use vlscan_tools::geotiff::{Band, Grid, geotiff_of_bands};
use vlscan_tools::preview::{BandMap, draw_bands};

/// Side of a cell if none is requested, m.
const DEFAULT_SIDE: f64 = 10.0;
/// Width and height of pictures, dots.
const PICTURE: [u32; 2] = [1620, 1080];

/// The side of a cell, m, if coverage is requested.
pub fn side(args: &DryRunArgs) -> Option<f64> {
    let side = args.coverage_cell.as_ref().map_or(DEFAULT_SIDE, |side| side.0);
    (!args.coverage.is_empty()).then_some(side)
}

/// Rejects files that cannot be written, before anything is measured. `scanner` is the name of one of several
/// scanners, each of which has files, too; `survey` is the file of the survey.
pub fn check(
    args: &DryRunArgs,
    scanner: Option<&str>,
    session: &Session,
    survey: &Path,
    replace: bool,
) -> Result<()> {
    check_names(args, scanner, replace)?;
    for path in &args.coverage {
        for path in scanner.map(|name| file_of(path, name)).iter().chain([path]) {
            reads::refuse_input_of(path, session.inputs().chain([survey.to_path_buf()]))?;
        }
    }
    Ok(())
}

/// [`check`] without the inputs, which a scene that is not loaded may have.
pub fn check_names(args: &DryRunArgs, scanner: Option<&str>, replace: bool) -> Result<()> {
    for (i, path) in args.coverage.iter().enumerate() {
        let refuse = |text: &str| Err(Error::input(format!("--coverage {}{text}", path.display())));
        if !is_raster(path) && !has_extension(path, &["png"]) {
            return refuse(": expected a name that ends in .tif or .png");
        }
        let is_one_of = |others: &[PathBuf], path: &Path| {
            let own = identity(path);
            others.iter().any(|other| identity(other) == own)
        };
        if is_one_of(&args.coverage[..i], path) {
            return refuse(" is given twice");
        }
        refuse_unwritable(path, replace)?;
        if let Some(name) = scanner {
            let own = file_of(path, name);
            if is_one_of(&args.coverage, &own) {
                let own = own.display();
                return refuse(&format!(": {own} is the file of the scanner `{name}` alone"));
            }
            refuse_unwritable(&own, replace)?;
        }
    }
    Ok(())
}

/// Writes the files of the coverage by several scanners: by each alone, and by all together.
pub fn write_each(
    args: &DryRunArgs,
    scanners: &[String],
    maps: &[CoverageMap],
    replace: bool,
    console: &Console,
) -> Result<()> {
    let all = CoverageMap::together(maps)?;
    let alone = scanners.iter().map(|name| Some(name.as_str())).zip(maps);
    write(args, &alone.chain([(None, &all)]).collect::<Vec<_>>(), replace, console)
}

/// Writes the files of maps: those with the name of a scanner have it in the names of their files.
pub fn write(
    args: &DryRunArgs,
    maps: &[(Option<&str>, &CoverageMap)],
    replace: bool,
    console: &Console,
) -> Result<()> {
    let mut group = FileGroup::default();
    let mut written: Vec<(PathBuf, String)> = Vec::new();
    for (scanner, map) in maps {
        if map.columns == 0 {
            let text = "no pulse of the sample has a return, so that there is no coverage to write";
            let error = Error::input(text);
            return Err(match scanner {
                Some(name) => error.named(&format!("scanner `{name}`")),
                None => error,
            });
        }
        for path in &args.coverage {
            let bytes = if is_raster(path) { raster(map)? } else { picture(map)? };
            let path = scanner.map_or_else(|| path.clone(), |name| file_of(path, name));
            group.write(&path, replace, &bytes)?;
            written.push((path, summary(map)));
        }
    }
    group.commit()?;
    for (path, summary) in written {
        let text = format!("{}: {summary}", path.display());
        console.wrote(messages::written(&path, "coverage"), text);
    }
    Ok(())
}

fn is_raster(path: &Path) -> bool {
    has_extension(path, &["tif", "tiff"])
}

/// True if the name of a file has one of these extensions, which are in lower case.
pub fn has_extension(path: &Path, endings: &[&str]) -> bool {
    let ending = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    endings.contains(&&*ending)
}

fn grid(map: &CoverageMap) -> Grid<'_> {
    Grid {
        columns: map.columns,
        rows: map.rows,
        side_m: map.side_m,
        corner: map.corner,
        crs: map.crs.as_deref(),
    }
}

fn raster(map: &CoverageMap) -> Result<Vec<u8>> {
    let bands = CoverageBand::ALL.map(|band| Band { name: band.name(), values: map.values(band) });
    geotiff_of_bands(&grid(map), &bands)
}

fn picture(map: &CoverageMap) -> Result<Vec<u8>> {
    let bands = CoverageBand::ALL.map(|band| {
        let (title, limits) = match band {
            CoverageBand::PulseDensity => ("pulses with a return per m²", None),
            CoverageBand::PointDensity => ("returns per m²", None),
            CoverageBand::Strips => ("strips", None),
            CoverageBand::Gaps => ("share without returns", Some([0.0, 1.0])),
            CoverageBand::Incidence => ("angle of incidence, °", None),
            CoverageBand::Occlusion => ("share without an echo from the ground", Some([0.0, 1.0])),
        };
        BandMap { title, values: map.values(band), limits }
    });
    draw_bands(&grid(map), &bands, PICTURE).png()
}

/// Size of a map, and the densities of the cells with returns.
fn summary(map: &CoverageMap) -> String {
    let densities = map.values(CoverageBand::PulseDensity).iter().copied();
    let mut densities: Vec<f64> = densities.filter(|density| *density > 0.0).collect();
    densities.sort_unstable_by(f64::total_cmp);
    let of_rank = |share: f64| {
        let rank = (share * densities.len() as f64) as usize;
        densities.get(rank.min(densities.len().saturating_sub(1))).copied().unwrap_or(0.0)
    };
    format!(
        "coverage of {} by {} cells of {} m from {} pulses; pulses with a return per m²: median {:.2}, 5 % \
         of the cells with returns below {:.2}",
        map.columns,
        map.rows,
        number(map.side_m),
        amount(map.sampled_pulses as f64),
        of_rank(0.5),
        of_rank(0.05)
    )
}
