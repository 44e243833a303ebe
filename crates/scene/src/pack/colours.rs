//! Colours of a packed scene as arrays and values of its file.

use crate::colours::{ColouredCubes, ColouredField, ColouredMesh, Colours, SurfaceColour};
use crate::texture::Texture;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;
use vlscan_base::error::Result;
use vlscan_base::store::{ArrayFile, ArrayFileWriter};
use vlscan_survey::{ColourDefinition, MeshColours, TextureDefinition, TextureImage, TextureWrap};

/// Beginning of the names of the arrays of colours, after the prefix of a scene.
const NAME: &str = "colours";

/// The colours of a scene without their arrays. Values are stored in the order of the fields.
#[derive(Serialize, Deserialize)]
struct ColourValues {
    palette: Vec<StoredColour>,
    /// Columns and rows of each image.
    images: Vec<[u32; 2]>,
    meshes: Vec<StoredMesh>,
    models: Vec<Vec<StoredMesh>>,
    fields: Vec<ColouredField>,
    cubes: Vec<Range<usize>>,
    /// Number of grids.
    grids: usize,
}

/// A colour of a material.
#[derive(Serialize, Deserialize)]
struct StoredColour {
    factor: [f64; 3],
    is_linear: bool,
    texture: Option<StoredTexture>,
}

/// A texture of a colour.
#[derive(Serialize, Deserialize)]
struct StoredTexture {
    /// Index of the image.
    image: usize,
    transform: ([[f64; 2]; 2], [f64; 2]),
    /// Rules for coordinates outside of the image: 0 repeat, 1 mirror, 2 clamp.
    wrap: [u8; 2],
    is_upward: bool,
}

/// Colours of consecutive triangles without their arrays.
#[derive(Serialize, Deserialize)]
struct StoredMesh {
    triangles: Range<usize>,
    runs: Vec<(u32, u32)>,
}

/// True if an array is one of colours, by its name without the prefix of the scene.
pub(super) fn is_of_colours(name: &str) -> bool {
    name.starts_with(NAME)
}

/// True if the scene whose arrays begin with `prefix` was packed with colours, as far as it has any.
pub(super) fn has_colours(file: &ArrayFile, prefix: &str) -> bool {
    file.element(&format!("{prefix}{NAME}")).is_some()
}

/// Writes colours under names that begin with `prefix`.
///
/// # Errors
/// As for [`ArrayFileWriter::array`].
pub(super) fn write_colours(colours: &Colours, prefix: &str, out: &mut ArrayFileWriter) -> Result<()> {
    let name = |what: &str, i: usize| format!("{prefix}{NAME} {what} {i}");
    let mut images: Vec<&Arc<Texture>> = Vec::new();
    let palette = colours.palette.iter().map(|colour| StoredColour::of(colour, &mut images)).collect();
    let stored = |meshes: &[ColouredMesh]| meshes.iter().map(StoredMesh::of).collect::<Vec<_>>();
    let values = ColourValues {
        palette,
        images: images.iter().map(|image| image.size()).collect(),
        meshes: stored(&colours.meshes),
        models: colours.models.iter().map(|meshes| stored(meshes)).collect(),
        fields: colours.fields.clone(),
        cubes: colours.cubes.iter().map(|of| of.cubes.clone()).collect(),
        grids: colours.grids.len(),
    };
    out.value(format!("{prefix}{NAME}"), &values)?;
    for (i, image) in images.into_iter().enumerate() {
        out.array(name("image", i), image.texels())?;
    }
    for (i, mesh) in colours.meshes.iter().chain(colours.models.iter().flatten()).enumerate() {
        out.array(name("texels", i), &mesh.colours.texels)?;
        out.array(name("tints", i), &mesh.colours.tints)?;
    }
    for (i, of) in colours.cubes.iter().enumerate() {
        out.array(name("cubes", i), &of.colours)?;
    }
    for (i, grid) in colours.grids.iter().enumerate() {
        out.array(name("grid", i), grid)?;
    }
    Ok(())
}

