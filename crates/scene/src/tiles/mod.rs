//! Tiles: parts of a scene that are in memory only while rays need them.
//!
//! Every tile is a separate scene with its tree, in the frame of the complete scene. For each tile the scene
//! stores the facts that are needed while the tile is not in memory: its box, its part, its materials and the
//! numbers of its primitives, which follow those of the scene's own primitives and instances. So a tile's
//! primitives are distinguished, ordered at equal distances and described as if they were stored in the
//! scene, and the set of tiles in memory only affects the duration of a run.

mod place;
mod reader;
#[cfg(test)]
mod tests;

pub use place::PlaceInRaster;
pub use reader::TileReader;

use crate::Scene;
use std::sync::{Arc, OnceLock};
use vlscan_base::diag::ProblemKind;
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity::bytes;
use vlscan_geom::{Aabb, DVec3};
use vlscan_trace::{Hit, Paged, PinError, ResidencyStatistics, Tree};

/// How tiles are kept in memory.
#[derive(Clone, Debug)]
pub struct TileOptions {
    /// Memory of all tiles that are in memory at a time, with their trees, bytes.
    pub memory: u64,
    /// How the trees over tiles are built.
    pub trees: vlscan_trace::BuildOptions,
}

/// A tile in memory.
#[derive(Clone, Debug)]
pub struct Tile {
    /// Its only part, in the frame of the complete scene; primitives and materials are numbered from 0.
    pub scene: Scene,
    /// The tree over it.
    pub tree: Tree,
}

impl Tile {
    /// Memory, bytes.
    pub fn memory(&self) -> usize {
        self.scene.memory() + self.tree.memory()
    }
}

/// Facts about a tile, in memory or not.
#[derive(Clone, Debug, Default)]
pub struct TileFacts {
    /// Box around its primitives, scene frame, m.
    pub bounds: Aabb,
    /// Index in [`Scene::parts`].
    pub part: u32,
    /// Index in [`Scene::materials`] of each of its materials.
    pub materials: Vec<u32>,
    /// Number of its first primitive in the complete scene.
    pub first: u32,
    /// Number of its triangles, with those that a height field lacks.
    pub triangles: u32,
    /// Number of its cubes, which follow its triangles.
    pub cubes: u32,
    /// Edge of its largest cube, m.
    pub max_cube: f64,
    /// Checksum of its geometry.
    pub checksum: u64,
    /// Memory with its tree, bytes, approximately.
    pub bytes: u64,
    /// Its place in the raster that it is a part of.
    pub place: Option<PlaceInRaster>,
    /// Numbers before the tile in the order of parts.
    pub before: Before,
}

impl TileFacts {
    /// Number of its primitives.
    pub fn primitives(&self) -> u64 {
        let missing = self.place.as_ref().map_or(0, |place| place.missing);
        u64::from(self.triangles - missing) + u64::from(self.cubes)
    }
}

/// Numbers before a tile in the order of parts, which decide between equal distances as if all were stored.
#[derive(Clone, Copy, Debug, Default)]
pub struct Before {
    /// Number of the scene's own triangles, those that height fields lack included.
    pub own_triangles: u32,
    /// Number of the scene's own cubes.
    pub own_cubes: u32,
    /// Number of instances.
    pub instances: u32,
    /// Number of triangles of tiles.
    pub triangles: u32,
    /// Number of cubes of tiles.
    pub cubes: u32,
}

/// The tiles of a scene.
#[derive(Debug)]
pub struct Tiles {
    facts: Vec<TileFacts>,
    items: Paged<Tile>,
    /// Number of the first primitive of any tile, and the end of their numbers.
    numbers: [u32; 2],
    /// Why heights or distances that cannot report a failure are wrong.
    failure: OnceLock<PinError>,
}

