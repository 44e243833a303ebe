//! Rays that leave one point together, and what they hit.

use crate::geom::DVec3;
use glam::DMat3;
use std::ops::Range;

/// The rays of one pulse: one origin, unit directions as structure of arrays.
#[derive(Clone, Debug, Default)]
pub struct RayBundle {
    /// Common origin, m, frame of the geometry.
    pub origin: DVec3,
    /// x of each direction.
    pub x: Vec<f64>,
    /// y of each direction.
    pub y: Vec<f64>,
    /// z of each direction.
    pub z: Vec<f64>,
}

impl RayBundle {
    /// Number of rays.
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// Whether there is no ray.
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }

    /// Direction of ray `i`.
    pub fn direction(&self, i: usize) -> DVec3 {
        DVec3::new(self.x[i], self.y[i], self.z[i])
    }
}

/// How far pulses of a packet may be apart: each component of the direction, and the origin in metres. A packet is as wide
/// as all of them together, and meets as many triangles.
const NEAR: (f64, f64) = (0.02, 1.0);

/// The rays of many pulses, emitted one after the other, each with its own origin and the same number of rays.
///
/// The kernel traces neighbouring pulses together; their order decides nothing but the speed, which is best when the
/// footprints of consecutive pulses touch. Directions are stored in rows of [`RayGroup::stride`] numbers per pulse.
#[derive(Clone, Debug, Default)]
pub struct RayGroup {
    rays: usize,
    origins: Vec<DVec3>,
    x: Vec<f64>,
    y: Vec<f64>,
    z: Vec<f64>,
    /// Origins of the rays of packets, by axis, in rows like the directions; empty where the rays of a pulse have its own.
    from: [Vec<f64>; 3],
}

impl RayGroup {
    /// Lanes of a row are a multiple of this.
    pub const LANES: usize = 8;

    /// No pulses yet, of `rays` rays each.
    pub fn new(rays: usize) -> RayGroup {
        RayGroup { rays, ..RayGroup::default() }
    }

    /// Forgets all pulses and sets the number of rays of those to come; memory is kept.
    pub fn clear(&mut self, rays: usize) {
        self.rays = rays;
        self.origins.clear();
        self.from.iter_mut().for_each(Vec::clear);
        for d in [&mut self.x, &mut self.y, &mut self.z] {
            d.clear();
        }
    }

    /// Appends a pulse from `origin`. `fill` gets the x, y and z of its directions, [`RayGroup::rays`] numbers each, to
    /// write all of them.
    pub fn push(&mut self, origin: DVec3, fill: impl FnOnce(&mut [f64], &mut [f64], &mut [f64])) {
        let (start, rays) = (self.x.len(), self.rays);
        let end = start + self.stride();
        self.origins.push(origin);
        for d in [&mut self.x, &mut self.y, &mut self.z] {
            d.resize(end, 0.0);
        }
        let row = start..start + rays;
        fill(&mut self.x[row.clone()], &mut self.y[row.clone()], &mut self.z[row.clone()]);
        // Lanes beyond the last ray repeat it, so that a row is as wide as its rays.
        for d in [&mut self.x, &mut self.y, &mut self.z] {
            if let Some(&last) = d[row.clone()].last() {
                d[row.end..].fill(last);
            }
        }
    }

