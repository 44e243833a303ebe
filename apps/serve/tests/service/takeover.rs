//! A program in place of vlscan that tries to leave its sandbox (`takeover.c`): as the user of the tests,
//! and, if that is root, as another user, too.

use crate::client::{Service, files_of, fixtures, vlscan};
use crate::jobs::{flight, wait_for_processes};
use serde_json::json;
use std::io::Read as _;
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

const TOKEN: &str = "a-token-that-nobody-guesses";
const NOBODY: &str = "65534";

/// A service whose program is hostile, and what it may not reach.
struct Stage {
    service: Service,
    secret: PathBuf,
    socket: UnixListener,
    _folder: tempfile::TempDir,
}

fn is_root() -> bool {
    nix::unistd::geteuid().is_root()
}

impl Stage {
    fn new(as_nobody: bool) -> Stage {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let open = |path: &Path, mode: u32| {
            std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).unwrap();
        };
        // Where another user can execute them, and everybody could reach what the sandbox should close.
        open(folder.path(), 0o777);
        for (from, name) in
            [(PathBuf::from(env!("CARGO_BIN_EXE_vlscan-serve")), "vlscan-serve"), (vlscan(), "real-vlscan")]
        {
            std::fs::copy(from, at(name)).unwrap();
            open(&at(name), 0o755);
        }
        std::fs::write(at("secret"), "a secret word").unwrap();
        open(&at("secret"), 0o666);
        let socket = UnixListener::bind(at("socket")).unwrap();
        open(&at("socket"), 0o777);
        let start = |program: &Path| {
            let mut command = match as_nobody {
                true => {
                    let mut command = Command::new("setpriv");
                    let user = [format!("--reuid={NOBODY}"), format!("--regid={NOBODY}")];
                    command.args(user).arg("--clear-groups").arg(program);
                    command
                }
                false => Command::new(program),
            };
            command.current_dir(folder.path());
            command
        };
        let held = start(&at("vlscan-serve")).arg("confine").output().unwrap();
        let held: serde_json::Value = serde_json::from_slice(&held.stdout).unwrap();
        assert!(held["files"] == true && held["calls"] == true && held["tcp"] == true, "{held}");
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let text = |path: PathBuf| format!("\"{}\"", path.display());
        let built = Command::new("cc")
            .args(["-O1", "-w", "-pthread", "-o"])
            .arg(at("vlscan"))
            .arg(format!("-DVLSCAN={}", text(at("real-vlscan"))))
            .arg(format!("-DSECRET={}", text(at("secret"))))
            .arg(format!("-DSOCKET={}", text(at("socket"))))
            .arg(format!("-DPORT={}", listener.local_addr().unwrap().port()))
            .arg(format!("-DHAS_ROOT={}", u8::from(held["root"] == true)))
            .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/service/takeover.c"))
            .status();
        assert!(built.unwrap().success(), "the hostile program is compiled by cc");
        open(&at("vlscan"), 0o755);
        let program = format!("--program={}", at("vlscan").display());
        let options = [program.as_str(), "--quota", "1M", "--max-time", "120"];
        let service = Service::by(start(&at("vlscan-serve")), &at("data"), &options, Some(TOKEN));
        assert_eq!(service.upload("room", &files_of(&fixtures().join("room"))).status, 201);
        Stage { service, secret: at("secret"), socket, _folder: folder }
    }

    /// Nothing has reached what lies outside.
    fn is_untouched(&self) {
        assert_eq!(std::fs::read_to_string(&self.secret).unwrap(), "a secret word");
        let mode = std::fs::metadata(&self.secret).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o666);
        self.socket.set_nonblocking(true).unwrap();
        assert!(self.socket.accept().is_err(), "somebody has connected");
    }
}

