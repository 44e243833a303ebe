//! Tests of the writer of files.

use super::testkit::names;
use super::*;
use std::fs;
use std::io::{Seek, SeekFrom, Write};
use std::path::Path;

fn create(path: &Path, replace: bool) -> FileWriter {
    FileWriter::create(path, replace, Patched::Always).unwrap()
}

#[test]
fn files_appear_when_they_are_complete_or_not_at_all() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("a.laz");
    fs::write(folder.path().join("a.laz.part"), "mine").unwrap();
    drop(create(&target, false));
    assert_eq!(names(folder.path()), ["a.laz.part"]);
    let [mut one, mut two] = [create(&target, false), create(&target, false)];
    assert_eq!(names(folder.path()).len(), 3, "every writer has a file of its own");
    one.write_all(b"one").unwrap();
    two.write_all(b"two").unwrap();
    assert_eq!(one.finish().unwrap(), target);
    let message = two.finish().unwrap_err().to_string();
    assert!(message.contains("the complete output is") && message.contains("a.new.laz"), "{message}");
    assert_eq!(names(folder.path()), ["a.laz", "a.laz.part", "a.new.laz"]);
    for (name, text) in [("a.laz", "one"), ("a.new.laz", "two"), ("a.laz.part", "mine")] {
        assert_eq!(fs::read_to_string(folder.path().join(name)).unwrap(), text);
    }
}

#[test]
fn files_that_cannot_be_written_are_refused_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.laz");
    refuse_unwritable(&file, false).unwrap();
    refuse_unwritable(Path::new("none.laz"), false).unwrap();
    fs::write(&file, "one").unwrap();
    refuse_unwritable(&file, true).unwrap();
    for (path, force, expected) in [
        (file.clone(), false, "exists already"),
        (file.join("b.laz"), true, "a.laz is not a directory"),
        (folder.path().join("none/b.laz"), true, "none is not a directory"),
        (folder.path().to_path_buf(), true, "is a directory, expected a file"),
        (folder.path().join("x".repeat(300)), true, "cannot be written: "),
    ] {
        let said = refuse_unwritable(&path, force).unwrap_err().to_string();
        assert!(said.contains(expected), "{said}");
    }
}

#[test]
fn a_file_of_the_same_bytes_may_stay_and_another_one_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("a.laz");
    let finish = |text: &[u8]| {
        let mut out = create(&target, false).keeping_equal(true);
        out.write_all(text).unwrap();
        out.finish()
    };
    let text = b"points ".repeat(10_000);
    for _ in 0..2 {
        finish(&text).unwrap();
        assert_eq!(names(folder.path()), ["a.laz"]);
        assert_eq!(fs::read(&target).unwrap(), text);
    }
    for other in [&b"precious"[..], &text[1..], b"", &[&text[..], b"!"].concat()] {
        fs::write(&target, other).unwrap();
        assert!(finish(&text).unwrap_err().to_string().contains("a.new.laz"));
        assert_eq!(fs::read(&target).unwrap(), other);
        fs::remove_file(folder.path().join("a.new.laz")).unwrap();
    }
}

#[test]
fn the_last_of_several_files_with_one_name_stays() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("a");
    fs::write(&target, "old").unwrap();
    let [mut one, mut two] = [create(&target, true), create(&target, true)];
    two.write_all(b"two").unwrap();
    one.write_all(b"one").unwrap();
    two.finish().unwrap();
    one.finish().unwrap();
    assert_eq!(names(folder.path()), ["a"]);
    assert_eq!(fs::read_to_string(target).unwrap(), "one");
}

#[test]
fn files_continue_after_their_handles_were_closed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    let mut out = create(&path, false);
    for text in ["head ", "one ", "two"] {
        out.write_all(text.as_bytes()).unwrap();
        out.close_handle();
    }
    out.seek(SeekFrom::Start(0)).unwrap();
    out.write_all(b"HEAD").unwrap();
    out.close_handle();
    out.write_all(b" three").unwrap();
    out.close_handle();
    out.finish().unwrap();
    assert_eq!(fs::read_to_string(path).unwrap(), "HEAD one two three");
}

#[test]
fn a_name_may_be_as_long_as_the_file_system_allows() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ä".repeat(125) + ".xyz");
    let mut out = create(&path, false);
    out.write_all(b"x").unwrap();
    out.finish().unwrap();
    assert!(path.exists());
}

