//! Reads LAS and LAZ.

use super::points::{Attributes, Point, Points};
use crate::damage;
use crate::error::{Error, Result};
use crate::geom::DVec3;
use las::{PointDataBuilder, Reader};
use std::path::Path;

/// Reads all points. Intensity and object come from the extra bytes `heliosAmplitude` (or `amplitude`) and `hitObjectId`
/// where they exist (spec outputs §4.4).
pub(super) fn read(path: &Path) -> Result<Points> {
    damage::catch_decoder_panic(|| read_sound(path)).unwrap_or_else(|| Err(broken(path)))
}

/// Compressed points that are none.
pub(super) fn broken(path: &Path) -> Error {
    Error::input(format!("the compressed points of {} make no sense; is the file whole?", path.display()))
}

fn read_sound(path: &Path) -> Result<Points> {
    let failed = |e: las::Error| match e {
        las::Error::Io(e) if e.kind() != std::io::ErrorKind::UnexpectedEof => Error::io("read", path, e),
        e => Error::input(format!("{} is not a LAS file that can be read: {e}", path.display())),
    };
    let mut reader = Reader::from_path(path).map_err(failed)?;
    let header = reader.header();
    let total = header.number_of_points();
    let extras = Extras::of(header);
    let bounds = header.bounds();
    let mut points = Points::new(Attributes {
        intensity: true,
        class: true,
        return_number: true,
        object: extras.object.is_some(),
    });
    points.set_origin(DVec3::new(
        0.5 * (bounds.min.x + bounds.max.x),
        0.5 * (bounds.min.y + bounds.max.y),
        0.5 * (bounds.min.z + bounds.max.z),
    ));
    let mut batch = PointDataBuilder::new().for_header(header).build();
    let mut left = total;
    while left > 0 {
        let read = reader.fill_points(left.min(65_536), &mut batch).map_err(failed)?;
        if read == 0 {
            return Err(Error::input(format!(
                "{} ends after {} of {total} points",
                path.display(),
                total - left
            )));
        }
        let mut columns = (batch.x().zip(batch.y()).zip(batch.z()))
            .zip(batch.intensity().zip(batch.classification()).zip(batch.return_number()));
        for record in batch.raw_bytes().chunks_exact(batch.record_len()) {
            let Some((((x, y), z), ((intensity, class), return_number))) = columns.next() else { break };
            let object = extras.object.as_ref().and_then(|f| f.value(record)).map(|v| (v as i64).to_string());
            points.push(&Point {
                position: DVec3::new(x, y, z),
                intensity: extras
                    .amplitude
                    .as_ref()
                    .and_then(|f| f.value(record))
                    .map_or(f32::from(intensity), |v| v as f32),
                class: i32::from(class),
                return_number: u32::from(return_number),
                object: object.as_deref().unwrap_or_default(),
            });
        }
        left -= read;
    }
    if points.is_empty() {
        return Err(Error::input(format!("{} holds no points", path.display())));
    }
    Ok(points)
}

/// An extra-bytes field within a point record.
pub(super) struct Field {
    offset: usize,
    kind: u8,
}

/// The first of these extra dimensions that the points have.
pub(super) fn field(header: &las::Header, names: &[&str]) -> Option<Field> {
    let all = fields(header);
    names.iter().find_map(|name| {
        all.iter().find(|f| f.0 == name.as_bytes()).map(|(_, f)| Field { offset: f.offset, kind: f.kind })
    })
}

/// The number of a point's extra dimension.
pub(super) fn number(field: &Field, record: &[u8]) -> Option<f64> {
    field.value(record)
}

impl Field {
    fn value(&self, record: &[u8]) -> Option<f64> {
        let bytes = record.get(self.offset..self.offset + size_of_kind(self.kind))?;
        Some(match self.kind {
            1 => f64::from(bytes[0]),
            2 => f64::from(bytes[0] as i8),
            3 => f64::from(u16::from_le_bytes(bytes.try_into().ok()?)),
            4 => f64::from(i16::from_le_bytes(bytes.try_into().ok()?)),
            5 => f64::from(u32::from_le_bytes(bytes.try_into().ok()?)),
            6 => f64::from(i32::from_le_bytes(bytes.try_into().ok()?)),
            7 => u64::from_le_bytes(bytes.try_into().ok()?) as f64,
            8 => i64::from_le_bytes(bytes.try_into().ok()?) as f64,
            9 => f64::from(f32::from_le_bytes(bytes.try_into().ok()?)),
            10 => f64::from_le_bytes(bytes.try_into().ok()?),
            _ => return None,
        })
    }
}

