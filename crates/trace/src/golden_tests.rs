//! The published test mesh and rays (spec tree-and-schedule §1.16): costs, sizes and hits of every builder.

use super::options::{Accounting, Axes, Statistics};
use super::*;
use vlscan_geom::{DVec3, unit};

fn mesh(relief: f64) -> Geometry {
    let mut g = Geometry::default();
    for i in 0..33 {
        for j in 0..33 {
            let h = f64::from((7 * i + 13 * j) % 17) / 4.0 * relief;
            g.vertices.push(DVec3::new(f64::from(i) - 16.0, f64::from(j) - 16.0, h - 2.0 * relief));
        }
    }
    for i in 0..32 {
        for j in 0..32 {
            let a = i * 33 + j;
            let (b, c, d) = (a + 33, a + 1, a + 34);
            g.triangles.extend([[a, b, d], [a, d, c]]);
        }
    }
    g
}

/// Number of hits and the sum of their distances.
fn hits_of_test_rays(tree: &Tree, g: &Geometry) -> (usize, f64) {
    let mut found = (0, 0.0);
    for i in 0..20 {
        for j in 0..20 {
            for d in [DVec3::new(0.2, 0.1, -1.0), DVec3::new(1.0, 0.3, -0.2)].map(unit) {
                let target = DVec3::new(-15.2 + 1.6 * f64::from(i), -15.2 + 1.6 * f64::from(j), 0.0);
                if let Some(hit) = tree.nearest_where(g, target - 60.0 * d, d, |_| true) {
                    found = (found.0 + 1, found.1 + hit.t);
                }
            }
        }
    }
    found
}

/// Interior nodes, leaves, deepest level, fullest and emptiest leaf, cost.
type Row = (Builder, usize, [usize; 5], f64);

fn sizes(s: &Statistics) -> [usize; 5] {
    [s.interior, s.leaves, s.max_depth as usize, s.max_leaf, s.min_leaf]
}

const ROWS: [Row; 7] = [
    (Builder::Median, 21, [101, 102, 8, 151, 30], 115.8527),
    (Builder::Sah, 21, [7048, 6985, 26, 33, 1], 22.0565),
    (Builder::Sah, 32, [7145, 7084, 23, 33, 1], 22.0066),
    (Builder::AxisSah, 21, [33912, 33913, 49, 8, 4], 16.4398),
    (Builder::AxisSah, 32, [33912, 33913, 49, 8, 4], 16.4398),
    (Builder::Fsah, 21, [9828, 9752, 29, 21, 1], 21.2931),
    (Builder::Fsah, 32, [9909, 9825, 26, 23, 1], 21.1668),
];

fn assert_published_hits(tree: &Tree, g: &Geometry) {
    let (hits, sum) = hits_of_test_rays(tree, g);
    assert_eq!(hits, 800);
    assert!((sum - 46184.689151527).abs() < 1e-8, "{sum}");
}

/// Equality node by node requires the published order of the running sums, too.
#[test]
fn strict_builders_reproduce_the_published_trees() {
    let g = mesh(1.0);
    for (builder, n, published, cost) in ROWS {
        let tree = Tree::build(&g, &BuildOptions { candidates: n, bins: n, ..BuildOptions::strict(builder) });
        assert_published_hits(&tree, &g);
        let s = tree.statistics();
        assert!((s.root_area - 2560.0).abs() < 1e-9);
        assert_eq!(sizes(s), published, "{builder:?} {n}");
        assert!((s.cost - cost).abs() < 1e-4, "{builder:?} {n}: cost {}", s.cost);
    }
}

#[test]
fn a_depth_cap_costs_nothing() {
    let g = mesh(1.0);
    let capped = |builder, accounting| {
        let options = BuildOptions { accounting, max_depth: Some(22), ..BuildOptions::strict(builder) };
        let tree = Tree::build(&g, &options);
        assert_published_hits(&tree, &g);
        *tree.statistics()
    };
    let s = capped(Builder::AxisSah, Accounting::Local);
    assert_eq!(sizes(&s), [12554, 12555, 22, 8, 4]);
    assert!((s.cost - 16.4400).abs() < 1e-4);
    let s = capped(Builder::Fsah, Accounting::Global);
    assert_eq!(sizes(&s), [9735, 9651, 22, 23, 1]);
    assert!((s.cost - 21.1668).abs() < 1e-4);
}

/// Local accounting of a split still works where the running sums run out of digits, and reproduces the tree
/// published for it.
#[test]
fn local_accounting_gives_its_published_tree() {
    let g = mesh(1.0);
    let options = BuildOptions { accounting: Accounting::Local, ..BuildOptions::strict(Builder::Sah) };
    let s = *Tree::build(&g, &options).statistics();
    assert_eq!(s.interior, 6871);
    assert!((s.cost - 22.108).abs() < 1e-3, "{}", s.cost);
}

/// Axes in turn make a leaf of hundreds of primitives where the axis of the turn is flat; trying the next one
/// avoids this.
#[test]
fn flat_meshes_are_split_along_their_extent() {
    let g = mesh(0.0);
    for builder in [Builder::Sah, Builder::Fsah] {
        let strict = *Tree::build(&g, &BuildOptions::strict(builder)).statistics();
        assert_eq!((strict.interior, strict.leaves, strict.max_leaf, strict.max_depth), (3, 4, 578, 2));
        assert!((strict.cost - 547.5).abs() < 0.1, "{}", strict.cost);
        let options = BuildOptions {
            axes: Axes::TurnThenNext,
            accounting: Accounting::Local,
            max_depth: None,
            ..BuildOptions::strict(builder)
        };
        let s = *Tree::build(&g, &options).statistics();
        assert!(s.cost < 30.0 && s.max_leaf < 40, "{builder:?}: {s:?}");
    }
}

#[test]
fn every_builder_gives_the_published_hits_with_its_own_defaults() {
    let g = mesh(1.0);
    for builder in [Builder::Median, Builder::Sah, Builder::AxisSah, Builder::Fsah, Builder::Bvh] {
        assert_published_hits(&Tree::build(&g, &BuildOptions::of(builder)), &g);
    }
}

/// The paper's Algorithm 1 on several threads, and local accounting. They differ only where a split gains
/// nothing at all, which no split does at this cost, or less than the precision of the running sums, which
/// happens deeper down.
#[test]
fn global_and_local_accounting_agree() {
    let g = mesh(1.0);
    for builder in [Builder::Sah, Builder::AxisSah, Builder::Fsah] {
        let build = |accounting, jobs| {
            let options = BuildOptions {
                accounting,
                jobs,
                geometry_jobs: jobs,
                max_depth: Some(14),
                cost_interior: 1.0137,
                ..BuildOptions::strict(builder)
            };
            *Tree::build(&g, &options).statistics()
        };
        let local = build(Accounting::Local, 1);
        for jobs in [1, 2, 8] {
            let global = build(Accounting::Global, jobs);
            assert_eq!(Statistics { booked_cost: None, ..global }, local, "{builder:?}, {jobs} threads");
            let booked = global.booked_cost.unwrap();
            let empty = local.interior + 1 - local.leaves;
            if empty == 0 {
                assert!((booked - local.cost).abs() < 1e-9, "{builder:?} {jobs}: {global:?}");
            } else {
                assert!(booked > local.cost && booked < local.cost + 1.0, "{builder:?} {jobs}: {global:?}");
            }
            assert_eq!(build(Accounting::Local, jobs), local);
        }
    }
}
