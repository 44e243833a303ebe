//! Fuzz targets: every reader of the program, alone and through the command that uses it.
//!
//! A target puts bytes where a file, a stream or a command line would be, and calls the reader; for one of
//! [`INPUTS_PER_COMMAND`] inputs, or for all where wanted, it also runs the program in this process, which
//! takes some hundred times as long. Whatever the bytes are, the program must return one of its exit
//! statuses: no panic, no endless loop, no memory beyond the limit. Where a run succeeds its points are
//! finite.

use std::cell::OnceCell;
use std::ffi::OsString;
use std::fs;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::time::Duration;
use vlscan::lidar::platform::{PollResult, PoseReader};
use vlscan::options::{Options, read_survey as read_run};
use vlscan::output::unzip;
use vlscan::scene::{LoadOptions, load};
use vlscan::survey::{PlatformKind, SceneRecipe};
use vlscan::tools::cloud::{read_packet, read_points, read_wave};
use vlscan::tools::preview::{PreviewOptions, draw};
use vlscan::{Formula, PulseReader, ReadOptions, command_line, parse_seed, read_scene, read_survey};

/// A folder with a small survey, into which a target writes its bytes.
pub struct Bench {
    folder: tempfile::TempDir,
    /// Points of the packed scene that `packed` damages.
    packed: Vec<u8>,
    packed_points: Vec<u8>,
    /// The scene or the survey that the target's reader is called with, read once.
    scene: OnceCell<SceneRecipe>,
    poses: OnceCell<Option<PlatformKind>>,
}

/// Of so many inputs one is given to the whole command.
const INPUTS_PER_COMMAND: u64 = 64;

/// A place for bytes, and what is done with them.
pub struct Target {
    pub name: &'static str,
    action: Action,
}

