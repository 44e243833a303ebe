//! Scan patterns of tables, and correction files, in pipelines.

use super::*;
use std::f64::consts::TAU;
use vlscan_geom::DVec3;
use vlscan_tables::NumberTable;

/// The survey of a pipeline with these keys of `[scanner]` and `[settings]`, in a folder of these files.
fn of_files(
    scanner: &str,
    settings: &str,
    files: &[(&str, &[u8])],
) -> vlscan_base::Result<(Survey, Diagnostics)> {
    let text = format!(
        "scene = \"a.obj\"\n[scanner]\n{scanner}\n[settings]\nmax_duration_s = 1\n{settings}\n[[leg]]\nposition_m = [0, 0, 0]\n"
    );
    let folder = Folder::new(&[("p.toml", &text), ("a.obj", "")]);
    for (name, bytes) in files {
        std::fs::write(folder.path(name), bytes).unwrap();
    }
    read_pipeline(&folder.path("p.toml"))
}

const PATTERN: &str = "optics = \"pattern\"\npattern = \"rows.csv\"\n";

/// The survey of a pattern of this table, and the warnings.
fn pattern(keys: &str, table: &str) -> vlscan_base::Result<(Survey, Diagnostics)> {
    of_files(&format!("{PATTERN}{keys}"), "", &[("rows.csv", table.as_bytes())])
}

fn table(device: &Device) -> &PatternTable {
    match &device.deflector {
        Deflector::Pattern(table) => table,
        other => panic!("no pattern: {other:?}"),
    }
}

/// Directions of the rows of a device.
fn beams(device: &Device) -> Vec<DVec3> {
    (0..table(device).len() as u32).map(|row| table(device).attitude(row).forward()).collect()
}

fn fine(read: vlscan_base::Result<(Survey, Diagnostics)>) -> Survey {
    let (survey, warnings) = read.unwrap_or_else(|e| panic!("{}", report(&e)));
    assert!(warnings.is_empty(), "{}", warnings.render(false));
    survey
}

/// A direction by azimuth, clockwise, and elevation in degrees.
fn towards(azimuth: f64, elevation: f64) -> DVec3 {
    let (sin, cos) = azimuth.to_radians().sin_cos();
    let (up, level) = elevation.to_radians().sin_cos();
    DVec3::new(level * sin, level * cos, up)
}

#[test]
fn rows_with_times_say_when_pulses_leave() {
    let rows = "time_s,azimuth_deg,elevation_deg\n2,10,0\n2.25,20,-5\n3,30,80\n";
    let survey = fine(pattern("", rows));
    let device = &survey.scanner.devices[0];
    for (found, expected) in beams(device).iter().zip([(10.0, 0.0), (20.0, -5.0), (30.0, 80.0)]) {
        assert!((*found - towards(expected.0, expected.1)).length() < 1e-12);
    }
    let cycle = PulseTimes::Cycle { times: [0.0, 0.25, 1.0].into(), duration: 1.5 };
    assert_eq!(survey.legs[0].scanner.pulse_times, Some(cycle));
    assert_eq!((survey.legs[0].scanner.pulse_freq, survey.scanner.pulse_freqs.as_slice()), (2, &[2][..]));
    let once = fine(pattern("pattern_repeat = false", rows));
    assert_eq!(once.legs[0].scanner.pulse_times, Some(PulseTimes::Recorded([0.0, 0.25, 1.0].into())));
    assert!(!table(&once.scanner.devices[0]).repeats());
    // A rate takes the place of the times.
    let (survey, warnings) = pattern("pulse_freqs_hz = [500]", rows).unwrap();
    contains(&warnings.text(), &["have no effect beside `pulse_freqs_hz`"]);
    assert_eq!((survey.legs[0].scanner.pulse_times.clone(), survey.legs[0].scanner.pulse_freq), (None, 500));
    for rate in ["2", "500"] {
        let settings = format!("pulse_freq_hz = {rate}");
        let read = of_files(PATTERN, &settings, &[("rows.csv", rows.as_bytes())]);
        assert_eq!(fine(read).legs[0].scanner.pulse_times, None);
    }
}

