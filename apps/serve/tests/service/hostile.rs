//! Hostile input: requests of strangers and of pages of other sites, names and files that lead
//! elsewhere, damaged files. Nothing of it yields an error of the service (5xx), or a byte that is not the
//! sender's.

use crate::client::{Answer, Service, files_of, fixtures, form};
use serde_json::{Value, json};
use std::io::Write as _;
use std::path::Path;

const TOKEN: &str = "a-token-that-nobody-guesses";

#[test]
fn strangers_get_nothing() {
    let service = Service::with_token(&["--workers", "0"], TOKEN);
    for (method, path) in [
        ("GET", "/"),
        ("GET", "/jobs"),
        ("GET", "/uploads"),
        ("GET", "/processes"),
        ("GET", "/new"),
        ("GET", "/api"),
        ("POST", "/uploads"),
        ("POST", "/processes/run/execution"),
        ("POST", "/forms/run"),
        ("DELETE", "/jobs/x"),
        ("GET", "/jobs/x/results/y"),
        ("GET", "/uploads/x/files/y"),
        ("GET", "/nothing"),
    ] {
        assert_eq!(service.ask_stranger(method, path, &[], b"").status, 401, "{method} {path}");
        let wrong = service.ask_stranger(
            method,
            path,
            &[("Authorization", "Bearer a-token-that-somebody-guesses")],
            b"",
        );
        assert_eq!(wrong.status, 401, "{method} {path}");
    }
    assert_eq!(service.get("/jobs").status, 200);
    // Browsers are led to the form.
    let page = service.ask_stranger("GET", "/", &[("Accept", "text/html")], b"");
    assert_eq!((page.status, page.header("location")), (303, "/login"));
    let wrong = service.ask_stranger(
        "POST",
        "/login",
        &[("Content-Type", "application/x-www-form-urlencoded")],
        b"token=no",
    );
    assert_eq!(wrong.status, 403);
    let media = ("Content-Type", "application/x-www-form-urlencoded");
    let login = service.ask_stranger("POST", "/login", &[media], format!("token={TOKEN}").as_bytes());
    assert_eq!(login.status, 303);
    let cookie = login.header("set-cookie").split(';').next().unwrap().to_owned();
    assert!(!cookie.contains(TOKEN));
    let home = service.ask_stranger("GET", "/", &[("Accept", "text/html"), ("Cookie", &cookie)], b"");
    assert!(home.status == 200 && home.text().contains("Log out admin"));
    // With a cookie alone, a form needs the page's own field.
    let forged = service.ask_stranger("POST", "/forms/logout", &[media, ("Cookie", &cookie)], b"csrf=0");
    assert_eq!(forged.status, 403);
    let (form_media, body) = form("x", &[("a.obj", b"v 0 0 0".to_vec())]);
    let forged = service.ask_stranger(
        "POST",
        "/uploads",
        &[("Content-Type", &form_media), ("Cookie", &cookie)],
        &body,
    );
    assert_eq!(forged.status, 403);
}

#[test]
fn pages_of_other_sites_change_nothing() {
    let service = Service::start(&["--workers", "0"]);
    let (media, body) = form("x", &[("a.obj", b"v 0 0 0".to_vec())]);
    for headers in [
        vec![("Origin", "https://example.org")],
        vec![("Origin", "null")],
        vec![("Sec-Fetch-Site", "cross-site")],
        vec![("Sec-Fetch-Site", "same-site")],
    ] {
        let with_media = [&[("Content-Type", media.as_str())], headers.as_slice()].concat();
        assert_eq!(service.ask("POST", "/uploads", &with_media, &body).status, 403, "{headers:?}");
        assert_eq!(service.ask("DELETE", "/uploads/x", &headers, b"").status, 403, "{headers:?}");
        let as_form = [&[("Content-Type", "application/x-www-form-urlencoded")], headers.as_slice()].concat();
        assert_eq!(service.ask("POST", "/forms/run", &as_form, b"file=a").status, 403, "{headers:?}");
    }
    // A name of another site that leads to this machine.
    assert_eq!(service.ask_stranger("GET", "/uploads", &[("Host", "example.org")], b"").status, 421);
    assert_eq!(service.ask_stranger("GET", "/uploads", &[("Host", "localhost:1")], b"").status, 200);
    assert_eq!(service.json("/uploads")["uploads"], json!([]));
}

