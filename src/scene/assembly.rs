//! A scene while it is being loaded: what the loaders append to.

use super::instances::Stock;
use super::library::Library;
use super::load::LoadOptions;
use super::voxel::Voxel;
use super::{MaterialRules, MovingPart, Part, Surface};
use crate::diag::{Diagnostics, Place};
use crate::error::{Error, Result};
use crate::geom::DVec3;
use crate::tree::{Cube, Geometry};
use rayon::prelude::*;
use std::collections::HashMap;
use std::mem::size_of;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Largest coordinate that is taken for a position, m. Beyond it double precision no longer resolves millimetres.
pub(super) const MAX_COORDINATE: f64 = 1e12;

/// Most vertices and most primitives of a scene: their numbers have 32 bits and the last one means "none".
pub(super) const MAX_ELEMENTS: usize = u32::MAX as usize - 1;

/// Geometry and materials as far as they are loaded.
pub(super) struct Assembly<'a> {
    /// Settings of the run.
    pub options: &'a LoadOptions,
    /// Primitives, world frame.
    pub geometry: Geometry,
    /// Attributes of the cubes.
    pub voxels: Vec<Voxel>,
    /// Surface of each triangle.
    pub triangle_surfaces: Vec<u32>,
    /// Surface of each cube.
    pub cube_surfaces: Vec<u32>,
    /// Distinct surfaces.
    pub surfaces: Vec<Surface>,
    /// Parts that hold at least one primitive.
    pub parts: Vec<Part>,
    /// Those of them that move.
    pub moving_parts: Vec<MovingPart>,
    /// Materials.
    pub library: Library,
    /// Meshes that are shared by parts.
    pub stock: Stock,
    /// Geometry files and tables that were opened.
    pub sources: Vec<PathBuf>,
    /// Rules that would make a difference to some leaf angle table.
    pub leaf_tables: MaterialRules,
    /// Problems met so far.
    pub diagnostics: Diagnostics,
    surface_numbers: HashMap<Surface, u32>,
}

/// The part that a loader works for.
pub(super) struct PartSource<'a> {
    /// Its index among the scene's parts.
    pub index: u32,
    /// Where it stands in the scene's file.
    pub place: Option<&'a Place>,
}

/// The primitives of one part.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Extent {
    /// Its vertices.
    pub vertices: Range<usize>,
    /// Its triangles.
    pub triangles: Range<usize>,
    /// Its cubes.
    pub cubes: Range<usize>,
}

impl Extent {
    /// Whether the part holds nothing.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty() && self.cubes.is_empty()
    }
}

