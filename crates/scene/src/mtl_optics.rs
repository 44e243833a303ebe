//! Optical properties of materials by their keys, and keywords of other programs that mean transparency or
//! mirror reflection, which only the refined physics simulates.

use super::number::float;
use super::optics::GLASS_INDEX;
use super::text::{Problems, shown};
use std::ops::Range;
use vlscan_base::diag::Place;
use vlscan_base::quantity::{
    Bounds, MIRROR, PANE_ABSORPTION, PANE_INDEX, PANE_SHEETS, PANE_THICKNESS, RETRO, SECCHI_DEPTH,
    WATER_ATTENUATION, WATER_BACKSCATTER, WIND_DIRECTION, WIND_SPEED,
};
use vlscan_survey::{MaterialDefinition, OpticsDefinition, UnusedOptics, WaterDefinition};

/// Keys of optical properties, without the prefix `vlscan_`.
pub(super) const OPTICAL_KEYS: [&str; 14] = [
    "mirror",
    "pane_index",
    "pane_thickness_m",
    "pane_absorption",
    "pane_sheets",
    "retro",
    "water_index",
    "water_group_index",
    "water_attenuation",
    "water_secchi_m",
    "water_beam_attenuation",
    "water_backscatter",
    "water_wind_m_s",
    "water_wind_deg",
];

/// Largest difference of shares that rounding explains.
const MAX_CONTRADICTION: f64 = 0.02;
/// The illumination models without transparency and mirrors; those above are glass and mirrors.
const OPAQUE_MODELS: std::ops::RangeInclusive<f64> = 0.0..=3.0;
/// Illumination models of glass.
const GLASS_MODELS: [f64; 4] = [4.0, 6.0, 7.0, 9.0];
/// Illumination models of mirrors, with and without ray tracing.
const MIRROR_MODEL: f64 = 5.0;
const DARK_MIRROR_MODEL: f64 = 8.0;

/// The values that a property may have, as the error of one that it cannot have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected {0}")]
pub(super) struct ExpectedValue(pub &'static str);

/// Sets an optical property by its key without the prefix.
///
/// # Errors
/// A `value` that the property cannot have, or none.
pub(super) fn set_optics(
    optics: &mut OpticsDefinition,
    key: &[u8],
    value: Option<f64>,
) -> Result<(), ExpectedValue> {
    let (bounds, slot) = match key {
        b"mirror" => (MIRROR, &mut optics.mirror),
        b"pane_index" => (PANE_INDEX, &mut optics.index),
        b"pane_thickness_m" => (PANE_THICKNESS, &mut optics.thickness),
        b"pane_absorption" => (PANE_ABSORPTION, &mut optics.absorption),
        b"pane_sheets" => {
            let sheets = value.filter(|v| PANE_SHEETS.contains(*v) && v.fract() == 0.0);
            optics.sheets = sheets.map(|sheets| sheets as u32);
            return optics.sheets.map(|_| ()).ok_or(ExpectedValue(PANE_SHEETS.expected));
        }
        b"retro" => (RETRO, &mut optics.retro),
        key => water_property(&mut optics.water, key),
    };
    *slot = value.filter(|v| bounds.contains(*v));
    slot.map(|_| ()).ok_or(ExpectedValue(bounds.expected))
}

/// A property of water by its key without the prefix.
fn water_property<'a>(water: &'a mut WaterDefinition, key: &[u8]) -> (Bounds, &'a mut Option<f64>) {
    match key {
        b"water_index" => (PANE_INDEX, &mut water.index),
        b"water_group_index" => (PANE_INDEX, &mut water.group_index),
        b"water_attenuation" => (WATER_ATTENUATION, &mut water.attenuation),
        b"water_secchi_m" => (SECCHI_DEPTH, &mut water.secchi),
        b"water_beam_attenuation" => (WATER_ATTENUATION, &mut water.beam_attenuation),
        b"water_backscatter" => (WATER_BACKSCATTER, &mut water.backscatter),
        b"water_wind_m_s" => (WIND_SPEED, &mut water.wind),
        _ => (WIND_DIRECTION, &mut water.wind_direction),
    }
}

/// Transparency of one material as its file states it.
#[derive(Default)]
pub(super) struct Optics {
    /// Opacity `d`, transparency `Tr`, illumination model, texture of the opacity, and share `Tf` of the
    /// light that passes, if they are given.
    statements: [Option<Statement>; 5],
    /// Refractive index `Ni`, which by itself means nothing.
    index: Option<f64>,
    /// Text and position of an index that no material has.
    wrong_index: Option<(String, Position)>,
    /// Keywords of laser scanners so far.
    own_keywords: Vec<Vec<u8>>,
}

/// Line, from 1, and bytes of a statement in its file.
type Position = (usize, Range<usize>);

struct Statement {
    /// As written.
    text: String,
    place: Place,
    at: Position,
    is_opaque: bool,
    /// The number.
    value: Option<f64>,
}

impl Optics {
    /// True for a keyword that this material has had before, which counts as had from now on.
    pub fn is_repeated(&mut self, keyword: &[u8]) -> bool {
        let is_repeated = self.own_keywords.iter().any(|own| own == keyword);
        if !is_repeated {
            self.own_keywords.push(keyword.to_vec());
        }
        is_repeated
    }

