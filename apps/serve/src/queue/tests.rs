//! Queue, leases, shares, removal.

use super::*;
use crate::files::Files;
use crate::store::{FileKind, Listed, StoreError, Upload, UploadFile};
use vlscan_messages::ProblemMessage;

/// A job that nobody computes yet.
pub(crate) fn job(owner: &str, id: &str) -> Job {
    Job {
        id: id.to_owned(),
        owner: owner.to_owned(),
        process: "run".to_owned(),
        inputs: "{}".to_owned(),
        prepared: "{}".to_owned(),
        fingerprint: "same".to_owned(),
        folder: id.to_owned(),
        status: Status::Accepted,
        message: String::new(),
        progress: 0,
        results: String::new(),
        warnings: String::new(),
        created: now(),
        started: None,
        finished: None,
        updated: now(),
    }
}

/// Messages with a warning.
fn warned() -> Said {
    let warning = ProblemMessage { message: "w".to_owned(), ..ProblemMessage::default() };
    Said { text: "warning: w".to_owned(), warnings: vec![warning] }
}

fn store() -> (tempfile::TempDir, Store) {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path(), Files::Folder).unwrap();
    (folder, store)
}

#[test]
fn a_job_is_taken_once_and_finished_by_its_holder() {
    let (_folder, store) = store();
    for id in ["a", "b"] {
        assert!(store.add_job(&job("anna", id), &BTreeSet::new(), None, 2).unwrap());
    }
    assert!(!store.add_job(&job("anna", "c"), &BTreeSet::new(), None, 2).unwrap(), "two jobs wait");
    assert!(store.add_job(&job("ben", "d"), &BTreeSet::new(), None, 2).unwrap());
    assert_eq!(store.take_job("w1", Lane::Any).unwrap().unwrap().id, "a");
    assert_eq!(store.take_job("w3", Lane::Any).unwrap().unwrap().id, "d", "it is the turn of ben");
    assert_eq!(store.take_job("w2", Lane::Any).unwrap().unwrap().id, "b");
    assert!(store.take_job("w4", Lane::Any).unwrap().is_none());
    assert!(!store.finish("a", "w2", &Outcome::Successful(Vec::new(), Said::default())).unwrap());
    assert!(store.finish("a", "w1", &Outcome::Failed("no".to_owned())).unwrap());
    let found = store.job("anna", "a").unwrap().unwrap();
    assert_eq!((found.status, found.message.as_str()), (Status::Failed, "no"));
    assert!(store.job("ben", "a").unwrap().is_none(), "jobs of others are not seen");
    // A holder that has ended gives its job back.
    store.release("w2").unwrap();
    assert_eq!(store.take_job("w5", Lane::Any).unwrap().unwrap().id, "b");
    assert!(!store.renew("b", "w2", 10, "").unwrap() && store.renew("b", "w5", 10, "").unwrap());
    // A lease runs out.
    store.database().execute("UPDATE jobs SET held_until = 1 WHERE id = 'b'", []).unwrap();
    assert_eq!(store.take_job("w6", Lane::Any).unwrap().unwrap().id, "b");
}

#[test]
fn the_place_of_a_job_counts_turns_of_owners() {
    let (_folder, store) = store();
    for (owner, id) in [("ben", "1"), ("ben", "2"), ("ben", "3"), ("anna", "a"), ("anna", "b"), ("carl", "c")]
    {
        assert!(store.add_job(&job(owner, id), &BTreeSet::new(), None, 9).unwrap());
    }
    let before = |owner: &str, id: &str| {
        let place = store.place(&store.job(owner, id).unwrap().unwrap()).unwrap().unwrap();
        (place.before, place.mean)
    };
    assert_eq!(before("anna", "a"), (2, None), "one of ben, one of carl");
    assert_eq!(before("anna", "b"), (4, None), "a, two of ben, one of carl");
    let plan = Job { process: "plan".to_owned(), ..job("anna", "p") };
    assert!(store.add_job(&plan, &BTreeSet::new(), None, 9).unwrap());
    assert_eq!(before("anna", "p"), (0, None), "plans do not wait for runs");
    let taken = store.take_job("w", Lane::Any).unwrap().unwrap();
    assert_eq!(store.place(&taken).unwrap(), None, "it is computed");
}

