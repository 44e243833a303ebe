//! The measurements and their comparison.

use crate::forecast::Forecast;
use crate::matrix::cores;
use crate::measure::{Built, Cell, ShardCosts};
use crate::nodes::{Cluster, NodesForecast};
use crate::paper;
use serde::Serialize;
use serde_json::{Value, json};

#[derive(Default)]
pub struct Report {
    pub survey: String,
    pub primitives: usize,
    pub legs: usize,
    pub load_s: f64,
    pub scene_bytes: usize,
    pub format: String,
    pub cells: Vec<Cell>,
    pub forecasts: Vec<Forecast>,
    pub clusters: Vec<ClusterForecast>,
}

/// Simulated clusters: what is assumed, what was measured, and what follows.
#[derive(Serialize)]
pub struct ClusterForecast {
    pub tree: &'static str,
    pub cluster: Cluster,
    pub costs: ShardCosts,
    pub nodes: Vec<NodesForecast>,
}

impl Report {
    /// Takes the facts of the survey and its scene.
    pub fn describe(&mut self, built: &Built, format: &str) {
        let (survey, scene) = (built.session.survey(), built.session.scene());
        self.survey = survey.name.clone();
        self.primitives = scene.primitives();
        self.legs = survey.legs.len();
        self.load_s = built.load_s;
        self.scene_bytes = scene.memory();
        self.format = format.to_owned();
    }

    /// Computes speedups: of each cell relative to its tree on one thread with the same chunks, or else the
    /// smallest; global speedups relative to the median tree on one thread, or else the first tree.
    pub fn compare(&mut self) {
        let sequential: Vec<Cell> = self.cells.iter().filter(|c| c.of.threads == 1).cloned().collect();
        let base = |tree: &str, chunk: u32| {
            let of_tree = || sequential.iter().filter(|s| s.of.tree == tree);
            of_tree().find(|s| s.of.chunk_size == chunk).or_else(|| of_tree().min_by_key(|s| s.of.chunk_size))
        };
        let simple =
            sequential.iter().find(|s| s.of.tree == "median").or(sequential.first()).map(|s| s.of.tree);
        for cell in &mut self.cells {
            if let Some(alone) = base(cell.of.tree, cell.of.chunk_size) {
                cell.speedup = alone.simulation_s / cell.simulation_s;
                cell.efficiency = cell.speedup / cell.of.threads as f64;
            }
            if let Some(simple) = simple.and_then(|tree| base(tree, cell.of.chunk_size)) {
                cell.global_speedup = simple.total_s / cell.total_s;
                cell.time_reduction = 1.0 - 1.0 / cell.global_speedup;
            }
        }
    }

    /// The trees in the order in which they were flown.
    pub fn trees(&self) -> Vec<&'static str> {
        let mut trees = Vec::new();
        for cell in &self.cells {
            if !trees.contains(&cell.of.tree) {
                trees.push(cell.of.tree);
            }
        }
        trees
    }

    /// For every number of threads of a tree, ascending, the cell of minimum total time.
    pub fn best_by_threads(&self, tree: &str) -> Vec<&Cell> {
        let mut best: Vec<&Cell> = Vec::new();
        for cell in self.cells.iter().filter(|c| c.of.tree == tree) {
            match best.iter_mut().find(|b| b.of.threads == cell.of.threads) {
                Some(b) if cell.total_s < b.total_s => *b = cell,
                Some(_) => {}
                None => best.push(cell),
            }
        }
        best.sort_by_key(|c| c.of.threads);
        best
    }

    pub fn json(&self, with_paper: bool) -> Value {
        let mut all = json!({
            "program": concat!("vlscan ", env!("CARGO_PKG_VERSION")),
            "machine": { "cores": cores(), "arch": std::env::consts::ARCH, "os": std::env::consts::OS },
            "survey": self.survey,
            "primitives": self.primitives,
            "legs": self.legs,
            "load_s": self.load_s,
            "scene_bytes": self.scene_bytes,
            "format": self.format,
            "cells": self.cells,
            "simulated": self.forecasts,
            "clusters": self.clusters,
        });
        if with_paper {
            all["paper"] = paper::json();
        }
        all
    }
}
