//! Point clouds as cubes (spec input-formats §4.4). The file is read twice, once for its extent and once into the cells of
//! the grid, so that memory grows with the number of occupied cells and not with that of the points.

mod cells;
mod points;
#[cfg(test)]
mod tests;

use super::assembly::{Assembly, PartSource};
use super::text::{Problems, Source, cut_into_pieces};
use super::voxel::Voxel;
use crate::error::Result;
use crate::geom::{Aabb, DVec3, unit};
use crate::survey::XyzLoader;
use crate::tree::Cube;
use cells::{Cells, Grid, NormalRule, SHARDS};
use points::{Columns, Point};
use rayon::prelude::*;
use std::ops::Range;

/// Bytes that one task reads.
const PIECE: usize = 1 << 20;

/// Fewest points that define a plane.
const PLANE_POINTS: u32 = 3;

/// Appends one cube per occupied cell of a file's grid, in the order of z, y, x.
pub(super) fn load(
    scene: &mut Assembly,
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
    if !source.is_text("a point cloud", &mut scene.diagnostics) {
        return Ok(());
    }
    let pieces = cut_into_pieces(source.bytes(), PIECE);
    let (extent, mut problems) = extent_of(source, &pieces, &settings.columns);
    if let Some((number, at, last)) = source.unended_line()
        && let Some((columns, found)) = points::cut(source.bytes(), last, &settings.columns)
    {
        problems.error(number, at..at + last.len(), || {
            format!("expected {columns} columns as in the first line, found {found}; is the file whole?")
        });
    }
    if !problems.report(source, &mut scene.diagnostics) {
        return Ok(());
    }
    if extent.is_empty() {
        scene.diagnostics.error(Some(source.place(1, 0..0)), "expected points, found none");
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
    let cells = collect(scene, source, &pieces, &settings, &grid)?;
    append_cubes(scene, part, &settings, &grid, cells, materials)
}

/// A loader's settings, checked.
struct Settings {
    columns: Columns,
    voxel_size: f64,
    default_normal: Option<DVec3>,
    rule: NormalRule,
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
        let columns = Columns::new(loader, rule != NormalRule::Plane);
        Ok(Settings { columns, voxel_size: size, default_normal, rule })
    }
}

/// The box around all points, and the lines that are none.
fn extent_of(source: &Source, pieces: &[Range<usize>], columns: &Columns) -> (Aabb, Problems) {
    let read: Vec<(Aabb, Problems, usize)> = pieces
        .par_iter()
        .map(|piece| {
            let (mut extent, mut problems) = (Aabb::EMPTY, Problems::default());
            let bytes = &source.bytes()[piece.clone()];
            let lines = points::each(bytes, piece.start == 0, columns, &mut problems, |p| {
                extent = extent.with(p.position)
            });
            (extent, problems, lines)
        })
        .collect();
    let (mut all, mut problems, mut passed) = (Aabb::EMPTY, Problems::default(), 0);
    for ((extent, found, lines), piece) in read.into_iter().zip(pieces) {
        all = all.union(extent);
        problems.append(found, passed, piece.start);
        passed += lines;
    }
    (all, problems)
}

/// Sorts all points into cells. Each cell sees its points in the order of the file whatever the number of threads.
fn collect(
    scene: &Assembly,
    source: &Source,
    pieces: &[Range<usize>],
    settings: &Settings,
    grid: &Grid,
) -> Result<Vec<Cells>> {
    let mut shards: Vec<Cells> = (0..SHARDS).map(|_| Cells::default()).collect();
    for wave in pieces.chunks(4 * rayon::current_num_threads()) {
        let read: Vec<Vec<Vec<Point>>> = wave
            .par_iter()
            .map(|piece| {
                let mut sorted = vec![Vec::new(); SHARDS];
                let mut reported = Problems::default();
                let (bytes, is_first) = (&source.bytes()[piece.clone()], piece.start == 0);
                points::each(bytes, is_first, &settings.columns, &mut reported, |point| {
                    if let Some(point) = settings.usable(point) {
                        sorted[grid.shard_of(point.position)].push(point);
                    }
                });
                sorted
            })
            .collect();
        shards.par_iter_mut().enumerate().for_each(|(shard, cells)| {
            read.iter().flat_map(|piece| &piece[shard]).for_each(|p| cells.add(grid, p, settings.rule));
        });
        let held: usize = shards.iter().map(Cells::memory).sum();
        scene.check_memory(held as u64, source.path())?;
    }
    Ok(shards)
}

impl Settings {
    /// The point with a normal that can be used: a bad one is replaced by the default or costs the point.
    fn usable(&self, point: Point) -> Option<Point> {
        let is_good = |n: &DVec3| n.is_finite() && *n != DVec3::ZERO;
        match point.normal {
            Some(n) if !is_good(&n) => self.default_normal.map(|n| Point { normal: Some(n), ..point }),
            _ => Some(point),
        }
    }
}

fn append_cubes(
    scene: &mut Assembly,
    part: &PartSource,
    settings: &Settings,
    grid: &Grid,
    shards: Vec<Cells>,
    materials: &[u32],
) -> Result<()> {
    let mut cells: Vec<(u128, Cube, Voxel)> = shards
        .into_par_iter()
        .flat_map_iter(|shard| shard.into_iter())
        .filter_map(|(cell, sums)| {
            let normal = match settings.rule {
                NormalRule::Plane if sums.count < PLANE_POINTS => Some(settings.default_normal?),
                _ => sums.normal(settings.rule).or(settings.default_normal),
            };
            let cube = Cube { centre: grid.centre(cell), half: 0.5 * settings.voxel_size };
            Some((grid.order(cell), cube, Voxel::of_points(normal)))
        })
        .collect();
    cells.par_sort_unstable_by_key(|c| c.0);
    let count = cells.len();
    scene.geometry.cubes.extend(cells.iter().map(|c| c.1));
    scene.voxels.extend(cells.iter().map(|c| c.2));
    scene.spread_materials(part.index, materials, count);
    scene.check_numbers()
}
