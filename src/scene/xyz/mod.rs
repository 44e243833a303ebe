//! Point clouds as cubes (spec input-formats §4.4), from text and, beyond the reference, from LAS, LAZ and PLY. The
//! file is read twice, once for its extent and once into the cells of the grid, so that memory grows with the number of
//! occupied cells instead of the number of points.

mod cells;
#[cfg(test)]
mod tests;
mod text;

use super::builder::{MAX_COORDINATE, PartSource, SceneBuilder, memory_of};
use super::text::{Problems, Source, cut_into_pieces, shown};
use super::voxel::Voxel;
use crate::diag::Diagnostics;
use crate::error::{Error, Result};
use crate::geom::{Aabb, DVec3, unit};
use crate::points::{self, LasReader, PlyReader, PointReader, PointRow, Selection};
use crate::survey::XyzLoader;
use crate::tree::Cube;
use cells::{Budget, Cells, Grid, NormalRule, SHARDS};
use rayon::prelude::*;
use std::ops::Range;
use text::RowFormat;

/// Bytes of text read by one task.
const PIECE_BYTES: usize = 1 << 20;

/// Minimum number of points to which a plane is fitted.
const MIN_PLANE_POINTS: u32 = 3;

/// Appends one cube per occupied cell of a file's grid, ordered by z, y, x.
pub(super) fn load(
    scene: &mut SceneBuilder,
    part: &PartSource,
    source: &Source,
    loader: &XyzLoader,
    materials: &[u32],
) -> Result<()> {
    let settings = match Settings::new(loader) {
        Ok(settings) => settings,
        Err(problem) => {
            scene.diagnostics.error(part.place.cloned(), problem);
            return Ok(());
        }
    };
    let Some(cloud) = Cloud::of(source, &mut scene.diagnostics) else { return Ok(()) };
    let Some(extent) = cloud.extent(source, &settings, &mut scene.diagnostics) else { return Ok(()) };
    if extent.is_empty() {
        let place = matches!(cloud, Cloud::Text { .. }).then(|| source.place(1, 0..0));
        let message = format!("expected points in {}, found none", source.path().display());
        scene.diagnostics.error(place, message);
        return Ok(());
    }
    let Some(grid) = Grid::around(extent, settings.voxel_size) else {
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
    match &cloud {
        Cloud::Text { pieces } => sorter.sort_text(scene, source, pieces)?,
        binary => {
            let mut failure = Ok(());
            let read = binary.each_batch(source, |batches| {
                failure = sorter.sort(scene, source, batches);
                failure.is_ok()
            });
            failure?;
            if let Err(problem) = read {
                scene.diagnostics.error(None, format!("{}: {problem}", source.path().display()));
                return Ok(());
            }
        }
    }
    let shards = sorter.shards;
    let cells: usize = shards.iter().map(Cells::len).sum();
    scene.check_memory(memory_of(0, 0, cells).max((cells * size_of::<Filled>()) as u64), source.path())?;
    append_cubes(scene, part, &settings, &grid, shards, materials)
}

/// A point file in one of the formats, recognised by its first bytes instead of its name.
enum Cloud {
    /// Lines of text; the pieces are read in parallel.
    Text {
        pieces: Vec<Range<usize>>,
    },
    Las,
    Ply,
}

impl Cloud {
    /// Recognises the format of a file; `None` after an error.
    fn of(source: &Source, diagnostics: &mut Diagnostics) -> Option<Cloud> {
        let bytes = source.bytes();
        let extension = source.path().extension().map(|e| e.to_ascii_lowercase());
        let named = ["las", "laz", "ply"].into_iter().find(|n| extension.as_ref().is_some_and(|e| e == n));
        match named {
            _ if points::is_las(bytes) => Some(Cloud::Las),
            _ if points::is_ply(bytes) => Some(Cloud::Ply),
            Some(name) => {
                let (path, found) = (source.path().display(), shown(&bytes[..bytes.len().min(4)]));
                let message = format!(
                    "expected {path} to be a {} file, found one that begins with \"{found}\"",
                    name.to_uppercase()
                );
                diagnostics.error(None, message);
                None
            }
            None => source
                .is_text("a point cloud", diagnostics)
                .then(|| Cloud::Text { pieces: cut_into_pieces(bytes, PIECE_BYTES) }),
        }
    }

    /// The box around all points; `None` after an error.
    fn extent(&self, source: &Source, settings: &Settings, diagnostics: &mut Diagnostics) -> Option<Aabb> {
        if let Cloud::Text { pieces } = self {
            return extent_of_text(source, pieces, &settings.format, diagnostics);
        }
        let (mut extent, mut passed, mut wrong) = (Aabb::EMPTY, 0, None);
        let read = self.each_batch(source, |batches| {
            for point in batches.iter().flatten() {
                // Also false for NaN.
                let is_near = point.position.abs().max_element() <= MAX_COORDINATE;
                wrong =
                    wrong.or((!(point.position.is_finite() && is_near)).then_some((passed, point.position)));
                extent = extent.with(point.position);
                passed += 1;
            }
            wrong.is_none()
        });
        let read = match wrong {
            Some((number, p)) => Err(format!(
                "expected points within ±{MAX_COORDINATE:e} m, point {number} (from 0) is at {p}"
            )),
            None => read,
        };
        match read {
            Ok(()) => Some(extent),
            Err(problem) => {
                diagnostics.error(None, format!("{}: {problem}", source.path().display()));
                None
            }
        }
    }

    /// Passes batches of points of a binary file to `take`, in the order of the file, as long as it returns true.
    fn each_batch(
        &self,
        source: &Source,
        mut take: impl FnMut(&[Vec<PointRow>]) -> bool,
    ) -> std::result::Result<(), String> {
        let mut points: Box<dyn PointReader + '_> = match self {
            Cloud::Ply => Box::new(PlyReader::open(source.bytes())?),
            _ => Box::new(LasReader::open(source.bytes(), Selection::PositionAndClass)?),
        };
        let mut batches = vec![Vec::new(); rayon::current_num_threads()];
        let mut more = true;
        while more {
            for batch in &mut batches {
                batch.clear();
                more = more && points.read_batch(batch)?;
            }
            if !take(&batches) {
                break;
            }
            source.release(0..source.bytes().len());
        }
        Ok(())
    }
}

