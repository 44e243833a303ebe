//! Trajectories read in pieces: poses, warnings, errors.

use super::fix::Pose;
use super::{PollResult, PoseReader, binary};
use std::io::{Cursor, Read};
use std::time::Duration;
use vlscan_base::diag::Notice;
use vlscan_base::error::{Error, Result};
use vlscan_geom::{DVec3, Rotation};
use vlscan_survey::{AngleConvention, PoseStream};
use vlscan_tables::input::InputStream;

pub fn settings() -> PoseStream {
    PoseStream::at("-")
}

/// A reader that returns its text in pieces of `size` bytes.
struct Trickle {
    text: Vec<u8>,
    size: usize,
}

impl Read for Trickle {
    fn read(&mut self, to: &mut [u8]) -> std::io::Result<usize> {
        let count = self.size.min(self.text.len()).min(to.len());
        to[..count].copy_from_slice(&self.text[..count]);
        self.text.drain(..count);
        Ok(count)
    }
}

fn reader(text: &str, size: usize, settings: &PoseStream) -> PoseReader {
    let trickle = Trickle { text: text.as_bytes().to_vec(), size };
    PoseReader::new(InputStream::from_reader(trickle), settings)
}

/// The next poses; `None` at the end.
fn next_block(reader: &mut PoseReader) -> Result<Option<Vec<Pose>>, String> {
    loop {
        match reader.poll(Duration::from_secs(3600)) {
            Ok(PollResult::Poses(block)) => return Ok(Some(block)),
            Ok(PollResult::End) => return Ok(None),
            Ok(PollResult::TimedOut) => {}
            Err(Error::Input(d)) => return Err(d.text()),
            Err(e) => return Err(e.to_string()),
        }
    }
}

fn read_all(text: &str, size: usize, settings: &PoseStream) -> Result<Vec<Pose>, String> {
    let mut reader = reader(text, size, settings);
    std::iter::from_fn(|| next_block(&mut reader).transpose()).try_fold(Vec::new(), |mut poses, block| {
        poses.extend(block?);
        Ok(poses)
    })
}

#[test]
fn columns_are_named_or_in_the_default_order() {
    let default = read_all("# remark\n\n10 1 2 3 0 0 90\n11 1 2 3 0 0 90\n", 5, &settings()).unwrap();
    let named = read_all(
        "heading[rad];z;y;x;quality;roll_deg;pitch;gps_time\n1.5707963267948966;3;2;1;7;0;0;10\n\
         1.5707963267948966;3;2;1;7;0;0;11",
        64,
        &settings(),
    )
    .unwrap();
    assert_eq!(default.len(), 2);
    for (a, b) in default.iter().zip(&named) {
        assert_eq!((a.time, a.position), (b.time, b.position));
        assert!((a.attitude.forward() - DVec3::X).length() < 1e-12);
        assert!((b.attitude.forward() - DVec3::X).length() < 1e-12);
    }
    let user = PoseStream {
        columns: Some(["x", "y", "z", "t", "yaw", "roll", "pitch"].map(str::to_owned).to_vec()),
        ..settings()
    };
    assert_eq!(read_all("1,2,3,10,90,0,0", 9, &user).unwrap()[0].time, 10.0);
}

#[test]
fn trajectory_files_of_surveys_are_understood() {
    let text = "#TIME_COLUMN: 0\n#HEADER: \"t\", \"roll\", \"pitch\", \"yaw\", \"x\", \"y\", \"z\"\n10,0,0,90,1,2,3\n";
    assert_eq!(read_all(text, 100, &settings()).unwrap()[0].position, DVec3::new(1.0, 2.0, 3.0));
    assert_eq!(
        read_all("#TIME_COLUMN: 0\n10,0,0,90,1,2,3\n", 100, &settings()).unwrap()[0].position,
        DVec3::new(1.0, 2.0, 3.0)
    );
}

#[test]
fn a_block_is_what_has_arrived() {
    let mut r = reader("1 0 0 0 0 0 0\n2 0 0 0 0 0 0\n3 0 0 0 0 0 0\n", 20, &settings());
    let counts: Vec<usize> = std::iter::from_fn(|| next_block(&mut r).unwrap()).map(|b| b.len()).collect();
    assert_eq!(counts, [1, 1, 1]);
    let many: String = (0..3000).map(|i| format!("{i},0,0,0,0,0,0\n")).collect();
    let mut r = PoseReader::new(InputStream::from_reader(Cursor::new(many)), &settings());
    let counts: Vec<usize> = std::iter::from_fn(|| next_block(&mut r).unwrap()).map(|b| b.len()).collect();
    assert_eq!(counts, [1024, 1024, 952]);
}

