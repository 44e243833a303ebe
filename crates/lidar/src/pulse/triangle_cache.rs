//! A cache of triangle normals and materials: neighbouring pulses hit the same triangles.

use super::lanes::{Block, LANES};
use super::view::SceneView;
use vlscan_geom::{DVec3, unit};
use vlscan_scene::{Material, Reflection, Scene, SceneTriangle};
use vlscan_trace::Hits;

/// Shading data of a triangle.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(super) struct CachedTriangle {
    /// Index of the primitive, or [`Hits::MISS`].
    primitive: u32,
    pub part: u32,
    pub classification: i32,
    law: Law,
    /// Index of the material.
    material: u32,
    /// Unit normal.
    pub normal: DVec3,
    /// ρ at the first wavelength.
    reflectance: f64,
}

#[derive(Clone, Copy, Debug)]
enum Law {
    Uniform,
    Lambert,
    /// With a specular share, or of a retro-reflector: [`Material::factor`].
    Phong,
}

impl CachedTriangle {
    const NONE: CachedTriangle = CachedTriangle {
        primitive: Hits::MISS,
        part: 0,
        classification: 0,
        law: Law::Uniform,
        material: 0,
        normal: DVec3::ZERO,
        reflectance: 0.0,
    };

    /// Triangle `primitive` in its current position, or `None` if it is not a triangle.
    fn of(view: &SceneView, primitive: u32) -> Option<CachedTriangle> {
        let (corners, surface) = match view.tiles.and_then(|tiles| tiles.locate(primitive)) {
            Some((_, tile, local)) => (tile.scene.triangle(local), view.surface(primitive)),
            None => {
                let found = view.scene.find_triangle(primitive)?;
                let corners = match view.locate_moving(primitive) {
                    Some((scene, local)) => scene.triangle(local),
                    None => found.corners(),
                };
                (corners, found.surface())
            }
        };
        let [a, b, c] = corners?;
        let material = &view.scene.materials[surface.material as usize];
        let law = match material.reflection {
            Reflection::Uniform => Law::Uniform,
            Reflection::Lambert => Law::Lambert,
            // A specular lobe without light is finite and adds nothing.
            Reflection::Phong { specularity: 0.0, exponent } if exponent >= 0.0 => Law::Lambert,
            Reflection::Lobes { specularity: 0.0, roughness: 0.0, .. } => Law::Lambert,
            Reflection::Phong { .. } | Reflection::Lobes { .. } | Reflection::Retro { .. } => Law::Phong,
        };
        Some(CachedTriangle {
            primitive,
            part: surface.part,
            classification: material.classification,
            law,
            material: surface.material,
            normal: unit((b - a).cross(c - a)),
            reflectance: material.reflectance,
        })
    }

    /// Cosines of the incidence angles (spec pulse-physics §2.4) of the directions that hit the triangle.
    #[inline(always)]
    pub fn cosines(&self, [x, y, z]: [&Block; 3], primitives: &[u32; LANES], out: &mut Block) {
        let n = self.normal;
        for i in 0..LANES {
            let cosine = (n.x * x[i] + n.y * y[i] + n.z * z[i]).abs();
            let cosine = if cosine < 1.0 { cosine } else { 1.0 };
            out[i] = if primitives[i] == self.primitive { cosine } else { out[i] };
        }
    }

    /// Reflectance factors ([`Material::factor`]) times the gains of the subrays that hit the triangle.
    #[inline(always)]
    pub fn intensities(
        &self,
        view: &SceneView,
        cosine: &Block,
        gain: &Block,
        primitives: &[u32; LANES],
        out: &mut Block,
    ) {
        let material = || &view.scene.materials[self.material as usize];
        let reflectance = match view.wavelength {
            0 => self.reflectance,
            further => material().reflectance_at(further),
        };
        // A factor of 1 changes no digit.
        let mut slope = *cosine;
        match self.law {
            Law::Lambert => {}
            Law::Uniform => slope = [1.0; LANES],
            Law::Phong => {
                return self.phong((material(), view.wavelength), cosine, gain, primitives, out);
            }
        }
        for i in 0..LANES {
            let intensity = reflectance * slope[i] * gain[i];
            out[i] = if primitives[i] == self.primitive { intensity } else { out[i] };
        }
    }

    /// [`CachedTriangle::intensities`] of materials with a specular share.
    #[inline(never)]
    fn phong(
        &self,
        (material, wavelength): (&Material, usize),
        cosine: &Block,
        gain: &Block,
        primitives: &[u32; LANES],
        out: &mut Block,
    ) {
        for i in 0..LANES {
            if primitives[i] == self.primitive {
                out[i] = material.factor(wavelength, cosine[i]) * gain[i];
            }
        }
    }
}

/// The triangles that were hit last, by the low bits of their index.
#[derive(Clone, Debug)]
pub(super) struct TriangleCache {
    entries: Vec<CachedTriangle>,
    /// Entries that belong to moving objects.
    moving: Vec<usize>,
}

const CACHE_SIZE: usize = 256;

impl Default for TriangleCache {
    fn default() -> TriangleCache {
        TriangleCache { entries: vec![CachedTriangle::NONE; CACHE_SIZE], moving: Vec::new() }
    }
}

impl TriangleCache {
    /// Removes the triangles of moving objects, whose positions change.
    pub fn forget_moving(&mut self) {
        for entry in self.moving.drain(..) {
            self.entries[entry] = CachedTriangle::NONE;
        }
    }

    /// Prefetches where the corners and surfaces of triangles among `primitives` are. In scenes with
    /// instances, where pulses hit more triangles than elsewhere and each takes longer to find, these are all
    /// that are not in the cache, and they are appended to `missing`.
    #[inline(always)]
    pub fn prefetch<'s>(&self, scene: &'s Scene, primitives: &[u32], missing: &mut Vec<SceneTriangle<'s>>) {
        if scene.instances.is_none() {
            // Neighbouring subrays share most triangles.
            let some = primitives.iter().step_by(4).filter_map(|primitive| scene.find_triangle(*primitive));
            return some.for_each(|triangle| triangle.prefetch());
        }
        let mut last = Hits::MISS;
        for primitive in primitives {
            if *primitive != last && self.entries[*primitive as usize % CACHE_SIZE].primitive != *primitive {
                let found = scene.find_triangle(*primitive);
                found.iter().for_each(SceneTriangle::prefetch);
                missing.extend(found);
            }
            last = *primitive;
        }
    }

    /// Triangle `primitive`, or `None` if it is another primitive.
    #[inline(always)]
    pub fn look_up(&mut self, view: &SceneView, primitive: u32) -> Option<&CachedTriangle> {
        let entry = primitive as usize % CACHE_SIZE;
        if self.entries[entry].primitive != primitive {
            self.insert(view, entry, primitive)?;
        }
        Some(&self.entries[entry])
    }

    #[inline(never)]
    fn insert(&mut self, view: &SceneView, entry: usize, primitive: u32) -> Option<()> {
        self.entries[entry] = CachedTriangle::of(view, primitive)?;
        if view.is_moving(primitive) {
            self.moving.push(entry);
        }
        Some(())
    }
}
