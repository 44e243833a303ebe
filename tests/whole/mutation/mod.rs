//! Twenty changes to each attribute, key and column of surveys, pipelines and tables: each is an error with
//! its place, a warning, a change of the points that the value asks for, or a row of the table "Silent by
//! nature" of docs/dev/values.md.

mod changes;
mod subjects;

use crate::common::text;
use changes::{Change, Effect, Place, changes};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};
use subjects::Subject;

/// A changed run that takes longer than this, and than five times the unchanged one, is ended: the change
/// asked for more pulses.
const LIMIT: Duration = Duration::from_secs(4);

/// The result of one run.
enum Outcome {
    Refused {
        messages: String,
    },
    Done {
        bytes: u64,
        warnings: BTreeSet<String>,
    },
    /// Ended before its time.
    Long {
        warnings: BTreeSet<String>,
    },
}

/// Limit of an unchanged run.
const PLAIN_LIMIT: Duration = Duration::from_secs(60);

/// Runs `vlscan` in `folder` for up to `limit`; its output is hashed and removed.
fn outcome(folder: &Path, args: &[String], limit: Duration) -> Outcome {
    let out = folder.join("out");
    let _ = std::fs::remove_dir_all(&out);
    std::fs::create_dir_all(&out).expect("a folder");
    let messages = std::fs::File::create(folder.join("messages")).expect("a file");
    let points = std::fs::File::create(folder.join("points")).expect("a file");
    let mut child = Command::new(env!("CARGO_BIN_EXE_vlscan"))
        .args(args)
        .current_dir(folder)
        .stdin(Stdio::null())
        .stdout(points)
        .stderr(messages)
        .spawn()
        .expect("the program starts");
    let begin = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().expect("the program ends") {
            break status;
        }
        if begin.elapsed() > limit {
            child.kill().expect("the program ends");
            child.wait().expect("the program ends");
            let messages = text(&std::fs::read(folder.join("messages")).expect("messages"));
            return Outcome::Long { warnings: warnings(&messages) };
        }
        std::thread::sleep(Duration::from_millis(4));
    };
    let messages = text(&std::fs::read(folder.join("messages")).expect("messages"));
    if !status.success() {
        return Outcome::Refused { messages };
    }
    let mut digest = xxhash_rust::xxh3::Xxh3::new();
    let points = std::fs::read(folder.join("points")).expect("points");
    // The name of a folder of results is a time.
    let is_result = |line: &&[u8]| !line.starts_with(b"Output directory");
    points.split_inclusive(|byte| *byte == b'\n').filter(is_result).for_each(|line| digest.update(line));
    for file in crate::common::files(&out) {
        let bytes = std::fs::read(out.join(&file)).expect("an output");
        digest.update(file.file_name().expect("a name").as_encoded_bytes());
        digest.update(&bytes);
    }
    Outcome::Done { bytes: digest.digest(), warnings: warnings(&messages) }
}

/// The warnings and notes among messages, without the places in files, which changes move.
fn warnings(messages: &str) -> BTreeSet<String> {
    let begins = |line: &&str| line.starts_with("warning") || line.starts_with("note");
    messages.lines().filter(begins).map(str::to_owned).collect()
}

/// True if an error names a file and a line, the option that is at fault, or what was typed.
fn has_place(messages: &str, value: &str) -> bool {
    let quoted = [format!("`{value}`"), format!("\"{value}\"")];
    let names_value = |line: &str| {
        let is_named = quoted.iter().any(|quoted| line.contains(quoted.as_str()));
        line.starts_with("error")
            && !value.is_empty()
            && (is_named || value.len() > 2 && line.contains(value))
    };
    messages.lines().any(|line| {
        names_value(line)
            || line.contains("-->")
            || line.contains("--")
            || line.split(':').any(|w| w.trim().parse::<u32>().is_ok())
    })
}

/// A changed input that has no consequence which the user would notice.
struct Silent {
    label: String,
    change: &'static str,
    what: String,
}

/// Reports what is wrong with a changed run, if anything.
fn judge(plain: (u64, &BTreeSet<String>), change: &Change, changed: &Outcome) -> Option<String> {
    match changed {
        Outcome::Long { warnings } => {
            let is_told = warnings.difference(plain.1).next().is_some();
            (change.effect != Effect::Value && !is_told).then(|| "a longer run in silence".to_owned())
        }
        Outcome::Refused { messages } if messages.contains("panicked") => Some(format!("panic: {messages}")),
        Outcome::Refused { messages } if !has_place(messages, &change.value) => {
            Some(format!("no place: {}", messages.trim()))
        }
        Outcome::Refused { .. } => None,
        Outcome::Done { bytes, warnings } => {
            if warnings.difference(plain.1).next().is_some() {
                return None;
            }
            let is_same = *bytes == plain.0;
            match change.effect {
                Effect::None => (!is_same).then(|| "other points in silence".to_owned()),
                Effect::Value if is_same => Some("no effect".to_owned()),
                Effect::Value => None,
                Effect::Message if is_same => Some("ignored".to_owned()),
                Effect::Message => Some("other points in silence".to_owned()),
            }
        }
    }
}

