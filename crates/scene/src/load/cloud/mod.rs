//! Point clouds as cubes (spec input-formats §4.4), from text and, beyond the reference, from every format of points. The
//! file is read twice, once for its extent and once into the cells of the grid, so that memory grows with the number of
//! occupied cells instead of the number of points.

mod cells;
#[cfg(test)]
mod tests;
mod text;

use crate::builder::{MAX_COORDINATE, PartSource, SceneBuilder, memory_of};
use crate::grid_voxels::GridSurfaces;
use crate::load::voxel_store::VoxelStore;
use crate::text::{Problems, Source, cut_into_pieces};
use crate::voxel::Voxel;
use cells::{Budget, Cell, Cells, CloudGrid, NormalRule, SHARDS};
use rayon::prelude::*;
use std::ops::{ControlFlow, Range};
use text::RowFormat;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_formats::{AttributeSet, CloudFormat, PointFile, PointRow, PointSink, Selection};
use vlscan_geom::{Aabb, DVec3, direction, rescaled};
use vlscan_survey::XyzLoader;

/// Bytes of text read by one task.
const PIECE_BYTES: usize = 1 << 20;

/// Minimum number of points to which a plane is fitted.
const MIN_PLANE_POINTS: u32 = 3;

/// Appends one voxel per occupied cell of a file's grid, ordered by z, y, x.
pub(crate) fn load(
    scene: &mut SceneBuilder,
    part: &PartSource,
    source: &Source,
    loader: &XyzLoader,
    (materials, keeps_grid): (&[u32], bool),
) -> Result<()> {
    let settings = match Settings::new(loader) {
        Ok(settings) => settings,
        Err(problem) => {
            scene.diagnostics.error(part.place.cloned(), problem);
            return Ok(());
        }
    };
    let Some(file) = PointFile::new(source.path(), source.bytes(), &mut scene.diagnostics) else {
        return Ok(());
    };
    let is_text = file.format() == CloudFormat::Text;
    let fed = if is_text { source.with_line_feeds() } else { None };
    let source = fed.as_ref().unwrap_or(source);
    let cloud = match is_text {
        true => Cloud::of_text(source, loader, &settings, &mut scene.diagnostics),
        false => Some(Cloud::File(file)),
    };
    let Some(cloud) = cloud else { return Ok(()) };
    let Some(extent) = cloud.extent(source, &settings, &mut scene.diagnostics)? else { return Ok(()) };
    if extent.is_empty() {
        report_empty(source, is_text, &mut scene.diagnostics);
        return Ok(());
    }
    let Some(grid) = CloudGrid::around(extent, settings.voxel_size) else {
        let message = format!(
            "voxels of {} m are too small for the {:.3} m of {}",
            settings.voxel_size,
            extent.size().max_element(),
            source.path().display()
        );
        scene.diagnostics.error(part.place.cloned(), message);
        return Ok(());
    };
    let budget = Budget::new(scene.free_memory().try_into().unwrap_or(usize::MAX));
    let mut sorter = Sorter { grid: &grid, settings: &settings, shards: Default::default(), budget };
    let mut failure = Ok(());
    // What there is to say was said when the extent was looked for.
    cloud.each_batch(source, &mut Diagnostics::default(), |batches| {
        failure = sorter.sort(scene, source, batches);
        failure.is_ok()
    })?;
    failure?;
    let shards = sorter.shards;
    let cells: usize = shards.iter().map(Cells::len).sum();
    scene.check_memory(memory_of(0, 0, cells).max((cells * size_of::<Filled>()) as u64), source.path())?;
    append_voxels(scene, part, &settings, (&grid, keeps_grid), shards, materials)
}

/// A point file in one of the formats, recognised by its first bytes instead of its name.
enum Cloud<'s> {
    /// Lines of text; the pieces are read in parallel.
    Text {
        pieces: Vec<Range<usize>>,
        format: Box<RowFormat>,
    },
    File(PointFile<'s>),
}

