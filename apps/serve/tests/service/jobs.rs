//! Queue, results given again, limits, interruptions.

use crate::client::{Service, refused};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// A flight of this many seconds over a field of 100 m, over which a run takes long enough to be interrupted.
pub fn flight(seed: u64, seconds: u32) -> Value {
    json!({
        "scene": "field/field.obj",
        "seed": seed,
        "scanner": { "catalogue": "riegl_vux-1uav" },
        "platform": { "catalogue": "copter_linearpath" },
        "settings": { "pulse_freq_hz": 100_000, "scan_freq_hz": 100 },
        "leg": [{ "position_m": [-40, 0, 50], "speed_m_per_s": f64::from(80) / f64::from(seconds) }, { "position_m": [40, 0, 50] }],
    })
}

pub fn with_field(service: &Service) {
    let corners = "v -50 -50 0\nv 50 -50 0\nv 50 50 0\nv -50 50 0\nf 1 2 3 4\n";
    assert_eq!(service.upload("field", &[("field.obj", corners.into())]).status, 201);
}

fn points(service: &Service, id: &str) -> Vec<u8> {
    let answer = service.get(&format!("/jobs/{id}/results/points.laz"));
    assert_eq!(answer.status, 200, "{}", answer.text());
    answer.body
}

/// True if a job has to be computed; a worker may have begun already.
fn is_computed(job: &Value) -> bool {
    ["accepted", "running"].iter().any(|status| job["status"] == *status)
}

#[test]
fn a_run_that_was_done_before_is_answered_at_once() {
    let mut service = Service::start(&[]);
    with_field(&service);
    let first = service.run("run", &flight(1, 1));
    assert_eq!(first["status"], "successful", "{first}");
    let first = first["jobID"].as_str().unwrap().to_owned();
    let again = service.execute("run", &flight(1, 1)).json();
    assert_eq!(again["status"], "successful", "no worker was needed");
    let again = again["jobID"].as_str().unwrap().to_owned();
    assert!(again != first && points(&service, &again) == points(&service, &first));
    let other = service.execute("run", &flight(2, 1)).json();
    assert!(is_computed(&other), "{other}");
    service.wait(other["jobID"].as_str().unwrap());
    // The results are those of the contents: another file of the same name is another run.
    service.ask("DELETE", "/uploads/field", &[], b"");
    let corners = "v -50 -50 1\nv 50 -50 1\nv 50 50 1\nv -50 50 1\nf 1 2 3 4\n";
    assert_eq!(service.upload("field", &[("field.obj", corners.into())]).status, 201);
    let moved = service.execute("run", &flight(1, 1)).json();
    assert!(is_computed(&moved), "{moved}");
    // Results stay while a job names them.
    let bytes = points(&service, &first);
    service.ask("DELETE", &format!("/jobs/{first}"), &[], b"");
    service.restart();
    assert!(points(&service, &again) == bytes);
    service.ask("DELETE", &format!("/jobs/{again}"), &[], b"");
    assert!(!service.data.join("jobs").join(&first).exists());
}

/// Kills service and workers `kills` times at random moments while jobs are computed; returns the points of
/// the jobs by seed.
fn interrupted(kills: u32, seeds: u64, seconds: u32) -> BTreeMap<u64, Vec<u8>> {
    let mut service = Service::start(&[]);
    with_field(&service);
    let jobs: Vec<(u64, String)> =
        (0..seeds).map(|seed| (seed, service.submit("run", &flight(seed, seconds)))).collect();
    let mut state: u64 = 88_172_645_463_325_252;
    for kill in 0..kills {
        // xorshift: the moments differ, and are the same in every test.
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        std::thread::sleep(Duration::from_millis(state % 400));
        match kill % 3 {
            // The worker's process alone.
            0 => kill_child(service.id()),
            _ => service.restart(),
        }
    }
    let done = jobs.iter().map(|(seed, id)| {
        let job = service.wait(id);
        assert_eq!(job["status"], "successful", "{job}");
        (*seed, points(&service, id))
    });
    let done = done.collect();
    assert_eq!(
        service.json("/jobs?limit=1000")["jobs"].as_array().unwrap().len(),
        jobs.len(),
        "no job is lost"
    );
    service.wait_until_incoming_is_empty("interruptions leave nothing");
    done
}

