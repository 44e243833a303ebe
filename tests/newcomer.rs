//! A newcomer's hour: whatever the README, `docs/`, the manual pages and `pipelines/` show works as it stands there, copied
//! into an empty folder. Examples that need a program that is not here are skipped by name.

mod common;

use common::{folder, text};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// Programs that examples may need and that not everybody has.
const OTHERS: [&str; 9] =
    ["pdal", "parallel", "pv", "laszip", "polars", "duckdb", "CloudCompare", "man", "gzip"];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// A folder with what the examples of a page are told to find, and the path on which they find the program.
struct Desk {
    folder: tempfile::TempDir,
    programs: tempfile::TempDir,
}

impl Desk {
    fn new() -> Desk {
        let desk = Desk { folder: folder(), programs: folder() };
        std::os::unix::fs::symlink(env!("CARGO_BIN_EXE_vlscan"), desk.programs.path().join("vlscan"))
            .unwrap();
        desk
    }

    fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Copies a file or folder of the project.
    fn lay(&self, from: &str, to: &str) -> &Desk {
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

    /// Runs examples one after the other as a newcomer would; all must succeed. Returns how many ran.
    fn follow(&self, page: &str, examples: &[String]) -> usize {
        let mut ran = 0;
        for example in examples {
            let missing = OTHERS.iter().find(|name| mentions(example, name) && !is_here(name));
            if let Some(name) = missing {
                println!("skipped: no {name} for this example of {page}:\n{example}");
                continue;
            }
            let Some(script) = runnable(example) else { continue };
            let done = self.bash(&script);
            assert!(
                done.status.success(),
                "an example of {page} fails ({}):\n{example}\n--- it says:\n{}{}",
                done.status,
                text(&done.stdout),
                text(&done.stderr)
            );
            assert!(!text(&done.stderr).contains("warning"), "{page}:\n{example}\n{}", text(&done.stderr));
            ran += 1;
        }
        ran
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

fn is_here(program: &str) -> bool {
    let found =
        Command::new("sh").args(["-c", &format!("command -v {program}")]).stdout(Stdio::null()).status();
    found.is_ok_and(|status| status.success())
}

/// The example with the program that is tested in place of one that cargo would build first; none for what only cargo
/// does.
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

/// Shell examples of a page of Markdown: indented blocks and those fenced as `sh`, parted at empty lines.
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
            // A block of code stands apart; what is indented right below text continues a list.
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
fn the_readme_is_true() {
    let page = fs::read_to_string(root().join("README.md")).unwrap();
    let desk = Desk::new();
    desk.lay("fixtures", "fixtures").lay("pipelines", "pipelines").lay("man", "man");
    // The survey of somebody who comes from HELIOS++.
    desk.lay("fixtures/room", "my_assets").lay("fixtures/room/survey.xml", "survey.xml");
    let ran = desk.follow("README.md", &examples(&page));
    assert!(ran >= 8, "{ran} examples");
    for link in page.split("](").skip(1).map(|rest| rest.split_once(')').unwrap().0) {
        let there = link.starts_with("https://") || root().join(link.split('#').next().unwrap()).exists();
        assert!(there, "README.md leads to {link}");
    }
}

/// Pages whose commands measure speed.
const MEASUREMENTS: [&str; 3] = ["experiment.md", "kernel.md", "speed.md"];

#[test]
fn the_pages_in_docs_are_true() {
    let mut pages: Vec<PathBuf> =
        fs::read_dir(root().join("docs")).unwrap().map(|e| e.unwrap().path()).collect();
    pages.retain(|path| path.extension().is_some_and(|e| e == "md"));
    pages.sort();
    assert!(pages.len() >= 2);
    for path in pages {
        let page = fs::read_to_string(&path).unwrap();
        if MEASUREMENTS.iter().any(|name| path.ends_with(name)) {
            println!("skipped: {} measures for minutes", path.display());
            continue;
        }
        let desk = Desk::new();
        desk.lay("fixtures", "fixtures").lay("pipelines", "pipelines");
        desk.lay("fixtures/room", "my_assets").lay("fixtures/room/survey.xml", "data/surveys/my_survey.xml");
        // The first file that a page shows is the one that its commands run.
        if let Some((_, rest)) = page.split_once("```toml\n") {
            let file = rest.split_once("```").unwrap().0;
            fs::write(desk.path().join("my_instrument.toml"), file).unwrap();
        }
        desk.follow(&path.display().to_string(), &examples(&page));
    }
}

#[test]
fn the_examples_of_the_manual_run_in_an_empty_folder() {
    let mut pages: Vec<PathBuf> =
        fs::read_dir(root().join("man")).unwrap().map(|e| e.unwrap().path()).collect();
    pages.sort();
    for path in pages {
        let examples = examples_of_manual(&fs::read_to_string(&path).unwrap());
        assert!(!examples.is_empty(), "{} has no examples", path.display());
        Desk::new().follow(&path.display().to_string(), &examples);
    }
}

#[test]
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
        let desk = Desk::new();
        let done = common::feed(desk.path(), &["run", path.to_str().unwrap(), "--strict"], flight.as_bytes());
        assert!(done.status.success(), "{name}: {}", text(&done.stderr));
        let keys: toml::Table = page.parse().unwrap();
        let outputs = keys["output"].as_array().unwrap();
        for output in outputs.iter().map(|output| output["path"].as_str().unwrap()) {
            let bytes = match output {
                "-" => done.stdout.len() as u64,
                file if desk.path().join(file).is_dir() => {
                    fs::read_dir(desk.path().join(file)).unwrap().count() as u64 * 1000
                }
                file => fs::metadata(desk.path().join(file))
                    .unwrap_or_else(|e| panic!("{name}: {file}: {e}"))
                    .len(),
            };
            assert!(bytes > 1000, "{name}: {output} has {bytes} bytes");
        }
    }
}

#[test]
fn a_dataset_is_made_by_as_many_processes_as_there_are_cores() {
    if !is_here("parallel") {
        println!("skipped: no parallel (GNU) for pipelines/dataset.sh");
        return;
    }
    let desk = Desk::new();
    let make = |command: &str| {
        let done = desk.bash(&format!("{}/pipelines/{command}", root().display()));
        assert!(done.status.success(), "{command}: {}", text(&done.stderr));
        text(&done.stdout)
    };
    assert_eq!(make("dataset.sh all 3").trim(), "3");
    assert_eq!(make("dataset.sh again 2").trim(), "2");
    let scene = |path: &str| fs::read(desk.path().join(path)).unwrap();
    assert!(scene("all/forest2.laz") == scene("again/forest2.laz"), "the same seed, other bytes");
    assert!(scene("all/forest1.laz") != scene("all/forest2.laz"), "another seed, the same bytes");
    assert!(scene("all/forest1.laz").starts_with(b"LASF"));
    // An interrupted run goes on where it was.
    fs::remove_file(desk.path().join("again/forest1.laz")).unwrap();
    make("dataset.sh again 3");
    assert!(
        scene("all/forest1.laz") == scene("again/forest1.laz") && scene("again/forest3.laz").len() > 10_000
    );
}

#[test]
fn slips_are_answered_with_what_to_do() {
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
        ("scene info forest", "name ./forest/survey.xml"),
        ("preview forest/survey.xml -o a.png", "vlscan run forest/survey.xml -o points.laz"),
        ("preview forest -o a.png", "name a file of points"),
        ("preview none.laz -o a.png", "there is no such file"),
        ("preview none.laz -o a.gif", ".png or .html"),
        ("run forest/survey.xml -o a.foo", "choose xyz"),
        ("run forest/survey.xml --correct foo -o a.xyz", "there are sum-equal-ranges"),
        ("preveiw a.laz", "similar subcommand exists: 'preview'"),
    ] {
        let words: Vec<&str> = line.split(' ').collect();
        let done = common::run(dir.path(), &words);
        let said = text(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "vlscan {line}: {said}");
        assert!(said.contains(answer), "vlscan {line}: {said}");
    }
    // Nobody who asks for nothing is left without a first step.
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
