//! Folders whose database is lost, damaged, older, or of another version or service: nothing is removed.

use crate::client::{Service, vlscan};
use crate::jobs::{flight, with_field};
use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

/// Takes a database back to the version before: to 3, to 2, to 1, and to none.
const BACK: [&str; 4] = [
    "ALTER TABLE jobs DROP COLUMN warnings; PRAGMA user_version = 3",
    "DROP INDEX jobs_dismissed; ALTER TABLE uploads DROP COLUMN folders; ALTER TABLE uploads DROP COLUMN missing;
     PRAGMA user_version = 2",
    "DROP INDEX jobs_stored; DROP INDEX jobs_finished; ALTER TABLE jobs DROP COLUMN disk;
     ALTER TABLE jobs DROP COLUMN texts;
     CREATE INDEX jobs_stored ON jobs (owner, bytes) WHERE folder = id AND bytes > 0; PRAGMA user_version = 1",
    "DROP TABLE service; DROP TABLE removed; PRAGMA user_version = 0",
];

/// A folder of a service with an upload and a finished run, which has ended.
struct Used {
    folder: tempfile::TempDir,
}

impl Used {
    fn new() -> Used {
        let folder = tempfile::tempdir().unwrap();
        let used = Used { folder };
        let mut service = Service::at(&used.data(), &[]);
        with_field(&service);
        let job = service.run("run", &flight(1, 1));
        assert_eq!(job["status"], "successful", "{job}");
        service.stop();
        used
    }

    fn data(&self) -> PathBuf {
        self.folder.path().join("data")
    }

    fn database(&self) -> PathBuf {
        self.data().join("service.db")
    }

    fn log(&self) -> PathBuf {
        self.data().join("service.db-wal")
    }

    /// Changes the database by SQL.
    fn change(&self, sql: &str) {
        rusqlite::Connection::open(self.database()).unwrap().execute_batch(sql).unwrap();
    }

    /// A copy of the folder.
    fn copy(&self) -> Used {
        let folder = tempfile::tempdir().unwrap();
        let done = Command::new("cp").arg("-a").arg(self.data()).arg(folder.path()).status().unwrap();
        assert!(done.success());
        Used { folder }
    }
}

fn program(words: &[&str], data: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_vlscan-serve"));
    command.args(words).arg("--data").arg(data).env_remove("VLSCAN_TOKEN").stdin(Stdio::null());
    command
}

fn check(data: &Path) -> Output {
    program(&["check"], data).output().unwrap()
}