/// Ends the processes that a service has started.
fn kill_child(parent: u32) {
    let children =
        std::fs::read_to_string(format!("/proc/{parent}/task/{parent}/children")).unwrap_or_default();
    let threads = std::fs::read_dir(format!("/proc/{parent}/task")).into_iter().flatten().flatten();
    let of_threads =
        threads.filter_map(|thread| std::fs::read_to_string(thread.path().join("children")).ok());
    for id in of_threads.chain([children]).collect::<String>().split_whitespace() {
        let _ = std::process::Command::new("kill").args(["-9", id]).status();
    }
}

#[test]
fn killed_services_and_workers_lose_no_job_and_no_byte() {
    let calm = interrupted(0, 3, 6);
    assert!(interrupted(9, 3, 6) == calm);
}

#[test]
#[ignore = "a hundred kills take minutes"]
fn a_hundred_kills_lose_no_job_and_no_byte() {
    let calm = interrupted(0, 10, 20);
    assert!(interrupted(100, 10, 20) == calm);
}

/// Waits until the number of processes that work in the service's folder is 0 or not.
pub fn wait_for_processes(service: &Service, wanted: bool) {
    let start = Instant::now();
    let works_there = |entry: std::fs::DirEntry| {
        std::fs::read_link(entry.path().join("cwd")).is_ok_and(|folder| folder.starts_with(&service.data))
    };
    while std::fs::read_dir("/proc").unwrap().flatten().any(works_there) != wanted {
        assert!(start.elapsed() < Duration::from_secs(20), "processes: not {wanted}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn processes_end_with_the_service_and_with_their_job() {
    let mut service = Service::start(&[]);
    with_field(&service);
    let id = service.submit("run", &flight(1, 4000));
    wait_for_processes(&service, true);
    service.kill();
    wait_for_processes(&service, false);
    service.restart();
    wait_for_processes(&service, true);
    let dismissed = service.ask("DELETE", &format!("/jobs/{id}"), &[], b"").json();
    assert_eq!(dismissed["status"], "dismissed");
    wait_for_processes(&service, false);
    let start = Instant::now();
    while service.data.join("jobs").join(&id).exists() {
        assert!(start.elapsed() < Duration::from_secs(20), "the files of a dismissed job are removed");
        std::thread::sleep(Duration::from_millis(10));
    }
    service.restart();
    assert_eq!(service.json(&format!("/jobs/{id}"))["status"], "dismissed");
}

#[test]
fn runs_are_priced_before_they_start() {
    let service = Service::start(&["--quota", "150k"]);
    with_field(&service);
    // 100,000 pulses per second.
    let first = service.run("run", &flight(1, 1));
    assert_eq!(first["status"], "successful", "{first}");
    let second = service.run("run", &flight(2, 1));
    assert_eq!(second["status"], "failed", "{second}");
    assert!(second["message"].as_str().unwrap().contains("of the quota of 150000 pulses"), "{second}");
    // What was computed before costs nothing.
    assert_eq!(service.execute("run", &flight(1, 1)).json()["status"], "successful");
}

#[test]
fn limits_end_a_job_with_a_message() {
    let service = Service::start(&["--max-time", "1"]);
    with_field(&service);
    let job = service.run("run", &flight(1, 4000));
    assert_eq!(job["status"], "failed", "{job}");
    assert!(job["message"].as_str().unwrap().contains("limit"), "{job}");
    let service = Service::start(&["--max-disk", "100k"]);
    with_field(&service);
    let job = service.run("run", &flight(1, 60));
    assert_eq!(job["status"], "failed", "{job}");
    let service = Service::start(&["--max-memory", "40M"]);
    with_field(&service);
    let job = service.run("run", &flight(1, 1));
    assert_eq!(job["status"], "failed", "{job}");
    let service = Service::start(&["--workers", "0", "--max-queued", "2"]);
    with_field(&service);
    service.submit("run", &flight(1, 1));
    service.submit("run", &flight(2, 1));
    assert_eq!(service.execute("run", &flight(3, 1)).status, 429);
}

#[test]
fn two_services_do_not_share_a_folder() {
    let service = Service::start(&["--workers", "0"]);
    let said = refused(&service.data, &[]);
    assert!(said.contains("another service uses the folder"), "{said}");
}
