//! Copies of clouds in other formats.

use crate::record::WEEK_S;
use crate::{
    Attribute, AttributeSet, CloudFormat, CloudSettings, CloudWriter, Column, ExtraDimensions, FileFacts,
    LasVersion, PointDetails, PointFlags, PointFormat, PointRecord, PointRow, PointSink, Tally, read_points,
};
use std::collections::HashMap;
use std::ops::ControlFlow;
use std::path::Path;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_geom::Aabb;

/// Points that are written together.
const BLOCK_POINTS: usize = 4096;

/// Copies a cloud to a new file, whose extension names its format; the file is read twice. Bounds, origin and
/// coordinate reference system are those of the cloud unless the settings have them. Returns the counts of
/// the points, and warnings: one for each attribute that the copy lacks. From LAS to LAS everything is copied
/// except near infrared, waveform packets and extra dimensions of other programs. Colours of 8 bits are 256
/// times as large in formats with 16 bits.
///
/// # Errors
/// The errors of [`read_points`] and [`CloudWriter`]; [`Error::Input`] for a stream, and for an extension
/// that names no format.
pub fn copy(from: &Path, to: &Path, settings: &CloudSettings) -> Result<(Tally, Diagnostics)> {
    let format = PointFormat::required(to);
    let format = format.map_err(|unknown| Error::input(format!("{}: {unknown}", to.display())))?;
    if from.exists() && !from.is_file() || from.as_os_str() == "-" {
        let message = format!("{} is a stream; a copy reads its file twice", from.display());
        return Err(Error::input_with_help(message, "save it as a file"));
    }
    let mut facts = SourceFacts::default();
    let mut found = read_points(from, &mut facts)?;
    let settings = facts.settings(settings, format);
    let keeps_colours = settings.has_colours() && (format.has_colours() || format.has_columns());
    facts.warn(from, (format, settings.las.version), keeps_colours, &mut found);
    let mut writer = CopyWriter {
        writer: CloudWriter::create(to, false, format, &settings, &mut found)?,
        settings,
        has_exact_times: !format.has_frames(),
        has_byte_colours: facts.max_colour.is_some_and(|max| max <= u16::from(u8::MAX)),
        is_from_las: facts.format == Some(CloudFormat::Las),
        details: None,
        objects: HashMap::new(),
        block: Vec::with_capacity(BLOCK_POINTS),
    };
    read_points(from, &mut writer)?;
    writer.flush()?;
    Ok((writer.writer.finish()?, found))
}

/// Facts about the points that must be known before the first one is written.
#[derive(Default)]
struct SourceFacts {
    format: Option<CloudFormat>,
    attributes: AttributeSet,
    crs: Option<String>,
    bounds: Option<Aabb>,
    highest_class: u8,
    /// The greatest component of colours; `None` without colours.
    max_colour: Option<u16>,
    has_adjusted_times: bool,
    has_flags: bool,
    /// True if a point has the flag that LAS 1.0 lacks.
    has_overlap: bool,
    has_user_data: bool,
    /// True if the number of an object does not fit into 32 bits.
    has_long_objects: bool,
    /// True if a point has a detail that is an extra dimension of this program.
    has_extra: bool,
    unread: Vec<String>,
}

impl SourceFacts {
    fn warn(
        &self,
        from: &Path,
        (format, version): (PointFormat, LasVersion),
        keeps_colours: bool,
        found: &mut Diagnostics,
    ) {
        let is_las = format.is_las();
        let has_normals = Attribute::NORMAL.iter().all(|attribute| self.attributes.has(*attribute));
        let others = [
            (self.max_colour.is_some() && !keeps_colours, "colour"),
            (has_normals, "normals"),
            (self.has_flags && !is_las, "flags"),
            (self.has_overlap && is_las && version == LasVersion::V10, "overlap flags"),
            (self.has_user_data && !is_las, "user data"),
        ];
        let others = others.into_iter().filter(|(is_there, _)| *is_there).map(|(_, name)| name);
        for name in self.unread.iter().map(String::as_str).chain(others) {
            let message = format!("the copy lacks an attribute of the points: {name}");
            found.warn(Some(Place::of_file(from)), message);
        }
        if self.has_long_objects {
            let message = "numbers of objects that do not fit into 32 bits are truncated in the copy";
            found.warn(Some(Place::of_file(from)), message);
        }
        let is_named =
            matches!(self.format, Some(CloudFormat::Las | CloudFormat::Arrow | CloudFormat::Parquet));
        if !is_named {
            let message = "positions, intensities, classes, returns, times, scan angles, objects, legs, \
                           channels and colours are copied, other attributes are not";
            found.note(Some(Place::of_file(from)), message);
        }
    }

