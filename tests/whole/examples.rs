//! The examples of the README, `docs/`, the manual pages and `pipelines/` work as they are written, in a
//! folder of their own. Examples that need a program that is not installed are skipped.

use crate::common;
use crate::common::{folder, text};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// Programs that examples may need and that may not be installed.
const OPTIONAL_PROGRAMS: [&str; 9] =
    ["pdal", "parallel", "pv", "laszip", "polars", "duckdb", "CloudCompare", "man", "gzip"];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// A folder with the files that the examples of a page use, and a folder for the search path with the
/// program.
struct Workspace {
    folder: tempfile::TempDir,
    programs: tempfile::TempDir,
}

impl Workspace {
    fn new() -> Workspace {
        let workspace = Workspace { folder: folder(), programs: folder() };
        std::os::unix::fs::symlink(env!("CARGO_BIN_EXE_vlscan"), workspace.programs.path().join("vlscan"))
            .unwrap();
        workspace
    }

    fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Copies a file or folder of the project.
    fn copy_in(&self, from: &str, to: &str) -> &Workspace {
        copy(&root().join(from), &self.path().join(to));
        self
    }

    fn bash(&self, script: &str) -> Output {
        let path = std::env::var("PATH").unwrap_or_default();
        Command::new("bash")
            .args(["-euo", "pipefail", "-c", script])
            .current_dir(self.path())
            .env("PATH", format!("{}:{path}", self.programs.path().display()))
            .env("HOME", self.path())
            .env("NO_COLOR", "1")
            .stdin(Stdio::null())
            .output()
            .expect("bash starts")
    }

    /// Runs the examples one after the other; all must succeed. Returns how many ran.
    fn run_examples(&self, page: &str, examples: &[String]) -> usize {
        let mut failures = Vec::new();
        let ran = self.try_examples(page, examples, &mut failures);
        assert!(failures.is_empty(), "{}", failures.join("\n"));
        ran
    }

    /// Runs the examples one after the other, adds those that fail or warn to `failures`, and returns how
    /// many ran.
    fn try_examples(&self, page: &str, examples: &[String], failures: &mut Vec<String>) -> usize {
        let mut ran = 0;
        for example in examples {
            let missing =
                OPTIONAL_PROGRAMS.iter().find(|name| mentions(example, name) && !is_installed(name));
            if let Some(name) = missing {
                common::missing(name, &format!("for this example of {page}:\n{example}"));
                continue;
            }
            let Some(script) = runnable(example) else { continue };
            let done = self.bash(&script);
            if !done.status.success() || text(&done.stderr).contains("warning") {
                let (said, stdout) = (text(&done.stderr), text(&done.stdout));
                failures.push(format!("{page} ({}):\n{example}\n--- it says:\n{stdout}{said}", done.status));
                continue;
            }
            self.check_clouds(page, example);
            ran += 1;
        }
        ran
    }

    /// Every point cloud in the folder has points, and an extent in three dimensions.
    fn check_clouds(&self, page: &str, example: &str) {
        for entry in fs::read_dir(self.path()).unwrap() {
            let path = entry.unwrap().path();
            let cloud = match path.extension().and_then(|e| e.to_str()) {
                Some("las" | "laz") => Cloud::of_las(&fs::read(&path).unwrap()),
                Some("xyz") => Cloud::of_rows(&fs::read_to_string(&path).unwrap(), ' '),
                _ => continue,
            };
            let name = path.display();
            assert!(cloud.count >= 500, "{name} of {page} has {} points:\n{example}", cloud.count);
            let size: Vec<f64> = (0..3).map(|axis| cloud.max[axis] - cloud.min[axis]).collect();
            assert!(size.iter().all(|s| *s > 0.5), "{name} of {page} is {size:?} m large:\n{example}");
        }
    }
}

/// Number, bounds and classes of a point cloud.
struct Cloud {
    count: usize,
    min: [f64; 3],
    max: [f64; 3],
    classes: BTreeSet<u8>,
}

impl Cloud {
    /// From the header of LAS 1.4.
    fn of_las(bytes: &[u8]) -> Cloud {
        let number = |at: usize| f64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
        let count = u64::from_le_bytes(bytes[247..255].try_into().unwrap()) as usize;
        Cloud {
            count,
            max: [179, 195, 211].map(number),
            min: [187, 203, 219].map(number),
            classes: BTreeSet::new(),
        }
    }

