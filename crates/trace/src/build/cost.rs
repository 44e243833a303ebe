//! Costs of a tree: the running sums of spec tree-and-schedule §1.12 and the statistics of spec
//! tree-and-schedule §1.16.

use crate::options::{BuildOptions, Statistics};
use std::sync::{Mutex, PoisonError};

/// Sums over the nodes of a tree or of a part of it. Areas are surfaces, in any unit and by any rule that the
/// builder applies consistently.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sums {
    area_interior: f64,
    area_leaves: f64,
    area_primitives: f64,
    interior: usize,
    leaves: usize,
    references: usize,
    max_depth: u32,
    max_leaf: usize,
    min_leaf: usize,
}

impl Sums {
    pub const ZERO: Sums = Sums {
        area_interior: 0.0,
        area_leaves: 0.0,
        area_primitives: 0.0,
        interior: 0,
        leaves: 0,
        references: 0,
        max_depth: 0,
        max_leaf: 0,
        min_leaf: usize::MAX,
    };

    /// Returns the sums of a leaf of `count` > 0 primitives.
    pub fn leaf(area: f64, count: usize, depth: u32) -> Sums {
        Sums {
            area_leaves: area,
            area_primitives: area * count as f64,
            leaves: 1,
            references: count,
            max_depth: depth,
            max_leaf: count,
            min_leaf: count,
            ..Sums::ZERO
        }
    }

    /// Returns the sums of an interior node without its children.
    pub fn interior(area: f64) -> Sums {
        Sums { area_interior: area, interior: 1, ..Sums::ZERO }
    }

    pub fn plus(self, part: Sums) -> Sums {
        Sums {
            area_interior: self.area_interior + part.area_interior,
            area_leaves: self.area_leaves + part.area_leaves,
            area_primitives: self.area_primitives + part.area_primitives,
            interior: self.interior + part.interior,
            leaves: self.leaves + part.leaves,
            references: self.references + part.references,
            max_depth: self.max_depth.max(part.max_depth),
            max_leaf: self.max_leaf.max(part.max_leaf),
            min_leaf: self.min_leaf.min(part.min_leaf),
        }
    }

    /// Number of references to primitives in all leaves.
    pub fn references(&self) -> usize {
        self.references
    }

    /// Returns the statistics of a complete tree, whose root has the area `root` in the unit of the sums and
    /// `square_metres` in m².
    pub fn statistics(
        &self,
        options: &BuildOptions,
        primitives: usize,
        root: f64,
        square_metres: f64,
    ) -> Statistics {
        let sum = options.cost_interior * self.area_interior
            + options.cost_leaf * self.area_leaves
            + options.cost_primitive * self.area_primitives;
        Statistics {
            primitives,
            references: self.references,
            interior: self.interior,
            leaves: self.leaves,
            max_depth: self.max_depth,
            max_leaf: self.max_leaf,
            min_leaf: if self.leaves > 0 { self.min_leaf } else { 0 },
            root_area: square_metres,
            // The probability of hitting a root without area is zero; it costs as much as a leaf.
            cost: if root > 0.0 {
                sum / root
            } else {
                options.cost_leaf + options.cost_primitive * primitives as f64
            },
            booked_cost: None,
        }
    }
}

/// A split to be accepted or rejected.
pub(crate) struct Proposal {
    pub area: f64,
    /// Probabilities that a ray hits the lower and the upper child.
    pub chances: [f64; 2],
    /// Numbers of primitives in the node, in the lower and in the upper child.
    pub counts: [usize; 3],
}

/// Accepts splits by their effect on the cost of the tree. Thread-safe.
pub(crate) enum CostAccount {
    /// Considers each node alone.
    Local,
    /// Considers the cost of the complete tree so far. Choosing a split and partitioning the primitives
    /// happen outside the lock (the paper's Algorithm 1).
    Global(Mutex<RunningCost>),
}

/// The paper's ILOT cache: running sums over interior nodes, leaves and primitives ("objects"), and their
/// total, where every unfinished node counts as a leaf (spec tree-and-schedule §1.12).
#[derive(Clone, Copy, Debug)]
pub(crate) struct RunningCost {
    interior: f64,
    leaves: f64,
    primitives: f64,
    total: f64,
    root: f64,
}

impl RunningCost {
    /// Returns the sums of a tree whose root is a leaf (eq 9).
    fn of_root(options: &BuildOptions, root: f64, count: usize) -> RunningCost {
        RunningCost {
            interior: 0.0,
            leaves: options.cost_leaf * root,
            primitives: options.cost_primitive * root * count as f64,
            total: options.cost_leaf + options.cost_primitive * count as f64,
            root,
        }
    }

    /// Returns the sums with the node of the proposal as an interior node (eqs 10–12). The node's cost as a
    /// leaf is subtracted before the costs of its children are added: where a split gains next to nothing,
    /// the rounding of this order decides, and the published trees depend on it.
    fn with(&self, options: &BuildOptions, split: &Proposal, [n, nl, nr]: [f64; 3]) -> RunningCost {
        let (ci, cl, co) = (options.cost_interior, options.cost_leaf, options.cost_primitive);
        let (left, right) = (split.chances[0] * split.area, split.chances[1] * split.area);
        let interior = self.interior + ci * split.area;
        let leaves = self.leaves - cl * split.area + cl * (left + right);
        let primitives = self.primitives - co * split.area * n + co * (left * nl + right * nr);
        let total = (interior + leaves + primitives) / self.root;
        RunningCost { interior, leaves, primitives, total, root: self.root }
    }
}

impl CostAccount {
    /// Creates the account of a tree whose root has the area `root` and `count` primitives.
    pub fn global(options: &BuildOptions, root: f64, count: usize) -> CostAccount {
        CostAccount::Global(Mutex::new(RunningCost::of_root(options, root, count)))
    }

    /// True if the split makes the tree cheaper. If so, it is added to the cost of the tree.
    pub fn try_split(&self, options: &BuildOptions, split: &Proposal) -> bool {
        let counts = split.counts.map(|c| c.next_multiple_of(options.grain.max(1)) as f64);
        match self {
            CostAccount::Local => {
                let [n, nl, nr] = counts;
                let (ci, co) = (options.cost_interior, options.cost_primitive);
                ci + co * (split.chances[0] * nl + split.chances[1] * nr) < co * n
            }
            CostAccount::Global(cost) => {
                let mut cost = cost.lock().unwrap_or_else(PoisonError::into_inner);
                let with_split = cost.with(options, split, counts);
                let accepted = with_split.total < cost.total;
                if accepted {
                    *cost = with_split;
                }
                accepted
            }
        }
    }

    /// The accounted cost of the finished tree; `None` with `CostAccount::Local`.
    pub fn total(&self) -> Option<f64> {
        match self {
            CostAccount::Local => None,
            CostAccount::Global(cost) => Some(cost.lock().unwrap_or_else(PoisonError::into_inner).total),
        }
    }
}