    /// The settings of the copy.
    fn settings(&self, chosen: &CloudSettings, format: PointFormat) -> CloudSettings {
        let mut settings = chosen.clone();
        if settings.bounds.is_empty()
            && let Some(bounds) = self.bounds
        {
            // Records are relative to the centre of the cloud, so that short numbers keep its digits.
            settings.origin = bounds.centre().round();
            settings.bounds = bounds.translated(-settings.origin);
        }
        settings.crs = settings.crs.or_else(|| self.crs.clone());
        settings.highest_class = settings.highest_class.max(self.highest_class.into());
        settings.adjusted_times |= self.has_adjusted_times;
        if format.is_las() && !self.has_extra && settings.las.extra == ExtraDimensions::All {
            // They would be zeros.
            settings.las.extra = ExtraDimensions::None;
        }
        self.add_colours(&mut settings, format);
        settings
    }

    /// Adds columns of colours if the points have colours, the format has a place for them, and no columns
    /// are chosen.
    fn add_colours(&self, settings: &mut CloudSettings, format: PointFormat) {
        let is_old = format.is_las() && settings.las.version == LasVersion::V10;
        if self.max_colour.is_none() || settings.columns.is_some() || is_old {
            return;
        }
        let colours = [Column::Red, Column::Green, Column::Blue];
        if format.has_colours() {
            settings.columns = Some(colours.to_vec());
        } else if format.has_columns() && format != PointFormat::Xyz {
            let mut columns = settings.table_columns();
            columns.extend(colours);
            settings.columns = Some(columns);
        }
    }
}

impl PointSink for SourceFacts {
    fn start(&mut self, attributes: AttributeSet) {
        self.attributes = attributes;
    }

    fn file(&mut self, facts: &FileFacts) {
        self.format = Some(facts.format);
        self.has_adjusted_times = facts.las.as_ref().is_some_and(|las| las.has_adjusted_times);
    }

    fn crs(&mut self, wkt: &str) {
        self.crs = Some(wkt.to_owned());
    }

    fn takes_details(&self) -> bool {
        true
    }

    fn unread(&mut self, attributes: Vec<String>) {
        self.unread = attributes;
    }

    fn details(&mut self, details: &PointDetails) {
        self.has_flags |= !details.stored.flags.is_empty();
        self.has_overlap |= details.stored.flags.has(PointFlags::OVERLAP);
        self.has_user_data |= details.stored.user_data != 0;
        self.has_extra |= details.has_extra();
    }

    fn point(&mut self, row: &PointRow, object: Option<&str>) -> Result<ControlFlow<()>> {
        self.has_long_objects |= object.is_none() && i32::try_from(row.object).is_err();
        if row.position.is_finite() {
            self.bounds = Some(self.bounds.unwrap_or(Aabb::EMPTY).with(row.position));
        }
        self.highest_class = self.highest_class.max(row.class);
        if let Some(colour) = row.colour {
            self.max_colour = colour.into_iter().chain(self.max_colour).max();
        }
        self.has_adjusted_times |= !(0.0..=WEEK_S).contains(&row.time) && row.time.is_finite();
        Ok(ControlFlow::Continue(()))
    }
}

/// Writes points while they are read.
struct CopyWriter {
    writer: CloudWriter,
    settings: CloudSettings,
    /// True if times may have different origins, so that no digit of them is lost.
    has_exact_times: bool,
    /// True if all colours have 8 bits.
    has_byte_colours: bool,
    /// True if the points are those of a LAS file, so that colours stay as they are in LAS.
    is_from_las: bool,
    /// Details of the next point.
    details: Option<PointDetails>,
    /// Numbers of objects with names, in order of appearance.
    objects: HashMap<String, i32>,
    block: Vec<PointRecord>,
}

impl CopyWriter {
    fn flush(&mut self) -> Result<()> {
        self.writer.write(&self.block)?;
        self.block.clear();
        Ok(())
    }
}

impl PointSink for CopyWriter {
    fn start(&mut self, _: AttributeSet) {}

    fn takes_details(&self) -> bool {
        true
    }

    fn details(&mut self, details: &PointDetails) {
        self.details = Some(*details);
    }

