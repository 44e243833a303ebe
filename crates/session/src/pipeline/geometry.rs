//! The primitives of a loaded scene as arrays.

use super::scene::LoadedScene;
use std::collections::HashMap;
use vlscan_base::error::{Error, Result};
use vlscan_geom::DVec3;
use vlscan_scene::{PrimitiveShape, Scene};
use vlscan_trace::{Cube, PrimitiveRef};

/// Mark of a stored vertex that no triangle has used so far.
const UNUSED: u32 = u32::MAX;

/// Primitives of a scene in the world frame: triangles, then voxels, each in the order of their numbers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneGeometry {
    /// Vertices of the triangles, m.
    pub vertices: Vec<DVec3>,
    /// Indices in `vertices` of the corners of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Voxels, m.
    pub voxels: Vec<Cube>,
    /// Number of each triangle, then of each voxel, see [`RayHit::primitive`](super::RayHit::primitive).
    pub numbers: Vec<u32>,
    /// Part of each triangle, then of each voxel, see [`RayHit::part`](super::RayHit::part).
    pub parts: Vec<u32>,
}

impl LoadedScene {
    /// The primitives of the scene, or of the part with an index among
    /// [`SceneFacts::parts`](super::SceneFacts::parts); moving parts are in their initial pose. Triangles of
    /// meshes share their vertices. Corners of terrain rasters and of instances at the same place are one
    /// vertex.
    ///
    /// # Errors
    /// [`Error::Input`] for scenes with parts that are not in memory, and for 2³² vertices or more.
    pub fn geometry(&self, part: Option<u32>) -> Result<SceneGeometry> {
        let scene: &Scene = self.scene();
        if scene.tiles.is_some() {
            return Err(Error::input(
                "arrays of primitives need the scene in memory: leave out --scene-memory, also where it was \
                 packed",
            ));
        }
        let mut chosen: Vec<(u32, PrimitiveRef)> = Vec::new();
        scene.for_each_primitive(|facts| {
            if part.is_none_or(|part| part == facts.part)
                && let Some(i) = scene.number_of(facts.primitive)
            {
                chosen.push((scene.number_when_stored(i), facts.primitive));
            }
        });
        chosen.sort_unstable_by_key(|(number, _)| *number);
        let mut arrays = Arrays {
            scene,
            geometry: SceneGeometry::default(),
            stored: vec![UNUSED; scene.geometry.vertices.len()],
            computed: HashMap::new(),
        };
        for (number, primitive) in chosen {
            arrays.push(number, primitive)?;
        }
        Ok(arrays.geometry)
    }
}

/// Arrays that are being filled.
struct Arrays<'a> {
    scene: &'a Scene,
    geometry: SceneGeometry,
    /// Index of each vertex that the scene stores, or [`UNUSED`].
    stored: Vec<u32>,
    /// Index of each other vertex, by the bits of its coordinates.
    computed: HashMap<[u64; 3], u32>,
}

impl Arrays<'_> {
    /// Appends a primitive.
    fn push(&mut self, number: u32, primitive: PrimitiveRef) -> Result<()> {
        let Some(facts) = self.scene.facts_of(primitive) else { return Ok(()) };
        match facts.shape {
            PrimitiveShape::Triangle([a, b, c]) => {
                let triangle = match primitive {
                    PrimitiveRef::Triangle(index) => {
                        let [a, b, c] = self.scene.geometry.triangles[index];
                        [self.stored(a)?, self.stored(b)?, self.stored(c)?]
                    }
                    _ => [self.computed(a)?, self.computed(b)?, self.computed(c)?],
                };
                self.geometry.triangles.push(triangle);
            }
            PrimitiveShape::Voxel(_, cube) => {
                let centre = self.scene.to_world(cube.centre);
                self.geometry.voxels.push(Cube { centre, ..cube });
            }
        }
        self.geometry.numbers.push(number);
        self.geometry.parts.push(facts.part);
        Ok(())
    }

    /// Index of a vertex that the scene stores.
    fn stored(&mut self, vertex: u32) -> Result<u32> {
        let known = self.stored[vertex as usize];
        if known != UNUSED {
            return Ok(known);
        }
        let index = self.add(self.scene.geometry.vertices[vertex as usize])?;
        self.stored[vertex as usize] = index;
        Ok(index)
    }

    /// Index of the vertex at a place in the scene's frame.
    fn computed(&mut self, place: DVec3) -> Result<u32> {
        // Adding 0 removes negative zeros.
        let bits = place.to_array().map(|value| (value + 0.0).to_bits());
        if let Some(index) = self.computed.get(&bits) {
            return Ok(*index);
        }
        let index = self.add(place)?;
        self.computed.insert(bits, index);
        Ok(index)
    }

    /// Appends a vertex at a place in the scene's frame.
    fn add(&mut self, place: DVec3) -> Result<u32> {
        let index = u32::try_from(self.geometry.vertices.len()).ok().filter(|index| *index != UNUSED);
        let index = index.ok_or_else(|| {
            Error::input("the arrays have 2³² vertices or more; choose the parts one after the other")
        })?;
        self.geometry.vertices.push(self.scene.to_world(place));
        Ok(index)
    }
}