#[test]
fn files_of_killed_processes_are_removed_when_no_other_process_writes() {
    let folder = tempfile::tempdir().unwrap();
    let litter = ["a.laz.vlscan-0123abcd.part", "b.xyz.vlscan-00000000.part"];
    let others = ["a.laz.part", "a.vlscan-0123.part", "vlscan-0123abcd.part", "a.vlscan-0123ABCD.part"];
    litter.iter().chain(&others).for_each(|name| fs::write(folder.path().join(name), "").unwrap());
    let target = folder.path().join("a.laz");
    {
        let another = fs::File::open(folder.path()).unwrap();
        another.lock_shared().unwrap();
        remove_litter(folder.path());
        assert_eq!(names(folder.path()).len(), 6, "another process may own them");
    }
    create(&target, false).finish().unwrap();
    let mut expected = [&others[..], &["a.laz"]].concat();
    expected.sort_unstable();
    assert_eq!(names(folder.path()), expected);
    // While this process writes, others see its lock.
    let _open = create(&folder.path().join("c"), false);
    remove_litter(folder.path());
    assert_eq!(names(folder.path()).len(), 6);
}

#[test]
fn new_folders_are_removed_while_they_are_empty() {
    let folder = tempfile::tempdir().unwrap();
    let inner = folder.path().join("a/b");
    drop(NewFolder::create_all(&inner).unwrap());
    assert!(names(folder.path()).is_empty());
    let made = NewFolder::create_all(&inner).unwrap();
    fs::write(folder.path().join("a/file"), "").unwrap();
    drop(made);
    assert_eq!(names(&folder.path().join("a")), ["file"]);
    NewFolder::create(&inner).unwrap().keep();
    assert!(inner.is_dir() && NewFolder::create(&inner).is_err());
    assert!(NewFolder::create_all(&folder.path().join("a/file")).is_err());
}

#[cfg(unix)]
#[test]
fn links_stay_links_and_lead_to_one_file() {
    use std::os::unix::fs::symlink;
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::create_dir(at("d")).unwrap();
    fs::write(at("target"), "old").unwrap();
    symlink("target", at("link")).unwrap();
    symlink("d/missing", at("dangling")).unwrap();
    symlink("dangling", at("twice")).unwrap();
    symlink("circle", at("circle")).unwrap();
    for (link, target, replace) in [("link", "target", true), ("twice", "d/missing", false)] {
        let mut out = create(&at(link), replace);
        out.write_all(b"new").unwrap();
        out.finish().unwrap();
        assert!(at(link).is_symlink());
        assert_eq!(fs::read_to_string(at(target)).unwrap(), "new");
        assert_eq!(identity(&at(link)), identity(&at("d/..").join(target)));
    }
    assert!(at("dangling").is_symlink());
    assert!(FileWriter::create(&at("circle"), true, Patched::Never).is_err());
    assert_ne!(identity(&at("target")), identity(&at("d/missing")));
}

#[test]
fn names_beside_another_keep_its_extension() {
    for (name, sibling) in [
        ("d.x/a.laz", "d.x/a.partial.laz"),
        ("a.copc.laz", "a.partial.copc.laz"),
        ("a.COPC.Laz", "a.partial.COPC.Laz"),
        (".laz", ".laz.partial"),
        ("d.x/a", "d.x/a.partial"),
    ] {
        assert_eq!(free_name(Path::new(name), "partial", |_| false), Path::new(sibling));
    }
    assert_eq!(with_suffix(Path::new("a.copc.laz"), "_pulse", Some("txt")), Path::new("a_pulse.txt"));
    let taken = |path: &Path| path != Path::new("a.partial-3.laz");
    assert_eq!(free_name(Path::new("a.laz"), "partial", taken), Path::new("a.partial-3.laz"));
}

#[test]
fn scratch_files_are_read_back() {
    let mut scratch = FileWriter::scratch().unwrap();
    scratch.append(&[7; 100_000]).unwrap();
    let mut read = Vec::new();
    scratch
        .copy_to(|bytes| {
            read.extend_from_slice(bytes);
            Ok(())
        })
        .unwrap();
    assert!(read == [7; 100_000]);
}

#[test]
fn temporary_folders_go_with_their_contents() {
    let dir = tempfile::tempdir().unwrap();
    let folder = TemporaryFolder::next_to(&dir.path().join("a.mcap")).unwrap();
    assert_eq!(folder.path().parent(), Some(dir.path()));
    assert!(is_temporary_name(folder.path().file_name().unwrap()));
    fs::write(folder.path().join("part"), "of a run").unwrap();
    drop(folder);
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
}
