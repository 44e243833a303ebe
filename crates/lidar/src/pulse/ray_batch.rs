//! Rays of several pulses of one device, traced together.

use std::ops::Range;
use vlscan_geom::DVec3;
use vlscan_trace::{Geometry, Hits, RayGroup, TraceScratch, Tree};

/// Pulses of one device, their rays and the hits of the rays.
#[derive(Clone, Debug, Default)]
pub(super) struct RayBatch {
    pub rays: RayGroup,
    pub hits: Hits,
    /// Point where each ray leaves the instrument, pulse by pulse, m; empty where all rays of a pulse leave
    /// its origin.
    pub exits: Vec<DVec3>,
    /// Rays with exits as groups of one ray each, and their hits.
    single: Box<(RayGroup, Hits)>,
}

impl RayBatch {
    pub fn trace(&mut self, tree: &Tree, geometry: &Geometry, scratch: &mut TraceScratch) {
        if self.exits.is_empty() {
            return tree.trace_group(geometry, &self.rays, &mut self.hits, scratch);
        }
        let (rays, n, stride) = (&self.rays, self.rays.rays(), self.rays.stride());
        let (single, hits) = &mut *self.single;
        single.clear(1);
        for (i, exit) in self.exits.iter().enumerate() {
            let d = rays.direction(i / n, i % n);
            single.push(*exit, |x, y, z| (x[0], y[0], z[0]) = (d.x, d.y, d.z));
        }
        tree.trace_group(geometry, single, hits, scratch);
        miss_all(&mut self.hits, rays);
        for i in 0..self.exits.len() {
            let (to, from) = (i / n * stride + i % n, i * single.stride());
            (self.hits.t[to], self.hits.primitive[to]) = (hits.t[from], hits.primitive[from]);
        }
    }

    /// Sets all hits to misses, like tracing through empty space.
    pub fn trace_nothing(&mut self) {
        miss_all(&mut self.hits, &self.rays);
    }

    /// Replaces the rays by those of some pulses of another batch.
    pub fn copy_rays(&mut self, from: &RayBatch, pulses: Range<usize>) {
        self.rays.copy_from(&from.rays, pulses.clone());
        self.exits.clear();
        if !from.exits.is_empty() {
            let n = from.rays.rays();
            self.exits.extend_from_slice(&from.exits[pulses.start * n..pulses.end * n]);
        }
    }
}

fn miss_all(hits: &mut Hits, rays: &RayGroup) {
    let count = rays.len() * rays.stride();
    hits.t.clear();
    hits.t.resize(count, f64::INFINITY);
    hits.primitive.clear();
    hits.primitive.resize(count, Hits::MISS);
}
