//! The area that points cover: square cells with points, in bounded memory.

use std::collections::HashMap;

/// Side of the smallest cells, m.
const MIN_SIDE: f64 = 0.25;
/// Cells along the side of a block, whose cells are the bits of one word per row.
const BLOCK_CELLS: i64 = 64;
/// Maximum number of blocks of 520 bytes that are kept; beyond it the side of cells doubles.
const MAX_BLOCKS: usize = 1 << 17;
/// Minimum number of points per occupied cell at which empty cells within the cover are rare: of points that
/// are strewn at random, 1 in 22 000 cells is empty.
const MIN_POINTS_PER_CELL: f64 = 10.0;

/// A cell of the smallest side.
pub(super) type SmallestCell = [i64; 2];

/// The cells of a place that have points.
#[derive(Clone, Debug)]
pub(super) struct Occupancy {
    side: f64,
    /// How often the smallest side has been doubled.
    doublings: u32,
    /// The blocks with the keys of their places.
    blocks: Vec<([i64; 2], Box<[u64; BLOCK_CELLS as usize]>)>,
    places: HashMap<[i64; 2], usize>,
    /// The block of the last place: neighbours in a cloud are near each other.
    latest: usize,
    max_blocks: usize,
}

impl Default for Occupancy {
    fn default() -> Occupancy {
        Occupancy::new(0, MAX_BLOCKS)
    }
}

impl Occupancy {
    fn new(doublings: u32, max_blocks: usize) -> Occupancy {
        let side = MIN_SIDE * 2f64.powi(doublings as i32);
        Occupancy { side, doublings, blocks: Vec::new(), places: HashMap::new(), latest: 0, max_blocks }
    }

    /// The smallest cell of a place.
    pub fn smallest_cell(x: f64, y: f64) -> SmallestCell {
        [x, y].map(|v| {
            let cells = v / MIN_SIDE;
            // Rounding down is a call on processors without an instruction for it; a conversion is not.
            let whole = cells as i64;
            whole.saturating_sub(i64::from(whole as f64 > cells))
        })
    }

    /// Marks the cell that a smallest cell belongs to. The cells that are marked in the end do not depend on
    /// the order of places. Doubling the side ends: it halves the indices of blocks, which soon are 0 or −1,
    /// four blocks at most.
    pub fn mark(&mut self, cell: SmallestCell) {
        self.mark_cell(cell.map(|c| c >> self.doublings));
        while self.blocks.len() > self.max_blocks {
            *self = self.coarser();
        }
    }

    fn mark_cell(&mut self, cell: [i64; 2]) {
        let block = cell.map(|c| c.div_euclid(BLOCK_CELLS));
        let [column, row] = cell.map(|c| c.rem_euclid(BLOCK_CELLS));
        if self.blocks.get(self.latest).is_none_or(|(latest, _)| *latest != block) {
            self.latest = *self.places.entry(block).or_insert(self.blocks.len());
            if self.latest == self.blocks.len() {
                self.blocks.push((block, Box::new([0; BLOCK_CELLS as usize])));
            }
        }
        self.blocks[self.latest].1[row as usize] |= 1 << column;
    }

    /// The same with cells of twice the side.
    fn coarser(&self) -> Occupancy {
        let mut coarse = Occupancy::new(self.doublings + 1, self.max_blocks);
        for (block, rows) in &self.blocks {
            for (row, bits) in (0..).zip(rows.iter()) {
                let mut bits = *bits;
                while bits != 0 {
                    let column = i64::from(bits.trailing_zeros());
                    bits &= bits - 1;
                    let cell = [block[0] * BLOCK_CELLS + column, block[1] * BLOCK_CELLS + row];
                    coarse.mark_cell(cell.map(|c| c.div_euclid(2)));
                }
            }
        }
        coarse
    }

    /// True if the same cells are marked, whatever their side.
    fn is_like(&self, other: &Occupancy) -> bool {
        let rows_at = |place: &[i64; 2]| other.places.get(place).map(|at| &other.blocks[*at].1);
        self.blocks.len() == other.blocks.len()
            && self.blocks.iter().all(|(place, rows)| rows_at(place) == Some(rows))
    }

