//! Tests of files that no writer at hand makes.

use super::*;
use crate::{AttributeSet, NewPart, PointFile, PointPart, PointRow, PointSink};
use laz::record::{RecordCompressor, SequentialPointRecordCompressor};
use laz::{LasZipCompressor, LazItemRecordBuilder, LazItemType, LazVlr, LazVlrBuilder};
use std::any::Any;
use std::io::Cursor;
use std::path::Path;
use vlscan_base::diag::{Diagnostics, ProblemKind};

/// Bytes of a header of LAS 1.2, and of that of a variable record.
const HEADER_BYTES: u32 = 227;
const RECORD_HEAD_BYTES: u32 = 54;

/// A file of LAS 1.2 with variable records and points of format 0.
fn file(
    count: u32,
    is_compressed: bool,
    records: impl IntoIterator<Item = (&'static str, u16, Vec<u8>)>,
    points: &[u8],
) -> Vec<u8> {
    let mut bytes = vec![0; HEADER_BYTES as usize];
    bytes[..4].copy_from_slice(b"LASF");
    bytes[24..26].copy_from_slice(&[1, 2]);
    bytes[94..96].copy_from_slice(&(HEADER_BYTES as u16).to_le_bytes());
    bytes[104] = if is_compressed { 0x80 } else { 0 };
    bytes[105] = 20;
    bytes[107..111].copy_from_slice(&count.to_le_bytes());
    for axis in 0..3 {
        bytes[131 + 8 * axis..139 + 8 * axis].copy_from_slice(&0.01f64.to_le_bytes());
    }
    for (user, id, data) in records {
        let mut head = vec![0; RECORD_HEAD_BYTES as usize];
        head[2..2 + user.len()].copy_from_slice(user.as_bytes());
        head[18..20].copy_from_slice(&id.to_le_bytes());
        head[20..22].copy_from_slice(&(data.len() as u16).to_le_bytes());
        bytes.extend(head);
        bytes.extend(data);
        bytes[100] += 1;
    }
    let data_at = bytes.len() as u32;
    bytes[96..100].copy_from_slice(&data_at.to_le_bytes());
    bytes.extend_from_slice(points);
    bytes
}

/// Records of format 0 at 0.01, 0.02 … m along x.
fn records(count: i32) -> Vec<[u8; 20]> {
    let record = |i: i32| {
        let mut record = [0; 20];
        record[..4].copy_from_slice(&i.to_le_bytes());
        record[12..14].copy_from_slice(&(i as u16).to_le_bytes());
        record
    };
    (1..=count).map(record).collect()
}

/// The points of a file and the messages about it.
fn read(bytes: &[u8]) -> (Vec<PointRow>, Vec<String>) {
    let (rows, found) = read_with_causes(bytes);
    (rows, found.items().iter().map(|item| item.message.clone()).collect())
}

fn read_with_causes(bytes: &[u8]) -> (Vec<PointRow>, Diagnostics) {
    read_on(bytes, 1)
}

/// Reads a file on some threads.
fn read_on(bytes: &[u8], threads: usize) -> (Vec<PointRow>, Diagnostics) {
    read_selected(bytes, threads, Selection::All)
}

/// Reads a file on some threads into a sink that uses parts of blocks.
fn read_in_parts(bytes: &[u8], threads: usize) -> (Vec<PointRow>, Diagnostics) {
    struct Part(Vec<PointRow>);
    impl PointPart for Part {
        fn add(&mut self, row: &PointRow) {
            self.0.push(*row);
        }
        fn clear(&mut self) {
            self.0.clear();
        }
    }
    struct Parts(Vec<PointRow>);
    impl PointSink for Parts {
        fn start(&mut self, _: AttributeSet) {}
        fn parts(&self) -> Option<NewPart> {
            Some(Box::new(|| -> Box<dyn PointPart> { Box::new(Part(Vec::new())) }))
        }
        fn add_part(&mut self, part: &mut (dyn PointPart + 'static)) -> vlscan_base::Result<ControlFlow<()>> {
            let part: &mut dyn Any = part;
            self.0.append(&mut part.downcast_mut::<Part>().unwrap().0);
            Ok(ControlFlow::Continue(()))
        }
        fn point(&mut self, row: &PointRow, _: Option<&str>) -> vlscan_base::Result<ControlFlow<()>> {
            self.0.push(*row);
            Ok(ControlFlow::Continue(()))
        }
    }
    let (mut rows, mut found) = (Parts(Vec::new()), Diagnostics::default());
    let file = PointFile::new(Path::new("a.las"), bytes, &mut found).unwrap().on_threads(threads);
    file.read(Selection::All, &mut rows, &mut found).unwrap();
    (rows.0, found)
}

/// Reads the selected attributes of a file on some threads.
pub(super) fn read_selected(
    bytes: &[u8],
    threads: usize,
    selection: Selection,
) -> (Vec<PointRow>, Diagnostics) {
    struct Rows(Vec<PointRow>);
    impl PointSink for Rows {
        fn start(&mut self, _: AttributeSet) {}
        fn point(&mut self, row: &PointRow, _: Option<&str>) -> vlscan_base::Result<ControlFlow<()>> {
            self.0.push(*row);
            Ok(ControlFlow::Continue(()))
        }
    }
    let (mut rows, mut found) = (Rows(Vec::new()), Diagnostics::default());
    let file = PointFile::new(Path::new("a.las"), bytes, &mut found).unwrap().on_threads(threads);
    file.read(selection, &mut rows, &mut found).unwrap();
    (rows.0, found)
}

#[test]
fn causes_tell_truncated_files_from_unsupported_ones() {
    let points = records(5).concat();
    let (_, found) = read_with_causes(&file(6, false, None, &points));
    assert!(matches!(found.cause::<LasError>(), Some(LasError::Points { at: 5, count: 6, .. })));
    assert!(found.has(ProblemKind::Truncated) && !found.has(ProblemKind::Unsupported));
    let mut other = file(5, false, None, &points);
    other[104] = 11;
    let (_, found) = read_with_causes(&other);
    assert!(matches!(found.cause::<LasError>(), Some(LasError::Version { format: 11, .. })));
    assert!(found.has(ProblemKind::Unsupported) && !found.has(ProblemKind::Truncated));
}

#[test]
fn scales_of_extra_dimensions_that_cannot_be_used_are_warned_of() {
    let points = records(1).concat();
    let mut amplitude = vec![0; 192];
    (amplitude[2], amplitude[3]) = (9, 8);
    amplitude[4..19].copy_from_slice(b"heliosAmplitude");
    let (_, said) = read(&file(1, false, Some(("LASF_Spec", 4, amplitude.clone())), &points));
    assert!(said.len() == 1 && said[0].contains("heliosAmplitude has a scale of 0"), "{said:?}");
    amplitude[112..120].copy_from_slice(&0.5f64.to_le_bytes());
    let (_, said) = read(&file(1, false, Some(("LASF_Spec", 4, amplitude)), &points));
    assert_eq!(said, [""; 0]);
}

#[test]
fn points_of_one_chunk_without_a_table_are_read() {
    let items = LazItemRecordBuilder::new().add_item(LazItemType::Point10).build();
    let mut compressor = SequentialPointRecordCompressor::new(std::io::Cursor::new(Vec::new()));
    compressor.set_fields_from(&items).unwrap();
    for record in records(1000) {
        compressor.compress_next(&record).unwrap();
    }
    compressor.done().unwrap();
    let compressed = compressor.get_mut().get_ref().clone();
    let mut record = Vec::new();
    LazVlr::from_laz_items(items).write_to(&mut record).unwrap();
    record[..2].copy_from_slice(&1u16.to_le_bytes());
    for size in [0u32, 50_000, u32::MAX] {
        record[12..16].copy_from_slice(&size.to_le_bytes());
        let record = Some((LazVlr::USER_ID, LazVlr::RECORD_ID, record.clone()));
        let (rows, said) = read(&file(1000, true, record, &compressed));
        assert_eq!(said, [""; 0]);
        assert_eq!((rows.len(), rows[999].position.x, rows[999].intensity), (1000, 10.0, 1000.0));
    }
}

#[test]
fn numbers_of_points_are_compared_with_the_size_of_the_file() {
    let points = records(5).concat();
    let (rows, said) = read(&file(5, false, None, &points));
    assert_eq!((rows.len(), said.len()), (5, 0));
    let (rows, said) = read(&file(0, false, None, &points));
    assert!(rows.len() == 5 && said[0].contains("states 0 points, 5 records follow"), "{said:?}");
    let (rows, said) = read(&file(3, false, None, &points));
    assert!(rows.len() == 3 && said[0].contains("states 3 points, there is room for 5"), "{said:?}");
    let (_, said) = read(&file(6, false, None, &points));
    assert!(said[0].contains("after 5 of 6 points"), "{said:?}");
}

#[test]
fn withheld_points_of_other_programs_are_no_pulses_without_a_return() {
    let mut record = [0; 20];
    record[15] = 1 << 7;
    let mut bytes = file(1, false, None, &record);
    for (software, is_miss) in [("", false), ("laspy 2.5.4", false), ("vlscan 1.0.0", true)] {
        bytes[58..90].fill(0);
        bytes[58..58 + software.len()].copy_from_slice(software.as_bytes());
        let (rows, _) = read(&bytes);
        assert_eq!((rows.len(), rows[0].is_miss), (1, is_miss), "{software}");
    }
    let mut direction = vec![0; 192];
    direction[2] = 9;
    direction[4..18].copy_from_slice(b"BeamDirectionX");
    let (rows, _) = read(&file(1, false, Some(("LASF_Spec", 4, direction)), &record));
    assert!(rows[0].is_miss);
}

#[test]
fn degrees_are_refused_and_feet_become_metres() {
    let keys = |entries: &[[u16; 4]]| {
        let head = [1, 1, 0, entries.len() as u16];
        let words = head.into_iter().chain(entries.iter().flatten().copied());
        Some(("LASF_Projection", 34_735, words.flat_map(u16::to_le_bytes).collect::<Vec<u8>>()))
    };
    let points = records(5).concat();
    let (rows, said) = read(&file(5, false, keys(&[[1024, 0, 1, 2], [2048, 0, 1, 4326]]), &points));
    assert!(rows.is_empty() && said[0].contains("longitude and latitude"), "{said:?}");
    // A geocentric system, of coordinates that are far from the surface of the Earth, and of others.
    let geocentric = || keys(&[[1024, 0, 1, 3], [2048, 0, 1, 4978]]);
    let (rows, said) = read(&file(5, false, geocentric(), &points));
    assert!(rows.len() == 5 && said[0].contains("is geocentric, its coordinates are not"), "{said:?}");
    let mut record = [0; 20];
    record[..4].copy_from_slice(&637_800_000i32.to_le_bytes());
    let (rows, said) = read(&file(1, false, geocentric(), &record));
    assert!(rows.is_empty() && said[0].contains("z is not the height"), "{said:?}");
    let (rows, said) = read(&file(5, false, keys(&[[1024, 0, 1, 1], [3076, 0, 1, 9002]]), &points));
    assert!((rows[4].position.x - 0.05 * 0.3048).abs() < 1e-12, "{rows:?}");
    assert!(said.len() == 2 && said[0].contains("0.3048") && said[1].contains("heights"), "{said:?}");
    let (rows, said) = read(&file(5, false, keys(&[[1024, 0, 1, 1], [3072, 0, 1, 25832]]), &points));
    assert!(said.is_empty() && rows[4].position.x == 0.05, "{said:?}");
}

#[test]
fn units_of_keys_are_those_of_the_registry() {
    const US_FOOT: f64 = 1200.0 / 3937.0;
    /// Records at x = z = 1.
    fn cubes() -> Vec<u8> {
        let mut record = [0; 20];
        record[..4].copy_from_slice(&100i32.to_le_bytes());
        record[8..12].copy_from_slice(&100i32.to_le_bytes());
        record.to_vec()
    }
    let said_of = |entries: &[[u16; 2]]| {
        let head = [1, 1, 0, entries.len() as u16];
        let words = head.into_iter().chain(entries.iter().flat_map(|[key, value]| [*key, 0, 1, *value]));
        let keys = ("LASF_Projection", 34_735, words.flat_map(u16::to_le_bytes).collect::<Vec<u8>>());
        let (rows, said) = read(&file(1, false, Some(keys), &cubes()));
        (rows[0].position, said)
    };
    for (entries, x, z, words) in [
        // New York in feet with NAVD88 in metres; UTM with NGVD29 in US survey feet.
        (&[[3072, 2263], [4096, 5703]][..], US_FOOT, 1.0, &["US survey feet", "heights in metres"][..]),
        (
            &[[3072, 26910], [4096, 5702]],
            1.0,
            US_FOOT,
            &["x and y are in metres", "heights in US survey feet"],
        ),
        (&[[3072, 26910], [4096, 5703]], 1.0, 1.0, &[]),
        (
            &[[3072, 2263], [4096, 5103]],
            US_FOOT,
            US_FOOT,
            &["US survey feet", "not stated; that of x and y is assumed"],
        ),
        (&[[3076, 9096], [4099, 9001]], 0.9144, 1.0, &["yards"]),
        (
            &[[3076, 9999]],
            1.0,
            1.0,
            &["unit of its x and y (EPSG code 9999) is not known; metres are assumed"],
        ),
        (
            &[[3072, 2263], [3076, 9999], [4099, 9001]],
            US_FOOT,
            1.0,
            &["in US", "9999) is not known; US survey feet"],
        ),
        (&[[3072, 26910], [4099, 9999]], 1.0, 1.0, &["unit of its heights (EPSG code 9999) is not known"]),
        (
            &[[4099, 9002]],
            1.0,
            0.3048,
            &["heights in feet (0.3048 m)", "x and y is not stated; metres are assumed"],
        ),
        (&[[3072, 29_999], [4099, 9001]], 1.0, 1.0, &["EPSG:29999 is not built in"]),
        (&[[3072, 29_999], [3076, 9001]], 1.0, 1.0, &[]),
    ] {
        let (position, said) = said_of(entries);
        assert!((position - DVec3::new(x, 0.0, z)).length() < 1e-9, "{entries:?}: {position} {said:?}");
        let all = said.join("; ");
        assert!(words.iter().all(|word| all.contains(word)), "{entries:?}: {said:?}");
        assert_eq!(said.is_empty(), words.is_empty(), "{entries:?}: {said:?}");
    }
}

#[test]
fn systems_that_programs_describe_in_a_text_have_their_units() {
    let keys = [1u16, 1, 0, 1, 3072, 0, 1, 32_767].into_iter().flat_map(u16::to_le_bytes).collect();
    let mut bytes = file(5, false, Some(("LASF_Projection", 34_735, keys)), &records(5).concat());
    // A second variable record, before the points.
    let text = b"ESRI PE String = PROJCS[\"p\",GEOGCS[\"g\",UNIT[\"Degree\",0.0174]],UNIT[\"Foot_US\",0.3048006096012192]]|";
    let mut record = vec![0; RECORD_HEAD_BYTES as usize];
    record[2..17].copy_from_slice(b"LASF_Projection");
    record[18..20].copy_from_slice(&34_737u16.to_le_bytes());
    record[20..22].copy_from_slice(&(text.len() as u16).to_le_bytes());
    record.extend_from_slice(text);
    let at = u32::from_le_bytes(std::array::from_fn(|i| bytes[96 + i])) as usize;
    bytes[100] = 2;
    bytes[96..100].copy_from_slice(&((at + record.len()) as u32).to_le_bytes());
    bytes.splice(at..at, record);
    let (rows, said) = read(&bytes);
    assert!((rows[4].position.x - 0.05 * 1200.0 / 3937.0).abs() < 1e-12, "{rows:?}");
    assert!(said[0].contains("US survey feet"), "{said:?}");
}

#[test]
fn compressions_that_are_not_read_are_named() {
    let items = LazItemRecordBuilder::new().add_item(LazItemType::Point10).build();
    let mut description = Vec::new();
    LazVlr::from_laz_items(items).write_to(&mut description).unwrap();
    let points = records(5).concat();
    let of = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut record = description.clone();
        change(&mut record);
        read(&file(5, true, Some((LazVlr::USER_ID, LazVlr::RECORD_ID, record)), &points))
    };
    // Points that the compressor 0 stores are those of LAS.
    let (rows, said) = of(&|record| record[0] = 0);
    assert!(rows.len() == 5 && rows[4].intensity == 5.0 && said.is_empty(), "{said:?}");
    type Change = fn(&mut Vec<u8>);
    let cases: [(Change, &str); 4] = [
        (|record| record[0] = 4, "LAZ compressor 4"),
        (|record| record[2] = 1, "LAZ coder 1"),
        (|record| record[34] = 5, "LAZ kind 5"),
        (|record| record[38] = 7, "version 7 of LAZ"),
    ];
    for (change, expected) in cases {
        let (rows, said) = of(&change);
        assert!(rows.is_empty() && said[0].contains(expected), "{said:?}");
        assert!(said[0].contains("laszip -i") && said[0].contains("pdal translate"), "{said:?}");
        assert!(!said[0].contains("truncated"), "{said:?}");
    }
    for length in [1, 3, 20, 33, 37] {
        let (_, said) = of(&|record| record.truncate(length));
        assert!(said[0].contains("too short; is the file truncated?"), "{length}: {said:?}");
    }
    let (_, said) = read(&file(5, true, None, &points));
    assert!(said[0].contains("LASzip record") && said[0].contains("pdal translate"), "{said:?}");
    // Chunks of various sizes whose table lies behind the end of the file.
    let mut cut = points.clone();
    cut[..8].copy_from_slice(&100_000u64.to_le_bytes());
    let mut record = description;
    record[12..16].copy_from_slice(&u32::MAX.to_le_bytes());
    let (_, said) = read(&file(5, true, Some((LazVlr::USER_ID, LazVlr::RECORD_ID, record)), &cut));
    assert!(said[0].contains("ends within its compressed points; is it truncated?"), "{said:?}");
    assert!(!said[0].contains("IoError") && !said[0].contains("buffer"), "{said:?}");
}

/// A file of compressed records of a format, in chunks of a hundred or of various numbers of points.
fn chunked(format: u8, records: &[Vec<u8>], is_variable: bool) -> Vec<u8> {
    chunked_with(format, records, is_variable, None)
}

/// The same with these descriptors of extra bytes.
pub(super) fn chunked_with(
    format: u8,
    records: &[Vec<u8>],
    is_variable: bool,
    descriptors: Option<Vec<u8>>,
) -> Vec<u8> {
    let extra_bytes = records[0].len() - if format == 0 { 20 } else { 30 };
    let items = LazItemRecordBuilder::default_for_point_format_id(format, extra_bytes as u16).unwrap();
    let builder = LazVlrBuilder::new(items);
    let vlr = match is_variable {
        true => builder.with_variable_chunk_size().build(),
        false => builder.with_fixed_chunk_size(100).build(),
    };
    let mut description = Vec::new();
    vlr.write_to(&mut description).unwrap();
    let description = (LazVlr::USER_ID, LazVlr::RECORD_ID, description);
    let extra = descriptors.map(|descriptors| ("LASF_Spec", 4, descriptors));
    let mut bytes = file(records.len() as u32, true, [description].into_iter().chain(extra), &[]);
    bytes[104] |= format;
    bytes[105] = records[0].len() as u8;
    let mut out = Cursor::new(bytes);
    out.set_position(out.get_ref().len() as u64);
    let mut compressor = LasZipCompressor::new(out, vlr).unwrap();
    for (i, record) in records.iter().enumerate() {
        compressor.compress_one(record).unwrap();
        if is_variable && matches!(i % 190, 20 | 150) {
            compressor.finish_current_chunk().unwrap();
        }
    }
    compressor.done().unwrap();
    compressor.into_inner().into_inner()
}

/// Records of a format with this length whose values change irregularly.
pub(super) fn irregular(count: u32, length: usize) -> Vec<Vec<u8>> {
    let record = |i: u32| {
        let mut record = vec![0; length];
        let noise = i.wrapping_mul(2_654_435_761);
        record[..4].copy_from_slice(&i.to_le_bytes());
        record[4..8].copy_from_slice(&(noise >> 20).to_le_bytes());
        record[12..14].copy_from_slice(&((noise >> 8) as u16).to_le_bytes());
        record
    };
    (0..count).map(record).collect()
}

/// Checks that the points and the messages about a file do not depend on the number of threads, nor on parts
/// of blocks; returns both.
pub(super) fn same_on_threads(bytes: &[u8], what: &str) -> (Vec<PointRow>, String) {
    let (rows, found) = read_on(bytes, 1);
    for threads in [2, 5] {
        for (others, said) in [read_on(bytes, threads), read_in_parts(bytes, threads)] {
            assert!(rows == others, "{what}, {threads} threads: {} and {} points", rows.len(), others.len());
            assert_eq!(said.text(), found.text(), "{what}, {threads} threads");
        }
    }
    (rows, found.text())
}

#[test]
fn points_do_not_depend_on_the_number_of_threads() {
    let plain = file(1000, false, None, &irregular(1000, 20).concat());
    let (rows, said) = same_on_threads(&plain, "plain");
    assert_eq!((rows.len(), said.as_str()), (1000, ""));
    let (rows, said) = same_on_threads(&plain[..plain.len() - 3005], "a plain file that is cut");
    assert!(rows.len() == 849 && said.contains("the file ends after 849 of 1000 points"), "{said}");
    for (format, length) in [(0, 20), (6, 30)] {
        for is_variable in [false, true] {
            let what = format!("format {format}, {is_variable}");
            let whole = chunked(format, &irregular(1000, length), is_variable);
            let (rows, said) = same_on_threads(&whole, &what);
            assert_eq!((rows.len(), said.as_str()), (1000, ""), "{what}");
            assert!((0..1000).all(|i| rows[i].position.x == 0.01 * i as f64), "{what}");
        }
    }
}

#[test]
fn attributes_that_are_not_selected_are_0_and_the_others_as_in_the_file() {
    use crate::Attribute::{Class, Intensity, Leg, ScanAngle, Time};
    let mut records = irregular(1000, 30);
    for (i, record) in (0_u16..).zip(&mut records) {
        (record[14], record[16]) = (0x21, (i % 7) as u8);
        record[18..20].copy_from_slice(&(i % 50 * 100).to_le_bytes());
        record[20..22].copy_from_slice(&(1 + i / 300).to_le_bytes());
        record[22..30].copy_from_slice(&(0.5 + f64::from(i)).to_le_bytes());
    }
    let mut plain = file(1000, false, None, &records.concat());
    (plain[104], plain[105]) = (6, 30);
    for (bytes, what) in [(chunked(6, &records, false), "compressed"), (plain, "plain")] {
        let all = read_on(&bytes, 1).0;
        assert_eq!((all[907].class, all[907].leg, all[907].time), (4, 3, 907.5), "{what}");
        for selected in [vec![], vec![Class], vec![Time, Leg], vec![ScanAngle, Intensity]] {
            let has = |attribute| selected.contains(&attribute);
            let expected = |row: &PointRow| PointRow {
                intensity: if has(Intensity) { row.intensity } else { 0.0 },
                scan_angle: if has(ScanAngle) { row.scan_angle } else { 0.0 },
                leg: if has(Leg) { row.leg } else { 0 },
                point_source: if has(Leg) { row.point_source } else { 0 },
                time: if has(Time) { row.time } else { 0.0 },
                ..*row
            };
            let expected: Vec<PointRow> = all.iter().map(expected).collect();
            for threads in [1, 2, 5] {
                let selection = Selection::Attributes(AttributeSet::of(has));
                let rows = read_selected(&bytes, threads, selection).0;
                assert!(rows == expected, "{what}, {selected:?}, {threads} threads");
            }
        }
    }
}

#[test]
fn damage_has_the_same_place_on_any_number_of_threads() {
    for (format, length) in [(0, 20), (6, 30)] {
        for is_variable in [false, true] {
            let whole = chunked(format, &irregular(1000, length), is_variable);
            let data_at = u32::from_le_bytes(std::array::from_fn(|i| whole[96 + i])) as usize;
            let mut errors = 0;
            for at in (data_at..whole.len()).step_by((whole.len() - data_at) / 40) {
                let what = format!("format {format}, {is_variable}, byte {at}");
                let mut damaged = whole.clone();
                damaged[at] ^= 0x55;
                errors += usize::from(!same_on_threads(&damaged, &what).1.is_empty());
                same_on_threads(&whole[..at], &format!("{what}, cut"));
            }
            assert!(errors > 0, "format {format}, {is_variable}");
        }
    }
    // The size of a layer of the sixth chunk.
    let whole = chunked(6, &irregular(1000, 30), false);
    let record = irregular(1000, 30).swap_remove(500);
    let size = whole.windows(30).position(|bytes| bytes == record).unwrap() + 30 + 4;
    let mut damaged = whole;
    damaged[size..size + 4].copy_from_slice(&u32::MAX.to_le_bytes());
    let (rows, said) = same_on_threads(&damaged, "a layer");
    assert!(
        rows.len() == 500 && said.contains("a chunk is longer than the file after 500 of 1000"),
        "{said}"
    );
}
