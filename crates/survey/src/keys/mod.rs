//! Every setting that a survey may state: its names in pipeline files and in XML, its bounds, and the physics
//! that uses it. Readers of both formats take names and bounds from here.

mod tables;

pub(crate) use tables::*;

use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::quantity::{ANGLE, Bounds, NUMBER};

/// When a key has an effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KeyUse {
    /// In all physics.
    Always,
    /// Only with the correction of that name, which is part of the refined physics.
    With(&'static str),
    /// Only without the correction of that name.
    Without(&'static str),
    /// In the scanner and its first channel always, in later channels only with the correction of that name.
    InLaterChannelsWith(&'static str),
    /// Unless the device has another key and the correction of that name is on.
    UnlessBeside {
        /// The TOML name of the other key.
        key: &'static str,
        /// The correction by which that key has its effect.
        correction: &'static str,
    },
}

/// A key of a pipeline file and the attribute or child element of XML that means the same.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Key {
    /// Its name in pipeline files; empty if they have none.
    pub key: &'static str,
    /// Its XML attribute or child element; empty if it has none.
    pub attribute: &'static str,
    /// Numbers that it takes, in the unit of its name.
    pub bounds: &'static Bounds,
    /// When it has an effect.
    pub used: KeyUse,
}

impl Key {
    /// An attribute that pipeline files lack.
    pub(crate) const fn attribute(attribute: &'static str, bounds: &'static Bounds) -> Key {
        Key { key: "", attribute, bounds, used: KeyUse::Always }
    }
}

impl From<&'static str> for Key {
    fn from(attribute: &'static str) -> Key {
        Key::attribute(attribute, &NUMBER)
    }
}

/// The documentation of a table of a pipeline file.
#[derive(Clone, Copy, Debug)]
pub struct KeyTable {
    /// Its header; empty for the keys at the top of the file.
    pub name: &'static str,
    /// Its subject.
    pub about: &'static str,
    /// Names and meanings of its keys.
    pub keys: &'static [(&'static str, &'static str)],
}

