//! The command line of HELIOS++: every option under its own name, with its effect.

use crate::common::{files, folder, run, succeed, text};
use std::fs;
use std::path::{Path, PathBuf};

const SCENE: &str = r#"<?xml version="1.0"?><document><scene id="s" name="s">
<part id="7"><filter type="objloader"><param type="string" key="filepath" value="ground.obj"/></filter></part>
</scene></document>"#;

const GROUND: &str = "mtllib ground.mtl\nv -40 -40 0\nv 40 -40 1.7\nv 40 40 0.9\nv -40 40 2.3\nv -20 0 9\nv 20 3 8\nv 0 20 11\n\
                      usemtl soil\nf 1 2 3\nf 1 3 4\nf 5 6 7\n";

const MATERIAL: &str =
    "newmtl soil\nKd 0.4 0.4 0.4\nKs 0.2 0.2 0.2\nNs 20\nhelios_reflectance 40\nhelios_classification 2\n";

const SCANNERS: &str = r#"<?xml version="1.0"?><document>
<scanner id="two" name="two" optics="oscillating" accuracy_m="0.05" beamDivergence_rad="0.002" pulseLength_ns="4"
  pulseFreqs_Hz="2000" rangeMin_m="1" scanAngleMax_deg="30" scanFreqMin_Hz="0" scanFreqMax_Hz="200" wavelength_nm="1064" maxNOR="5">
  <FWFSettings beamSampleQuality="2" binSize_ns="0.25"/>
  <beamOrigin x="0" y="0" z="0"/>
  <channels>
    <channel id="front"><beamOrigin x="0" y="0" z="0.1"/></channel>
    <channel id="rear"><beamOrigin x="0" y="0" z="-0.1"><rot axis="z" angle_deg="10"/></beamOrigin></channel>
  </channels>
</scanner></document>"#;

const PLATFORMS: &str = r#"<?xml version="1.0"?><document>
<platform id="plane" name="plane" type="linearpath">
  <positionZNoise mean="0" stdev="0.2"/>
  <scannerMount x="0" y="0" z="0"><rot axis="x" angle_deg="-90"/><rot axis="z" angle_deg="90"/></scannerMount>
</platform></document>"#;

const SURVEY: &str = r#"<?xml version="1.0"?><document>
<scannerSettings id="on" active="true" pulseFreq_hz="2000" scanAngle_deg="20" scanFreq_hz="5" trajectoryTimeInterval_s="0.05"/>
<survey name="tiny" seed="5" legRandomOffset="true" legRandomOffsetStdev="0.3" scene="data/scene.xml#s" platform="data/platforms.xml#plane" scanner="data/scanners.xml#two">
  <leg><platformSettings x="-15" y="0" z="60" movePerSec_m="100"/><scannerSettings template="on"/></leg>
  <leg><platformSettings x="15" y="0" z="60" movePerSec_m="100"/><scannerSettings template="on" active="false"/></leg>
</survey></document>"#;

/// A folder with a survey `s.xml` of 1198 pulses from two channels, with noise everywhere, whose other files
/// are in `kept/data` and `more`.
fn tiny() -> tempfile::TempDir {
    let dir = folder();
    let data = dir.path().join("kept/data");
    fs::create_dir_all(&data).unwrap();
    fs::create_dir_all(dir.path().join("more")).unwrap();
    for (name, content) in [
        ("scene.xml", SCENE),
        ("ground.obj", GROUND),
        ("ground.mtl", MATERIAL),
        ("scanners.xml", SCANNERS),
        ("platforms.xml", PLATFORMS),
    ] {
        let folder = if name.starts_with("ground") { dir.path().join("more") } else { data.clone() };
        fs::write(folder.join(name), content).unwrap();
    }
    fs::write(dir.path().join("s.xml"), SURVEY).unwrap();
    dir
}

/// The files that a run with a HELIOS++ command line leaves below `out/tiny/TIME`.
struct Run {
    dir: tempfile::TempDir,
    home: PathBuf,
    said: String,
}

impl Run {
    fn of(options: &str) -> Run {
        Run::words(&format!("s.xml --assets kept --assets more --output out {options}"))
    }