/// The table "Silent by nature" of docs/dev/values.md: for each label the changes that have no message.
fn documented() -> BTreeMap<String, BTreeSet<String>> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/dev/values.md");
    let page = std::fs::read_to_string(path).expect("docs/dev/values.md");
    let table = page.split("## Silent by nature").nth(1).expect("the section `Silent by nature`");
    let mut all = BTreeMap::<String, BTreeSet<String>>::new();
    for row in table.lines().filter(|line| line.starts_with("| `")) {
        let cells: Vec<&str> = row.trim_matches('|').split('|').map(str::trim).collect();
        let [labels, changes, _] = cells[..] else { panic!("three cells: {row}") };
        for label in labels.split(", ") {
            let of = all.entry(label.trim_matches('`').to_owned()).or_default();
            of.extend(changes.split(", ").map(str::to_owned));
        }
    }
    all
}

/// Some values of a file of a subject, which no subject before it has.
struct Attack<'a> {
    subject: &'a Subject,
    file: &'a str,
    content: &'a str,
    places: Vec<Place>,
}

/// Values of one attack, so that threads share a subject of many.
const PLACES: usize = 8;

/// Assigns each value to the first subject that has it.
fn assign(subjects: &[Subject]) -> Vec<Attack<'_>> {
    let (mut tried, mut all) = (BTreeSet::new(), Vec::new());
    for subject in subjects {
        for (file, content) in subject.changed_files() {
            let mut places = subject.places(file, content).into_iter();
            let mut is_new = |place: &Place| tried.insert(place.label.clone());
            loop {
                let places: Vec<Place> = places.by_ref().filter(|place| is_new(place)).take(PLACES).collect();
                if places.is_empty() {
                    break;
                }
                all.push(Attack { subject, file, content, places });
            }
        }
    }
    all
}

impl Attack<'_> {
    /// Tries all changes in a copy of the subject; returns what is silent, and the number of changes.
    fn run(&self) -> (Vec<Silent>, usize) {
        let folder = crate::common::folder();
        self.subject.copy_to(folder.path());
        let begin = Instant::now();
        let plain = outcome(folder.path(), &self.subject.args, PLAIN_LIMIT);
        let limit = LIMIT.max(5 * begin.elapsed());
        let (bytes, warnings) = match plain {
            Outcome::Done { bytes, warnings } => (bytes, warnings),
            Outcome::Refused { messages } => panic!("{} fails by itself: {messages}", self.subject.name),
            Outcome::Long { .. } => panic!("{} takes too long", self.subject.name),
        };
        let (mut silent, mut count) = (Vec::new(), 0);
        for place in &self.places {
            for change in sampled(&place.label, changes(place, self.content)) {
                std::fs::write(folder.path().join(self.file), &change.content).expect("a file");
                let changed = outcome(folder.path(), &self.subject.args, limit);
                count += 1;
                if let Some(what) = judge((bytes, &warnings), &change, &changed) {
                    silent.push(Silent { label: place.label.clone(), change: change.name, what });
                }
            }
        }
        (silent, count)
    }
}

/// Of this many changes of a value one is tried, unless `VLSCAN_ALL_CASES` is set, as it is every week.
const SAMPLING: usize = 4;

/// Of this many changes one is tried.
fn sampling() -> usize {
    if std::env::var_os("VLSCAN_ALL_CASES").is_some() { 1 } else { SAMPLING }
}

/// The changes of a value that are tried, the same ones in every run; values differ in where they begin.
fn sampled(label: &str, changes: Vec<Change>) -> impl Iterator<Item = Change> {
    let step = sampling();
    assert!(changes.len() >= step, "{label}: none of {} changes may be tried", changes.len());
    let first = label.bytes().map(usize::from).sum::<usize>() % step;
    changes.into_iter().skip(first).step_by(step)
}

/// Tries the changes to all subjects on two threads.
fn attack_all(subjects: &[Subject]) -> (Vec<Silent>, usize) {
    let attacks = assign(subjects);
    let next = AtomicUsize::new(0);
    let all = Mutex::new((Vec::new(), 0));
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                while let Some(attack) = attacks.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let (silent, count) = attack.run();
                    let mut all = all.lock().unwrap();
                    all.0.extend(silent);
                    all.1 += count;
                }
            });
        }
    });
    all.into_inner().unwrap()
}

#[test]
#[ignore = "takes minutes"]
fn no_change_of_an_input_is_silent_unless_documented() {
    let subjects = subjects::all();
    let (silent, count) = attack_all(&subjects);
    let documented = documented();
    let is_documented = |silent: &Silent| {
        let of = |label: &str| documented.get(label).is_some_and(|changes| changes.contains(silent.change));
        // A row may name an attribute of every element, and the headings of every table.
        of(&silent.label)
            || silent.label.split_once('@').is_some_and(|(_, name)| of(&format!("@{name}")))
            || silent.label.contains(":heading ") && of("heading")
    };
    let mut rows = BTreeMap::<(&str, &str), Vec<&str>>::new();
    for silent in silent.iter().filter(|silent| !is_documented(silent)) {
        rows.entry((&silent.label, &silent.what)).or_default().push(silent.change);
    }
    let list: Vec<String> =
        rows.iter().map(|((label, what), names)| format!("{label}: {what}: {}", names.join(", "))).collect();
    assert!(list.is_empty(), "of {count} changes, silent:\n{}", list.join("\n"));
    assert!(count > 3000 / sampling(), "only {count} changes were tried");
}