enum Action {
    /// Writes the bytes to the file, calls the reader, and runs the command. `@` stands for the folder.
    Command { file: &'static str, read: fn(&Bench, &str), words: &'static [&'static str] },
    /// Calls a function.
    Call(fn(&Bench, &[u8])),
}

const fn command(
    name: &'static str,
    file: &'static str,
    read: fn(&Bench, &str),
    words: &'static [&'static str],
) -> Target {
    Target { name, action: Action::Command { file, read, words } }
}

const fn call(name: &'static str, function: fn(&Bench, &[u8])) -> Target {
    Target { name, action: Action::Call(function) }
}

/// The points of a run.
const POINTS: &str = "points.xyz";

macro_rules! preview {
    ($file:literal $(, $more:literal)*) => {
        &["preview", concat!("@/", $file), "-o", "@/picture.png", "--width", "200", "--height", "150", "--force", "-q" $(, $more)*]
    };
}

macro_rules! fly {
    ($($more:literal),*) => {
        &["run", "@/survey.xml", "-o", "@/points.xyz", "--force", "-q", "-j", "1", "--tree-jobs", "1", "--max-memory", "256M"
            $(, $more)*]
    };
}

macro_rules! trace {
    ($file:literal) => {
        &[
            "trace",
            concat!("@/", $file),
            "--scene",
            "@/scene.xml#s",
            "--scanner",
            "@/own.xml#beam",
            "-o",
            "@/points.xyz",
            "--force",
            "-q",
            "-j",
            "1",
        ]
    };
}

/// All targets.
pub const TARGETS: &[Target] = &[
    command(
        "survey",
        "survey.xml",
        |bench, file| drop(read_survey(&bench.path(file), &ReadOptions::default())),
        &["scene", "info", "@/survey.xml", "-q"],
    ),
    call("survey_read", |bench, data| {
        let _ = read_survey(&bench.write("survey.xml", data), &ReadOptions::default());
    }),
    call("scanner_xml", |bench, data| {
        bench.write("own.xml", data);
        let _ = read_survey(&bench.path("survey.xml"), &ReadOptions::default());
    }),
    call("platform_xml", |bench, data| {
        bench.write("platforms.xml", data);
        let _ = read_survey(&bench.path("survey.xml"), &ReadOptions::default());
    }),
    call("pipeline", |bench, data| {
        let _ = read_run(&bench.write("pipeline.toml", data), Options::default());
    }),
    command(
        "scene_xml",
        "scene.xml",
        |bench, file| drop(read_scene(&format!("{}#s", bench.name(file)), &ReadOptions::default())),
        &["scene", "info", "@/scene.xml#s", "-q"],
    ),
    command("obj", "mesh.obj", |bench, _| bench.load("mesh.obj"), fly!("--scene", "@/mesh.obj")),
    command("mtl", "mesh.mtl", |bench, _| bench.load("mesh.obj"), fly!("--scene", "@/mesh.obj")),
    command(
        "spectrum",
        "spectra/moss.txt",
        |bench, _| bench.load("mesh.obj"),
        fly!("--scene", "@/mesh.obj", "--assets", "@"),
    ),
    command("raster", "ground.tif", |bench, file| bench.load(file), fly!("--scene", "@/ground.tif")),
    command("voxels", "crown.vox", |bench, file| bench.load(file), fly!("--scene", "@/crown.vox")),
    command(
        "instances",
        "trees.csv",
        |bench, file| bench.read_and_load(file),
        fly!("--scene", "@/trees.csv"),
    ),
    command(
        "cloud_xyz",
        "cloud.xyz",
        |bench, _| bench.load("clouds.xml#xyz"),
        fly!("--scene", "@/clouds.xml#xyz"),
    ),
    command(
        "cloud_las",
        "cloud.las",
        |bench, _| bench.load("clouds.xml#las"),
        fly!("--scene", "@/clouds.xml#las"),
    ),
    command(
        "cloud_laz",
        "cloud.laz",
        |bench, _| bench.load("clouds.xml#laz"),
        fly!("--scene", "@/clouds.xml#laz"),
    ),
    command(
        "cloud_ply",
        "cloud.ply",
        |bench, _| bench.load("clouds.xml#ply"),
        fly!("--scene", "@/clouds.xml#ply"),
    ),
    command(
        "poses_text",
        "poses.csv",
        |bench, file| bench.read_poses(file, ""),
        fly!("--trajectory", "@/poses.csv"),
    ),
    command(
        "poses_sbet",
        "poses.sbet",
        |bench, file| bench.read_poses(file, "format = \"sbet\""),
        fly!("--trajectory", "@/poses.sbet", "--trajectory-format", "sbet"),
    ),
    command(
        "poses_trj",
        "poses.trj",
        |bench, file| bench.read_poses(file, "format = \"terrascan\""),
        fly!("--trajectory", "@/poses.trj", "--trajectory-format", "terrascan"),
    ),
    command(
        "poses_arrow",
        "poses.arrow",
        |bench, file| bench.read_poses(file, ""),
        fly!("--trajectory", "@/poses.arrow"),
    ),
    command("pulses_text", "pulses.csv", Bench::read_pulses, trace!("pulses.csv")),
    command("pulses_arrow", "pulses.arrow", Bench::read_pulses, trace!("pulses.arrow")),
    command("preview_xyz", "p.xyz", Bench::read_preview, preview!("p.xyz")),
    command("preview_csv", "p.csv", Bench::read_preview, preview!("p.csv")),
    command("preview_las", "p.las", Bench::read_preview, preview!("p.las")),
    command("preview_laz", "p.laz", Bench::read_preview, preview!("p.laz")),
    command("preview_ply", "p.ply", Bench::read_preview, preview!("p.ply")),
    command("preview_arrow", "p.arrow", Bench::read_preview, preview!("p.arrow")),
    command("preview_parquet", "p.parquet", Bench::read_preview, preview!("p.parquet")),
    command(
        "preview_waveform",
        "w_fullwave.txt",
        |bench, file| {
            if let Ok(source) = fs::File::open(bench.path(file)) {
                let _ = read_wave(source, &bench.path(file), 0);
            }
        },
        preview!("w_fullwave.txt", "--pulse", "0"),
    ),
    command(
        "preview_packets",
        "p.las",
        |bench, file| drop(read_packet(&bench.path(file), 0)),
        preview!("p.las", "--pulse", "0"),
    ),
    command(
        "unzip",
        "p.bin",
        |bench, file| {
            if let Ok(source) = fs::File::open(bench.path(file)) {
                let _ = unzip(
                    &bench.path(file),
                    Box::new(BufReader::new(source)),
                    Some(&bench.path("p.txt")),
                    true,
                );
            }
        },
        &["unzip", "@/p.bin", "@/p.txt", "--force", "-q"],
    ),
    call("packed", damage_packed_scene),
    call("formula", |_, data| {
        if let Ok(formula) = Formula::parse(&String::from_utf8_lossy(data)) {
            let _ = formula.eval(1.5);
        }
    }),
    call("seed", |_, data| drop(parse_seed(&String::from_utf8_lossy(data)))),
    call("command_line", |_, data| {
        let words = data.split(|byte| *byte == 0).map(|word| String::from_utf8_lossy(word).into_owned());
        let _ = command_line().try_get_matches_from(std::iter::once("vlscan".to_owned()).chain(words));
    }),
    call("flight", fly_random_survey),
];

impl Target {
    /// Runs the target on these bytes, and the command on every input if it is `whole`.
    ///
    /// # Panics
    /// If the program panics, returns an unknown status, or writes points that are not finite.
    pub fn run(&self, bench: &Bench, data: &[u8], whole: bool) {
        match self.action {
            Action::Call(function) => function(bench, data),
            Action::Command { file, read, words } => {
                let original = fs::read(bench.path(file)).ok();
                bench.write(file, data);
                read(bench, file);
                if whole || sum(data).is_multiple_of(INPUTS_PER_COMMAND) {
                    bench.check(words);
                }
                if let Some(original) = original {
                    bench.write(file, &original);
                }
            }
        }
    }
}

/// FNV-1a.
fn sum(data: &[u8]) -> u64 {
    data.iter()
        .fold(0xcbf2_9ce4_8422_2325, |sum, byte| (sum ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3))
}

impl Default for Bench {
    fn default() -> Bench {
        Bench::new()
    }
}

impl Bench {
    /// Creates the folder, in memory where the system has such a file system.
    pub fn new() -> Bench {
        let memory = Path::new("/dev/shm");
        let folder = if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() };
        let mut bench = Bench {
            folder: folder.expect("a temporary folder"),
            packed: Vec::new(),
            packed_points: Vec::new(),
            scene: OnceCell::new(),
            poses: OnceCell::new(),
        };
        for (file, content) in FILES {
            bench.write(file, content.as_bytes());
        }
        bench.must(&[
            "scene",
            "pack",
            "@/scene.xml#s",
            "--physics",
            "helios",
            "-o",
            "@/packed.vlscene",
            "--force",
            "-q",
        ]);
        bench.must(fly!("--scene", "@/packed.vlscene"));
        bench.packed = fs::read(bench.path("packed.vlscene")).expect("the packed scene");
        bench.packed_points = fs::read(bench.path(POINTS)).expect("its points");
        assert!(bench.packed_points.len() > 1000);
        bench
    }

