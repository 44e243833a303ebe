//! How a run ends: complete files under their names or none, clear reports, exit statuses.

mod common;

use common::{feed, files, fixture, folder, run, succeed, text, vlscan};
use std::fs;
use std::io::Read;
use std::process::Stdio;

fn room() -> String {
    fixture("room/survey.xml").to_str().unwrap().to_owned()
}

#[test]
fn wrong_input_is_reported_with_its_place_and_status_2() {
    let dir = folder();
    let survey = fs::read_to_string(fixture("room/survey.xml")).unwrap();
    let broken = survey.replace("<leg", "<leg>\n<oops").replacen("</survey>", "", 1);
    fs::write(dir.path().join("broken.xml"), broken).unwrap();
    let out = run(dir.path(), &["run", "broken.xml"]);
    assert_eq!(out.status.code(), Some(2));
    assert!(text(&out.stderr).contains("broken.xml:"), "{}", text(&out.stderr));
    assert!(files(dir.path()).len() == 1, "nothing is written: {:?}", files(dir.path()));

    let out = run(dir.path(), &["run", "missing.xml"]);
    assert_eq!(out.status.code(), Some(2), "{}", text(&out.stderr));
    assert!(text(&out.stderr).contains("missing.xml"));
}

#[test]
fn a_misspelt_attribute_warns_and_is_an_error_with_strict() {
    let dir = folder();
    for name in ["scene.xml", "scanners.xml", "platforms.xml"] {
        fs::copy(fixture("room").join(name), dir.path().join(name)).unwrap();
    }
    for entry in fs::read_dir(fixture("room")).unwrap() {
        let path = entry.unwrap().path();
        if path.is_file() {
            fs::copy(&path, dir.path().join(path.file_name().unwrap())).unwrap();
        }
    }
    let survey = fs::read_to_string(fixture("room/survey.xml")).unwrap();
    assert!(survey.contains("pulseFreq_hz"));
    fs::write(dir.path().join("survey.xml"), survey.replacen("pulseFreq_hz", "pulseFreq_Hz", 1)).unwrap();
    let out = run(dir.path(), &["run", "survey.xml", "-o", "a.xyz"]);
    assert_eq!(out.status.code(), Some(0), "{}", text(&out.stderr));
    assert!(text(&out.stderr).contains("pulseFreq_Hz"), "{}", text(&out.stderr));
    let out = run(dir.path(), &["run", "survey.xml", "-o", "b.xyz", "--strict"]);
    assert_eq!(out.status.code(), Some(2));
    assert!(!dir.path().join("b.xyz").exists());
}

#[test]
fn nothing_is_overwritten_without_force() {
    let dir = folder();
    fs::write(dir.path().join("a.laz"), "mine").unwrap();
    let out = run(dir.path(), &["run", &room(), "-o", "a.laz"]);
    assert_eq!(out.status.code(), Some(2));
    assert!(text(&out.stderr).contains("--force"), "{}", text(&out.stderr));
    assert_eq!(fs::read(dir.path().join("a.laz")).unwrap(), b"mine");
    succeed(dir.path(), &["run", &room(), "-o", "a.laz", "--force", "-q"]);
    assert_eq!(&fs::read(dir.path().join("a.laz")).unwrap()[..4], b"LASF");
    assert_eq!(files(dir.path()).len(), 1, "a .part was left: {:?}", files(dir.path()));
}

#[test]
fn a_reader_that_leaves_ends_the_run_quietly() {
    let dir = folder();
    let mut child = vlscan(dir.path())
        .args(["run", &room(), "-o", "-", "--format", "xyz"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut some = [0u8; 100];
    child.stdout.take().unwrap().read_exact(&mut some).unwrap();
    let out = child.wait_with_output().unwrap();
    assert_eq!(out.status.code(), Some(0), "{}", text(&out.stderr));
    assert!(!text(&out.stderr).contains("error"), "{}", text(&out.stderr));
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_a_clear_error_and_status_1() {
    let dir = folder();
    let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    for format in ["xyz", "las", "laz", "ply"] {
        let out = vlscan(dir.path())
            .args(["run", &room(), "-o", "-", "--format", format])
            .stdout(full.try_clone().unwrap())
            .output()
            .unwrap();
        assert_eq!(out.status.code(), Some(1), "{format}: {}", text(&out.stderr));
        assert!(text(&out.stderr).contains("No space left"), "{format}: {}", text(&out.stderr));
    }
}

#[cfg(unix)]
#[test]
fn an_interrupt_leaves_nothing_half_under_a_final_name() {
    let dir = folder();
    // Poses that never end keep the run going until the signal.
    let mut child = vlscan(dir.path())
        .args(["run", &fixture("forest/survey.xml").to_string_lossy(), "--trajectory", "-", "-o", "a.laz"])
        .stdin(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let stdin = child.stdin.take().unwrap();
    let feeder = std::thread::spawn(move || {
        use std::io::Write;
        let mut stdin = stdin;
        for i in 0..u64::MAX {
            let line = format!("{},{},0,400,0,0,90\n", 100.0 + i as f64 * 0.005, i as f64 * 0.001);
            if stdin.write_all(line.as_bytes()).is_err() {
                break;
            }
        }
    });
    let started = std::time::Instant::now();
    while !dir.path().join("a.laz.part").exists() {
        assert!(started.elapsed().as_secs() < 60, "the run does not start writing");
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    let out = child.wait_with_output().unwrap();
    feeder.join().unwrap();
    assert_eq!(out.status.code(), Some(130), "{}", text(&out.stderr));
    assert!(files(dir.path()).is_empty(), "left behind: {:?}", files(dir.path()));
}

#[test]
fn a_bad_pose_is_reported_with_its_line() {
    let dir = folder();
    let poses = "time,x,y,z,roll,pitch,yaw\n1.0,0,0,400,0,0,0\n1.1,zero,0,400,0,0,0\n";
    let survey = fixture("forest/survey.xml");
    let args = ["run", survey.to_str().unwrap(), "--trajectory", "-", "-o", "a.xyz"];
    let out = feed(dir.path(), &args, poses.as_bytes());
    assert_eq!(out.status.code(), Some(2), "{}", text(&out.stderr));
    assert!(text(&out.stderr).contains(":3:"), "{}", text(&out.stderr));
    assert!(files(dir.path()).is_empty());
}
