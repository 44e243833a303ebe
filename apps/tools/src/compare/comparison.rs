//! Compares two clouds.

use super::chance::{BlockKind, Chance, Halves, MIN_BLOCKS, SPLITS};
use super::change::{Change, change};
use super::cut::{CellGrid, Cut, of_both};
use super::neighbours::{Distances, distances};
use super::options::{CompareError, CompareOptions};
use super::pulses::Pulses;
use super::quantity::Quantity;
use super::setting::{Findings, Setting};
use super::surfaces::{Canopy, Voxels, canopy, correlation, voxels};
use super::terrain::{Planes, Terrain};
use crate::cloud::Points;
use serde::Serialize;
use vlscan_base::Observer;
use vlscan_base::diag::{Diagnostics, Notice, Place};
use vlscan_base::error::{Error, Result};
use vlscan_crs::{differ, short_name};
use vlscan_formats::{Attribute, AttributeSet};
use vlscan_geom::DVec3;

/// Side of the squares whose lowest point counts as ground without a terrain, m.
const GROUND_CELL: f64 = 5.0;
/// Number of cells of the common box that are blocks of neighbouring points where there are no scan lines,
/// about.
const BLOCK_CELLS: f64 = 400.0;

/// One cloud.
#[derive(Clone, Debug, Serialize)]
pub struct Cloud {
    /// Name of its file.
    pub name: String,
    /// Points of the file.
    pub points: usize,
    /// Lower corner of its box, world coordinates, m.
    pub min: [f64; 3],
    /// Upper corner of its box, world coordinates, m.
    pub max: [f64; 3],
    /// Points within the box that both clouds share. If the file has more points than are kept in memory, its
    /// own number is estimated from them.
    pub points_in_box: f64,
    /// Points per m² of the cells that hold points of either cloud.
    pub density_per_m2: f64,
    /// Median intensity of the points in the box, in the unit of the file; `None` without intensities.
    pub intensity_median: Option<f64>,
    /// Pulses and scan lines with points in the box; `None` if they cannot be distinguished.
    pub pulses_and_lines: Option<[usize; 2]>,
}

/// Agreement of voxels, neighbours and cells in a pair of clouds.
#[derive(Clone, Debug, Serialize)]
pub struct Agreement {
    /// Correlation of the numbers of points per cell.
    pub density_correlation: f64,
    /// The highest points of the cells.
    pub canopy: Canopy,
    /// From points of the first cloud to the nearest of the second.
    pub first_to_second: Distances,
    /// From points of the second cloud to the nearest of the first.
    pub second_to_first: Distances,
    /// Occupied voxels.
    pub voxels: Voxels,
}

/// The result.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// The first cloud.
    pub first: Cloud,
    /// The second cloud.
    pub second: Cloud,
    /// Side of the cells, m.
    pub cell_m: f64,
    /// Area of the cells of the common box that hold points of either cloud, m².
    pub area_m2: f64,
    /// Basis of the bounds by chance, if they were computed.
    pub chance: Option<Chance>,
    /// Quantities of points, pulses, scan lines and cells.
    pub quantities: Vec<Quantity>,
    /// Quantities that are missing, with the reason.
    pub missing: Vec<String>,
    /// Agreement of both clouds.
    #[serde(flatten)]
    pub agreement: Agreement,
    /// The same of two halves of the first cloud, if chance is estimated.
    pub agreement_of_halves: Option<Agreement>,
    /// Change from the first to the second cloud.
    pub change: Change,
    /// System of the coordinates as WKT, if the files name one.
    #[serde(skip)]
    pub crs: Option<String>,
}

impl Comparison {
    /// The quantity of a name.
    pub fn quantity(&self, name: &str) -> Option<&Quantity> {
        self.quantities.iter().find(|quantity| quantity.name == name)
    }
}

