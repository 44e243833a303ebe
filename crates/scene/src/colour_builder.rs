//! Adds colours to a scene under construction.

use super::builder::{Extent, SceneBuilder};
use super::colour_store::ColourMark;
use super::colours::{ColouredCubes, ColouredField, ColouredMesh, FieldPlace, NONE, SurfaceColour};
use super::text::{Source, shown};
use super::texture::{Texture, TextureError};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use vlscan_base::diag::Place;
use vlscan_base::files::reads;
use vlscan_survey::{MeshColours, TextureImage};

/// Memory for textures of a scene without a limit, bytes.
const MAX_TEXTURES: u64 = 1 << 36;

impl Extent {
    /// The numbers of primitives before the extent.
    pub fn colour_mark(&self) -> ColourMark {
        let Extent { triangles, cubes, fields, grids, .. } = self;
        ColourMark {
            triangles: triangles.start,
            fields: fields.start,
            cubes: cubes.start,
            grids: grids.start,
        }
    }
}

impl SceneBuilder<'_> {
    /// Adds the colours of the triangles since `start`, which have their materials: those of the materials,
    /// and `colours` of the triangles.
    pub fn add_colours(&mut self, start: usize, colours: MeshColours) {
        let triangles = start..self.geometry.triangles.len();
        if !self.options.colours || triangles.is_empty() {
            return;
        }
        let has_tints = !colours.tints.is_empty();
        let mut runs: Vec<(u32, u32)> = Vec::new();
        for (i, triangle) in (0..).zip(triangles.clone()) {
            let material = self.surfaces[self.triangle_surfaces[triangle] as usize].material;
            let number = self.palette_number(material);
            let number = if number == NONE && has_tints { self.colours.white() } else { number };
            if runs.last().is_none_or(|(_, last)| *last != number) {
                runs.push((i, number));
            }
        }
        if runs.iter().any(|(_, number)| *number != NONE) {
            self.colours.meshes.push(ColouredMesh { triangles, runs, colours });
        }
    }

    /// Adds the colour of the last height field, which is that of a material. A texture covers the `raster`,
    /// columns and rows of pixels, that the field is a part of.
    pub fn add_field_colour(&mut self, material: u32, raster: [usize; 2]) {
        if !self.options.colours {
            return;
        }
        let number = self.palette_number(material);
        if let Some(last) = self.geometry.fields.last()
            && number != NONE
        {
            let place = FieldPlace::of(last.grid(), raster);
            let field = self.geometry.fields.len() - 1;
            self.colours.fields.push(ColouredField { field, number, place });
        }
    }

    /// True if the material of a triangle, by its number in the scene, has the colours of a texture.
    pub fn is_textured(&self, triangle: usize) -> bool {
        self.has_texture(self.surfaces[self.triangle_surfaces[triangle] as usize].material)
    }

    /// True if surfaces of a material have the colours of a texture.
    pub fn has_texture(&self, material: u32) -> bool {
        let colour = self.library.colour_of(material).filter(|_| self.options.colours);
        colour.is_some_and(|(definition, _)| definition.texture.is_some())
    }

    /// Adds the colours of voxels, which are all of a grid or stored cubes.
    pub fn add_voxel_colours(&mut self, voxels: &Extent, colours: Vec<[u8; 3]>) {
        if colours.is_empty() {
            return;
        }
        match voxels.grids.is_empty() {
            true => self.colours.cubes.push(ColouredCubes { cubes: voxels.cubes.clone(), colours }),
            false => self.colours.add_grid(voxels.grids.start, colours),
        }
    }

    /// The number of the colour of a material in the palette, to which it is added if it is new.
    fn palette_number(&mut self, material: u32) -> u32 {
        match self.colours.numbers.get(&material) {
            Some(known) => *known,
            None => self.add_to_palette(material),
        }
    }

    /// Adds the colour of a material to the palette. Returns its number.
    fn add_to_palette(&mut self, material: u32) -> u32 {
        let number = match self.library.colour_of(material).cloned() {
            None => NONE,
            Some((definition, place)) => {
                let image = definition.texture.as_ref().map(|texture| texture.image.clone());
                let texture = image.and_then(|image| self.texture(&image, place.as_ref()));
                self.colours.palette.push(SurfaceColour { definition, texture });
                self.colours.palette.len() as u32 - 1
            }
        };
        self.colours.numbers.insert(material, number);
        number
    }

    /// A texture, which is read the first time; `None` after a warning.
    fn texture(&mut self, image: &TextureImage, place: Option<&Place>) -> Option<Arc<Texture>> {
        if let Some(known) = self.colours.textures.get(image) {
            return known.clone();
        }
        let free = match self.options.max_memory {
            Some(_) => self.free_memory(),
            None => MAX_TEXTURES,
        };
        let name = match image {
            TextureImage::File(_, name) => shown(name.as_bytes()),
            TextureImage::Bytes(path, _) => format!("within {}", path.display()),
        };
        let read = match image {
            TextureImage::Bytes(_, bytes) => Texture::decode(bytes, free),
            TextureImage::File(folder, name) => self.texture_file(folder, name, place, free),
        };
        let texture = match read {
            Ok(texture) => {
                self.colours.texture_bytes += texture.memory() as u64;
                Some(Arc::new(texture))
            }
            Err(error) => {
                let message = format!("cannot use the texture {name}: {error}");
                let help = "its surfaces have the colour of their material without it";
                self.diagnostics.warn(place.cloned(), message).help(help);
                None
            }
        };
        self.colours.textures.insert(image.clone(), texture.clone());
        texture
    }

    /// Reads a texture file. Programs write absolute names, also of other systems, so a file of the same name
    /// next to the referring file replaces a missing one, with a warning.
    fn texture_file(
        &mut self,
        folder: &Path,
        name: &str,
        place: Option<&Place>,
        free: u64,
    ) -> Result<Texture, TextureError> {
        let slashes = name.replace('\\', "/");
        let is_absolute = slashes.starts_with('/') || slashes.as_bytes().get(1) == Some(&b':');
        let relative = [name, slashes.as_str()].map(|name| folder.join(name));
        let sibling = folder.join(slashes.rsplit('/').next().unwrap_or_default());
        let named = relative.iter().filter(|_| !is_absolute).find(|path| reads::is_file(path));
        let path: PathBuf = match named {
            Some(path) => path.clone(),
            None if reads::is_file(&sibling) && slashes.contains('/') => {
                let message =
                    format!("there is no texture {}; {} is read", shown(name.as_bytes()), sibling.display());
                self.diagnostics.warn(place.cloned(), message);
                sibling
            }
            None => return Err(TextureError::Missing),
        };
        let source = Source::open(&path)?;
        self.sources.push(path);
        Texture::decode(source.bytes(), free)
    }
}
