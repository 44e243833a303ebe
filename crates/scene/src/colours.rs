//! Colours of surfaces as people see them: of materials, textures, corners of triangles, and voxels of
//! coloured points. Scenes have them if [`LoadOptions::colours`](super::LoadOptions::colours) is set. They
//! change no echo.

use super::texture::Texture;
use std::fmt;
use std::ops::Range;
use std::sync::Arc;
use vlscan_base::store::{Checksum, vec_bytes};
use vlscan_geom::DVec3;
use vlscan_survey::{ColourDefinition, MeshColours};
use vlscan_trace::PrimitiveRef;

/// Number of a missing colour.
pub(super) const NONE: u32 = u32::MAX;

/// The colours of a scene, see [`Scene::colour_at`](super::Scene::colour_at).
#[derive(Clone, Default)]
pub struct Colours {
    /// Distinct colours of materials.
    palette: Vec<SurfaceColour>,
    /// Colours of stored triangles, by their first ones.
    meshes: Vec<ColouredMesh>,
    /// Colours of the triangles of each model of instances.
    models: Vec<Vec<ColouredMesh>>,
    /// Colours of stored cubes, by their first ones.
    cubes: Vec<ColouredCubes>,
    /// Colours of the voxels of each grid; empty for grids without.
    grids: Vec<Vec<[u8; 3]>>,
}

/// The colour of a material, with its texture if that could be read.
#[derive(Clone)]
pub(super) struct SurfaceColour {
    pub definition: ColourDefinition,
    pub texture: Option<Arc<Texture>>,
}

/// Colours of consecutive triangles.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ColouredMesh {
    pub triangles: Range<usize>,
    /// Colours by their number in the palette, or [`NONE`], each with the triangle from which on it applies,
    /// counted within the range.
    pub runs: Vec<(u32, u32)>,
    pub colours: MeshColours,
}

/// Colours of consecutive cubes.
#[derive(Clone, Debug)]
pub(super) struct ColouredCubes {
    pub cubes: Range<usize>,
    pub colours: Vec<[u8; 3]>,
}

impl ColouredMesh {
    pub fn memory(&self) -> usize {
        vec_bytes(&self.runs) + vec_bytes(&self.colours.texels) + vec_bytes(&self.colours.tints)
    }

    /// Adds the colours to a checksum. The numbers in the palette and the names of files do not count.
    pub fn add_to(&self, palette: &[SurfaceColour], sum: &mut Checksum) {
        for (first, number) in &self.runs {
            sum.debug(first);
            if let Some(colour) = palette.get(*number as usize) {
                colour.add_to(sum);
            }
        }
        sum.array(&self.colours.texels);
        sum.array(&self.colours.tints);
    }

    /// Number of the colour of a triangle, counted within the range.
    fn number(&self, triangle: usize) -> u32 {
        let next = self.runs.partition_point(|(first, _)| *first as usize <= triangle);
        next.checked_sub(1).map_or(NONE, |run| self.runs[run].1)
    }
}

impl fmt::Debug for Colours {
    /// Numbers of colours and of ranges of triangles.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let (colours, meshes) = (self.palette.len(), self.meshes.len());
        f.debug_struct("Colours").field("palette", &colours).field("meshes", &meshes).finish_non_exhaustive()
    }
}

impl Colours {
    pub(super) fn new(
        palette: Vec<SurfaceColour>,
        (meshes, models): (Vec<ColouredMesh>, Vec<Vec<ColouredMesh>>),
        cubes: Vec<ColouredCubes>,
        grids: Vec<Vec<[u8; 3]>>,
    ) -> Colours {
        Colours { palette, meshes, models, cubes, grids }
    }

    /// Memory, bytes.
    pub(super) fn memory(&self) -> usize {
        let textures = self.palette.iter().filter_map(|colour| colour.texture.as_ref());
        let mut textures: Vec<&Arc<Texture>> = textures.collect();
        textures.sort_by_key(|texture| Arc::as_ptr(texture));
        textures.dedup_by_key(|texture| Arc::as_ptr(texture));
        let meshes = self.meshes.iter().chain(self.models.iter().flatten());
        textures.iter().map(|texture| texture.memory()).sum::<usize>()
            + meshes.map(ColouredMesh::memory).sum::<usize>()
            + self.cubes.iter().map(|of| vec_bytes(&of.colours)).sum::<usize>()
            + self.grids.iter().map(vec_bytes).sum::<usize>()
            + self.palette.capacity() * size_of::<SurfaceColour>()
    }

