//! What the physics needs to know of a triangle, remembered: neighbouring pulses meet the same ones.

use super::energy::{Block, LANES};
use super::reflect::View;
use crate::geom::{DVec3, unit};
use crate::scene::{Material, Reflection};
use crate::tree::Hits;

/// A triangle as the physics sees it.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(super) struct Facet {
    /// Number of the primitive, or [`Hits::MISS`].
    primitive: u32,
    /// Part of the scene.
    pub part: u32,
    /// Class of the material.
    pub classification: i32,
    law: Law,
    /// Unit normal.
    normal: DVec3,
    /// ρ.
    reflectance: f64,
}

/// How the reflectance factor depends on the angle.
#[derive(Clone, Copy, Debug)]
enum Law {
    Uniform,
    Lambert,
    /// That of the material with this number.
    Glossy(u32),
}

impl Facet {
    const NONE: Facet = Facet {
        primitive: Hits::MISS,
        part: 0,
        classification: 0,
        law: Law::Uniform,
        normal: DVec3::ZERO,
        reflectance: 0.0,
    };

    /// Triangle `primitive` where it is seen now, or `None` if it is no triangle.
    fn of(view: &View, primitive: u32) -> Option<Facet> {
        let (shown, local) = view.shown(primitive);
        let [a, b, c] = shown.triangle(local)?;
        let surface = view.scene.surface(primitive);
        let material = &view.scene.materials[surface.material as usize];
        let law = match material.reflection {
            Reflection::Uniform => Law::Uniform,
            Reflection::Lambert => Law::Lambert,
            // A lobe without light of its own is finite and adds nothing.
            Reflection::Phong { specularity: 0.0, exponent } if exponent >= 0.0 => Law::Lambert,
            Reflection::Lobes { specularity: 0.0, roughness: 0.0, .. } => Law::Lambert,
            Reflection::Phong { .. } | Reflection::Lobes { .. } => Law::Glossy(surface.material),
        };
        Some(Facet {
            primitive,
            part: surface.part,
            classification: material.classification,
            law,
            normal: unit((b - a).cross(c - a)),
            reflectance: material.reflectance,
        })
    }

    /// Unit normal.
    pub fn normal(&self) -> DVec3 {
        self.normal
    }

    /// Cosines of the incidence angles (spec pulse-physics §2.4) of those directions where `same` is 1.
    #[inline(always)]
    pub fn cosines(&self, [x, y, z]: [&Block; 3], same: &[u8; LANES], out: &mut Block) {
        let n = self.normal;
        for i in 0..LANES {
            let cosine = (n.x * x[i] + n.y * y[i] + n.z * z[i]).abs();
            let cosine = if cosine < 1.0 { cosine } else { 1.0 };
            out[i] = if same[i] == 1 { cosine } else { out[i] };
        }
    }

    /// Reflectance factors, as [`crate::scene::Material::factor`] has them, times the gains where `same` is 1.
    #[inline(always)]
    pub fn intensities(
        &self,
        view: &View,
        cosine: &Block,
        gain: &Block,
        same: &[u8; LANES],
        out: &mut Block,
    ) {
        // A factor of 1 changes no digit.
        let mut slope = *cosine;
        match self.law {
            Law::Lambert => {}
            Law::Uniform => slope = [1.0; LANES],
            Law::Glossy(material) => {
                return Facet::shine(&view.scene.materials[material as usize], cosine, gain, same, out);
            }
        }
        for i in 0..LANES {
            let intensity = self.reflectance * slope[i] * gain[i];
            out[i] = if same[i] == 1 { intensity } else { out[i] };
        }
    }

    /// [`Facet::intensities`] of what shines.
    #[inline(never)]
    fn shine(material: &Material, cosine: &Block, gain: &Block, same: &[u8; LANES], out: &mut Block) {
        for i in 0..LANES {
            if same[i] == 1 {
                out[i] = material.factor(cosine[i]) * gain[i];
            }
        }
    }
}

/// Triangles that were met lately.
#[derive(Clone, Debug)]
pub(super) struct Facets {
    met: Vec<Facet>,
    /// Places of those that belong to moving parts.
    moving: Vec<usize>,
}

/// How many are remembered: a power of two.
const REMEMBERED: usize = 256;

impl Default for Facets {
    fn default() -> Facets {
        Facets { met: vec![Facet::NONE; REMEMBERED], moving: Vec::new() }
    }
}

impl Facets {
    /// Forgets what may be seen elsewhere from now on.
    pub fn forget_moving(&mut self) {
        for place in self.moving.drain(..) {
            self.met[place] = Facet::NONE;
        }
    }

    /// Triangle `primitive`, or `None` if it is another primitive.
    #[inline(always)]
    pub fn look_up(&mut self, view: &View, primitive: u32) -> Option<&Facet> {
        let place = primitive as usize % REMEMBERED;
        if self.met[place].primitive != primitive {
            self.remember(view, place, primitive)?;
        }
        Some(&self.met[place])
    }

    #[inline(never)]
    fn remember(&mut self, view: &View, place: usize, primitive: u32) -> Option<()> {
        self.met[place] = Facet::of(view, primitive)?;
        if view.moves(primitive) {
            self.moving.push(place);
        }
        Some(())
    }
}