/// The validated settings of a loader.
struct Settings {
    format: RowFormat,
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
        let default_normal = loader.default_normal.map(unit).filter(|n| n.is_finite());
        if loader.default_normal.is_some() && default_normal.is_none() {
            return Err("expected a defaultNormal other than 0;0;0".to_owned());
        }
        let rule = match (loader.estimate_normals, loader.snap_neighbor_normal) {
            (1.., _) => NormalRule::Plane,
            (0, true) => NormalRule::Nearest,
            (0, false) => NormalRule::Mean,
        };
        let format = RowFormat::new(loader, rule != NormalRule::Plane);
        let has_material = loader.material.file.is_some();
        Ok(Settings { format, voxel_size: size, default_normal, rule, has_material })
    }
}

/// The box around all points of a text file; `None` after errors in its lines.
fn extent_of_text(
    source: &Source,
    pieces: &[Range<usize>],
    format: &RowFormat,
    diagnostics: &mut Diagnostics,
) -> Option<Aabb> {
    let read: Vec<(Aabb, Problems, usize)> = pieces
        .par_iter()
        .map(|piece| {
            let (mut extent, mut problems) = (Aabb::EMPTY, Problems::default());
            let bytes = &source.bytes()[piece.clone()];
            let lines =
                format.read(bytes, piece.start == 0, &mut problems, |p| extent = extent.with(p.position));
            source.release(piece.clone());
            (extent, problems, lines)
        })
        .collect();
    let (mut all, mut problems, mut passed) = (Aabb::EMPTY, Problems::default(), 0);
    for ((extent, found, lines), piece) in read.into_iter().zip(pieces) {
        all = all.union(extent);
        problems.append(found, passed, piece.start);
        passed += lines;
    }
    if let Some((number, at, last)) = source.unended_line()
        && let Some((columns, found)) = format.find_truncation(source.bytes(), last)
    {
        problems.error(number, at..at + last.len(), || {
            format!("expected {columns} columns as in the first line, found {found}; is the file whole?")
        });
    }
    problems.report(source, diagnostics).then_some(all)
}

/// Sorts points into cells. Each cell receives its points in the order of the file for any number of threads.
struct Sorter<'a> {
    grid: &'a Grid,
    settings: &'a Settings,
    shards: [Cells; SHARDS],
    budget: Budget,
}

impl Sorter<'_> {
    fn sort_text(&mut self, scene: &SceneBuilder, source: &Source, pieces: &[Range<usize>]) -> Result<()> {
        for wave in pieces.chunks(4 * rayon::current_num_threads()) {
            let read: Vec<_> = wave
                .par_iter()
                .map(|piece| {
                    let mut sorted: [Vec<PointRow>; SHARDS] = Default::default();
                    let mut reported = Problems::default();
                    let (bytes, is_first) = (&source.bytes()[piece.clone()], piece.start == 0);
                    let format = &self.settings.format;
                    format.read(bytes, is_first, &mut reported, |p| self.put(p, &mut sorted));
                    sorted
                })
                .collect();
            self.add(scene, source, &read)?;
            source.release(wave[0].start..wave[wave.len() - 1].end);
        }
        Ok(())
    }

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
    /// The point with a usable normal: an invalid normal is replaced by the default, or the point is dropped.
    fn usable(&self, point: PointRow) -> Option<PointRow> {
        let is_good = |n: &DVec3| n.is_finite() && *n != DVec3::ZERO;
        match point.normal {
            Some(n) if self.rule != NormalRule::Plane && !is_good(&n) => {
                self.default_normal.map(|n| PointRow { normal: Some(n), ..point })
            }
            _ => Some(point),
        }
    }
}

/// Sort key of a cell, its cube, and the class of its points.
type Filled = (u128, Cube, Voxel, u8);

fn append_cubes(
    scene: &mut SceneBuilder,
    part: &PartSource,
    settings: &Settings,
    grid: &Grid,
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
            let cube = Cube { centre: grid.centre(cell), half: 0.5 * settings.voxel_size };
            Some((grid.order(cell), cube, Voxel::of_points(normal), sums.class))
        })
        .collect();
    cells.par_sort_unstable_by_key(|c| c.0);
    scene.geometry.cubes.extend(cells.iter().map(|c| c.1));
    scene.voxels.extend(cells.iter().map(|c| c.2));
    if settings.has_material || cells.iter().all(|c| c.3 == 0) {
        scene.assign_materials_in_turn(part.index, materials, cells.len());
    } else {
        for ((.., class), material) in cells.iter().zip(materials.iter().cycle()) {
            let material = scene.library.of_class(*material, *class);
            let surface = scene.surface(part.index, material);
            scene.cube_surfaces.push(surface);
        }
    }
    scene.check_counts()
}