    /// Loads a scene whose description does not depend on the input, so that it is read once.
    fn load(&self, scene: &str) {
        // The kind of a file may be known by its first bytes only, so that a broken input has no description.
        match self.scene.get() {
            Some(recipe) => self.load_recipe(recipe),
            None => {
                if let Some(recipe) = self.read_scene(scene) {
                    self.load_recipe(self.scene.get_or_init(|| recipe));
                }
            }
        }
    }

    /// Reads the description of a scene from the input, and loads it.
    fn read_and_load(&self, scene: &str) {
        if let Some(recipe) = self.read_scene(scene) {
            self.load_recipe(&recipe);
        }
    }

    fn read_scene(&self, scene: &str) -> Option<SceneRecipe> {
        let assets = vec![self.folder.path().to_path_buf()];
        let options = ReadOptions { assets, ..ReadOptions::default() };
        read_scene(&self.name(scene), &options).ok().map(|(recipe, _)| recipe)
    }

    fn load_recipe(&self, recipe: &SceneRecipe) {
        let _ = load(recipe, &LoadOptions { jobs: 1, max_memory: Some(256 << 20), ..LoadOptions::default() });
    }

    /// Reads all poses of a trajectory.
    fn read_poses(&self, file: &str, more: &str) {
        let kind = self.poses.get_or_init(|| {
            let settings =
                format!("survey = \"survey.xml\"\n[trajectory]\npath = {:?}\n{more}\n", self.name(file));
            let run = read_run(&self.write("poses.toml", settings.as_bytes()), Options::default());
            run.ok().map(|(survey, ..)| survey.platform.kind)
        });
        let Some(PlatformKind::Stream(settings)) = kind else { panic!("no trajectory") };
        if let Ok(mut reader) = PoseReader::open(settings) {
            while let Ok(PollResult::Poses(_) | PollResult::TimedOut) = reader.poll(Duration::from_secs(10)) {
            }
        }
    }