#[test]
fn invalid_lines_are_located_and_reported_after_the_poses_before_them() {
    let mut r = reader("1,0,0,0,0,0,0\n2,0,0,0,0,0,0\n1.5,0,0,0,0,0,0\n", 1000, &settings());
    assert_eq!(next_block(&mut r).unwrap().unwrap().len(), 2);
    let report = next_block(&mut r).unwrap_err();
    assert!(report.contains("<stdin>:3:1") && report.contains("goes back"), "{report}");
    for (text, part) in [
        ("1,0,0,0,0,0,0\n1,9,0,0,0,0,0\n", "occurs again"),
        ("1,0,0,0,0,0,zero\n", "<stdin>:1:13"),
        ("1,0,0,0\n", "column 5 for roll is missing"),
        ("time,x,y,z\n", "no column for roll, pitch, yaw"),
        ("time,x,y,z,roll[gon],pitch,yaw\n", "gon"),
    ] {
        let report = read_all(text, 7, &settings()).unwrap_err();
        assert!(report.contains(part), "{part:?} is missing from\n{report}");
    }
    assert!(read_all(&"7".repeat(70_000), 5000, &settings()).unwrap_err().contains("a line of more than"));
}

/// The notices while `bytes` are read, and the number of poses or the error.
fn notices_of(bytes: &[u8], strict: bool) -> (Vec<Notice>, Result<usize, String>) {
    let all = std::sync::Arc::new(std::sync::Mutex::new(Vec::new()));
    let heard = all.clone();
    let mut reader = PoseReader::new(InputStream::from_reader(Cursor::new(bytes.to_vec())), &settings())
        .on_notice(strict, move |notice| heard.lock().unwrap().push(notice));
    let blocks = std::iter::from_fn(|| next_block(&mut reader).transpose());
    let end = blocks.map(|block| block.map(|b| b.len())).sum();
    let notices = all.lock().unwrap().clone();
    (notices, end)
}

fn warnings(notices: &[Notice]) -> String {
    let of = |t: &Notice| match t {
        Notice::Warnings(found) => Some(found.text()),
        _ => None,
    };
    notices.iter().filter_map(of).collect()
}

#[test]
fn an_identical_row_is_skipped_with_a_warning() {
    let text = b"1,0,0,0,0,0,0\n1,0,0,0,0,0,0\n2,0,0,0,0,0,0\n";
    let (said, end) = notices_of(text, false);
    assert_eq!(end, Ok(2));
    assert!(warnings(&said).contains("<stdin>:2:1"), "{said:?}");
    assert!(notices_of(text, true).1.unwrap_err().contains("<stdin>:2:1"));
}

#[test]
fn gaps_are_reported_with_their_lines() {
    let (said, end) = notices_of(b"1,0,0,0,0,0,0\n1.1,0,0,0,0,0,0\n9.1,0,0,0,0,0,0\n", false);
    assert_eq!(end, Ok(3));
    assert!(
        warnings(&said).contains("<stdin>:3:1") && warnings(&said).contains("no pose for 8 s"),
        "{said:?}"
    );
    let slow: String = (0..9).map(|i| format!("{i},0,0,0,0,0,0\n")).collect();
    assert_eq!(warnings(&notices_of(slow.as_bytes(), false).0), "", "one pose a second is no gap");
}

#[test]
fn empty_trajectories_are_reported() {
    let (said, end) = notices_of(b"time,x,y,z,roll,pitch,yaw\n", false);
    assert_eq!(end, Ok(0));
    assert!(warnings(&said).contains("0 poses"), "{said:?}");
    assert!(notices_of(b"", false).1.unwrap_err().contains("empty"));
}

#[test]
fn headings_across_the_course_are_noted_once() {
    let east: String = (0..30).map(|i| format!("{i},{},0,0,0,0,270\n", i * 10)).collect();
    let notes: Vec<String> = notices_of(east.as_bytes(), false)
        .0
        .into_iter()
        .filter_map(|t| if let Notice::Note(note) = t { Some(note) } else { None })
        .collect();
    assert!(notes.len() == 1 && notes[0].contains("--trajectory-rotation"), "{notes:?}");
}

/// Attitudes that turn about all axes: time, x, y, z, and roll, pitch, yaw of ROS in degrees.
fn turning() -> Vec<[f64; 7]> {
    (0..40)
        .map(|i| {
            let i = f64::from(i);
            [i / 10.0, 30.0 * i, i, 300.0, 40.0 - 3.0 * i, 2.5 * i - 60.0, 17.0 * i - 200.0]
        })
        .collect()
}

