//! Leases, folders, limits of owners.

use super::expiry::{CLOCK, DAY};
use super::limits::MAX_QUICK;
use super::*;
use crate::files::Files;
use crate::messages::Said;
use crate::queue::LEASE;
use crate::queue::tests::job;
use crate::store::now;
use std::collections::BTreeSet;
use std::fs;
use std::path::PathBuf;

/// A workshop without workers, and a job of `anna` in its queue.
fn workshop() -> (tempfile::TempDir, Workshop, Job) {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path(), Files::Folder).unwrap();
    let program = Program {
        path: PathBuf::from("vlscan"),
        version: String::new(),
        pipeline: serde_json::Value::Null,
        commands: serde_json::Value::Null,
        catalogue: serde_json::Value::Null,
    };
    let limits = <crate::config::Cli as clap::Parser>::parse_from(["serve"]).serve;
    let job = job("anna", "a");
    assert!(store.add_job(&job, &BTreeSet::new(), None, 9).unwrap());
    (folder, Workshop::new(Arc::new(store), Arc::new(program), limits, Vec::new(), None), job)
}

fn fill(folder: &Path) {
    for name in ["in", "out", "view", "tmp", "tasks"] {
        fs::create_dir_all(folder.join(name)).unwrap();
        fs::write(folder.join(name).join("file"), "text").unwrap();
    }
    fs::write(folder.join("complete"), "[]").unwrap();
    fs::write(folder.join("prepared.json"), "{}").unwrap();
}

#[test]
fn a_worker_without_its_lease_leaves_the_files_of_the_new_holder() {
    let (_folder, workshop, job) = workshop();
    let store = &workshop.store;
    let folder = store.job_folder("a");
    fill(&folder);
    let late = now() - LEASE.as_millis() as i64;
    store.take_job("first", Lane::Any).unwrap().unwrap();
    store.database().execute("UPDATE jobs SET held_until = ?", [late]).unwrap();
    store.take_job("second", Lane::Any).unwrap().unwrap();
    let results = || Outcome::Successful(Vec::new(), Said::default());
    for outcome in [Outcome::Failed(String::new()), Outcome::Same("b".to_owned()), results()] {
        workshop.conclude(&job, "first", &outcome);
        assert_eq!(store.status("a").unwrap(), Some(Status::Running), "{outcome:?}");
        for name in ["in/file", "out/file", "view/file", "tmp/file", "tasks/file", "complete"] {
            assert!(folder.join(name).is_file(), "{outcome:?}: {name}");
        }
    }
    workshop.conclude(&job, "second", &results());
    assert_eq!(store.status("a").unwrap(), Some(Status::Successful));
    assert!(folder.join("out/file").is_file() && !folder.join("tmp").exists());
    assert_eq!(fs::read_dir(store.root().join("incoming")).unwrap().count(), 0, "removed files stay");
}

#[test]
fn failed_jobs_keep_their_messages_only_those_of_earlier_versions_too() {
    let (_folder, workshop, job) = workshop();
    let store = &workshop.store;
    let folder = store.job_folder("a");
    let is_tidy = || {
        let names: Vec<_> = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        names == ["log"] && fs::read_dir(store.root().join("incoming")).unwrap().count() == 0
    };
    fill(&folder);
    fs::write(folder.join("log"), "error: no").unwrap();
    store.take_job("w", Lane::Any).unwrap().unwrap();
    workshop.conclude(&job, "w", &Outcome::Failed("no".to_owned()));
    assert!(is_tidy());
    // As earlier versions have left it.
    fill(&folder);
    store.set_disk("a", 0).unwrap();
    assert_eq!(workshop.resume().unwrap(), None);
    assert!(is_tidy() && store.stored_bytes("anna").unwrap() > 4096);
}

#[test]
fn a_job_is_finished_although_its_folder_cannot_be_tidied() {
    let (_folder, workshop, job) = workshop();
    let store = &workshop.store;
    fill(&store.job_folder("a"));
    fs::remove_dir_all(store.root().join("incoming")).unwrap();
    fs::write(store.root().join("incoming"), "not a folder").unwrap();
    store.take_job("w", Lane::Any).unwrap().unwrap();
    workshop.conclude(&job, "w", &Outcome::Failed("no".to_owned()));
    assert_eq!(store.job("anna", "a").unwrap().unwrap().message, "no");
}

#[test]
fn files_of_a_job_that_gets_other_results_count_no_longer() {
    let (_folder, workshop, job) = workshop();
    let store = &workshop.store;
    fill(&store.job_folder("a"));
    store.take_job("w", Lane::Any).unwrap().unwrap();
    store.set_disk("a", 1 << 30).unwrap();
    workshop.conclude(&job, "w", &Outcome::Same("b".to_owned()));
    let stored = store.stored_bytes("anna").unwrap();
    assert!(stored < 10_000, "{stored}");
}

