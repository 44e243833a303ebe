//! Limits of owners: disk and turns.

use crate::client::{Service, files_of, fixtures, vlscan};
use crate::jobs::{flight, with_field};
use serde_json::{Value, json};
use std::io::Write as _;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

fn wait_until(what: &str, is_so: impl Fn() -> bool) {
    let start = Instant::now();
    while !is_so() {
        assert!(start.elapsed() < Duration::from_secs(120), "{what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Bytes of all files below a folder, but for those that go meanwhile.
fn bytes_in(folder: &Path) -> u64 {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries
        .map(|entry| match entry.metadata() {
            Ok(about) if about.is_dir() => bytes_in(&entry.path()),
            about => about.map_or(0, |about| about.len()),
        })
        .sum()
}

fn with_output(path: &str) -> Value {
    let mut inputs = flight(1, 1);
    inputs["output"] = json!([{ "path": path }]);
    inputs
}

#[test]
fn failed_jobs_keep_no_files() {
    let service = Service::start(&["--max-disk", "200k"]);
    with_field(&service);
    let mut inputs = flight(1, 60);
    inputs["output"] = json!([{ "path": "a.xyz" }, { "path": "b.xyz" }]);
    let job = service.run("run", &inputs);
    assert_eq!(job["status"], "failed", "{job}");
    let folder = service.data.join("jobs").join(job["jobID"].as_str().unwrap());
    let names: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names, ["log"]);
    assert!(bytes_in(&folder) < 20_000, "{}", bytes_in(&folder));
    let page = service.ask(
        "GET",
        &format!("/jobs/{}", job["jobID"].as_str().unwrap()),
        &[("Accept", "text/html")],
        b"",
    );
    assert!(page.status == 200 && page.text().contains("state failed"), "{}", page.text());
}

#[test]
fn outputs_that_nobody_could_fetch_are_refused_and_all_others_are_served() {
    let service = Service::start(&[]);
    with_field(&service);
    for path in [
        ".hidden.xyz",
        ".h/points.xyz",
        "a/.b.laz",
        "-o.laz",
        "p?x=1.laz",
        "c:.laz",
        "<x>.laz",
        "a\nb.laz",
        "a\u{7f}.laz",
        "x.laz/",
        "./x.laz",
        "a//b.laz",
        " a.laz",
        &"a".repeat(121),
    ] {
        let answer = service.execute("run", &with_output(path));
        assert_eq!(answer.status, 400, "{path:?}: {}", answer.text());
        assert!(answer.text().contains("output.path"), "{}", answer.text());
        // In a pipeline file, too.
        let text = toml::to_string(&with_output(path)).unwrap();
        service.ask("DELETE", "/uploads/pipe", &[], b"");
        assert_eq!(service.upload("pipe", &[("p.toml", text.into_bytes())]).status, 201);
        assert_eq!(service.execute("run", &json!({ "pipeline": "pipe/p.toml" })).status, 400, "{path:?}");
    }
    for path in ["p#x.laz", "p%41 b.laz", "é&'$(id);.laz"] {
        let job = service.run("run", &with_output(path));
        assert_eq!(job["status"], "successful", "{path}: {job}");
        let results = service.json(&format!("/jobs/{}/results", job["jobID"].as_str().unwrap()));
        let files: Vec<&Value> = results.as_object().unwrap().values().collect();
        assert_eq!(files.len(), 1, "{results}");
        assert_eq!(service.get(files[0]["href"].as_str().unwrap()).status, 200, "{results}");
    }
}

#[test]
fn files_without_content_and_repeated_requests_count() {
    let service = Service::start(&["--workers", "0", "--max-stored", "200k"]);
    let names: Vec<String> = (0..20).map(|number| format!("f{number}")).collect();
    let files: Vec<(&str, Vec<u8>)> = names.iter().map(|name| (name.as_str(), Vec::new())).collect();
    assert_eq!(service.upload("one", &files).status, 201);
    assert_eq!(service.upload("two", &files).status, 201);
    let full = service.upload("three", &files);
    assert_eq!(full.status, 413, "{}", full.text());
    let mut answers = Vec::new();
    for number in 0..40 {
        let area = json!({ "type": "Polygon", "coordinates": [vec![[f64::from(number), 1.5]; 500]] });
        let plan = json!({ "kind": "airborne", "scanner": "riegl_vux-1uav", "height": 60, "density": 5, "area": area });
        let headers = [("Prefer", "respond-async")];
        let answer = service.post_json("/processes/plan/execution", &json!({ "inputs": plan }), &headers);
        answers.push(answer.status);
    }
    assert!(answers[0] == 201 && answers.ends_with(&[403]), "{answers:?}");
}

#[test]
fn finished_jobs_expire_where_the_operator_says_so() {
    let service = Service::start(&["--keep", "0.00002"]);
    with_field(&service);
    let job = service.run("run", &flight(1, 1));
    let id = job["jobID"].as_str().unwrap();
    wait_until("the job expires", || {
        matches!(service.get(&format!("/jobs/{id}")).status, 404 | 410)
            || service.json(&format!("/jobs/{id}"))["status"] == "dismissed"
    });
    wait_until("its files go", || !service.data.join("jobs").join(id).exists());
    assert_eq!(service.get("/uploads/field").status, 200);
}

/// A service whose program is a shell script for all but what a start asks.
fn scripted(folder: &Path, script: &str, options: &[&str]) -> Service {
    let program = folder.join("program");
    let vlscan = vlscan();
    let asked = "case \"$*\" in catalogue*|*' man '*)";
    let script = format!("#!/bin/sh\n{asked} exec {} \"$@\";; esac\n{script}\n", vlscan.display());
    std::fs::write(&program, script).unwrap();
    std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
    Service::start(
        &[&[format!("--program={}", program.display()).as_str(), "--no-sandbox"], options].concat(),
    )
}

#[test]
fn deleted_files_that_a_job_writes_are_limited() {
    let folder = tempfile::tempdir().unwrap();
    let script = "exec 3>../tmp/f; rm ../tmp/f; while :; do head -c 1000000 /dev/zero >&3; sleep 0.05; done";
    let service = scripted(folder.path(), script, &["--max-disk", "3M"]);
    with_field(&service);
    let job = service.run("dry-run", &flight(1, 1));
    assert!(job["message"].as_str().unwrap().contains("more than 3000000 bytes"), "{job}");
}

#[test]
fn deleted_files_that_a_job_maps_are_limited() {
    let folder = tempfile::tempdir().unwrap();
    let python = "import mmap, os, time\nf = open('../tmp/f', 'w+b'); f.truncate(1 << 20); m = mmap.mmap(f.fileno(), 4096)\n\
                  os.closerange(3, 1000); os.unlink('../tmp/f'); time.sleep(60)";
    let script = format!("exec python3 -c \"{python}\"");
    let service = scripted(folder.path(), &script, &["--max-disk", "3M"]);
    with_field(&service);
    let job = service.run("dry-run", &flight(1, 1));
    assert!(job["message"].as_str().unwrap().contains("maps deleted files"), "{job}");
}

#[test]
fn folders_that_cannot_be_read_are_removed() {
    let folder = tempfile::tempdir().unwrap();
    // Root reads them all the same.
    let script =
        "mkdir -p ../tmp/a/b ../out/c; : >../tmp/a/b/f; chmod 0 ../tmp/a/b ../tmp/a ../out/c; exit 3";
    let mut service = scripted(folder.path(), script, &[]);
    with_field(&service);
    let job = service.run("dry-run", &flight(1, 1));
    assert_eq!(job["status"], "failed", "{job}");
    service.wait_until_incoming_is_empty("the files of the job go");
    let closed = service.data.join("incoming/0123456789abcdef/inner");
    std::fs::create_dir_all(&closed).unwrap();
    for folder in [closed.as_path(), closed.parent().unwrap()] {
        std::fs::set_permissions(folder, std::fs::Permissions::from_mode(0o0)).unwrap();
    }
    service.restart();
    service.wait_until_incoming_is_empty("a start removes them");
}

#[test]
fn a_job_ends_where_its_owner_has_no_room_left() {
    let service = Service::start(&["--max-stored", "5M"]);
    with_field(&service);
    let mut inputs = flight(1, 60);
    inputs["output"] = json!([{ "path": "a.xyz" }]);
    let job = service.run("run", &inputs);
    assert_eq!(job["status"], "failed", "{job}");
    assert!(job["message"].as_str().unwrap().contains("more than 5000000 bytes"), "{job}");
    // Its files are gone, and there is room again.
    assert_eq!(service.run("run", &flight(1, 1))["status"], "successful");
}

#[test]
fn uploads_that_are_received_count() {
    let service = Service::start(&["--workers", "0", "--max-stored", "2M"]);
    let begin = |bytes: usize| {
        let mut stream = std::net::TcpStream::connect(&service.address).unwrap();
        let head = format!(
            "POST /uploads HTTP/1.1\r\nHost: {}\r\nContent-Type: multipart/form-data; boundary=b\r\nContent-Length: 9000000\r\n\r\n\
             --b\r\nContent-Disposition: form-data; name=\"file\"; filename=\"a.obj\"\r\n\r\n",
            service.address
        );
        stream.write_all(head.as_bytes()).unwrap();
        stream.write_all(&vec![b' '; bytes]).unwrap();
        stream
    };
    let streams = [begin(900_000), begin(900_000)];
    let incoming = service.data.join("incoming");
    wait_until("the uploads arrive", || bytes_in(&incoming) > 1_700_000);
    let upload = || service.upload("more", &[("a.obj", vec![b' '; 400_000])]).status;
    wait_until("uploads that are received count", || upload() == 413);
    drop(streams);
    wait_until("uploads that end early do not", || upload() == 201);
    // An archive is expanded within what is left.
    let full = archive(&[("a.obj".to_owned(), vec![b' '; 5_000_000])]);
    let refused = service.upload("zip", &[("a.zip", full)]);
    assert!(
        refused.status == 413 && refused.text().contains("more than 2000000 bytes"),
        "{}",
        refused.text()
    );
}

#[test]
fn a_drawing_keeps_its_turn_although_its_connection_ends() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("log");
    let name = log.display();
    let service =
        scripted(folder.path(), &format!("echo start >>{name}\nsleep 1\necho end >>{name}\nexit 1"), &[]);
    with_field(&service);
    let path = "/map.png?scene=field/field.obj";
    let mut stream = std::net::TcpStream::connect(&service.address).unwrap();
    write!(stream, "GET {path} HTTP/1.1\r\nHost: {}\r\n\r\n", service.address).unwrap();
    wait_until("the drawing starts", || log.exists());
    drop(stream);
    assert_eq!(service.get(path).status, 404);
    assert_eq!(std::fs::read_to_string(log).unwrap(), "start\nend\nstart\nend\n");
}

#[test]
fn owners_draw_the_same_scene_at_the_same_time() {
    let owners = Owners::new();
    let draw = |token: &str| ask(&owners.service, token, "GET", "/map.png?scene=field/field.obj", &json!({}));
    std::thread::scope(|scope| {
        let tokens = [&owners.anna, &owners.ben, &owners.anna, &owners.ben];
        let drawn = tokens.map(|token| scope.spawn(|| draw(token)));
        for drawn in drawn {
            let drawn = drawn.join().unwrap();
            assert!(drawn.status == 200 && drawn.body.starts_with(b"\x89PNG"), "{}", drawn.text());
        }
    });
    let data = &owners.service.data;
    assert_eq!(std::fs::read_dir(data.join("maps")).unwrap().count(), 2, "a picture for each");
    owners.service.wait_until_incoming_is_empty("drawings leave nothing");
}

#[test]
fn a_process_that_is_always_killed_is_started_three_times() {
    let folder = tempfile::tempdir().unwrap();
    let starts = folder.path().join("starts");
    let service = scripted(folder.path(), &format!("echo x >>{}\nkill -9 $$", starts.display()), &[]);
    with_field(&service);
    let job = service.run("dry-run", &flight(1, 1));
    assert!(job["message"].as_str().unwrap().contains("memory"), "{job}");
    assert_eq!(std::fs::read_to_string(starts).unwrap().lines().count(), 3);
}

/// A request of an owner, who has a token.
fn ask(service: &Service, token: &str, method: &str, path: &str, body: &Value) -> crate::client::Answer {
    let bearer = format!("Bearer {token}");
    let headers = [
        ("Authorization", bearer.as_str()),
        ("Content-Type", "application/json"),
        ("Prefer", "respond-async"),
    ];
    service.ask_stranger(method, path, &headers, body.to_string().as_bytes())
}

/// A service for two owners who have a field each, and their tokens.
struct Owners {
    service: Service,
    anna: String,
    ben: String,
    _folder: tempfile::TempDir,
}

impl Owners {
    fn new() -> Owners {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("tokens");
        let token = |owner: &str| {
            let made =
                Command::new(env!("CARGO_BIN_EXE_vlscan-serve")).args(["token", owner]).output().unwrap();
            let mut tokens = std::fs::File::options().create(true).append(true).open(&file).unwrap();
            tokens.write_all(&made.stdout).unwrap();
            String::from_utf8(made.stderr).unwrap().trim().rsplit(' ').next().unwrap().to_owned()
        };
        let (anna, ben) = (token("anna"), token("ben"));
        let service = Service::start(&["--token-file", file.to_str().unwrap()]);
        let owners = Owners { service, anna, ben, _folder: folder };
        for owner in [&owners.anna, &owners.ben] {
            assert_eq!(owners.upload(owner, "field"), 201);
        }
        owners
    }

    fn upload(&self, token: &str, name: &str) -> u16 {
        let corners = "v -50 -50 0\nv 50 -50 0\nv 50 50 0\nv -50 50 0\nf 1 2 3 4\n";
        let (media, body) = crate::client::form(name, &[("field.obj", corners.into())]);
        let bearer = format!("Bearer {token}");
        let headers = [("Authorization", bearer.as_str()), ("Content-Type", media.as_str())];
        self.service.ask_stranger("POST", "/uploads", &headers, &body).status
    }
}

#[test]
fn uploads_of_an_owner_that_do_not_end_leave_room_for_others() {
    let owners = Owners::new();
    let begin = || {
        let mut stream = std::net::TcpStream::connect(&owners.service.address).unwrap();
        let head = format!(
            "POST /uploads HTTP/1.1\r\nHost: {}\r\nAuthorization: Bearer {}\r\nContent-Type: multipart/form-data; boundary=b\r\n\
             Content-Length: 100000\r\n\r\n--b\r\n",
            owners.service.address, owners.anna
        );
        stream.write_all(head.as_bytes()).unwrap();
        stream
    };
    let streams: Vec<_> = (0..20).map(|_| begin()).collect();
    wait_until("anna has her share", || owners.upload(&owners.anna, "more") == 429);
    assert_eq!(owners.upload(&owners.ben, "more"), 201);
    drop(streams);
    wait_until("connections that end give their places back", || owners.upload(&owners.anna, "again") == 201);
}

#[test]
fn an_owner_who_floods_the_service_does_not_stop_others() {
    let owners = Owners::new();
    let Owners { service, anna, ben, .. } = &owners;
    let submit = |token: &str, process: &str, inputs: &Value| {
        let path = format!("/processes/{process}/execution");
        let answer = ask(service, token, "POST", &path, &json!({ "inputs": inputs }));
        assert_eq!(answer.status, 201, "{}", answer.text());
        answer.json()["jobID"].as_str().unwrap().to_owned()
    };
    let status = |token: &str, id: &str| {
        ask(service, token, "GET", &format!("/jobs/{id}"), &json!({})).json()["status"]
            .as_str()
            .unwrap()
            .to_owned()
    };
    let long: Vec<String> = (0..20).map(|seed| submit(anna, "run", &flight(seed, 4000))).collect();
    for seed in 0..20 {
        submit(anna, "dry-run", &flight(seed, 4000));
    }
    wait_until("a run of anna is computed", || long.iter().any(|id| status(anna, id) == "running"));
    // Neither her runs nor her forecasts are before his.
    let plan = json!({ "kind": "airborne", "scene": "field/field.obj", "scanner": "riegl_vux-1uav", "height": 60, "density": 5 });
    let start = Instant::now();
    let plan = submit(ben, "plan", &plan);
    wait_until("the plan of ben", || status(ben, &plan) == "successful");
    assert!(start.elapsed() < Duration::from_secs(30), "the plan of ben took {:?}", start.elapsed());
    let forecast = submit(ben, "dry-run", &flight(1, 1));
    wait_until("the forecast of ben", || status(ben, &forecast) == "successful");
    assert!(long.iter().any(|id| status(anna, id) == "running"));
    let run = submit(ben, "run", &flight(1, 1));
    let first = long.iter().find(|id| status(anna, id) == "running").unwrap();
    ask(service, anna, "DELETE", &format!("/jobs/{first}"), &json!({}));
    wait_until("the run of ben, whose turn it is", || status(ben, &run) == "successful");
    assert!(long.iter().any(|id| status(anna, id) == "accepted"));
}

fn archive(files: &[(String, Vec<u8>)]) -> Vec<u8> {
    let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, content) in files {
        zip.start_file(name.as_str(), zip::write::SimpleFileOptions::default()).unwrap();
        zip.write_all(content).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

#[test]
fn an_upload_lists_the_files_that_are_missing_in_it() {
    let service = Service::start(&["--workers", "0"]);
    let files: Vec<_> = files_of(&fixtures().join("forest"))
        .into_iter()
        .filter(|(name, _)| !["beech.obj", "scanners.xml"].contains(name))
        .collect();
    assert_eq!(service.upload("forest", &files).status, 201);
    assert_eq!(service.json("/uploads/forest")["missing"], json!(["beech.obj", "scanners.xml"]));
    let page = service.ask("GET", "/uploads/forest", &[("Accept", "text/html")], b"").text();
    assert!(page.contains("<code>beech.obj</code>") && page.contains("one zip archive"), "{page}");
}

/// The folder `data` of HELIOS++ as users zip it: with it, in folders, or what is in it.
#[test]
fn archives_of_helios_folders_are_found_whatever_folder_they_are_in() {
    let service = Service::start(&[]);
    let fixture = files_of(&fixtures().join("forest"));
    let text = |name: &str| {
        let (_, bytes) = fixture.iter().find(|(known, _)| *known == name).unwrap();
        String::from_utf8(bytes.clone()).unwrap()
    };
    let survey = text("survey.xml")
        .replace(" paths=\"beside\"", "")
        .replace("scene.xml#", "data/scenes/forest.xml#")
        .replace("platforms.xml#plane", "data/platforms.xml#sr22")
        .replace("scanners.xml#als_polygon", "data/scanners_als.xml#riegl_vux-1uav");
    let mut scene = text("scene.xml");
    for (name, _) in fixture.iter().filter(|(name, _)| name.ends_with(".obj")) {
        scene = scene.replace(&format!("\"{name}\""), &format!("\"data/sceneparts/{name}\""));
    }
    for (name, folder) in [("plain", ""), ("one", "myproject/"), ("two", "a/b/"), ("mac", "My Project 2/")] {
        let mut files = vec![
            (format!("{folder}data/surveys/demo/forest.xml"), survey.clone().into_bytes()),
            (format!("{folder}data/scenes/forest.xml"), scene.clone().into_bytes()),
        ];
        for (file, bytes) in
            fixture.iter().filter(|(name, _)| name.ends_with(".obj") || name.ends_with(".mtl"))
        {
            files.push((format!("{folder}data/sceneparts/{file}"), bytes.clone()));
        }
        let answer = service.upload(name, &[("h.zip", archive(&files))]);
        assert_eq!(answer.status, 201, "{}", answer.text());
        let list = service.json(&format!("/uploads/{name}"))["list"].clone();
        let found = list.as_array().unwrap().iter().find(|file| file["kind"] == "survey").unwrap();
        assert_eq!(service.json(&format!("/uploads/{name}"))["missing"], json!([]), "{list}");
        let path = format!("{name}/{}", found["path"].as_str().unwrap());
        let job = service.run("dry-run", &json!({ "survey": path }));
        assert_eq!(job["status"], "successful", "{path}: {job}");
    }
}

#[test]
fn uploads_take_the_place_of_no_instrument() {
    let service = Service::start(&[]);
    with_field(&service);
    let hostile = b"<document><scanner id=\"riegl_vux-1uav\" name=\"another\"/></document>".to_vec();
    let taken = service.upload("data", &[("scanners_als.xml", hostile.clone())]);
    assert_eq!(taken.status, 400, "{}", taken.text());
    let (media, body) = crate::client::form("", &[("data/scanners_als.xml", hostile.clone())]);
    let answer = service.ask("POST", "/uploads", &[("Content-Type", &media)], &body);
    assert!(answer.status == 201 && answer.json()["name"] != "data", "{}", answer.text());
    // Words of a request that are names of uploads are no files of them.
    assert_eq!(service.upload("airborne", &[("data/scanners_als.xml", hostile.clone())]).status, 201);
    assert_eq!(service.upload("riegl_vux-1uav", &[("data/scanners_als.xml", hostile)]).status, 201);
    // The scene and files of the catalogue's names in one upload, whose folders are searched.
    let (scanners, platforms) = (
        b"<document><scanner id='riegl_vux-1uav'/></document>".to_vec(),
        b"<document><platform id='copter_linearpath'/></document>".to_vec(),
    );
    let files = [
        ("a/field.obj", b"v -50 -50 0\nv 50 -50 0\nv 50 50 0\nv -50 50 0\nf 1 2 3 4\n".to_vec()),
        ("data/scanners_als.xml", scanners.clone()),
        ("data/platforms.xml", platforms.clone()),
        ("a/data/scanners_als.xml", scanners.clone()),
        ("scanners_als.xml", scanners.clone()),
        ("riegl_vux-1uav", scanners),
        ("a/copter_linearpath", platforms),
    ];
    let (media, body) = crate::client::form("wood", &files);
    assert_eq!(service.ask("POST", "/uploads", &[("Content-Type", &media)], &body).status, 201);
    for scanner in ["riegl_vux-1uav", "data/scanners_als.xml#riegl_vux-1uav"] {
        for scene in ["field/field.obj", "wood/a/field.obj"] {
            let plan =
                json!({ "kind": "airborne", "scene": scene, "scanner": scanner, "height": 60, "density": 5 });
            let job = service.run("plan", &plan);
            assert_eq!(job["status"], "successful", "{scanner}: {job}");
            let plan = format!("jobs/{}/plan.toml", job["jobID"].as_str().unwrap());
            let job = service.run("dry-run", &json!({ "pipeline": plan }));
            assert_eq!(job["status"], "successful", "{scanner}: {job}");
            let mut run = flight(1, 1);
            run["scene"] = json!(scene);
            run["scanner"] = json!({ "catalogue": scanner });
            let job = service.run("dry-run", &run);
            assert_eq!(job["status"], "successful", "{scanner}: {job}");
        }
    }
}

#[test]
fn areas_of_many_corners_are_read_from_files() {
    let service = Service::start(&[]);
    with_field(&service);
    let corners = |number: u32| {
        let at = |corner: u32| {
            let angle = std::f64::consts::TAU * f64::from(corner) / f64::from(number);
            format!("{:.25} {:.25}", 20.0 * angle.cos(), 20.0 * angle.sin())
        };
        let all: Vec<String> = (0..number).chain([0]).map(at).collect();
        format!("POLYGON (({}))", all.join(", "))
    };
    let plan = |area: String| {
        json!({
            "kind": "airborne", "scene": "field/field.obj", "scanner": "riegl_vux-1uav", "height": 60, "density": 5, "area": area,
        })
    };
    // The last one is longer than words of Linux.
    for number in [4, 200, 2500] {
        let job = service.run("plan", &plan(corners(number)));
        assert_eq!(job["status"], "successful", "{number}: {job}");
    }
    let long = json!({ "first": "field/a.laz", "second": format!("field/{}", "b".repeat(200_000)) });
    let answer = service.execute("compare", &long);
    assert!(answer.status == 400 && answer.text().contains("upload it as a file"), "{}", answer.status);
}
