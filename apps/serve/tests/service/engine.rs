//! Jobs that an engine computes. The engine is a script that starts each task as a separate process, which
//! outlives the service.

use crate::client::{Service, refused};
use crate::jobs::{flight, wait_for_processes, with_field};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Hands in, asks for and cancels tasks, which it knows by the groups of their processes.
const SCRIPT: &str = r#"#!/bin/sh
set -eu
folder=$(dirname "$0") verb=$1 name=$2
shift 2
case $verb in
  submit)
    tasks=$1
    shift
    for task in $(seq 0 $((tasks - 1))); do
      JOB_COMPLETION_INDEX=$task setsid sh -c '
        while [ -e "$0.held-$JOB_COMPLETION_INDEX" ]; do sleep 0.02; done
        exec "$@"
      ' "$folder/tasks" "$@" >>"$folder/log" 2>&1 &
      echo $! >>"$folder/$name"
    done
    echo "$name" >>"$folder/submitted"
    ;;
  poll)
    [ -e "$folder/$name" ] || exit 0
    for task in $(cat "$folder/$name"); do
      if [ -d "/proc/$task" ] && ! grep -q '^State:.Z' "/proc/$task/status"; then echo "$task"; fi
    done
    ;;
  cancel)
    [ -e "$folder/$name" ] || exit 0
    for task in $(cat "$folder/$name"); do kill -9 "-$task" 2>/dev/null || true; done
    ;;
esac
"#;

struct Engine {
    folder: tempfile::TempDir,
}

impl Engine {
    fn new() -> Engine {
        use std::os::unix::fs::PermissionsExt as _;
        let folder = tempfile::tempdir().unwrap();
        let script = folder.path().join("engine");
        std::fs::write(&script, SCRIPT).unwrap();
        std::fs::set_permissions(&script, std::fs::Permissions::from_mode(0o755)).unwrap();
        Engine { folder }
    }

    fn options(&self, parts: u32) -> Vec<String> {
        let script = self.folder.path().join("engine").display().to_string();
        vec![
            format!("--submit={script} submit {{name}} {{tasks}} {{command}}"),
            format!("--poll={script} poll {{name}}"),
            format!("--cancel={script} cancel {{name}}"),
            format!("--parts={parts}"),
        ]
    }

    fn service(&self, parts: u32) -> Service {
        let options = self.options(parts);
        Service::start(&options.iter().map(String::as_str).collect::<Vec<_>>())
    }

    /// Names of what was handed in.
    fn submitted(&self) -> Vec<String> {
        let text = std::fs::read_to_string(self.folder.path().join("submitted")).unwrap_or_default();
        text.lines().map(str::to_owned).collect()
    }

    /// Lets a task wait before it begins, however fast the others are.
    fn hold(&self, task: usize) {
        std::fs::write(self.held(task), "").unwrap();
    }

    /// Kills a held task with the process that it has started.
    fn kill_held(&self, name: &str, task: usize) {
        let tasks = std::fs::read_to_string(self.folder.path().join(name)).unwrap();
        let group = format!("-{}", tasks.lines().nth(task).unwrap());
        wait_until("the task has a group of its own", || {
            std::process::Command::new("kill").args(["-9", "--", &group]).status().unwrap().success()
        });
        std::fs::remove_file(self.held(task)).unwrap();
    }

    fn held(&self, task: usize) -> PathBuf {
        self.folder.path().join(format!("tasks.held-{task}"))
    }
}

impl Drop for Engine {
    fn drop(&mut self) {
        for name in self.submitted() {
            let _ = std::process::Command::new(self.folder.path().join("engine"))
                .args(["cancel", &name])
                .status();
        }
    }
}

/// The results of a job by path.
fn results(service: &Service, id: &str) -> Vec<(String, Vec<u8>)> {
    let results = service.json(&format!("/jobs/{id}/results"));
    let names = results.as_object().unwrap().keys();
    names
        .map(|name| {
            let answer = service.get(&format!("/jobs/{id}/results/{name}"));
            assert_eq!(answer.status, 200, "{name}: {}", answer.text());
            (name.clone(), answer.body)
        })
        .collect()
}

