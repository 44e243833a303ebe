//! Meshes and materials in memory.

use super::Identity;
use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;
use vlscan_base::diag::Place;
use vlscan_base::error::{Error, Result};
use vlscan_geom::{DVec3, MAX_COORDINATE};

/// A triangle mesh in memory, with materials.
#[derive(Clone, Debug)]
pub struct Mesh {
    identity: Identity,
    vertices: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    materials: Vec<MaterialDefinition>,
    material_of: Vec<u32>,
    name: String,
    colours: MeshColours,
}

/// Colours of the triangles of a mesh in addition to those of its materials. Either list is empty or has an
/// entry for each triangle.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeshColours {
    /// Texture coordinates of the corners.
    pub texels: Vec<[[f32; 2]; 3]>,
    /// Colours of the corners, which multiply that of the material; 65535 is 1.
    pub tints: Vec<[[u16; 3]; 3]>,
}

impl Mesh {
    /// A mesh of `vertices` (m) and `triangles` (indices of vertices). `material_of` holds the index of each
    /// triangle's material; if it is empty all triangles have the first one. Without materials the mesh has
    /// the default one.
    ///
    /// # Errors
    /// [`Error::Input`] for indices out of range, and for coordinates that are not finite or too large.
    pub fn new(
        vertices: Vec<DVec3>,
        triangles: Vec<[u32; 3]>,
        materials: Vec<MaterialDefinition>,
        material_of: Vec<u32>,
    ) -> Result<Mesh> {
        let wrong = |v: &DVec3| v.is_nan() || v.abs().max_element() > MAX_COORDINATE;
        if let Some(at) = vertices.iter().position(wrong) {
            let [x, y, z] = vertices[at].to_array().map(|c| match c.abs() > MAX_COORDINATE {
                true => format!("{c:e}"),
                false => c.to_string(),
            });
            return Err(Error::input(format!(
                "vertex {at} is at {x}, {y}, {z}; expected finite numbers within ±{MAX_COORDINATE:e} m"
            )));
        }
        let count = vertices.len();
        if let Some(at) = triangles.iter().position(|t| t.iter().any(|&v| v as usize >= count)) {
            let [a, b, c] = triangles[at];
            return Err(Error::input(format!(
                "triangle {at} has the vertices {a}, {b}, {c}; there are {count}"
            )));
        }
        if !material_of.is_empty() && material_of.len() != triangles.len() {
            return Err(Error::input(format!(
                "there are {} indices of materials for {} triangles",
                material_of.len(),
                triangles.len()
            )));
        }
        if let Some(at) = material_of.iter().position(|&m| m as usize >= materials.len()) {
            let (index, count) = (material_of[at], materials.len());
            return Err(Error::input(format!("triangle {at} has material {index}; there are {count}")));
        }
        Ok(Mesh {
            identity: Identity::new(),
            vertices,
            triangles,
            materials,
            material_of,
            name: String::new(),
            colours: MeshColours::default(),
        })
    }

    /// The mesh with colours of its triangles.
    ///
    /// # Errors
    /// [`Error::Input`] if their number differs from the number of triangles.
    pub fn with_colours(self, colours: MeshColours) -> Result<Mesh> {
        let count = self.triangles.len();
        for found in [colours.texels.len(), colours.tints.len()] {
            if found != 0 && found != count {
                return Err(Error::input(format!(
                    "there are colours of {found} triangles, expected {count}"
                )));
            }
        }
        Ok(Mesh { colours, ..self })
    }

    /// Colours of its triangles.
    pub fn colours(&self) -> &MeshColours {
        &self.colours
    }

    /// Its identity, which its clones share.
    pub fn identity(&self) -> Identity {
        self.identity
    }

    /// The mesh with a name, which its part reports.
    pub fn with_name(self, name: String) -> Mesh {
        Mesh { name, ..self }
    }

    /// Its name; empty unless it has been given one.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Vertices, m.
    pub fn vertices(&self) -> &[DVec3] {
        &self.vertices
    }

    /// Indices of the vertices of each triangle.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// The materials.
    pub fn materials(&self) -> &[MaterialDefinition] {
        &self.materials
    }

    /// Index of the material of each triangle; empty if all have the first one.
    pub fn material_of(&self) -> &[u32] {
        &self.material_of
    }
}