#[test]
fn tables_of_livox_count_their_rows_and_turn_to_the_left() {
    let rows = "Time/s,Azimuth/deg,Zenith/deg\n1,90,90\n2,0,120\n3,270,30\n";
    let survey = fine(pattern("pulse_freqs_hz = [200000]", rows));
    for (found, expected) in
        beams(&survey.scanner.devices[0]).iter().zip([(-90.0, 0.0), (0.0, -30.0), (90.0, 60.0)])
    {
        assert!((*found - towards(expected.0, expected.1)).length() < 1e-12, "{found}");
    }
    contains(&refused(pattern("", rows)), &["`pulse_freqs_hz` is needed", "count its rows", "p.toml:4"]);
    let right = fine(pattern("pulse_freqs_hz = [200000]\npattern_azimuth = \"clockwise\"", rows));
    assert!((beams(&right.scanner.devices[0])[0] - DVec3::X).length() < 1e-12);
    // Beam, receiver and pulse rate of an entry of the catalogue.
    let survey = fine(pattern("catalogue = \"livox_mid-360\"", rows));
    let (entry, _) = find_scanner("livox_mid-360", &ReadOptions::default()).unwrap();
    assert_eq!(survey.scanner.pulse_freqs, entry.pulse_freqs);
    assert_eq!(survey.scanner.devices.len(), 1);
    assert_eq!(survey.scanner.devices[0].receiver, entry.devices[0].receiver);
    assert_eq!(survey.scanner.devices[0].beam_origin.rotation, Mount::IDENTITY.rotation);
}

#[test]
fn channels_have_tables_origins_and_divergences() {
    let rows = "index;channel;azimuth_rad;elevation_deg;origin_x_mm;divergence_mrad\n\
                0;5;0;1;0;1\n0;7;0;2;50;2\n1;5;0.5;3;0;1\n3;7;1;4;50;2\n";
    let survey = fine(pattern("pulse_freqs_hz = [1000]", rows));
    let [five, seven] = &survey.scanner.devices[..] else { panic!("two channels") };
    assert!(survey.scanner.multi_channel);
    assert_eq!((five.id.as_str(), seven.id.as_str()), ("5", "7"));
    assert!((five.beam.divergence - 0.001).abs() < 1e-15 && (seven.beam.divergence - 0.002).abs() < 1e-15);
    let fires = |device: &Device| (0..4).map(|step| table(device).row(step).is_some()).collect::<Vec<_>>();
    assert_eq!(fires(five), [true, true, false, false]);
    assert_eq!(fires(seven), [true, false, false, true]);
    assert!((beams(five)[1] - towards(0.5f64.to_degrees(), 3.0)).length() < 1e-12);
    assert!(!table(five).has_origins() && (table(seven).origin(1) - DVec3::X * 0.05).length() < 1e-15);
    assert_eq!(survey.scanner.rings(), [0, 1]);
}

#[test]
fn rows_in_brackets_and_arrays_of_numpy_are_those_of_text() {
    let text = fine(pattern("pulse_freqs_hz = [1000]", "10,1\n20,2\n30,-3.5\n"));
    let keys = "optics = \"pattern\"\npattern = [[10, 1], [20, 2], [30, -3.5]]\npulse_freqs_hz = [1000]";
    let listed = fine(of_files(keys, "", &[]));
    let header = "{'descr': '<f8', 'fortran_order': False, 'shape': (3, 2), }\n";
    let mut array = b"\x93NUMPY\x01\x00".to_vec();
    array.extend((header.len() as u16).to_le_bytes());
    array.extend(header.as_bytes());
    array.extend([10.0, 1.0, 20.0, 2.0, 30.0, -3.5f64].iter().flat_map(|x| x.to_le_bytes()));
    let keys = "optics = \"pattern\"\npattern = \"rows.npy\"\npulse_freqs_hz = [1000]";
    let numpy = fine(of_files(keys, "", &[("rows.npy", &array)]));
    for other in [listed, numpy] {
        assert_eq!(table(&other.scanner.devices[0]), table(&text.scanner.devices[0]));
    }
}