    /// Adds all colours to a checksum.
    pub(super) fn add_to(&self, sum: &mut Checksum) {
        for mesh in self.meshes.iter().chain(self.models.iter().flatten()) {
            sum.debug(&mesh.triangles);
            mesh.add_to(&self.palette, sum);
        }
        for of in &self.cubes {
            sum.debug(&of.cubes);
            sum.array(&of.colours);
        }
        self.grids.iter().for_each(|colours| sum.array(colours));
    }

    /// The colour of a voxel; black if it has none.
    pub(super) fn of_voxel(&self, primitive: PrimitiveRef) -> [u8; 3] {
        let found = match primitive {
            PrimitiveRef::Cube(index) => {
                find(&self.cubes, index, |of| &of.cubes).and_then(|of| of.colours.get(index - of.cubes.start))
            }
            PrimitiveRef::Grid { grid, voxel } => self.grids.get(grid).and_then(|of| of.get(voxel)),
            _ => None,
        };
        found.copied().unwrap_or_default()
    }

    /// The colour of stored triangle `index` at a point of it; black if it has none.
    pub(super) fn of_stored(&self, index: usize, corners: [DVec3; 3], at: DVec3) -> [u8; 3] {
        self.of_triangle(&self.meshes, index, weights(corners, at))
    }

    /// The colour of a triangle of a model of instances at a point of it; black if it has none.
    pub(super) fn of_model(&self, model: usize, index: usize, corners: [DVec3; 3], at: DVec3) -> [u8; 3] {
        let meshes = self.models.get(model);
        meshes.map_or([0; 3], |meshes| self.of_triangle(meshes, index, weights(corners, at)))
    }

    /// The colour of triangle `index` of `meshes` at a point, whose weights for the corners are `weights`;
    /// black if it has none.
    fn of_triangle(&self, meshes: &[ColouredMesh], index: usize, weights: [f64; 3]) -> [u8; 3] {
        let Some(mesh) = find(meshes, index, |of| &of.triangles) else { return [0; 3] };
        let triangle = index - mesh.triangles.start;
        let Some(colour) = self.palette.get(mesh.number(triangle) as usize) else { return [0; 3] };
        let texel =
            mesh.colours.texels.get(triangle).map(|corners| {
                [0, 1].map(|axis| (0..3).map(|i| weights[i] * f64::from(corners[i][axis])).sum())
            });
        let tint = mesh.colours.tints.get(triangle).map_or([1.0; 3], |corners| {
            [0, 1, 2].map(|c| (0..3).map(|i| weights[i] * f64::from(corners[i][c])).sum::<f64>() / 65_535.0)
        });
        colour.at(texel, tint)
    }
}

/// The element whose range contains `index`; ranges are in order.
fn find<T>(all: &[T], index: usize, range: impl Fn(&T) -> &Range<usize>) -> Option<&T> {
    let next = all.partition_point(|of| range(of).start <= index);
    all.get(next.checked_sub(1)?).filter(|of| range(of).contains(&index))
}

impl SurfaceColour {
    /// Adds the colour to a checksum, without the name of its texture.
    fn add_to(&self, sum: &mut Checksum) {
        let ColourDefinition { factor, is_linear, texture } = &self.definition;
        sum.debug(&(factor, is_linear));
        if let (Some(map), Some(image)) = (texture, &self.texture) {
            sum.debug(&(map.transform, map.wrap, map.is_upward, image.checksum()));
        }
    }

    /// The colour at texture coordinates, times the colour `tint` of the corners.
    fn at(&self, texel: Option<[f64; 2]>, tint: [f64; 3]) -> [u8; 3] {
        let ColourDefinition { factor, is_linear, texture } = &self.definition;
        let found = match (&self.texture, texture, texel) {
            (Some(image), Some(map), Some([u, v])) if !u.is_nan() && !v.is_nan() => {
                let (linear, offset) = map.transform;
                let moved = [0, 1].map(|i| linear[i][0] * u + linear[i][1] * v + offset[i]);
                image.nearest(moved, map.wrap, map.is_upward)
            }
            _ => [255; 3],
        };
        [0, 1, 2].map(|c| {
            let stored = f64::from(found[c]) / 255.0;
            let value = match is_linear {
                true => encode(decode(stored) * factor[c] * tint[c]),
                false => stored * factor[c] * tint[c],
            };
            // The conversion saturates, and NaN becomes 0.
            (value * 255.0).round() as u8
        })
    }
}