/// The definition of a material in a file or by a program.
#[derive(Clone, PartialEq)]
pub struct MaterialDefinition {
    /// Name; the first word after `newmtl`.
    pub name: String,
    /// Diffuse colour.
    pub kd: [f64; 3],
    /// Specular colour.
    pub ks: [f64; 3],
    /// Specular exponent.
    pub ns: f64,
    /// Roughness of the surface (`vlscan_roughness_deg`), rad.
    pub roughness: f64,
    /// Size of the elements of foliage that intercept light as a whole (`vlscan_element_size_m`), m; 0:
    /// leaves are much smaller than footprints.
    pub element_size: f64,
    /// Reflectance, 0 to 1 (`helios_reflectance`).
    pub reflectance: Option<f64>,
    /// Name of a spectrum (`helios_spectra`).
    pub spectrum: Option<String>,
    /// Class of points (`helios_classification`).
    pub classification: i32,
    /// True if the surface is ground (`helios_isGround`).
    pub is_ground: bool,
    /// True for leaves (`vlscan_leaf`); `None` if the definition does not state it.
    pub leaf: Option<bool>,
    /// Mirror, pane, retro-reflector or water that the surface is.
    pub optics: OpticsDefinition,
    /// Colour; `None` if the definition states none.
    pub colour: Option<ColourDefinition>,
    /// Transparency and mirror reflection as file formats for pictures state them.
    pub unused_optics: Option<UnusedOptics>,
    /// Place of the definition; `None` outside of files.
    pub place: Option<Place>,
}

impl fmt::Debug for MaterialDefinition {
    /// Checksums of scenes include this text, so opaque materials have no field `optics`.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        // Checksums would miss a field that is not named.
        let MaterialDefinition {
            name,
            kd,
            ks,
            ns,
            roughness,
            element_size,
            reflectance,
            spectrum,
            classification,
            is_ground,
            leaf,
            optics,
            colour,
            unused_optics,
            place,
        } = self;
        let mut fields = f.debug_struct("MaterialDefinition");
        fields
            .field("name", name)
            .field("kd", kd)
            .field("ks", ks)
            .field("ns", ns)
            .field("roughness", roughness)
            .field("element_size", element_size)
            .field("reflectance", reflectance)
            .field("spectrum", spectrum)
            .field("classification", classification)
            .field("is_ground", is_ground)
            .field("leaf", leaf);
        if *optics != OpticsDefinition::default() {
            fields.field("optics", optics);
        }
        if let Some(colour) = colour {
            fields.field("colour", colour);
        }
        fields.field("unused_optics", unused_optics).field("place", place).finish()
    }
}

/// The colour of a material as its definition states it. It does not change what a scanner measures.
#[derive(Clone, Debug, PartialEq)]
pub struct ColourDefinition {
    /// Red, green and blue, 0 to 1, which multiply those of the texture.
    pub factor: [f64; 3],
    /// True if `factor` and the colours of corners are linear, as in glTF: texels are decoded from sRGB
    /// before they are multiplied. Otherwise all are multiplied as they are stored.
    pub is_linear: bool,
    /// Texture.
    pub texture: Option<TextureDefinition>,
}

impl ColourDefinition {
    /// A colour whose numbers are multiplied as they are stored.
    pub fn stored(factor: [f64; 3]) -> ColourDefinition {
        ColourDefinition { factor, is_linear: false, texture: None }
    }
}

/// A texture of a material, and how texture coordinates find their texel.
#[derive(Clone, Debug, PartialEq)]
pub struct TextureDefinition {
    /// Image.
    pub image: TextureImage,
    /// Linear map of texture coordinates, by rows, and the offset that is added to its result.
    pub transform: ([[f64; 2]; 2], [f64; 2]),
    /// Meaning of texture coordinates outside of 0 to 1, along either axis.
    pub wrap: [TextureWrap; 2],
    /// True if the second coordinate counts from the lower edge of the image, as in OBJ.
    pub is_upward: bool,
}

impl TextureDefinition {
    /// The transform that changes no coordinates.
    pub const IDENTITY: ([[f64; 2]; 2], [f64; 2]) = ([[1.0, 0.0], [0.0, 1.0]], [0.0; 2]);
}

