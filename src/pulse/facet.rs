//! What the physics needs to know of a triangle, remembered: neighbouring pulses meet the same ones.

use super::reflect::View;
use crate::geom::{DVec3, unit};
use crate::scene::Reflection;
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
    /// Specular share and exponent are the material's with this number.
    Phong(u32),
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
            Reflection::Phong { .. } => Law::Phong(surface.material),
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

    /// Cosine of the incidence angle (spec pulse-physics §2.4).
    #[inline(always)]
    pub fn cosine(&self, direction: DVec3) -> f64 {
        self.normal.dot(direction).abs().min(1.0)
    }

    /// Reflectance factor, as [`crate::scene::Material::factor`] has it.
    #[inline(always)]
    pub fn factor(&self, view: &View, cosine: f64) -> f64 {
        match self.law {
            Law::Uniform => self.reflectance,
            Law::Lambert => self.reflectance * cosine,
            Law::Phong(material) => view.scene.materials[material as usize].factor(cosine),
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
