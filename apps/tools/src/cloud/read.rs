//! Reads point clouds into memory and temporary files.

use super::points::{POINTS_BYTES, Points};
use ::arrow_array::RecordBatch;
use std::path::Path;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_formats::AttributeSet;
use vlscan_geom::MAX_COORDINATE;

/// Reads a point cloud in any format of [`vlscan_formats`]; `-` is stdin. Returns the points and messages:
/// warnings, also about points that are left out, and notes on how the file was interpreted.
///
/// # Errors
/// [`Error::Input`] when the file has no supported format or is damaged, with the invalid lines of text.
pub fn read_points(path: &Path) -> Result<(Points, Diagnostics)> {
    read_within(path, None, None)
}

/// Reads a point cloud as [`read_points`] does, and keeps only the positions and these attributes. The others
/// take no memory, and of LAS no time.
///
/// # Errors
/// The errors of [`read_points`].
pub fn read_attributes(path: &Path, attributes: AttributeSet) -> Result<(Points, Diagnostics)> {
    read_within(path, Some(attributes), None)
}

/// Reads a point cloud as [`read_points`] does, and keeps only the positions and these attributes, or all.
/// Points beyond `max_bytes` of memory, by default 128 MiB, are kept in temporary files; the limit does not
/// change anything else.
///
/// # Errors
/// The errors of [`read_points`].
pub fn read_within(
    path: &Path,
    attributes: Option<AttributeSet>,
    max_bytes: Option<u64>,
) -> Result<(Points, Diagnostics)> {
    let mut points = Points::keeping(attributes, max_bytes.unwrap_or(POINTS_BYTES));
    let found = vlscan_formats::read_points(path, &mut points)?;
    checked(points, path, found)
}

/// The points of a table in memory, and messages as of [`read_points`].
///
/// # Errors
/// [`Error::Input`] for tables without the columns X, Y and Z, for columns of other numbers than integers and
/// floats of 32 and 64 bits, and for empty ones.
pub fn points_of_table(batch: &RecordBatch) -> Result<(Points, Diagnostics)> {
    const NAME: &str = "the table";
    let (mut points, mut found) = (Points::default(), Diagnostics::default());
    vlscan_formats::read_record_batch(batch, NAME, &mut points, &mut found)?;
    checked(points, Path::new(NAME), found)
}

