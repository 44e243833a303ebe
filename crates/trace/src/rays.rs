//! Rays by pulse, and their hits.

use std::ops::Range;
use vlscan_geom::DVec3;

/// Maximum difference between the first ray of a pulse and that of the first pulse that it is merged with: in
/// each component of the direction, and of the origin in metres. A merged pulse is as wide as all of them
/// together, and hits as many triangles.
const MAX_MERGE_DISTANCE: (f64, f64) = (0.02, 1.0);

/// The rays of consecutive pulses, each pulse with its own origin and all with the same number of rays.
///
/// Neighbouring pulses are traced together. Their order affects only the speed, which is best when the
/// footprints of consecutive pulses touch. Directions are stored in rows of [`RayGroup::stride`] numbers per
/// pulse.
#[derive(Clone, Debug, Default)]
pub struct RayGroup {
    rays: usize,
    origins: Vec<DVec3>,
    x: Vec<f64>,
    y: Vec<f64>,
    z: Vec<f64>,
    /// Origins of the rays of merged pulses, by axis, in rows like the directions; empty where all rays of a
    /// pulse share its origin.
    ray_origins: [Vec<f64>; 3],
}

impl RayGroup {
    /// Rays per register; the length of a row is a multiple of it.
    pub const WIDTH: usize = 8;

    /// Creates a group without pulses, for pulses of `rays` rays each.
    pub fn new(rays: usize) -> RayGroup {
        RayGroup { rays, ..RayGroup::default() }
    }

    /// Removes all pulses and sets the number of rays of further pulses; memory is kept.
    pub fn clear(&mut self, rays: usize) {
        self.rays = rays;
        self.origins.clear();
        [&mut self.x, &mut self.y, &mut self.z].into_iter().chain(&mut self.ray_origins).for_each(Vec::clear);
    }

    /// Appends a pulse from `origin`. `fill` must write x, y and z of its directions, [`RayGroup::rays`]
    /// numbers each.
    pub fn push(&mut self, origin: DVec3, fill: impl FnOnce(&mut [f64], &mut [f64], &mut [f64])) {
        let (start, rays) = (self.x.len(), self.rays);
        let end = start + self.stride();
        self.origins.push(origin);
        for d in [&mut self.x, &mut self.y, &mut self.z] {
            d.resize(end, 0.0);
        }
        let row = start..start + rays;
        fill(&mut self.x[row.clone()], &mut self.y[row.clone()], &mut self.z[row.clone()]);
        // Lanes beyond the last ray repeat it, which keeps the extent of a row that of its rays.
        for d in [&mut self.x, &mut self.y, &mut self.z] {
            if let Some(&last) = d[row.clone()].last() {
                d[row.end..].fill(last);
            }
        }
    }

    /// Appends a pulse from `origin` and returns x, y and z of its directions in complete registers. The
    /// caller must write all of them; lanes beyond the last ray must repeat it.
    #[inline(always)]
    pub fn push_registers(&mut self, origin: DVec3) -> [&mut [[f64; RayGroup::WIDTH]]; 3] {
        let start = self.x.len();
        let end = start + self.stride();
        self.origins.push(origin);
        let [x, y, z] = [&mut self.x, &mut self.y, &mut self.z];
        x.resize(end, 0.0);
        y.resize(end, 0.0);
        z.resize(end, 0.0);
        [x[start..].as_chunks_mut().0, y[start..].as_chunks_mut().0, z[start..].as_chunks_mut().0]
    }

    /// Replaces the pulses by the `pulses` of another group.
    pub fn copy_from(&mut self, other: &RayGroup, pulses: Range<usize>) {
        self.clear(other.rays);
        let rows = pulses.start * other.stride()..pulses.end * other.stride();
        self.origins.extend_from_slice(&other.origins[pulses]);
        self.x.extend_from_slice(&other.x[rows.clone()]);
        self.y.extend_from_slice(&other.y[rows.clone()]);
        self.z.extend_from_slice(&other.z[rows]);
    }

    /// Maximum rays of a pulse that is worth merging.
    pub(super) const MAX_MERGEABLE_RAYS: usize = RayGroup::MERGED_RAYS / 4;

    pub(super) const MERGED_RAYS: usize = 16;

    /// Replaces the pulses by those of another group, merged: the rays of several pulses, of at most
    /// [`RayGroup::MAX_MERGEABLE_RAYS`] rays each, with nearly the same origin and direction become one
    /// pulse. Writes to `places` the index of each ray's hit in the hits of `of`; `u32::MAX` for padding.
    pub(super) fn merge_pulses(&mut self, of: &RayGroup, places: &mut Vec<u32>) {
        self.clear(RayGroup::MERGED_RAYS);
        places.clear();
        let mut first = 0;
        while first < of.len() {
            let last = (first + RayGroup::MERGED_RAYS / of.rays).min(of.len());
            let count = 1 + (first + 1..last).take_while(|p| of.are_near(first, *p)).count();
            let mut row = [[0.0; RayGroup::MERGED_RAYS]; 6];
            let mut filled = 0;
            for pulse in first..first + count {
                let start = pulse * of.stride();
                for at in start..start + of.rays {
                    let o = of.origins[pulse];
                    let ray = [of.x[at], of.y[at], of.z[at], o.x, o.y, o.z];
                    row.iter_mut().zip(ray).for_each(|(row, x)| row[filled] = x);
                    places.push(at as u32);
                    filled += 1;
                }
            }
            for row in &mut row {
                let last = row[filled - 1];
                row[filled..].fill(last);
            }
            places.resize(places.len() + RayGroup::MERGED_RAYS - filled, u32::MAX);
            self.origins.push(of.origins[first]);
            let [fx, fy, fz] = &mut self.ray_origins;
            for (to, row) in [&mut self.x, &mut self.y, &mut self.z, fx, fy, fz].into_iter().zip(&row) {
                to.extend_from_slice(row);
            }
            first += count;
        }
    }

