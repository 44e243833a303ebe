//! Materials of glTF documents: their names, and as extras the properties that material files of OBJ have.

use super::{GltfError, diffuse};
use crate::mtl::{is_own, unknown_keyword};
use crate::mtl_optics::{OPTICAL_KEYS, set_optics};
use crate::optics::{GLASS_INDEX, SHEET_THICKNESS};
use crate::text::printable;
use serde::Deserialize;
use serde_json::Value;
use std::collections::BTreeSet;
use vlscan_base::quantity::{PANE_INDEX, PANE_THICKNESS};
use vlscan_survey::{MaterialDefinition, OpticsDefinition, UnusedOptics};

#[derive(Debug, Deserialize)]
pub(super) struct MaterialJson {
    #[serde(default)]
    name: String,
    #[serde(default)]
    extras: Value,
    #[serde(default, rename = "alphaMode")]
    alpha_mode: Value,
    #[serde(default, rename = "alphaCutoff")]
    alpha_cutoff: Value,
    #[serde(default, rename = "pbrMetallicRoughness")]
    pub pbr: Value,
    #[serde(default)]
    extensions: Value,
}

impl MaterialJson {
    /// True if colours of an extension take the place of those that are read.
    pub fn has_glossy_colours(&self) -> bool {
        self.extensions.get("KHR_materials_pbrSpecularGlossiness").is_some()
    }
}

/// The materials of a document, and after them that of primitives without one.
///
/// # Errors
/// A sentence about an extra that is not of its kind.
pub(super) fn definitions(materials: &[MaterialJson]) -> Result<Vec<MaterialDefinition>, GltfError> {
    let named = (0..).zip(materials).map(|(i, m)| definition(i, m));
    named.chain([Ok(diffuse("default"))]).collect()
}

fn definition(number: usize, json: &MaterialJson) -> Result<MaterialDefinition, GltfError> {
    let mut material = match json.name.as_str() {
        "" => diffuse(format!("material_{number}")),
        name => diffuse(name),
    };
    let name = material.name.clone();
    let extra = |key: &str| json.extras.get(key).filter(|value| !value.is_null());
    let wrong = |key: &str, expected: &str, found: &Value| {
        let found: String = found.to_string().chars().take(40).collect();
        GltfError::Material { name: name.clone(), key: key.to_owned(), expected: expected.to_owned(), found }
    };
    if let Some(value) = extra("helios_reflectance") {
        let number = value.as_f64().filter(|r| r.is_finite() && *r >= 0.0);
        material.reflectance =
            Some(number.ok_or_else(|| wrong("helios_reflectance", "a number, 0 or greater,", value))?);
    }
    if let Some(value) = extra("helios_spectra") {
        let text = value.as_str().ok_or_else(|| wrong("helios_spectra", "the name of a spectrum", value))?;
        material.spectrum = Some(text.to_owned());
    }
    if let Some(value) = extra("helios_classification") {
        // Some programs write every number as a float.
        let whole = value.as_f64().filter(|c| c.fract() == 0.0 && c.abs() <= f64::from(i32::MAX));
        let class = whole.ok_or_else(|| wrong("helios_classification", "a whole number", value))?;
        material.classification = class as i32;
    }
    if let Some(value) = extra("helios_isGround") {
        let number = value.as_f64().filter(|v| [0.0, 1.0].contains(v)).map(|v| v == 1.0);
        let is_ground = value.as_bool().or(number);
        material.is_ground = is_ground.ok_or_else(|| wrong("helios_isGround", "true or false", value))?;
    }
    if let Some(value) = extra("vlscan_leaf") {
        let number = value.as_f64().filter(|v| [0.0, 1.0].contains(v)).map(|v| v == 1.0);
        let leaf = value.as_bool().or(number);
        material.leaf = Some(leaf.ok_or_else(|| wrong("vlscan_leaf", "true or false", value))?);
    }
    for (key, highest, slot, unit) in [
        ("vlscan_roughness_deg", 90.0, &mut material.roughness, 1f64.to_radians()),
        ("vlscan_element_size_m", 100.0, &mut material.element_size, 1.0),
    ] {
        if let Some(value) = extra(key) {
            let number = value.as_f64().filter(|v| (0.0..=highest).contains(v));
            let expected = format!("a number from 0 to {highest}");
            *slot = unit * number.ok_or_else(|| wrong(key, &expected, value))?;
        }
    }
    for key in OPTICAL_KEYS {
        let name = format!("vlscan_{key}");
        if let Some(value) = extra(&name) {
            set_optics(&mut material.optics, key.as_bytes(), value.as_f64())
                .map_err(|expected| wrong(&name, expected.0, value))?;
        }
    }
    material.unused_optics = unused_optics(json).map(|properties| {
        let meaning = meaning(json);
        UnusedOptics { properties, place: None, meaning }
    });
    Ok(material)
}