/// Reads the colours of [`write_colours`]; none of a scene that was packed without.
///
/// # Errors
/// As for [`ArrayFile::array`].
pub(super) fn read_colours(file: &ArrayFile, prefix: &str) -> Result<Colours> {
    if !has_colours(file, prefix) {
        return Ok(Colours::default());
    }
    let name = |what: &str, i: usize| format!("{prefix}{NAME} {what} {i}");
    let differs = || file.refuse("the lengths of its arrays do not match");
    let values: ColourValues = file.value(&format!("{prefix}{NAME}"))?;
    let image = |(i, size): (usize, &[u32; 2])| {
        let image = Texture::of_texels(*size, file.array(&name("image", i))?);
        image.map(Arc::new).ok_or_else(differs)
    };
    let images = values.images.iter().enumerate().map(image).collect::<Result<Vec<_>>>()?;
    let palette = values.palette.into_iter().map(|colour| colour.surface_colour(&images));
    let palette = palette.collect::<Option<Vec<_>>>().ok_or_else(differs)?;
    let mut read = 0;
    let mut mesh = |StoredMesh { triangles, runs }: StoredMesh| {
        let (texels, tints) = (file.array(&name("texels", read))?, file.array(&name("tints", read))?);
        read += 1;
        let colours = MeshColours { texels, tints };
        let fits = |length: usize| length == 0 || length == triangles.len();
        match fits(colours.texels.len()) && fits(colours.tints.len()) {
            true => Ok(ColouredMesh { triangles, runs, colours }),
            false => Err(differs()),
        }
    };
    let meshes = values.meshes.into_iter().map(&mut mesh).collect::<Result<Vec<_>>>()?;
    let of_model = |meshes: Vec<StoredMesh>| meshes.into_iter().map(&mut mesh).collect::<Result<Vec<_>>>();
    let models = values.models.into_iter().map(of_model).collect::<Result<Vec<_>>>()?;
    let of_cubes = |(i, cubes): (usize, Range<usize>)| {
        let colours: Vec<[u8; 3]> = file.array(&name("cubes", i))?;
        match colours.len() == cubes.len() {
            true => Ok(ColouredCubes { cubes, colours }),
            false => Err(differs()),
        }
    };
    let cubes = values.cubes.into_iter().enumerate().map(of_cubes).collect::<Result<Vec<_>>>()?;
    let grids = (0..values.grids).map(|i| file.array(&name("grid", i))).collect::<Result<Vec<_>>>()?;
    Ok(Colours { palette, meshes, models, fields: values.fields, cubes, grids })
}

impl StoredColour {
    /// The stored form of a colour, whose image is added to `images` if it is new. Without an image there is
    /// no texture.
    fn of<'c>(colour: &'c SurfaceColour, images: &mut Vec<&'c Arc<Texture>>) -> StoredColour {
        let ColourDefinition { factor, is_linear, texture } = &colour.definition;
        let texture = texture.as_ref().zip(colour.texture.as_ref()).map(|(map, texture)| {
            let known = images.iter().position(|image| Arc::ptr_eq(image, texture));
            let image = known.unwrap_or_else(|| {
                images.push(texture);
                images.len() - 1
            });
            let (transform, is_upward) = (map.transform, map.is_upward);
            StoredTexture { image, transform, wrap: map.wrap.map(number_of), is_upward }
        });
        StoredColour { factor: *factor, is_linear: *is_linear, texture }
    }

    /// The colour; `None` if its image or a rule does not exist.
    fn surface_colour(self, images: &[Arc<Texture>]) -> Option<SurfaceColour> {
        let StoredColour { factor, is_linear, texture } = self;
        let Some(StoredTexture { image, transform, wrap: [u, v], is_upward }) = texture else {
            let definition = ColourDefinition { factor, is_linear, texture: None };
            return Some(SurfaceColour { definition, texture: None });
        };
        let texture = Some(images.get(image)?.clone());
        let wrap = [wrap_of(u)?, wrap_of(v)?];
        // The name is not needed: the image is stored.
        let image = TextureImage::File(PathBuf::new(), String::new());
        let map = TextureDefinition { image, transform, wrap, is_upward };
        Some(SurfaceColour {
            definition: ColourDefinition { factor, is_linear, texture: Some(map) },
            texture,
        })
    }
}

impl StoredMesh {
    fn of(mesh: &ColouredMesh) -> StoredMesh {
        StoredMesh { triangles: mesh.triangles.clone(), runs: mesh.runs.clone() }
    }
}

fn number_of(wrap: TextureWrap) -> u8 {
    match wrap {
        TextureWrap::Repeat => 0,
        TextureWrap::Mirror => 1,
        TextureWrap::Clamp => 2,
    }
}

fn wrap_of(number: u8) -> Option<TextureWrap> {
    [TextureWrap::Repeat, TextureWrap::Mirror, TextureWrap::Clamp].get(usize::from(number)).copied()
}