impl<'s> Cloud<'s> {
    /// Finds the columns of a text file; `None` after an error.
    fn of_text(
        source: &Source,
        loader: &XyzLoader,
        settings: &Settings,
        diagnostics: &mut Diagnostics,
    ) -> Option<Cloud<'s>> {
        if !source.is_text("a point cloud", diagnostics) {
            return None;
        }
        let mut found = Diagnostics::default();
        let format = RowFormat::new(loader, settings.rule != NormalRule::Plane, source, &mut found);
        let is_wrong = found.is_fatal(false);
        diagnostics.extend(found);
        if format.is_none() {
            report_empty(source, true, diagnostics);
        }
        let pieces = cut_into_pieces(source.bytes(), PIECE_BYTES);
        format.filter(|_| !is_wrong).map(|format| Cloud::Text { pieces, format: Box::new(format) })
    }

    /// The box around all points; `None` after an error. Says what there is to say of the points.
    fn extent(
        &self,
        source: &Source,
        settings: &Settings,
        diagnostics: &mut Diagnostics,
    ) -> Result<Option<Aabb>> {
        let (mut extent, mut passed, mut wrong) = (Aabb::EMPTY, 0, None);
        let mut without_normal = 0;
        let mut found = Diagnostics::default();
        self.each_batch(source, &mut found, |batches| {
            let seen: Vec<_> = batches.par_iter().map(|batch| settings.look_at(batch)).collect();
            for ((own, lacking, first_wrong), batch) in seen.into_iter().zip(batches) {
                extent = extent.union(own);
                without_normal += lacking;
                wrong = wrong.or(first_wrong.map(|number| (passed + number, batch[number].position)));
                passed += batch.len();
            }
            wrong.is_none()
        })?;
        settings.warn_of_normals(without_normal, source, &mut found);
        if let Some((number, p)) = wrong {
            found.error(
                None,
                format!(
                    "{}: expected points within ±{MAX_COORDINATE:e} m, point {number} (from 0) is at {p}",
                    source.path().display()
                ),
            );
        }
        let is_wrong = found.is_fatal(false);
        diagnostics.extend(found);
        Ok((!is_wrong).then_some(extent))
    }

    /// Passes batches of points to `take`, in the order of the file, as long as it returns true. What is wrong with them goes to
    /// `found`.
    fn each_batch(
        &self,
        source: &Source,
        found: &mut Diagnostics,
        mut take: impl FnMut(&[Vec<PointRow>]) -> bool,
    ) -> Result<()> {
        let (pieces, format) = match self {
            Cloud::Text { pieces, format } => (pieces, format),
            Cloud::File(file) => {
                let mut batches = Batches { take, batches: vec![Vec::new()], is_ended: false };
                file.read(Selection::PositionAndClass, &mut batches, found)?;
                if !batches.is_ended {
                    batches.flush();
                }
                return Ok(());
            }
        };
        let (mut problems, mut passed) = (Problems::default(), 0);
        for wave in pieces.chunks(4 * rayon::current_num_threads()) {
            let read = wave.par_iter().map(|piece| {
                let (mut points, mut problems) = (Vec::new(), Problems::default());
                let bytes = &source.bytes()[piece.clone()];
                let lines = format.read(bytes, piece.start == 0, &mut problems, |p| points.push(p));
                (points, problems, lines)
            });
            let read: Vec<_> = read.collect();
            let mut batches = Vec::with_capacity(read.len());
            for ((points, found, lines), piece) in read.into_iter().zip(wave) {
                problems.append(found, passed, piece.start);
                passed += lines;
                batches.push(points);
            }
            if !take(&batches) {
                return Ok(());
            }
        }
        if let Some((number, at, last)) = source.unended_line()
            && let Some((columns, found)) = format.find_truncation(source.bytes(), last)
        {
            problems.error(number, at..at + last.len(), || {
                format!(
                    "expected {columns} columns as in the first line, found {found}; is the file truncated?"
                )
            });
        }
        problems.report(source, found);
        Ok(())
    }
}