#[test]
fn answers_have_the_headers_of_a_closed_house() {
    let service = Service::start(&["--workers", "0"]);
    for path in ["/", "/new", "/static/style.css", "/nothing", "/jobs/x", "/instruments/0"] {
        let answer = service.ask("GET", path, &[("Accept", "text/html")], b"");
        let policy = answer.header("content-security-policy");
        assert!(
            policy.contains("default-src 'self'") && policy.contains("frame-ancestors 'none'"),
            "{path}: {policy}"
        );
        assert_eq!(answer.header("x-content-type-options"), "nosniff", "{path}");
        assert_eq!(answer.header("x-frame-options"), "DENY", "{path}");
    }
    let picture = service.get("/instruments/0/pattern.svg");
    assert_eq!((picture.status, picture.header("content-type")), (200, "image/svg+xml"));
    assert!(picture.header("content-security-policy").contains("sandbox"));
}

#[test]
fn an_address_that_others_reach_needs_tokens() {
    let start = |options: &[&str]| {
        let folder = tempfile::tempdir().unwrap();
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_vlscan-serve"));
        command
            .args(options)
            .arg("--program")
            .arg(crate::client::vlscan())
            .arg("--data")
            .arg(folder.path().join("data"));
        let done = command.env_remove("VLSCAN_TOKEN").output().unwrap();
        assert!(!done.status.success() && !folder.path().join("data").exists());
        String::from_utf8_lossy(&done.stderr).into_owned()
    };
    // A token that is not text lets nobody in.
    use std::os::unix::ffi::OsStrExt as _;
    let folder = tempfile::tempdir().unwrap();
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_vlscan-serve"));
    command.args(["--listen", "127.0.0.1:0", "--data"]).arg(folder.path().join("data"));
    command.env("VLSCAN_TOKEN", std::ffi::OsStr::from_bytes(b"secret\xff"));
    let done = command.arg("--program").arg(crate::client::vlscan()).output().unwrap();
    let told = String::from_utf8_lossy(&done.stderr);
    assert!(!done.status.success() && told.contains("VLSCAN_TOKEN is not valid UTF-8"), "{told}");
    let told = start(&["--listen", "0.0.0.0:0"]);
    assert!(told.contains("needs tokens") && told.contains("vlscan serve token"), "{told}");
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(&file, "anna").unwrap();
    let told = start(&["--token-file", file.path().to_str().unwrap()]);
    assert!(told.contains("line 1"), "{told}");
    // Tokens that were asked for and are missing let nobody in.
    for text in ["", "# anna sha256:00\n\n"] {
        std::fs::write(&file, text).unwrap();
        for more in [&[][..], &["--host", "scans.example.org"]] {
            let options = [&["--token-file", file.path().to_str().unwrap()], more].concat();
            let told = start(&options);
            assert!(told.contains("has no tokens") && told.contains("vlscan serve token"), "{told}");
        }
    }
    let told = start(&["--host", "localhost", "--host", "scans.example.org"]);
    assert!(told.contains("--host scans.example.org") && told.contains("--open"), "{told}");
    for options in [
        &["--open", "--host", "scans.example.org", "--no-sandbox"][..],
        &["--open", "--host", "scans.example.org", "--listen", "0.0.0.0:0"],
        &["--open", "--host", "scans.example.org", "--token-file", "tokens"],
        &["--open"],
        &["--host", ""],
    ] {
        start(options);
    }
    let made = std::process::Command::new(env!("CARGO_BIN_EXE_vlscan-serve"))
        .args(["token", "anna"])
        .output()
        .unwrap();
    std::fs::write(&file, &made.stdout).unwrap();
    let told = start(&["--token-file", file.path().to_str().unwrap(), "--no-sandbox"]);
    assert!(told.contains("--no-sandbox"), "{told}");
}

#[test]
fn requests_that_name_very_many_files_are_refused() {
    let service = Service::start(&["--workers", "0"]);
    let names: Vec<String> = (0..10_001).map(|number| format!("u{number}/a")).collect();
    let refused = service.execute("run", &json!({ "scene": names }));
    assert!(refused.status == 400 && refused.text().contains("more than 10000 words"), "{}", refused.text());
    let pipeline = format!("scene = \"{}\"\n", names.join(" "));
    assert_eq!(service.upload("many", &[("p.toml", pipeline.into_bytes())]).status, 201);
    let refused = service.execute("run", &json!({ "pipeline": "many/p.toml" }));
    assert!(refused.status == 400 && refused.text().contains("more than 10000 words"), "{}", refused.text());
}

