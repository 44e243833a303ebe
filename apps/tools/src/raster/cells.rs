//! Sums of points in square cells, in tiles that exist where there are points.

use std::collections::HashMap;
use vlscan_geom::DVec3;

/// Cells along the side of a tile.
const TILE_CELLS: i64 = 64;

/// The points of a cell.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    pub points: u32,
    /// First returns.
    pub pulses: u32,
    /// Height of the highest point, m.
    pub highest: f64,
}

/// The ground points of a cell.
#[derive(Clone, Copy, Debug, Default)]
struct Ground {
    points: u32,
    /// Sum of the positions, m: x and y from the south-western corner of the tile, z as it is.
    sum: DVec3,
}

const NO_POINTS: Cell = Cell { points: 0, pulses: 0, highest: f64::NEG_INFINITY };

#[derive(Clone, Debug)]
struct Tile {
    key: [i64; 2],
    cells: TileCells,
}

/// The cells of a tile.
#[derive(Clone, Debug)]
enum TileCells {
    /// Cells with points, ordered by place, so that scattered points take little memory.
    Few(Vec<(u16, Cell, Ground)>),
    /// All cells; without ground if no ground is requested.
    All(Vec<Cell>, Vec<Ground>),
}

/// Cells with points of a tile up to which the others take no memory.
const MAX_FEW: usize = 256;

impl TileCells {
    /// The sums at a place.
    fn at(&mut self, place: usize, has_ground: bool) -> (&mut Cell, Option<&mut Ground>) {
        if let TileCells::Few(few) = self
            && few.len() >= MAX_FEW
        {
            *self = Self::all(few, has_ground);
        }
        match self {
            TileCells::All(cells, ground) => (&mut cells[place], ground.get_mut(place)),
            TileCells::Few(few) => {
                let key = place as u16;
                let at = few.binary_search_by_key(&key, |(place, ..)| *place).unwrap_or_else(|at| {
                    few.insert(at, (key, NO_POINTS, Ground::default()));
                    at
                });
                let (_, cell, ground) = &mut few[at];
                (cell, has_ground.then_some(ground))
            }
        }
    }

    fn all(few: &[(u16, Cell, Ground)], has_ground: bool) -> TileCells {
        let count = (TILE_CELLS * TILE_CELLS) as usize;
        let mut cells = vec![NO_POINTS; count];
        let mut grounds = vec![Ground::default(); if has_ground { count } else { 0 }];
        for (place, cell, ground) in few {
            cells[usize::from(*place)] = *cell;
            if let Some(at) = grounds.get_mut(usize::from(*place)) {
                *at = *ground;
            }
        }
        TileCells::All(cells, grounds)
    }

    /// The cell at a place.
    fn get(&self, place: usize) -> Cell {
        match self {
            TileCells::All(cells, _) => cells[place],
            TileCells::Few(few) => {
                let at = few.binary_search_by_key(&(place as u16), |(place, ..)| *place);
                at.map_or(NO_POINTS, |at| few[at].1)
            }
        }
    }

    /// The places of cells with points, ascending.
    fn places(&self) -> Box<dyn Iterator<Item = i64> + '_> {
        match self {
            TileCells::All(cells, _) => {
                Box::new((0..).zip(cells).filter(|(_, cell)| cell.points > 0).map(|(at, _)| at))
            }
            TileCells::Few(few) => Box::new(few.iter().map(|(place, ..)| i64::from(*place))),
        }
    }

    /// The ground of cells in the order of places.
    fn ground(&self) -> Box<dyn Iterator<Item = &Ground> + '_> {
        match self {
            TileCells::All(_, ground) => Box::new(ground.iter()),
            TileCells::Few(few) => Box::new(few.iter().map(|(.., ground)| ground)),
        }
    }

    /// Bytes of memory, approximately.
    fn memory(&self) -> usize {
        match self {
            TileCells::All(cells, ground) => size_of_val(&cells[..]) + size_of_val(&ground[..]),
            TileCells::Few(few) => few.capacity() * size_of::<(u16, Cell, Ground)>(),
        }
    }
}

/// The cells that have points.
#[derive(Clone, Debug)]
pub(super) struct Cells {
    side: f64,
    has_ground: bool,
    tiles: Vec<Tile>,
    places: HashMap<[i64; 2], usize>,
    /// The tile of the last point.
    latest: usize,
    /// Bytes of the cells.
    bytes: u64,
}

impl Cells {
    /// No points yet; cells have this side, m.
    pub fn new(side: f64, has_ground: bool) -> Cells {
        Cells { side, has_ground, tiles: Vec::new(), places: HashMap::new(), latest: 0, bytes: 0 }
    }

    pub fn side(&self) -> f64 {
        self.side
    }

