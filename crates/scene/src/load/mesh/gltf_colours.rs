//! Colours of a glTF document: base colours of materials, their textures, and colours of vertices. They are
//! read only if they are requested. Metalness, emission and other light are not.

use super::gltf::GltfDocument;
use super::gltf_buffers::decode_percent;
use super::{GltfError, RawMesh};
use base64::Engine;
use serde::Deserialize;
use serde_json::Value;
use std::collections::HashMap;
use std::path::Path;
use vlscan_survey::{ColourDefinition, TextureDefinition, TextureImage, TextureWrap};

/// Texture coordinates of a corner without any.
const NO_TEXEL: [f32; 2] = [f32::NAN; 2];

/// The parts of a document that only colours need.
#[derive(Debug, Default, Deserialize)]
pub(super) struct ColourJson {
    #[serde(default)]
    textures: Vec<TextureJson>,
    #[serde(default)]
    images: Vec<ImageJson>,
    #[serde(default)]
    samplers: Vec<SamplerJson>,
}

/// A texture that cannot be used. The messages are the rest of a sentence about it.
#[derive(Debug, thiserror::Error)]
enum TextureError {
    #[error("does not exist")]
    Missing,
    #[error("has no PNG or JPEG image")]
    NoSource,
    #[error("refers to image {0}, which is missing")]
    NoImage(usize),
    #[error("has no image")]
    Empty,
    #[error("is on another machine")]
    Elsewhere,
    #[error("is not base64")]
    NoBase64,
    #[error("is not base64: {0}")]
    Base64(#[from] base64::DecodeError),
    #[error(transparent)]
    View(#[from] GltfError),
}

#[derive(Debug, Deserialize)]
struct TextureJson {
    source: Option<usize>,
    sampler: Option<usize>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct ImageJson {
    uri: Option<String>,
    buffer_view: Option<usize>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct SamplerJson {
    wrap_s: Option<u32>,
    wrap_t: Option<u32>,
}

/// Colours of the vertices of a primitive; either list may be empty.
pub(super) struct VertexColours {
    texels: Vec<[f32; 2]>,
    tints: Vec<[u16; 3]>,
}

impl GltfDocument {
    /// Gives the materials their colours.
    pub fn add_colours(&mut self, json: &ColourJson) {
        let mut warnings = Vec::new();
        let named = self.json.materials.iter().zip(&self.materials);
        let of_materials: Vec<_> = named
            .map(|(m, definition)| {
                let mut found = Vec::new();
                if m.has_glossy_colours() {
                    found.push("colours of KHR_materials_pbrSpecularGlossiness are not read".to_owned());
                }
                let colour = self.colour_of(json, &m.pbr, &mut found);
                let name = &definition.name;
                warnings.extend(found.into_iter().map(|text| format!("the material \"{name}\": {text}")));
                colour
            })
            .collect();
        self.texel_sets = of_materials.iter().map(|(_, set)| *set).chain([0]).collect();
        let default = ColourDefinition { is_linear: true, ..ColourDefinition::stored([1.0; 3]) };
        let colours = of_materials.into_iter().map(|(colour, _)| colour).chain([default]);
        for (material, colour) in self.materials.iter_mut().zip(colours) {
            material.colour = Some(colour);
        }
        self.warnings.extend(warnings);
    }

    /// The colour of a material and the number of the texture coordinates that it uses. Appends sentences
    /// about values that cannot be used to `warnings`.
    fn colour_of(
        &self,
        json: &ColourJson,
        pbr: &Value,
        warnings: &mut Vec<String>,
    ) -> (ColourDefinition, usize) {
        let component = |i: usize| pbr.get("baseColorFactor")?.get(i)?.as_f64();
        let factor = [0, 1, 2].map(|i| component(i).unwrap_or(1.0).clamp(0.0, 1.0));
        let is_usable = |i: usize| component(i).is_some_and(|value| (0.0..=1.0).contains(&value));
        if pbr.get("baseColorFactor").is_some() && !(0..3).all(is_usable) {
            warnings.push(format!("baseColorFactor is no colour of numbers from 0 to 1; it is {factor:?}"));
        }
        let plain = ColourDefinition { is_linear: true, ..ColourDefinition::stored(factor) };
        let Some(reference) = pbr.get("baseColorTexture") else { return (plain, 0) };
        let number = |value: &Value, key: &str| value.get(key)?.as_u64().map(|n| n as usize);
        let Some(index) = number(reference, "index") else {
            warnings.push("baseColorTexture has no index and is ignored".to_owned());
            return (plain, 0);
        };
        let moved = reference.get("extensions").and_then(|all| all.get("KHR_texture_transform"));
        let set = moved.and_then(|moved| number(moved, "texCoord"));
        let set = set.or_else(|| number(reference, "texCoord")).unwrap_or(0);
        let image = match self.image(json, index) {
            Ok(image) => image,
            Err(what) => {
                warnings.push(format!("texture {index} {what}; its surfaces have the colour without it"));
                return (plain, set);
            }
        };
        let sampler = json.textures[index].sampler.and_then(|sampler| json.samplers.get(sampler));
        let wrap = |mode: Option<u32>| match mode {
            Some(33_071) => TextureWrap::Clamp,
            Some(33_648) => TextureWrap::Mirror,
            _ => TextureWrap::Repeat,
        };
        let wrap = sampler.map_or_else(Default::default, |of| [wrap(of.wrap_s), wrap(of.wrap_t)]);
        let transform = moved.map_or(TextureDefinition::IDENTITY, transform);
        let texture = TextureDefinition { image, transform, wrap, is_upward: false };
        (ColourDefinition { texture: Some(texture), ..plain }, set)
    }

    /// The image of a texture.
    fn image(&self, json: &ColourJson, texture: usize) -> Result<TextureImage, TextureError> {
        let texture = json.textures.get(texture).ok_or(TextureError::Missing)?;
        let source = texture.source.ok_or(TextureError::NoSource)?;
        let image = json.images.get(source).ok_or(TextureError::NoImage(source))?;
        let path = self.source.path();
        let within = |bytes: &[u8]| TextureImage::Bytes(path.to_path_buf(), bytes.into());
        match (&image.uri, image.buffer_view) {
            (Some(uri), _) => match uri.strip_prefix("data:") {
                Some(data) => {
                    let text = data.split_once(";base64,").ok_or(TextureError::NoBase64)?.1;
                    Ok(within(&base64::engine::general_purpose::STANDARD.decode(text)?))
                }
                None if uri.contains("://") => Err(TextureError::Elsewhere),
                None => {
                    let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
                    Ok(TextureImage::File(folder, decode_percent(uri)))
                }
            },
            (None, Some(view)) => Ok(within(self.view(view, 0, 1)?.0)),
            (None, None) => Err(TextureError::Empty),
        }
    }

    /// The colours of the vertices of a primitive with `count` of them and this material; `None` if none are
    /// requested or there are none.
    pub fn corner_colours(
        &self,
        attributes: &HashMap<String, usize>,
        material: usize,
        count: usize,
    ) -> Result<Option<VertexColours>, GltfError> {
        let Some(set) = self.texel_sets.get(material) else { return Ok(None) };
        let texels = match attributes.get(&format!("TEXCOORD_{set}")) {
            Some(&accessor) => {
                self.vectors::<2>(accessor)?.into_iter().map(|t| t.map(|c| c as f32)).collect()
            }
            None => Vec::new(),
        };
        // The conversion saturates.
        let tint = |of: [f64; 3]| of.map(|c| (c * 65_535.0).round() as u16);
        let tints = match attributes.get("COLOR_0") {
            Some(&accessor) if self.json.accessors.get(accessor).is_some_and(|a| a.shape == "VEC4") => {
                self.vectors::<4>(accessor)?.into_iter().map(|[r, g, b, _]| tint([r, g, b])).collect()
            }
            Some(&accessor) => self.vectors::<3>(accessor)?.into_iter().map(tint).collect(),
            None => Vec::new(),
        };
        let colours = VertexColours { texels, tints };
        let is_usable = |length: usize| length == 0 || length >= count;
        if !is_usable(colours.texels.len()) || !is_usable(colours.tints.len()) {
            return Err(GltfError::OutOfRange {
                corner: count.saturating_sub(1) as u32,
                count: colours.texels.len().max(colours.tints.len()) as u32,
            });
        }
        Ok((!colours.texels.is_empty() || !colours.tints.is_empty()).then_some(colours))
    }
}

impl VertexColours {
    /// Adds the colours of the last triangle of a mesh, whose corners are these vertices of the primitive.
    pub fn add_triangle(&self, raw: &mut RawMesh, corners: [u32; 3]) {
        let Some(before) = raw.triangles.len().checked_sub(1) else { return };
        if !self.texels.is_empty() {
            raw.colours.texels.resize(before, [NO_TEXEL; 3]);
            raw.colours.texels.push(corners.map(|corner| self.texels[corner as usize]));
        }
        if !self.tints.is_empty() {
            raw.colours.tints.resize(before, [[u16::MAX; 3]; 3]);
            raw.colours.tints.push(corners.map(|corner| self.tints[corner as usize]));
        }
    }
}

/// Gives the last triangles of a mesh the colours of those without, if others have some.
pub(super) fn complete_colours(raw: &mut RawMesh) {
    let count = raw.triangles.len();
    if !raw.colours.texels.is_empty() {
        raw.colours.texels.resize(count, [NO_TEXEL; 3]);
    }
    if !raw.colours.tints.is_empty() {
        raw.colours.tints.resize(count, [[u16::MAX; 3]; 3]);
    }
}

/// The transform of texture coordinates of the extension `KHR_texture_transform`: scale, then rotation, then
/// offset. A positive rotation turns from u towards smaller v, which counts downwards: anticlockwise in the
/// image. The text and the examples of the extension mean that, and other programs compute it. The matrix in
/// its listing has the opposite sign (KhronosGroup/glTF#1563).
fn transform(json: &Value) -> ([[f64; 2]; 2], [f64; 2]) {
    let pair = |key: &str, default: f64| {
        [0, 1].map(|i| json.get(key).and_then(|all| all.get(i)?.as_f64()).unwrap_or(default))
    };
    let (offset, [su, sv]) = (pair("offset", 0.0), pair("scale", 1.0));
    let angle = json.get("rotation").and_then(Value::as_f64).unwrap_or(0.0);
    let (s, c) = (libm::sin(angle), libm::cos(angle));
    ([[c * su, s * sv], [-s * su, c * sv]], offset)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Texture coordinates after a transform.
    fn moved(json: &str, [u, v]: [f64; 2]) -> [f64; 2] {
        let (linear, offset) = transform(&serde_json::from_str(json).unwrap());
        [0, 1].map(|i| linear[i][0] * u + linear[i][1] * v + offset[i])
    }

    #[test]
    fn texture_coordinates_are_scaled_turned_and_moved() {
        // The example of the extension: the lower left quadrant of the image, turned clockwise by 90°.
        let quadrant = r#"{"offset":[0,1],"rotation":1.57079632679,"scale":[0.5,0.5]}"#;
        // The example that counts the second coordinate from the lower edge.
        let upward = r#"{"offset":[0,1],"scale":[1,-1]}"#;
        let all = r#"{"offset":[0.1,0.2],"rotation":0.5235987755982988,"scale":[2,0.5]}"#;
        for (json, from, to) in [
            (quadrant, [0.0, 0.0], [0.0, 1.0]),
            (quadrant, [1.0, 0.0], [0.0, 0.5]),
            (quadrant, [0.0, 1.0], [0.5, 1.0]),
            (quadrant, [1.0, 1.0], [0.5, 0.5]),
            (upward, [0.25, 0.125], [0.25, 0.875]),
            (r#"{"offset":[0.25,-3]}"#, [0.5, 0.5], [0.75, -2.5]),
            (r#"{"scale":[4,0.5]}"#, [0.5, 0.5], [2.0, 0.25]),
            ("{}", [0.3, 0.7], [0.3, 0.7]),
            // 2·0.3·cos 30° + 0.5·0.4·sin 30° + 0.1 and −2·0.3·sin 30° + 0.5·0.4·cos 30° + 0.2.
            (all, [0.3, 0.4], [0.719_615_242_270_663, 0.073_205_080_756_888]),
        ] {
            let found = moved(json, from);
            let is_near = found.iter().zip(to).all(|(a, b)| (a - b).abs() < 1e-11);
            assert!(is_near, "{json} {from:?}: {found:?} is not {to:?}");
        }
    }
}