#[test]
fn columns_of_parquet_come_from_the_reader_of_the_program() {
    let text = "scene = \"a.obj\"\n[scanner]\noptics = \"pattern\"\npattern = \"rows.parquet\"\npulse_freqs_hz = [10]\n\
                [settings]\nmax_duration_s = 1\n[[leg]]\nposition_m = [0, 0, 0]\n";
    let folder = Folder::new(&[("p.toml", text), ("a.obj", ""), ("rows.parquet", "PAR1")]);
    contains(&refused(read_pipeline(&folder.path("p.toml"))), &["Parquet files are not read here"]);
    fn columns(_: &Path, is_read: &dyn Fn(&str) -> bool) -> vlscan_base::Result<NumberTable> {
        let mut table = NumberTable::default();
        for (name, values) in
            [("Azimuth/deg", [10.0, 20.0]), ("intensity", [0.0; 2]), ("elevation_deg", [1.0, 2.0])]
        {
            match is_read(name) {
                true => table.columns.push((name.to_owned(), values.to_vec())),
                false => table.unread.push(name.to_owned()),
            }
        }
        Ok(table)
    }
    let source = Source::read(&folder.path("p.toml")).unwrap();
    let reading = ReadOptions { number_columns: Some(columns), ..ReadOptions::default() };
    let (read, warnings) = read_pipeline_survey(source.tables().unwrap(), &reading).unwrap();
    assert!((beams(&read.survey.scanner.devices[0])[1] - towards(20.0, 2.0)).length() < 1e-12);
    contains(&warnings.text(), &["column `intensity` not read", "rows.parquet"]);
    // Columns of a pattern that have other values are not passed over.
    fn texts(_: &Path, _: &dyn Fn(&str) -> bool) -> vlscan_base::Result<NumberTable> {
        let columns = ["azimuth_deg", "elevation_deg"].map(|name| (name.to_owned(), vec![1.0])).to_vec();
        Ok(NumberTable { columns, unread: vec!["note".to_owned(), "time_s".to_owned()] })
    }
    let reading = ReadOptions { number_columns: Some(texts), ..ReadOptions::default() };
    let error = read_pipeline_survey(source.tables().unwrap(), &reading).map(|_| ()).unwrap_err();
    contains(&report(&error), &["the column `time_s` has no numbers", "rows.parquet"]);
}

#[test]
fn radians_in_columns_of_degrees_are_noticed() {
    let rows = |k: usize| format!("{},{}\n", 0.3 * k as f64 - 3.0, 0.05 * k as f64 - 0.5);
    let rows: String = (0..21).map(rows).collect();
    for table in [format!("azimuth_deg,elevation_deg\n{rows}"), rows.clone()] {
        let (_, warnings) = pattern("pulse_freqs_hz = [9]", &table).unwrap();
        contains(&warnings.text(), &["look like radians", "azimuths from -3 to 3", "azimuth_rad"]);
    }
    fine(pattern("pulse_freqs_hz = [9]", &format!("azimuth_rad,elevation_rad\n{rows}")));
    let angles: String = (1..=16).map(|i| format!("{i},{},0\n", 0.03 * f64::from(i) - 0.3)).collect();
    let keys = "optics = \"conic\"\npulse_freqs_hz = [1000]\nhead_rate_max_deg_per_s = 3600\n\
                corrections = \"angles.csv\"";
    let turn = "head_rate_deg_per_s = 3600\nhead_stop_deg = 360";
    let (_, warnings) = of_files(keys, turn, &[("angles.csv", angles.as_bytes())]).unwrap();
    contains(&warnings.text(), &["look like radians", "elevations from -0.27 to 0.18"]);
}