    fn read_pulses(&self, file: &str) {
        if let Ok(mut reader) = PulseReader::open(&self.path(file), 64) {
            while let Ok(Some(block)) = reader.next_block(&|| false) {
                drop(block);
            }
        }
    }

    fn read_preview(&self, file: &str) {
        if let Ok((points, _)) = read_points(&self.path(file)) {
            draw(&points, &PreviewOptions { width: 200, height: 150, ..PreviewOptions::default() });
        }
    }

    /// Runs a command; if it succeeds, its points are finite.
    fn check(&self, words: &[&str]) {
        if self.run(words) == 0 && words.iter().any(|word| word.ends_with(POINTS)) {
            self.check_points(None);
        }
    }

    /// The name of a file, with what follows `#`.
    fn name(&self, file: &str) -> String {
        self.path(file).display().to_string()
    }

    fn must(&self, words: &[&str]) {
        assert_eq!(self.run(words), 0, "{words:?}");
    }

    fn path(&self, file: &str) -> PathBuf {
        self.folder.path().join(file)
    }

    fn write(&self, file: &str, data: &[u8]) -> PathBuf {
        let path = self.path(file);
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).expect("a folder");
        }
        fs::write(&path, data).expect("a file in the temporary folder");
        path
    }

    /// Runs the program and returns its exit status.
    fn run(&self, words: &[&str]) -> u8 {
        let folder = self.folder.path().to_str().expect("a name in UTF-8");
        let words = words.iter().map(|word| OsString::from(word.replace('@', folder)));
        let status = vlscan::main(std::iter::once(OsString::from("vlscan")).chain(words));
        assert!(status <= 3, "exit status {status}");
        status
    }

    /// Panics if a point is not finite, or farther than `reach` from the origin.
    fn check_points(&self, reach: Option<f64>) {
        let text = fs::read_to_string(self.path(POINTS)).expect("the points");
        for line in text.lines() {
            let values = line.split(' ').take(4).map(|word| word.parse::<f64>().unwrap_or(f64::NAN));
            let values: Vec<f64> = values.collect();
            assert!(values.iter().all(|v| v.is_finite()), "not finite: {line}");
            let is_near = |v: &f64| reach.is_none_or(|reach| v.abs() <= reach);
            assert!(values[..3].iter().all(is_near), "beyond the scene: {line}");
        }
    }
}

/// Changes single bytes of a packed scene: four bytes of input give the place and the change of one. The run
/// fails, or gives the points of the undamaged scene.
fn damage_packed_scene(bench: &Bench, data: &[u8]) {
    let mut packed = bench.packed.clone();
    for patch in data.chunks_exact(4) {
        let at = u32::from_le_bytes([patch[0], patch[1], patch[2], 0]) as usize % packed.len();
        packed[at] ^= patch[3];
    }
    bench.write("packed.vlscene", &packed);
    if bench.run(fly!("--scene", "@/packed.vlscene")) == 0 {
        let points = fs::read(bench.path(POINTS)).expect("the points");
        assert!(points == bench.packed_points, "a damaged scene gave other points");
    }
}

