//! Point clouds as cubes (spec input-formats §4.4), from text and, beyond the reference, from every format of
//! points. The file is read twice, once for its extent and once into the cells of the grid, so that memory
//! grows with the number of occupied cells instead of the number of points. Very many cells are found in
//! several readings, some at a time.
//!
//! | files | contents |
//! |---|---|
//! | `text` | points of lines of text |
//! | `cells`, `occupancy` | the cells of the grid and sums over their points; the occupied cells |
//! | `sorter` | points in the order of their cells |
//! | `colours` | mean colours of the points in each cell |

mod cells;
mod colours;
mod occupancy;
mod sorter;
#[cfg(test)]
mod tests;
mod text;

use crate::builder::{MAX_COORDINATE, PartSource, SceneBuilder, memory_of};
use crate::grid_voxels::GridSurfaces;
use crate::load::voxel_store::VoxelStore;
use crate::text::{Problems, Source, cut_into_pieces};
use crate::voxel::Voxel;
use cells::{CellSums, CloudGrid, NormalRule, Sums, Votes};
use rayon::prelude::*;
use sorter::Sorter;
use std::ops::{ControlFlow, Range};
use text::{LinePlace, RowFormat};
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::Result;
use vlscan_base::recognise::Expected;
use vlscan_formats::text::Widths;
use vlscan_formats::{AttributeSet, CloudFormat, PointFile, PointRow, PointSink, Selection, StrayFinder};
use vlscan_geom::{Aabb, DVec3, direction, rescaled};
use vlscan_survey::XyzLoader;

/// Bytes of text read by one task.
const PIECE_BYTES: usize = if cfg!(test) { 1 << 10 } else { 1 << 20 };

/// Attributes of points that cells need.
const CELLS: Selection = Selection::PositionAndClass;

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
            scene.diagnostics.error(part.place.cloned(), problem.to_string());
            return Ok(());
        }
    };
    let Some(file) = PointFile::new(source.path(), source.bytes(), &mut scene.diagnostics) else {
        return Ok(());
    };
    let file = file.on_threads(rayon::current_num_threads());
    let is_text = file.format() == CloudFormat::Text;
    let fed = if is_text { source.with_line_feeds() } else { None };
    let source = fed.as_ref().unwrap_or(source);
    let cloud = match is_text {
        true => {
            let selected = (&settings, scene.options.colours);
            Cloud::of_text(source, loader, selected, &mut scene.diagnostics)
        }
        false => Some(Cloud::File(file)),
    };
    let Some(cloud) = cloud else { return Ok(()) };
    let seen = cloud.look_at(source, &settings, &mut scene.diagnostics)?;
    let Some((extent, has_normals)) = seen else { return Ok(()) };
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
    let voxels = Voxels { cloud: &cloud, source, settings: &settings, grid: &grid, keeps_grid, materials };
    match settings.rule == NormalRule::Plane || has_normals {
        true => voxels.load::<Sums>(scene, part),
        false => voxels.load::<Votes>(scene, part),
    }
}

/// The voxels of a point file.
struct Voxels<'a> {
    cloud: &'a Cloud<'a>,
    source: &'a Source,
    settings: &'a Settings,
    grid: &'a CloudGrid,
    keeps_grid: bool,
    materials: &'a [u32],
}