#[test]
fn a_job_without_its_inputs_fails_with_the_reason() {
    let (_folder, workshop, job) = workshop();
    let store = &workshop.store;
    let used = Use::Upload { name: "forest".to_owned(), id: "u".to_owned() };
    let prepared = Prepared { uses: BTreeSet::from([used]), ..Prepared::default() };
    let job = Job { prepared: serde_json::to_string(&prepared).unwrap(), ..job };
    store.take_job("w", Lane::Any).unwrap().unwrap();
    workshop.compute(&job, "w", Lane::Any);
    assert_eq!(store.job("anna", "a").unwrap().unwrap().message, REMOVED);
}

#[test]
fn a_clock_of_the_system_that_is_wrong_at_the_first_start_removes_nothing() {
    let (_folder, workshop, _) = workshop();
    let path = workshop.store.root().join(CLOCK);
    let year = 365 * DAY;
    workshop.store.database().execute("UPDATE jobs SET updated = updated - ?", [year]).unwrap();
    let time = |wall: i64| workshop.expiry_clock(&path).time(wall, Instant::now());
    assert!(time(now()) < now() - 364 * DAY, "the newest job was changed a year ago");
    fs::write(&path, "damaged").unwrap();
    assert!(time(now()) < now() - 364 * DAY);
    fs::write(&path, "5 -\n").unwrap();
    assert!(time(now()) < 60_000, "the clock of the service");
    workshop.store.database().execute("DELETE FROM jobs", []).unwrap();
    fs::remove_file(&path).unwrap();
    assert!(time(now()) > now() - DAY, "there is nothing to remove");
}

#[test]
fn a_quick_job_has_its_turn_while_others_wait() {
    let (_folder, workshop, _) = workshop();
    let store = &workshop.store;
    let quick = Lane::Quick { share: 1 };
    let add = |owner: &str, id: &str| {
        let job = Job { process: "plan".to_owned(), fingerprint: id.to_owned(), ..job(owner, id) };
        assert!(store.add_job(&job, &BTreeSet::new(), None, 9).unwrap());
        job
    };
    let first = add("anna", "p");
    assert_eq!(store.take_job("w", quick).unwrap().unwrap().id, "p");
    let start = Instant::now().checked_sub(MAX_QUICK + RENEWAL).unwrap();
    let is_over = |turn: Turn| workshop.is_over(&first, &turn).unwrap();
    let long = |lane| Turn { start, ..Turn::new(lane) };
    add("anna", "q");
    assert!(!is_over(long(quick)), "nobody else waits");
    add("ben", "r");
    assert!(is_over(long(quick)) && !is_over(Turn::new(quick)) && !is_over(long(Lane::Any)));
    assert_eq!(store.take_job("x", quick).unwrap().unwrap().id, "r");
    add("ben", "s");
    assert!(!is_over(long(quick)), "ben has his share");
    store.release_slow("p", "w").unwrap();
    assert_eq!(store.take_job("w", quick).unwrap().unwrap().id, "q", "p waits for the other workers");
    assert!(store.take_job("w", quick).unwrap().is_none());
    let others: Vec<_> = std::iter::from_fn(|| store.take_job("y", Lane::Any).unwrap()).collect();
    assert!(others.iter().any(|job| job.id == "p"));
    assert!(store.finish("p", "y", &Outcome::Failed(String::new())).unwrap());
    assert!(store.slow.lock().unwrap().is_empty());
}

#[test]
fn campaigns_at_the_same_time_count_each_other() {
    let (_folder, mut workshop, _) = workshop();
    workshop.limits.quota = Some(100);
    let store = Arc::clone(&workshop.store);
    let campaigns = ["b", "c"].map(|id| {
        let campaign = Job { process: "campaign".to_owned(), ..job("anna", id) };
        assert!(store.add_job(&campaign, &BTreeSet::new(), None, 9).unwrap());
        campaign
    });
    let complete = |id: &str, pulses: u64| {
        let notes = store.job_folder(id).join("out/dataset/.campaign");
        fs::create_dir_all(&notes).unwrap();
        fs::write(notes.join("a.made"), format!("{{\"pulses\": {pulses}}}\n")).unwrap();
    };
    let exceeded = |workshop: &Workshop, campaign: &Job| {
        workshop.exceeded(campaign, &store.job_folder(&campaign.id)).unwrap()
    };
    let [first, second] = &campaigns;
    complete("b", 60);
    complete("c", 40);
    assert_eq!((exceeded(&workshop, first), exceeded(&workshop, second)), (None, None));
    complete("c", 50);
    let message = exceeded(&workshop, second).unwrap();
    assert!(message.contains("quota of 100 pulses") && message.contains("(110)"), "{message}");
    // Their files count while they are computed.
    let stored = store.stored_bytes("anna").unwrap();
    assert!(stored > 8 * 4096, "{stored}");
    workshop.limits.max_stored = stored - 1;
    assert!(exceeded(&workshop, first).unwrap().contains("remove some first"));
}