/// Flies a survey whose numbers come from the bytes over the small scene. All points lie within 100 m: they
/// are on the axis of a beam, as far away as a ray of its cone met the scene, whose largest coordinate is 10
/// m, or farther by some lengths of the pulse, where a window of one bin makes every bin of a waveform an
/// echo. Neither that length nor the range noise is ever large.
fn fly_random_survey(bench: &Bench, data: &[u8]) {
    bench.write("random.xml", &[]);
    let mut numbers = Numbers { data: data.iter().copied() };
    let mut text = |template: &str| fill(template, &mut numbers);
    let scanner = text(
        "<document><scanner id=\"beam\" name=\"b\" optics=\"<rotating|oscillating|conic|line>\" accuracy_m=\"[0|0.01]\" \
         beamDivergence_rad=\"{0.0003|0.01}\" pulseFreqs_Hz=\"[300|1000]\" pulseLength_ns=\"<4|10>\" rangeMin_m=\"{0.1|1}\" \
         wavelength_nm=\"{1064|532}\" scanAngleMax_deg=\"{60|90}\" scanAngleEffectiveMax_deg=\"{60|90}\" scanFreqMin_Hz=\"1\" \
         scanFreqMax_Hz=\"{100|1000}\" headRotatePerSecMax_deg=\"3600\" maxNOR=\"{0|1|5}\"><FWFSettings \
         beamSampleQuality=\"{1|3|5}\" binSize_ns=\"{0.25|1}\" winSize_ns=\"{1|4}\"/><beamOrigin z=\"{0|0.1}\"/>\
         <headRotateAxis z=\"1\"/></scanner></document>",
    );
    // Speeds are never small and coordinates never large: a valid survey may last for years.
    let leg = "<leg><platformSettings x=\"[-2|0|3]\" y=\"[-2|0|3]\" z=\"[0.5|8]\" movePerSec_m=\"[5|20]\"/><scannerSettings \
               active=\"{true|false}\" pulseFreq_hz=\"[300|1000]\" scanAngle_deg=\"{20|50}\" scanFreq_hz=\"{10|50}\" \
               headRotateStart_deg=\"[0|10]\" headRotateStop_deg=\"[36|100]\" headRotatePerSec_deg=\"[360|100]\" \
               verticalAngleMin_deg=\"{-40|-10}\" verticalAngleMax_deg=\"{10|60}\"/></leg>";
    let legs = [text(leg), text(leg)].concat();
    let platform = text("<tripod|sr22|copter_linearpath|tractor>");
    bench.write("random.xml", scanner.as_bytes());
    let survey = format!(
        "<document><survey name=\"s\" scene=\"scene.xml#s\" platform=\"data/platforms.xml#{platform}\" \
         scanner=\"random.xml#beam\">{legs}</survey></document>"
    );
    bench.write("random_survey.xml", survey.as_bytes());
    let words =
        ["run", "@/random_survey.xml", "-o", "@/points.xyz", "--force", "-q", "-j", "1", "--tree-jobs", "1"];
    if bench.run(&words) == 0 {
        bench.check_points(Some(100.0));
    }
}

/// Choices made by the bytes of an input.
struct Numbers<I> {
    data: I,
}

impl<I: Iterator<Item = u8>> Numbers<I> {
    fn choose<'a>(&mut self, values: &[&'a str]) -> &'a str {
        values[self.data.next().unwrap_or(0) as usize % values.len()]
    }
}

/// Replaces `<a|b>` in a template by one of the values, `{a|b}` by one of them or, seldom, by any number or
/// none, and `[a|b]` by one of them or, seldom, by something that is no finite positive number.
fn fill<I: Iterator<Item = u8>>(template: &str, numbers: &mut Numbers<I>) -> String {
    const WRONG: &[&str] = &["0", "-1", "-0.0", "NaN", "-inf", "", "x"];
    const ANY: &[&str] =
        &["1", "0.5", "-7", "90", "360", "1e-3", "1e-300", "1e3", "1e9", "1e300", "inf", "NaN", ""];
    let mut text = String::new();
    for quoted in template.split('"') {
        let inner = quoted.get(1..quoted.len().saturating_sub(1)).unwrap_or_default();
        let usual: Vec<&str> = inner.split('|').collect();
        let seldom = |numbers: &mut Numbers<I>| numbers.choose(&["", "", "", "", "", "", "", "x"]) == "x";
        let value = match quoted.chars().next() {
            Some('<') if quoted.contains('|') => numbers.choose(&usual),
            Some('{') if seldom(numbers) => numbers.choose(ANY),
            Some('[') if seldom(numbers) => numbers.choose(WRONG),
            Some('{' | '[') => numbers.choose(&usual),
            _ => quoted,
        };
        text.push_str(value);
        text.push('"');
    }
    text.pop();
    text
}