/// The image of a texture: PNG or JPEG.
#[derive(Clone, PartialEq, Eq, Hash)]
pub enum TextureImage {
    /// A file, by the folder of the file that names it and the name there.
    File(PathBuf, String),
    /// The bytes of such a file, and the file that they are part of.
    Bytes(PathBuf, Arc<[u8]>),
}

impl fmt::Debug for TextureImage {
    /// The bytes are counted, not shown.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            TextureImage::File(folder, name) => f.debug_tuple("File").field(folder).field(name).finish(),
            TextureImage::Bytes(path, bytes) => {
                f.debug_tuple("Bytes").field(path).field(&bytes.len()).finish()
            }
        }
    }
}

/// Texels for texture coordinates outside of 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TextureWrap {
    /// The image is repeated.
    #[default]
    Repeat,
    /// Every second repetition is mirrored.
    Mirror,
    /// The texels of the edge.
    Clamp,
}

/// Properties of a material that mean transparency or mirror reflection. Its surfaces are opaque unless
/// `meaning` is given and the physics is refined.
#[derive(Clone, Debug, PartialEq)]
pub struct UnusedOptics {
    /// Names and values as in the file, for a message: `d 0.05, illum 4`.
    pub properties: String,
    /// The first of them; `None` if only the file is known.
    pub place: Option<Place>,
    /// The mirror or pane that the properties describe; `None` for textures and filters, which have no
    /// effect.
    pub meaning: Option<OpticsDefinition>,
}

/// Optical properties of a material as its definition states them.
#[derive(Clone, Copy, Default, PartialEq)]
pub struct OpticsDefinition {
    /// Share of the light that a mirror reflects (`vlscan_mirror`), 0 to 1.
    pub mirror: Option<f64>,
    /// Refractive index of a pane (`vlscan_pane_index`), 1 to 5.
    pub index: Option<f64>,
    /// Thickness of each sheet of a pane (`vlscan_pane_thickness_m`), m.
    pub thickness: Option<f64>,
    /// Absorption within a pane (`vlscan_pane_absorption`), 1/m.
    pub absorption: Option<f64>,
    /// Number of sheets of a pane (`vlscan_pane_sheets`), 1 or 2.
    pub sheets: Option<u32>,
    /// Coefficient R_A of a retro-reflector (`vlscan_retro`), cd/(lx·m²).
    pub retro: Option<f64>,
    /// Share of a mirror or pane that is opaque (`d` of an MTL file), 0 to 1.
    pub opacity: Option<f64>,
    /// Water whose surface it is.
    pub water: WaterDefinition,
}

impl fmt::Debug for OpticsDefinition {
    /// Checksums of scenes include this text, so mirrors and panes have no field `water`.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        // Checksums would miss a field that is not named.
        let OpticsDefinition { mirror, index, thickness, absorption, sheets, retro, opacity, water } = self;
        let mut fields = f.debug_struct("OpticsDefinition");
        fields
            .field("mirror", mirror)
            .field("index", index)
            .field("thickness", thickness)
            .field("absorption", absorption)
            .field("sheets", sheets)
            .field("retro", retro)
            .field("opacity", opacity);
        if water.is_water() {
            fields.field("water", water);
        }
        fields.finish()
    }
}

/// Properties of water as the definition of its surface states them. Water has at least one of them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WaterDefinition {
    /// Refractive index in air (`vlscan_water_index`), 1 to 5.
    pub index: Option<f64>,
    /// Group index in vacuum (`vlscan_water_group_index`), 1 to 5.
    pub group_index: Option<f64>,
    /// Diffuse attenuation K (`vlscan_water_attenuation`), 1/m.
    pub attenuation: Option<f64>,
    /// Secchi depth (`vlscan_water_secchi_m`), m, instead of the attenuation.
    pub secchi: Option<f64>,
    /// Attenuation c of a narrow beam (`vlscan_water_beam_attenuation`), 1/m.
    pub beam_attenuation: Option<f64>,
    /// Volume scattering function at 180° (`vlscan_water_backscatter`), 1/(m·sr).
    pub backscatter: Option<f64>,
    /// Wind speed at 12.5 m (`vlscan_water_wind_m_s`), m/s.
    pub wind: Option<f64>,
    /// Direction of the wind, clockwise from north (`vlscan_water_wind_deg`), degrees.
    pub wind_direction: Option<f64>,
}