#[test]
fn tables_that_are_no_pattern_are_refused_with_line_and_column() {
    for (rows, words) in [
        ("", &["no row of numbers", "rows.csv"][..]),
        ("azimuth_deg,elevation_deg\n", &["no row of numbers"]),
        ("azimuth_deg,height\n1,2\n", &["no column `elevation`", "rows.csv:1"]),
        (
            "azimut_deg,elevation_deg\n1,2\n",
            &["no column `azimuth`", "did you mean `azimuth` by `azimut_deg`?"],
        ),
        ("azimuth,elevation,azimuth\n1,2,3\n", &["two columns `azimuth`"]),
        ("azimuth,elevation,zenith\n1,2,3\n", &["give either `elevation` or `zenith`"]),
        ("azimuth,elevation\n1,2\n3,nan\n", &["a finite number", "rows.csv:3:3"]),
        ("azimuth,elevation\n1,2\n3,1e300\n", &["an angle from -90 to 90 degrees", "rows.csv:3:3"]),
        ("azimuth,elevation\n1,2\n3,up\n", &["a finite number", "rows.csv:3:3"]),
        ("azimuth,elevation\n1,2\n3\n", &["1 field, expected 2", "rows.csv:3"]),
        (
            "time,azimuth,elevation\n1,0,0\n0.5,0,0\n",
            &["a time not below that of the row before", "rows.csv:3:1"],
        ),
        ("time,azimuth,elevation\n1,0,0\n1,0,0\n", &["a second beam of one time", "rows.csv:3:1"]),
        ("time,azimuth,elevation\n1,0,0\n", &["a single time"]),
        ("time,azimuth,elevation\n0,0,0\n1e-12,0,0\n", &["pulses per second on average"]),
        ("1,2,3,4,5,6\n", &["6 columns without headings"]),
        ("1\n", &["1 column without headings"]),
        ("azimuth;elevation\n1;2\n1,5;2\n", &["found 1,5, which has a decimal comma", "rows.csv:3:1"]),
    ] {
        contains(&refused(pattern("", rows)), words);
    }
    contains(&refused(pattern("", "azimuth,elevation\n1,2\n")), &["`pulse_freqs_hz` is needed"]);
    let (_, warnings) = pattern("pulse_freqs_hz = [9]", "azimuth,elevation,intensity\n1,2,3\n").unwrap();
    contains(&warnings.text(), &["column `intensity` not read", "rows.csv:1"]);
    // A single row is a beam that stands still.
    fine(pattern("pulse_freqs_hz = [9]", "azimuth,elevation\n1,2\n"));
}

#[test]
fn keys_beside_a_pattern_are_checked() {
    let rows: &[(&str, &[u8])] =
        &[("rows.csv", b"1,2\n"), ("two.csv", b"channel,azimuth,elevation\n0,1,2\n1,1,3\n")];
    let base = format!("{PATTERN}pulse_freqs_hz = [9]\n");
    for (keys, words) in [
        ("optics = \"pattern\"\npulse_freqs_hz = [9]".to_owned(), "the key `pattern` is missing"),
        (
            "optics = \"conic\"\npattern = \"rows.csv\"\npulse_freqs_hz = [9]".to_owned(),
            "needs optics = \"pattern\"",
        ),
        (format!("{base}scan_reverse = true"), "`scan_reverse` needs optics that move"),
        (format!("{base}scan_angle_max_deg = 30"), "`scan_angle_max_deg` needs optics that move"),
        (
            format!("{base}pattern_azimuth = \"left\""),
            "`pattern_azimuth` must be clockwise or counterclockwise",
        ),
        (
            format!("{base}[[scanner.channel]]\npattern = \"rows.csv\""),
            "a channel has no `pattern` of its own",
        ),
        (format!("{base}[[scanner.channel]]\noptics = \"pattern\""), "`optics` must be rotating"),
        (base.replace("rows.csv", "two.csv") + "[[scanner.channel]]\nid = \"a\"", "has channels of its own"),
        (base.replace("rows.csv", "two.csv") + "elevations_deg = [1, 2]", "has channels of its own"),
        (base.replace("rows.csv", "none.csv"), "cannot find the file `none.csv`"),
        (base.replace("\"rows.csv\"", "[[1, 2], [3]]"), "row 1 has 1 numbers, expected 2"),
        (base.replace("\"rows.csv\"", "[]"), "no row of numbers"),
        (base.replace("\"rows.csv\"", "[[1, 2], [3, 99]]"), "row 1, `elevation`: expected an angle"),
        (base.replace("\"rows.csv\"", "[1, 2]"), "`pattern` must be a file, or rows in brackets"),
    ] {
        contains(&refused(of_files(&keys, "", rows)), &[words]);
    }
    // Heads with the pattern of the scanner, turned.
    let keys = format!(
        "{base}[[scanner.channel]]\n[[scanner.channel]]\nbeam_origin = {{ rotate_deg = [{{ z = 30 }}] }}\n"
    );
    let survey = fine(of_files(&keys, "", rows));
    assert_eq!((survey.scanner.devices.len(), table(&survey.scanner.devices[1]).len()), (2, 1));
    let (_, warnings) = of_files(&base, "scan_angle_deg = 5\nscan_freq_hz = 3", rows).unwrap();
    contains(&warnings.text(), &["its pattern states all directions", "it has no mirror"]);
}