/// Defines a table of a pipeline file: the struct, and its documentation as a constant.
#[macro_export]
macro_rules! key_table {
    (
        $(#[doc = $about:literal])+
        #[derive($($derive:ident),*)]
        #[serde($($serde:tt)*)]
        pub struct $name:ident = $table:literal {
            $($(#[doc = $doc:literal])+ $(#[serde($($attribute:tt)*)])? pub $field:ident: $type:ty,)*
        }
    ) => {
        $(#[doc = $about])+
        #[derive($($derive),*)]
        #[serde($($serde)*)]
        pub struct $name {
            $($(#[doc = $doc])+ $(#[serde($($attribute)*)])? pub $field: $type,)*
        }

        impl $name {
            /// Names and meanings of the keys.
            pub const TABLE: $crate::KeyTable = $crate::KeyTable {
                name: $table,
                about: concat!($($about, "\n"),+),
                keys: &[$((stringify!($field), concat!($($doc, "\n"),+))),*],
            };
        }
    };
}

/// Documentation of all tables of a pipeline file that describe the survey.
pub const SURVEY_TABLES: [KeyTable; 21] = [
    SurveyKeys::TABLE,
    PartKeys::TABLE,
    MaterialKeys::TABLE,
    PlatformKeys::TABLE,
    InstrumentKeys::TABLE,
    RigKeys::TABLE,
    PrismKeys::TABLE,
    TargetKeys::TABLE,
    RatioKeys::TABLE,
    WanderKeys::TABLE,
    RangeNoiseKeys::TABLE,
    OverlapKeys::TABLE,
    FmcwKeys::TABLE,
    AfterpulseKeys::TABLE,
    SettingsKeys::TABLE,
    WeatherKeys::TABLE,
    LegKeys::TABLE,
    WaveformKeys::TABLE,
    DetectorKeys::TABLE,
    PoseKeys::TABLE,
    AxisKeys::TABLE,
];

use KeyUse::{InLaterChannelsWith, UnlessBeside, With, Without};

/// All keys of an instrument that pipeline files have.
pub const INSTRUMENT_KEYS: &[Key] = InstrumentKeys::ALL;

/// Times of all channels within a firing cycle, which only XML lists.
pub(crate) const FIRING_OFFSETS: Key =
    Key { used: With("firing_offsets"), ..Key::attribute("firingOffsets_us", &NUMBER) };

/// Azimuths of the beams of channels, which XML lists next to their elevations.
pub(crate) const AZIMUTHS: Key = Key::attribute("azimuths_deg", &ANGLE);

/// Distances of the origins of the beams of channels, which XML lists next to their elevations.
pub(crate) const ORIGIN_RADII: Key = Key::attribute("originRadii_m", &NUMBER);

/// The key of an instrument of that name in pipeline files.
pub fn key_named(name: &str) -> Option<&'static Key> {
    INSTRUMENT_KEYS.iter().find(|known| known.key == name)
}

/// The key of an instrument of that XML attribute or child element.
pub(crate) fn key_of_attribute(name: &str) -> Option<&'static Key> {
    let mut keys = INSTRUMENT_KEYS.iter().chain([&FIRING_OFFSETS]);
    keys.find(|known| !name.is_empty() && known.attribute == name)
}

/// `text` with the keys of pipeline files in place of the attributes of XML that it names, if `place` is in
/// such a file.
pub fn named_as_in(place: Option<&Place>, text: &str) -> String {
    let is_toml =
        place.is_some_and(|place| place.path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml")));
    if !is_toml {
        return text.to_owned();
    }
    let tables = [SettingsKeys::ALL, LegKeys::ALL, InstrumentKeys::ALL];
    let is_part = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let key_of = |word: &str| {
        let mut keys = tables.iter().flat_map(|keys| keys.iter());
        // Short names such as `x` are also English words.
        keys.find(|key| key.attribute == word && word.chars().any(char::is_uppercase) && !key.key.is_empty())
    };
    let mut named = String::new();
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let end = rest.find(|c: char| is_part(c) != is_part(first)).unwrap_or(rest.len());
        let (word, after) = rest.split_at(end);
        named += key_of(word).map_or(word, |key| key.key);
        rest = after;
    }
    named
}

/// A key as the user wrote it.
#[derive(Clone, Debug)]
pub struct WrittenKey {
    /// The key.
    pub key: &'static Key,
    /// Its name as written.
    pub name: &'static str,
    /// Its place.
    pub place: Place,
    /// The channel of the key; `None` for all channels.
    pub channel: Option<usize>,
}

/// Warns of the keys that the physics with these corrections ignores. `is_on` is true if a correction is on.
pub fn warn_of_unused_keys(written: &[WrittenKey], is_on: impl Fn(&str) -> bool, problems: &mut Diagnostics) {
    for WrittenKey { key, name, place, channel } in written {
        let (message, help) = match key.used {
            With(correction) if !is_on(correction) => {
                let flag = correction.replace('_', "-");
                (
                    format!("`{name}` has no effect without the correction {flag} of the physics"),
                    format!("use `--physics refined` or `--correct {flag}`, or leave it out"),
                )
            }
            InLaterChannelsWith(correction) if channel.is_some_and(|i| i > 0) && !is_on(correction) => (
                format!(
                    "`{name}` of a channel has no effect: in the physics of HELIOS++ all have the first one's"
                ),
                "use `--physics refined`, or leave it out".to_owned(),
            ),
            Without(correction) if is_on(correction) => {
                let flag = correction.replace('_', "-");
                (
                    format!(
                        "`{name}` has no effect with the correction {flag}, which is part of the refined \
                         physics"
                    ),
                    "leave it out, or use `--physics helios`".to_owned(),
                )
            }
            UnlessBeside { key: other, correction } if is_on(correction) => {
                let holds = |w: &&WrittenKey| {
                    w.key.key == other
                        && w.place.path == place.path
                        && (w.channel.is_none() || w.channel == *channel)
                };
                let Some(replacing) = written.iter().find(holds) else { continue };
                (
                    format!("`{name}` has no effect beside `{}`, which replaces it", replacing.name),
                    "leave one of them out".to_owned(),
                )
            }
            _ => continue,
        };
        problems.warn(Some(place.clone()), message).help(help);
    }
}