    /// True if two pulses may be merged; false if the first ray of either is NaN.
    fn are_near(&self, a: usize, b: usize) -> bool {
        let turn = (self.direction(a, 0) - self.direction(b, 0)).abs();
        let away = (self.origins[a] - self.origins[b]).abs();
        turn.cmple(DVec3::splat(MAX_MERGE_DISTANCE.0)).all()
            && away.cmple(DVec3::splat(MAX_MERGE_DISTANCE.1)).all()
    }

    /// True if the pulses are those of [`RayGroup::merge_pulses`].
    pub(super) fn is_merged(&self) -> bool {
        !self.ray_origins[0].is_empty()
    }

    #[inline(always)]
    pub(super) fn origin_of(&self, pulse: usize, ray: usize) -> DVec3 {
        if !self.is_merged() {
            return self.origins[pulse];
        }
        let at = pulse * self.stride() + ray;
        DVec3::from(self.ray_origins.each_ref().map(|axis| axis[at]))
    }

    /// Origins of all rays along one axis, in complete registers; empty unless pulses are merged.
    pub(super) fn origin_lanes(&self, axis: usize) -> &[[f64; RayGroup::WIDTH]] {
        self.ray_origins[axis].as_chunks().0
    }

    /// Number of pulses.
    pub fn len(&self) -> usize {
        self.origins.len()
    }

    /// True if there are no pulses.
    pub fn is_empty(&self) -> bool {
        self.origins.is_empty()
    }

    /// Number of rays of each pulse.
    pub fn rays(&self) -> usize {
        self.rays
    }

    /// Distance from one pulse's first ray to the next one's, in this group and in its [`Hits`].
    pub fn stride(&self) -> usize {
        self.rays.next_multiple_of(RayGroup::WIDTH)
    }

    /// Origin of a pulse, m, frame of the geometry.
    pub fn origin(&self, pulse: usize) -> DVec3 {
        self.origins[pulse]
    }

    /// Direction of ray `ray` of a pulse.
    pub fn direction(&self, pulse: usize, ray: usize) -> DVec3 {
        let at = pulse * self.stride() + ray;
        DVec3::new(self.x[at], self.y[at], self.z[at])
    }

    /// Directions of a pulse: x, y and z of each.
    pub fn directions(&self, pulse: usize) -> [&[f64]; 3] {
        let row = pulse * self.stride()..pulse * self.stride() + self.rays;
        [&self.x, &self.y, &self.z].map(|d| &d[row.clone()])
    }

    /// Directions of a pulse in complete registers: x, y and z of each.
    pub fn registers(&self, pulse: usize) -> [&[[f64; RayGroup::WIDTH]]; 3] {
        let row = pulse * self.stride()..(pulse + 1) * self.stride();
        [&self.x, &self.y, &self.z].map(|d| d[row.clone()].as_chunks().0)
    }

    /// All directions along one axis, in complete registers.
    pub(super) fn lanes(&self, axis: usize) -> &[[f64; RayGroup::WIDTH]] {
        [&self.x, &self.y, &self.z][axis].as_chunks().0
    }
}

/// First hits of a group, by pulse and ray. A miss has `t = ∞` and primitive [`Hits::MISS`].
#[derive(Clone, Debug, Default)]
pub struct Hits {
    /// Distance along each ray, m.
    pub t: Vec<f64>,
    /// Number of the primitive hit.
    pub primitive: Vec<u32>,
}

impl Hits {
    /// The primitive number of a miss.
    pub const MISS: u32 = u32::MAX;

    /// Replaces hits of the rays from number `first` on by those of `others` that are nearer, or equally near
    /// and first by the `order` of primitives. `number` converts the primitive numbers of `others` to those
    /// of these hits.
    pub fn take_nearer(
        &mut self,
        first: usize,
        others: &Hits,
        number: impl Fn(u32) -> u32,
        order: impl Fn(u32) -> u32,
    ) {
        let own = self.t[first..].iter_mut().zip(&mut self.primitive[first..]);
        for ((t, id), (other_t, other)) in own.zip(others.t.iter().zip(&others.primitive)) {
            if *other == Hits::MISS || *other_t > *t {
                continue;
            }
            let other = number(*other);
            if *other_t < *t || order(other) < order(*id) {
                (*t, *id) = (*other_t, other);
            }
        }
    }

    /// All hits, in complete registers.
    pub(super) fn registers(&mut self) -> (&mut [[f64; RayGroup::WIDTH]], &mut [[u32; RayGroup::WIDTH]]) {
        (self.t.as_chunks_mut().0, self.primitive.as_chunks_mut().0)
    }

    /// Resizes to `rays` hits of unspecified content.
    pub(super) fn resize(&mut self, rays: usize) {
        self.t.resize(rays, f64::INFINITY);
        self.primitive.resize(rays, Hits::MISS);
    }

    /// Copies the hits of merged pulses; `places` are those of [`RayGroup::merge_pulses`].
    pub(super) fn take_merged(&mut self, merged: &Hits, places: &[u32]) {
        for ((t, id), place) in merged.t.iter().zip(&merged.primitive).zip(places) {
            let place = *place as usize;
            if let (Some(own_t), Some(own)) = (self.t.get_mut(place), self.primitive.get_mut(place)) {
                (*own_t, *own) = (*t, *id);
            }
        }
    }

    #[inline(always)]
    pub(super) fn clear(&mut self, rays: Range<usize>) {
        self.t[rays.clone()].fill(f64::INFINITY);
        self.primitive[rays].fill(Hits::MISS);
    }
}