    /// Reads a line; false for a keyword of something else. A later statement replaces an earlier one. Warns
    /// of values that cannot be.
    pub fn read(
        &mut self,
        (keyword, operand): (&[u8], &[u8]),
        at: Position,
        place: impl FnOnce() -> Place,
        problems: &mut Problems,
    ) -> bool {
        let kind = match keyword {
            b"d" => 0,
            b"Tr" | b"tr" => 1,
            b"illum" => 2,
            b"map_d" | b"map_D" | b"map_Tr" => 3,
            b"Tf" => 4,
            b"Ni" => {
                self.index = float(operand).filter(|index| PANE_INDEX.contains(*index));
                self.wrong_index = self.index.is_none().then(|| (shown(operand), at));
                return true;
            }
            _ => return false,
        };
        let Some(last) = operand.split(u8::is_ascii_whitespace).rfind(|word| !word.is_empty()) else {
            return true;
        };
        let value = float(last).filter(|value| value.is_finite());
        if let (0 | 1, Some(share)) = (kind, value)
            && !(0.0..=1.0).contains(&share)
        {
            let read_as = share.clamp(0.0, 1.0);
            problems.warn(at.0, at.1.clone(), || {
                format!("{} {} is no share from 0 to 1; it is read as {read_as}", shown(keyword), shown(last))
            });
        }
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
        self.statements[kind] = Some(Statement { text, place: place(), at, is_opaque, value });
        true
    }

    /// Warns of an opacity and a transparency that are not those of one material: their sum is not 1, and
    /// they are not the same number, which some programs write for both.
    fn warn_of_contradiction(&self, problems: &mut Problems) {
        let [Some(opacity), Some(transparency), ..] = &self.statements else { return };
        let (Some(d), Some(tr)) = (opacity.value, transparency.value) else { return };
        let (d, tr) = (d.clamp(0.0, 1.0), tr.clamp(0.0, 1.0));
        if (d + tr - 1.0).abs() > MAX_CONTRADICTION && (d - tr).abs() > MAX_CONTRADICTION {
            let (line, bytes) = transparency.at.clone();
            let counts = if opacity.is_opaque { "Tr" } else { "d" };
            let texts = format!("{} and {}", opacity.text, transparency.text);
            problems
                .warn(line, bytes, || format!("{texts} contradict each other: Tr is 1 - d; {counts} counts"));
        }
    }

    /// Passes transparency to the material.
    pub fn finish(mut self, material: Option<&mut MaterialDefinition>, problems: &mut Problems) {
        self.warn_of_contradiction(problems);
        let is_one = |statement: &Option<Statement>| statement.as_ref().is_some_and(|s| s.value == Some(1.0));
        if is_one(&self.statements[0]) && is_one(&self.statements[1]) {
            // Some programs write the opacity as `Tr`, too.
            self.statements[1] = None;
        }
        if self.statements[..2].iter().flatten().any(|statement| statement.is_opaque) {
            // Nothing passes that could be filtered.
            self.statements[4] = None;
        }
        let meaning = self.meaning(material.as_deref());
        let is_pane = meaning.is_some_and(|meaning| meaning.index.is_some());
        if let Some((text, (line, bytes))) = self.wrong_index.take().filter(|_| is_pane) {
            problems.warn(line, bytes, || {
                format!("Ni {text} is no refractive index from 1 to 5; the pane has {GLASS_INDEX}")
            });
        }
        let mut found: Vec<Statement> = self.statements.into_iter().flatten().collect();
        found.retain(|statement| !statement.is_opaque);
        let properties: Vec<&str> = found.iter().map(|statement| statement.text.as_str()).collect();
        let properties = properties.join(", ");
        let first = found.into_iter().map(|statement| statement.place).min_by_key(|place| place.line);
        if let (Some(material), Some(place)) = (material, first) {
            material.unused_optics = Some(UnusedOptics { properties, place: Some(place), meaning });
        }
    }

    /// The mirror or pane that the numbers describe; `None` for glass of full opacity, or if a texture
    /// decides where light passes.
    fn meaning(&self, material: Option<&MaterialDefinition>) -> Option<OpticsDefinition> {
        let number = |i: usize| self.statements[i].as_ref().filter(|s| !s.is_opaque).and_then(|s| s.value);
        let opacity = number(0).or(number(1).map(|transparency| 1.0 - transparency));
        // A file that states full opacity together with a model of glass contradicts itself. Mirrors are
        // opaque.
        let is_opaque = self.statements[..2].iter().flatten().any(|s| s.is_opaque) && opacity.is_none();
        if self.statements[3].is_some() {
            return None;
        }
        let opacity = opacity.map(|opacity| opacity.clamp(0.0, 1.0));
        let is_glass = |model: Option<f64>| model.is_some_and(|model| GLASS_MODELS.contains(&model));
        match number(2) {
            // Mirrors with the specular colour, or with all light if there is none.
            Some(MIRROR_MODEL | DARK_MIRROR_MODEL) if opacity.is_none() => {
                let ks = material.map_or([0.0; 3], |material| material.ks);
                let mean = (ks[0] + ks[1] + ks[2]) / 3.0;
                let mirror = if mean > 0.0 { mean.min(1.0) } else { 1.0 };
                Some(OpticsDefinition { mirror: Some(mirror), ..Default::default() })
            }
            model if opacity.is_some() || (is_glass(model) && !is_opaque) => {
                let index = self.index.unwrap_or(GLASS_INDEX);
                Some(OpticsDefinition { index: Some(index), opacity, ..Default::default() })
            }
            _ => None,
        }
    }
}

/// True if the numbers of a colour are all 0 or all 1.
fn is_black_or_white(operand: &[u8]) -> bool {
    let numbers = || operand.split(u8::is_ascii_whitespace).filter_map(float);
    numbers().all(|number| number == 0.0) || numbers().all(|number| number == 1.0)
}