impl WaterDefinition {
    /// Refractive index of fresh water of 20 °C at 532 nm, in air (Quan and Fry, 1995).
    pub const FRESH_INDEX: f64 = 1.335035;

    /// True if a property of water is given.
    pub fn is_water(&self) -> bool {
        *self != WaterDefinition::default()
    }
}

impl OpticsDefinition {
    /// True if a property of a pane is given.
    pub fn is_pane(&self) -> bool {
        self.index.is_some() || self.thickness.is_some() || self.absorption.is_some() || self.sheets.is_some()
    }

    /// True if the surface is a mirror, a pane or water.
    pub fn is_optical(&self) -> bool {
        self.mirror.is_some() || self.is_pane() || self.water.is_water()
    }

    /// True if no share of a mirror or pane is opaque, so that a missing reflectance is 0.
    pub fn is_clean(&self) -> bool {
        self.opacity.is_none_or(|opacity| opacity == 0.0)
    }
}

impl MaterialDefinition {
    /// A material without properties.
    pub fn new(name: impl Into<String>) -> MaterialDefinition {
        MaterialDefinition {
            name: name.into(),
            kd: [0.0; 3],
            ks: [0.0; 3],
            ns: 10.0,
            roughness: 0.0,
            element_size: 0.0,
            reflectance: None,
            spectrum: None,
            classification: 0,
            is_ground: false,
            leaf: None,
            optics: OpticsDefinition::default(),
            colour: None,
            unused_optics: None,
            place: None,
        }
    }

    /// Bare soil: ground of class 2 that reflects 30 %.
    pub fn soil() -> MaterialDefinition {
        MaterialDefinition {
            kd: [0.42, 0.34, 0.25],
            reflectance: Some(0.3),
            classification: 2,
            is_ground: true,
            ..MaterialDefinition::new("soil")
        }
    }

    /// True if the line of its definition is known.
    pub fn has_line(&self) -> bool {
        self.place.as_ref().is_some_and(|place| place.line > 0)
    }
}

/// A material that replaces others of a part.
#[derive(Clone, Debug, PartialEq)]
pub struct MaterialChange {
    /// The primitives that get it.
    pub replaced: Replaced,
    /// The material.
    pub material: MaterialDefinition,
}

/// Primitives of a part.
#[derive(Clone, Debug, PartialEq)]
pub enum Replaced {
    /// All.
    All,
    /// Primitives whose material has this name.
    Named(String),
    /// Primitives of the faces with these indices within the part, as its file or its mesh has them; voxels
    /// follow them. An index beyond is an error.
    Faces(Vec<u32>),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_and_coordinates_are_checked() {
        let square = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let material = || vec![MaterialDefinition::new("bark")];
        let of = |vertices: &[DVec3], triangle: [u32; 3], of: &[u32]| {
            Mesh::new(vertices.to_vec(), vec![triangle], material(), of.to_vec()).map_err(|e| e.to_string())
        };
        assert!(of(&square, [0, 1, 2], &[0]).is_ok() && of(&square, [0, 1, 2], &[]).is_ok());
        assert!(of(&square, [0, 1, 3], &[]).unwrap_err().contains("there are 3"));
        assert!(of(&square, [0, 1, 2], &[1]).unwrap_err().contains("material 1"));
        assert!(of(&square, [0, 1, 2], &[0, 0]).unwrap_err().contains("2 indices"));
        assert!(of(&[DVec3::NAN; 3], [0, 1, 2], &[]).unwrap_err().contains("vertex 0"));
    }

    #[test]
    fn colours_are_those_of_all_triangles() {
        let mesh = || {
            Mesh::new(vec![DVec3::ZERO, DVec3::X, DVec3::Y], vec![[0, 1, 2]], Vec::new(), Vec::new()).unwrap()
        };
        let of = |count| MeshColours { texels: vec![[[0.0; 2]; 3]; count], tints: Vec::new() };
        assert_eq!(mesh().with_colours(of(1)).unwrap().colours().texels.len(), 1);
        assert!(mesh().with_colours(of(0)).is_ok());
        assert!(mesh().with_colours(of(2)).unwrap_err().to_string().contains("of 2 triangles, expected 1"));
    }
}