#[test]
fn results_are_given_again_and_kept_while_a_job_names_them() {
    let (_folder, store) = store();
    store.add_job(&job("anna", "a"), &BTreeSet::new(), None, 9).unwrap();
    store.take_job("w", Lane::Any).unwrap();
    std::fs::create_dir_all(store.job_folder("a").join("out")).unwrap();
    let points = store.job_folder("a").join("out/points.laz");
    std::fs::write(&points, "7 bytes").unwrap();
    let files = vec![ResultFile { path: "points.laz".to_owned(), bytes: 7 }];
    store.finish("a", "w", &Outcome::Successful(files.clone(), warned())).unwrap();
    std::fs::rename(&points, points.with_extension("gone")).unwrap();
    assert!(store.same_job("anna", "same").unwrap().is_none(), "its file is gone");
    std::fs::rename(points.with_extension("gone"), &points).unwrap();
    let first = store.same_job("anna", "same").unwrap().unwrap();
    assert!(store.same_job("ben", "same").unwrap().is_none());
    store.add_job(&job("anna", "b"), &BTreeSet::new(), Some(&first), 0).unwrap();
    let again = store.job("anna", "b").unwrap().unwrap();
    assert_eq!((again.status, again.folder.as_str()), (Status::Successful, "a"));
    assert_eq!((again.result_files(), again.message.as_str()), (files, "warning: w"));
    assert_eq!(again.problems(), warned().warnings);
    assert_eq!(store.job("anna", "a").unwrap().unwrap().result_files()[0].bytes, 7);
    store.dismiss("anna", "a", None).unwrap();
    assert!(store.job_folder("a").is_dir(), "the second job has its results there");
    store.dismiss("anna", "b", None).unwrap();
    assert!(!store.job_folder("a").exists());
    let uses = BTreeSet::from([Use::Upload { name: "forest".into(), id: "u".into() }]);
    let rows =
        || -> i64 { store.database().query_row("SELECT count(*) FROM uses", [], |row| row.get(0)).unwrap() };
    store.add_job(&Job { fingerprint: "other".to_owned(), ..job("anna", "d") }, &uses, None, 9).unwrap();
    assert!(rows() == 1 && store.stored_bytes("anna").unwrap() > 256);
    store.take_job("w", Lane::Any).unwrap();
    store.finish("d", "w", &Outcome::Successful(Vec::new(), Said::default())).unwrap();
    let other = store.same_job("anna", "other").unwrap().unwrap();
    store.add_job(&job("anna", "e"), &uses, Some(&other), 9).unwrap();
    assert_eq!(rows(), 0, "finished jobs read nothing");
    // A request that was about to be answered with them.
    store.add_job(&job("anna", "c"), &BTreeSet::new(), Some(&first), 9).unwrap();
    assert_eq!(store.status("c").unwrap(), Some(Status::Accepted), "it is computed");
}

#[test]
fn a_damaged_list_of_results_is_an_error_and_not_an_empty_list() {
    let (_folder, store) = store();
    store.add_job(&job("anna", "a"), &BTreeSet::new(), None, 9).unwrap();
    store.take_job("w", Lane::Any).unwrap();
    std::fs::create_dir_all(store.job_folder("a").join("out")).unwrap();
    store.finish("a", "w", &Outcome::Successful(Vec::new(), Said::default())).unwrap();
    assert!(store.results_in("a").unwrap().is_empty());
    store.database().execute("UPDATE jobs SET results = '[{' WHERE id = 'a'", []).unwrap();
    let error = store.results_in("a").unwrap_err();
    assert!(matches!(error, StoreError::Record { .. }), "{error}");
    assert!(store.same_job("anna", "same").unwrap().is_none(), "it answers no other request");
}

#[test]
fn uploads_stay_while_unfinished_jobs_use_them() {
    let (_folder, store) = store();
    let upload = Upload {
        id: "u".into(),
        name: "forest".into(),
        files: 1,
        folders: 1,
        bytes: 5,
        sha256: "x".into(),
        created: 1,
    };
    let files = [UploadFile { path: "a.obj".into(), bytes: 5, kind: FileKind::Other }];
    std::fs::create_dir_all(store.upload_folder("u")).unwrap();
    assert!(store.add_upload("anna", &upload, &files).unwrap());
    assert!(!store.add_upload("anna", &Upload { id: "v".into(), ..upload.clone() }, &files).unwrap());
    let uses = BTreeSet::from([Use::Upload { name: "forest".into(), id: "u".into() }]);
    store.add_job(&job("anna", "a"), &uses, None, 9).unwrap();
    assert!(!store.remove_upload("ben", "forest").unwrap());
    assert!(store.remove_upload("anna", "forest").unwrap());
    assert!(store.uploads("anna").unwrap().is_empty() && store.upload_folder("u").is_dir());
    store.dismiss("anna", "a", None).unwrap();
    assert!(!store.upload_folder("u").exists());
}

