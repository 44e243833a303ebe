//! The scene at the time of a pulse, and the interactions of rays with it.

use super::foliage;
use super::tiles::NearTiles;
use vlscan_geom::{Aabb, DVec3};
use vlscan_scene::{DynamicObject, Scene, Surface};
use vlscan_trace::{Hit, Hits, Tree};

/// Distance behind a surface at which a ray continues, m.
pub(super) const STEP_BEHIND: f64 = 1e-5;
/// Tolerance of the scene's box, m.
const BOX_SLACK: f64 = 1e-4;

/// The parts of the scene that are independent of time and worker.
#[derive(Clone, Copy, Debug)]
pub(super) struct StaticView<'a> {
    pub scene: &'a Scene,
    /// Tree over the static primitives.
    pub tree: &'a Tree,
    /// See [`SceneView::visible_bounds`].
    pub visible_bounds: Option<Aabb>,
    /// See [`SceneView::fixed_incidence`].
    pub fixed_incidence: bool,
    /// See [`SceneView::max_cube_size`].
    pub max_cube_size: f64,
    /// See [`SceneView::has_optics`].
    pub has_optics: bool,
    /// See [`SceneView::has_colours`].
    pub has_colours: bool,
}

impl<'a> StaticView<'a> {
    /// The scene with moving objects, and with the tiles that the rays of a batch may hit.
    pub fn with<'b>(&self, moving: &'b [DynamicObject], tiles: Option<NearTiles<'b>>) -> SceneView<'b>
    where
        'a: 'b,
    {
        let StaticView {
            scene,
            tree,
            visible_bounds,
            fixed_incidence,
            max_cube_size,
            has_optics,
            has_colours,
        } = *self;
        SceneView {
            scene,
            tree,
            moving,
            tiles,
            visible_bounds,
            fixed_incidence,
            max_cube_size,
            wavelength: 0,
            has_optics,
            has_colours,
        }
    }
}

/// The scene at the time of a pulse.
#[derive(Clone, Copy, Debug)]
pub(super) struct SceneView<'a> {
    pub scene: &'a Scene,
    /// Tree over the static primitives.
    pub tree: &'a Tree,
    /// The moving objects in their current position.
    pub moving: &'a [DynamicObject],
    /// The tiles that rays may hit, if the scene has tiles.
    pub tiles: Option<NearTiles<'a>>,
    /// The scene's box, outside of which nothing is visible; `None` if nothing lies outside or all is
    /// visible.
    pub visible_bounds: Option<Aabb>,
    /// All surfaces face the beam.
    pub fixed_incidence: bool,
    /// Edge of the largest cube, m.
    pub max_cube_size: f64,
    /// Number of the beam's wavelength among those of the scene's spectra.
    pub wavelength: usize,
    /// True if a material of the scene is a mirror or a pane.
    pub has_optics: bool,
    /// True if the colours of surfaces are recorded.
    pub has_colours: bool,
}

/// Interaction of a ray with a primitive.
#[derive(Clone, Copy, Debug)]
pub(super) struct Interaction {
    /// Start of the current segment of the ray.
    pub from: DVec3,
    /// Distance from there, m; 0 if the ray starts within foliage.
    pub t: f64,
    pub primitive: u32,
    /// Distance of the entry from the pulse's origin, m.
    pub range: f64,
    /// Distance of the point that reflects the ray from the pulse's origin, m: beyond the entry in foliage.
    pub scatter_range: f64,
}

impl Interaction {
    /// The interaction of a ray at its hit, see [`Hits::MISS`]; ranges are distances from `origin`.
    pub fn at_hit(
        (from, direction): (DVec3, DVec3),
        origin: DVec3,
        Hit { t, primitive }: Hit,
    ) -> Interaction {
        let is_miss = primitive == Hits::MISS;
        let range = if is_miss { f64::INFINITY } else { distance((from + direction * t) - origin) };
        Interaction { from, t, primitive, range, scatter_range: range }
    }

