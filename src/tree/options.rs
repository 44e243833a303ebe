//! What a tree is built with, and what came out.

/// How a tree chooses its splits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Builder {
    /// Kd-tree by the object median, axes in turn (spec §1.8, "simple").
    Median,
    /// Kd-tree by the surface area heuristic between the medians, axes in turn (spec §1.10).
    Sah,
    /// As [`Builder::Sah`] on the best of the three axes.
    AxisSah,
    /// Kd-tree by the surface area heuristic over min/max histograms, axes in turn (spec §1.11).
    #[default]
    Fsah,
}

/// How a split's gain is judged (spec §1.12).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Accounting {
    /// By the node alone; independent of the order of the build.
    Local,
    /// By the running cost of the whole tree. Differs from [`Accounting::Local`] in rounding only, but there it decides
    /// when a build without depth cap ends. Builds on one thread.
    Global,
}

/// Settings of a build.
#[derive(Clone, Debug, PartialEq)]
pub struct BuildOptions {
    /// Which builder.
    pub builder: Builder,
    /// Histogram bins m of [`Builder::Fsah`], 2 to 1024.
    pub bins: usize,
    /// Candidates n of [`Builder::Sah`] and [`Builder::AxisSah`], at least 2.
    pub candidates: usize,
    /// Smallest number of primitives that may be split, τ_p.
    pub min_primitives: usize,
    /// Cost of visiting an interior node, C_i.
    pub cost_interior: f64,
    /// Cost of visiting a leaf, C_l.
    pub cost_leaf: f64,
    /// Cost of testing a primitive, C_o.
    pub cost_primitive: f64,
    /// Primitives are tested by so many at once: a leaf's count is rounded up to a multiple of it when judging a split.
    pub grain: usize,
    /// Largest depth of a leaf; `None` is ⌊8 + 1.3·log2 N⌋.
    pub max_depth: Option<u32>,
    /// Whether the other axes are tried when the axis of the turn has no split worth making.
    pub next_axis: bool,
    /// How a split's gain is judged.
    pub accounting: Accounting,
    /// Threads for the build; 0 is as many as the machine has.
    pub jobs: usize,
    /// Smallest number of primitives that is handed to another thread.
    pub delegate: usize,
}

impl Default for BuildOptions {
    fn default() -> BuildOptions {
        BuildOptions {
            builder: Builder::default(),
            bins: 32,
            candidates: 21,
            min_primitives: 17,
            cost_interior: 4.0,
            cost_leaf: 1.0,
            cost_primitive: 1.0,
            grain: 16,
            max_depth: None,
            next_axis: true,
            accounting: Accounting::Local,
            jobs: 0,
            delegate: 32,
        }
    }
}

impl BuildOptions {
    /// The default settings of another builder.
    pub fn of(builder: Builder) -> BuildOptions {
        BuildOptions { builder, ..BuildOptions::default() }
    }

    /// The reference's costs and rules (spec §1.2): unit costs, τ_p = 5, axes in turn without a second try, the running
    /// cost of the whole tree as the judge and no depth cap beyond the 64 levels that it never reaches.
    pub fn strict(builder: Builder) -> BuildOptions {
        BuildOptions {
            builder,
            min_primitives: 5,
            cost_interior: 1.0,
            grain: 1,
            max_depth: Some(64),
            next_axis: false,
            accounting: Accounting::Global,
            jobs: 1,
            ..BuildOptions::default()
        }
    }
}

/// What a build yielded (spec §1.16).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Statistics {
    /// Primitives that can be hit; those with a coordinate that is no number cannot.
    pub primitives: usize,
    /// References to primitives in all leaves.
    pub references: usize,
    /// Interior nodes.
    pub interior: usize,
    /// Leaves that hold something.
    pub leaves: usize,
    /// Depth of the deepest leaf; the root's is 0.
    pub max_depth: u32,
    /// Primitives in the fullest leaf.
    pub max_leaf: usize,
    /// Primitives in the emptiest leaf.
    pub min_leaf: usize,
    /// Surface area of the root's box, m².
    pub root_area: f64,
    /// Expected cost of a ray, C_T of spec §1.9, with proportional areas.
    pub cost: f64,
}