    /// From lines of x, y, z and perhaps a class; a header is skipped.
    fn of_rows(text: &str, separator: char) -> Cloud {
        let [mut min, mut max] = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        let (mut count, mut classes) = (0, BTreeSet::new());
        for line in text.lines().filter(|line| !line.starts_with(char::is_alphabetic)) {
            let fields: Vec<f64> = line.split(separator).map_while(|f| f.parse().ok()).collect();
            for axis in 0..3 {
                min[axis] = min[axis].min(fields[axis]);
                max[axis] = max[axis].max(fields[axis]);
            }
            classes.insert(fields.get(3).map_or(0, |class| *class as u8));
            count += 1;
        }
        Cloud { count, min, max, classes }
    }

    /// Compares number and bounds: up to a quarter more points than `least`, bounds within a metre.
    fn check(&self, name: &str, least: usize, min: [f64; 3], max: [f64; 3]) {
        assert!((least..least * 5 / 4).contains(&self.count), "{name}: {} points", self.count);
        for axis in 0..3 {
            let off = (self.min[axis] - min[axis]).abs().max((self.max[axis] - max[axis]).abs());
            assert!(off < 1.0, "{name}: {:?} to {:?}", self.min, self.max);
        }
    }
}

fn copy(from: &Path, to: &Path) {
    if from.is_dir() {
        fs::create_dir_all(to).unwrap();
        for entry in fs::read_dir(from).unwrap() {
            let entry = entry.unwrap();
            copy(&entry.path(), &to.join(entry.file_name()));
        }
    } else {
        fs::create_dir_all(to.parent().unwrap()).unwrap();
        fs::copy(from, to).unwrap();
    }
}

fn mentions(example: &str, program: &str) -> bool {
    let code = example.lines().filter(|line| !line.trim_start().starts_with('#'));
    let mut words = code.flat_map(|line| line.split(|c: char| !(c.is_alphanumeric() || "-_./".contains(c))));
    words.any(|word| word == program || (program == "parallel" && word.ends_with("dataset.sh")))
}

fn is_installed(program: &str) -> bool {
    let found =
        Command::new("sh").args(["-c", &format!("command -v {program}")]).stdout(Stdio::null()).status();
    found.is_ok_and(|status| status.success())
}

/// The example with the tested program in place of `cargo run`; `None` for examples that only call cargo.
fn runnable(example: &str) -> Option<String> {
    let lines: Vec<String> = example
        .lines()
        .filter_map(|line| match line.strip_prefix("cargo run --release -- ") {
            Some(rest) => Some(format!("vlscan {rest}")),
            None if line.starts_with("cargo ") => {
                println!("skipped: {line}");
                None
            }
            None => Some(line.to_owned()),
        })
        .collect();
    let does = lines.iter().any(|line| !line.trim().is_empty() && !line.trim_start().starts_with('#'));
    does.then(|| lines.join("\n"))
}

/// Shell examples of a page of Markdown: indented blocks and those fenced as `sh`, separated by empty lines.
fn examples(markdown: &str) -> Vec<String> {
    let mut blocks: Vec<Vec<&str>> = vec![Vec::new()];
    let mut fence: Option<bool> = None;
    let mut after_text = false;
    for line in markdown.lines() {
        if let Some(kind) = line.trim_start().strip_prefix("```") {
            fence = if fence.is_some() { None } else { Some(kind == "sh") };
            blocks.push(Vec::new());
        } else if fence == Some(true) && !line.trim().is_empty() {
            blocks.last_mut().unwrap().push(line);
        } else if fence.is_none() && line.starts_with("    ") && !after_text {
            blocks.last_mut().unwrap().push(&line[4..]);
        } else {
            blocks.push(Vec::new());
            // A code block follows an empty line; indented lines right below text continue a list.
            after_text = fence.is_none() && !line.trim().is_empty();
        }
    }
    blocks.into_iter().filter(|block| !block.is_empty()).map(|block| block.join("\n")).collect()
}

/// The EXAMPLES of a manual page, as `man` shows them.
fn examples_of_manual(page: &str) -> Vec<String> {
    let inside = page
        .split_once("\n.EX\n")
        .and_then(|(_, rest)| rest.split_once("\n.EE"))
        .map_or("", |(code, _)| code);
    let plain = inside
        .replace("\\&", "")
        .replace("\\-", "-")
        .replace("\\*(Aq", "'")
        .replace("\\(aq", "'")
        .replace("\\\\", "\\");
    examples(&format!("```sh\n{plain}\n```\n"))
}