/// Linear light of a value of sRGB (IEC 61966-2-1), both 0 to 1.
fn decode(stored: f64) -> f64 {
    if stored <= 0.04045 { stored / 12.92 } else { libm::pow((stored + 0.055) / 1.055, 2.4) }
}

/// The value of sRGB of linear light, both 0 to 1.
fn encode(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * libm::pow(linear, 1.0 / 2.4) - 0.055 }
}

/// Weights of the corners of a triangle at a point of it; those of the first corner if it has no area.
fn weights([a, b, c]: [DVec3; 3], at: DVec3) -> [f64; 3] {
    let normal = (b - a).cross(c - a);
    let of_b = (at - a).cross(c - a).dot(normal) / normal.dot(normal);
    let of_c = (b - a).cross(at - a).dot(normal) / normal.dot(normal);
    if !of_b.is_finite() || !of_c.is_finite() {
        return [1.0, 0.0, 0.0];
    }
    let of_b = of_b.clamp(0.0, 1.0);
    let of_c = of_c.clamp(0.0, 1.0 - of_b);
    [1.0 - of_b - of_c, of_b, of_c]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::texture::tests::png_of;
    use std::path::PathBuf;
    use vlscan_survey::{TextureDefinition, TextureImage, TextureWrap};

    fn colour(texel: u8, factor: f64, is_linear: bool) -> [u8; 3] {
        let texture = TextureDefinition {
            image: TextureImage::File(PathBuf::new(), String::new()),
            transform: TextureDefinition::IDENTITY,
            wrap: [TextureWrap::Repeat; 2],
            is_upward: false,
        };
        let definition = ColourDefinition { factor: [factor; 3], is_linear, texture: Some(texture) };
        let image = Texture::decode(&png_of(1, 1, &[texel; 3]), 1 << 20).unwrap();
        SurfaceColour { definition, texture: Some(Arc::new(image)) }.at(Some([0.5, 0.5]), [1.0; 3])
    }

    #[test]
    fn factors_are_linear_and_texels_are_not() {
        // Worked with the definition of sRGB by another program.
        for (texel, factor, expected) in [(200, 0.5, 146), (128, 1.0, 128), (255, 0.25, 137)] {
            assert_eq!(colour(texel, factor, true), [expected; 3], "{texel} {factor}");
        }
        assert_eq!(colour(200, 0.5, false), [100; 3]);
        for texel in 0..=255 {
            assert_eq!([colour(texel, 1.0, true), colour(texel, 1.0, false)], [[texel; 3]; 2]);
        }
    }

    #[test]
    fn runs_and_ranges_are_found_by_any_index() {
        let mesh = |triangles: Range<usize>, runs: &[(u32, u32)]| ColouredMesh {
            triangles,
            runs: runs.to_vec(),
            colours: MeshColours::default(),
        };
        let all = [mesh(2..5, &[(0, 7), (2, NONE)]), mesh(5..6, &[(0, 1)]), mesh(9..10, &[])];
        let number =
            |index| find(&all, index, |of| &of.triangles).map(|m| m.number(index - m.triangles.start));
        let found: Vec<_> = (0..11).map(number).collect();
        let none = Some(NONE);
        assert_eq!(found, [None, None, Some(7), Some(7), none, Some(1), None, None, None, none, None]);
    }

    #[test]
    fn corners_weigh_by_their_distance() {
        let corners = [DVec3::new(1.0, 0.0, 2.0), DVec3::new(5.0, 0.0, 2.0), DVec3::new(1.0, 2.0, 2.0)];
        assert_eq!(weights(corners, corners[1]), [0.0, 1.0, 0.0]);
        assert_eq!(weights(corners, DVec3::new(2.0, 0.5, 2.0)), [0.5, 0.25, 0.25]);
        assert_eq!(weights(corners, DVec3::new(9.0, 0.0, 2.0)), [0.0, 1.0, 0.0], "beyond a corner");
        for flat in [[DVec3::ONE; 3], corners.map(|corner| corner * 1e-100)] {
            assert_eq!(weights(flat, DVec3::ONE), [1.0, 0.0, 0.0], "without area");
        }
    }
}