/// Warnings of ignored extras and of replaced numbers of glass, as sentences about the file.
/// `definitions` are those of the materials.
pub(super) fn doubts(materials: &[MaterialJson], definitions: &[MaterialDefinition]) -> Vec<String> {
    let mut found = Vec::new();
    for (json, definition) in materials.iter().zip(definitions) {
        let mut doubtful: Vec<String> = unknown_extras(json).collect();
        if !definition.optics.is_optical() {
            doubtful.extend(doubtful_glass(json));
        }
        found.extend(doubtful.iter().map(|text| format!("the material \"{}\": {text}", definition.name)));
    }
    found
}

/// Warnings of extras with a prefix of material files that have no meaning.
fn unknown_extras(json: &MaterialJson) -> impl Iterator<Item = String> {
    let keys = json.extras.as_object().into_iter().flat_map(|extras| extras.keys());
    keys.filter_map(|key| unknown_keyword(key)).map(|text| format!("the unknown extra {text}"))
}

/// Warnings of extras of nodes and meshes that only materials have, as sentences about the file.
pub(super) fn misplaced_extras<'j>(extras: impl Iterator<Item = &'j Value>) -> Vec<String> {
    let keys = extras.filter_map(Value::as_object).flat_map(|extras| extras.keys());
    let keys: BTreeSet<&String> = keys.filter(|key| is_own(key)).collect();
    let message = |key: &String| {
        format!("the extra {} of a node or mesh is ignored: it belongs to materials", printable(key))
    };
    keys.into_iter().map(message).collect()
}

/// Numbers of a material with transmission that no pane has.
fn doubtful_glass(json: &MaterialJson) -> Vec<String> {
    let number = |extension: &str, key: &str| json.extensions.get(extension)?.get(key)?.as_f64();
    let transmission = number("KHR_materials_transmission", "transmissionFactor").filter(|t| *t > 0.0);
    let Some(transmission) = transmission else { return Vec::new() };
    let mut found = Vec::new();
    if transmission > 1.0 {
        found.push(format!(
            "KHR_materials_transmission {transmission} is no share from 0 to 1; it is read as 1"
        ));
    }
    if let Some(ior) = number("KHR_materials_ior", "ior").filter(|ior| !PANE_INDEX.contains(*ior)) {
        found.push(format!(
            "KHR_materials_ior {ior} is no refractive index from 1 to 5; the pane has {GLASS_INDEX}"
        ));
    }
    // Glass of thickness 0 is a thin sheet.
    let thickness = number("KHR_materials_volume", "thicknessFactor");
    if let Some(thickness) = thickness.filter(|t| !PANE_THICKNESS.contains(*t)) {
        found.push(format!(
            "KHR_materials_volume {thickness} is no thickness of 0 to 1 m; the pane has {SHEET_THICKNESS} m"
        ));
    }
    found
}

/// The pane that the extension of transmission describes; opacities and diffuse transmission have no effect.
fn meaning(json: &MaterialJson) -> Option<OpticsDefinition> {
    let number = |extension: &str, key: &str| json.extensions.get(extension)?.get(key)?.as_f64();
    let transmission = number("KHR_materials_transmission", "transmissionFactor").filter(|t| *t > 0.0)?;
    let index = number("KHR_materials_ior", "ior").filter(|ior| PANE_INDEX.contains(*ior));
    let thickness = number("KHR_materials_volume", "thicknessFactor");
    Some(OpticsDefinition {
        index: Some(index.unwrap_or(GLASS_INDEX)),
        thickness: thickness.filter(|t| *t > 0.0 && PANE_THICKNESS.contains(*t)),
        opacity: Some(1.0 - transmission.min(1.0)),
        ..OpticsDefinition::default()
    })
}