#[test]
fn a_job_is_finished_with_the_results_of_another_one_while_these_are_there() {
    let (_folder, store) = store();
    let files = vec![ResultFile { path: "points.laz".to_owned(), bytes: 7 }];
    for id in ["a", "b", "c"] {
        store.add_job(&job("anna", id), &BTreeSet::new(), None, 9).unwrap();
    }
    store.take_job("w1", Lane::Any).unwrap();
    store.finish("a", "w1", &Outcome::Successful(files.clone(), warned())).unwrap();
    store.take_job("w2", Lane::Any).unwrap();
    assert!(store.finish("b", "w2", &Outcome::Same("a".to_owned())).unwrap());
    let found = store.job("anna", "b").unwrap().unwrap();
    assert_eq!((found.status, found.folder.as_str(), found.result_files()), (Status::Successful, "a", files));
    assert_eq!((found.message.as_str(), found.problems()), ("warning: w", warned().warnings));
    store.dismiss("anna", "a", None).unwrap();
    assert!(store.has(Kind::Results, "a").unwrap(), "another job names them");
    store.dismiss("anna", "b", None).unwrap();
    assert_eq!(store.take_job("w3", Lane::Any).unwrap().unwrap().id, "c");
    assert!(!store.finish("c", "w3", &Outcome::Same("a".to_owned())).unwrap());
    assert_eq!(store.take_job("w4", Lane::Any).unwrap().unwrap().id, "c", "it is computed after all");
}

#[test]
fn the_folder_of_a_dismissed_job_stays_while_somebody_holds_it() {
    let (_folder, store) = store();
    store.add_job(&job("anna", "a"), &BTreeSet::new(), None, 9).unwrap();
    std::fs::create_dir_all(store.job_folder("a")).unwrap();
    store.dismiss("anna", "a", Some("engine")).unwrap();
    assert!(store.job_folder("a").is_dir() && store.take_job("w", Lane::Any).unwrap().is_none());
    assert_eq!(store.held(Status::Dismissed).unwrap(), ["a"]);
    store.let_go("a", "another").unwrap();
    assert!(store.job_folder("a").is_dir());
    store.let_go("a", "engine").unwrap();
    assert!(!store.job_folder("a").exists());
}

#[test]
fn owners_take_turns_and_have_a_share_of_quick_workers() {
    let (_folder, store) = store();
    let add = |owner: &str, id: &str, process: &str| {
        let job = Job { process: process.to_owned(), ..job(owner, id) };
        assert!(store.add_job(&job, &BTreeSet::new(), None, 99).unwrap());
    };
    for id in ["a1", "a2", "a3", "a4"] {
        add("anna", id, "run");
    }
    add("anna", "a5", "plan");
    add("anna", "a6", "plan");
    add("ben", "b1", "run");
    add("ben", "b2", "plan");
    add("carl", "c1", "run");
    let take = |lane| store.take_job("w", lane).unwrap().map(|job| job.id);
    let quick = Lane::Quick { share: 1 };
    assert_eq!(take(quick).as_deref(), Some("a5"));
    assert_eq!(take(quick).as_deref(), Some("b2"), "anna has her share");
    assert_eq!(take(quick), None);
    // Jobs that end leave the order of turns.
    store.release("w").unwrap();
    store.database().execute("UPDATE jobs SET status = 'failed' WHERE process = 'plan'", []).unwrap();
    let mut order = Vec::new();
    while let Some(job) = store.take_job("w", Lane::Any).unwrap() {
        store.finish(&job.id, "w", &Outcome::Failed(String::new())).unwrap();
        order.push(job.id);
    }
    assert_eq!(order, ["c1", "a1", "b1", "a2", "a3", "a4"]);
}

#[test]
fn dismissed_jobs_leave_nothing_but_their_state() {
    let (folder, store) = store();
    for number in 0..200 {
        let id = format!("j{number}");
        let long = format!("{{\"area\": \"{}\"}}", "x".repeat(100_000));
        let job = Job { inputs: long.clone(), prepared: long, ..job("anna", &id) };
        assert!(store.add_job(&job, &BTreeSet::new(), None, 999).unwrap());
    }
    assert!(store.stored_bytes("anna").unwrap() > 200 * 200_000, "rows count");
    let rows = store.row_bytes("anna").unwrap();
    assert!((200 * 200_000..200 * 202_000).contains(&rows), "{rows}");
    let listed = store.jobs(Listed::States, "anna", &[], &[], 0, 1000).unwrap();
    assert!(listed.len() == 200 && listed.iter().all(|job| job.inputs.len() + job.prepared.len() < 100));
    for number in 0..200 {
        assert!(store.dismiss("anna", &format!("j{number}"), None).unwrap());
    }
    assert_eq!(store.stored_bytes("anna").unwrap(), 200 * 1024, "rows that are left count");
    assert_eq!(store.row_bytes("anna").unwrap(), 0);
    assert_eq!(store.job("anna", "j7").unwrap().unwrap().inputs, "{}");
    store.database().query_row("PRAGMA wal_checkpoint(TRUNCATE)", [], |_| Ok(())).unwrap();
    let bytes = std::fs::metadata(folder.path().join("service.db")).unwrap().len();
    assert!(bytes < 4 << 20, "{bytes}");
    store.forget_before(now() - 60_000).unwrap();
    assert!(store.job("anna", "j7").unwrap().is_some());
    store.forget_before(now() + 1).unwrap();
    assert!(store.job("anna", "j7").unwrap().is_none());
    assert_eq!(store.stored_bytes("anna").unwrap(), 0);
}