    pub fn point(&self, direction: DVec3) -> DVec3 {
        self.from + direction * self.t
    }
}

/// Position of an interaction relative to the scene's box, see [`SceneView::side_of_bounds`].
pub(super) enum SideOfBounds {
    Inside,
    /// Before the box, which the ray enters at this point.
    Before(DVec3),
    Beyond,
}

impl<'a> SceneView<'a> {
    /// The scene that holds primitive `i` in its current position, and its index there.
    #[inline]
    pub fn locate(&self, i: u32) -> (&'a Scene, u32) {
        if let Some((_, tile, local)) = self.tiles.and_then(|tiles| tiles.locate(i)) {
            return (&tile.scene, local);
        }
        self.locate_moving(i).unwrap_or((self.scene, i))
    }

    /// The moving object that holds primitive `i`, if any, and its index there.
    #[inline]
    pub fn locate_moving(&self, i: u32) -> Option<(&'a Scene, u32)> {
        self.moving.iter().find_map(|o| Some((&o.scene, o.to_object_index(i)?)))
    }

    /// Velocity of primitive `i` at a point, m per simulation step.
    pub fn velocity(&self, i: u32, at: DVec3) -> DVec3 {
        let object = self.moving.iter().find(|object| object.to_object_index(i).is_some());
        object.map_or(DVec3::ZERO, |object| object.twist.at(at))
    }

    pub fn is_moving(&self, i: u32) -> bool {
        self.moving.iter().any(|o| o.to_object_index(i).is_some())
    }

    /// Part and material of primitive `i` in the complete scene.
    #[inline]
    pub fn surface(&self, i: u32) -> Surface {
        match self.tiles.and_then(|tiles| tiles.locate(i)) {
            Some((facts, tile, local)) => {
                let material = tile.scene.surface(local).material as usize;
                Surface { part: facts.part, material: facts.materials[material] }
            }
            None => self.scene.surface(i),
        }
    }

    /// The colour of primitive `i` at a point of it, see [`Scene::colour_at`].
    pub fn colour_at(&self, i: u32, at: DVec3) -> [u8; 3] {
        let (holder, local) = self.locate(i);
        let corners = holder.triangle(local);
        // Colours of moving objects are those of the scene.
        match self.locate_moving(i) {
            Some(_) => self.scene.colour_at(i, corners, at),
            None => holder.colour_at(local, corners, at),
        }
    }

    /// See [`Scene::number_when_stored`].
    #[inline]
    pub fn number_when_stored(&self, i: u32) -> u32 {
        match self.tiles {
            Some(tiles) => tiles.reader.number_when_stored(self.scene, i),
            None => self.scene.number_when_stored(i),
        }
    }

    /// True if primitive `i` is a triangle.
    #[inline]
    pub fn is_triangle(&self, i: u32) -> bool {
        let (triangles, own) = (self.scene.geometry.triangle_count(), self.scene.geometry.len());
        if (i as usize) < own || i == Hits::MISS {
            return (i as usize) < triangles;
        }
        self.tiles.and_then(|tiles| tiles.locate(i)).is_none_or(|(facts, _, local)| local < facts.triangles)
    }

    /// Part of primitive `i` and class of its material.
    pub fn part_and_class(&self, i: u32) -> (u32, i32) {
        let surface = self.surface(i);
        (surface.part, self.scene.materials[surface.material as usize].classification)
    }

    /// The voxels of foliage around a pulse's origin.
    pub fn voxels_around(&self, origin: DVec3) -> Vec<u32> {
        let b = self.scene.bounds;
        if self.max_cube_size == 0.0 || !origin.cmpge(b.min).all() || !origin.cmple(b.max).all() {
            return Vec::new();
        }
        let mut all = foliage::voxels_around(self.scene, self.tree, origin, self.max_cube_size);
        for object in self.moving {
            let found = foliage::voxels_around(&object.scene, &object.tree, origin, self.max_cube_size);
            all.extend(found.into_iter().map(|voxel| object.to_scene_index(voxel)));
        }
        for (first, tile) in self.tiles.iter().flat_map(|tiles| tiles.around(origin)) {
            let found = foliage::voxels_around(&tile.scene, &tile.tree, origin, self.max_cube_size);
            all.extend(found.into_iter().map(|voxel| first + voxel));
        }
        all
    }