impl Tiles {
    /// The tiles with these facts, whose primitives follow the `own` ones of the scene and are numbered here.
    ///
    /// # Errors
    /// [`Error::Input`] if they cannot be numbered with 32 bits.
    pub(crate) fn new(mut facts: Vec<TileFacts>, items: Paged<Tile>, own: usize) -> Result<Tiles> {
        let (mut next, mut before) = (own as u64, [0u64; 2]);
        // The raster of the tile before, and the number of triangles before the raster.
        let mut raster: Option<(Arc<[u32]>, u64)> = None;
        for tile in &mut facts {
            tile.first = next as u32;
            next += u64::from(tile.triangles) + u64::from(tile.cubes);
            // Triangles of one raster are counted row by row, not tile by tile.
            let known = raster
                .take()
                .filter(|(rows, _)| tile.place.as_ref().is_some_and(|place| Arc::ptr_eq(&place.rows, rows)));
            let start = known.map_or(before[0], |(_, start)| start);
            (tile.before.triangles, tile.before.cubes) = (start as u32, before[1] as u32);
            before[0] = start + u64::from(tile.place.as_ref().map_or(tile.triangles, PlaceInRaster::all));
            before[1] += u64::from(tile.cubes);
            raster = tile.place.as_ref().map(|place| (place.rows.clone(), start));
        }
        if next >= u64::from(u32::MAX) {
            let message = format!(
                "the scene has {next} primitives with all its tiles; at most {} can be numbered",
                u32::MAX - 1
            );
            return Err(Error::input_of(ProblemKind::TooLarge, message));
        }
        Ok(Tiles { facts, items, numbers: [own as u32, next as u32], failure: OnceLock::new() })
    }

    /// The facts of all tiles, in the order of their parts.
    pub fn facts(&self) -> &[TileFacts] {
        &self.facts
    }

    /// Number of primitives of all tiles.
    pub fn primitives(&self) -> usize {
        self.facts.iter().map(|tile| tile.primitives() as usize).sum()
    }

    /// The tile that primitive `i` of the complete scene belongs to, and the primitive's number there; `None`
    /// if it belongs to no tile.
    #[inline]
    pub fn locate(&self, i: u32) -> Option<(usize, u32)> {
        if i < self.numbers[0] || i >= self.numbers[1] {
            return None;
        }
        let tile = self.facts.partition_point(|tile| tile.first <= i) - 1;
        Some((tile, i - self.facts[tile].first))
    }

    /// Memory of all tiles with their trees, bytes, approximately.
    pub fn bytes(&self) -> u64 {
        self.facts.iter().map(|tile| tile.bytes).fold(0, u64::saturating_add)
    }

    /// Statistics of loading and dropping so far.
    pub fn statistics(&self) -> ResidencyStatistics {
        self.items.residency().statistics()
    }

    /// Memory of the facts about tiles, without the loaded tiles, bytes.
    pub(crate) fn memory(&self) -> usize {
        let of_place = |place: &PlaceInRaster| 4 * place.before.capacity();
        let of_tile = |tile: &TileFacts| {
            size_of::<TileFacts>() + 4 * tile.materials.capacity() + tile.place.as_ref().map_or(0, of_place)
        };
        self.facts.iter().map(of_tile).sum()
    }

    /// Loads the tiles that an area meets on its way, the nearest first, as long as there is room for them
    /// without recently used tiles. `way` is in m.
    pub fn prefetch(&self, area: &Aabb, way: DVec3) {
        let mut ahead: Vec<(f64, usize)> = (0..)
            .zip(&self.facts)
            .filter_map(|(i, tile)| {
                // The area meets the tile when its lower corner meets the tile widened by the area.
                let b = Aabb { min: tile.bounds.min - area.size(), max: tile.bounds.max };
                let (enter, exit) = b.slabs(area.min, way)?;
                (enter <= 1.0 && exit >= 0.0).then_some((enter, i))
            })
            .collect();
        ahead.sort_by(|a, b| a.0.total_cmp(&b.0));
        let _ = ahead.into_iter().all(|(_, tile)| self.items.prefetch(tile));
    }

    /// Calls `visit` with the tiles that pass `is_selected`, one after the other, so that only one must be in
    /// memory at a time. A tile that cannot be loaded is reported by [`Tiles::check`].
    pub(crate) fn for_each(
        self: &Arc<Self>,
        is_selected: impl Fn(&TileFacts) -> bool,
        mut visit: impl FnMut(&TileFacts, &Tile),
    ) {
        for (i, facts) in self.facts.iter().enumerate().filter(|(_, facts)| is_selected(facts)) {
            self.read(|reader| reader.get(i).map(|tile| visit(facts, tile)));
        }
    }

    /// Runs `work` with the tiles that it asks for in memory.
    pub(crate) fn read<R>(self: &Arc<Self>, work: impl FnOnce(&TileReader) -> R) -> R {
        let mut reader = TileReader::new(self);
        let result = work(&reader);
        if let Err(error) = reader.pins.release() {
            let _ = self.failure.set(error);
        }
        result
    }

    /// Fails if a height of the ground or a distance could not be computed because a tile could not be
    /// loaded.
    ///
    /// # Errors
    /// The error of the tile.
    pub fn check(&self) -> Result<()> {
        self.failure.get().map_or(Ok(()), |error| Err(error_of(error)))
    }