#[test]
fn ten_thousand_dismissed_jobs_leave_a_small_database() {
    let (folder, store) = store();
    store.database().execute_batch("PRAGMA synchronous = OFF").unwrap();
    let long = format!("{{\"area\": \"{}\"}}", "x".repeat(4000));
    for number in 0..10_000 {
        let id = format!("{number:032x}");
        let job = Job { inputs: long.clone(), prepared: long.clone(), ..job("anna", &id) };
        let uses = BTreeSet::from([Use::Upload { name: "forest".into(), id: "u".into() }]);
        assert!(store.add_job(&job, &uses, None, 99_999).unwrap());
        assert!(store.dismiss("anna", &id, None).unwrap());
    }
    let bytes = |name: &str| std::fs::metadata(folder.path().join(name)).unwrap().len();
    let all = bytes("service.db") + bytes("service.db-wal");
    assert!(all < 20_000_000, "{all}");
}

#[test]
fn failed_jobs_keep_their_inputs_and_nothing_that_was_made_of_them() {
    let (_folder, store) = store();
    let long = format!("{{\"shown\": \"{}\"}}", "x".repeat(100_000));
    let failed = Job { inputs: "{\"seed\": 1}".to_owned(), prepared: long, ..job("anna", "a") };
    store.add_job(&failed, &BTreeSet::new(), None, 9).unwrap();
    store.take_job("w", Lane::Any).unwrap();
    store.finish("a", "w", &Outcome::Failed("no".to_owned())).unwrap();
    let found = store.job("anna", "a").unwrap().unwrap();
    assert_eq!((found.inputs.as_str(), found.prepared.as_str()), ("{\"seed\": 1}", "{}"));
    assert!(store.stored_bytes("anna").unwrap() < 2000);
}

#[test]
fn lists_have_the_start_of_long_messages() {
    let (_folder, store) = store();
    store.add_job(&job("anna", "a"), &BTreeSet::new(), None, 9).unwrap();
    store.take_job("w", Lane::Any).unwrap();
    let long = "ä".repeat(5000);
    store.finish("a", "w", &Outcome::Failed(long.clone())).unwrap();
    let listed = store.jobs(Listed::Bare, "anna", &[], &[], 0, 9).unwrap();
    assert_eq!(listed[0].message, format!("{} …", "ä".repeat(1000)));
    assert_eq!(store.job("anna", "a").unwrap().unwrap().message, long);
}

#[test]
fn the_state_of_a_job_has_no_long_texts() {
    let (_folder, store) = store();
    let long = format!("{{\"shown\": \"{}\"}}", "x".repeat(100_000));
    let waiting = Job { inputs: long.clone(), prepared: long, ..job("anna", "a") };
    store.add_job(&waiting, &BTreeSet::new(), None, 9).unwrap();
    store.take_job("w", Lane::Any).unwrap();
    let files = vec![ResultFile { path: "points.laz".to_owned(), bytes: 7 }];
    store.finish("a", "w", &Outcome::Successful(files, warned())).unwrap();
    let state = store.job_state("anna", "a").unwrap().unwrap();
    assert_eq!((state.inputs.as_str(), state.prepared.as_str(), state.results.as_str()), ("{}", "{}", "[]"));
    assert_eq!((state.status, state.message.as_str()), (Status::Successful, "warning: w"));
    assert_eq!(state.problems(), warned().warnings);
    assert!(store.job_state("ben", "a").unwrap().is_none());
}

#[test]
fn quotas_count_what_has_started_within_a_day() {
    let (_folder, store) = store();
    for id in ["a", "b"] {
        store.add_job(&job("anna", id), &BTreeSet::new(), None, 9).unwrap();
    }
    let first = store.take_job("w", Lane::Any).unwrap().unwrap();
    let second = store.take_job("w", Lane::Any).unwrap().unwrap();
    assert_eq!(store.charge(&first, 60, Some(100)).unwrap(), Ok(()));
    assert_eq!(store.charge(&first, 60, Some(100)).unwrap(), Ok(()), "it is continued");
    assert_eq!(store.charge(&second, 60, Some(100)).unwrap(), Err(60));
    assert_eq!(store.charge(&second, u64::MAX, None).unwrap(), Ok(()));
}
