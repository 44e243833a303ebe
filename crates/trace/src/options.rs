//! Settings of a build, and statistics of its result.

use vlscan_choice::Choice as _;

vlscan_choice::choices! {
    /// How a tree chooses its splits.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Builder: default Builder::Bvh {
        /// kd-tree by the object median, axes in turn; 1 in HELIOS++.
        ///
        /// Spec tree-and-schedule §1.8, "simple".
        Median = "median" | "1",
        /// kd-tree by the surface area heuristic between the medians, axes in turn; 2 in HELIOS++.
        ///
        /// Spec tree-and-schedule §1.10.
        Sah = "sah" | "2",
        /// kd-tree by the surface area heuristic on the best of the three axes; 3 in HELIOS++.
        AxisSah = "axis-sah" | "3",
        /// kd-tree by the surface area heuristic over min/max histograms, axes in turn; 4 in HELIOS++.
        ///
        /// Spec tree-and-schedule §1.11.
        Fsah = "fsah" | "4",
        /// Hierarchy of bounding boxes with sixteen children per node: the fastest and smallest.
        Bvh = "bvh",
    }
}

impl Builder {
    /// The name on the command line and in pipeline files.
    pub fn name(self) -> &'static str {
        self.label()
    }
}

/// How the gain of a split is judged (spec tree-and-schedule §1.12).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Accounting {
    /// By the node alone; independent of the order of the build.
    Local,
    /// By the running cost of the whole tree, the paper's ILOT cache, which several threads update under a
    /// lock (its Algorithm 1). In exact arithmetic this accepts the splits that [`Accounting::Local`]
    /// accepts: the sides of a split have the area of the node together, so its effect on the whole is its
    /// effect on the node. Rounding differs, and decides when a build without depth cap ends; with several
    /// threads it depends on their order.
    Global,
}

/// Axes on which a node's split is searched. [`Builder::AxisSah`] always searches all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axes {
    /// Axis number depth mod 3.
    Turn,
    /// Axis number depth mod 3, then the others if it has no split that is accepted, as flat scenes need.
    TurnThenNext,
    /// The axis with the split of minimum loss.
    Best,
}

/// Estimate of the probability that a ray hits a side of a split.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Areas {
    /// Proportional to the side's length along the split axis (spec tree-and-schedule §1.4).
    Proportional,
    /// By the surface of the side's box.
    Surface,
}

/// Settings of a build. Those of splits and costs are for kd-trees; [`Builder::Bvh`] has different rules.
#[derive(Clone, Debug, PartialEq)]
pub struct BuildOptions {
    /// Builder.
    pub builder: Builder,
    /// Histogram bins m of [`Builder::Fsah`], 2 to 1024.
    pub bins: usize,
    /// Candidates n of [`Builder::Sah`] and [`Builder::AxisSah`], at least 2.
    pub candidates: usize,
    /// Minimum number of primitives that may be split, τ_p.
    pub min_primitives: usize,
    /// Cost of visiting an interior node, C_i.
    pub cost_interior: f64,
    /// Cost of visiting a leaf, C_l.
    pub cost_leaf: f64,
    /// Cost of testing a primitive, C_o.
    pub cost_primitive: f64,
    /// Number of primitives tested at once: a leaf's count is rounded up to a multiple of it when a split is
    /// judged.
    pub grain: usize,
    /// Maximum depth of a leaf; `None` is ⌊8 + 1.3·log2 N⌋.
    pub max_depth: Option<u32>,
    /// Axes that are searched.
    pub axes: Axes,
    /// Estimate of the probability that a ray hits a side of a split.
    pub areas: Areas,
    /// How the gain of a split is judged.
    pub accounting: Accounting,
    /// Threads of the build, each on different nodes; 0 is as many as the machine has, with 1 nodes are built
    /// one after the other (spec tree-and-schedule §2.1).
    pub jobs: usize,
    /// Threads that work together on the nodes of the upper ⌊log2⌋ levels of a kd-tree, where there are fewer
    /// nodes than threads; 0 is as many as the machine has, with 1 each node has one (spec tree-and-schedule
    /// §2.3).
    pub geometry_jobs: usize,
    /// Minimum number of primitives that are handed to another thread.
    pub delegate: usize,
}

impl Default for BuildOptions {
    fn default() -> BuildOptions {
        BuildOptions {
            builder: Builder::default(),
            bins: 32,
            candidates: 21,
            min_primitives: 17,
            cost_interior: 8.0,
            cost_leaf: 1.0,
            cost_primitive: 1.0,
            grain: 16,
            max_depth: None,
            axes: Axes::Best,
            areas: Areas::Surface,
            accounting: Accounting::Local,
            jobs: 0,
            geometry_jobs: 0,
            delegate: 32,
        }
    }
}

impl BuildOptions {
    /// Default settings of a builder. [`Builder::Median`] and [`Builder::Sah`] take the axes in turn, which
    /// distinguishes the latter from [`Builder::AxisSah`].
    pub fn of(builder: Builder) -> BuildOptions {
        let axes = match builder {
            Builder::Median | Builder::Sah => Axes::TurnThenNext,
            Builder::AxisSah | Builder::Fsah | Builder::Bvh => Axes::Best,
        };
        BuildOptions { builder, axes, ..BuildOptions::default() }
    }

    /// Costs and rules of HELIOS++ (spec tree-and-schedule §1.2): unit costs, τ_p = 5, axes in turn without a
    /// second try, global accounting, and no depth cap below the 64 levels, which it never reaches.
    pub fn strict(builder: Builder) -> BuildOptions {
        BuildOptions {
            builder,
            min_primitives: 5,
            cost_interior: 1.0,
            grain: 1,
            max_depth: Some(64),
            axes: Axes::Turn,
            areas: Areas::Proportional,
            accounting: Accounting::Global,
            jobs: 1,
            geometry_jobs: 1,
            ..BuildOptions::default()
        }
    }
}

/// Size, depth and cost of a tree (spec tree-and-schedule §1.16).
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Statistics {
    /// Primitives that can be hit; excludes those with a coordinate that is NaN or infinite.
    pub primitives: usize,
    /// References to primitives in all leaves.
    pub references: usize,
    /// Interior nodes.
    pub interior: usize,
    /// Leaves that are not empty.
    pub leaves: usize,
    /// Depth of the deepest leaf; the root's depth is 0.
    pub max_depth: u32,
    /// Primitives in the fullest leaf.
    pub max_leaf: usize,
    /// Primitives in the emptiest leaf.
    pub min_leaf: usize,
    /// Surface area of the root's box, m².
    pub root_area: f64,
    /// Expected cost of a ray, C_T of spec tree-and-schedule §1.9, with proportional areas.
    pub cost: f64,
    /// The cost as accounted by [`Accounting::Global`], for which the empty side of a split costs as much as
    /// a leaf.
    pub booked_cost: Option<f64>,
}