    fn cells(&self) -> u64 {
        let ones =
            |rows: &[u64; BLOCK_CELLS as usize]| rows.iter().map(|r| u64::from(r.count_ones())).sum::<u64>();
        self.blocks.iter().map(|(_, rows)| ones(rows)).sum()
    }

    /// The area of the cells with points, m², and their side, m: that of the smallest cells which have ten
    /// points on average, or of those that no doubling joins. `None` without points.
    pub fn area(&self, points: u64) -> Option<(f64, f64)> {
        let mut cover = self.clone();
        // Ends: each doubling halves the indices of cells until all are 0 or −1. Cells on two sides of an
        // axis never join.
        loop {
            let cells = cover.cells();
            if cells == 0 {
                return None;
            }
            let area = Some((cells as f64 * cover.side * cover.side, cover.side));
            if cells == 1 || points as f64 >= MIN_POINTS_PER_CELL * cells as f64 {
                return area;
            }
            let coarser = cover.coarser();
            if coarser.is_like(&cover) {
                return area;
            }
            cover = coarser;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cover_of_points_is_their_area() {
        let mut cover = Occupancy::default();
        // 64 by 32 m around the origin, 25 points per m².
        let places =
            || (0..320 * 160).map(|i| [f64::from(i % 320), f64::from(i / 320)].map(|v| 0.2 * v + 0.1));
        places().for_each(|[x, y]| cover.mark(Occupancy::smallest_cell(x - 32.0, y - 16.0)));
        assert_eq!(cover.area(320 * 160), Some((64.0 * 32.0, 1.0)));
        // Too many cells get larger, in any order of points.
        let mut few = [false, true].map(|is_reversed| {
            let mut few = Occupancy { max_blocks: 4, ..Occupancy::default() };
            let mut all: Vec<[f64; 2]> = places().collect();
            if is_reversed {
                all.reverse();
            }
            all.iter().for_each(|[x, y]| few.mark(Occupancy::smallest_cell(*x, *y)));
            few
        });
        assert_eq!(few[0].side, few[1].side);
        assert!(few[0].side > MIN_SIDE && few[0].blocks.len() <= 4);
        let area = few[0].area(320 * 160);
        assert_eq!(area, few[1].area(320 * 160));
        assert_eq!(area.map(|(area, _)| area), Some(64.0 * 32.0));
        few[0] = Occupancy::default();
        assert_eq!(few[0].area(0), None);
        few[0].mark(Occupancy::smallest_cell(7.0, -1e7));
        assert!(few[0].area(1).is_some());
    }

    #[test]
    fn cells_are_rounded_down() {
        for i in -4000..4000 {
            let v = 0.013 * f64::from(i);
            let [cell, other] = Occupancy::smallest_cell(v, 0.25 * f64::from(i));
            assert_eq!((cell, other), ((v / MIN_SIDE).floor() as i64, i64::from(i)), "{v}");
        }
        for v in [0.0, -0.0, 1e13, -1e13 - 0.1, f64::NAN, 1e300, -1e300] {
            assert_eq!(Occupancy::smallest_cell(v, v), [(v / MIN_SIDE).floor() as i64; 2], "{v}");
        }
    }

    #[test]
    fn few_points_around_the_origin_have_an_area() {
        for places in [
            &[[1.0, 1.0], [-1.0, -1.0]][..],
            &[[1e-9, 5.0], [-1e-9, 5.0]],
            &[[3.0, 4.0], [-3.0, 4.0], [3.0, -4.0], [-3.0, -4.0]],
            &[[1e9, 1e9], [-1e9, -1e9], [0.0, -0.1]],
        ] {
            let mut cover = Occupancy::default();
            places.iter().for_each(|[x, y]| cover.mark(Occupancy::smallest_cell(*x, *y)));
            let (area, side) = cover.area(places.len() as u64).unwrap();
            assert!(area >= side * side && area <= 4.0 * side * side, "{places:?}: {area} {side}");
        }
    }
}
