//! Tests of the store of a campaign.

use super::super::{Cells, File as CampaignFile, FileRecord, checksum};
use super::*;

fn cell() -> Cell {
    let text =
        "out = \"o\"\n[[scene]]\nname = \"s\"\nfile = \"x\"\n[[variant]]\nname = \"v\"\nplan = \"p\"\n";
    let file: CampaignFile = toml::from_str(text).unwrap();
    Cells::of(&file).unwrap().0.remove(0)
}

fn open(folder: &Path) -> Result<Store> {
    Store::create(folder, false, false)
}

/// Completes a cell with one file.
fn complete(store: &Store, cell: &Cell, text: &str) -> Result<Record> {
    let lock = store.lock(cell)?.unwrap();
    let path = lock.work.join("out/points.laz");
    fs::write(&path, text).unwrap();
    let mut record = Record { cell: cell.name.clone(), ..Record::default() };
    record.files.push(FileRecord {
        path: format!("cells/{}/points.laz", cell.name),
        records: 1,
        bytes: text.len() as u64,
        sum: checksum(&path)?,
    });
    store.complete(cell, lock, &record).map(|()| record)
}

#[test]
fn cells_are_complete_or_absent_and_one_process_has_them() {
    let dir = tempfile::tempdir().unwrap();
    let (store, cell) = (open(dir.path()).unwrap(), cell());
    let record = Record { cell: cell.name.clone(), ..Record::default() };
    let outcome = || store.outcome(&cell, &record, &mut Inputs::default());
    assert!(matches!(outcome(), Outcome::Absent(None)));
    let lock = store.lock(&cell).unwrap().unwrap();
    assert!(store.lock(&cell).unwrap().is_none());
    fs::write(lock.work.join("out/points.laz"), "unfinished").unwrap();
    std::mem::forget(lock);
    // The remains of a killed process are removed; its lock ends with it.
    fs::remove_file(store.hidden(&format!("{}.lock", cell.name))).unwrap();
    let lock = store.lock(&cell).unwrap().unwrap();
    assert!(!lock.work.join("out/points.laz").exists());
    let failed = Record { error: Some("no".to_owned()), ..record.clone() };
    store.fail(&cell, lock, &failed).unwrap();
    assert!(matches!(outcome(), Outcome::Failed(found) if found.error.as_deref() == Some("no")));
    complete(&store, &cell, "all").unwrap();
    assert!(matches!(outcome(), Outcome::Complete(_)));
    assert_eq!(fs::read(store.cell(&cell).join("points.laz")).unwrap(), b"all");
    assert!(!store.work(&cell).exists());
}

#[test]
fn damage_of_any_file_is_noticed_and_repaired() {
    let dir = tempfile::tempdir().unwrap();
    let (store, cell) = (open(dir.path()).unwrap(), cell());
    let wanted = Record { cell: cell.name.clone(), ..Record::default() };
    let outcome = |store: &Store| store.outcome(&cell, &wanted, &mut Inputs::default());
    let points = store.cell(&cell).join("points.laz");
    let damages: [(&str, &dyn Fn()); 6] = [
        ("has 0 bytes", &|| fs::write(&points, "").unwrap()),
        ("checksum", &|| fs::write(&points, "aLl").unwrap()),
        ("missing", &|| fs::remove_file(&points).unwrap()),
        ("record.json", &|| fs::write(store.cell(&cell).join(RECORD), "{}").unwrap()),
        ("record.json", &|| fs::remove_file(store.cell(&cell).join(RECORD)).unwrap()),
        ("", &|| {
            fs::remove_file(&points).unwrap();
            fs::remove_file(store.cell(&cell).join(RECORD)).unwrap();
            fs::remove_dir(store.cell(&cell)).unwrap();
        }),
    ];
    for (reason, damage) in damages {
        complete(&store, &cell, "all").unwrap();
        assert!(matches!(outcome(&store), Outcome::Complete(_)));
        damage();
        match outcome(&store) {
            Outcome::Absent(found) => assert!(found.unwrap_or_default().contains(reason), "{reason}"),
            other => panic!("{reason}: {other:?}"),
        }
    }
    // Times alone do not count, and are noted.
    complete(&store, &cell, "all").unwrap();
    fs::write(&points, "all").unwrap();
    fs::remove_file(store.made_path(&cell)).unwrap();
    assert!(matches!(outcome(&store), Outcome::Complete(_)));
    assert!(Made::read(&store.made_path(&cell)).is_some());
    // Damage that keeps size and times is seen by checksums only.
    let record = store.record_in(&store.cell(&cell).join(RECORD), &cell).unwrap();
    fs::write(&points, "aLl").unwrap();
    store.note_made(&cell, &record).unwrap();
    assert!(matches!(outcome(&store), Outcome::Complete(_)));
    let verifying = Store::create(dir.path(), false, true).unwrap();
    assert!(matches!(outcome(&verifying), Outcome::Absent(Some(_))));
}