/// Compares `second` with `first` within the box that both share horizontally. Clouds are named for messages
/// and pages.
///
/// # Errors
/// [`Error::Input`] for clouds that do not overlap, cells that are too small, a terrain that cannot be read;
/// warnings if they are errors.
pub fn compare(
    [first, second]: [(&str, &Points); 2],
    options: &CompareOptions,
    observer: &Observer,
) -> Result<Comparison> {
    options.check()?;
    check_systems(first.1, second.1, observer)?;
    let (low, high) = common_box(first.1, second.1)?;
    let splits = if options.chance { rayon::current_num_threads().min(SPLITS as usize) } else { 0 };
    let grid = CellGrid::new((low, high), options.cell, first, splits)?;
    let wide_grid = CellGrid::new((low, high), GROUND_CELL.max(options.cell), first, splits)?;
    let [a, b] = [first.1, second.1].map(|points| Cut::of(points, low, high));
    let cuts = [&a, &b];
    if let Some((_, (name, _))) = cuts.iter().zip([first, second]).find(|(cut, _)| cut.len() == 0) {
        return Err(Error::input(format!(
            "{name} has no points in the box that both clouds share, x {:.3} to {:.3} m and y {:.3} to \
                 {:.3} m",
            low.x, high.x, low.y, high.y
        )));
    }
    let tell = |what: &str, step: &'static str| {
        // The next step uses other attributes.
        cuts.iter().for_each(|cut| cut.points.release());
        observer.step(step);
        observer.notify(Notice::Detail(format!("compare: {what}")));
    };
    tell("pulses", "grouping points into pulses");
    let (mut setting, kind, count) =
        prepared(cuts, (low, high), [grid, wide_grid], first, options, observer)?;
    let Findings { quantities, mut missing } = findings(&setting, &tell);
    if options.chance && setting.halves.is_none() {
        missing.push(format!("--chance: the first cloud has {count} blocks, expected at least {MIN_BLOCKS}"));
    }
    tell("distances, canopy, voxels", "measuring distances");
    let area = occupied_cells(&setting.grid, cuts) as f64 * options.cell * options.cell;
    cuts.iter().for_each(|cut| cut.points.release());
    let [first_cloud, second_cloud] =
        [(0, first), (1, second)].map(|(index, cloud)| described(&setting, index, cloud, area));
    setting.free();
    let agreement = agreement(&setting, cuts, options);
    let agreement_of_halves = agreement_of_halves(&setting, options);
    tell("change", "measuring change");
    let change = change(&setting.grid, cuts, [low.x, low.y], options.registration);
    missing.extend(change.doubts(options.cell));
    if let Some(note) = change.registration_note().filter(|_| options.registration.is_none()) {
        observer.notify(Notice::Note(note));
    }
    Ok(Comparison {
        first: first_cloud,
        second: second_cloud,
        cell_m: options.cell,
        area_m2: area,
        chance: setting.halves.is_some().then_some(Chance { kind, count, splits: SPLITS }),
        quantities,
        missing,
        agreement,
        agreement_of_halves,
        change,
        crs: first.1.crs().or(second.1.crs()).map(str::to_owned),
    })
}

/// The attributes of points that a comparison uses in addition to their positions.
pub fn compared_attributes() -> AttributeSet {
    AttributeSet::of(|attribute| {
        use Attribute::{Channel, Class, Intensity, Leg, NumberOfReturns, ReturnNumber, ScanAngle, Time};
        let used = [Channel, Class, Intensity, Leg, NumberOfReturns, ReturnNumber, ScanAngle, Time];
        used.contains(&attribute)
    })
}

/// Warns of clouds in different coordinate reference systems.
fn check_systems(first: &Points, second: &Points, observer: &Observer) -> Result<()> {
    if let (Some(a), Some(b)) = (first.crs(), second.crs())
        && differ(a, b)
    {
        let mut found = Diagnostics::default();
        found.warn(
            None,
            format!("the clouds are in different systems: {} and {}", short_name(a), short_name(b)),
        );
        observer.warnings(found)?;
    }
    Ok(())
}

/// Both clouds, ready to be measured, with kind and number of the blocks of the first one.
fn prepared<'a>(
    cuts: [&'a Cut<'a>; 2],
    (low, high): (DVec3, DVec3),
    [grid, wide_grid]: [CellGrid; 2],
    first: (&str, &Points),
    options: &CompareOptions,
    observer: &Observer,
) -> Result<(Setting<'a>, BlockKind, u32)> {
    let (first_pulses, second_pulses) = rayon::join(|| Pulses::of(cuts[0]), || Pulses::of(cuts[1]));
    let mut pulses = [first_pulses, second_pulses];
    let [own_lines, _] = pulses.each_mut().map(|found| match found {
        Ok(found) => Some(found.take_lines_of_points()).filter(|_| found.has_lines),
        Err(_) => None,
    });
    let terrain = match &options.terrain {
        Some(path) => {
            let terrain = Terrain::load(path, low, observer)?;
            if !cuts.iter().any(|cut| terrain.is_below(cut)) {
                let mut found = Diagnostics::default();
                let message = "no point lies above this --terrain";
                found
                    .warn(Some(Place::of_file(path)), message)
                    .help("it must be in the system and the place of the clouds");
                observer.warnings(found)?;
            }
            Some(terrain)
        }
        None => Planes::of(cuts[0], own_lines.as_deref()).map(Terrain::Planes),
    };
    let (kind, count, blocks) = blocks_of(cuts[0], own_lines, (low, high), wide_grid.side, first)?;
    let [lowest, others] = of_both(cuts, |cut| wide_grid.extremes(cut.offsets()));
    let lowest: Vec<f64> = lowest.iter().zip(&others).map(|([a, _], [b, _])| a.min(*b)).collect();
    let halves = (options.chance && count >= MIN_BLOCKS).then(|| Halves::new(count));
    let blocks = if halves.is_some() { blocks } else { Vec::new() };
    let most = options.max_distances;
    let setting = Setting { cuts, pulses, blocks, halves, grid, wide_grid, lowest, terrain, most };
    Ok((setting, kind, count))
}