#[test]
fn a_service_without_tokens_is_not_reached_through_a_proxy_by_accident() {
    let through_proxy = |options: &[&str]| {
        let service = Service::start(&[&["--workers", "0"], options].concat());
        service.ask("GET", "/uploads", &[("X-Forwarded-For", "203.0.113.7")], b"")
    };
    let refused = through_proxy(&[]);
    assert!(refused.status == 403 && refused.text().contains("no tokens"), "{}", refused.text());
    assert_eq!(through_proxy(&["--host", "localhost"]).status, 403);
    assert_eq!(through_proxy(&["--host", "scans.example.org", "--open"]).status, 200);
}

/// A file outside of the service, which no answer may contain.
fn secret() -> (tempfile::TempDir, String) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("secret.obj"), "v 0 0 0\nv 9 0 0\nv 0 9 0\nf 1 2 3\n# a secret word\n")
        .unwrap();
    std::fs::write(folder.path().join("secret.xml"), "a secret word").unwrap();
    let path = folder.path().to_str().unwrap().to_owned();
    (folder, path)
}

/// Every key that may name a file, with a name that leads out, is refused before a job is accepted.
#[test]
fn names_in_requests_lead_nowhere() {
    let service = Service::start(&["--workers", "0"]);
    service.upload_fixture("room");
    let (_folder, secret) = secret();
    let mut refused = 0;
    for name in [
        format!("{secret}/secret.obj"),
        "../../service.db".to_owned(),
        "room/../../x".to_owned(),
        "~/x".to_owned(),
        "file:///etc/passwd".to_owned(),
    ] {
        let requests = [
            ("run", json!({ "scene": name })),
            ("run", json!({ "survey": name })),
            ("run", json!({ "pipeline": name })),
            ("run", json!({ "crs": name, "survey": "room/survey.xml" })),
            ("run", json!({ "part": [{ "file": name }] })),
            ("run", json!({ "part": [{ "file": "room/a.obj", "materials": name }] })),
            ("run", json!({ "part": [{ "file": "room/a.obj", "material": [{ "spectrum": name }] }] })),
            ("run", json!({ "scanner": { "catalogue": format!("{name}#a") } })),
            ("run", json!({ "scanner": { "pulse_shape": name } })),
            ("run", json!({ "scanner": { "scan_wander": name } })),
            ("run", json!({ "scanner": { "pattern": name } })),
            ("run", json!({ "scanner": { "corrections": name } })),
            ("run", json!({ "scanner": { "firing_times": name } })),
            ("run", json!({ "scanner": { "channel": [{ "pulse_shape": name }] } })),
            ("run", json!({ "scanner": [{ "name": "a", "output": name }] })),
            ("run", json!({ "scanner": [{ "name": "a", "output": [{ "path": name }] }] })),
            ("run", json!({ "scanner": [{ "name": "a", "pattern": name, "output": "a.las" }] })),
            ("run", json!({ "platform": { "catalogue": name } })),
            ("run", json!({ "trajectory": { "path": name } })),
            ("run", json!({ "settings": { "pulse_times": name } })),
            ("run", json!({ "leg": [{ "settings": { "pulse_times": name } }] })),
            ("run", json!({ "survey": "room/survey.xml", "output": [{ "path": name }] })),
            ("dry-run", json!({ "survey": name })),
            ("plan", json!({ "kind": "airborne", "scanner": name })),
            ("plan", json!({ "kind": "airborne", "scanner": "vlp16", "scene": name })),
            ("plan", json!({ "kind": "airborne", "scanner": "vlp16", "area": name })),
            ("plan", json!({ "kind": "mobile", "scanner": "vlp16", "along": name })),
            ("compare", json!({ "first": name, "second": "room/a.laz" })),
            ("compare", json!({ "first": "room/a.laz", "second": name })),
            ("compare", json!({ "first": "room/a.laz", "second": "room/a.laz", "terrain": name })),
            ("preview", json!({ "points": name })),
            ("campaign", json!({ "scene": [{ "name": "a", "file": name }], "variant": [] })),
            (
                "campaign",
                json!({ "scene": [{ "name": "a", "stand": format!("room/a.csv --trees {name}") }], "variant": [] }),
            ),
            (
                "campaign",
                json!({ "scene": [{ "name": "a", "make": format!("forest -n 1k -o={name}") }], "variant": [] }),
            ),
            (
                "campaign",
                json!({ "scene": [{ "name": "a", "make": "forest", "area": name }], "variant": [] }),
            ),
            ("campaign", json!({ "scene": [], "variant": [{ "name": "v", "survey": name }] })),
            ("campaign", json!({ "scene": [], "variant": [], "run": format!("--assets '{name}'") })),
        ];
        for (process, inputs) in requests {
            let answer = service.execute(process, &inputs);
            assert_eq!(answer.status, 400, "{process} {inputs}: {}", answer.text());
            refused += 1;
        }
        let encoded = name.replace('/', "%2F");
        for path in [
            format!("/jobs/x/results/{encoded}"),
            format!("/uploads/{encoded}"),
            format!("/uploads/room/files/{encoded}"),
            format!("/jobs/{encoded}"),
            format!("/static/{encoded}"),
        ] {
            assert_eq!(service.get(&path).status, 404, "{path}");
        }
    }
    assert_eq!(refused, 5 * 37);
    for inputs in [
        json!({ "trajectory": { "path": "-" } }),
        json!({ "output": [{ "path": "-" }] }),
        json!({ "trajectory": { "path": "STDIN" } }),
    ] {
        assert_eq!(service.execute("run", &inputs).status, 400, "{inputs}");
    }
    let mut deep = json!("room");
    for _ in 0..100 {
        deep = json!([deep]);
    }
    assert_eq!(service.execute("run", &json!({ "columns": deep })).status, 400);
    assert_eq!(service.json("/jobs")["jobs"], json!([]));
}