/// Properties of a material that mean transparency.
fn unused_optics(json: &MaterialJson) -> Option<String> {
    let mut found = Vec::new();
    let mode = json.alpha_mode.as_str().filter(|mode| ["BLEND", "MASK"].contains(mode));
    if let Some(mode) = mode.filter(|_| has_alpha(json)) {
        let cutoff = json.alpha_cutoff.as_f64().filter(|_| mode == "MASK");
        found.push(format!("alphaMode {mode}") + &cutoff.map_or(String::new(), |c| format!(" {c}")));
    }
    let number = |extension: &str, key: &str| json.extensions.get(extension)?.get(key)?.as_f64();
    // A texture with a factor of 0 has no effect.
    let mut transmit = |extension: &str, key: &str| {
        let value = number(extension, key).filter(|value| *value != 0.0);
        found.extend(value.map(|value| format!("{extension} {value}")));
        value.is_some()
    };
    let is_glass = transmit("KHR_materials_transmission", "transmissionFactor");
    let is_thin = transmit("KHR_materials_diffuse_transmission", "diffuseTransmissionFactor");
    // Only light that passes the surface meets the volume.
    if is_glass || is_thin {
        transmit("KHR_materials_volume", "thicknessFactor");
    }
    // An index of refraction alone only changes the gloss.
    if let Some(ior) = number("KHR_materials_ior", "ior").filter(|_| !found.is_empty()) {
        found.push(format!("KHR_materials_ior {ior}"));
    }
    (!found.is_empty()).then(|| found.join(", "))
}