    fn point(&mut self, row: &PointRow, object: Option<&str>) -> Result<ControlFlow<()>> {
        let mut record = PointRecord::from(row);
        record.position -= self.settings.origin;
        if self.has_exact_times {
            (record.time_origin, record.time_ns) = (row.time, 0.0);
        }
        if let Some(details) = self.details.take() {
            details.add_to(&mut record);
        }
        if let Some(colour) = row.colour {
            let is_byte = self.has_byte_colours;
            record.set_colour(if is_byte { colour.map(|component| component << 8) } else { colour });
            if self.is_from_las {
                record.stored.colour = Some(colour);
            }
        }
        if let Some(name) = object {
            let next = self.objects.len() as i32 + 1;
            record.object = match self.objects.get(name) {
                Some(number) => *number,
                None => *self.objects.entry(name.to_owned()).or_insert(next),
            };
        }
        self.block.push(record);
        if self.block.len() == BLOCK_POINTS {
            self.flush()?;
        }
        Ok(ControlFlow::Continue(()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::StoredFields;
    use vlscan_geom::DVec3;

    /// All rows of a file with their details.
    #[derive(Default)]
    struct Rows {
        rows: Vec<PointRow>,
        details: Vec<PointDetails>,
    }

    impl PointSink for Rows {
        fn start(&mut self, _: AttributeSet) {}

        fn takes_details(&self) -> bool {
            true
        }

        fn details(&mut self, details: &PointDetails) {
            self.details.push(*details);
        }

        fn point(&mut self, row: &PointRow, _: Option<&str>) -> Result<ControlFlow<()>> {
            self.rows.push(*row);
            Ok(ControlFlow::Continue(()))
        }
    }

    fn lacking(found: &Diagnostics) -> usize {
        found.items().iter().filter(|item| item.message.contains("the copy lacks")).count()
    }

    fn read(path: &Path) -> Rows {
        let mut rows = Rows::default();
        read_points(path, &mut rows).unwrap();
        rows
    }

    #[test]
    fn copies_of_las_keep_every_field() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let settings = CloudSettings { origin: DVec3::new(4e5, 5e6, 100.0), ..CloudSettings::default() };
        let point = |i: u32| PointRecord {
            position: DVec3::new(f64::from(i) * 0.01, 1.0, 2.0),
            amplitude: f64::from(i) * 1e-9,
            range: 10.0 + f64::from(i),
            echo_width: 0.1 * f64::from(i),
            incidence_cosine: 1.0 / f64::from(i),
            time_origin: 3.9e8,
            time_ns: f64::from(i) * 123_456.0,
            pulse_number: u64::from(u32::MAX - i),
            object: i as i32,
            class: 6,
            leg: i as u16,
            stored: StoredFields {
                intensity: i.is_multiple_of(2).then_some(60_000 + i as u16),
                point_source: i.is_multiple_of(3).then_some(0),
                flags: PointFlags::of_format_6(i as u8),
                user_data: i as u8,
                ..StoredFields::default()
            },
            ..PointRecord::default()
        };
        let points: Vec<PointRecord> = (1..5000).map(point).collect();
        let create = |name: &str| {
            let format = PointFormat::required(Path::new(name)).unwrap();
            CloudWriter::create(&at(name), false, format, &settings, &mut Diagnostics::default()).unwrap()
        };
        for (from, to) in [("a.las", "b.laz"), ("c.laz", "d.las")] {
            let mut writer = create(from);
            writer.write(&points).unwrap();
            writer.finish().unwrap();
            let (tally, found) = copy(&at(from), &at(to), &CloudSettings::default()).unwrap();
            assert!(tally.records == 4999 && lacking(&found) == 0, "{}", found.text());
            let (before, after) = (read(&at(from)), read(&at(to)));
            assert_eq!(before.details, after.details);
            for (old, new) in before.rows.iter().zip(&after.rows) {
                assert!((old.position - new.position).abs().max_element() < 1e-6, "{old:?} {new:?}");
                assert_eq!(PointRow { position: new.position, ..*old }, *new);
            }
        }
    }

    #[test]
    fn copies_of_las_keep_the_kind_of_times() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        // A time that both kinds can have.
        let point = PointRecord { time_ns: 5e9, ..PointRecord::default() };
        for (adjusted_times, from, to) in [(false, "a.las", "b.laz"), (true, "c.las", "d.laz")] {
            let settings = CloudSettings { adjusted_times, ..CloudSettings::default() };
            let format = PointFormat::required(Path::new(from)).unwrap();
            let mut found = Diagnostics::default();
            let mut writer = CloudWriter::create(&at(from), false, format, &settings, &mut found).unwrap();
            writer.write(&[point]).unwrap();
            writer.finish().unwrap();
            copy(&at(from), &at(to), &CloudSettings::default()).unwrap();
            // Bit 0 of the global encoding.
            let header = std::fs::read(at(to)).unwrap();
            assert_eq!(header[6] & 1 == 1, adjusted_times, "{to}");
        }
    }

    #[test]
    fn what_a_copy_lacks_is_warned_of_and_foreign_files_keep_their_fields() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        // Format 2 of LAS 1.2: 26 bytes with a colour; a header of 227 bytes.
        let mut file = vec![0; 227];
        file[..4].copy_from_slice(b"LASF");
        (file[24], file[25], file[104]) = (1, 2, 2);
        file[94..96].copy_from_slice(&227_u16.to_le_bytes());
        file[96..100].copy_from_slice(&227_u32.to_le_bytes());
        file[105..107].copy_from_slice(&26_u16.to_le_bytes());
        file[107..111].copy_from_slice(&1_u32.to_le_bytes());
        for scale in [131, 139, 147] {
            file[scale..scale + 8].copy_from_slice(&0.01_f64.to_le_bytes());
        }
        let mut record = [0; 26];
        record[..2].copy_from_slice(&[100, 1]);
        record[12..14].copy_from_slice(&41_332_u16.to_le_bytes());
        // The first of two returns; the scan direction is positive; withheld, class 2.
        (record[14], record[15], record[17]) = (1 | 2 << 3 | 1 << 6, 2 | 1 << 7, 77);
        record[18..20].copy_from_slice(&9_u16.to_le_bytes());
        record[20..26].copy_from_slice(&[255, 255, 1, 2, 0, 128]);
        file.extend_from_slice(&record);
        std::fs::write(at("a.las"), &file).unwrap();
        let (_, found) = copy(&at("a.las"), &at("b.las"), &CloudSettings::default()).unwrap();
        assert_eq!(lacking(&found), 0, "{}", found.text());
        let (before, after) = (read(&at("a.las")), read(&at("b.las")));
        assert_eq!(before.details, after.details);
        let stored = after.details[0].stored;
        assert_eq!((stored.intensity, stored.point_source, stored.user_data), (Some(41_332), Some(9), 77));
        let (before, after) = (before.rows[0], after.rows[0]);
        assert_eq!(after.colour, Some([65_535, 513, 32_768]));
        assert_eq!(PointRow { position: after.position, ..before }, after);
        let mut old = CloudSettings::default();
        old.las.version = LasVersion::V10;
        for (name, settings) in [("old.las", &old), ("a.xyz", &CloudSettings::default())] {
            let (_, found) = copy(&at("a.las"), &at(name), settings).unwrap();
            assert!(found.text().contains("attribute of the points: colour"), "{name}: {}", found.text());
        }
        let (_, found) = copy(&at("a.las"), &at("c.ply"), &CloudSettings::default()).unwrap();
        let said = found.text();
        assert!(said.contains("points: flags") && said.contains("points: user data"), "{said}");
        assert!(copy(&at("a.las"), &at("b.las"), &CloudSettings::default()).is_err(), "it exists");
        assert!(copy(folder.path(), &at("d.las"), &CloudSettings::default()).is_err());
    }

