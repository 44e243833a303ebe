//! Surveys that HELIOS++ runs although they are not as its documents say: slips of programs that write scenes
//! are warnings, and errors with `--strict`.

use crate::common::{folder, run, succeed, text};
use std::fs;
use std::path::Path;

const HEAD: &str = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n";

/// Writes a box, a tripod with a rotating mirror, and a survey of the scene whose part has these further
/// elements.
fn write_survey(folder: &Path, before: &str, scene: &str, part: &str) {
    let write = |name: &str, content: &str| fs::write(folder.join(name), content).unwrap();
    write(
        "box.obj",
        "mtllib box.mtl\nusemtl board\nv -2 4 -2\nv 2 4 -2\nv 2 6 -2\nv -2 6 -2\nv -2 4 2\nv 2 4 2.1\nv 2 6 2.2\nv -2 6 2\n\
         f 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\nf 5 6 7 8\n",
    );
    write("box.mtl", "newmtl board\nKd 0.5 0.5 0.5\nhelios_spectra pine\n");
    fs::create_dir_all(folder.join("spectra")).unwrap();
    let header = (1..=26).map(|n| format!("header {n}\n")).collect::<String>();
    write("spectra/pine.txt", &format!("{header}0.5 20\n1.0 30\n2.0 40\n"));
    write(
        "survey.xml",
        &format!(
            "{before}{HEAD}<document>
  <scanner id='mirror' optics='rotating' pulseFreqs_Hz='2000' accuracy_m='0' rangeMin_m='0.5' scanAngleMax_deg='50'
    scanAngleEffectiveMax_deg='45' scanFreqMin_Hz='1' scanFreqMax_Hz='100' headRotatePerSecMax_deg='60'>
    <FWFSettings beamSampleQuality='1'/></scanner>
  <platform id='tripod' type='static'/>
  <scene id='s' {scene}><part id='1'><filter type='objloader'>
    <param type='string' key='filepath' value='box.obj'/></filter>{part}</part></scene>
  <survey name='case' scene='#s' platform='#tripod' scanner='#mirror'>
    <leg><platformSettings x='0' y='0' z='0'/><scannerSettings active='true' pulseFreq_hz='2000' scanAngle_deg='40'
      scanFreq_hz='20' headRotatePerSec_deg='40' headRotateStart_deg='-20' headRotateStop_deg='20'/></leg>
  </survey>
</document>"
        ),
    );
}

/// The points of a survey that must warn of `warning`, and must be refused with `--strict`.
fn points_with_warning(folder: &Path, warning: &str) -> String {
    let output = succeed(folder, &["run", "survey.xml", "-o", "points.xyz", "--force"]);
    let messages = text(&output.stderr);
    assert!(messages.contains(warning), "{warning:?} is missing from\n{messages}");
    let strict = run(folder, &["run", "survey.xml", "-o", "strict.xyz", "--strict"]);
    assert_eq!(strict.status.code(), Some(2), "{}", text(&strict.stderr));
    fs::read_to_string(folder.join("points.xyz")).unwrap()
}

fn points(folder: &Path) -> String {
    succeed(folder, &["run", "survey.xml", "-o", "points.xyz", "--force", "-q"]);
    fs::read_to_string(folder.join("points.xyz")).unwrap()
}

#[test]
fn slips_are_read_as_the_reference_reads_them() {
    let dir = folder();
    let dir = dir.path();
    write_survey(dir, "", "", "");
    let plain = points(dir);
    assert!(plain.lines().count() > 500, "{plain}");
    write_survey(dir, "\n", "", "");
    assert_eq!(points_with_warning(dir, "the XML declaration is not at the beginning"), plain);

    let rotate = |rots: &str| {
        format!("<filter type='rotate'><param type='rotation' key='rotation'>{rots}</param></filter>")
    };
    write_survey(dir, "", "", &rotate("<rot axis='pitch' angle_deg='12'/><rot axis='yaw' angle_deg='33'/>"));
    assert_eq!(points_with_warning(dir, "pitch is the rotation about x"), plain);
    write_survey(dir, "", "", &rotate("<rot axis='z' angle_deg='6'/>"));
    let rotated = points(dir);
    write_survey(dir, "", "", &rotate("<rot axis='z' angle_deg='3'/><rot axis='roll' angle_deg='9'/>"));
    let repeated = points_with_warning(dir, "it repeats the rotation before it");
    assert_eq!(repeated.lines().count(), rotated.lines().count());
    assert!(rotated != plain && (repeated == rotated || nearly_equal(&repeated, &rotated)));
}

/// True if coordinates differ by no more than the last digit that is written.
fn nearly_equal(a: &str, b: &str) -> bool {
    let numbers = |line: &str| -> Vec<f64> { line.split(' ').take(3).map(|f| f.parse().unwrap()).collect() };
    a.lines()
        .zip(b.lines())
        .all(|(a, b)| numbers(a).iter().zip(numbers(b)).all(|(a, b)| (a - b).abs() < 2e-4))
}