#[test]
fn files_of_others_are_never_removed() {
    let dir = tempfile::tempdir().unwrap();
    let (store, cell) = (open(dir.path()).unwrap(), cell());
    let wanted = Record { cell: cell.name.clone(), version: "2".to_owned(), ..Record::default() };
    let mine = store.cell(&cell).join("thesis/chapter.txt");
    let is_obstructed = || match store.outcome(&cell, &wanted, &mut Inputs::default()) {
        Outcome::Obstructed(reason) => reason,
        other => panic!("{other:?}"),
    };
    fs::create_dir_all(mine.parent().unwrap()).unwrap();
    fs::write(&mine, "precious").unwrap();
    assert!(is_obstructed().contains("chapter.txt"));
    assert!(complete(&store, &cell, "all").is_err());
    fs::remove_dir_all(store.cell(&cell)).unwrap();
    complete(&store, &cell, "all").unwrap();
    fs::create_dir_all(mine.parent().unwrap()).unwrap();
    fs::write(&mine, "precious").unwrap();
    assert!(is_obstructed().contains("chapter.txt"));
    assert!(complete(&store, &cell, "new").is_err());
    let failed = store.fail(&cell, store.lock(&cell).unwrap().unwrap(), &wanted);
    assert!(failed.is_err() && !store.failed_path(&cell).exists());
    assert_eq!(fs::read(&mine).unwrap(), b"precious");
    assert_eq!(fs::read(store.cell(&cell).join("points.laz")).unwrap(), b"all");
    // Neither in the place of unfinished files,
    let theirs = store.work(&cell).join("notes.txt");
    fs::create_dir(store.work(&cell)).unwrap();
    fs::write(&theirs, "precious").unwrap();
    assert!(store.lock(&cell).is_err() && is_obstructed().contains(".work"));
    assert_eq!(fs::read(&theirs).unwrap(), b"precious");
    // nor in that of a whole data set.
    for name in [".campaign/notes.txt", "manifest.jsonl", "times.jsonl", "cells"] {
        let other = tempfile::tempdir().unwrap();
        let path = other.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, "precious").unwrap();
        assert!(open(other.path()).is_err(), "{name}");
        assert_eq!(fs::read(&path).unwrap(), b"precious");
    }
    // A mark does not make a manifest of the user one of the campaign.
    let other = tempfile::tempdir().unwrap();
    open(other.path()).unwrap();
    let manifest = other.path().join("manifest.jsonl");
    fs::write(&manifest, "precious").unwrap();
    assert!(open(other.path()).unwrap_err().to_string().contains("no campaign has written"));
    assert_eq!(fs::read(&manifest).unwrap(), b"precious");
}

#[test]
fn processes_that_begin_at_the_same_time_share_a_folder() {
    let dir = tempfile::tempdir().unwrap();
    // Another process is writing the mark.
    fs::create_dir(dir.path().join(".campaign")).unwrap();
    fs::write(dir.path().join(".campaign/vlscan-campaign.json.vlscan-0123abcd.part"), "{").unwrap();
    assert!(open(dir.path()).is_ok());
    for _ in 0..50 {
        let dir = tempfile::tempdir().unwrap();
        let refused = std::thread::scope(|scope| {
            let started = [(); 4].map(|()| scope.spawn(|| open(dir.path()).err()));
            started.map(|thread| thread.join().unwrap())
        });
        assert!(refused.iter().all(Option::is_none), "{refused:?}");
    }
}

#[test]
fn manifests_are_known_by_any_line_of_a_cell() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("manifest.jsonl");
    let line = Record { cell: "a".to_owned(), ..Record::default() }.line().unwrap();
    let damaged = line.replacen("\"seed\":0", "\"seed\":4", 1);
    assert!(damaged != line && Record::parse(damaged.as_bytes()).is_none());
    for (text, is_known) in [
        (line.as_str(), true),
        (&damaged, true),
        (&format!("{{\n{line}"), true),
        ("{\"cell\":\"a\",\"seconds\":1.0,\"threads\":2}\n", true),
        ("", false),
        ("{\"cell\":\"a\"}\n", false),
        ("precious\n", false),
    ] {
        fs::write(&path, text).unwrap();
        assert_eq!(is_of_cells(&path), is_known, "{text}");
    }
}

#[test]
fn what_an_ended_removal_of_unfinished_files_leaves_is_known() {
    let dir = tempfile::tempdir().unwrap();
    let (store, cell) = (open(dir.path()).unwrap(), cell());
    let lock = store.lock(&cell).unwrap().unwrap();
    let work = lock.work.clone();
    fs::create_dir(work.join("scene")).unwrap();
    for name in ["a", "scene/a", "out/a", "zzz"] {
        fs::write(work.join(name), "unfinished").unwrap();
    }
    drop(lock);
    assert!(!work.exists());
    // The mark is removed after all other files, and then the folder.
    for left in [&[WORK_MARK, "a"][..], &[WORK_MARK], &[]] {
        fs::create_dir(&work).unwrap();
        left.iter().for_each(|name| fs::write(work.join(name), "").unwrap());
        assert!(store.lock(&cell).unwrap().is_some(), "{left:?}");
        assert!(!work.exists());
    }
}

#[test]
fn a_failure_that_is_not_kept_is_computed_by_the_next_start() {
    let dir = tempfile::tempdir().unwrap();
    let (store, cell) = (open(dir.path()).unwrap(), cell());
    let record = Record { cell: cell.name.clone(), ..Record::default() };
    let outcome = || store.outcome(&cell, &record, &mut Inputs::default());
    store.fail(&cell, store.lock(&cell).unwrap().unwrap(), &record).unwrap();
    assert!(matches!(outcome(), Outcome::Failed(_)));
    store.forget(&cell, store.lock(&cell).unwrap().unwrap()).unwrap();
    assert!(matches!(outcome(), Outcome::Absent(None)) && !store.work(&cell).exists());
}

#[test]
fn without_locks_only_processes_with_cells_of_their_own_compute() {
    let dir = tempfile::tempdir().unwrap();
    let attempt = || Err(TryLockError::Error(std::io::Error::from_raw_os_error(95)));
    let shared = open(dir.path()).unwrap();
    match shared.is_locked(attempt()) {
        Err(Error::Input(problems)) => assert!(problems.text().contains("use --task K/N")),
        other => panic!("{other:?}"),
    }
    assert!(!shared.is_locked(Err(TryLockError::WouldBlock)).unwrap());
    assert!(Store::create(dir.path(), true, false).unwrap().is_locked(attempt()).unwrap());
}