    #[test]
    fn colours_of_8_bits_are_256_times_as_large_in_formats_with_16() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let ply = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n\
                   property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
                   end_header\n1 2 3 255 128 7\n4 5 6 0 1 2\n";
        std::fs::write(at("a.ply"), ply).unwrap();
        let bytes = [[255, 128, 7], [0, 1, 2]].map(Some);
        let shorts = [[65_280, 32_768, 1792], [0, 256, 512]].map(Some);
        let colours = |name: &str| read(&at(name)).rows.iter().map(|row| row.colour).collect::<Vec<_>>();
        for (name, expected) in
            [("b.laz", shorts), ("c.pcd", bytes), ("d.csv", shorts), ("e.ply", bytes), ("f.arrow", shorts)]
        {
            let (_, found) = copy(&at("a.ply"), &at(name), &CloudSettings::default()).unwrap();
            assert_eq!(colours(name), expected, "{name}");
            assert_eq!(lacking(&found), 0, "{name}: {}", found.text());
        }
        copy(&at("b.laz"), &at("g.pcd"), &CloudSettings::default()).unwrap();
        assert_eq!(colours("g.pcd"), bytes);
    }

    #[test]
    fn values_that_a_format_cannot_hold_are_warned_of() {
        let said = |format: &str, version| {
            let mut facts = SourceFacts { format: Some(CloudFormat::Las), ..SourceFacts::default() };
            let flags = PointFlags::OVERLAP;
            let stored = StoredFields { flags, ..StoredFields::default() };
            facts.details(&PointDetails { stored, ..PointDetails::default() });
            let row = PointRow { object: 5_000_000_000, ..PointRow::default() };
            let _ = facts.point(&row, None).unwrap();
            let (format, mut found) =
                (PointFormat::required(Path::new(format)).unwrap(), Diagnostics::default());
            facts.warn(Path::new("a.laz"), (format, version), true, &mut found);
            found.text()
        };
        let old = said("b.las", LasVersion::V10);
        assert!(old.contains("overlap flags") && old.contains("do not fit into 32 bits"), "{old}");
        assert!(!said("b.las", LasVersion::V14).contains("flags"));
        assert!(said("b.xyz", LasVersion::V14).contains("points: flags"));
    }
}