impl Voxels<'_> {
    /// Appends them to the scene.
    fn load<S: CellSums>(&self, scene: &mut SceneBuilder, part: &PartSource) -> Result<()> {
        let (before, mut coloured) = (scene.end(), Vec::new());
        let mut store = VoxelStore::new(self.grid.place(), self.grid.counts(), self.keeps_grid);
        let mut classes = Vec::new();
        let mut sorter = Sorter::<S>::new(self.grid, self.settings, scene.free_memory());
        loop {
            let mut failure = Ok(());
            // Warnings were reported when the extent was determined.
            self.cloud.each_batch(self.source, CELLS, &mut Diagnostics::default(), |batches| {
                failure = scene.options.check_stop().and_then(|()| sorter.sort(scene, self.source, batches));
                failure.is_ok()
            })?;
            failure?;
            let (count, found) = sorter.found();
            store.reserve(scene, count, self.source.path())?;
            for (cell, sums) in found {
                let normal = match self.settings.rule {
                    NormalRule::Plane if sums.count() < MIN_PLANE_POINTS => {
                        match self.settings.default_normal {
                            Some(normal) => Some(normal),
                            None => continue,
                        }
                    }
                    rule => sums.normal(rule).or(self.settings.default_normal),
                };
                store.push(scene, cell, &Voxel::of_points(normal));
                if scene.options.colours {
                    coloured.push(cell);
                }
                classes.push(sums.class());
            }
            if !sorter.go_on() {
                break;
            }
        }
        // Its tables are not needed any more.
        drop(sorter);
        if !self.keeps_grid || classes.len() < scene.options.min_grid_voxels {
            scene.check_memory(memory_of(0, 0, classes.len()), self.source.path())?;
        }
        let surfaces = if self.settings.has_material || classes.iter().all(|class| *class == 0) {
            scene.surfaces_in_turn(part.index, self.materials)
        } else {
            let surfaces = classes.iter().zip(self.materials.iter().cycle()).map(|(class, material)| {
                let material = scene.library.of_class(*material, *class);
                scene.surface(part.index, material)
            });
            GridSurfaces::Each(surfaces.collect())
        };
        store.finish(scene, surfaces)?;
        if scene.options.colours {
            let colours = self.mean_colours(scene, &coloured)?;
            scene.add_voxel_colours(&scene.since(&before), colours);
        }
        Ok(())
    }
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
        (settings, has_colours): (&Settings, bool),
        diagnostics: &mut Diagnostics,
    ) -> Option<Cloud<'s>> {
        if !source.is_text(&Expected::POINTS, diagnostics) {
            return None;
        }
        let mut found = Diagnostics::default();
        let selected = (settings.rule != NormalRule::Plane, has_colours);
        let format = RowFormat::new(loader, selected, source, &mut found);
        let is_wrong = found.is_fatal(false);
        diagnostics.extend(found);
        if format.is_none() {
            report_empty(source, true, diagnostics);
        }
        let pieces = cut_into_pieces(source.bytes(), PIECE_BYTES);
        format.filter(|_| !is_wrong).map(|format| Cloud::Text { pieces, format: Box::new(format) })
    }

    /// Returns the box around all points, and true if any point has a normal; `None` after an error. Reports
    /// warnings about the points.
    fn look_at(
        &self,
        source: &Source,
        settings: &Settings,
        diagnostics: &mut Diagnostics,
    ) -> Result<Option<(Aabb, bool)>> {
        let (mut extent, mut passed, mut wrong) = (Aabb::EMPTY, 0, None);
        let (mut without_normal, mut has_normals) = (0, false);
        let mut found = Diagnostics::default();
        let mut strays = StrayFinder::default();
        self.each_batch(source, CELLS, &mut found, |batches| {
            let places = batches.iter().flatten().map(|point| point.position);
            places.filter(|p| p.is_finite()).for_each(|p| strays.add(p));
            let seen: Vec<_> = batches.par_iter().map(|batch| settings.look_at(batch)).collect();
            for (own, batch) in seen.into_iter().zip(batches) {
                let Seen { extent: own, without_normal: lacking, has_normals: has, first_wrong } = own;
                has_normals |= has;
                extent = extent.union(own);
                without_normal += lacking;
                wrong = wrong.or(first_wrong.map(|number| (passed + number, batch[number].position)));
                passed += batch.len();
            }
            wrong.is_none()
        })?;
        settings.warn_of_normals(without_normal, source, &mut found);
        strays.strays().warn(source.path(), "loaded like the rest", &mut found);
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
        Ok((!is_wrong).then_some((extent, has_normals)))
    }

    /// Passes batches of points to `take`, in the order of the file, as long as it returns true. What is
    /// wrong with them goes to `found`.
    fn each_batch(
        &self,
        source: &Source,
        selection: Selection,
        found: &mut Diagnostics,
        mut take: impl FnMut(&[Vec<PointRow>]) -> bool,
    ) -> Result<()> {
        let (pieces, format) = match self {
            Cloud::Text { pieces, format } => (pieces, format),
            Cloud::File(file) => {
                let (all, mut points) = (0..source.bytes().len(), 0);
                let take = |batches: &[Vec<PointRow>]| {
                    points += batches.iter().map(Vec::len).sum::<usize>();
                    if points >= RELEASED_POINTS {
                        // Where in the file they are is not known.
                        source.release(all.clone());
                        points = 0;
                    }
                    take(batches)
                };
                let mut batches = Batches { take, batches: vec![Vec::new()], misses: 0, is_ended: false };
                file.read(selection, &mut batches, found)?;
                if batches.misses > 0 {
                    let message = format!("{} pulses without a return are left out", batches.misses);
                    found.note(Some(Place::of_file(source.path())), message);
                }
                if !batches.is_ended {
                    batches.flush();
                }
                return Ok(());
            }
        };
        let (mut problems, mut passed, mut widths) = (Problems::default(), 0, Widths::default());
        for wave in pieces.chunks(4 * rayon::current_num_threads()) {
            let read = wave.par_iter().map(|piece| {
                let (mut points, mut problems) = (Vec::new(), Problems::default());
                let bytes = &source.bytes()[piece.clone()];
                let lines = format.read(bytes, piece.start == 0, &mut problems, |p| points.push(p));
                (points, problems, lines)
            });
            let read: Vec<_> = read.collect();
            let mut batches = Vec::with_capacity(read.len());
            for ((points, found, (lines, of_piece)), piece) in read.into_iter().zip(wave) {
                problems.append(found, passed, piece.start);
                let in_file =
                    |(line, at): LinePlace| (passed + line, piece.start + at.start..piece.start + at.end);
                widths.append(of_piece, in_file);
                passed += lines;
                batches.push(points);
            }
            if let (Some(first), Some(last)) = (wave.first(), wave.last()) {
                source.release(first.start..last.end);
            }
            if !take(&batches) {
                return Ok(());
            }
        }
        if let Some((number, at, last)) = source.unended_line()
            && let Some((columns, found)) = format.find_truncation(last)
        {
            problems.error(number, at..at + last.len(), || {
                format!(
                    "expected {columns} columns as in the first line, found {found}; is the file truncated?"
                )
            });
        }
        for ((line, at), message) in format.warnings(widths) {
            problems.warn(line, at, || message);
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
const BATCH_POINTS: usize = if cfg!(test) { 1 << 8 } else { 1 << 16 };

/// Points after which the memory of a mapped file is released.
const RELEASED_POINTS: usize = 1 << 21;

/// Collects points to as many batches as there are threads.
struct Batches<F> {
    take: F,
    batches: Vec<Vec<PointRow>>,
    /// Pulses without a return, which are not points.
    misses: u64,
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

    fn point(&mut self, row: &PointRow, _: Option<&str>) -> Result<ControlFlow<()>> {
        if row.is_miss {
            self.misses += 1;
            return Ok(ControlFlow::Continue(()));
        }
        let is_full = self.batches.last().is_none_or(|batch| batch.len() >= BATCH_POINTS);
        if is_full && self.batches.len() >= rayon::current_num_threads() {
            self.flush();
        } else if is_full {
            self.batches.push(Vec::new());
        }
        if let Some(batch) = self.batches.last_mut() {
            batch.push(*row);
        }
        Ok(if self.is_ended { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
    }
}

/// The validated settings of a loader.
struct Settings {
    voxel_size: f64,
    default_normal: Option<DVec3>,
    rule: NormalRule,
    /// Greatest number of a component of colours.
    max_colour: f64,
    /// True if the scene names a material; if so, its class overrides that of the points.
    has_material: bool,
}

/// Settings of a loader that cannot be used.
#[derive(Debug, thiserror::Error)]
enum SettingsError {
    #[error("expected a voxelSize above 0, found {0}")]
    VoxelSize(f64),
    #[error("expected a defaultNormal other than 0;0;0")]
    DefaultNormal,
}

impl Settings {
    fn new(loader: &XyzLoader) -> std::result::Result<Settings, SettingsError> {
        let size = if loader.voxel_size == 0.0 { 1.0 } else { loader.voxel_size };
        if !(size > 0.0 && size.is_finite()) {
            return Err(SettingsError::VoxelSize(loader.voxel_size));
        }
        let default_normal = loader.default_normal.and_then(direction);
        if loader.default_normal.is_some() && default_normal.is_none() {
            return Err(SettingsError::DefaultNormal);
        }
        let rule = match (loader.estimate_normals, loader.snap_neighbor_normal) {
            (1.., _) => NormalRule::Plane,
            (0, true) => NormalRule::Nearest,
            (0, false) => NormalRule::Mean,
        };
        let has_material = loader.material.file.is_some();
        let max_colour = Some(loader.max_color_value).filter(|max| *max > 0.0).unwrap_or(255.0);
        Ok(Settings { voxel_size: size, default_normal, rule, max_colour, has_material })
    }
}

/// Facts about some points.
struct Seen {
    /// The box around them.
    extent: Aabb,
    /// Number of those without a usable normal.
    without_normal: u64,
    has_normals: bool,
    /// Number of the first one that is too far away.
    first_wrong: Option<usize>,
}

impl Settings {
    /// Collects facts about points before they are sorted.
    fn look_at(&self, points: &[PointRow]) -> Seen {
        let mut seen = Seen { extent: Aabb::EMPTY, without_normal: 0, has_normals: false, first_wrong: None };
        for point in points {
            seen.extent = seen.extent.with(point.position);
            seen.without_normal += u64::from(!self.has_usable_normal(point));
            seen.has_normals |= point.normal.is_some();
        }
        // Also false for NaN.
        let is_near = |p: DVec3| p.is_finite() && p.abs().max_element() <= MAX_COORDINATE;
        seen.first_wrong = points.iter().position(|point| !is_near(point.position));
        seen
    }

    /// True if a point has no normal, or one of a direction; normals that are not used are valid.
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