#[test]
fn examples_of_the_readme_run() {
    let page = fs::read_to_string(root().join("README.md")).unwrap();
    let workspace = Workspace::new();
    workspace.copy_in("fixtures", "fixtures").copy_in("pipelines", "pipelines").copy_in("man", "man");
    // A survey as HELIOS++ users have it.
    workspace.copy_in("fixtures/room", "my_assets").copy_in("fixtures/room/survey.xml", "survey.xml");
    let ran = workspace.run_examples("README.md", &examples(&page));
    assert!(ran >= 7, "{ran} examples");
    check_clouds_of_page(&root().join("README.md"), &workspace);
}

/// Pages of Markdown of the project.
fn pages() -> Vec<PathBuf> {
    let folders = ["", "docs", "docs/dev", "docs/dev/notes", "docs/dev/spec", "fixtures", "pipelines/paper"];
    let entries = folders.iter().flat_map(|folder| fs::read_dir(root().join(folder)).unwrap());
    let mut pages: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    pages.retain(|path| path.extension().is_some_and(|e| e == "md"));
    pages.sort();
    pages
}

#[test]
fn links_between_pages_lead_somewhere() {
    let mut links = 0;
    for path in pages() {
        let page = fs::read_to_string(&path).unwrap();
        for link in page.split("](").skip(1).map(|rest| rest.split_once(')').unwrap().0) {
            let file = path.parent().unwrap().join(link.split('#').next().unwrap());
            assert!(link.starts_with("https://") || file.exists(), "{} leads to {link}", path.display());
            links += 1;
        }
    }
    assert!(links > 20, "{links} links");
}

/// Pages whose commands measure speed.
const MEASUREMENTS: [&str; 3] = ["experiment.md", "kernel.md", "speed.md"];

/// A file that a page of docs/ leaves: the page, its name, the least number of points, their bounds.
type CloudOfPage = (&'static str, &'static str, usize, [f64; 3], [f64; 3]);

/// As seen in a picture of each.
const CLOUDS_OF_PAGES: [CloudOfPage; 17] = [
    ("README.md", "forest.laz", 40_000, [-22.9, -22.0, 0.4], [21.8, 22.0, 24.2]),
    ("README.md", "trees.laz", 420_000, [-34.2, -33.8, -1.3], [33.9, 33.6, 26.7]),
    ("README.md", "traced.laz", 23_000, [-119.4, -119.3, -15.4], [120.1, 119.3, 9.3]),
    ("docs/cluster.md", "forest.laz", 40_000, [-22.9, -22.0, 0.4], [21.8, 22.0, 24.2]),
    ("docs/cluster.md", "resumed.laz", 40_000, [-22.9, -22.0, 0.4], [21.8, 22.0, 24.2]),
    ("docs/pipes.md", "traced.laz", 23_000, [-119.4, -119.3, -15.4], [120.1, 119.3, 9.3]),
    (
        "docs/trajectories.md",
        "again.laz",
        200_000,
        [475_880.0, 5_428_880.0, -15.5],
        [476_120.0, 5_429_120.0, 9.3],
    ),
    (
        "docs/trajectories.md",
        "level.laz",
        200_000,
        [475_880.0, 5_428_880.0, -15.5],
        [476_120.0, 5_429_120.0, 9.3],
    ),
    (
        "docs/trajectories.md",
        "mine.laz",
        145_000,
        [475_880.0, 5_428_880.0, -14.6],
        [476_120.0, 5_429_120.0, 9.3],
    ),
    ("docs/trajectories.md", "a.laz", 145_000, [-74.8, -120.0, -7.8], [71.8, -37.6, 7.4]),
    (
        "docs/own-data.md",
        "site.laz",
        360_000,
        [475_889.4, 5_428_849.0, 202.0],
        [476_102.6, 5_429_141.9, 220.0],
    ),
    (
        "docs/own-data.md",
        "gnss.laz",
        360_000,
        [475_891.1, 5_428_849.0, 202.0],
        [476_098.6, 5_429_145.3, 220.0],
    ),
    ("docs/scenes.md", "stand.laz", 69_000, [-29.7, -24.7, -3.0], [20.7, 24.7, 12.9]),
    ("docs/scenes.md", "scanned.laz", 69_000, [-29.7, -24.5, -2.5], [20.7, 24.5, 13.0]),
    ("docs/scenes.md", "crown.laz", 69_000, [-29.7, -24.7, -3.0], [20.7, 24.7, 6.8]),
    ("docs/scenes.md", "forest.laz", 69_000, [-29.7, -24.7, -3.0], [20.7, 24.7, 11.8]),
    ("docs/scenes.md", "moving.laz", 69_000, [-29.7, -24.7, -3.0], [20.7, 24.7, 7.9]),
];

