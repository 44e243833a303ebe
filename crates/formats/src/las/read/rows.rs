//! Records as points.

use super::compressed::Selection;
use super::details::DetailFields;
use super::extra::ExtraDimension;
use super::header::Header;
use crate::{Attribute, AttributeSet, Columns, Misfits, PointDetails, PointRow};
use vlscan_geom::DVec3;
use vlscan_tables::plain;

/// The extra dimension of this program's files with pulses without a return.
const NAME_OF_MISSES: &str = "BeamDirectionX";

/// The extra dimensions that are read as attributes of points.
#[derive(Default)]
struct Shown {
    /// The unscaled amplitude of this program. Amplitudes of other programs are another quantity than the
    /// intensity.
    intensity: Option<ExtraDimension>,
    object: Option<ExtraDimension>,
    device: Option<ExtraDimension>,
    path: Option<ExtraDimension>,
}

/// Turns the records of a file into points.
pub(super) struct RowFormat {
    header: Header,
    shown: Shown,
    /// The fields of details, if these are read.
    details: Option<DetailFields>,
    /// Extra dimensions whose values are passed with the points.
    pub chosen: Vec<ExtraDimension>,
    /// Metres in a unit of x, y and z.
    pub metres: DVec3,
    may_have_misses: bool,
    /// Offset of red, green and blue in a record, if the format has them and all fields are read.
    colour_at: Option<usize>,
    /// The attributes that are read if the records have them; the others are 0.
    selected: AttributeSet,
}

impl RowFormat {
    /// The points of a file with this header and these extra dimensions, of which the selected attributes are
    /// read. Returns also warnings about scales and offsets that are replaced, and about dimensions that are
    /// not read because others mean the same.
    pub fn new(
        header: &Header,
        extra: &[(String, ExtraDimension)],
        selection: Selection,
    ) -> (RowFormat, Vec<String>) {
        let (shown, mut warnings) = match selection {
            Selection::PositionAndClass => Default::default(),
            Selection::Attributes(_) | Selection::All => Shown::of(extra),
        };
        if selection != Selection::PositionAndClass && !header.is_own() {
            warnings.extend(extra.iter().filter_map(|(name, _)| like_a_field(name)));
        }
        // A program that edits a file of this program names itself in the header and keeps the dimensions.
        let may_have_misses = header.is_own() || extra.iter().any(|(name, _)| name == NAME_OF_MISSES);
        let colour_at = match header.format {
            _ if selection != Selection::All => None,
            2 => Some(20),
            3 | 5 => Some(28),
            7 | 8 | 10 => Some(30),
            _ => None,
        };
        let selected = selection.attributes();
        let header = header.clone();
        let (details, metres) = (None, DVec3::ONE);
        let chosen = Vec::new();
        let rows = RowFormat { header, shown, details, chosen, metres, may_have_misses, colour_at, selected };
        (rows, warnings)
    }

    /// Reads details, too.
    pub fn read_details(&mut self, extra: &[(String, ExtraDimension)]) {
        self.details = Some(DetailFields::of(&self.header, extra));
    }

    /// The attributes of the points.
    pub fn attributes(&self) -> AttributeSet {
        let attributes = AttributeSet::of(|attribute| match attribute {
            Attribute::NormalX | Attribute::NormalY | Attribute::NormalZ => false,
            Attribute::Object => self.shown.object.is_some(),
            Attribute::Channel => self.shown.device.is_some() || self.header.format >= 6,
            Attribute::Time => self.header.has_time(),
            Attribute::Path => self.shown.path.is_some(),
            _ => true,
        });
        attributes.with_colours(self.colour_at.is_some())
    }

    /// True if the extra byte at an offset of a record is read.
    pub fn reads_byte(&self, at: usize) -> bool {
        let Shown { intensity, object, device, path } = &self.shown;
        let shown = [
            (Attribute::Intensity, intensity),
            (Attribute::Object, object),
            (Attribute::Channel, device),
            (Attribute::Path, path),
        ];
        let is_of = |dimension: &ExtraDimension| dimension.bytes().contains(&at);
        let mut read = shown.into_iter().filter(|(attribute, _)| self.selected.has(*attribute));
        self.details.is_some()
            || self.chosen.iter().any(is_of)
            || read.any(|(_, dimension)| dimension.as_ref().is_some_and(is_of))
    }

    /// Appends the values of the chosen dimensions of a record, NaN for those that it marks as missing.
    pub fn push_values(&self, record: &[u8], values: &mut Vec<f64>) {
        values.extend(self.chosen.iter().map(|dimension| dimension.value(record).unwrap_or(f64::NAN)));
    }

    /// The details of a record, if they are read.
    pub fn details(&self, record: &[u8]) -> Option<PointDetails> {
        self.details.as_ref().map(|details| details.read(&self.header, record))
    }