/// Lines of `rows` as time, x, y, z and a quaternion with w last, between `separator`.
fn quaternions(rows: &[[f64; 7]], separator: &str) -> String {
    let line = |[t, x, y, z, angles @ ..]: &[f64; 7]| {
        let [roll, pitch, yaw] = angles.map(vlscan_geom::radians);
        let q = Rotation::about_z(yaw).after(Rotation::about_y(pitch)).after(Rotation::about_x(roll));
        let numbers = [*t, *x, *y, *z, q.u.x, q.u.y, q.u.z, q.w];
        numbers.map(|number| number.to_string()).join(separator) + "\n"
    };
    rows.iter().map(line).collect()
}

fn assert_same(found: &[Pose], expected: &[Pose], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    for (a, b) in found.iter().zip(expected) {
        assert!((a.time - b.time).abs() < tolerance && (a.position - b.position).length() < tolerance);
        for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
            assert!((a.attitude.apply(axis) - b.attitude.apply(axis)).length() < tolerance, "{a:?} {b:?}");
        }
    }
}

#[test]
fn quaternions_are_the_attitudes_of_their_angles() {
    let ros = PoseStream { rotation: Some(AngleConvention::Ros), ..settings() };
    let rows = turning();
    let angles: String = rows.iter().map(|row| row.map(|v| v.to_string()).join(",") + "\n").collect();
    let expected = read_all(&angles, 1000, &ros).unwrap();
    let lines = quaternions(&rows, " ");
    for text in [
        lines.clone(),
        format!("# ground truth\n# timestamp tx ty tz qx qy qz qw\n{lines}"),
        format!("time x y z qx qy qz qw\n{lines}"),
        format!(
            "#timestamp [s],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_x [],q_RS_y [],q_RS_z [],q_RS_w []\n{}",
            quaternions(&rows, ",")
        ),
    ] {
        assert_same(&read_all(&text, 1000, &settings()).unwrap(), &expected, 1e-12);
        assert_same(&read_all(&text, 1000, &ros).unwrap(), &expected, 1e-12);
    }
    let columns = "time,x,y,z,qx,qy,qz,qw".split(',').map(str::to_owned).collect();
    let chosen = PoseStream { columns: Some(columns), ..settings() };
    assert_same(&read_all(&lines, 1000, &chosen).unwrap(), &expected, 1e-12);
    let yaw = PoseStream { rotation: Some(AngleConvention::Yaw), ..settings() };
    assert!(read_all(&lines, 1000, &yaw).unwrap_err().contains("convention of angles"));
    let camera = PoseStream { rotation: Some(AngleConvention::Camera), ..settings() };
    assert!(read_all(&angles, 1000, &camera).unwrap_err().contains("not of angles"));
}

#[test]
fn times_may_be_nanoseconds() {
    let text = "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], \
                v_RS_R_x [m s^-1], b_w_RS_S_x [rad s^-1]\n\
                1403636580838555648,4.6,-1.7,0.7,1,0,0,0,0.1,0.2\n1403636580938555648,4.7,-1.7,0.7,1,0,0,0,0.1,0.2\n";
    let poses = read_all(text, 1000, &settings()).unwrap();
    assert!((poses[0].time - 1_403_636_580.838_555_6).abs() < 1e-6 && poses.len() == 2);
    assert!((poses[0].attitude.forward() - DVec3::X).length() < 1e-12);
    let (said, _) = notices_of(text.as_bytes(), true);
    let said = warnings(&said);
    assert!(said.contains("nanoseconds") && said.contains("`v_RS_R_x [m s^-1]`"), "{said}");
}

#[test]
fn matrices_need_times() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("poses.txt");
    // A camera that moves to its front.
    std::fs::write(&path, "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 0 0 0 1 2\n").unwrap();
    let read = |rotation| {
        let settings = PoseStream { rotation, ..PoseStream::at(&path) };
        let mut reader = PoseReader::open(&settings).unwrap();
        let poses = std::iter::from_fn(|| next_block(&mut reader).transpose());
        poses.collect::<Result<Vec<_>, _>>().map(|blocks| blocks.concat())
    };
    let said = read(None).unwrap_err();
    assert!(said.contains("have no times") && said.contains("paste -d ' ' times.txt"), "{said}");
    std::fs::write(dir.path().join("times.txt"), "0.0\n1e-1\n").unwrap();
    let poses = read(Some(AngleConvention::Camera)).unwrap();
    assert_eq!(poses.iter().map(|pose| pose.time).collect::<Vec<_>>(), [0.0, 0.1]);
    assert!((poses[1].position - DVec3::new(0.0, 2.0, 0.0)).length() < 1e-12);
    assert!((poses[1].attitude.forward() - DVec3::Y).length() < 1e-12);
    assert!((read(None).unwrap()[1].position - DVec3::new(0.0, 0.0, 2.0)).length() < 1e-12);
    std::fs::write(&path, "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 0 0 0 1 25\n").unwrap();
    assert!(read(None).is_ok(), "a drone that climbs");
    std::fs::write(&path, "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 0 0 0 1 160\n").unwrap();
    assert!(read(None).unwrap_err().contains("--trajectory-rotation camera"));
    assert!(read(Some(AngleConvention::Ros)).is_ok() && read(Some(AngleConvention::Camera)).is_ok());
    let timed = read_all("0 1 0 0 5 0 1 0 6 0 0 1 7\n", 100, &settings()).unwrap();
    assert_eq!(timed[0].position, DVec3::new(5.0, 6.0, 7.0));
    std::fs::write(dir.path().join("times.txt"), "0.0\n").unwrap();
    assert!(read(None).unwrap_err().contains("poses.txt:2"));
}

