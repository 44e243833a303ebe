//! Points as text: the eleven columns of HELIOS++ (spec outputs §3) separated by single spaces and without
//! header, as lines or as a compressed archive of them (spec outputs §8); and chosen columns with a line of
//! their names.

use super::archive;
use crate::columnar::TableEncoder;
use crate::encode::{FileBody, Plain, PointEncoder};
use crate::number::{push_fixed, push_integer};
use crate::out::OutputStream;
use crate::record::{EncodedPoints, PointBatch, PointRecord};
use crate::settings::CloudSettings;
use std::sync::Arc;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::Result;
use vlscan_geom::DVec3;

/// The columns of HELIOS++, or chosen columns between blanks.
pub(crate) fn xyz(settings: &CloudSettings, _: &mut Diagnostics) -> Result<Arc<dyn PointEncoder>> {
    Ok(match &settings.columns {
        Some(_) => Arc::new(Lines::new(settings, b' ')),
        None => Arc::new(HeliosText::new(settings, false)),
    })
}

/// The columns of HELIOS++ as a compressed archive.
pub(crate) fn bin(settings: &CloudSettings, _: &mut Diagnostics) -> Result<Arc<dyn PointEncoder>> {
    Ok(Arc::new(HeliosText::new(settings, true)))
}

/// Comma-separated values with a line of names.
pub(crate) fn csv(settings: &CloudSettings, _: &mut Diagnostics) -> Result<Arc<dyn PointEncoder>> {
    Ok(Arc::new(Lines::new(settings, b',')))
}

/// Points as lines of columns.
#[derive(Debug)]
struct Lines {
    table: TableEncoder,
    separator: u8,
}

impl Lines {
    fn new(settings: &CloudSettings, separator: u8) -> Lines {
        Lines { table: TableEncoder::new(settings.table_columns(), settings), separator }
    }
}

impl PointEncoder for Lines {
    fn encode(&self, batch: &PointBatch, out: &mut EncodedPoints) {
        self.table.push_lines(batch.points, self.separator, out);
    }

    fn begin(self: Arc<Self>, out: &mut OutputStream) -> Result<Box<dyn FileBody>> {
        out.append(&self.table.heading(self.separator))?;
        Ok(Box::new(Plain))
    }
}

/// Points as HELIOS++ writes them.
#[derive(Debug)]
struct HeliosText {
    /// World position of the origin of points, m.
    origin: DVec3,
    /// Names of parts as text fields.
    labels: Vec<Box<[u8]>>,
    is_archive: bool,
}

impl HeliosText {
    fn new(settings: &CloudSettings, is_archive: bool) -> HeliosText {
        let labels = settings.parts.iter().map(|part| label(part)).collect();
        HeliosText { origin: settings.origin, labels, is_archive }
    }

    /// Appends `x y z intensity echo_width return_number number_of_returns fullwave_index
    /// object_id class gps_time`.
    fn push(&self, out: &mut Vec<u8>, point: &PointRecord) -> DVec3 {
        let position = point.position + self.origin;
        let reals = position.to_array().into_iter().chain([point.amplitude, point.echo_width]);
        for real in reals {
            push_fixed::<4>(out, real);
            out.push(b' ');
        }
        for count in [point.return_number, point.number_of_returns] {
            push_integer(out, count);
            out.push(b' ');
        }
        push_integer(out, point.pulse_number);
        out.push(b' ');
        out.extend_from_slice(self.labels.get(point.part as usize).map_or(&b"-"[..], |label| label));
        out.push(b' ');
        push_integer(out, point.class);
        out.push(b' ');
        push_fixed::<9>(out, point.seconds());
        out.push(b'\n');
        position
    }
}

impl PointEncoder for HeliosText {
    fn typical_bytes(&self) -> usize {
        112
    }

    fn encode(&self, batch: &PointBatch, out: &mut EncodedPoints) {
        out.extend(batch.points, |bytes, point| Some(self.push(bytes, point)));
    }

    fn begin(self: Arc<Self>, out: &mut OutputStream) -> Result<Box<dyn FileBody>> {
        if self.is_archive { archive::begin_archive(out) } else { Ok(Box::new(Plain)) }
    }
}

/// Converts a part's id to a text field: blanks become `_`, and an empty id, which would shift the columns,
/// becomes `-`.
fn label(id: &str) -> Box<[u8]> {
    if id.is_empty() {
        return Box::from(*b"-");
    }
    id.chars()
        .map(|c| if c.is_whitespace() || c.is_control() { '_' } else { c })
        .collect::<String>()
        .into_bytes()
        .into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_of_the_specification() {
        let settings = CloudSettings { parts: vec!["0".to_owned()], ..CloudSettings::default() };
        let point = PointRecord {
            position: DVec3::new(-2.838, -25.5432, -0.0065),
            amplitude: 5.6037077,
            time_ns: 86_391e9,
            pulse_number: 1,
            part: 0,
            ..PointRecord::default()
        };
        let mut line = Vec::new();
        HeliosText::new(&settings, false).push(&mut line, &point);
        let expected = "-2.8380 -25.5432 -0.0065 5.6037 0.0000 1 1 1 0 0 86391.000000000\n";
        assert_eq!(String::from_utf8(line).unwrap(), expected);
    }

    #[test]
    fn labels_stay_one_field() {
        assert_eq!(&*label(""), b"-");
        assert_eq!(&*label("oak tree\t7"), b"oak_tree_7");
        assert_eq!(&*label("north"), b"north");
    }
}
