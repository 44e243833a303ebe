//! Sorts the points of a cloud into the cells of its grid, as many of them at a time as have room.

use super::Settings;
use super::cells::{Budget, Cell, CellSums, Cells, CloudGrid, SHARDS};
use super::occupancy::{DenseSums, Occupancy};
use crate::builder::SceneBuilder;
use crate::text::Source;
use rayon::prelude::*;
use std::ops::Range;
use vlscan_base::error::{Error, Result};
use vlscan_formats::PointRow;

/// Memory of all tables of cells, bytes, beyond which a cloud is read several times; small in tests.
const MIN_TABLE_BYTES: u64 = if cfg!(test) { 1 << 20 } else { 400 << 20 };

/// The tables of cells may take this fraction of the memory if that is more.
const MAX_TABLE_FRACTION: u64 = if cfg!(test) { u64::MAX } else { 64 };

/// Fraction of the memory of the tables of cells that occupancy bits may take, as a divisor.
const OCCUPANCY_FRACTION: u64 = 4;

/// Batches of points for which there has to be room at a time.
const BATCHES: usize = 2;

/// Cells that are looked at to halve their number.
const SAMPLE: usize = 1 << 10;

/// Sorts points into cells. Each cell receives its points in the order of the file for any number of threads,
/// and all of them in the same reading. Where a first reading finds too many cells, it also finds which ones
/// there are, if the grid is not too large for that: then further readings have room for several times as
/// many.
pub(super) struct Sorter<'a, S> {
    grid: &'a CloudGrid,
    settings: &'a Settings,
    shards: [Cells<S>; SHARDS],
    budget: Budget,
    /// Memory that the tables may take without several readings, bytes.
    table_bytes: u64,
    /// The cells that this reading collects, by their [`CloudGrid::order`].
    range: Range<u128>,
    /// The existing cells, once the first reading has too many.
    occupied: Option<Occupancy>,
    /// In place of shards when all occupied cells are known.
    dense: Option<DenseSums<S>>,
}