/// The points with what was found and what is to be said of them, or an error if there are none.
fn checked(mut points: Points, path: &Path, mut found: Diagnostics) -> Result<(Points, Diagnostics)> {
    match points.is_empty() {
        true if points.skipped() > 0 => Err(Error::input(format!(
            "{} holds no points with coordinates within ±{MAX_COORDINATE:e} m",
            path.display()
        ))),
        true if points.misses() > 0 => Err(Error::input(format!(
            "{} holds no points: its {} records are pulses without a return",
            path.display(),
            points.misses()
        ))),
        true => Err(Error::input(format!("{} holds no points", path.display()))),
        false => {
            found.extend(points.doubts(path));
            points.leave_out_strays(path, &mut found);
            Ok((points, found))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_formats::Attribute;
    use vlscan_geom::DVec3;

    fn read_bytes(bytes: &[u8], name: &str) -> Result<Points> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        read_points(&path).map(|(points, _)| points)
    }

    fn read(text: &str) -> Result<Points> {
        read_bytes(text.as_bytes(), "cloud.xyz")
    }

    /// Reads a file and returns its warnings.
    fn said(bytes: &[u8], name: &str) -> String {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        read_points(&path).unwrap().1.text()
    }

    #[test]
    fn points_in_temporary_files_are_those_in_memory() {
        let (_folder, path) = written("a.laz", true);
        let read = |bytes| read_within(&path, None, bytes).unwrap().0;
        let (all, few) = (read(None), read(Some(1)));
        few.release();
        assert_eq!((few.len(), few.bounds()), (all.len(), all.bounds()));
        for i in 0..all.len() {
            assert_eq!(few.position(i), all.position(i), "{i}");
            assert_eq!((few.time_of(i), few.intensity_of(i)), (all.time_of(i), all.intensity_of(i)), "{i}");
            assert_eq!(few.return_number_of(i), all.return_number_of(i), "{i}");
        }
        assert_eq!(few.object.to_vec(), all.object.to_vec());
        // Text has positions in metres.
        let text: String = (0..1000).map(|i| format!("{i}.25 {} 1e-3\n", i % 7)).collect();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.xyz");
        std::fs::write(&path, text).unwrap();
        let points = read_within(&path, None, Some(1)).unwrap().0;
        assert_eq!(points.position(999), DVec3::new(999.25, 5.0, 1e-3));
    }

    #[test]
    fn lines_end_in_any_way() {
        let rows: Vec<String> = (0..100).map(|i| format!("{i} 0 5")).collect();
        for end in ["\n", "\r\n", "\r"] {
            for head in ["", "x y z", "# x y z", "//X Y Z"] {
                let text = [vec![head.to_owned()], rows.clone()].concat().join(end);
                let points = read(&text).unwrap();
                assert_eq!((points.len(), points.bounds().max.x), (100, 99.0), "{end:?} {head:?}");
            }
            // A file behind another one whose lines end otherwise.
            let both = format!("1 2 3\n{}{end}", rows.join(end));
            assert_eq!(read(&both).unwrap().len(), 101, "{end:?}");
            let pts = [vec!["100".to_owned()], rows.clone()].concat().join(end);
            assert_eq!(read_bytes(pts.as_bytes(), "a.pts").unwrap().len(), 100, "{end:?}");
            let pcd = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 100\nHEIGHT 1\nDATA ascii\n";
            let pcd = pcd.replace('\n', end) + &rows.join(end);
            assert_eq!(read_bytes(pcd.as_bytes(), "a.pcd").unwrap().len(), 100, "{end:?}");
            let ply = "ply\nformat ascii 1.0\nelement vertex 100\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
            let ply = ply.replace('\n', end) + &rows.join(end);
            assert_eq!(read_bytes(ply.as_bytes(), "a.ply").unwrap().len(), 100, "{end:?}");
        }
        let Err(Error::Input(report)) = read("1 2 3\r4 5 6\r7 two 9\r") else { panic!("read") };
        assert!(report.text().contains("cloud.xyz:3:3"), "{}", report.text());
    }

    #[test]
    fn elements_of_text_ply_need_no_lines() {
        let header = "ply\nformat ascii 1.0\nelement camera 1\nproperty list uchar int k\nelement vertex 2\n\
                      property float x\nproperty float y\nproperty float z\nend_header\n";
        for rows in ["1 7\n1 2 3\n4 5 6\n", "1\n7\n\n1 2\n3\n\n4 5 6", "1 7 1 2 3 4 5 6 "] {
            let points = read_ply(format!("{header}{rows}").as_bytes()).unwrap();
            assert_eq!((points.len(), points.bounds().max), (2, DVec3::new(4.0, 5.0, 6.0)), "{rows:?}");
        }
        for (rows, expected, is_cut) in [
            (
                "1 7\n1 2 3\n4 5",
                "the end of the file; is it truncated? (after 1 of 2 elements \"vertex\")",
                true,
            ),
            ("1 7\n1 2 3\n4 5,5 6", "found \"5,5\", which has a decimal comma", false),
            ("9 7\n1 2 3\n4 5 six", "found \"six\"", false),
        ] {
            let Err(Error::Input(report)) = read_ply(format!("{header}{rows}").as_bytes()) else {
                panic!("read {rows:?}")
            };
            let report = report.text();
            assert!(report.contains(expected) && report.contains("truncated") == is_cut, "{report}");
        }
    }

    #[test]
    fn values_that_are_not_used_as_written_are_told_with_their_place() {
        let text = "x,y,z,class,return,leg,ring,time\n1,2,3,300,1,0,0,5\n4,5,6,-1,1,0,0,5\n\
                    7,8,9,2.7,1,0,0,5\n7,8,9,nan,400,A,-3,noon\n7,8,9,5,1,1,1,5\n";
        let report = said(text.as_bytes(), "a.csv");
        for part in [
            "4 points have a class that is not a whole number from 0 to 255",
            "a.csv:2:7",
            "1 point has a return number",
            "a.csv:5:11",
            "1 point has a leg",
            "1 point has a channel",
            "1 point has a time that is not a number",
        ] {
            assert!(report.contains(part), "{part} is missing from {report}");
        }
        let points = read(text).unwrap();
        assert_eq!(points.class.to_vec(), [255, 0, 2, 0, 5]);
        // Names of objects are not numbers.
        assert_eq!(said(b"x,y,z,object,class\n1,2,3,oak,5\n1,2,3,2.5,255\n", "a.csv"), "");
        let ply = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n\
                   property float label\nend_header\n1 2 3 0.5\n4 5 6 7\n";
        assert!(said(ply.as_bytes(), "a.ply").contains("1 point has a class"));
        let skipped = said(b"inf 0 0\n1 2 3\n", "a.xyz");
        assert!(skipped.contains("1 point without coordinates"), "{skipped}");
    }

    #[test]
    fn commas_that_do_not_separate_are_decimal_commas() {
        for text in [
            "1,5\t2,5\t3,5\n",
            "1,5 2,5 3,5\n",
            "x y z\n1,5 2,5 3,5\n",
            "X\tY\tZ\n1,5\t2,5\t3,5\n",
            "1,5;2,5;3,5\n",
            "\"x\";\"y\";\"z\"\n\"1,5\";\"2,5\";\"3,5\"\n",
            "\"1.5\",\"2.5\",\"3.5\"\n",
            "1\n1,5 2,5 3,5 100\n",
        ] {
            assert_eq!(read(text).unwrap().bounds().max, DVec3::new(1.5, 2.5, 3.5), "{text:?}");
        }
        for text in ["1.5 2 3\n4.5 5,5 6\n", "\"1,5\",\"2,5\",\"3,5\"\n", "2\n1 2 3 100\n4.5 5,5 6,5 100\n"] {
            let Err(Error::Input(report)) = read(text) else { panic!("read {text:?}") };
            let report = report.text();
            assert!(
                report.contains("decimal comma") && report.contains("decimal point"),
                "{text:?}: {report}"
            );
            assert!(!report.contains("columns are named"), "{text:?}: {report}");
        }
    }

    #[test]
    fn point_files_of_eleven_columns_have_everything() {
        // The example of spec outputs §3, and a line whose object has no name.
        let points = read(
            "-2.8380 -25.5432 -0.0065 5.6037 0.0000 1 2 1 17 5 86391.000000000\n\
             1 2 3 4.5 0.0000 2 2 1  6 86391.000000000\n",
        )
        .unwrap();
        assert_eq!(points.len(), 2);
        assert_eq!(points.bounds().min, DVec3::new(-2.838, -25.5432, -0.0065));
        assert_eq!(points.class.to_vec(), [5, 6]);
        assert_eq!(points.return_number.to_vec(), [1, 2]);
        assert_eq!(points.objects, ["17", ""]);
        assert_eq!(points.intensity.to_vec(), [5.6037, 4.5]);
    }

    #[test]
    fn plain_coordinates_in_any_dress() {
        for text in [
            "1 2 3\n4 5 6",
            "# a note\nx y z\n1\t2\t3\r\n\r\n4   5 6\r\n",
            "X,Y,Z\n1,2,3\n4,5,6\n",
            "1; 2; 3\n// note\n4; 5; 6\n",
        ] {
            let points = read(text).unwrap();
            assert!(points.len() == 2 && !points.has(Attribute::Intensity), "{text:?}");
            assert_eq!(points.bounds().max, DVec3::new(4.0, 5.0, 6.0), "{text:?}");
        }
        assert!(read("1 2 3 0.5\n").unwrap().has(Attribute::Intensity));
    }

    #[test]
    fn a_line_of_names_tells_the_columns() {
        let points =
            read("GpsTime,Z,X,Y,Note,ReturnNumber,Amplitude\n9,3,1,2,oak,1,0.5\n9,6,4,5,ash,2,0.25\n")
                .unwrap();
        assert_eq!(points.bounds().max, DVec3::new(4.0, 5.0, 6.0));
        assert_eq!((points.return_number.to_vec(), points.intensity.to_vec()), (vec![1, 2], vec![0.5, 0.25]));
        let Err(Error::Input(report)) = read("Z,X,Y,T,ReturnNumber\n1,2,3,4,5\n1,2,three,4,5\n") else {
            panic!("read")
        };
        let report = report.text();
        assert!(report.contains("cloud.xyz:3:5") && report.contains("\"three\""), "{report}");
    }

    #[test]
    fn wrong_lines_are_reported_together_with_their_places() {
        let Err(Error::Input(report)) = read("1 2 3\n  1 two 3\n4 5\n7 8 9\n") else { panic!("accepted") };
        assert_eq!(report.items().len(), 2);
        let report = report.text();
        assert!(
            report.contains("cloud.xyz:2:5") && report.contains("expected y") && report.contains("\"two\"")
        );
        assert!(report.contains("cloud.xyz:3") && report.contains("expected z"), "{report}");
    }

    #[test]
    fn rubbish_ends_in_a_report() {
        for bytes in [&b""[..], b"\n\n", b"#only a comment\n", b"\xff\xfe\x00\x01\x02", &[0u8; 300_000]] {
            assert!(matches!(read_bytes(bytes, "rubbish"), Err(Error::Input(_))));
        }
        // Infinite coordinates are numbers; the point is skipped.
        assert!(matches!(read("inf 0 0\n"), Err(Error::Input(_))));
        assert_eq!(read("inf 0 0\n1 2 3\n").unwrap().skipped(), 1);
    }

    fn written(name: &str, compressed: bool) -> (tempfile::TempDir, std::path::PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        let mut builder = las::Builder::from((1, 4));
        builder.point_format = las::point::Format::new(6).unwrap();
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
                scan_angle: -12.0,
                classification: las::point::Classification::new(5).unwrap(),
                extra_bytes: extra,
                gps_time: Some(3e8 + f64::from(i / 3) * 1e-6),
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
            let points = read_points(&path).unwrap().0;
            assert_eq!(points.len(), 1000, "{name}");
            assert!((points.bounds().max.x - 99.9).abs() < 1e-9);
            assert_eq!(points.class.at(7), 5);
            assert_eq!(points.return_number.to_vec()[..4], [1, 2, 3, 1]);
            assert_eq!(points.number_of_returns.to_vec()[..2], [3, 3]);
            assert_eq!(points.scan_angle.at(0), -12.0);
            assert_eq!(points.intensity.at(321), 321.0);
            assert_eq!(points.objects, ["0", "1"]);
            let time = |i| points.time_of(i).unwrap();
            assert_eq!((time(0), time(999)), (3e8, 3e8 + 333e-6));
        }
    }

    #[test]
    fn damaged_files_are_input_problems() {
        let (folder, path) = written("a.las", false);
        let whole = std::fs::read(path).unwrap();
        for length in [0, 3, 100, 300, whole.len() - 5000] {
            let cut = folder.path().join("cut.las");
            std::fs::write(&cut, &whole[..length]).unwrap();
            assert!(matches!(read_points(&cut), Err(Error::Input(_))), "cut at {length}");
        }
        assert!(matches!(read_points(&folder.path().join("none.las")), Err(Error::Input(_))));
    }

    const HEADER: &str = "element camera 1\nproperty float focal\nelement vertex 2\nproperty double x\n\
                          property double y\nproperty float z\nproperty uchar Classification\n\
                          property int hit_object_id\nproperty list uchar int unused\nend_header\n";

    fn read_ply(bytes: &[u8]) -> Result<Points> {
        read_bytes(bytes, "cloud.ply")
    }

    fn check(points: &Points) {
        assert_eq!(points.len(), 2);
        assert_eq!(points.bounds().min, DVec3::new(1.25, 2.0, 3.0));
        assert_eq!(points.bounds().max.x, 5_474_500.125);
        assert_eq!(points.class.to_vec(), [2, 5]);
        assert_eq!(points.objects, ["7", "-1"]);
        assert!(!points.has(Attribute::Intensity));
    }

    #[test]
    fn text_and_binary_files_are_alike() {
        let text =
            format!("ply\nformat ascii 1.0\n{HEADER}35.0\n1.25 2 3 2 7 0\n5474500.125 5 6 5 -1 2 8 9\n");
        check(&read_ply(text.as_bytes()).unwrap());
        let mut binary = format!("ply\nformat binary_little_endian 1.0\n{HEADER}").into_bytes();
        binary.extend_from_slice(&35f32.to_le_bytes());
        for (x, y, z, class, object, list) in
            [(1.25, 2.0, 3f32, 2u8, 7i32, &[][..]), (5_474_500.125, 5.0, 6.0, 5, -1, &[8i32, 9][..])]
        {
            binary.extend_from_slice(&f64::to_le_bytes(x));
            binary.extend_from_slice(&f64::to_le_bytes(y));
            binary.extend_from_slice(&z.to_le_bytes());
            binary.push(class);
            binary.extend_from_slice(&object.to_le_bytes());
            binary.push(list.len() as u8);
            list.iter().for_each(|v| binary.extend_from_slice(&v.to_le_bytes()));
        }
        check(&read_ply(&binary).unwrap());
        // Truncated at any length, it is an input error.
        for length in (0..binary.len()).step_by(7) {
            assert!(matches!(read_ply(&binary[..length]), Err(Error::Input(_))), "cut at {length}");
        }
    }

    #[test]
    fn a_vast_count_does_not_ask_for_memory() {
        let text =
            "ply\nformat ascii 1.0\nelement vertex 18446744073709551615\nproperty float x\nend_header\n1\n";
        assert!(matches!(read_ply(text.as_bytes()), Err(Error::Input(_))));
    }
}