#[test]
fn correction_files_of_hesai_are_channels() {
    let angles = b"EEFF,1,1\nLaser id,Elevation,Azimuth\n2,-1.5,0.25\n1,3,-1\n\
                   ,,\n0123456789abcdef0123456789abcdef,,\n";
    let times = b"Channel,fire time(us)\n1,-2.5\n2,4\n";
    let files: &[(&str, &[u8])] = &[("angles.csv", angles), ("times.csv", times)];
    let keys = "optics = \"conic\"\npulse_freqs_hz = [1000]\nhead_rate_max_deg_per_s = 3600\n\
                corrections = \"angles.csv\"\nfiring_times = \"times.csv\"";
    for sense in [1.0, -1.0] {
        let turn = format!("head_rate_deg_per_s = {}\nhead_stop_deg = {}", 3600.0 * sense, 360.0 * sense);
        let survey = fine(of_files(keys, &turn, files));
        let [one, two] = &survey.scanner.devices[..] else { panic!("two channels") };
        assert!((one.beam_origin.rotation.forward() - towards(-1.0, 3.0)).length() < 1e-12);
        assert!((two.beam_origin.rotation.forward() - towards(0.25, -1.5)).length() < 1e-12);
        assert!(one.firing_offset == 0.0 && (two.firing_offset - 6.5e-6).abs() < 1e-18);
        let leg = &survey.legs[0].scanner;
        assert!((leg.head_rate - sense * 10.0 * TAU).abs() < 1e-9);
        assert!((leg.head_stop - sense * TAU).abs() < 1e-12);
    }
    // Listed channels have firing times, too.
    let listed = keys.replace("corrections = \"angles.csv\"", "elevations_deg = [3, -1.5]");
    let (survey, _) = of_files(&listed, "head_rate_deg_per_s = 3600\nhead_stop_deg = 360", files)
        .unwrap_or_else(|e| panic!("{}", report(&e)));
    let offsets: Vec<f64> = survey.scanner.devices.iter().map(|device| device.firing_offset).collect();
    assert!(offsets.len() == 2 && offsets[0] == 0.0 && (offsets[1] - 6.5e-6).abs() < 1e-18, "{offsets:?}");
    // The channels of an entry keep all but their angles.
    let rows: String = (1..=32).map(|i| format!("{i},{},0.5\n", 16 - i)).collect();
    let all = format!("Channel,Elevation,Azimuth\n{rows}");
    let keys = "catalogue = \"hesai_xt32\"\ncorrections = \"angles.csv\"";
    let turn = "head_rate_deg_per_s = -3600\nhead_stop_deg = -360";
    let survey = fine(of_files(keys, turn, &[("angles.csv", all.as_bytes())]));
    let (entry, _) = find_scanner("hesai_xt32", &ReadOptions::default()).unwrap();
    let devices = survey.scanner.devices.iter().zip(&entry.devices);
    for (i, (device, nominal)) in devices.enumerate() {
        assert_eq!(device.firing_offset, nominal.firing_offset);
        let expected = towards(0.5, 15.0 - i as f64);
        assert!((device.beam_origin.rotation.forward() - expected).length() < 1e-12);
    }
    let refused_by = |keys: &str, angles: &[u8]| refused(of_files(keys, turn, &[("angles.csv", angles)]));
    let gap = all.replace("\n32,", "\n40,");
    contains(&refused_by(keys, gap.as_bytes()), &["the 32 channels of the scanner", "found 1 to 40"]);
    contains(&refused_by(keys, b"1,2,3\n2,3,4\n"), &["has 2 channels, but the scanner has 32"]);
    contains(&refused_by(keys, b"1,2,3\n1,3,4\n"), &["each channel once", "angles.csv:2:1"]);
    contains(&refused_by(keys, b"1,200,3\n"), &["a number from -90 to 90", "angles.csv:1:3"]);
    contains(&refused_by(keys, b"Channel,Azimuth\n1,2\n"), &["no column `elevation`"]);
    let times: String = (1..=32).map(|i| format!("{i},{i}\n")).collect();
    let tables = "catalogue = \"hesai_xt32\"\nfiring_times = \"times.csv\"\n[[scanner.channel]]\nid = \"a\"";
    let beside = of_files(tables, turn, &[("times.csv", times.as_bytes())]);
    contains(&refused(beside), &["`firing_times` has channels of its own"]);
    contains(&refused_by(keys, b""), &["no row of numbers"]);
    let undecodable = [&b"1,2,3\n".repeat(2000)[..], b"\xe9\n"].concat();
    contains(&refused_by(keys, &undecodable), &["is not UTF-8", "angles.csv:2001"]);
}