fn report_empty(source: &Source, is_text: bool, diagnostics: &mut Diagnostics) {
    let place = is_text.then(|| source.place(1, 0..0));
    let message = format!("expected points in {}, found none", source.path().display());
    diagnostics.error(place, message);
}

/// Number of points of a batch, which one task sorts.
const BATCH_POINTS: usize = 1 << 16;

/// Collects points to as many batches as there are threads.
struct Batches<F> {
    take: F,
    batches: Vec<Vec<PointRow>>,
    is_ended: bool,
}

impl<F: FnMut(&[Vec<PointRow>]) -> bool> Batches<F> {
    fn flush(&mut self) {
        self.is_ended = !(self.take)(&self.batches);
        self.batches.clear();
        self.batches.push(Vec::new());
    }
}

impl<F: FnMut(&[Vec<PointRow>]) -> bool> PointSink for Batches<F> {
    fn start(&mut self, _: AttributeSet) {}

    fn point(&mut self, row: &PointRow, _: Option<&str>) -> ControlFlow<()> {
        let is_full = self.batches.last().is_none_or(|batch| batch.len() >= BATCH_POINTS);
        if is_full && self.batches.len() >= rayon::current_num_threads() {
            self.flush();
        } else if is_full {
            self.batches.push(Vec::new());
        }
        if let Some(batch) = self.batches.last_mut() {
            batch.push(*row);
        }
        if self.is_ended { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

/// The validated settings of a loader.
struct Settings {
    voxel_size: f64,
    default_normal: Option<DVec3>,
    rule: NormalRule,
    /// Whether the scene names a material; if so, its class overrides that of the points.
    has_material: bool,
}

impl Settings {
    fn new(loader: &XyzLoader) -> std::result::Result<Settings, String> {
        let size = if loader.voxel_size == 0.0 { 1.0 } else { loader.voxel_size };
        if !(size > 0.0 && size.is_finite()) {
            return Err(format!("expected a voxelSize above 0, found {}", loader.voxel_size));
        }
        let default_normal = loader.default_normal.and_then(direction);
        if loader.default_normal.is_some() && default_normal.is_none() {
            return Err("expected a defaultNormal other than 0;0;0".to_owned());
        }
        let rule = match (loader.estimate_normals, loader.snap_neighbor_normal) {
            (1.., _) => NormalRule::Plane,
            (0, true) => NormalRule::Nearest,
            (0, false) => NormalRule::Mean,
        };
        let has_material = loader.material.file.is_some();
        Ok(Settings { voxel_size: size, default_normal, rule, has_material })
    }
}

/// Sorts points into cells. Each cell receives its points in the order of the file for any number of threads.
struct Sorter<'a> {
    grid: &'a CloudGrid,
    settings: &'a Settings,
    shards: [Cells; SHARDS],
    budget: Budget,
}

impl Sorter<'_> {
    fn sort(&mut self, scene: &SceneBuilder, source: &Source, batches: &[Vec<PointRow>]) -> Result<()> {
        let sorted: Vec<_> = batches
            .par_iter()
            .map(|batch| {
                let mut sorted: [Vec<PointRow>; SHARDS] = Default::default();
                batch.iter().for_each(|p| self.put(*p, &mut sorted));
                sorted
            })
            .collect();
        self.add(scene, source, &sorted)
    }

    fn put(&self, point: PointRow, sorted: &mut [Vec<PointRow>; SHARDS]) {
        if let Some(point) = self.settings.usable(point) {
            sorted[self.grid.shard_of(point.position)].push(point);
        }
    }

    fn add(
        &mut self,
        scene: &SceneBuilder,
        source: &Source,
        sorted: &[[Vec<PointRow>; SHARDS]],
    ) -> Result<()> {
        let (grid, rule) = (self.grid, self.settings.rule);
        let budget = &self.budget;
        let has_room = self.shards.par_iter_mut().enumerate().all(|(shard, cells)| {
            sorted.iter().flat_map(|batch| &batch[shard]).all(|p| cells.add(grid, p, rule, budget))
        });
        if has_room {
            return Ok(());
        }
        scene.check_memory(budget.taken() as u64, source.path())?;
        Err(Error::io("load", source.path(), std::io::ErrorKind::OutOfMemory.into()))
    }
}

impl Settings {
    /// The box around points, the number of those without a usable normal, and the first one that is too far away.
    fn look_at(&self, points: &[PointRow]) -> (Aabb, u64, Option<usize>) {
        let (mut extent, mut without_normal) = (Aabb::EMPTY, 0);
        for point in points {
            extent = extent.with(point.position);
            without_normal += u64::from(!self.has_usable_normal(point));
        }
        // Also false for NaN.
        let is_near = |p: DVec3| p.is_finite() && p.abs().max_element() <= MAX_COORDINATE;
        (extent, without_normal, points.iter().position(|point| !is_near(point.position)))
    }