    fn words(line: &str) -> Run {
        let dir = tiny();
        let args: Vec<&str> = line.split_whitespace().map(|w| if w == "''" { "" } else { w }).collect();
        let out = succeed(dir.path(), &args);
        let runs = dir.path().join("out/tiny");
        let home = fs::read_dir(&runs).unwrap().next().unwrap().unwrap().path();
        let name = Path::new("out/tiny").join(home.file_name().unwrap());
        let said = text(&out.stderr);
        let is_quiet = said.is_empty() && !line.contains("--logFileOnly");
        let named = format!("Output directory: \"{}\"\n", name.display());
        let expected = if is_quiet || line.contains("--silent") { "" } else { &named };
        assert_eq!(text(&out.stdout), expected, "{line}");
        Run { home, dir, said }
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        fs::read(self.home.join(name))
            .unwrap_or_else(|e| panic!("{name}: {e}; there is {:?}", files(&self.home)))
    }

    fn points(&self) -> String {
        text(&self.bytes("leg000_points.xyz"))
    }

    fn has(&self, name: &str) -> bool {
        self.home.join(name).exists()
    }

    /// Values of a column of the points.
    fn column(&self, at: usize) -> Vec<f64> {
        self.points().lines().map(|l| l.split(' ').nth(at).unwrap().parse().unwrap()).collect()
    }

    fn log(&self) -> Option<String> {
        let mut logs = files(self.dir.path()).into_iter().filter(|f| {
            let name = f.to_string_lossy().into_owned();
            name.starts_with("helios_") && name.ends_with(".log")
        });
        logs.next().map(|f| fs::read_to_string(self.dir.path().join(f)).unwrap())
    }
}

#[test]
fn the_plain_run_has_points_and_a_trajectory() {
    let plain = Run::of("");
    let points = plain.points();
    assert!(points.lines().count() > 1000, "{} points", points.lines().count());
    assert!(points.lines().all(|l| l.split(' ').count() == 11 && l.contains(" 7 2 ")), "part 7, class 2");
    assert_eq!(files(&plain.home), [Path::new("leg000_points.xyz"), Path::new("leg000_trajectory.txt")]);
    assert!(plain.log().is_none());
}

#[test]
fn these_options_leave_the_points_alone() {
    let plain = Run::of("").points();
    for options in [
        "--parallelization 0",
        "--parallelization 0 --chunkSize 5 -j 3",
        "--parallelization 0 --chunkSize -5 -j 3",
        "--parallelization 1",
        "--chunkSize 7",
        "--CHUNKSIZE -32",
        "--warehouseFactor 1",
        "-j 1",
        "--njobs 2",
        "--nThreads 3",
        "--kdt 1",
        "--kdt 2 --sahNodes 7",
        "--kdt 3",
        "--kdt 4 --sahNodes 16",
        "--tree bvh",
        "--tree axis-sah",
        "--kdtJobs 1 --kdtGeomJobs 2",
        "--rebuildScene",
        "--noSceneWriting",
        "--seed 5",
        "--seed 5 --seed 6",
        "--writePulse --writePulse",
        "-v",
        "-vt",
        "-v2",
    ] {
        assert!(Run::of(options).points() == plain, "{options}");
    }
}

#[test]
fn these_options_change_the_points() {
    let plain = Run::of("").points();
    for options in [
        "--seed 6",
        "--seed 1.5",
        "--disablePlatformNoise",
        "--disableLegNoise",
        "--fixedIncidenceAngle",
        "--calcEchowidth",
        "--gpsStartTime 1704067201",
        "--gpsStartTime ''",
    ] {
        assert!(Run::of(options).points() != plain, "{options}");
    }
}

#[test]
fn the_legacy_model_is_for_scanners_with_one_channel() {
    let strengths = |options: &str, channels: bool| {
        let dir = tiny();
        let scanners = dir.path().join("kept/data/scanners.xml");
        if !channels {
            let (head, rest) = SCANNERS.split_once("<channels>").unwrap();
            let tail = rest.split_once("</channels>").unwrap().1;
            fs::write(scanners, [head, tail].concat()).unwrap();
        }
        let line = format!("s.xml --assets kept --assets more -o - -q {options}");
        text(&succeed(dir.path(), &line.split_whitespace().collect::<Vec<_>>()).stdout)
    };
    assert_ne!(strengths("--legacyEnergyModel", false), strengths("", false));
    assert_eq!(strengths("--legacyEnergyModel", true), strengths("", true));
}

