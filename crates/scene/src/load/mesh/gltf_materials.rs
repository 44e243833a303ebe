//! Materials of glTF documents: their names, and as extras the properties that material files of OBJ have.

use super::diffuse;
use serde::Deserialize;
use serde_json::Value;
use vlscan_survey::MaterialDefinition;

#[derive(Debug, Deserialize)]
pub(super) struct MaterialJson {
    #[serde(default)]
    name: String,
    #[serde(default)]
    extras: Value,
}

/// The materials of a document, and after them that of primitives without one.
///
/// # Errors
/// A sentence about an extra that is not of its kind.
pub(super) fn definitions(materials: &[MaterialJson]) -> Result<Vec<MaterialDefinition>, String> {
    let named = (0..).zip(materials).map(|(i, m)| definition(i, m));
    named.chain([Ok(diffuse("default"))]).collect()
}

fn definition(number: usize, json: &MaterialJson) -> Result<MaterialDefinition, String> {
    let mut material = match json.name.as_str() {
        "" => diffuse(format!("material_{number}")),
        name => diffuse(name),
    };
    let name = material.name.clone();
    let extra = |key: &str| json.extras.get(key).filter(|value| !value.is_null());
    let wrong = |key: &str, expected: &str, found: &Value| {
        let found: String = found.to_string().chars().take(40).collect();
        format!("the material \"{name}\": expected {expected} as {key}, found {found}")
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
    Ok(material)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(extras: &str) -> Result<MaterialDefinition, String> {
        let json = format!(r#"[{{"name":"bark\n","extras":{extras}}}]"#);
        let materials: Vec<MaterialJson> = serde_json::from_str(&json).unwrap();
        definitions(&materials).map(|found| found[0].clone())
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
        ] {
            let message = read(extras).unwrap_err();
            assert!(message.contains(expected) && message.contains("\"bark_\""), "{extras}: {message}");
        }
    }
}