/// A cloud with its points in the common box; `index` is 0 for the first one.
fn described(setting: &Setting, index: usize, (name, points): (&str, &Points), area: f64) -> Cloud {
    let cut = setting.cuts[index];
    let count = cut.len() as f64 * cut.weight;
    let of_pulses = |found: &Pulses| [found.count(), if found.has_lines { found.lines.len() } else { 0 }];
    let intensity_median = cut.median_intensity();
    cut.points.release();
    Cloud {
        name: name.to_owned(),
        points: points.total(),
        min: points.bounds().min.to_array(),
        max: points.bounds().max.to_array(),
        points_in_box: count,
        density_per_m2: count / area,
        intensity_median,
        pulses_and_lines: setting.pulses[index].as_ref().ok().map(of_pulses),
    }
}

/// Agreement of two halves of the first cloud; `None` without halves.
fn agreement_of_halves(setting: &Setting, options: &CompareOptions) -> Option<Agreement> {
    let (halves, cut) = (setting.halves.as_ref()?, setting.cuts[0]);
    let half = |half: usize| cut.part(|i| halves.half(0, setting.blocks[i]) == half);
    let (first, second) = (half(0), half(1));
    Some(agreement(setting, [&first, &second], options))
}

/// All quantities; `tell` is called with the quantity that is measured next.
fn findings(setting: &Setting, tell: &dyn Fn(&str, &'static str)) -> Findings {
    let mut found = Findings::default();
    type Part = (&'static str, &'static str, fn(&Setting, &mut Findings));
    let parts: [Part; 8] = [
        ("density", "comparing densities", |setting, found| setting.density(found)),
        ("heights", "comparing heights", |setting, found| setting.heights(found)),
        ("returns", "comparing returns", |setting, found| setting.returns(found)),
        ("classes", "comparing classes", |setting, found| setting.classes(found)),
        ("intensities", "comparing intensities", |setting, found| setting.intensity(found)),
        ("pulses", "comparing pulses", |setting, found| setting.pulses(found)),
        ("scan lines", "comparing scan lines", |setting, found| setting.lines(found)),
        ("residuals", "comparing residuals", |setting, found| setting.residuals(found)),
    ];
    for (name, step, measure) in parts {
        tell(name, step);
        measure(setting, &mut found);
    }
    found
}

/// The corners of the box that both clouds share horizontally, and that holds the heights of both.
pub(super) fn common_box(first: &Points, second: &Points) -> Result<(DVec3, DVec3), CompareError> {
    let (a, b) = (first.bounds(), second.bounds());
    let low = DVec3::new(a.min.x.max(b.min.x), a.min.y.max(b.min.y), a.min.z.min(b.min.z));
    let high = DVec3::new(a.max.x.min(b.max.x), a.max.y.min(b.max.y), a.max.z.max(b.max.z));
    if low.x > high.x || low.y > high.y {
        let corners = [[a.min.x, a.min.y], [b.min.x, b.min.y]];
        return Err(CompareError::Apart { gap: (low - high).max_element(), corners });
    }
    Ok((low, high))
}

/// The blocks of neighbouring points: scan lines, or square cells of at most a side.
fn blocks_of(
    cut: &Cut,
    lines: Option<Vec<u32>>,
    (low, high): (DVec3, DVec3),
    max_side: f64,
    cloud: (&str, &Points),
) -> Result<(BlockKind, u32, Vec<u32>)> {
    if let Some(lines) = lines {
        let count = lines.iter().max().map_or(0, |line| line + 1);
        return Ok((BlockKind::ScanLines, count, lines));
    }
    let extent = high - low;
    let side = (extent.x * extent.y / BLOCK_CELLS).sqrt().clamp(1e-3, max_side);
    let grid = CellGrid::new((low, high), side, cloud, 0)?;
    let cells = cut.offsets().map(|offset| grid.cell(&offset) as u32).collect();
    Ok((BlockKind::Cells { side_m: side }, grid.len() as u32, cells))
}

fn occupied_cells(grid: &CellGrid, cuts: [&Cut; 2]) -> usize {
    let counts = of_both(cuts, |cut| grid.counts(cut.offsets()));
    counts[0].iter().zip(&counts[1]).filter(|(a, b)| **a + **b > 0.0).count()
}

fn agreement(setting: &Setting, cuts: [&Cut; 2], options: &CompareOptions) -> Agreement {
    let counts = of_both(cuts, |cut| setting.grid.counts(cut.offsets()));
    let pairs = counts[0].iter().zip(&counts[1]).filter(|(a, b)| **a + **b > 0.0);
    let density_correlation = correlation(pairs.map(|(a, b)| (*a, *b)));
    let canopy = canopy(&setting.grid, &setting.wide_grid, &setting.lowest, cuts);
    let voxels = voxels(cuts, options.voxel);
    // The trees of distances need the memory.
    cuts.iter().for_each(|cut| cut.points.release());
    Agreement {
        density_correlation,
        canopy,
        first_to_second: distances(cuts[0], cuts[1], options.max_distances),
        second_to_first: distances(cuts[1], cuts[0], options.max_distances),
        voxels,
    }
}