    /// The point of a record.
    pub fn row(&self, record: &[u8]) -> PointRow {
        let (header, shown) = (&self.header, &self.shown);
        let raw_intensity = u16::from_le_bytes([record[12], record[13]]);
        let mut misfits = Misfits::default();
        let has = |attribute| self.selected.has(attribute);
        let time = if has(Attribute::Time) { header.time(record) } else { 0.0 };
        let time = misfits.fitted(Attribute::Time, time);
        let mut number = |attribute, dimension: Option<ExtraDimension>| {
            dimension
                .filter(|_| has(attribute))
                .and_then(|dimension| dimension.value(record))
                .map(|value| misfits.fitted(attribute, value))
        };
        PointRow {
            position: header.position(record) * self.metres,
            normal: None,
            intensity: match shown.intensity {
                _ if !has(Attribute::Intensity) => 0.0,
                Some(amplitude) => amplitude.value(record).unwrap_or(f64::NAN) as f32,
                None => f32::from(raw_intensity),
            },
            class: header.class(record),
            return_number: header.return_number(record),
            number_of_returns: header.number_of_returns(record),
            is_miss: self.may_have_misses && raw_intensity == 0 && header.is_miss(record),
            scan_angle: if has(Attribute::ScanAngle) { header.scan_angle(record) } else { 0.0 },
            leg: if has(Attribute::Leg) { header.source_id(record) } else { 0 },
            point_source: if has(Attribute::Leg) { header.point_source(record) } else { 0 },
            channel: number(Attribute::Channel, shown.device).map_or(header.channel(record), |v| v as u16),
            time,
            object: number(Attribute::Object, shown.object).map_or(0, |v| v as i64),
            path: number(Attribute::Path, shown.path).map_or(0, |v| v as u8),
            colour: self
                .colour_at
                .and_then(|at| record.get(at..at + 6))
                .map(|of| [0, 2, 4].map(|c| u16::from_le_bytes([of[c], of[c + 1]]))),
            misfits,
        }
    }
}

impl Shown {
    fn of(all: &[(String, ExtraDimension)]) -> (Shown, Vec<String>) {
        let numbers: Vec<&(String, ExtraDimension)> = all.iter().filter(|(_, d)| d.is_number()).collect();
        let names: Vec<&str> = numbers.iter().map(|(name, _)| name.as_str()).collect();
        let columns = Columns::find(names.iter().copied()).only(&[
            Attribute::Object,
            Attribute::Channel,
            Attribute::Path,
        ]);
        let dimension = |attribute| columns.get(attribute).map(|column| numbers[column]);
        let intensity = numbers.iter().copied().find(|(name, _)| name == "heliosAmplitude");
        let (object, device) = (dimension(Attribute::Object), dimension(Attribute::Channel));
        let path = dimension(Attribute::Path);
        let all = [intensity, object, device, path];
        let rescaled = all.into_iter().flatten().filter(|(_, d)| d.is_rescaled());
        let warning = |(name, _): &(String, ExtraDimension)| {
            format!(
                "its dimension {name} has a scale of 0, or a scale or an offset that is not finite; 1 and 0 \
                 are used instead"
            )
        };
        let repeated = columns.repeated(&names, "extra dimension");
        let warnings = rescaled.map(warning).chain(repeated).collect();
        let shown = Shown {
            intensity: intensity.map(|(_, d)| *d),
            object: object.map(|(_, d)| *d),
            device: device.map(|(_, d)| *d),
            path: path.map(|(_, d)| *d),
        };
        (shown, warnings)
    }
}

/// Names of fields that all records have, in the form of [`plain`].
const FIELDS: [&str; 9] = [
    "intensity",
    "classification",
    "class",
    "returnnumber",
    "numberofreturns",
    "scanangle",
    "scananglerank",
    "pointsourceid",
    "gpstime",
];

/// A warning of an extra dimension with the name of a field of the records, which is read instead.
fn like_a_field(name: &str) -> Option<String> {
    let is_field = FIELDS.contains(&plain(name).as_str());
    is_field.then(|| format!("its extra dimension {name:?} is not read: the field of this name is"))
}

#[cfg(test)]
mod tests {
    use super::super::extra::dimensions;
    use super::*;

    /// Extra dimensions of whole numbers with these names.
    fn extra(names: &[&str]) -> Vec<(String, ExtraDimension)> {
        let descriptor = |name: &&str| {
            let mut bytes = [0; 192];
            bytes[2] = 5;
            bytes[4..4 + name.len()].copy_from_slice(name.as_bytes());
            bytes
        };
        dimensions(&names.iter().flat_map(descriptor).collect::<Vec<u8>>(), 30)
    }

    #[test]
    fn dimensions_that_mean_the_same_are_warned_of() {
        let warnings = |names: &[&str]| Shown::of(&extra(names)).1;
        let alike = "extra dimensions 1 (\"tree_id\") and 2 (\"instance\") both name an object";
        let found = warnings(&["tree_id", "instance"]);
        assert!(found.len() == 1 && found[0].starts_with(alike), "{found:?}");
        assert!(warnings(&["device", "device"])[0].contains("both name the number of a channel"));
        for names in
            [&["hitObjectId", "Part"][..], &["device", "heliosAmplitude"], &["Amplitude", "Amplitude"]]
        {
            assert_eq!(warnings(names), [""; 0], "{names:?}");
        }
        assert!(like_a_field("Intensity").is_some() && like_a_field("gps_time").is_some());
        assert_eq!((like_a_field("Amplitude"), like_a_field("treeID")), (None, None));
    }
}
