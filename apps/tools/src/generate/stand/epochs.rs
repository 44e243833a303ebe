//! Development of a stand from epoch to epoch.

use super::inventory::Tree;
use crate::args;
use vlscan_base::rng::{Purpose, Stream};

/// Changes from one epoch to the next.
#[derive(Clone, Copy, Debug, Default, PartialEq, clap::Args)]
pub struct Development {
    /// Growth of the trees from epoch to epoch, percent.
    #[arg(
        long,
        value_name = "PERCENT",
        default_value = "0",
        value_parser = args::growth,
        allow_negative_numbers = true,
    )]
    pub growth: f64,
    /// Trees felled from epoch to epoch, percent, spread evenly over the stand.
    #[arg(long, value_name = "PERCENT", default_value = "0", value_parser = args::share)]
    pub thinning: f64,
    /// Trees thrown by a storm from epoch to epoch, percent, in one gap.
    #[arg(long, value_name = "PERCENT", default_value = "0", value_parser = args::share)]
    pub storm: f64,
}

/// The trees of the next epoch, with their numbers in the inventory. Draws are by seed, epoch and number, so
/// that a tree that is felled in one variant is felled in the others, too.
pub(super) fn next_epoch(
    trees: &[(usize, Tree)],
    development: &Development,
    epoch: u32,
    seed: u64,
) -> Vec<(usize, Tree)> {
    let stream = Stream::new(seed, Purpose::SceneMaking);
    let draw = |number: usize, counter: u32| stream.uniform(epoch, number as u64, counter);
    let thrown = storm_gap(trees, development.storm / 100.0, |counter| draw(u32::MAX as usize, counter));
    trees
        .iter()
        .enumerate()
        .filter(|(i, (number, _))| !thrown[*i] && draw(*number, 2) >= development.thinning / 100.0)
        .map(|(_, (number, tree))| {
            let factor = 1.0 + development.growth / 100.0;
            let grown = Tree {
                height: tree.height * factor,
                crown: tree.crown.map(|crown| crown * factor),
                stem: tree.stem.map(|stem| stem * factor),
                ..tree.clone()
            };
            (*number, grown)
        })
        .collect()
}

/// Trees nearest to a tree that is drawn, as many as the fraction says.
fn storm_gap(trees: &[(usize, Tree)], fraction: f64, draw: impl Fn(u32) -> f64) -> Vec<bool> {
    let mut thrown = vec![false; trees.len()];
    let count = (fraction * trees.len() as f64).round() as usize;
    if count == 0 {
        return thrown;
    }
    let centre = ((draw(3) * trees.len() as f64) as usize).min(trees.len() - 1);
    let [x, y, _] = trees[centre].1.position;
    let distance = |i: usize| libm::hypot(trees[i].1.position[0] - x, trees[i].1.position[1] - y);
    let mut order: Vec<usize> = (0..trees.len()).collect();
    order.sort_by(|&a, &b| distance(a).total_cmp(&distance(b)).then(a.cmp(&b)));
    order.into_iter().take(count).for_each(|i| thrown[i] = true);
    thrown
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(side: usize) -> Vec<(usize, Tree)> {
        let tree = |i: usize| Tree {
            id: i.to_string(),
            position: [(i % side) as f64, (i / side) as f64, 0.0],
            height: 10.0,
            crown: Some(4.0),
            stem: None,
            species: None,
        };
        (0..side * side).map(|i| (i, tree(i))).collect()
    }

    #[test]
    fn growth_thinning_and_storm() {
        let trees = square(40);
        let grown = next_epoch(&trees, &Development { growth: 10.0, ..Development::default() }, 1, 3);
        assert_eq!((grown.len(), grown[0].1.height, grown[0].1.crown), (1600, 11.0, Some(4.4)));
        let thinned = next_epoch(&trees, &Development { thinning: 25.0, ..Development::default() }, 1, 3);
        assert!((thinned.len() as f64 / 1200.0 - 1.0).abs() < 0.05, "{}", thinned.len());
        let storm = next_epoch(&trees, &Development { storm: 10.0, ..Development::default() }, 1, 3);
        assert_eq!(storm.len(), 1440);
        // The gap is in one place: a disc of 160 trees has a radius of 7, a corner's quarter of one 14.
        let gone: Vec<_> = trees.iter().filter(|(n, _)| !storm.iter().any(|(m, _)| m == n)).collect();
        let extent = |i: usize| {
            let values = gone.iter().map(|(_, t)| t.position[i]);
            values.clone().fold(f64::MIN, f64::max) - values.fold(f64::MAX, f64::min)
        };
        assert!(extent(0) < 30.0 && extent(1) < 30.0);
        assert_ne!(
            thinned.len(),
            next_epoch(&trees, &Development { thinning: 25.0, ..Development::default() }, 2, 3).len()
        );
    }
}