#[test]
fn values_go_where_they_should() {
    let plain = Run::of("");
    assert!(plain.column(4).iter().all(|&width| width == 0.0));
    assert!(Run::of("--calcEchowidth").column(4).iter().all(|&width| width > 0.1));
    assert_eq!(Run::of("--gpsStartTime 1704067200").column(10)[0], 86_391.0);
    assert_eq!(Run::of("--gpsStartTime 1704067201.9").column(10)[0], 86_392.0);
    let heights = |options: &str| -> Vec<String> {
        let pulses = text(&Run::of(&format!("{options} --writePulse")).bytes("leg000_pulse.txt"));
        let mut z: Vec<_> = pulses.lines().map(|l| l.split(' ').nth(2).unwrap().to_owned()).collect();
        z.sort();
        z.dedup();
        z
    };
    assert_eq!(
        heights("--disablePlatformNoise --disableLegNoise"),
        ["59.9000", "60.1000"],
        "mounts of the channels"
    );
    assert!(heights("--disableLegNoise").len() > 100, "noise of the platform");
    let sloping = heights("--disablePlatformNoise");
    assert!(
        sloping.len() > 2 && sloping != heights("--disableLegNoise"),
        "both ends of the leg are elsewhere"
    );
    let flat = Run::of("--disablePlatformNoise --disableLegNoise");
    let steep = Run::of("--fixedIncidenceAngle --disablePlatformNoise --disableLegNoise");
    let brighter = steep.column(3).iter().zip(flat.column(3)).filter(|(a, b)| **a > *b).count();
    assert!(brighter > 1000, "{brighter} echoes are brighter");
}

#[test]
fn files_by_options() {
    for (options, there, gone) in [
        ("--writeWaveform", "leg000_fullwave.txt", "leg000_pulse.txt"),
        ("--writePulse", "leg000_pulse.txt", "leg000_fullwave.txt"),
        ("--lasOutput", "leg000_points.las", "leg000_points.xyz"),
        ("--las10", "leg000_points.las", "leg000_points.xyz"),
        ("--lasOutput --zipOutput", "leg000_points.laz", "leg000_points.las"),
        ("--zipOutput", "leg000_points.bin", "leg000_points.xyz"),
        ("--zipOutput --writeWaveform", "leg000_fullwave.bin", "leg000_fullwave.txt"),
        ("--zipOutput --lasOutput --writePulse", "leg000_pulse.bin", "leg000_pulse.txt"),
        ("--splitByChannel", "leg000_points_devrear.xyz", "leg000_points.xyz"),
        ("--splitByChannel --zipOutput", "leg000_points_devfront.bin", "leg000_points.bin"),
    ] {
        let run = Run::of(options);
        assert!(run.has(there) && !run.has(gone), "{options}: {:?}", files(&run.home));
        assert!(run.has("leg000_trajectory.txt"), "{options}");
    }
}

#[test]
fn las_versions_and_scale() {
    let header = |options: &str| {
        let las = Run::of(options).bytes("leg000_points.las");
        let scale = f64::from_le_bytes(las[131..139].try_into().unwrap());
        (las[24], las[25], las[104], scale)
    };
    assert_eq!(header("--lasOutput"), (1, 4, 6, 1e-4));
    assert_eq!(header("--lasOutput --las10 --lasScale 0.01"), (1, 0, 1, 0.01));
    assert_eq!(header("--las10 --LASSCALE 0.001"), (1, 0, 1, 0.001));
}

#[test]
fn every_pulse_is_written_and_noise_goes_into_waveforms_only() {
    let plain = Run::of("--writeWaveform --writePulse");
    let noisy = Run::of("--writeWaveform --fullwaveNoise");
    assert!(plain.points() == noisy.points());
    assert!(plain.bytes("leg000_fullwave.txt") != noisy.bytes("leg000_fullwave.txt"));
    let pulses = text(&plain.bytes("leg000_pulse.txt")).lines().count();
    assert_eq!(pulses, 1198, "two channels, 599 steps");
}

#[test]
fn channels_split_without_loss() {
    let split = Run::of("--splitByChannel");
    let parts = ["front", "rear"].map(|id| text(&split.bytes(&format!("leg000_points_dev{id}.xyz"))));
    let mut lines: Vec<&str> = parts.iter().flat_map(|p| p.lines()).collect();
    let whole = Run::of("").points();
    let mut expected: Vec<&str> = whole.lines().collect();
    lines.sort_unstable();
    expected.sort_unstable();
    assert_eq!(lines, expected);
}