/// The small survey: a floor and a box, scanned from a tripod with 300 pulses.
const FILES: &[(&str, &str)] = &[
    (
        "survey.xml",
        "<document><survey name=\"s\" scene=\"scene.xml#s\" platform=\"platforms.xml#tripod\" scanner=\"own.xml#beam\">\
         <FWFSettings binSize_ns=\"0.25\" beamSampleQuality=\"2\"/><leg><platformSettings x=\"0.5\" y=\"0.5\" z=\"0.5\"/>\
         <scannerSettings pulseFreq_hz=\"300\" scanAngle_deg=\"50\" scanFreq_hz=\"10\" headRotateStart_deg=\"0\" \
         headRotateStop_deg=\"360\" headRotatePerSec_deg=\"360\"/></leg></survey></document>",
    ),
    (
        "own.xml",
        "<document><scanner id=\"beam\" name=\"beam\" optics=\"rotating\" accuracy_m=\"0\" beamDivergence_rad=\"0.0003\" \
         pulseFreqs_Hz=\"300\" pulseLength_ns=\"4\" rangeMin_m=\"0.1\" wavelength_nm=\"1064\" scanAngleMax_deg=\"60\" \
         scanAngleEffectiveMax_deg=\"60\" scanFreqMin_Hz=\"1\" scanFreqMax_Hz=\"100\" headRotatePerSecMax_deg=\"360\">\
         <beamOrigin z=\"0.1\"/><headRotateAxis z=\"1\"/></scanner></document>",
    ),
    (
        "platforms.xml",
        "<document><platform id=\"tripod\" name=\"Tripod\" type=\"static\"><scannerMount x=\"0\" y=\"0\" z=\"1\"/></platform>\
         </document>",
    ),
    (
        "scene.xml",
        "<document><scene id=\"s\" name=\"s\"><part id=\"0\"><filter type=\"objloader\"><param type=\"string\" key=\"filepath\" \
         value=\"mesh.obj\"/></filter></part><part id=\"1\"><filter type=\"objloader\"><param type=\"string\" key=\"filepath\" \
         value=\"mesh.obj\"/></filter><filter type=\"scale\"><param type=\"double\" key=\"scale\" value=\"0.5\"/></filter><filter \
         type=\"rotate\"><param key=\"rotation\" type=\"rotation\"><rot axis=\"z\" angle_deg=\"30\"/></param></filter></part></scene>\
         </document>",
    ),
    (
        "clouds.xml",
        "<document><scene id=\"xyz\"><part id=\"0\"><filter type=\"xyzloader\"><param type=\"string\" key=\"filepath\" \
         value=\"cloud.xyz\"/><param type=\"string\" key=\"separator\" value=\" \"/><param type=\"double\" key=\"voxelSize\" \
         value=\"0.5\"/></filter></part></scene><scene id=\"las\"><part id=\"0\"><filter type=\"xyzloader\"><param type=\"string\" \
         key=\"filepath\" value=\"cloud.las\"/><param type=\"double\" key=\"voxelSize\" value=\"0.5\"/></filter></part></scene>\
         <scene id=\"laz\"><part id=\"0\"><filter type=\"xyzloader\"><param type=\"string\" key=\"filepath\" value=\"cloud.laz\"/>\
         <param type=\"double\" key=\"voxelSize\" value=\"0.5\"/></filter></part></scene><scene id=\"ply\"><part id=\"0\"><filter \
         type=\"xyzloader\"><param type=\"string\" key=\"filepath\" value=\"cloud.ply\"/><param type=\"double\" key=\"voxelSize\" \
         value=\"0.5\"/></filter></part></scene></document>",
    ),
    (
        "mesh.obj",
        "mtllib mesh.mtl\nusemtl grey\nv -9.5 -9.5 0\nv 9.5 -9.5 0\nv 9.5 9.5 0\nv -9.5 9.5 0\nf 1 2 3 4\nv 3 3 0\nv 5 3 0\n\
         v 5 5 3\nv 3 5 3\nusemtl moss\nf 5 6 7 8\n",
    ),
    (
        "mesh.mtl",
        "newmtl grey\nKd 0.25 0.25 0.25\nKs 0.1 0.1 0.1\nNs 10\nhelios_reflectance 0.5\nnewmtl moss\nhelios_spectra moss\n\
         helios_classification 12\nhelios_isGround true\n",
    ),
    ("trees.csv", "file,x,y,z,yaw,scale\nmesh.obj,0,0,0,90,0.25\nmesh.obj,1,2,0.5,45,0.5\n"),
];