/// True if the opacity of a material differs from 1, or comes from a texture.
fn has_alpha(json: &MaterialJson) -> bool {
    let of = |material: &Value, texture: &str, factor: &str| {
        let alpha = material.get(factor).and_then(|factor| factor.get(3)).and_then(Value::as_f64);
        material.get(texture).is_some() || alpha.is_some_and(|alpha| alpha != 1.0)
    };
    let older = json.extensions.get("KHR_materials_pbrSpecularGlossiness");
    of(&json.pbr, "baseColorTexture", "baseColorFactor")
        || older.is_some_and(|older| of(older, "diffuseTexture", "diffuseFactor"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(extras: &str) -> Result<MaterialDefinition, String> {
        let json = format!(r#"[{{"name":"bark\n","extras":{extras}}}]"#);
        let materials: Vec<MaterialJson> = serde_json::from_str(&json).unwrap();
        definitions(&materials).map(|found| found[0].clone()).map_err(|e| e.to_string())
    }

    #[test]
    fn transparency_is_remembered_for_a_message() {
        let of = |properties: &str| {
            let json = format!(r#"[{{"name":"pane",{properties}}}]"#);
            let materials: Vec<MaterialJson> = serde_json::from_str(&json).unwrap();
            definitions(&materials).unwrap()[0].unused_optics.clone().map(|optics| optics.properties)
        };
        for (json, expected) in [
            (
                r#""alphaMode":"BLEND","pbrMetallicRoughness":{"baseColorFactor":[1,1,1,0.2]}"#,
                Some("alphaMode BLEND"),
            ),
            (
                r#""alphaMode":"MASK","alphaCutoff":0.3,"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}"#,
                Some("alphaMode MASK 0.3"),
            ),
            (
                r#""alphaMode":"BLEND","extensions":{"KHR_materials_pbrSpecularGlossiness":{"diffuseTexture":{"index":0}}}"#,
                Some("alphaMode BLEND"),
            ),
            (r#""alphaMode":"BLEND""#, None),
            (r#""alphaMode":"MASK","pbrMetallicRoughness":{"baseColorFactor":[0.2,0.3,0.4,1.0]}"#, None),
            (
                r#""extensions":{"KHR_materials_transmission":{"transmissionFactor":0.9},"KHR_materials_ior":{"ior":1.33}}"#,
                Some("KHR_materials_transmission 0.9, KHR_materials_ior 1.33"),
            ),
            (
                r#""extensions":{"KHR_materials_diffuse_transmission":{"diffuseTransmissionFactor":0.5},"KHR_materials_volume":{"thicknessFactor":0.1}}"#,
                Some("KHR_materials_diffuse_transmission 0.5, KHR_materials_volume 0.1"),
            ),
            (r#""extensions":{"KHR_materials_volume":{"thicknessFactor":0.1}}"#, None),
            (r#""alphaMode":"OPAQUE""#, None),
            (r#""extensions":{"KHR_materials_transmission":{},"KHR_materials_ior":{"ior":1.45}}"#, None),
        ] {
            assert_eq!(of(json).as_deref(), expected, "{json}");
        }
    }

    #[test]
    fn ignored_extras_and_replaced_numbers_are_named() {
        let of = |properties: &str| {
            let json = format!(r#"[{{"name":"pane",{properties}}}]"#);
            let materials: Vec<MaterialJson> = serde_json::from_str(&json).unwrap();
            doubts(&materials, &definitions(&materials).unwrap()).join("\n")
        };
        let glass = |more: &str| {
            of(&format!(r#""extensions":{{"KHR_materials_transmission":{{"transmissionFactor":1}}{more}}}"#))
        };
        let volume =
            |thickness: f64| glass(&format!(r#","KHR_materials_volume":{{"thicknessFactor":{thickness}}}"#));
        for fine in [
            of(
                r#""extras":{"vlscan_mirror":0.9,"helios_reflectance":0.1,"helios_useVertexColors":1,"note":1}"#,
            ),
            glass(r#","KHR_materials_ior":{"ior":1.33}"#),
            volume(0.0),
            of(r#""extensions":{"KHR_materials_ior":{"ior":9}}"#),
            of(
                r#""extensions":{"KHR_materials_transmission":{"transmissionFactor":2}},"extras":{"vlscan_mirror":1}"#,
            ),
        ] {
            assert_eq!(fine, "");
        }
        let miror = of(r#""extras":{"vlscan_miror":0.9}"#);
        let expected = "the material \"pane\": the unknown extra vlscan_miror is ignored; did you mean \
                        vlscan_mirror?";
        assert_eq!(miror, expected);
        for (key, expected) in [
            ("vlscan_rougness_deg", "did you mean vlscan_roughness_deg?"),
            ("Helios_spectra", "did you mean helios_spectra?"),
            ("vlscan_colour", "the unknown extra vlscan_colour is ignored"),
        ] {
            let said = of(&format!(r#""extras":{{"{key}":1}}"#));
            assert!(said.contains(expected), "{said}");
        }
        let ior = glass(r#","KHR_materials_ior":{"ior":9}"#);
        assert!(
            ior.contains("KHR_materials_ior 9 is no refractive index") && ior.contains("has 1.5"),
            "{ior}"
        );
        let thick = volume(3.0);
        assert!(
            thick.contains("KHR_materials_volume 3 is no thickness") && thick.contains("0.004 m"),
            "{thick}"
        );
        let share = of(r#""extensions":{"KHR_materials_transmission":{"transmissionFactor":2}}"#);
        assert!(share.contains("KHR_materials_transmission 2 is no share"), "{share}");
    }

    #[test]
    fn extras_of_materials_elsewhere_are_named_once() {
        let extras = [r#"{"vlscan_leaf":1,"author":"me"}"#, "null", "7", r#"{"vlscan_leaf":0}"#];
        let extras = extras.map(|json| serde_json::from_str::<Value>(json).unwrap());
        let expected = "the extra vlscan_leaf of a node or mesh is ignored: it belongs to materials";
        assert_eq!(misplaced_extras(extras.iter()), [expected]);
    }

    #[test]
    fn extras_are_numbers_names_and_truths() {
        let whole = r#"{"helios_reflectance":0.4,"helios_classification":5.0,"helios_isGround":1,"helios_spectra":"moss"}"#;
        let material = read(whole).unwrap();
        assert_eq!((material.name.as_str(), material.reflectance), ("bark_", Some(0.4)));
        assert_eq!((material.classification, material.is_ground), (5, true));
        assert_eq!(material.spectrum.as_deref(), Some("moss"));
        assert!(read("null").is_ok() && read(r#"{"helios_reflectance":null}"#).is_ok());
        for (extras, expected) in [
            (r#"{"helios_reflectance":-5}"#, "found -5"),
            (r#"{"helios_reflectance":"0.3"}"#, "a number, 0 or greater,"),
            (r#"{"helios_spectra":7}"#, "the name of a spectrum"),
            (r#"{"helios_classification":5.5}"#, "a whole number"),
            (r#"{"helios_classification":1e300}"#, "a whole number"),
            (r#"{"helios_isGround":"true"}"#, "true or false"),
            (r#"{"helios_isGround":2}"#, "true or false"),
            (r#"{"vlscan_leaf":"yes"}"#, "true or false"),
            (r#"{"vlscan_roughness_deg":120}"#, "a number from 0 to 90"),
        ] {
            let message = read(extras).unwrap_err();
            assert!(message.contains(expected) && message.contains("\"bark_\""), "{extras}: {message}");
        }
    }
}
