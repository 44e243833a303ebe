//! Tracing of pulses through the tiles of a scene: those that may be hit are loaded, the nearest first, and
//! traced like the scene itself.

use super::ray_batch::RayBatch;
use std::sync::Arc;
use vlscan_base::Result;
use vlscan_geom::{Aabb, DVec3};
use vlscan_scene::{Scene, Tile, TileFacts, TileReader, Tiles};
use vlscan_trace::{Hits, TraceScratch};

/// Margin of comparisons of distances and boxes for rounding, relative to the distances.
const ROUNDING: f64 = 1e-9;

/// The tiles that the rays of a batch may hit, for interactions after the first.
#[derive(Clone, Copy, Debug)]
pub(super) struct NearTiles<'a> {
    pub reader: &'a TileReader,
    /// Indices of the tiles, ascending.
    pub near: &'a [u32],
}

/// A worker's access to the tiles.
pub(super) struct TileTracer {
    reader: TileReader,
    /// Tiles that rays of the batch may hit.
    near: Vec<u32>,
    /// Hits on one of them.
    hits: Hits,
    bundles: Vec<Bundle>,
    /// Box around everything that rays could hit since it was taken last.
    area: Aabb,
    /// Tiles that rays of a device may hit, with the least distance to one of them.
    ahead: Vec<(f64, u32)>,
}

/// The rays of a pulse: all start within `reach` of `origin` and have directions within `spread` of
/// `direction`.
#[derive(Clone, Copy)]
struct Bundle {
    origin: DVec3,
    direction: DVec3,
    reach: f64,
    spread: f64,
}

impl TileTracer {
    pub fn new(tiles: &Arc<Tiles>) -> TileTracer {
        TileTracer {
            reader: TileReader::new(tiles),
            near: Vec::new(),
            hits: Hits::default(),
            bundles: Vec::new(),
            area: Aabb::EMPTY,
            ahead: Vec::new(),
        }
    }

    /// The tiles near the rays of the last batch.
    pub fn near(&self) -> NearTiles<'_> {
        NearTiles { reader: &self.reader, near: &self.near }
    }

    /// Box around everything that rays could hit in the scene since the last call, scene frame, m.
    pub fn take_area(&mut self) -> Aabb {
        std::mem::replace(&mut self.area, Aabb::EMPTY)
    }

    /// True if the tiles that the batch has met need more memory than there is.
    pub fn is_over_budget(&self) -> bool {
        self.reader.is_over_budget()
    }

    /// Begins another batch: tiles of the last one may be dropped.
    ///
    /// # Errors
    /// The errors of [`TileReader::release`].
    pub fn release(&mut self) -> Result<()> {
        self.near.clear();
        self.reader.release()
    }

    /// Merges the hits on tiles into the hits of the batch of a device, which was traced through `scene`
    /// without them. Rays of all its pulses have the same arrangement if there `is_one_pattern`.
    pub fn trace(
        &mut self,
        scene: &Scene,
        batch: &mut RayBatch,
        is_one_pattern: bool,
        scratch: &mut TraceScratch,
    ) {
        self.find_ahead(scene, batch, is_one_pattern);
        let TileTracer { reader, near, hits, bundles, ahead, .. } = self;
        for (_, number) in ahead.iter() {
            let facts = &reader.facts()[*number as usize];
            if !may_be_nearer(facts, bundles, batch) {
                continue;
            }
            let Some(tile) = reader.get(*number as usize) else { continue };
            std::mem::swap(&mut batch.hits, hits);
            batch.trace(&tile.tree, &tile.scene.geometry, scratch);
            std::mem::swap(&mut batch.hits, hits);
            let order = |i| reader.number_when_stored(scene, i);
            batch.hits.take_nearer(0, hits, |i| facts.first + i, order);
        }
        near.extend(ahead.iter().map(|(_, tile)| tile));
        near.sort_unstable();
        near.dedup();
    }

    /// Finds the tiles that rays of a batch may hit, the nearest first.
    fn find_ahead(&mut self, scene: &Scene, batch: &RayBatch, is_one_pattern: bool) {
        let TileTracer { reader, bundles, ahead, area, .. } = self;
        bundles.clear();
        for pulse in 0..batch.rays.len() {
            let known = bundles.first().filter(|_| is_one_pattern).copied();
            bundles.push(Bundle::of(batch, pulse, known));
        }
        let around = bundles.iter().fold(Aabb::EMPTY, |all, b| all.union(b.within(&scene.bounds)));
        *area = area.union(around);
        ahead.clear();
        for (number, facts) in (0..).zip(reader.facts()) {
            let is_apart =
                facts.bounds.min.cmpgt(around.max).any() || around.min.cmpgt(facts.bounds.max).any();
            if is_apart {
                continue;
            }
            let entries = bundles.iter().filter_map(|bundle| Some(bundle.enter(&facts.bounds)?.0));
            if let Some(enter) = entries.reduce(f64::min) {
                ahead.push((enter, number));
            }
        }
        ahead.sort_by(|a, b| a.0.total_cmp(&b.0));
    }
}

/// True if the tile may be hit before all other hits of the rays so far.
fn may_be_nearer(facts: &TileFacts, bundles: &[Bundle], batch: &RayBatch) -> bool {
    let (rays, stride) = (batch.rays.rays(), batch.rays.stride());
    bundles.iter().enumerate().any(|(pulse, bundle)| {
        let hits = &batch.hits.t[pulse * stride..pulse * stride + rays];
        let enter = bundle.enter(&facts.bounds);
        enter.is_some_and(|(enter, _)| hits.iter().any(|t| *t * (1.0 + ROUNDING) >= enter))
    })
}