    /// Bytes of memory, approximately.
    pub fn memory(&self) -> u64 {
        self.bytes + (self.tiles.len() * (size_of::<Tile>() + size_of::<([i64; 2], usize)>() * 2)) as u64
    }

    /// Adds a point; returns whether memory has grown.
    pub fn add(&mut self, p: DVec3, is_first_return: bool, is_ground: bool) -> bool {
        let cell = [p.x, p.y].map(|v| (v / self.side).floor() as i64);
        let key = cell.map(|c| c.div_euclid(TILE_CELLS));
        let is_new = self.select(key);
        let tile = &mut self.tiles[self.latest];
        let before = tile.cells.memory();
        let (cell, ground) = tile.cells.at(index(cell), self.has_ground);
        cell.points = cell.points.saturating_add(1);
        cell.pulses = cell.pulses.saturating_add(u32::from(is_first_return));
        cell.highest = cell.highest.max(p.z);
        if let Some(ground) = ground.filter(|_| is_ground) {
            let corner = key.map(|k| (k * TILE_CELLS) as f64 * self.side);
            ground.points = ground.points.saturating_add(1);
            ground.sum += DVec3::new(p.x - corner[0], p.y - corner[1], p.z);
        }
        let after = tile.cells.memory();
        self.bytes += (after - before) as u64;
        is_new || after > before
    }

    /// Makes a tile the latest; returns whether it is new.
    fn select(&mut self, key: [i64; 2]) -> bool {
        if self.tiles.get(self.latest).is_some_and(|tile| tile.key == key) {
            return false;
        }
        if let Some(&known) = self.places.get(&key) {
            self.latest = known;
            return false;
        }
        self.latest = self.tiles.len();
        self.places.insert(key, self.latest);
        self.tiles.push(Tile { key, cells: TileCells::Few(Vec::with_capacity(1)) });
        true
    }

    /// A cell by column and row; `None` without points.
    pub fn cell(&self, cell: [i64; 2]) -> Option<Cell> {
        let tile = *self.places.get(&cell.map(|c| c.div_euclid(TILE_CELLS)))?;
        Some(self.tiles[tile].cells.get(index(cell))).filter(|cell| cell.points > 0)
    }

    /// The tiles by row and column, so that nothing depends on the order of points.
    fn sorted(&self) -> Vec<&Tile> {
        let mut tiles: Vec<&Tile> = self.tiles.iter().collect();
        tiles.sort_by_key(|tile| [tile.key[1], tile.key[0]]);
        tiles
    }

    /// Columns and rows of the cells with points.
    fn occupied(&self) -> impl Iterator<Item = [i64; 2]> + '_ {
        self.tiles.iter().flat_map(|tile| tile.cells.places().map(|at| place(tile.key, at)))
    }

    /// Column and row of the first and of the last cell along both axes; there must be points.
    pub fn extent(&self) -> ([i64; 2], [i64; 2]) {
        self.occupied().fold(([i64::MAX; 2], [i64::MIN; 2]), |(low, high), cell| {
            let each = |of: fn(i64, i64) -> i64, ends: [i64; 2]| [of(ends[0], cell[0]), of(ends[1], cell[1])];
            (each(i64::min, low), each(i64::max, high))
        })
    }

    /// The first and the last column with points in each of `count` rows, counted from the cell `first`.
    pub fn row_ends(&self, first: [i64; 2], count: usize) -> Vec<Option<[i64; 2]>> {
        let mut ends: Vec<Option<[i64; 2]>> = vec![None; count];
        for cell in self.occupied() {
            let [column, row] = [cell[0] - first[0], cell[1] - first[1]];
            let [low, high] = ends[row as usize].get_or_insert([column; 2]);
            (*low, *high) = ((*low).min(column), (*high).max(column));
        }
        ends
    }

    /// The mean ground point of each cell that has any, in the world, m; by row and column of tiles.
    pub fn ground(&self) -> impl Iterator<Item = DVec3> + '_ {
        self.sorted().into_iter().flat_map(|tile| {
            let corner = tile.key.map(|k| (k * TILE_CELLS) as f64 * self.side);
            let corner = DVec3::new(corner[0], corner[1], 0.0);
            let with_points = tile.cells.ground().filter(|ground| ground.points > 0);
            with_points.map(move |ground| ground.sum / f64::from(ground.points) + corner)
        })
    }
}

/// The place of a cell in its tile.
fn index(cell: [i64; 2]) -> usize {
    let [column, row] = cell.map(|c| c.rem_euclid(TILE_CELLS));
    (row * TILE_CELLS + column) as usize
}

/// Column and row of the cell at a place of a tile.
fn place(key: [i64; 2], at: i64) -> [i64; 2] {
    [key[0] * TILE_CELLS + at % TILE_CELLS, key[1] * TILE_CELLS + at / TILE_CELLS]
}