    /// Position of an interaction relative to the scene's box. Only moving objects ever leave it (spec
    /// pulse-physics §6).
    pub fn side_of_bounds(&self, at: &Interaction, direction: DVec3) -> SideOfBounds {
        let Some(b) = self.visible_bounds else { return SideOfBounds::Inside };
        let point = at.point(direction);
        if point.cmpge(b.min - BOX_SLACK).all() && point.cmple(b.max + BOX_SLACK).all() {
            return SideOfBounds::Inside;
        }
        match b.slabs(at.from, direction) {
            Some((enter, exit)) if at.t <= exit + BOX_SLACK => {
                if at.t < enter - BOX_SLACK {
                    SideOfBounds::Before(at.from + direction * (enter - BOX_SLACK))
                } else {
                    SideOfBounds::Inside
                }
            }
            _ => SideOfBounds::Beyond,
        }
    }

    /// The nearest interaction of the ray `from` + t·`direction` with a primitive that `accept` accepts;
    /// `origin` is the pulse's origin.
    pub fn nearest(
        &self,
        from: DVec3,
        direction: DVec3,
        origin: DVec3,
        accept: impl Fn(u32) -> bool,
    ) -> Interaction {
        self.nearest_among(self.tiles.map(|tiles| tiles.near), (from, direction), origin, accept)
    }

    /// The nearest interaction of a ray that has left its beam: other than for [`SceneView::nearest`], every
    /// tile of the scene counts. The range of the interaction is the distance from the start of the ray.
    pub fn nearest_astray(
        &self,
        (from, direction): (DVec3, DVec3),
        accept: impl Fn(u32) -> bool,
    ) -> Interaction {
        self.nearest_among(None, (from, direction), from, accept)
    }

    /// [`SceneView::nearest`] with the tiles of these indices, or with all.
    fn nearest_among(
        &self,
        tiles: Option<&[u32]>,
        (from, direction): (DVec3, DVec3),
        origin: DVec3,
        accept: impl Fn(u32) -> bool,
    ) -> Interaction {
        let hit = self.tree.nearest_where(&self.scene.geometry, from, direction, &accept);
        let hit = match self.tiles {
            Some(NearTiles { reader, .. }) => {
                let accept = |_: &Scene, _, i| accept(i);
                reader.nearest(self.scene, tiles, (from, direction), hit, accept)
            }
            None => hit,
        };
        let hit = self.moving.iter().fold(hit, |best, object| {
            let accept = |i| accept(object.to_scene_index(i));
            let hit = object.tree.nearest_where(&object.scene.geometry, from, direction, accept);
            let order = |hit: Hit| self.number_when_stored(hit.primitive);
            nearer(best, hit.map(|h| Hit { primitive: object.to_scene_index(h.primitive), ..h }), order)
        });
        let miss = Hit { t: f64::INFINITY, primitive: Hits::MISS };
        Interaction::at_hit((from, direction), origin, hit.unwrap_or(miss))
    }
}

/// The nearer of two hits; of equally near hits the one that comes first in `order`.
fn nearer(a: Option<Hit>, b: Option<Hit>, order: impl Fn(Hit) -> u32) -> Option<Hit> {
    match (a, b) {
        (Some(a), Some(b)) if b.t < a.t || (b.t == a.t && order(b) < order(a)) => Some(b),
        (a, b) => a.or(b),
    }
}

/// √(x² + y² + z²), added in this order.
pub(super) fn distance(d: DVec3) -> f64 {
    (d.x * d.x + d.y * d.y + d.z * d.z).sqrt()
}