#[test]
#[ignore = "minutes; part of `.ci/run --long`"]
fn examples_of_docs_run() {
    let entries = ["docs", "docs/dev"].iter().flat_map(|folder| fs::read_dir(root().join(folder)).unwrap());
    let mut pages: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    pages.retain(|path| path.extension().is_some_and(|e| e == "md"));
    pages.sort();
    assert!(pages.len() >= 20);
    let mut failures = Vec::new();
    for path in pages {
        let page = fs::read_to_string(&path).unwrap();
        if MEASUREMENTS.iter().any(|name| path.ends_with(name)) {
            println!("skipped: {} measures for minutes", path.display());
            continue;
        }
        let workspace = Workspace::new();
        workspace.copy_in("fixtures", "fixtures").copy_in("pipelines", "pipelines");
        workspace
            .copy_in("fixtures/room", "my_assets")
            .copy_in("fixtures/room/survey.xml", "data/surveys/my_survey.xml");
        // The first file that a page shows is the one that its commands run.
        if let Some((_, rest)) = page.split_once("```toml\n") {
            let file = rest.split_once("```").unwrap().0;
            fs::write(workspace.path().join("my_instrument.toml"), file).unwrap();
        }
        let before = failures.len();
        workspace.try_examples(&path.display().to_string(), &examples(&page), &mut failures);
        if failures.len() == before {
            check_clouds_of_page(&path, &workspace);
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

/// Compares the files that the examples of a page have left with what they are known to hold.
fn check_clouds_of_page(page: &Path, workspace: &Workspace) {
    for (_, file, least, min, max) in CLOUDS_OF_PAGES.iter().filter(|cloud| page == root().join(cloud.0)) {
        let bytes = fs::read(workspace.path().join(file)).unwrap();
        Cloud::of_las(&bytes).check(file, *least, *min, *max);
    }
}

/// A shell function that changes the columns of the flight of docs/own-data.md by awk, and flies it.
const FLY: &str = r#"fly() {
  awk -F, -v OFS=, -v CONVFMT=%.6f "NR == 1 { gsub(/.deg./, \"\") } NR > 1 { $1 } NR < 40" flight.csv > wrong.csv
  vlscan run site.toml --trajectory wrong.csv -o wrong.laz --force
}"#;

/// The mistakes of the table in docs/own-data.md: what makes them, and what is said, in the order of the
/// table.
const MISTAKES: [(&str, &str); 42] = [
    ("fly '$2 -= 476000; $3 -= 5429000'", "coordinates of a grid such as UTM, the flight has local ones"),
    ("fly '$2 = 8.67176; $3 = 49.0121 + NR / 1e5'", "look like longitude and latitude"),
    ("fly '$2 -= 434000'", "as between neighbouring UTM zones"),
    ("fly '$3 += 10000000'", "the false northing of the southern hemisphere"),
    ("fly 'swap = $2; $2 = $3; $3 = swap'", "with x and y swapped"),
    ("fly 'for (i = 2; i < 5; i++) $i /= 0.3048'", "read as feet"),
    (
        "awk -F, -v OFS=, 'NR > 1 { $1 = sprintf(\"%d\", 1000 * $1) } NR < 40' flight.csv > slow.csv; \
         sed 's/50000/100/' site.toml > rare.toml; vlscan run rare.toml --trajectory slow.csv -o slow.laz",
        "0.010 m/s on average",
    ),
    (
        "awk -F, -v OFS=, 'NR > 1 { $1 = sprintf(\"%.6f\", $1 / 60) } 1' flight.csv > fast.csv; \
         vlscan run site.toml --trajectory fast.csv -o wrong.laz --force",
        "600 m/s on average",
    ),
    ("fly 'if (NR == 20) $2 += 1000'", "remove the pose if its place or time is wrong"),
    ("fly '$4 -= 148'", "below the lowest point of the scene"),
    ("fly '$4 -= 105'", "below the terrain"),
    (
        "awk -F, -v OFS=, '{ print $0, NR == 1 ? \"yaww\" : 0 }' flight.csv > named.csv; \
         vlscan run site.toml --trajectory named.csv -o wrong.laz --force",
        "columns that are not read",
    ),
    (
        "awk -F, 'NR > 1 { print $1, $2, $3, $4, 0, 0, 0, 1 }' flight.csv > tum.txt; \
         vlscan run site.toml --trajectory tum.txt -o wrong.laz --force",
        "the platform moves towards",
    ),
    (
        "awk -F, 'NR > 1 { print 1, 0, 0, $2, 0, 1, 0, $3, 0, 0, 1, $4 }' flight.csv > kitti.txt; \
         vlscan run site.toml --trajectory kitti.txt -o wrong.laz --force",
        "have no times",
    ),
    ("fly 'for (i = 5; i < 8; i++) $i /= 57.29578'", "the angles look like radians"),
    ("fly '$7 = 90'", "the platform moves towards"),
    (
        "sed /copter/d site.toml > wrong.toml; vlscan run wrong.toml -o wrong.laz --force",
        "of the beams point above the horizon",
    ),
    ("sed /translate/d scene.xml > local.xml; vlscan scene info local.xml", "has local coordinates"),
    (
        "mkdir degrees; cp ./*.* degrees; cd degrees; printf '%s\n' 2e-5 0 0 -2e-5 8.67 49.01 > dem.tfw; \
         vlscan scene info dem.tif",
        "its coordinates are degrees",
    ),
    ("cp dem.tif nowhere.tif; vlscan scene info nowhere.tif", "it does not say where it lies"),
    (
        // -9999 as the first pixel.
        "cp dem.tif holes.tif; cp dem.tfw holes.tfw; \
         printf '\\000\\074\\034\\306' | dd of=holes.tif bs=1 seek=122 conv=notrunc; vlscan scene info holes.tif",
        "which often means no data",
    ),
    (
        "awk '$1 == \"v\" { print $1, 1000 * $2, 1000 * $3, 1000 * $4; next } 1' house.obj > large.obj; \
         vlscan scene info large.obj",
        "are taken as metres",
    ),
    (
        "awk '$1 == \"v\" { print $1, $2, $4, -$3; next } 1' house.obj > lying.obj; vlscan scene info lying.obj",
        "lies on its side",
    ),
    ("sed '/^v/s/-6/-6,0/' house.obj > comma.obj; vlscan scene info comma.obj", "a decimal comma"),
    (
        "sed s/site.mtl/none.mtl/ house.obj > wrong.obj; vlscan scene info wrong.obj",
        "there is no material file",
    ),
    (
        "sed 's/reflectance 0.3/reflectance 30/' site.mtl > units.mtl; sed s/site.mtl/units.mtl/ scene.xml > units.xml; \
         vlscan scene info units.xml",
        "are in two units",
    ),
    (
        "sed '/^.scanner/a received_energy_min_w = 1' site.toml > high.toml; vlscan run high.toml -o wrong.laz --force",
        "returned less than the detector needs",
    ),
    (
        "printf '%s\n' 'scene = \"scene.xml\"' 'platform = { catalogue = \"data/platforms.xml#tripod\" }' \
         'scanner = { catalogue = \"data/scanners_tls.xml#riegl_vz400\" }' \
         'settings = { pulse_freq_hz = 100000, scan_angle_deg = 50, scan_freq_hz = 60, head_rate_deg_per_s = 180, head_stop_deg = 6 }' \
         'leg = [{ position_m = [0, 0, 0], on_ground = true }]' > tripod.toml; vlscan run tripod.toml -o wrong.laz --force",
        "no ground at",
    ),
    (
        "sed /helios_reflectance/d site.mtl > dull.mtl; sed s/site.mtl/dull.mtl/ house.obj > dull.obj; vlscan scene info dull.obj",
        "no reflectance",
    ),
    (
        "vlscan run site.toml -o site.laz --force -q; vlscan run site.laz",
        "expected a survey (.xml) or a pipeline (.toml), found a LAZ point cloud",
    ),
    (
        "printf 'Kaydara FBX Binary  ' > tree.obj; vlscan scene info tree.obj",
        "expected a mesh (OBJ, PLY, STL, OFF, glTF)",
    ),
    (
        "mkdir -p sub; cp scene.xml dem.tif dem.tfw house.obj site.mtl sub; vlscan scene info sub/scene.xml",
        "of the working directory is read",
    ),
    (
        "vlscan run site.toml --crs EPSG:3067 -o wrong.laz --force --dry-run",
        "from the area in which it is used",
    ),
    (
        "sed 's/^lever_arm_m.*/lever_arm_m = [0, 100, 0]/' site.toml > far.toml; vlscan run far.toml -o wrong.laz --force --dry-run",
        "typical values are",
    ),
    (
        "sed 's/scan_angle_deg = 45/scan_angle_deg = 0.785/' site.toml > narrow.toml; \
         vlscan run narrow.toml -o wrong.laz --force --dry-run",
        "0.785 rad would be 44.9772 degrees",
    ),
    ("fly '$4 /= 0.3048'", "if its heights are in feet"),
    (
        "printf '%s\n' 'v -5 0.5 -5' 'v 5 0.5 -5' 'v 5 0.5 5' 'v -5 0.5 5' 'f 1 2 3 4' > wall.obj; \
         printf '%s\n' 'scanner = { catalogue = \"vlp16\", range_min_m = 0.1 }' 'part = [{ file = \"wall.obj\" }]' \
         'settings = { pulse_freq_hz = 18750, head_rate_deg_per_s = 3600, head_start_deg = -10, head_stop_deg = 10 }' \
         'leg = [{ position_m = [0, 0, 0] }]' > wall.toml; vlscan run wall.toml -o wrong.laz --physics helios --force",
        "light came from nearer than",
    ),
    (
        "sed '/^.scanner/a nep_w = 1e-3' site.toml > noisy.toml; \
         vlscan run noisy.toml -o wrong.laz --force --dry-run",
        "crosses the detection threshold",
    ),
    (
        "sed '/^.scanner/a optics = \"conic\"\\nscan_angle_max_deg = 0' site.toml > straight.toml; \
         vlscan run straight.toml -o wrong.laz --force --dry-run",
        "never deflect the beam",
    ),
    (
        "sed '/^.scanner/a range_min_m = 500' site.toml > near.toml; vlscan run near.toml -o wrong.laz --force",
        "fly higher",
    ),
    (
        "sed 's/scan_angle_deg = 45/scan_angle_deg = 270/' site.toml > wide.toml; vlscan run wide.toml -o wrong.laz --force --dry-run",
        "is beyond the scanner's",
    ),
    ("fly '$2 += 300'", "points for"),
];

#[test]
fn mistakes_with_own_data_are_answered_as_the_page_says() {
    let page = fs::read_to_string(root().join("docs/own-data.md")).unwrap();
    let (_, table) = page.split_once("## What goes wrong").unwrap();
    let listed: Vec<&str> =
        table.lines().filter_map(|line| line.split(" | `").nth(1)?.split('`').next()).collect();
    assert_eq!(listed, MISTAKES.map(|(_, warning)| warning));
    let workspace = Workspace::new();
    // The blocks that write the files of the page.
    let files: Vec<String> = examples(&page).into_iter().filter(|block| block.contains(" > ")).collect();
    workspace.run_examples("docs/own-data.md", &files);
    for (mistake, warning) in MISTAKES {
        let said = text(&workspace.bash(&format!("{FLY}\n{mistake}")).stderr);
        assert!(said.contains(warning), "{mistake}: {said}");
    }
}

#[test]
fn every_correction_has_its_row() {
    let dir = folder();
    let help = text(&common::succeed(dir.path(), &["run", "--help"]).stdout);
    let (_, list) = help.split_once("\nCorrections").unwrap();
    let (list, _) = list.split_once("\nExamples").unwrap();
    let entries = list.lines().filter_map(|line| line.strip_prefix("  "));
    let names = entries.filter(|line| line.starts_with(|c: char| c.is_ascii_lowercase()));
    let page = fs::read_to_string(root().join("docs/dev/physics.md")).unwrap();
    let mut count = 0;
    for name in names.map(|line| line.split(' ').next().unwrap()) {
        assert!(page.contains(&format!("\n| `{name}`")), "docs/dev/physics.md has no row of {name}");
        count += 1;
    }
    assert!(count > 50, "{count} corrections");
}

#[test]
#[ignore = "minutes; part of `.ci/run --long`"]
fn the_examples_of_the_manual_run_in_an_empty_folder() {
    let mut pages: Vec<PathBuf> =
        fs::read_dir(root().join("man")).unwrap().map(|e| e.unwrap().path()).collect();
    // Section 5 shows a pipeline file, section 1 commands.
    pages.retain(|path| path.extension().is_some_and(|e| e == "1"));
    pages.sort();
    let mut failures = Vec::new();
    for path in pages {
        let examples = examples_of_manual(&fs::read_to_string(&path).unwrap());
        assert!(!examples.is_empty(), "{} has no examples", path.display());
        Workspace::new().try_examples(&path.display().to_string(), &examples, &mut failures);
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
#[ignore = "minutes; part of `.ci/run`"]
fn every_pipeline_runs_as_it_is() {
    let mut pipelines: Vec<PathBuf> =
        fs::read_dir(root().join("pipelines")).unwrap().map(|e| e.unwrap().path()).collect();
    pipelines.retain(|path| path.extension().is_some_and(|e| e == "toml"));
    pipelines.sort();
    assert!(pipelines.len() >= 7);
    // Two seconds of the flight.
    let flight: String = fs::read_to_string(root().join("fixtures/flight.csv"))
        .unwrap()
        .lines()
        .take(400)
        .map(|l| format!("{l}\n"))
        .collect();
    for path in pipelines {
        let page = fs::read_to_string(&path).unwrap();
        let name = path.file_name().unwrap().to_str().unwrap();
        let told = format!("vlscan run pipelines/{name}");
        assert!(
            page.lines().take(12).any(|l| l.starts_with('#') && l.contains(&told)),
            "{name} does not tell how it is run"
        );
        let workspace = Workspace::new();
        let done =
            common::feed(workspace.path(), &["run", path.to_str().unwrap(), "--strict"], flight.as_bytes());
        assert!(done.status.success(), "{name}: {}", text(&done.stderr));
        let keys: toml::Table = page.parse().unwrap();
        let outputs = keys["output"].as_array().unwrap();
        for output in outputs.iter().map(|output| output["path"].as_str().unwrap()) {
            let bytes = match output {
                "-" => done.stdout.len() as u64,
                file if workspace.path().join(file).is_dir() => {
                    fs::read_dir(workspace.path().join(file)).unwrap().count() as u64 * 1000
                }
                file => fs::metadata(workspace.path().join(file))
                    .unwrap_or_else(|e| panic!("{name}: {file}: {e}"))
                    .len(),
            };
            assert!(bytes > 1000, "{name}: {output} has {bytes} bytes");
        }
    }
}

/// Expected result of a pipeline: its name, the least number of points, their bounds, their classes.
type Expected = (&'static str, usize, [f64; 3], [f64; 3], &'static [u8]);

/// As seen in a picture of each.
const EXPECTED: [Expected; 7] = [
    ("airborne.toml", 190_000, [475_880.0, 5_428_880.0, -15.5], [476_120.0, 5_429_120.0, 9.3], &[2, 6, 64]),
    ("als.toml", 140_000, [-74.8, -120.0, -7.8], [71.8, -37.6, 7.4], &[2, 64]),
    ("dataset.toml", 37_000, [-23.0, -22.8, 0.4], [14.7, 22.3, 24.2], &[2, 3, 4, 5]),
    ("mobile.toml", 420_000, [-20.0, -20.4, 0.0], [19.8, 9.6, 9.4], &[6, 11, 15]),
    ("own_scanner.toml", 920_000, [-23.1, -23.1, 0.4], [22.1, 22.6, 25.0], &[2, 3, 4, 5]),
    ("tls.toml", 1_560_000, [-4.4, -3.5, 0.0], [4.4, 3.5, 2.8], &[2, 5, 6, 64, 65, 66]),
    ("voxels.toml", 25_000, [-19.8, -20.0, -0.1], [10.2, 20.0, 10.0], &[2, 5]),
];

#[test]
#[ignore = "minutes; part of `.ci/run`"]
fn every_pipeline_gives_what_it_describes() {
    let flight: Vec<u8> = fs::read(root().join("fixtures/flight.csv")).unwrap();
    let flight: Vec<u8> = flight.split_inclusive(|b| *b == b'\n').take(400).flatten().copied().collect();
    let shipped = fs::read_dir(root().join("pipelines")).unwrap().map(|e| e.unwrap().path());
    assert_eq!(shipped.filter(|path| path.extension().is_some_and(|e| e == "toml")).count(), EXPECTED.len());
    for (name, least, min, max, classes) in EXPECTED {
        let workspace = Workspace::new();
        let path = root().join("pipelines").join(name);
        let args =
            ["run", path.to_str().unwrap(), "--strict", "-o", "a.csv", "--columns", "X,Y,Z,Classification"];
        let done = common::feed(workspace.path(), &args, &flight);
        let said = text(&done.stderr);
        assert!(done.status.success() && !said.contains("warning"), "{name}: {said}");
        let cloud = Cloud::of_rows(&fs::read_to_string(workspace.path().join("a.csv")).unwrap(), ',');
        cloud.check(name, least, min, max);
        assert_eq!(cloud.classes, classes.iter().copied().collect(), "{name}");
    }
}

#[test]
fn a_dataset_is_made_by_as_many_processes_as_there_are_cores() {
    if !is_installed("parallel") {
        common::missing("parallel", "pipelines/dataset.sh needs GNU parallel");
        return;
    }
    let workspace = Workspace::new();
    let make = |command: &str| {
        let done = workspace.bash(&format!("{}/pipelines/{command}", root().display()));
        assert!(done.status.success(), "{command}: {}", text(&done.stderr));
        text(&done.stdout)
    };
    assert_eq!(make("dataset.sh all 3").trim(), "3");
    assert_eq!(make("dataset.sh again 2").trim(), "2");
    let scene = |path: &str| fs::read(workspace.path().join(path)).unwrap();
    assert!(scene("all/forest2.laz") == scene("again/forest2.laz"), "the same seed, other bytes");
    assert!(scene("all/forest1.laz") != scene("all/forest2.laz"), "another seed, the same bytes");
    assert!(scene("all/forest1.laz").starts_with(b"LASF"));
    // A run that was interrupted continues.
    fs::remove_file(workspace.path().join("again/forest1.laz")).unwrap();
    make("dataset.sh again 3");
    assert!(
        scene("all/forest1.laz") == scene("again/forest1.laz") && scene("again/forest3.laz").len() > 10_000
    );
}

#[test]
fn errors_say_what_to_do() {
    let dir = folder();
    common::succeed(
        dir.path(),
        &["scene", "make", "forest", "-n", "2k", "--pulses", "2k", "-o", "forest", "-q"],
    );
    for (line, answer) in [
        ("run nofile.xml", "searched in:"),
        ("run forest", "forest is a folder; name ./forest/survey.xml"),
        ("run forest/scene.xml", "it holds a <scene>"),
        ("scene make forest -o forest", "--force"),
        ("scene info forest", "name forest/survey.xml"),
        ("preview forest/scene.xml -o a.png", "contains no points and no survey"),
        ("preview forest/scene.xml -o a.png", "name a file of points, a survey"),
        ("preview forest -o a.png", "name a file of points"),
        ("preview none.laz -o a.png", "there is no such file"),
        ("run forest/survey.xml --trajectory none.csv -o a.xyz", "none.csv: there is no such file"),
        ("trace none.csv --scanner forest/survey.xml -o a.xyz", "none.csv: there is no such file"),
        ("unzip none.bin a.txt", "none.bin: there is no such file"),
        ("preview none.laz -o a.gif", ".png, .html or .copc.laz"),
        ("run forest/survey.xml -o a.foo", "choose xyz"),
        ("run forest/survey.xml --correct foo -o a.xyz", "there are sum-equal-ranges"),
        ("preveiw a.laz", "similar subcommands exist: 'serve', 'preview'"),
    ] {
        let words: Vec<&str> = line.split(' ').collect();
        let done = common::run(dir.path(), &words);
        let said = text(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "vlscan {line}: {said}");
        assert!(said.contains(answer), "vlscan {line}: {said}");
    }
    // Without arguments the program shows a first step.
    let first = text(&common::run(dir.path(), &[]).stdout);
    assert!(first.contains("To begin:\n  vlscan scene make forest"), "{first}");
}

#[test]
fn examples_are_found_where_readers_see_them() {
    let page = "Text\n\n    one # a\n\n    two |\n      three\n\n* item\n    goes on\n\n```toml\n    no = 1\n```\n\n```sh\nfour\n\nfive\n```\n";
    assert_eq!(examples(page), ["one # a", "two |\n  three", "four", "five"]);
    assert_eq!(examples_of_manual(".SH EXAMPLES\n.EX\na \\-o b\n\n\\&.c\n.EE\n.SH X\n"), ["a -o b", ".c"]);
    assert_eq!(runnable("# a note\ncargo test").as_deref(), None);
    assert_eq!(runnable("cargo run --release -- run a").as_deref(), Some("vlscan run a"));
}