#[test]
fn firing_times_are_those_of_the_corrected_channels() {
    let keys = "optics = \"conic\"\npulse_freqs_hz = [1000]\nhead_rate_max_deg_per_s = 3600\n\
                corrections = \"angles.csv\"\nfiring_times = \"times.csv\"";
    let turn = "head_rate_deg_per_s = 3600\nhead_stop_deg = 360";
    let read = |angles: &str, times: &str| {
        of_files(keys, turn, &[("angles.csv", angles.as_bytes()), ("times.csv", times.as_bytes())])
    };
    for (angles, times) in [
        ("1,3,0\n2,-3,0\n", "1,0\n2,5\n"),
        // One file counts from 1, the other from 0.
        ("1,3,0\n2,-3,0\n", "0,0\n1,5\n"),
        ("3,3,0\n7,-3,0\n", "3,0\n7,5\n"),
    ] {
        let survey = fine(read(angles, times));
        assert!((survey.scanner.devices[1].firing_offset - 5e-6).abs() < 1e-18, "{angles}");
    }
    for (angles, times, words) in [
        ("1,3,0\n2,-3,0\n", "1,0\n3,5\n", "`firing_times` must have the channels of `corrections`"),
        ("1,3,0\n2,-3,0\n", "1,0\n", "must have a row for each of the 2 channels, found 1"),
        (
            "channel,elevation,azimuth,firing_time_us\n1,3,0,0\n2,-3,0,1\n",
            "1,0\n2,5\n",
            "contradict each other",
        ),
    ] {
        contains(&refused(read(angles, times)), &[words]);
    }
    // A firing offset of all channels would be ignored beside firing times.
    let offset = |files: &str| {
        let keys = format!(
            "optics = \"conic\"\npulse_freqs_hz = [1000]\nhead_rate_max_deg_per_s = 3600\n\
             firing_offset_us = 1\n{files}"
        );
        let angles = b"channel,elevation,azimuth,firing_time_us\n1,3,0,0\n2,-3,0,1\n";
        refused(of_files(&keys, turn, &[("angles.csv", &angles[..]), ("times.csv", b"1,0\n2,5\n")]))
    };
    contains(&offset("corrections = \"angles.csv\""), &["`firing_offset_us` and a column of firing times"]);
    let both = offset("elevations_deg = [1, 2]\nfiring_times = \"times.csv\"");
    contains(&both, &["give either `firing_times` or `firing_offset_us`"]);
}

#[test]
fn beam_intrinsics_of_ouster_are_channels() {
    let json = br#"{"beam_altitude_angles": [10.5, 0, -10.5], "beam_azimuth_angles": [4.2, 0, -1.4], "lidar_origin_to_beam_origin_mm": 15.806}"#;
    let keys = "optics = \"conic\"\npulse_freqs_hz = [1000]\nhead_rate_max_deg_per_s = 3600\ncorrections = \"beams.json\"";
    let turn = "head_rate_deg_per_s = 3600\nhead_stop_deg = 360";
    let survey = fine(of_files(keys, turn, &[("beams.json", json)]));
    for (device, (altitude, azimuth)) in
        survey.scanner.devices.iter().zip([(10.5, 4.2), (0.0, 0.0), (-10.5, -1.4)])
    {
        assert!((device.beam_origin.rotation.forward() - towards(azimuth, altitude)).length() < 1e-12);
        assert!((device.beam_origin.offset - DVec3::new(0.0, 0.015806, 0.0)).length() < 1e-15);
    }
}