/// Bytes of an extra-bytes data type (LAS 1.4 table 24).
fn size_of_kind(kind: u8) -> usize {
    match kind {
        1 | 2 => 1,
        3 | 4 => 2,
        5 | 6 | 9 => 4,
        7 | 8 | 10 => 8,
        _ => 0,
    }
}

/// The extra bytes that a preview can show.
#[derive(Default)]
struct Extras {
    amplitude: Option<Field>,
    object: Option<Field>,
}

impl Extras {
    fn of(header: &las::Header) -> Extras {
        Extras {
            amplitude: field(header, &["heliosAmplitude", "amplitude", "Amplitude"]),
            object: field(header, &["hitObjectId"]),
        }
    }
}

/// All extra dimensions with their names.
fn fields(header: &las::Header) -> Vec<(Vec<u8>, Field)> {
    const DESCRIPTOR: usize = 192;
    let mut fields = Vec::new();
    let format = header.point_format();
    let mut offset = usize::from(format.len()).saturating_sub(usize::from(format.extra_bytes));
    let descriptors = header.all_vlrs().find(|v| v.user_id == "LASF_Spec" && v.record_id == 4);
    for descriptor in descriptors.iter().flat_map(|v| v.data.chunks_exact(DESCRIPTOR)) {
        let (kind, options) = (descriptor[2], descriptor[3]);
        let name = descriptor[4..36].split(|&b| b == 0).next().unwrap_or_default();
        fields.push((name.to_vec(), Field { offset, kind }));
        // Type 0 is a run of bytes whose number stands in the options.
        offset += if kind == 0 { usize::from(options) } else { size_of_kind(kind) };
    }
    fields
}

#[cfg(test)]
mod tests {
    use super::*;
    use las::point::{Classification, Format};

    fn written(name: &str, compressed: bool) -> (tempfile::TempDir, std::path::PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        let mut builder = las::Builder::from((1, 4));
        builder.point_format = Format::new(6).unwrap();
        builder.point_format.is_compressed = compressed;
        builder.point_format.extra_bytes = 12;
        let mut descriptors = vec![0u8; 2 * 192];
        for (i, (kind, label)) in
            [(10u8, &b"heliosAmplitude"[..]), (6, b"hitObjectId")].into_iter().enumerate()
        {
            descriptors[192 * i + 2] = kind;
            descriptors[192 * i + 4..192 * i + 4 + label.len()].copy_from_slice(label);
        }
        builder.vlrs.push(las::Vlr {
            user_id: "LASF_Spec".into(),
            record_id: 4,
            description: String::new(),
            data: descriptors,
        });
        let mut writer = las::Writer::from_path(&path, builder.into_header().unwrap()).unwrap();
        for i in 0..1000u32 {
            let mut extra = f64::from(i).to_le_bytes().to_vec();
            extra.extend_from_slice(&(i as i32 / 500).to_le_bytes());
            let point = las::Point {
                x: f64::from(i) * 0.1,
                y: 2.0,
                z: 3.0,
                return_number: 1 + (i % 3) as u8,
                number_of_returns: 3,
                classification: Classification::new(5).unwrap(),
                extra_bytes: extra,
                gps_time: Some(0.0),
                ..las::Point::default()
            };
            writer.write_point(point).unwrap();
        }
        writer.close().unwrap();
        (folder, path)
    }

    #[test]
    fn las_and_laz_give_position_class_return_amplitude_and_object() {
        for (name, compressed) in [("a.las", false), ("b.laz", true)] {
            let (_folder, path) = written(name, compressed);
            let points = super::super::read_points(&path).unwrap();
            assert_eq!(points.len(), 1000, "{name}");
            assert!((points.bounds().max.x - 99.9).abs() < 1e-9);
            assert_eq!(points.class[7], 5);
            assert_eq!(points.return_number[..4], [1, 2, 3, 1]);
            assert_eq!(points.intensity[321], 321.0);
            assert_eq!(points.objects, ["0", "1"]);
        }
    }

    #[test]
    fn damaged_files_are_input_problems() {
        let (folder, path) = written("a.las", false);
        let whole = std::fs::read(path).unwrap();
        for length in [0, 3, 100, 300, whole.len() - 5000] {
            let cut = folder.path().join("cut.las");
            std::fs::write(&cut, &whole[..length]).unwrap();
            assert!(matches!(read(&cut), Err(Error::Input(_))), "cut at {length}");
        }
        assert!(matches!(read(&folder.path().join("none.las")), Err(Error::Io { .. })));
    }
}
