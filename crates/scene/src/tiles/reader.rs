//! A thread's access to the tiles of a scene.

use super::{Tile, TileFacts, Tiles, error_of};
use crate::Scene;
use std::sync::Arc;
use vlscan_base::error::Result;
use vlscan_geom::DVec3;
use vlscan_trace::{Hit, Pins};

/// Access of one thread to the tiles of a scene. Requested tiles stay in memory until they are
/// [released](TileReader::release).
#[derive(Debug)]
pub struct TileReader {
    tiles: Arc<Tiles>,
    pub(super) pins: Pins,
}

impl TileReader {
    /// Access to these tiles.
    pub fn new(tiles: &Arc<Tiles>) -> TileReader {
        TileReader { tiles: tiles.clone(), pins: Pins::new(tiles.items.residency()) }
    }

    /// Facts about all tiles.
    pub fn facts(&self) -> &[TileFacts] {
        &self.tiles.facts
    }

    /// A tile, which is loaded if it is not in memory. `None` if that fails or if there is no room for it;
    /// [`TileReader::release`] returns the reason.
    #[inline]
    pub fn get(&self, tile: usize) -> Option<&Tile> {
        self.pins.get(&self.tiles.items, tile)
    }

    /// The tile that primitive `i` of the complete scene belongs to, and the primitive's number there; `None`
    /// for other primitives.
    #[inline]
    pub fn locate(&self, i: u32) -> Option<(&TileFacts, &Tile, u32)> {
        let (tile, local) = self.tiles.locate(i)?;
        Some((&self.tiles.facts[tile], self.get(tile)?, local))
    }

    /// As [`Scene::number_when_stored`], for a primitive of `scene` or of one of the requested tiles.
    #[inline]
    pub fn number_when_stored(&self, scene: &Scene, i: u32) -> u32 {
        self.tiles.number_with(scene, i, |i| scene.number_without_tiles(i), |tile| self.get(tile))
    }

    /// True if the tiles requested since the last release need more memory than available.
    pub fn is_over_budget(&self) -> bool {
        self.pins.is_over_budget()
    }

    /// Allows the tiles to be dropped.
    ///
    /// # Errors
    /// When one of them could not be loaded, or all together need too much memory: rays traced through them
    /// are then invalid.
    pub fn release(&mut self) -> Result<()> {
        self.pins.release().map_err(|error| error_of(&error))
    }

    /// The nearest of `best`, a hit on `scene` without its tiles, and the first hits on the tiles with these
    /// indices (all without) of primitives that `accept` accepts, by the scene of their tile, their number
    /// there and that in `scene`.
    pub fn nearest(
        &self,
        scene: &Scene,
        among: Option<&[u32]>,
        (origin, direction): (DVec3, DVec3),
        best: Option<Hit>,
        accept: impl Fn(&Scene, u32, u32) -> bool,
    ) -> Option<Hit> {
        let all = among.is_none().then_some(0..self.facts().len() as u32).into_iter().flatten();
        let tiles = all.chain(among.into_iter().flatten().copied());
        // Rounding moves the faces of a box and of the primitives within it by at most this.
        let slack = 1e-9 * (1.0 + origin.abs().max_element());
        let mut entered: Vec<(f64, u32)> = tiles
            .filter_map(|tile| {
                let mut b = self.facts()[tile as usize].bounds;
                (b.min, b.max) = (b.min - slack, b.max + slack);
                let (enter, exit) = b.slabs(origin, direction)?;
                (exit >= 0.0).then_some((enter, tile))
            })
            .collect();
        entered.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut best = best;
        for (enter, tile) in entered {
            if best.is_some_and(|best| best.t < enter - slack) {
                break;
            }
            let (Some(found), first) = (self.get(tile as usize), self.facts()[tile as usize].first) else {
                continue;
            };
            let inner = &found.scene;
            let hit =
                found.tree.nearest_where(&inner.geometry, origin, direction, |i| accept(inner, i, first + i));
            let Some(hit) = hit.map(|hit| Hit { primitive: first + hit.primitive, ..hit }) else { continue };
            let is_nearer = best.is_none_or(|best| {
                let order = |hit: Hit| self.number_when_stored(scene, hit.primitive);
                hit.t < best.t || (hit.t == best.t && order(hit) < order(best))
            });
            if is_nearer {
                best = Some(hit);
            }
        }
        best
    }
}