#[test]
fn compressed_text_expands_to_the_text() {
    let plain = Run::of("--writeWaveform --writePulse");
    let zipped = Run::of("--zipOutput --writeWaveform --writePulse");
    for product in ["points", "fullwave", "pulse"] {
        let bin = zipped.home.join(format!("leg000_{product}.bin"));
        let extension = if product == "points" { "xyz" } else { "txt" };
        let expected = plain.bytes(&format!("leg000_{product}.{extension}"));
        assert_eq!(fs::read(&bin).unwrap()[..2], [0x78, 0xDA]);
        let bin = bin.to_str().unwrap();
        // twice: HELIOS++ overwrites
        for _ in 0..2 {
            succeed(zipped.dir.path(), &["--unzip", bin, "back.txt", "-q"]);
            assert!(fs::read(zipped.dir.path().join("back.txt")).unwrap() == expected, "{product}");
        }
        let piped = succeed(zipped.dir.path(), &["unzip", bin, "-q"]);
        assert!(piped.stdout == expected, "{product} on standard output");
    }
}

#[test]
fn how_much_is_said() {
    let plain = Run::of("").said;
    assert!(plain.contains("pulses") && !plain.contains("tree:"), "{plain}");
    for options in ["--silent", "-q", "--quiet", "--QUIET -v", "--silent -vv"] {
        assert_eq!(Run::of(options).said, "", "{options}");
    }
    let times = Run::of("-vt").said;
    assert!(times.contains("tree:") && times.contains("pulses/s") && !times.contains("leg000"), "{times}");
    for options in ["-v", "-v2", "-vv"] {
        let said = Run::of(options).said;
        assert!(said.contains("tree:") && said.contains("leg000"), "{options}: {said}");
    }
}

#[test]
fn logs_on_file() {
    let both = Run::of("--logFile");
    assert!(both.said.contains("pulses"));
    assert_eq!(both.log().as_deref(), Some(&*both.said));
    let only = Run::of("--logFileOnly");
    assert_eq!(only.said, "");
    assert!(only.log().is_some_and(|log| log.contains("pulses")));
    assert_eq!(Run::of("--logFileOnly --silent").log().as_deref(), Some(""));
}

#[test]
fn where_the_words_stand_does_not_matter() {
    let expected = Run::of("").points();
    for line in [
        "run s.xml --assets kept --output out --assets more",
        "--output out s.xml --assets kept --assets more",
        "run --Assets kept --ASSETS more --OUTPUT out s.xml",
        "s.xml --output out --output elsewhere --assets kept --assets more",
    ] {
        assert!(Run::words(line).points() == expected, "{line}");
    }
}

#[test]
fn without_output_the_folder_is_output() {
    let dir = tiny();
    succeed(dir.path(), &["s.xml", "--assets", "kept", "--assets", "more", "-q"]);
    assert!(dir.path().join("output/tiny").is_dir());
}

#[test]
fn answers_and_refusals() {
    let dir = tiny();
    for (line, status, says) in [
        ("", 0, "Usage"),
        ("--help", 0, "Usage"),
        ("-h", 0, "Usage"),
        ("s.xml --HELP", 0, "--seed"),
        ("--version", 0, "vlscan 0"),
        ("s.xml --version", 0, "vlscan 0"),
        ("--test", 2, "cargo test"),
        ("--test --testDir d", 2, "cargo test"),
        ("--demo box", 2, "scene make"),
        ("s.xml --demoSurvey d", 2, "scene make"),
        ("s.xml --demoAssets d", 2, "scene make"),
        ("s.xml --assets kept", 2, "ground.obj"),
        ("s.xml --seed", 2, "value is required"),
        ("s.xml --assets kept --assets more --seed x", 2, "--seed"),
        ("s.xml --kdt 5", 2, "fsah"),
        ("s.xml --parallelization 2", 2, "[possible values: warehouse, dynamic, static, single]"),
        ("s.xml --assets kept --assets more --gpsStartTime noon:", 2, "--gps-start"),
        ("s.xml --unknownOption", 2, "unknownOption"),
        ("--unzip missing.bin a.txt", 2, "no such file"),
        ("--unzip s.xml a.txt", 2, "expected compressed text"),
        ("missing.xml", 2, "missing.xml"),
    ] {
        let args: Vec<&str> = line.split_whitespace().collect();
        let out = run(dir.path(), &args);
        let said = text(&out.stdout) + &text(&out.stderr);
        assert_eq!(out.status.code(), Some(status), "{line}: {said}");
        assert!(said.contains(says), "{line}: {said}");
    }
    assert!(!dir.path().join("a.txt").exists());
}