/// Files that name other files, all of which lead out: the job's process cannot open them.
#[test]
fn files_lead_nowhere() {
    let service = Service::start(&[]);
    let (_folder, secret) = secret();
    let scene = |filter: &str, path: &str| {
        format!(
            "<document><scene id=\"s\" name=\"s\"><part><filter type=\"{filter}\"><param type=\"string\" key=\"filepath\" value=\"{path}\"/></filter></part></scene></document>"
        )
    };
    let outside = format!("{secret}/secret.obj");
    let up = format!("../../../../../../../../../..{secret}/secret.obj");
    let mut files: Vec<(&str, Vec<u8>)> = Vec::new();
    for (name, path) in [("absolute.xml", &outside), ("up.xml", &up)] {
        files.push((name, scene("objloader", path).into_bytes()));
    }
    files.push(("cloud.xml", scene("xyzloader", &format!("{secret}/secret.xml")).into_bytes()));
    files.push((
        "entity.xml",
        format!("<!DOCTYPE d [<!ENTITY x SYSTEM \"file://{secret}/secret.xml\">]><document>&x;</document>")
            .into_bytes(),
    ));
    files.push((
        "library.obj",
        format!("mtllib {secret}/secret.xml\nv 0 0 0\nv 9 0 0\nv 0 9 0\nf 1 2 3\n").into_bytes(),
    ));
    files.push(("buffer.gltf", format!(
        "{{\"asset\":{{\"version\":\"2.0\"}},\"buffers\":[{{\"byteLength\":36,\"uri\":\"{up}\"}}],\"bufferViews\":[{{\"buffer\":0,\"byteLength\":36}}],\"accessors\":[{{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}}],\"meshes\":[{{\"primitives\":[{{\"attributes\":{{\"POSITION\":0}}}}]}}],\"nodes\":[{{\"mesh\":0}}]}}"
    ).into_bytes()));
    files.push(("tiles.vrt", format!(
        "<VRTDataset rasterXSize=\"9\" rasterYSize=\"9\"><GeoTransform>0,1,0,0,0,-1</GeoTransform><VRTRasterBand dataType=\"Float32\" band=\"1\"><SimpleSource><SourceFilename relativeToVRT=\"0\">{secret}/secret.tif</SourceFilename></SimpleSource></VRTRasterBand></VRTDataset>"
    ).into_bytes()));
    files.push(("instances.csv", format!("file,x,y,z\n{outside},0,0,0\n").into_bytes()));
    let survey = |scene: &str| {
        format!(
            "<document><survey name=\"s\" scene=\"{scene}#s\" platform=\"data/platforms.xml#tripod\" scanner=\"data/scanners_tls.xml#riegl_vz400\"><leg><platformSettings x=\"0\" y=\"0\" z=\"1\"/><scannerSettings active=\"true\" pulseFreq_hz=\"100000\" scanFreq_hz=\"100\"/></leg></survey></document>"
        )
    };
    files.push(("survey.xml", survey(&format!("{secret}/secret.xml")).into_bytes()));
    files.push(("survey2.xml", survey("absolute.xml").into_bytes()));
    assert_eq!(service.upload("trap", &files).status, 201);
    let tripod = |scene: &str| {
        json!({
            "scene": format!("trap/{scene}"), "scanner": { "catalogue": "riegl_vz400" }, "platform": { "catalogue": "tripod" },
            "settings": { "pulse_freq_hz": 100_000, "vertical_resolution_deg": 1, "horizontal_resolution_deg": 1, "head_start_deg": 0, "head_stop_deg": 90 },
            "leg": [{ "position_m": [1, 1, 2] }],
        })
    };
    let mut failed = 0;
    for scene in [
        "absolute.xml",
        "up.xml",
        "cloud.xml",
        "entity.xml",
        "library.obj",
        "buffer.gltf",
        "tiles.vrt",
        "instances.csv",
    ] {
        let job = service.run("run", &tripod(scene));
        let text = job.to_string();
        assert!(!text.contains("secret word"), "{scene}: {text}");
        assert!(
            !text.contains(service.data.to_str().unwrap()),
            "the folders of the service are told: {text}"
        );
        failed += usize::from(job["status"] == "failed");
        if job["status"] == "successful" {
            // A missing library of materials is no error: the triangle is the upload's own.
            assert_eq!(scene, "library.obj", "{text}");
        }
    }
    assert!(failed >= 7, "{failed}");
    for survey in ["survey.xml", "survey2.xml"] {
        let job = service.run("run", &json!({ "survey": format!("trap/{survey}") }));
        assert_eq!(job["status"], "failed", "{job}");
        assert!(!job.to_string().contains("secret word"), "{job}");
    }
    // A pipeline file among the uploads is checked like a request, and may not write elsewhere.
    let pipeline = format!("survey = \"survey.xml\"\n[[output]]\npath = \"{secret}/made.laz\"\n");
    assert_eq!(service.upload("pipe", &[("p.toml", pipeline.into_bytes())]).status, 201);
    assert_eq!(service.execute("run", &json!({ "pipeline": "pipe/p.toml" })).status, 400);
    assert_eq!(std::fs::read_dir(&secret).unwrap().count(), 2);
}