fn text(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

/// Message of a start that refuses the folder.
fn refused(data: &Path) -> Option<String> {
    let mut command = program(&["--listen", "127.0.0.1:0"], data);
    let mut process = command.arg("--program").arg(vlscan()).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(process.stderr.take().unwrap());
    let mut said = String::new();
    while lines.read_line(&mut said).unwrap() > 0 {
        if said.contains("http://") {
            // It starts. What it removes in the background takes a moment.
            std::thread::sleep(Duration::from_millis(500));
            process.kill().unwrap();
            process.wait().unwrap();
            return None;
        }
    }
    assert!(!process.wait().unwrap().success());
    Some(said)
}

/// Contents of all files of uploads and jobs, wherever they are now.
fn kept(data: &Path) -> Vec<Vec<u8>> {
    let is_in_folder = |path: &str| path.contains('/');
    let files = files(data).into_iter().filter(|(path, _)| is_in_folder(path));
    let mut contents: Vec<Vec<u8>> = files.map(|(_, bytes)| bytes).collect();
    contents.sort();
    contents
}

fn files(data: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![data.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap().map(Result::unwrap) {
            let about = entry.metadata().unwrap();
            if about.is_dir() {
                folders.push(entry.path());
            } else if about.is_file() {
                let path = entry.path().strip_prefix(data).unwrap().display().to_string();
                found.insert(path, std::fs::read(entry.path()).unwrap());
            }
        }
    }
    found
}

#[test]
fn a_service_with_a_lost_or_damaged_database_does_not_start_and_removes_nothing() {
    let sound = Used::new();
    let bytes = std::fs::read(sound.database()).unwrap();
    let before = kept(&sound.data());
    assert!(before.len() > 3);
    let told = check(&sound.data());
    assert!(told.status.success() && text(&told).contains("sound"), "{}", text(&told));
    let write = |bytes: &[u8]| {
        let bytes = bytes.to_vec();
        move |used: &Used| std::fs::write(used.database(), &bytes).unwrap()
    };
    let third: Vec<u8> = bytes
        .iter()
        .enumerate()
        .map(|(at, byte)| if at >= 4096 && at % 3 == 0 { byte ^ 0x55 } else { *byte })
        .collect();
    type Damage = Box<dyn Fn(&Used)>;
    let damages: Vec<(&str, Damage)> = vec![
        ("missing", Box::new(|used| std::fs::remove_file(used.database()).unwrap())),
        ("missing", Box::new(write(b""))),
        ("damaged", Box::new(write(b"a text that is no database, as a full disk or an editor leaves it"))),
        ("damaged", Box::new(write(&third))),
        ("damaged", Box::new(write(&bytes[..bytes.len() / 2]))),
        ("damaged", Box::new(write(&bytes[..5000]))),
        ("damaged", Box::new(write(&vec![0; bytes.len()]))),
        ("version 99", Box::new(|used| used.change("PRAGMA user_version = 99"))),
        ("version -1", Box::new(|used| used.change("PRAGMA user_version = -1"))),
        ("columns", Box::new(|used| used.change("ALTER TABLE jobs RENAME COLUMN owner TO whose"))),
        ("columns", Box::new(|used| used.change("DROP TABLE uses"))),
        ("another service", Box::new(|used| used.change("UPDATE service SET id = 'another'"))),
        ("another service", Box::new(|used| std::fs::write(used.data().join("id"), "another").unwrap())),
    ];
    for (number, (word, damage)) in damages.iter().enumerate() {
        let used = sound.copy();
        damage(&used);
        let all = files(&used.data());
        let told = check(&used.data());
        assert!(!told.status.success(), "{number}: {}", text(&told));
        assert_eq!(files(&used.data()), all, "{number}: a check changes nothing");
        let told = refused(&used.data()).unwrap_or_else(|| panic!("{number} ({word}): it starts"));
        let found = told.contains(word)
            || (*word == "missing" && told.contains("empty"))
            || told.contains(&word.replace("version", "the version"));
        assert!(found && told.contains("help:"), "{number} ({word}): {told}");
        assert!(kept(&used.data()) == before, "{number} ({word}): files have changed");
    }
    // Without its database and id, as a folder of an earlier version is.
    let used = sound.copy();
    std::fs::remove_file(used.database()).unwrap();
    std::fs::remove_file(used.data().join("id")).unwrap();
    assert!(refused(&used.data()).is_some_and(|told| told.contains("missing")));
    assert!(kept(&used.data()) == before);
}

#[test]
fn a_damaged_page_removes_nothing() {
    let sound = Used::new();
    let bytes = std::fs::read(sound.database()).unwrap();
    let before = kept(&sound.data());
    for page in 0..bytes.len() / 4096 {
        let used = sound.copy();
        let mut damaged = bytes.clone();
        damaged[page * 4096..(page + 1) * 4096].fill(0);
        std::fs::write(used.database(), damaged).unwrap();
        refused(&used.data());
        assert!(kept(&used.data()) == before, "page {page}");
    }
}

#[test]
fn what_an_older_database_does_not_list_is_kept_and_found_again() {
    let used = Used::new();
    let backup = std::fs::read(used.database()).unwrap();
    let mut service = Service::at(&used.data(), &[]);
    assert_eq!(service.upload("new", &[("a.obj", b"v 1 2 3".to_vec())]).status, 201);
    let job = service.run("run", &flight(2, 1));
    let id = job["jobID"].as_str().unwrap().to_owned();
    let points = service.get(&format!("/jobs/{id}/results/points.laz")).body;
    service.stop();
    let newest = std::fs::read(used.database()).unwrap();
    let before = kept(&used.data());
    std::fs::write(used.database(), backup).unwrap();
    let told = check(&used.data());
    assert!(!told.status.success() && text(&told).contains(&id), "{}", text(&told));
    let mut service = Service::at(&used.data(), &[]);
    assert_eq!(service.json("/uploads")["uploads"].as_array().unwrap().len(), 1);
    service.stop();
    assert!(kept(&used.data()) == before, "nothing is removed");
    assert!(used.data().join("lost/jobs").join(&id).is_dir());
    // As the message says: restore the newest database, move the folders back.
    std::fs::write(used.database(), newest).unwrap();
    for kind in ["uploads", "jobs"] {
        for entry in std::fs::read_dir(used.data().join("lost").join(kind)).unwrap().flatten() {
            std::fs::rename(entry.path(), used.data().join(kind).join(entry.file_name())).unwrap();
        }
    }
    assert!(check(&used.data()).status.success(), "{}", text(&check(&used.data())));
    let mut service = Service::at(&used.data(), &[]);
    assert!(service.get(&format!("/jobs/{id}/results/points.laz")).body == points);
    assert_eq!(service.get("/uploads/new").status, 200);
    service.stop();
}

#[test]
fn a_database_without_a_version_is_migrated_after_a_copy() {
    let used = Used::new();
    BACK.iter().for_each(|step| used.change(step));
    std::fs::remove_file(used.data().join("id")).unwrap();
    let before = kept(&used.data());
    let mut service = Service::at(&used.data(), &[]);
    assert_eq!(service.get("/uploads/field").status, 200);
    assert_eq!(service.json("/jobs")["jobs"][0]["status"], "successful");
    service.stop();
    assert!(kept(&used.data()) == before);
    assert!(used.data().join("service.db-version-0").is_file() && used.data().join("id").is_file());
    assert!(check(&used.data()).status.success());
}

#[test]
fn an_interrupted_removal_is_completed_and_not_taken_for_a_loss() {
    let used = Used::new();
    let uploads = std::fs::read_dir(used.data().join("uploads")).unwrap().flatten().next().unwrap();
    let id = uploads.file_name().into_string().unwrap();
    used.change(&format!(
        "DELETE FROM uploads WHERE id = '{id}'; INSERT INTO removed (kind, id) VALUES ('uploads', '{id}')"
    ));
    let told = check(&used.data());
    assert!(told.status.success() && text(&told).contains("completes 1 interrupted"), "{}", text(&told));
    let mut service = Service::at(&used.data(), &[]);
    service.stop();
    assert!(!uploads.path().exists() && !used.data().join("lost").exists());
}

#[test]
fn incomplete_files_go_and_what_others_have_put_among_them_is_kept() {
    let used = Used::new();
    let data = used.data();
    let write = |path: &str, text: &str| {
        std::fs::create_dir_all(data.join(path).parent().unwrap()).unwrap();
        std::fs::write(data.join(path), text).unwrap();
    };
    let incomplete = [
        "incoming/.tmpAb12Cd/a.obj",
        "incoming/0123456789abcdef/out/a.laz",
        ".tmpXy34Zw",
        "patterns/.tmpAAAAAA/pattern.svg",
    ];
    incomplete.iter().for_each(|path| write(path, "1764372000000 -\n"));
    let others = [
        "incoming/photos/2025/a.jpg",
        "incoming/.tmp",
        "incoming/notes.txt",
        ".tmpOthers",
        "patterns/.tmpBBBBBB/a",
    ];
    others.iter().for_each(|path| write(path, path));
    let told = check(&data);
    assert!(!told.status.success() && text(&told).contains("removes 4 incomplete files"), "{}", text(&told));
    assert!(text(&told).contains("photos"), "{}", text(&told));
    let mut service = Service::at(&data, &[]);
    service.stop();
    for path in incomplete {
        assert!(!data.join(path).exists(), "{path}");
    }
    for path in others {
        let kept = if path.starts_with("incoming/") { data.join("lost").join(path) } else { data.join(path) };
        assert_eq!(std::fs::read_to_string(kept).unwrap(), path);
    }
    assert_eq!(std::fs::read_dir(data.join("incoming")).unwrap().count(), 0);
    let told = check(&data);
    assert!(told.status.success() && text(&told).contains("3 in lost/incoming"), "{}", text(&told));
}

#[test]
fn a_copy_before_a_migration_is_whole() {
    let used = Used::new();
    used.change(BACK[0]);
    // As a service leaves it that was killed while it made the copy.
    std::fs::write(used.data().join("service.db-part"), "a part").unwrap();
    let mut service = Service::at(&used.data(), &[]);
    service.stop();
    let copy = used.data().join("service.db-version-3");
    let jobs = rusqlite::Connection::open(copy).unwrap();
    let jobs: i64 = jobs.query_row("SELECT count(*) FROM jobs", [], |row| row.get(0)).unwrap();
    assert!(jobs == 1 && !used.data().join("service.db-part").exists());
}

/// A folder whose service was killed: the log has what the database lacks.
fn killed() -> Used {
    let used = Used::new();
    let mut service = Service::at(&used.data(), &[]);
    assert_eq!(service.upload("new", &[("a.obj", b"v 1 2 3".to_vec())]).status, 201);
    service.kill();
    assert!(std::fs::metadata(used.log()).unwrap().len() > 0);
    used
}

#[test]
fn a_log_without_its_database_is_kept() {
    let sound = killed();
    for is_empty in [false, true] {
        let used = sound.copy();
        let moved = used.data().join("moved.db");
        std::fs::rename(used.database(), &moved).unwrap();
        if is_empty {
            std::fs::write(used.database(), "").unwrap();
        }
        let all = files(&used.data());
        assert!(!check(&used.data()).status.success());
        let told = refused(&used.data()).expect("it starts");
        assert!(told.contains("missing or empty") && told.contains("service.db-wal"), "{told}");
        assert_eq!(files(&used.data()), all);
        std::fs::rename(&moved, used.database()).unwrap();
        let mut service = Service::at(&used.data(), &[]);
        assert_eq!(service.get("/uploads/new").status, 200, "the log had it");
        service.stop();
    }
}

#[test]
fn an_older_database_beside_a_newer_log_loses_no_files() {
    let used = Used::new();
    let yesterday = std::fs::read(used.database()).unwrap();
    // The database takes the first uploads at the end of the service, and the log has the others.
    for day in 0..2 {
        let mut service = Service::at(&used.data(), &[]);
        for number in 0..30 {
            let name = format!("new{day}-{number}");
            assert_eq!(service.upload(&name, &[("a.obj", b"v 1 2 3".to_vec())]).status, 201);
        }
        if day == 0 { service.stop() } else { service.kill() }
    }
    let before = kept(&used.data());
    std::fs::write(used.database(), yesterday).unwrap();
    if let Some(told) = refused(&used.data()) {
        assert!(told.contains("help:") && told.contains("service.db-wal"), "{told}");
    }
    assert!(kept(&used.data()) == before, "nothing is removed");
    let _ = std::fs::remove_file(used.log());
    let mut service = Service::at(&used.data(), &[]);
    assert_eq!(service.get("/uploads/field").status, 200);
    service.stop();
    assert!(kept(&used.data()) == before, "nothing is removed");
}

#[test]
fn a_database_that_is_refused_is_not_migrated() {
    let used = Used::new();
    used.change(BACK[0]);
    for (word, sql, undo) in [
        (
            "columns",
            "ALTER TABLE jobs RENAME COLUMN progress TO percent",
            "ALTER TABLE jobs RENAME COLUMN percent TO progress",
        ),
        ("another service", "UPDATE service SET id = id || 'x'", "UPDATE service SET id = rtrim(id, 'x')"),
    ] {
        used.change(sql);
        let told = refused(&used.data()).expect("it starts");
        assert!(told.contains(word), "{told}");
        let database = rusqlite::Connection::open(used.database()).unwrap();
        let version: i64 = database.query_row("PRAGMA user_version", [], |row| row.get(0)).unwrap();
        assert_eq!(version, 3, "{word}");
        used.change(undo);
    }
    assert!(refused(&used.data()).is_none());
}

#[test]
fn a_check_needs_the_folder_for_itself() {
    let service = Service::start(&["--workers", "0"]);
    let told = check(&service.data);
    assert_eq!(told.status.code(), Some(2));
    assert!(text(&told).contains("stop it first"), "{}", text(&told));
    assert_eq!(check(Path::new("/absent/folder")).status.code(), Some(2));
}
