//! Keywords of material files that mean transparency or mirror reflection, which are not simulated.

use super::number::float;
use super::text::shown;
use vlscan_base::diag::Place;
use vlscan_survey::{MaterialDefinition, UnusedOptics};

/// The illumination models without transparency and mirrors; those above are glass and mirrors.
const OPAQUE_MODELS: std::ops::RangeInclusive<f64> = 0.0..=3.0;

/// Transparency of one material as its file states it.
#[derive(Default)]
pub(super) struct Optics {
    /// Opacity `d`, transparency `Tr`, illumination model, texture of the opacity, and share `Tf` of the
    /// light that passes, if they are given.
    statements: [Option<Statement>; 5],
}

struct Statement {
    /// As written.
    text: String,
    place: Place,
    is_opaque: bool,
    /// The number.
    value: Option<f64>,
}

impl Optics {
    /// Reads a line; false for a keyword of something else. A later statement replaces an earlier one.
    pub fn read(&mut self, keyword: &[u8], operand: &[u8], place: impl FnOnce() -> Place) -> bool {
        let kind = match keyword {
            b"d" => 0,
            b"Tr" | b"tr" => 1,
            b"illum" => 2,
            b"map_d" | b"map_D" | b"map_Tr" => 3,
            b"Tf" => 4,
            _ => return false,
        };
        let Some(last) = operand.split(u8::is_ascii_whitespace).rfind(|word| !word.is_empty()) else {
            return true;
        };
        let value = float(last);
        let is_opaque = match (kind, value) {
            (0, Some(opacity)) => opacity >= 1.0,
            (1, Some(transparency)) => transparency <= 0.0,
            // Programs write 0 or 1 for opaque materials.
            (4, passing) => passing.is_none_or(|_| is_black_or_white(operand)),
            // Words instead of a number mean nothing.
            (2, model) => model.is_none_or(|model| OPAQUE_MODELS.contains(&model)),
            _ => false,
        };
        let text = format!("{} {}", shown(keyword), shown(operand));
        self.statements[kind] = Some(Statement { text, place: place(), is_opaque, value });
        true
    }

    /// Passes transparency to the material.
    pub fn finish(mut self, material: Option<&mut MaterialDefinition>) {
        let is_one = |statement: &Option<Statement>| statement.as_ref().is_some_and(|s| s.value == Some(1.0));
        if is_one(&self.statements[0]) && is_one(&self.statements[1]) {
            // Some programs write the opacity as `Tr`, too.
            self.statements[1] = None;
        }
        if self.statements[..2].iter().flatten().any(|statement| statement.is_opaque) {
            // Nothing passes that could be filtered.
            self.statements[4] = None;
        }
        let mut found: Vec<Statement> = self.statements.into_iter().flatten().collect();
        found.retain(|statement| !statement.is_opaque);
        let properties: Vec<&str> = found.iter().map(|statement| statement.text.as_str()).collect();
        let properties = properties.join(", ");
        let first = found.into_iter().map(|statement| statement.place).min_by_key(|place| place.line);
        if let (Some(material), Some(place)) = (material, first) {
            material.unused_optics = Some(UnusedOptics { properties, place: Some(place) });
        }
    }
}

/// True if the numbers of a colour are all 0 or all 1.
fn is_black_or_white(operand: &[u8]) -> bool {
    let numbers = || operand.split(u8::is_ascii_whitespace).filter_map(float);
    numbers().all(|number| number == 0.0) || numbers().all(|number| number == 1.0)
}