    /// The number of primitive `i` if all primitives were stored in the order of their parts, cubes last.
    /// `own` is that number without tiles, for primitives of no tile.
    pub(crate) fn number_when_stored(
        self: &Arc<Self>,
        scene: &Scene,
        i: u32,
        own: impl FnOnce(u32) -> u32,
    ) -> u32 {
        let place = self.locate(i).and_then(|(tile, _)| self.facts[tile].place.as_ref());
        match place.is_some_and(|place| place.missing > 0) {
            true => self.read(|reader| self.number_with(scene, i, own, |tile| reader.get(tile))),
            false => self.number_with(scene, i, own, |_| None),
        }
    }

    /// [`Tiles::number_when_stored`]; `get` returns the tile of the primitive.
    fn number_with<'t>(
        &self,
        scene: &Scene,
        i: u32,
        own: impl FnOnce(u32) -> u32,
        get: impl FnOnce(usize) -> Option<&'t Tile>,
    ) -> u32 {
        let g = &scene.geometry;
        let set = scene.instances.as_ref().map(|set| &*set.instances);
        let of_instances = set.map_or(0, |all| all.triangles());
        let end = self.facts.last().map_or([0, 0], |last| {
            let triangles = last.place.as_ref().map_or(last.triangles, PlaceInRaster::all);
            [last.before.triangles + triangles, last.before.cubes + last.cubes]
        });
        let stored = |numbers: u32| numbers - g.missing_before(numbers as usize) as u32;
        let Some((tile, local)) = self.locate(i) else {
            // Number of primitives of tiles before a primitive of the scene.
            let at = |is_before: &dyn Fn(&Before) -> bool| {
                let next = self.facts.get(self.facts.partition_point(|tile| is_before(&tile.before)));
                next.map_or(end, |tile| [tile.before.triangles, tile.before.cubes])
            };
            let added =
                match (set.and_then(|all| all.locate(i)), (i as usize).checked_sub(g.triangle_count())) {
                    (Some((instance, _)), _) => at(&|before| before.instances as usize <= instance)[0],
                    (None, Some(cube)) => end[0] + at(&|before| before.own_cubes as usize <= cube)[1],
                    (None, None) => at(&|before| before.own_triangles <= i)[0],
                };
            return own(i) + added;
        };
        let TileFacts { triangles, before, place, .. } = &self.facts[tile];
        match local.checked_sub(*triangles) {
            None => {
                let of_earlier = set.map_or(0, |all| {
                    all.all
                        .get(before.instances as usize)
                        .map_or(of_instances, |next| next.first - all.first())
                });
                let local = match place {
                    Some(place) => {
                        let found = get(tile).filter(|_| place.missing > 0);
                        place.number(local, found.and_then(|tile| tile.scene.geometry.fields.first()))
                    }
                    None => local,
                };
                stored(before.own_triangles) + of_earlier + before.triangles + local
            }
            Some(cube) => {
                let all_triangles = stored(g.triangle_count() as u32) + of_instances + end[0];
                all_triangles + before.own_cubes + before.cubes + cube
            }
        }
    }

    /// The nearest of `best`, a hit on the scene without its tiles, and the first hits on tiles of primitives
    /// that `accept` accepts, by the scene of their tile and their number there.
    pub(crate) fn nearest(
        self: &Arc<Self>,
        scene: &Scene,
        (origin, direction): (DVec3, DVec3),
        best: Option<Hit>,
        accept: impl Fn(&Scene, u32) -> bool,
    ) -> Option<Hit> {
        let accept = |inner: &Scene, i: u32, _| accept(inner, i);
        self.read(|reader| reader.nearest(scene, None, (origin, direction), best, accept))
    }
}

/// The error of a run whose tiles could not be loaded.
pub(crate) fn error_of(error: &PinError) -> Error {
    match error {
        PinError::TooSmall { needed, budget } => {
            let [needed, budget] = [*needed, *budget].map(bytes);
            Error::input_with_help(
                format!(
                    "one footprint meets tiles of the scene that need {needed} together; --scene-memory is \
                     {budget}"
                ),
                format!("give --scene-memory more than {needed}, or divide the scene into smaller tiles"),
            )
        }
        PinError::Load(error) => match error.downcast_ref() {
            Some(Error::Input(found)) => Error::Input(found.clone()),
            Some(Error::Io { action, path, source }) => {
                let source = std::io::Error::new(source.kind(), source.to_string());
                Error::Io { action, path: path.clone(), source }
            }
            Some(Error::Interrupted) => Error::Interrupted,
            _ => Error::Internal(error.to_string()),
        },
    }
}