fn hold(as_nobody: bool) {
    let stage = Stage::new(as_nobody);
    let service = &stage.service;
    let plan = json!({
        "kind": "airborne", "scene": "room/scene.xml", "scanner": "riegl_vux-1uav", "height": 60, "density": 10, "overlap": 30,
    });
    let answer = service.execute("plan", &plan);
    assert_eq!(answer.status, 200, "{}", answer.text());
    let id = service.json("/jobs")["jobs"][0]["jobID"].as_str().unwrap().to_owned();
    let report = service.get(&format!("/jobs/{id}/results/report.txt")).text();
    let breaches: Vec<&str> = report.lines().filter(|line| !line.starts_with("held ")).collect();
    assert_eq!(breaches, ["allowed a thread", "end"], "{report}");
    assert!(report.lines().count() > 120, "{report}");
    // Names that lead elsewhere are neither listed nor served.
    let results = service.json(&format!("/jobs/{id}/results"));
    for name in ["folder", "pipe.json", "log"] {
        assert!(results.get(name).is_none(), "{results}");
        assert_eq!(service.get(&format!("/jobs/{id}/results/{name}")).status, 404);
    }
    wait_for_processes(service, false);
    stage.is_untouched();
    let map = service.get("/map.png?scene=room/scene.xml");
    assert!(map.status >= 400 && !map.text().contains("secret word"), "{}", map.text());
    stage.is_untouched();
    // The price of a run, and a run that does not end with the service.
    let run = service.submit(
        "run",
        &flight(1, 1)
            .as_object()
            .map(|inputs| {
                let mut inputs = inputs.clone();
                inputs.insert("scene".to_owned(), json!("room/scene.xml"));
                serde_json::Value::Object(inputs)
            })
            .unwrap(),
    );
    let alive = service.data.join("jobs").join(run).join("tmp/alive");
    let start = Instant::now();
    while !alive.exists() {
        assert!(
            start.elapsed() < Duration::from_secs(60),
            "the run does not start: {}",
            service.get("/jobs").text()
        );
        std::thread::sleep(Duration::from_millis(10));
    }
    stage.is_untouched();
    let mut stage = stage;
    stage.service.kill();
    wait_for_processes(&stage.service, false);
    let bytes = || {
        let mut text = String::new();
        std::fs::File::open(&alive).unwrap().read_to_string(&mut text).unwrap();
        text.len()
    };
    let ended = bytes();
    std::thread::sleep(Duration::from_millis(200));
    assert_eq!(bytes(), ended, "it outlives the service");
    stage.is_untouched();
}

#[test]
fn a_program_that_was_taken_over_does_not_leave_its_sandbox() {
    hold(false);
    if is_root() {
        hold(true);
    }
}

/// Links that a job has left, as a process without a filter of calls could, lead nowhere.
#[test]
fn links_in_the_folder_of_a_job_are_not_followed() {
    let service = Service::start(&[]);
    service.upload_fixture("room");
    let folder = tempfile::tempdir().unwrap();
    let secret = folder.path().join("secret.txt");
    std::fs::write(&secret, "a secret word").unwrap();
    let job = service.run("dry-run", &json!({ "survey": "room/survey.xml" }));
    let id = job["jobID"].as_str().unwrap();
    let out = service.data.join("jobs").join(id).join("out");
    assert_eq!(service.get(&format!("/jobs/{id}/results/report.json")).status, 200);
    std::fs::remove_file(out.join("report.json")).unwrap();
    std::os::unix::fs::symlink(&secret, out.join("report.json")).unwrap();
    for path in
        [format!("/jobs/{id}/results/report.json"), format!("/jobs/{id}/results"), format!("/jobs/{id}")]
    {
        assert!(!service.get(&path).text().contains("secret word"), "{path}");
    }
    let map = service.get("/map.png?scene=room/scene.xml");
    assert_eq!(map.status, 200, "{}", map.text());
    let maps = std::fs::read_dir(service.data.join("maps")).unwrap().flatten().next().unwrap().path();
    for name in ["map.png", "map.pgw"] {
        let picture = maps.join(name);
        std::fs::remove_file(&picture).unwrap();
        std::os::unix::fs::symlink(&secret, &picture).unwrap();
        let map = service.get("/map.png?scene=room/scene.xml");
        assert!(!map.text().contains("secret word"), "{name}");
    }
    assert_eq!(std::fs::read_to_string(&secret).unwrap(), "a secret word");
}
