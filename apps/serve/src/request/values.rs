//! Values of inputs and their types.

use super::prepared::{RequestError, wrong};
use serde_json::Value;
use vlscan_messages::nearest;

/// A value given as `{"value": …}`, as OGC API - Processes has objects, or as it stands.
pub(super) fn unqualified(key: &str, value: Value) -> Result<Value, RequestError> {
    match value {
        Value::Object(map) if map.contains_key("href") => Err(wrong(
            key,
            "inputs by reference are not fetched; upload the file and give its name, UPLOAD/FILE",
        )),
        Value::Object(mut map)
            if map
                .keys()
                .all(|key| matches!(key.as_str(), "value" | "mediaType" | "encoding" | "schema")) =>
        {
            map.remove("value").ok_or_else(|| wrong(key, "expected a value"))
        }
        value => Ok(value),
    }
}

/// All texts of a value.
pub(super) fn texts(value: &Value) -> Vec<&str> {
    match value {
        Value::String(text) => vec![text],
        Value::Array(list) => list.iter().flat_map(texts).collect(),
        Value::Object(map) => map.values().flat_map(texts).collect(),
        _ => Vec::new(),
    }
}

/// Longest well-known text that stands in a command, bytes.
const MAX_TEXT: usize = 4096;

/// The ending and text of the file that an area or line becomes: GeoJSON, as an object or as text, which
/// vlscan reads from files only, and well-known text that is too long for a command line.
pub(super) fn geometry(value: &Value) -> Option<(&'static str, String)> {
    match value {
        Value::Object(_) => Some(("geojson", value.to_string())),
        Value::String(text) if text.trim_start().starts_with('{') => Some(("geojson", text.clone())),
        Value::String(text) if text.len() > MAX_TEXT && text.contains('(') => Some(("wkt", text.clone())),
        _ => None,
    }
}

/// Checks the type of a value as far as the schema tells it.
pub(super) fn check_type(key: &str, value: &Value, schema: &Value) -> Result<(), RequestError> {
    let is = |kind: &str| match kind {
        "string" => value.is_string(),
        "boolean" => value.is_boolean(),
        "integer" => value.is_u64() || value.is_i64(),
        "number" => value.is_number(),
        "array" => value.is_array(),
        "object" => value.is_object(),
        _ => true,
    };
    let alternatives: Vec<&Value> = match schema["anyOf"].as_array() {
        Some(list) => list.iter().collect(),
        None => vec![schema],
    };
    let kinds: Vec<&str> = alternatives.iter().filter_map(|one| one["type"].as_str()).collect();
    if kinds.len() == alternatives.len() && !kinds.iter().any(|kind| is(kind)) {
        return Err(wrong(key, format!("expected {}", kinds.join(" or "))));
    }
    if let (Some(names), Some(text)) = (schema["enum"].as_array(), value.as_str())
        && !names.iter().any(|name| name == text)
    {
        let names: Vec<&str> = names.iter().filter_map(Value::as_str).collect();
        return Err(wrong(key, format!("`{text}`: expected one of {}", names.join(", "))));
    }
    Ok(())
}

/// Advice in place of an unknown name: the known one that it may stand for, or all.
pub(crate) fn suggestion<'n>(typed: &str, known: impl Iterator<Item = &'n str>) -> String {
    let mut known: Vec<&str> = known.collect();
    known.sort_unstable();
    match nearest(typed, known.iter().copied()) {
        Some(near) => format!("did you mean `{near}`?"),
        None => format!("it has {}", known.join(", ")),
    }
}