impl<'a, S: CellSums> Sorter<'a, S> {
    /// A sorter for the first reading; the tables never take more than `memory`, bytes.
    pub fn new(grid: &'a CloudGrid, settings: &'a Settings, memory: u64) -> Sorter<'a, S> {
        Sorter {
            grid,
            settings,
            shards: Default::default(),
            budget: Budget::new(memory.try_into().unwrap_or(usize::MAX)),
            table_bytes: MIN_TABLE_BYTES.max(memory / MAX_TABLE_FRACTION),
            range: 0..u128::MAX,
            occupied: None,
            dense: None,
        }
    }

    /// Sorts points.
    ///
    /// # Errors
    /// When there is not enough memory for a table of cells.
    pub fn sort(&mut self, scene: &SceneBuilder, source: &Source, batches: &[Vec<PointRow>]) -> Result<()> {
        let sorted: Vec<_> = batches
            .par_iter()
            .map(|batch| {
                let mut sorted: [Vec<PointRow>; SHARDS] = Default::default();
                batch.iter().for_each(|p| self.put(*p, &mut sorted));
                sorted
            })
            .collect();
        sorted.chunks(BATCHES).try_for_each(|some| self.add(scene, source, some))
    }

    fn add(
        &mut self,
        scene: &SceneBuilder,
        source: &Source,
        sorted: &[[Vec<PointRow>; SHARDS]],
    ) -> Result<()> {
        let (grid, rule) = (self.grid, self.settings.rule);
        if let (Some(dense), Some(occupied)) = (&mut self.dense, &self.occupied) {
            let (first, cells) = (dense.first, dense.shard_cells());
            dense.sums.par_chunks_mut(cells).enumerate().for_each(|(shard, sums)| {
                for point in sorted.iter().flat_map(|batch| &batch[shard]) {
                    let cell = grid.cell_of(point.position);
                    let at = occupied.rank(cell) - first - shard * cells;
                    sums[at].add(grid.centre(cell), point, rule);
                }
            });
            return Ok(());
        }
        self.make_room(sorted);
        let (budget, end, occupied) = (&self.budget, self.range.end, &self.occupied);
        let has_room = self.shards.par_iter_mut().enumerate().all(|(shard, cells)| {
            let mut points = sorted.iter().flat_map(|batch| &batch[shard]);
            points.all(|point| {
                let cell = grid.cell_of(point.position);
                occupied.iter().for_each(|occupied| occupied.mark(cell));
                grid.order(cell) >= end || cells.add(cell, grid.centre(cell), point, rule, budget)
            })
        });
        if has_room {
            return Ok(());
        }
        scene.check_memory(budget.taken() as u64, source.path())?;
        Err(Error::io("load", source.path(), std::io::ErrorKind::OutOfMemory.into()))
    }

    fn put(&self, point: PointRow, sorted: &mut [Vec<PointRow>; SHARDS]) {
        let Some(point) = self.settings.usable(point) else { return };
        let cell = self.grid.cell_of(point.position);
        let is_collected = self.range.contains(&self.grid.order(cell));
        match (&self.dense, &self.occupied) {
            // A file that changes between two readings, which is reported later, may have other cells than in
            // the first reading.
            (Some(dense), Some(occupied)) if is_collected && occupied.contains(cell) => {
                sorted[(occupied.rank(cell) - dense.first) / dense.shard_cells()].push(point);
            }
            (None, _) if is_collected => sorted[self.grid.shard_of_cell(cell)].push(point),
            (None, Some(occupied)) => occupied.mark(cell),
            _ => {}
        }
    }

    /// Leaves cells to the next reading until there is room for more points. Tables keep the size that they
    /// reached.
    fn make_room(&mut self, sorted: &[[Vec<PointRow>; SHARDS]]) {
        let more: Vec<usize> =
            (0..SHARDS).map(|shard| sorted.iter().map(|batch| batch[shard].len()).sum()).collect();
        let bytes = |of: &dyn Fn(&Cells<S>, usize) -> usize| {
            self.shards.iter().zip(&more).map(|(cells, more)| of(cells, *more) as u64).sum::<u64>()
        };
        let limit = self.table_bytes.max(bytes(&|cells, _| cells.bytes_with(0)));
        if bytes(&|_, more| Cells::<S>::bytes_of(2 * more)) > limit {
            return;
        }
        loop {
            let bytes = self.shards.iter().zip(&more).map(|(cells, more)| cells.bytes_with(*more) as u64);
            let count = self.shards.iter().map(Cells::len).sum::<usize>();
            if bytes.sum::<u64>() <= limit || count < 2 {
                return;
            }
            if self.range == (0..u128::MAX) {
                // Until now tables have had all cells.
                self.occupied = Occupancy::new(self.grid, self.table_bytes / OCCUPANCY_FRACTION);
                if let Some(occupied) = &self.occupied {
                    self.shards.par_iter().flat_map_iter(Cells::iter).for_each(|cell| occupied.mark(cell));
                }
            }
            let step = (count / SAMPLE).max(1);
            let cells = self.shards.iter().flat_map(Cells::iter).step_by(step);
            let mut sample: Vec<u128> = cells.map(|cell| self.grid.order(cell)).collect();
            let middle = sample.len() / 2;
            let (_, end, _) = sample.select_nth_unstable(middle);
            // The least of several cells is below their middle one.
            self.range.end = *end;
            let grid = self.grid;
            self.shards.par_iter_mut().for_each(|cells| cells.retain(|cell| grid.order(cell) < *end));
        }
    }

    /// The cells of this reading in order, with the sums over their points, and their number.
    pub fn found(&self) -> (usize, Box<dyn Iterator<Item = (Cell, S)> + '_>) {
        if let (Some(dense), Some(occupied)) = (&self.dense, &self.occupied) {
            let cells = occupied.cells_from(dense.first).zip(dense.sums.iter().copied());
            return (dense.sums.len(), Box::new(cells));
        }
        let cells = self.order();
        let count = cells.len();
        (count, Box::new(cells.into_iter().filter_map(|cell| Some((cell, *self.get(cell)?)))))
    }

    /// The cells of the tables in their order.
    fn order(&self) -> Vec<Cell> {
        // By z, then y, then x.
        let mut cells: Vec<Cell> = Vec::with_capacity(self.shards.iter().map(Cells::len).sum());
        cells.extend(self.shards.iter().flat_map(Cells::iter).map(|[x, y, z]| [z, y, x]));
        cells.par_sort_unstable();
        cells.par_iter_mut().for_each(|cell| cell.reverse());
        cells
    }

    /// The sums over the points of a cell.
    fn get(&self, cell: Cell) -> Option<&S> {
        self.shards[self.grid.shard_of_cell(cell)].get(cell)
    }

    /// Begins the next reading; `false` if all cells were found.
    pub fn go_on(&mut self) -> bool {
        self.range = self.range.end..u128::MAX;
        let Some(occupied) = &mut self.occupied else {
            self.shards.par_iter_mut().for_each(Cells::clear);
            return self.range.start < u128::MAX;
        };
        let first = match self.dense.take() {
            Some(dense) => dense.ranks().end,
            None => {
                occupied.count();
                let found = self.shards.iter().map(Cells::len).sum();
                self.shards = Default::default();
                found
            }
        };
        let most = self.budget.limit().min(self.table_bytes.try_into().unwrap_or(usize::MAX));
        let mut cells = occupied.cells_from(first);
        let count = cells.by_ref().take((most / size_of::<S>()).max(1)).count();
        self.range.end = cells.next().map_or(u128::MAX, |next| self.grid.order(next));
        self.dense = Some(DenseSums { sums: vec![S::NOTHING; count], first });
        count > 0
    }
}