#[test]
fn columns_are_used_refused_or_reported() {
    for (text, part) in [
        ("time,x,y,z,roll,pitch,yaw\n0.3,3,00,0.9,40.3,0,0,80\n", "8 fields, expected 7 as in the heading"),
        ("0.3,3,00,0.9,40.3,0,0,80\n", "8 columns without names"),
        ("0,00,-15,00,0,00,40,00,0,00,0,00,80,00\n", "14 columns without names"),
        ("1,2,3,4,0,0,0\n2,2,3,4,0,0,0,5\n", "8 fields, expected 7 as in the first line"),
        ("1,2,3,4,0,0,0\n2,2,3,4,0,0\n", "6 fields, expected 7 as in the first line"),
        ("0 0 0 0.3826834 0 0 0.9238795\n", "there is no time"),
        ("1 2 3 4 5 6 7 8 9 10 11 12\n", "12 columns without names"),
        ("t,a,b,c,roll,pitch,yaw\n1,2,3,4,5,6,7\n", "no column for x, y, z"),
        ("a b c d p f g\n1 2 3 4 5 6 7\n", "none of these names"),
        ("1,2,3,4,0,0,1e30\n", "yaw is 1e30"),
        ("time,x,y,z,qx,qy,qz,qw\n1,2,3,4,0,0,0,0\n", "the quaternion's length is 0"),
        ("time,x,x,y,z,roll,pitch,yaw\n1,2,3,4,5,6,7,8\n", "`x` and `x` have the same meaning"),
    ] {
        let said = read_all(text, 1000, &settings()).unwrap_err();
        assert!(said.contains(part), "{text}: {said}");
    }
    let said = warnings(&notices_of(b"time,x,y,z,roll,pitch,yaw,yaww\n1,2,3,4,0,0,0,0\n", false).0);
    assert!(said.contains("columns that are not read: `yaww`") && said.contains("<stdin>:1"), "{said}");
    let strict = notices_of(b"time,x,y,z,roll,pitch,yaw,yaww\n1,2,3,4,0,0,0,0\n", true).1;
    assert!(strict.unwrap_err().contains("`yaww`"));
}

#[test]
fn records_are_read_in_any_pieces() {
    let rows: Vec<[f64; 7]> =
        (0..300).map(|i| [1000.0 + f64::from(i) * 0.005, 0.8, 0.15, 300.0, 0., 0., 1.]).collect();
    let (sbet, trj) = (binary::testing::sbet(&rows), binary::testing::terrascan(&rows));
    for bytes in [&sbet, &trj] {
        let whole = notices_of(bytes, false).1;
        assert_eq!(whole, Ok(300));
        for size in [1, 7, 137, 4096] {
            let trickle = Trickle { text: bytes.clone(), size };
            let mut reader = PoseReader::new(InputStream::from_reader(trickle), &settings());
            let mut count = 0;
            while let Some(block) = next_block(&mut reader).unwrap() {
                count += block.len();
            }
            assert_eq!(count, 300, "in pieces of {size}");
        }
    }
    let zone = |t: &Notice| matches!(t, Notice::Note(note) if note.contains("UTM zone 32N"));
    assert!(notices_of(&sbet, false).0.iter().any(zone));
}

proptest::proptest! {
    #[test]
    fn any_bytes_are_read_or_refused(text in "[#HEADRTIM_:0-9txyz,; \t\n.-]{0,200}", size in 1usize..40) {
        let once = read_all(&text, 10_000, &settings());
        proptest::prop_assert_eq!(once, read_all(&text, size, &settings()));
    }

    #[test]
    fn any_records_are_read_or_refused(bytes in proptest::collection::vec(0u8.., 0..500)) {
        let _ = notices_of(&bytes, false);
    }
}