    /// Whether a point has no normal, or one of a direction; normals that are not looked at are usable.
    fn has_usable_normal(&self, point: &PointRow) -> bool {
        self.rule == NormalRule::Plane || point.normal.is_none_or(|n| n.is_finite() && n != DVec3::ZERO)
    }

    /// The point with a usable normal: an invalid normal is replaced by the default, or the point is dropped.
    fn usable(&self, point: PointRow) -> Option<PointRow> {
        match self.has_usable_normal(&point) {
            false => self.default_normal.map(|n| PointRow { normal: Some(n), ..point }),
            true => Some(PointRow { normal: point.normal.map(rescaled), ..point }),
        }
    }

    /// Warns of points that are dropped for their normal.
    fn warn_of_normals(&self, count: u64, source: &Source, diagnostics: &mut Diagnostics) {
        if count > 0 && self.default_normal.is_none() {
            let message = format!("points whose normal is zero or no number are left out: {count} of them");
            diagnostics
                .warn(Some(Place::of_file(source.path())), message)
                .help("`defaultNormal` of its loader gives such points a normal");
        }
    }
}

/// Sort key of a cell, the cell, its attributes, and the class of its points.
type Filled = (u128, Cell, Voxel, u8);

fn append_voxels(
    scene: &mut SceneBuilder,
    part: &PartSource,
    settings: &Settings,
    (grid, keeps_grid): (&CloudGrid, bool),
    shards: [Cells; SHARDS],
    materials: &[u32],
) -> Result<()> {
    let mut cells: Vec<Filled> = shards
        .into_par_iter()
        .flat_map_iter(|shard| shard.into_iter())
        .filter_map(|(cell, sums)| {
            let normal = match settings.rule {
                NormalRule::Plane if sums.count < MIN_PLANE_POINTS => Some(settings.default_normal?),
                _ => sums.normal(settings.rule).or(settings.default_normal),
            };
            Some((grid.order(cell), cell, Voxel::of_points(normal), sums.class))
        })
        .collect();
    cells.par_sort_unstable_by_key(|c| c.0);
    let mut store = VoxelStore::new(grid.place(), grid.counts(), keeps_grid);
    cells.iter().for_each(|(_, cell, voxel, _)| store.push(scene, *cell, voxel));
    let surfaces = if settings.has_material || cells.iter().all(|c| c.3 == 0) {
        scene.surfaces_in_turn(part.index, materials)
    } else {
        let surfaces = cells.iter().zip(materials.iter().cycle()).map(|((.., class), material)| {
            let material = scene.library.of_class(*material, *class);
            scene.surface(part.index, material)
        });
        GridSurfaces::Each(surfaces.collect())
    };
    store.finish(scene, surfaces)
}