#[cfg(test)]
mod tests {
    use super::super::cells::{NormalRule, Sums, Votes};
    use super::*;
    use crate::builder::LoadOptions;
    use crate::library::Library;
    use crate::spectra::Spectra;
    use std::collections::BTreeMap;
    use vlscan_geom::{Aabb, DVec3};

    const CELLS: usize = 40_000;
    const SIZE: [f64; 3] = [50.0, 40.0, 20.0];

    /// Three points in each of many cells, at different places of the file, with two classes.
    fn points() -> Vec<PointRow> {
        let point = |i: usize| {
            let cell = i * 7919 % CELLS;
            let [x, y, z] = [cell % 50, cell / 50 % 40, cell / 2000].map(|n| n as f64 + 0.25);
            let position = DVec3::new(x + (i / CELLS) as f64 * 0.125, y, z);
            let class = if i / CELLS == 1 { 9 } else { (cell % 5) as u8 };
            PointRow { position, class, ..PointRow::default() }
        };
        (0..3 * CELLS).map(point).collect()
    }

    /// The cells in order with the result of a function of their sums, the number of readings, and whether
    /// all cells were known before the last one.
    fn sorted<S: CellSums, T>(
        points: &[PointRow],
        size: [f64; 3],
        found: impl Fn(&S) -> T,
    ) -> (Vec<(Cell, T)>, usize, bool) {
        let grid = CloudGrid::around(Aabb { min: DVec3::ZERO, max: DVec3::from(size) }, 1.0).unwrap();
        let rule = NormalRule::Mean;
        let settings =
            Settings { voxel_size: 1.0, default_normal: None, rule, max_colour: 255.0, has_material: false };
        let options = LoadOptions::default();
        let library = Library::new(Spectra::new(&[], [1064.0]), options.rules, 0);
        let (scene, source) = (SceneBuilder::new(&options, library), Source::of("a.las", b""));
        let mut sorter = Sorter::<S>::new(&grid, &settings, u64::MAX);
        let (mut all, mut readings) = (Vec::new(), 0);
        let mut is_dense = false;
        loop {
            readings += 1;
            for batches in points.chunks(512) {
                sorter
                    .sort(&scene, &source, &batches.chunks(128).map(<[_]>::to_vec).collect::<Vec<_>>())
                    .unwrap();
            }
            is_dense |= sorter.dense.is_some();
            all.extend(sorter.found().1.map(|(cell, sums)| (cell, found(&sums))));
            if !sorter.go_on() {
                return (all, readings, is_dense);
            }
        }
    }

    #[test]
    fn many_cells_are_found_in_several_readings() {
        let points = points();
        let mut expected = BTreeMap::<[u32; 3], (u32, u8)>::new();
        for point in &points {
            let [x, y, z] = [point.position.x, point.position.y, point.position.z].map(|c| c as u32);
            let (count, class) = expected.entry([z, y, x]).or_insert((0, point.class));
            *count += 1;
            // The class of two of three points.
            *class = if point.class == 9 { *class } else { point.class };
        }
        let (found, readings, is_dense) = sorted(&points, SIZE, |sums: &Sums| (sums.count(), sums.class()));
        assert!(readings > 4 && is_dense, "{readings}");
        assert!(found.iter().map(|([x, y, z], sums)| ([*z, *y, *x], *sums)).eq(expected.clone()));
        let (found, readings, is_dense) = sorted(&points, SIZE, |votes: &Votes| votes.class());
        assert!(readings == 2 && is_dense, "{readings}");
        let classes = expected.iter().map(|([z, y, x], (_, class))| ([*x, *y, *z], *class));
        assert!(found.into_iter().eq(classes));
    }

    #[test]
    fn cells_far_apart_are_found_in_several_readings() {
        // Bits for all cells of the grid would take too much memory.
        let far = |mut point: PointRow| {
            point.position.x *= 1000.0;
            point.position.y *= 1000.0;
            point
        };
        let (expected, ..) = sorted(&points(), SIZE, |votes: &Votes| votes.class());
        let apart: Vec<PointRow> = points().into_iter().map(far).collect();
        let (found, readings, is_dense) = sorted(&apart, [50e3, 40e3, 20.0], |votes: &Votes| votes.class());
        assert!(readings > 1 && !is_dense, "{readings}");
        // The three points of a cell are in three cells.
        assert_eq!(found.len(), 3 * expected.len());
    }

    #[test]
    fn one_layer_of_cells_is_found_in_several_readings() {
        let points: Vec<PointRow> = points()
            .into_iter()
            .map(|mut point| {
                point.position.x += 50.0 * point.position.z.floor();
                point.position.z = 0.5;
                point
            })
            .collect();
        let (found, readings, _) = sorted(&points, [1000.0, 40.0, 1.0], |sums: &Sums| sums.count());
        assert!(readings > 4, "{readings}");
        assert!(found.len() == CELLS && found.iter().all(|(_, count)| *count == 3), "{}", found.len());
    }
}
