//! What a tree costs: the running sums of spec §1.12 and the statistics of §1.16.

use crate::tree::options::{BuildOptions, Statistics};
use std::sync::{Mutex, PoisonError};

/// Sums over the nodes of a tree or of a part of it.
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
    /// A part that is not there.
    pub const NOTHING: Sums = Sums {
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

    /// A leaf of `count` > 0 primitives.
    pub fn leaf(area: f64, count: usize, depth: u32) -> Sums {
        Sums {
            area_leaves: area,
            area_primitives: area * count as f64,
            leaves: 1,
            references: count,
            max_depth: depth,
            max_leaf: count,
            min_leaf: count,
            ..Sums::NOTHING
        }
    }

    /// An interior node over two parts.
    pub fn interior(area: f64, left: Sums, right: Sums) -> Sums {
        Sums {
            area_interior: area + left.area_interior + right.area_interior,
            area_leaves: left.area_leaves + right.area_leaves,
            area_primitives: left.area_primitives + right.area_primitives,
            interior: 1 + left.interior + right.interior,
            leaves: left.leaves + right.leaves,
            references: left.references + right.references,
            max_depth: left.max_depth.max(right.max_depth),
            max_leaf: left.max_leaf.max(right.max_leaf),
            min_leaf: left.min_leaf.min(right.min_leaf),
        }
    }

    /// The statistics of a whole tree whose root has the area `root` in the unit of the sums and `square_metres`.
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
            // A root without area is met by no ray worth counting; its cost is that of a leaf.
            cost: if root > 0.0 {
                sum / root
            } else {
                options.cost_leaf + options.cost_primitive * primitives as f64
            },
            booked_cost: None,
        }
    }
}

/// A split under judgement.
pub(crate) struct Proposal {
    /// Area of the node.
    pub area: f64,
    /// Chances of a ray to meet the lower and the upper child.
    pub chances: [f64; 2],
    /// Primitives in the node, in the lower and in the upper child.
    pub counts: [usize; 3],
}

/// Judges splits, for any number of threads at once.
pub(crate) enum Ledger {
    /// By each node alone.
    Local,
    /// By the cost of the tree so far. Choosing a split and parting the primitives happen outside the lock (the paper's
    /// Algorithm 1).
    Global(Mutex<Ilot>),
}

/// The paper's cache: running sums over interior nodes, leaves and primitives ("objects"), and their total, while every
/// unfinished node counts as a leaf (spec §1.12).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ilot {
    interior: f64,
    leaves: f64,
    primitives: f64,
    total: f64,
    root: f64,
}

impl Ilot {
    /// The root is a leaf (eq 9).
    fn of_root(options: &BuildOptions, root: f64, count: usize) -> Ilot {
        Ilot {
            interior: 0.0,
            leaves: options.cost_leaf * root,
            primitives: options.cost_primitive * root * count as f64,
            total: options.cost_leaf + options.cost_primitive * count as f64,
            root,
        }
    }

    /// The sums with the node of the proposal as an interior one (eqs 10–12). What the node cost as a leaf goes before what
    /// its sides cost comes: where a split gains next to nothing, the rounding of this order decides, and the published
    /// trees have it.
    fn with(&self, options: &BuildOptions, split: &Proposal, [n, nl, nr]: [f64; 3]) -> Ilot {
        let (ci, cl, co) = (options.cost_interior, options.cost_leaf, options.cost_primitive);
        let (left, right) = (split.chances[0] * split.area, split.chances[1] * split.area);
        let interior = self.interior + ci * split.area;
        let leaves = self.leaves - cl * split.area + cl * (left + right);
        let primitives = self.primitives - co * split.area * n + co * (left * nl + right * nr);
        let total = (interior + leaves + primitives) / self.root;
        Ilot { interior, leaves, primitives, total, root: self.root }
    }
}

impl Ledger {
    /// The cache of a tree whose root has this area and so many primitives.
    pub fn global(options: &BuildOptions, root: f64, count: usize) -> Ledger {
        Ledger::Global(Mutex::new(Ilot::of_root(options, root, count)))
    }

    /// Whether the split makes the tree cheaper; if so it is booked.
    pub fn accepts(&self, options: &BuildOptions, split: &Proposal) -> bool {
        let counts = split.counts.map(|c| c.next_multiple_of(options.grain.max(1)) as f64);
        match self {
            Ledger::Local => {
                let [n, nl, nr] = counts;
                let (ci, co) = (options.cost_interior, options.cost_primitive);
                ci + co * (split.chances[0] * nl + split.chances[1] * nr) < co * n
            }
            Ledger::Global(ilot) => {
                let mut ilot = ilot.lock().unwrap_or_else(PoisonError::into_inner);
                let speculated = ilot.with(options, split, counts);
                let accepted = speculated.total < ilot.total;
                if accepted {
                    *ilot = speculated;
                }
                accepted
            }
        }
    }

    /// The booked cost of the tree, when it is finished; `None` where nothing is booked.
    pub fn total(&self) -> Option<f64> {
        match self {
            Ledger::Local => None,
            Ledger::Global(ilot) => Some(ilot.lock().unwrap_or_else(PoisonError::into_inner).total),
        }
    }
}