impl<'a> Assembly<'a> {
    /// Nothing yet.
    pub fn new(options: &'a LoadOptions, library: Library) -> Assembly<'a> {
        Assembly {
            options,
            geometry: Geometry::default(),
            voxels: Vec::new(),
            triangle_surfaces: Vec::new(),
            cube_surfaces: Vec::new(),
            surfaces: Vec::new(),
            parts: Vec::new(),
            moving_parts: Vec::new(),
            library,
            stock: Stock::default(),
            sources: Vec::new(),
            leaf_tables: MaterialRules::default(),
            diagnostics: Diagnostics::default(),
            surface_numbers: HashMap::new(),
        }
    }

    /// The number of a (part, material) pair.
    pub fn surface(&mut self, part: u32, material: u32) -> u32 {
        let surface = Surface { part, material };
        *self.surface_numbers.entry(surface).or_insert_with(|| {
            self.surfaces.push(surface);
            self.surfaces.len() as u32 - 1
        })
    }

    /// Everything from here to the end of what is loaded, once more is loaded.
    pub fn end(&self) -> Extent {
        let (v, t, c) =
            (self.geometry.vertices.len(), self.geometry.triangles.len(), self.geometry.cubes.len());
        Extent { vertices: v..v, triangles: t..t, cubes: c..c }
    }

    /// What was appended since `start` was the end.
    pub fn since(&self, start: &Extent) -> Extent {
        let end = self.end();
        Extent {
            vertices: start.vertices.start..end.vertices.end,
            triangles: start.triangles.start..end.triangles.end,
            cubes: start.cubes.start..end.cubes.end,
        }
    }

    /// Gives the `count` cubes just appended their materials in turn.
    pub fn spread_materials(&mut self, part: u32, materials: &[u32], count: usize) {
        let surfaces: Vec<u32> = materials.iter().map(|&m| self.surface(part, m)).collect();
        self.cube_surfaces.extend(surfaces.iter().cycle().take(count));
    }

    /// Removes the cubes from number `first` on that `keep` rejects.
    pub fn remove_cubes(&mut self, first: usize, keep: impl Fn(&Cube) -> bool) {
        let mut kept = first;
        for i in first..self.geometry.cubes.len() {
            if keep(&self.geometry.cubes[i]) {
                self.geometry.cubes[kept] = self.geometry.cubes[i];
                self.voxels[kept] = self.voxels[i];
                self.cube_surfaces[kept] = self.cube_surfaces[i];
                kept += 1;
            }
        }
        self.geometry.cubes.truncate(kept);
        self.voxels.truncate(kept);
        self.cube_surfaces.truncate(kept);
    }

    /// Completes triangles that were appended after `start` and number their vertices from there: vertices that none of
    /// them uses are removed, and the rest is numbered within the scene.
    pub fn finish_mesh(&mut self, start: &Extent) -> Result<()> {
        let (first, vertices) = (start.vertices.start, self.geometry.vertices.to_mut());
        let triangles = &mut self.geometry.triangles[start.triangles.start..];
        let mut used = vec![false; vertices.len() - first];
        triangles.iter().flatten().for_each(|&v| used[v as usize] = true);
        if used.iter().all(|&u| u) {
            self.check_numbers()?;
            self.geometry.triangles[start.triangles.start..]
                .par_iter_mut()
                .for_each(|t| *t = t.map(|v| v + first as u32));
            return Ok(());
        }
        let mut number = Vec::with_capacity(used.len());
        let mut kept = first;
        for (i, used) in used.into_iter().enumerate() {
            number.push(kept as u32);
            if used {
                vertices[kept] = vertices[first + i];
                kept += 1;
            }
        }
        vertices.truncate(kept);
        triangles.par_iter_mut().for_each(|t| *t = t.map(|v| number[v as usize]));
        self.check_numbers()
    }

    /// Whether vertices and primitives can be numbered.
    pub fn check_numbers(&self) -> Result<()> {
        if self.geometry.vertices.len() > MAX_ELEMENTS || self.geometry.len() > MAX_ELEMENTS {
            let message = format!(
                "the scene has {} vertices and {} primitives; at most {MAX_ELEMENTS} of each can be numbered",
                self.geometry.vertices.len(),
                self.geometry.len()
            );
            return Err(Error::input(message));
        }
        Ok(())
    }

    /// Refuses when what is loaded and `more` bytes for `file` exceed the limit.
    pub fn check_memory(&self, more: u64, file: &Path) -> Result<()> {
        let Some(limit) = self.options.max_memory else { return Ok(()) };
        let need = self.memory() + more;
        if need <= limit {
            return Ok(());
        }
        Err(Error::input(format!(
            "the scene needs at least {} with {}, without the tree over it; the limit is {}",
            as_size(need),
            file.display(),
            as_size(limit)
        )))
    }

    fn memory(&self) -> u64 {
        memory_of(self.geometry.vertices.len(), self.geometry.triangles.len(), self.geometry.cubes.len())
            .saturating_add(self.stock.memory())
    }
}

/// Bytes that a frozen scene holds for so many vertices, triangles and cubes: 24 per vertex, 16 per triangle, 60 per cube.
pub(super) fn memory_of(vertices: usize, triangles: usize, cubes: usize) -> u64 {
    let per_triangle = size_of::<[u32; 3]>() + size_of::<u32>();
    let per_cube = size_of::<Cube>() + size_of::<Voxel>() + size_of::<u32>();
    let bytes = |count: usize, each: usize| (count as u64).saturating_mul(each as u64);
    bytes(vertices, size_of::<DVec3>())
        .saturating_add(bytes(triangles, per_triangle))
        .saturating_add(bytes(cubes, per_cube))
}

/// A number of bytes for people.
pub(super) fn as_size(bytes: u64) -> String {
    const UNITS: [&str; 5] = ["B", "kB", "MB", "GB", "TB"];
    let mut value = bytes as f64;
    let mut unit = 0;
    while value >= 1000.0 && unit + 1 < UNITS.len() {
        value /= 1000.0;
        unit += 1;
    }
    if unit == 0 { format!("{bytes} B") } else { format!("{value:.1} {}", UNITS[unit]) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_is_stated_per_primitive_and_readably() {
        assert_eq!(memory_of(1, 0, 0), 24);
        assert_eq!(memory_of(0, 1, 0), 16);
        assert_eq!(memory_of(0, 0, 1), 60);
        assert_eq!((as_size(999), as_size(5_600_000_000)), ("999 B".to_owned(), "5.6 GB".to_owned()));
    }
}