#[test]
fn parts_that_stand_still_and_motions_that_end() {
    let dir = folder();
    let dir = dir.path();
    write_survey(dir, "", "dynTimeStep='0.1'", "");
    let plain = points(dir);
    let still = "<dmotion id='a' loop='1' next='a'><motion type='rotation' axis='0;0;-0' angle='0.0' center='0;0;0'/></dmotion>";
    write_survey(dir, "", "dynTimeStep='0.1'", still);
    assert_eq!(points_with_warning(dir, "nothing moves"), plain);
    let drive = |next: &str| {
        format!("<dmotion id='a' loop='3' {next}><motion type='translation' vec='0;0.05;0'/></dmotion>")
    };
    write_survey(dir, "", "dynTimeStep='0.1'", &drive(""));
    let driven = points(dir);
    write_survey(dir, "", "dynTimeStep='0.1'", &drive("next='b'"));
    assert_eq!(points_with_warning(dir, "which stops after `a`"), driven);
    assert!(driven != plain);
}

#[test]
fn swapped_parts_keep_their_spectra() {
    let dir = folder();
    let dir = dir.path();
    let again = "<swap swapStep='1'><filter type='objloader'><param type='string' key='filepath' value='box.obj'/></filter></swap>";
    write_survey(dir, "", "", again);
    succeed(dir, &["run", "survey.xml", "--output", "out", "-q"]);
    let epochs = crate::common::files(&dir.join("out"));
    let points: Vec<String> = epochs
        .iter()
        .filter(|f| f.ends_with("leg000_points.xyz"))
        .map(|f| fs::read_to_string(dir.join("out").join(f)).unwrap())
        .collect();
    let intensities = |points: &String| -> Vec<String> {
        points.lines().map(|l| l.split(' ').nth(3).unwrap().to_owned()).collect()
    };
    assert_eq!(points.len(), 2);
    assert_eq!(intensities(&points[0]), intensities(&points[1]));
}

/// Checks the starts of the first pulses of the legs of an interpolated platform (spec kinematics §2.6): the
/// first leg at its start, a later one three pulses later, four with `teleportToStart`; a head that rotates
/// changes nothing.
#[test]
fn legs_of_interpolated_platforms_with_rotating_heads() {
    let dir = folder();
    let dir = dir.path();
    write_survey(dir, "", "", "");
    fs::write(dir.join("t.txt"), "0,0,0,0,-5,0,0\n1,0,0,0,-4,0,0\n2,0,0,0,-3,1,0\n4,0,0,0,1,2,0\n").unwrap();
    let legs = |first: &str, second: &str, head: &str| {
        let scanner = format!(
            "<scannerSettings active='true' pulseFreq_hz='2000' scanAngle_deg='40' scanFreq_hz='20' {head}/>"
        );
        format!(
            "<survey name='case' scene='#s' platform='interpolated' scanner='#mirror'>
               <leg><platformSettings trajectory='t.txt' tIndex='0' rollIndex='1' pitchIndex='2' yawIndex='3' xIndex='4'
                 yIndex='5' zIndex='6' tStart='0.5' tEnd='1' {first}/>{scanner}</leg>
               <leg><platformSettings trajectory='t.txt' tStart='2' tEnd='2.5' {second}/>{scanner}</leg></survey></document>"
        )
    };
    let head = "headRotatePerSec_deg='60' headRotateStart_deg='0' headRotateStop_deg='60'";
    let teleport = "teleportToStart='true'";
    // x of the two first pulses: 1 m/s from -4.5 in the first leg, 2 m/s from -3 in the second one.
    for (first, second, head, expected) in [
        ("", "", "", [-4.5, -3.0 + 3.0 * 0.001]),
        ("", "", head, [-4.5, -3.0 + 3.0 * 0.001]),
        ("", teleport, head, [-4.5, -3.0 + 4.0 * 0.001]),
        (teleport, teleport, head, [-4.4995, -3.0 + 4.0 * 0.001]),
    ] {
        let survey = fs::read_to_string(dir.join("survey.xml")).unwrap();
        let (assets, _) = survey.split_once("<survey").unwrap();
        fs::write(dir.join("flight.xml"), format!("{assets}{}", legs(first, second, head))).unwrap();
        let out = tempfile::tempdir_in(dir).unwrap();
        let out_name = out.path().to_string_lossy().into_owned();
        succeed(dir, &["run", "flight.xml", "--output", &out_name, "--pulses", "-q"]);
        let files = crate::common::files(out.path());
        let pulses: Vec<_> = files.iter().filter(|f| f.to_string_lossy().contains("pulse")).collect();
        let starts: Vec<f64> = pulses
            .iter()
            .map(|f| {
                fs::read_to_string(out.path().join(f)).unwrap().split(' ').next().unwrap().parse().unwrap()
            })
            .collect();
        assert_eq!(starts.len(), 2, "{files:?}");
        let near = starts.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-4);
        assert!(near, "{first} {second} {head}: {starts:?} is not {expected:?}");
    }
}
