//! Fields of records that only copies need, see [`PointDetails`].

use super::{ExtraDimension, Header};
use crate::{PointDetails, PointFlags, StoredFields};

/// Names of the extra dimensions that are read as attributes or details of a point.
const READ: [&str; 7] =
    ["device", "hitObjectId", "heliosAmplitude", "echo_width", "fullwaveIndex", "range", "incidence_angle"];

/// Places of the details of a point in its record.
pub(super) struct DetailFields {
    is_extended: bool,
    amplitude: Option<ExtraDimension>,
    echo_width: Option<ExtraDimension>,
    pulse_number: Option<ExtraDimension>,
    range: Option<ExtraDimension>,
    incidence: Option<ExtraDimension>,
}

impl DetailFields {
    /// The fields of records with this header and these extra dimensions.
    pub fn of(header: &Header, extra: &[(String, ExtraDimension)]) -> DetailFields {
        let dimension = |named: &str| {
            let found = extra.iter().find(|(name, dimension)| name == named && dimension.is_number());
            found.map(|(_, dimension)| *dimension)
        };
        DetailFields {
            is_extended: header.format >= 6,
            amplitude: dimension("heliosAmplitude"),
            echo_width: dimension("echo_width"),
            pulse_number: dimension("fullwaveIndex"),
            range: dimension("range"),
            incidence: dimension("incidence_angle"),
        }
    }

    /// Names of the attributes of the points that are not read.
    pub fn unread(header: &Header, extra: &[(String, ExtraDimension)]) -> Vec<String> {
        let mut names = Vec::new();
        if matches!(header.format, 8 | 10) {
            names.push("near infrared".to_owned());
        }
        if matches!(header.format, 4 | 5 | 9 | 10) {
            names.push("waveform packets".to_owned());
        }
        let others = extra.iter().filter(|(name, d)| !(d.is_number() && READ.contains(&name.as_str())));
        names.extend(others.map(|(name, _)| name.clone()));
        names
    }

    /// The details of a point.
    pub fn read(&self, header: &Header, record: &[u8]) -> PointDetails {
        let value = |dimension: Option<ExtraDimension>| dimension.and_then(|d| d.value(record));
        PointDetails {
            stored: StoredFields {
                intensity: Some(u16::from_le_bytes([record[12], record[13]])),
                point_source: Some(header.point_source(record)),
                incidence_deg: value(self.incidence).map(|angle| angle as f32),
                flags: match self.is_extended {
                    true => PointFlags::of_format_6(record[15]),
                    false => PointFlags::of_format_1(record[14], record[15]),
                },
                user_data: record[17],
                colour: None,
            },
            amplitude: value(self.amplitude),
            echo_width: value(self.echo_width),
            // The low 32 bits, stored as a signed number.
            pulse_number: value(self.pulse_number).map(|number| u64::from(number as i64 as u32)),
            range: value(self.range),
        }
    }
}