impl Bundle {
    /// The rays of a pulse; `known` are those of another pulse with the same arrangement.
    fn of(batch: &RayBatch, pulse: usize, known: Option<Bundle>) -> Bundle {
        let (rays, exits) = (&batch.rays, &batch.exits);
        let (origin, direction) = (rays.origin(pulse), rays.direction(pulse, 0));
        if let Some(Bundle { reach, spread, .. }) = known {
            return Bundle { origin, direction, reach, spread };
        }
        let own = exits.get(pulse * rays.rays()..(pulse + 1) * rays.rays()).unwrap_or_default();
        let reach = own.iter().fold(0.0, |max, exit| f64::max(max, (*exit - origin).length()));
        let aside = |ray| (rays.direction(pulse, ray) - direction).length();
        let spread = (0..rays.rays()).fold(0.0, |max, ray| f64::max(max, aside(ray)));
        // Turning the arrangement changes its last digits.
        Bundle {
            origin,
            direction,
            reach: reach * (1.0 + ROUNDING),
            spread: spread * (1.0 + ROUNDING) + ROUNDING,
        }
    }

    /// The distances between which rays may be within a box.
    fn enter(&self, b: &Aabb) -> Option<(f64, f64)> {
        let farthest = (self.origin - b.min).abs().max((self.origin - b.max).abs()).length();
        let margin = self.reach + self.spread * (farthest + self.reach) + ROUNDING * (1.0 + farthest);
        let (enter, exit) =
            Aabb { min: b.min - margin, max: b.max + margin }.slabs(self.origin, self.direction)?;
        (exit >= 0.0).then_some((enter, exit))
    }

    /// Box around the part of the rays within a box.
    fn within(&self, b: &Aabb) -> Aabb {
        let Some((enter, exit)) = self.enter(b) else { return Aabb::EMPTY };
        let ends = [enter.max(0.0), exit].map(|t| self.origin + self.direction * t);
        let margin = self.reach + (self.spread + ROUNDING) * (exit + self.reach) + ROUNDING;
        let around = Aabb::around(ends);
        Aabb { min: around.min - margin, max: around.max + margin }
    }
}

impl<'a> NearTiles<'a> {
    /// The tile of a primitive, its facts, and the primitive's number in the tile; `None` for other
    /// primitives.
    #[inline]
    pub fn locate(&self, primitive: u32) -> Option<(&'a TileFacts, &'a Tile, u32)> {
        self.reader.locate(primitive)
    }

    /// The tiles that hold voxels around a point, with the numbers of their first primitives.
    pub fn around(&self, point: DVec3) -> impl Iterator<Item = (u32, &'a Tile)> {
        let NearTiles { reader, near } = *self;
        near.iter().filter_map(move |tile| {
            let TileFacts { bounds, cubes, first, .. } = &reader.facts()[*tile as usize];
            let is_within = point.cmpge(bounds.min).all() && point.cmple(bounds.max).all();
            (is_within && *cubes > 0).then(|| Some((*first, reader.get(*tile as usize)?))).flatten()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_geom::unit;
    use vlscan_trace::RayGroup;

    /// Numbers from −1 to 1.
    fn numbers() -> impl FnMut() -> f64 {
        let mut state = 7u64;
        move || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        }
    }

    #[test]
    fn a_bundle_meets_every_box_that_one_of_its_rays_meets() {
        let mut random = numbers();
        let mut met = 0;
        for round in 0..2000 {
            let mut vector = |size: f64| DVec3::new(random(), random(), random()) * size;
            let (origin, axis) = (vector(300.0), unit(vector(1.0)));
            let spread = if round % 2 == 0 { 1e-3 } else { 0.2 };
            let directions: Vec<DVec3> = (0..9).map(|_| unit(axis + vector(spread))).collect();
            let exits: Vec<DVec3> = (0..9).map(|_| origin + vector(0.5)).collect();
            let corners = [origin + axis * 200.0 + vector(60.0), origin + axis * 220.0 + vector(60.0)];
            let tile = Aabb::around(corners);
            let mut batch = RayBatch::default();
            batch.rays = RayGroup::new(directions.len());
            batch.rays.push(origin, |x, y, z| {
                for (r, d) in directions.iter().enumerate() {
                    (x[r], y[r], z[r]) = (d.x, d.y, d.z);
                }
            });
            batch.exits = if round % 3 == 0 { exits } else { Vec::new() };
            let bundle = Bundle::of(&batch, 0, None);
            let scene = tile.union(Aabb::around([vector(400.0)]));
            for (ray, d) in directions.iter().enumerate() {
                let start = batch.exits.get(ray).copied().unwrap_or(origin);
                let Some((enter, exit)) = tile.slabs(start, *d).filter(|(_, exit)| *exit >= 0.0) else {
                    continue;
                };
                met += 1;
                let (first, last) = bundle.enter(&tile).expect("a ray meets the box");
                assert!(first <= enter && last >= exit, "{first} {enter} {exit} {last}");
                let around = bundle.within(&scene);
                let hit = start + *d * enter.max(0.0);
                assert!(around.min.cmple(hit).all() && hit.cmple(around.max).all(), "{around:?} {hit}");
            }
        }
        assert!(met > 2000, "{met}");
    }
}
