//! Outlines of roofs: where as many points around lie on a building as below it.
//!
//! Points are weighed by their distance. A single point among many does not move an outline, and an outline
//! across the rows of a grid is as long as it is: cells are cut where the vote is even (marching squares:
//! Lorensen and Cline 1987, *Marching cubes*, in two dimensions).

use rayon::prelude::*;
use vlscan_geom::DVec3;

/// Distance from which on points have no weight, in cells.
const REACH: f64 = 1.5;
/// Weight of the assumption that there is no roof where there are no points; a point there has 1.
const NO_ROOF: f64 = 0.25;

/// A place on the grid: row and column.
pub(super) type Place = (i64, i64);

/// Points in the order of the cells that hold them.
pub(super) struct Binned<'p> {
    points: &'p [DVec3],
    cell: f64,
    /// The numbers of points by their row and column.
    order: Vec<usize>,
}

impl<'p> Binned<'p> {
    pub fn new(points: &'p [DVec3], cell: f64) -> Binned<'p> {
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.par_sort_by_key(|i| (place_of(points[*i], cell), *i));
        Binned { points, cell, order }
    }

    fn place(&self, i: usize) -> Place {
        place_of(self.points[i], self.cell)
    }

    /// The numbers of the points in the cells of a row whose columns are from `first` to `last`.
    pub fn in_row(&self, row: i64, first: i64, last: i64) -> &[usize] {
        let begin = self.order.partition_point(|i| self.place(*i) < (row, first));
        let count = self.order[begin..].partition_point(|i| self.place(*i) <= (row, last));
        &self.order[begin..begin + count]
    }

    /// The numbers of the points in the cells around a node that are as near as [`REACH`].
    fn around_node(&self, (j, i): Place) -> impl Iterator<Item = usize> + '_ {
        (j - 2..j + 2).flat_map(move |row| self.in_row(row, i - 2, i + 1)).copied()
    }

    /// True if there may be a node within reach of `p` that is within reach of one of these points, too.
    pub fn is_near(&self, p: DVec3) -> bool {
        let (j, i) = place_of(p, self.cell);
        (j - 3..=j + 3).any(|row| !self.in_row(row, i - 3, i + 3).is_empty())
    }

    /// The rows that hold points, ascending.
    fn rows(&self) -> Vec<i64> {
        let mut rows: Vec<i64> = self.order.iter().map(|i| self.place(*i).0).collect();
        rows.dedup();
        rows
    }

    /// The columns of a row that hold points.
    fn columns(&self, row: i64) -> impl Iterator<Item = i64> + '_ {
        self.in_row(row, i64::MIN, i64::MAX).iter().map(|i| self.place(*i).1)
    }
}

/// The cell that holds a point.
pub(super) fn place_of(p: DVec3, cell: f64) -> Place {
    let at = |v: f64| (v / cell).floor() as i64;
    (at(p.y), at(p.x))
}

/// Votes on whether nodes, the corners of cells, are roof.
pub(super) struct Votes {
    /// By row and column.
    nodes: Vec<(Place, f32)>,
}

impl Votes {
    /// The votes of points of buildings and of points that are none, of which those count that lie `step` m
    /// or more below the building.
    pub fn of(roofs: &Binned, others: &Binned, step: f64) -> Votes {
        let mut rows: Vec<i64> = roofs.rows().into_iter().flat_map(|row| row - 1..=row + 2).collect();
        rows.sort_unstable();
        rows.dedup();
        let of_row = |j: &i64| {
            let around = (j - 2..j + 2).flat_map(|row| roofs.columns(row));
            let mut columns: Vec<i64> = around.flat_map(|i| i - 1..=i + 2).collect();
            columns.sort_unstable();
            columns.dedup();
            let nodes = columns.into_iter().map(|i| ((*j, i), vote(roofs, others, (*j, i), step) as f32));
            nodes.collect::<Vec<_>>()
        };
        let nodes: Vec<Vec<(Place, f32)>> = rows.par_iter().map(of_row).collect();
        Votes { nodes: nodes.concat() }
    }

    /// Above 0 for roof.
    fn at(&self, node: Place) -> f64 {
        let found = self.nodes.binary_search_by_key(&node, |(place, _)| *place);
        found.map_or(-NO_ROOF, |i| f64::from(self.nodes[i].1))
    }

    /// The cells that are roof, or a part of them.
    pub fn cells(&self) -> Vec<Place> {
        let is_roof = self.nodes.iter().filter(|(_, vote)| *vote > 0.0);
        let around = |(j, i): Place| [(j - 1, i - 1), (j - 1, i), (j, i - 1), (j, i)];
        let mut cells: Vec<Place> = is_roof.flat_map(|(node, _)| around(*node)).collect();
        cells.sort_unstable();
        cells.dedup();
        cells
    }

    /// The part of a cell that is roof, as a polygon in the order of its corners.
    pub fn polygon(&self, (j, i): Place) -> Vec<Corner> {
        let offsets = [(0, 0), (0, 1), (1, 1), (1, 0)];
        let votes = offsets.map(|(dj, di)| self.at((j + dj, i + di)));
        let mut corners = Vec::new();
        for from in 0..4 {
            let to = (from + 1) % 4;
            if votes[from] > 0.0 {
                corners.push(Corner { edge: from, along: 0.0, is_cut: false });
            }
            if (votes[from] > 0.0) != (votes[to] > 0.0) {
                let along = votes[from] / (votes[from] - votes[to]);
                corners.push(Corner { edge: from, along, is_cut: true });
            }
        }
        corners
    }
}

/// A corner of the part of a cell that is roof.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Corner {
    /// The edge of the cell on which it lies: 0 from (0, 0) to (1, 0), and so on around.
    pub edge: usize,
    /// Share of the edge before it.
    pub along: f64,
    /// True for a point on the outline, false for a corner of the cell.
    pub is_cut: bool,
}

/// The vote on a node.
fn vote(roofs: &Binned, others: &Binned, node: Place, step: f64) -> f64 {
    let (x, y) = (node.1 as f64 * roofs.cell, node.0 as f64 * roofs.cell);
    let square = (REACH * roofs.cell).powi(2);
    let weight = |p: DVec3| (1.0 - ((p.x - x).powi(2) + (p.y - y).powi(2)) / square).max(0.0).powi(2);
    let on_roof = roofs.around_node(node).map(|i| (roofs.points[i], weight(roofs.points[i])));
    let (roof, height) = on_roof.fold((0.0, 0.0), |(sum, height), (p, w)| (sum + w, height + w * p.z));
    if roof <= 0.0 {
        return -NO_ROOF;
    }
    let is_below = |p: &DVec3| p.z < height / roof - step;
    let below = others.around_node(node).map(|i| others.points[i]).filter(is_below).map(weight);
    roof - below.sum::<f64>() - NO_ROOF
}