#[test]
fn names_of_uploads_and_files_lead_nowhere_and_are_escaped() {
    let service = Service::start(&["--workers", "0"]);
    let small = || b"v 0 0 0".to_vec();
    for name in ["../x", "a/b", "..", ".x", "jobs", "job.toml", "a b", "<b>", "-o", "a\u{0}b", "data:x"] {
        let answer = service.upload(name, &[("a.obj", small())]);
        assert_eq!(answer.status, 400, "{name:?}: {}", answer.text());
    }
    for file in [
        "../a.obj",
        "/etc/a.obj",
        "a/../../b.obj",
        ".ssh/x",
        "C:/a.obj",
        "a//b",
        "-o",
        "a<b",
        "con|x",
        "x\u{1}",
    ] {
        let answer = service.upload("x", &[(file, small())]);
        assert_eq!(answer.status, 400, "{file:?}: {}", answer.text());
    }
    assert_eq!(service.upload("x", &[("a.obj", small()), ("a.obj", small())]).status, 400);
    assert_eq!(service.upload("x", &[]).status, 400);
    assert_eq!(service.upload("Wäld-1", &[("Bäume '&' $(id).obj", small())]).status, 201);
    assert_eq!(service.upload("Wäld-1", &[("b.obj", small())]).status, 409, "nothing is replaced");
    let page = service.ask("GET", "/new", &[("Accept", "text/html")], b"").text();
    assert!(
        page.contains("Bäume &#39;&amp;&#39; $(id).obj") || page.contains("Bäume '&amp;' $(id).obj"),
        "{page}"
    );
    let everything: Vec<_> = walk(&service.data);
    assert!(everything.iter().all(|path| path.starts_with(&service.data)));
    assert!(!service.data.parent().unwrap().join("x").exists());
}

fn walk(folder: &Path) -> Vec<std::path::PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.flat_map(|path| if path.is_dir() { walk(&path) } else { vec![path] }).collect()
}

