//! Colours of surfaces as people see them: of materials, textures, corners of triangles, rasters, and voxels
//! of coloured points. Scenes have them if [`LoadOptions::colours`](super::LoadOptions::colours) is set. They
//! change no echo.

use super::texture::Texture;
use std::fmt;
use std::ops::Range;
use std::sync::Arc;
use vlscan_base::store::{Checksum, vec_bytes};
use vlscan_geom::DVec3;
use vlscan_survey::{ColourDefinition, MeshColours};
use vlscan_trace::{HeightGrid, PrimitiveRef};

/// Number of a missing colour.
pub(super) const NONE: u32 = u32::MAX;

/// The colours of a scene, see [`Scene::colour_at`](super::Scene::colour_at).
#[derive(Clone, Default)]
pub struct Colours {
    /// Distinct colours of materials.
    pub(super) palette: Vec<SurfaceColour>,
    /// Colours of stored triangles, by their first ones.
    pub(super) meshes: Vec<ColouredMesh>,
    /// Colours of the triangles of each model of instances.
    pub(super) models: Vec<Vec<ColouredMesh>>,
    /// Colours of height fields, in their order.
    pub(super) fields: Vec<ColouredField>,
    /// Colours of stored cubes, by their first ones.
    pub(super) cubes: Vec<ColouredCubes>,
    /// Colours of the voxels of each grid; empty for grids without.
    pub(super) grids: Vec<Vec<[u8; 3]>>,
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
    /// Colours by their number in the palette, or [`NONE`], each with the first triangle to which it applies,
    /// counted within the range.
    pub runs: Vec<(u32, u32)>,
    pub colours: MeshColours,
}

/// The colour of a height field.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(super) struct ColouredField {
    /// Index of the field.
    pub field: usize,
    /// Number of the colour in the palette.
    pub number: u32,
    pub place: FieldPlace,
}

/// The place of a height field in the raster that a texture covers.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(super) struct FieldPlace {
    /// Cells per row of the field.
    pub cells: usize,
    /// Column and row of its first pixel in the raster.
    pub first: [usize; 2],
    /// Columns and rows of the raster.
    pub raster: [usize; 2],
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

impl FieldPlace {
    /// The place of a field with this grid in a raster of these columns and rows.
    pub fn of(grid: &HeightGrid, raster: [usize; 2]) -> FieldPlace {
        FieldPlace { cells: grid.columns.saturating_sub(1), first: grid.first, raster }
    }

    /// Texture coordinates of the corners of triangle `i` of the field, in the order of its corners.
    fn texels(&self, i: usize) -> [[f32; 2]; 3] {
        let (cell, cells) = (i / 2, self.cells.max(1));
        // Places of packed scenes may be damaged.
        let pixel = |axis: usize, offset: usize| self.first[axis].saturating_add(offset);
        let of = |below: usize, right: usize| {
            raster_texel([pixel(0, cell % cells + right), pixel(1, cell / cells + below)], self.raster)
        };
        match i.is_multiple_of(2) {
            true => [of(0, 0), of(1, 0), of(0, 1)],
            false => [of(1, 0), of(1, 1), of(0, 1)],
        }
    }
}

/// Texture coordinates of the centre of a pixel of a raster, by column and row from the upper left corner.
/// The texture covers the raster; its second coordinate counts from the lower edge, as in MTL files.
pub(super) fn raster_texel([column, row]: [usize; 2], [columns, rows]: [usize; 2]) -> [f32; 2] {
    let u = (column as f64 + 0.5) / columns as f64;
    let v = 1.0 - (row as f64 + 0.5) / rows as f64;
    [u as f32, v as f32]
}

impl fmt::Debug for Colours {
    /// Numbers of colours and of ranges of triangles.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let (colours, meshes) = (self.palette.len(), self.meshes.len());
        f.debug_struct("Colours").field("palette", &colours).field("meshes", &meshes).finish_non_exhaustive()
    }
}

impl Colours {
    /// The colours of a scene that is one height field with this grid, without a texture.
    pub(super) fn of_page(definition: ColourDefinition, grid: &HeightGrid) -> Colours {
        let place = FieldPlace::of(grid, [grid.columns, grid.rows]);
        Colours {
            palette: vec![SurfaceColour { definition, texture: None }],
            fields: vec![ColouredField { field: 0, number: 0, place }],
            ..Colours::default()
        }
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
            + vec_bytes(&self.fields)
    }

    /// Adds all colours to a checksum.
    pub(super) fn add_to(&self, sum: &mut Checksum) {
        for mesh in self.meshes.iter().chain(self.models.iter().flatten()) {
            sum.debug(&mesh.triangles);
            mesh.add_to(&self.palette, sum);
        }
        for of in &self.fields {
            sum.debug(&(of.field, of.place));
            if let Some(colour) = self.palette.get(of.number as usize) {
                colour.add_to(sum);
            }
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

    /// The colour of a triangle of height field `field` at a point of it; black if it has none.
    pub(super) fn of_field(&self, field: usize, index: usize, corners: [DVec3; 3], at: DVec3) -> [u8; 3] {
        let found = self.fields.binary_search_by_key(&field, |of| of.field);
        let Some(of) = found.ok().map(|i| &self.fields[i]) else { return [0; 3] };
        let Some(colour) = self.palette.get(of.number as usize) else { return [0; 3] };
        let texel = mean(of.place.texels(index), weights(corners, at));
        colour.at(Some(texel), [1.0; 3])
    }

    /// The colour of triangle `index` of `meshes` at a point, whose weights for the corners are `weights`;
    /// black if it has none.
    fn of_triangle(&self, meshes: &[ColouredMesh], index: usize, weights: [f64; 3]) -> [u8; 3] {
        let Some(mesh) = find(meshes, index, |of| &of.triangles) else { return [0; 3] };
        let triangle = index - mesh.triangles.start;
        let Some(colour) = self.palette.get(mesh.number(triangle) as usize) else { return [0; 3] };
        let texel = mesh.colours.texels.get(triangle).map(|corners| mean(*corners, weights));
        let tint = mesh.colours.tints.get(triangle).map_or([1.0; 3], |corners| {
            [0, 1, 2].map(|c| (0..3).map(|i| weights[i] * f64::from(corners[i][c])).sum::<f64>() / 65_535.0)
        });
        colour.at(texel, tint)
    }
}

/// The mean of the texture coordinates of corners with these weights.
fn mean(corners: [[f32; 2]; 3], weights: [f64; 3]) -> [f64; 2] {
    [0, 1].map(|axis| (0..3).map(|i| weights[i] * f64::from(corners[i][axis])).sum())
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
    fn textures_cover_all_pixels_of_a_raster() {
        // The second of two pages of a raster of 5 by 4 pixels, from column 2 on.
        let grid = HeightGrid { first: [2, 0], ..HeightGrid::new(3, 4) };
        let place = FieldPlace::of(&grid, [5, 4]);
        let of = |column: f32, row: f32| [(column + 0.5) / 5.0, 1.0 - (row + 0.5) / 4.0];
        // Cell 3 is the second of the second row.
        let expected =
            [[of(3.0, 1.0), of(3.0, 2.0), of(4.0, 1.0)], [of(3.0, 2.0), of(4.0, 2.0), of(4.0, 1.0)]];
        for (triangle, expected) in [6, 7].into_iter().zip(expected) {
            for (found, expected) in
                place.texels(triangle).into_iter().flatten().zip(expected.into_iter().flatten())
            {
                assert!((found - expected).abs() < 1e-6, "{triangle}: {found} {expected}");
            }
        }
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