    /// Appends a pulse from `origin` and returns x, y and z of its directions by whole registers, for the caller to write
    /// all of them; lanes beyond the last ray shall repeat it.
    #[inline(always)]
    pub fn add(&mut self, origin: DVec3) -> [&mut [[f64; RayGroup::LANES]]; 3] {
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

    /// Replaces the pulses by the `pulses` of another group as they are in another frame: `origin` moves their origins,
    /// `turn` their directions.
    #[inline(always)]
    pub(super) fn turn_from(
        &mut self,
        other: &RayGroup,
        pulses: Range<usize>,
        turn: DMat3,
        mut origin: impl FnMut(DVec3) -> DVec3,
    ) {
        self.rays = other.rays;
        let rows = pulses.start * other.stride()..pulses.end * other.stride();
        self.origins.clear();
        self.origins.extend(other.origins[pulses].iter().map(|o| origin(*o)));
        let [x, y, z] = [&other.x[rows.clone()], &other.y[rows.clone()], &other.z[rows]];
        let [a, b, c] = [turn.x_axis.to_array(), turn.y_axis.to_array(), turn.z_axis.to_array()];
        for (axis, to) in [&mut self.x, &mut self.y, &mut self.z].into_iter().enumerate() {
            to.resize(x.len(), 0.0);
            let (a, b, c) = (a[axis], b[axis], c[axis]);
            for (((to, x), y), z) in to.iter_mut().zip(x).zip(y).zip(z) {
                *to = a * x + b * y + c * z;
            }
        }
    }

    /// Most rays of pulses that are worth packing.
    pub(super) const FEW: usize = RayGroup::PACKET / 4;

    /// Rays of a packet.
    pub(super) const PACKET: usize = 16;

    /// Replaces the pulses by packets: what takes the place of a pulse are the rays of several, of at most
    /// [`RayGroup::FEW`] rays each, which leave from about one place in about one direction. `places` tells of each ray
    /// where its hit belongs in the hits of `of`; `u32::MAX` of those that fill up a row.
    pub(super) fn pack(&mut self, of: &RayGroup, places: &mut Vec<u32>) {
        self.clear(RayGroup::PACKET);
        places.clear();
        let mut first = 0;
        while first < of.len() {
            let last = (first + RayGroup::PACKET / of.rays).min(of.len());
            let count = 1 + (first + 1..last).take_while(|p| of.are_near(first, *p)).count();
            let mut row = [[0.0; RayGroup::PACKET]; 6];
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
            places.resize(places.len() + RayGroup::PACKET - filled, u32::MAX);
            self.origins.push(of.origins[first]);
            let [fx, fy, fz] = &mut self.from;
            for (to, row) in [&mut self.x, &mut self.y, &mut self.z, fx, fy, fz].into_iter().zip(&row) {
                to.extend_from_slice(row);
            }
            first += count;
        }
    }

    /// Whether two pulses may share a packet: never with one whose first ray is no number.
    fn are_near(&self, a: usize, b: usize) -> bool {
        let apart = (self.direction(a, 0) - self.direction(b, 0)).abs();
        let away = (self.origins[a] - self.origins[b]).abs();
        apart.cmple(DVec3::splat(NEAR.0)).all() && away.cmple(DVec3::splat(NEAR.1)).all()
    }

    /// Whether [`RayGroup::pack`] made this.
    pub(super) fn is_packed(&self) -> bool {
        !self.from[0].is_empty()
    }

    /// Origin of one ray, m.
    pub(super) fn origin_of(&self, pulse: usize, ray: usize) -> DVec3 {
        if !self.is_packed() {
            return self.origins[pulse];
        }
        let at = pulse * self.stride() + ray;
        DVec3::from(self.from.each_ref().map(|axis| axis[at]))
    }

    /// Origins of all rays along one axis, by whole registers; nothing but of packets.
    pub(super) fn origin_lanes(&self, axis: usize) -> &[[f64; RayGroup::LANES]] {
        self.from[axis].as_chunks().0
    }

    /// Number of pulses.
    pub fn len(&self) -> usize {
        self.origins.len()
    }

    /// Whether there is no pulse.
    pub fn is_empty(&self) -> bool {
        self.origins.is_empty()
    }

    /// Rays of each pulse.
    pub fn rays(&self) -> usize {
        self.rays
    }

    /// Places from one pulse's first ray to the next one's, here and in the [`Hits`] of the group.
    pub fn stride(&self) -> usize {
        self.rays.next_multiple_of(RayGroup::LANES)
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

    /// Directions of a pulse: x, y and z of each, filled up to whole registers.
    pub fn blocks(&self, pulse: usize) -> [&[[f64; RayGroup::LANES]]; 3] {
        let row = pulse * self.stride()..(pulse + 1) * self.stride();
        [&self.x, &self.y, &self.z].map(|d| d[row.clone()].as_chunks().0)
    }

    /// All directions along one axis, by whole registers.
    pub(super) fn lanes(&self, axis: usize) -> &[[f64; RayGroup::LANES]] {
        [&self.x, &self.y, &self.z][axis].as_chunks().0
    }
}

/// First hits of a bundle, by ray, or of a group, by pulse and ray. A miss has `t = ∞` and primitive [`Hits::MISS`].
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
}

impl Hits {
    /// Takes over those of `others` that are nearer than what the rays from place `first` on have hit, or as near and first
    /// in the `order` of these hits' numbers; `number` turns the others' numbers into those.
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

    /// All of them, by whole registers.
    pub(super) fn registers(&mut self) -> (&mut [[f64; RayGroup::LANES]], &mut [[u32; RayGroup::LANES]]) {
        (self.t.as_chunks_mut().0, self.primitive.as_chunks_mut().0)
    }

    /// Makes room for `rays` hits; what stands there means nothing yet.
    pub(super) fn make_room(&mut self, rays: usize) {
        self.t.resize(rays, f64::INFINITY);
        self.primitive.resize(rays, Hits::MISS);
    }

    /// Takes over the hits of packets: `places` are those of [`RayGroup::pack`].
    pub(super) fn unpack(&mut self, packed: &Hits, places: &[u32]) {
        for ((t, id), place) in packed.t.iter().zip(&packed.primitive).zip(places) {
            let place = *place as usize;
            if let (Some(own_t), Some(own)) = (self.t.get_mut(place), self.primitive.get_mut(place)) {
                (*own_t, *own) = (*t, *id);
            }
        }
    }

    /// Makes some of them misses.
    #[inline(always)]
    pub(super) fn clear(&mut self, rays: Range<usize>) {
        self.t[rays.clone()].fill(f64::INFINITY);
        self.primitive[rays].fill(Hits::MISS);
    }
}