#[test]
fn uploads_are_limited_before_they_are_stored_and_archives_before_they_are_expanded() {
    let service =
        Service::start(&["--workers", "0", "--max-upload", "1M", "--max-files", "5", "--max-stored", "2M"]);
    let answer = service.upload("large", &[("a.obj", vec![b' '; 1_000_001])]);
    assert_eq!(answer.status, 413, "{}", answer.text());
    let many: Vec<(&str, Vec<u8>)> =
        ["a", "b", "c", "d", "e", "f"].map(|name| (name, b"x".to_vec())).to_vec();
    assert_eq!(service.upload("many", &many).status, 413);
    let archive = |files: &[(&str, Vec<u8>)]| {
        let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
        for (name, content) in files {
            zip.start_file(*name, zip::write::SimpleFileOptions::default()).unwrap();
            zip.write_all(content).unwrap();
        }
        zip.finish().unwrap().into_inner()
    };
    let zipped =
        |name: &str, files: &[(&str, Vec<u8>)]| service.upload(name, &[("archive.zip", archive(files))]);
    let bomb = zipped("bomb", &[("a.obj", vec![0; 100_000_000])]);
    assert_eq!(bomb.status, 400, "{}", bomb.text());
    assert_eq!(zipped("files", &many).status, 400);
    assert_eq!(zipped("out", &[("../../a.obj", b"x".to_vec())]).status, 400);
    let mut damaged = archive(&[("a.obj", b"v 0 0 0".to_vec())]);
    let middle = damaged.len() / 2;
    damaged[middle] ^= 0xff;
    damaged.truncate(damaged.len() - 3);
    assert_eq!(service.upload("damaged", &[("a.zip", damaged)]).status, 400);
    let good = zipped("good", &[("wood/a.obj", b"v 0 0 0".to_vec()), ("wood/b/c.obj", b"v 1 1 1".to_vec())]);
    assert_eq!(good.status, 201, "{}", good.text());
    let paths = service.json("/uploads/good")["list"]
        .as_array()
        .unwrap()
        .iter()
        .map(|file| file["path"].as_str().unwrap().to_owned())
        .collect::<Vec<_>>();
    assert_eq!(paths, ["a.obj", "b/c.obj"]);
    assert_eq!(service.upload("one", &[("a", vec![1; 900_000])]).status, 201);
    assert_eq!(service.upload("two", &[("a", vec![2; 900_000])]).status, 201);
    let full = service.upload("three", &[("a", vec![3; 900_000])]);
    assert_eq!(full.status, 413, "{}", full.text());
    service.wait_until_incoming_is_empty("nothing is left of what was refused");
    let large = vec![b' '; 2 << 20];
    assert_eq!(
        service
            .ask("POST", "/processes/run/execution", &[("Content-Type", "application/json")], &large)
            .status,
        413
    );
}

/// Damaged files through all processes that read them: failures of jobs, never of the service.
#[test]
fn damaged_files_fail_their_jobs_only() {
    let service = Service::start(&["--max-time", "60", "--max-memory", "2G"]);
    let mut files = files_of(&fixtures().join("room"));
    let mut seed: u64 = 1;
    for (_, content) in &mut files {
        for _ in 0..8 {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let at = (seed >> 33) as usize % content.len();
            content[at] = (seed >> 20) as u8;
        }
    }
    for (name, content) in [
        ("huge.las", [b"LASF".as_slice(), &[0xff; 400]].concat()),
        ("endless.csv", b"time,x,y,z\n".repeat(1000)),
        ("entities.xml", "<!DOCTYPE a [<!ENTITY a \"aaaaaaaaaa\">]><document>&a;</document>".into()),
        ("zeros.ply", vec![0; 4096]),
        ("cut.tif", b"II*\0\xff\xff\xff\xff".to_vec()),
        ("cut.glb", b"glTF\x02\0\0\0\xff\xff\xff\xff".to_vec()),
        ("cut.vlscene", vec![0x55; 3000]),
    ] {
        files.push((name, content));
    }
    assert_eq!(service.upload("damaged", &files).status, 201);
    let before = walk(service.data.parent().unwrap()).len();
    let check = |answer: &Answer, about: &str| assert!(answer.status < 500, "{about}: {}", answer.text());
    for (name, _) in &files {
        let file = format!("damaged/{name}");
        let jobs: Vec<(&str, Value)> = vec![
            ("dry-run", json!({ "survey": file })),
            ("dry-run", json!({ "survey": "damaged/survey.xml", "scene": file })),
            ("preview", json!({ "points": file })),
            (
                "plan",
                json!({ "kind": "airborne", "scanner": "riegl_vux-1uav", "scene": file, "height": 50, "density": 5 }),
            ),
        ];
        for (process, inputs) in jobs {
            check(&service.execute(process, &inputs), &format!("{process} {inputs}"));
        }
    }
    assert_eq!(service.get("/").status, 200);
    let after = walk(service.data.parent().unwrap());
    assert!(after.len() >= before && after.iter().all(|path| path.starts_with(&service.data)));
}