fn wait_until(what: &str, is_so: impl Fn() -> bool) {
    let start = Instant::now();
    while !is_so() {
        assert!(start.elapsed() < Duration::from_secs(60), "{what}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

fn tasks_of(service: &Service, id: &str) -> PathBuf {
    service.data.join("jobs").join(id).join("tasks")
}

fn exists(path: &Path) -> bool {
    path.exists()
}

#[test]
fn an_engine_gives_the_bytes_of_one_process_whoever_is_killed() {
    let inputs = || {
        let mut inputs = flight(1, 6);
        inputs["output"] =
            json!([{ "path": "points.laz" }, { "path": "poses.csv", "content": "trajectory" }]);
        inputs
    };
    let alone = Service::start(&[]);
    with_field(&alone);
    let job = alone.run("run", &inputs());
    assert_eq!(job["status"], "successful", "{job}");
    let expected = results(&alone, job["jobID"].as_str().unwrap());
    assert_eq!(expected.len(), 2);

    let engine = Engine::new();
    engine.hold(1);
    let mut service = engine.service(3);
    with_field(&service);
    let id = service.submit("run", &inputs());
    wait_until("the job is handed in", || engine.submitted().len() == 1);
    engine.kill_held(&engine.submitted()[0], 1);
    service.kill();
    // The tasks go on without the service.
    let tasks = tasks_of(&service, &id);
    wait_until("part 2", || exists(&tasks.join("part-2-of-3")));
    service.restart();
    let job = service.wait(&id);
    assert_eq!(job["status"], "successful", "{job}");
    assert!(results(&service, &id) == expected);
    // The one that was killed was computed again, by a second submission; what was complete was kept.
    assert_eq!(engine.submitted(), [format!("vlscan-{id}-1"), format!("vlscan-{id}-2")]);
    assert!(!exists(&tasks), "what the tasks were given is removed");
}

#[test]
fn a_dismissed_job_is_cancelled_also_after_a_restart() {
    let engine = Engine::new();
    let mut service = engine.service(2);
    with_field(&service);
    let id = service.submit("run", &flight(1, 4000));
    wait_for_processes(&service, true);
    service.restart();
    let dismissed = service.ask("DELETE", &format!("/jobs/{id}"), &[], b"").json();
    assert_eq!(dismissed["status"], "dismissed");
    wait_for_processes(&service, false);
    let folder = service.data.join("jobs").join(&id);
    wait_until("the files of a dismissed job are removed", || !exists(&folder));
    assert_eq!(engine.submitted().len(), 1);
}

/// A program that divides no run, else vlscan.
fn undividing(folder: &Path) -> String {
    use std::os::unix::fs::PermissionsExt as _;
    let program = folder.join("vlscan");
    let vlscan = crate::client::vlscan();
    let refusal = "case \"$*\" in *--shard*|*--resume*) echo 'error: not divisible' >&2; exit 4;; esac";
    std::fs::write(&program, format!("#!/bin/sh\n{refusal}\nexec {} \"$@\"\n", vlscan.display())).unwrap();
    std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
    format!("--program={}", program.display())
}

#[test]
fn what_cannot_be_divided_is_computed_as_a_whole() {
    let alone = Service::start(&[]);
    with_field(&alone);
    let expected = alone.run("run", &flight(1, 1));
    let expected = results(&alone, expected["jobID"].as_str().unwrap());
    let engine = Engine::new();
    let program = undividing(engine.folder.path());
    for mut options in [Vec::new(), engine.options(2)] {
        options.extend([program.clone(), "--no-sandbox".to_owned()]);
        let service = Service::start(&options.iter().map(String::as_str).collect::<Vec<_>>());
        with_field(&service);
        let job = service.run("run", &flight(1, 1));
        assert_eq!(job["status"], "successful", "{job}");
        assert!(results(&service, job["jobID"].as_str().unwrap()) == expected);
    }
    assert_eq!(engine.submitted().len(), 1);
}

#[test]
fn campaigns_are_divided_among_tasks_and_failures_are_told() {
    let engine = Engine::new();
    let service = engine.service(2);
    with_field(&service);
    service.upload_fixture("forest");
    let campaign = json!({
        "seeds": 2,
        "scene": [{ "name": "plot", "file": "forest/scene.xml", "area": "POLYGON ((-5 -5, 5 -5, 5 5, -5 5, -5 -5))" }],
        "variant": [{ "name": "drone", "plan": "airborne --scanner riegl_vux-1uav --height 60 --density 5" }],
    });
    let job = service.run("campaign", &campaign);
    assert_eq!(job["status"], "successful", "{job}");
    let manifest =
        service.get(&format!("/jobs/{}/results/dataset/manifest.jsonl", job["jobID"].as_str().unwrap()));
    assert_eq!(manifest.text().lines().count(), 2, "{}", manifest.text());
    let mut wrong = flight(1, 1);
    wrong["scene"] = json!("field/absent.obj");
    let job = service.run("run", &wrong);
    let message = job["message"].as_str().unwrap_or_default();
    assert!(job["status"] == "failed" && message.contains("absent.obj"), "{job}");
    assert!(!message.contains(service.data.to_str().unwrap()), "{message}");
    // Quick processes are computed by the service itself.
    let before = engine.submitted().len();
    let forecast = service.execute("dry-run", &flight(1, 1));
    assert_eq!(forecast.status, 200, "{}", forecast.text());
    assert_eq!(engine.submitted().len(), before);
}

#[test]
fn a_job_that_an_engine_loses_again_and_again_fails() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("log");
    // As tasks that are killed for lack of memory.
    let submit = format!("--submit=sh -c 'echo \"$0\" >>{}' {{name}} {{command}}", log.display());
    let service = Service::start(&[submit.as_str(), "--poll=true {name}", "--cancel=true {name}"]);
    with_field(&service);
    let job = service.run("run", &flight(1, 1));
    assert!(job["message"].as_str().unwrap().contains("5 times without results"), "{job}");
    assert_eq!(std::fs::read_to_string(log).unwrap().lines().count(), 5);
}

#[test]
fn a_service_without_the_engine_leaves_its_jobs_alone() {
    let engine = Engine::new();
    let mut service = engine.service(2);
    with_field(&service);
    service.submit("run", &flight(1, 4000));
    wait_for_processes(&service, true);
    service.kill();
    let said = refused(&service.data, &[]);
    assert!(said.contains("--submit, --poll and --cancel"), "{said}");
}

#[test]
fn commands_of_an_engine_are_checked_at_the_start() {
    let refused = |options: &[&str]| refused(tempfile::tempdir().unwrap().path(), options);
    assert!(refused(&["--submit", "a {command}"]).contains("--poll"));
    let said = refused(&["--submit", "a {comand}", "--poll", "b", "--cancel", "c"]);
    assert!(said.contains("--submit: {comand} is no placeholder; expected {name}"), "{said}");
    let said = refused(&["--submit", "a", "--poll", "/absent/poll {name}", "--cancel", "c"]);
    assert!(said.contains("--poll: /absent/poll"), "{said}");
}
