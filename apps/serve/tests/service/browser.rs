//! Pages, as a browser without scripts uses them: links and forms alone lead from a scene to a cloud.

use super::jobs::{flight, with_field};
use crate::client::{Answer, Service, files_of, fixtures, form};
use serde_json::json;
use std::time::{Duration, Instant};

const HTML: (&str, &str) = ("Accept", "text/html");

/// A page.
pub fn page(service: &Service, path: &str) -> String {
    let answer = service.ask("GET", path, &[HTML], b"");
    assert_eq!(answer.status, 200, "{path}: {}", answer.text());
    assert!(answer.header("content-type").starts_with("text/html"), "{path}");
    answer.text()
}

/// The hidden field of a page's forms.
pub fn token_of(page: &str) -> &str {
    page.split("name=\"csrf\" value=\"").nth(1).unwrap().split('"').next().unwrap()
}

/// Sends a form.
pub fn send(service: &Service, path: &str, token: &str, fields: &[(&str, &str)]) -> Answer {
    let encoded = |text: &str| {
        text.bytes()
            .map(|byte| {
                if byte.is_ascii_alphanumeric() {
                    char::from(byte).to_string()
                } else {
                    format!("%{byte:02X}")
                }
            })
            .collect::<String>()
    };
    let fields = [&[("csrf", token)], fields].concat();
    let body =
        fields.iter().map(|(key, value)| format!("{key}={}", encoded(value))).collect::<Vec<_>>().join("&");
    let origin = format!("http://{}", service.address);
    let headers = [HTML, ("Content-Type", "application/x-www-form-urlencoded"), ("Origin", &origin)];
    service.ask("POST", path, &headers, body.as_bytes())
}

/// The page of a job when it is finished: it is loaded again as browsers do that it asks to.
pub fn finished(service: &Service, path: &str) -> String {
    let start = Instant::now();
    loop {
        let text = page(service, path);
        if !text.contains("http-equiv=\"refresh\"") {
            return text;
        }
        assert!(start.elapsed() < Duration::from_secs(120), "{text}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn links_and_forms_lead_from_a_scene_to_a_cloud() {
    let service = Service::start(&[]);
    let home = page(&service, "/");
    let token = token_of(&home).to_owned();
    let (media, body) = form("terrain", &files_of(&fixtures().join("terrain")));
    let uploaded = service.ask("POST", "/uploads", &[HTML, ("Content-Type", &media)], &body);
    assert_eq!((uploaded.status, uploaded.header("location")), (303, "/uploads/terrain"));
    let upload = page(&service, "/uploads/terrain");
    let link = "/new?kind=airborne&amp;scene=terrain%2Fscene.xml&amp;upload=terrain";
    assert!(page(&service, "/").contains("/uploads/terrain") && upload.contains(link), "{upload}");
    let new =
        page(&service, &(link.replace("&amp;", "&") + "&scanner=data/scanners_als.xml%23riegl_vux-1uav"));
    assert!(new.contains("<option value=\"terrain/scene.xml\" selected"), "{new}");
    let planned = send(
        &service,
        "/forms/plan",
        &token,
        &[
            ("kind", "airborne"),
            ("scene", "terrain/scene.xml"),
            ("scanner", "riegl_vux-1uav"),
            ("height", "60"),
            ("density", "4"),
            ("overlap", "20"),
            ("speed", ""),
            ("area_file", ""),
            ("area", "POLYGON ((-20 -20, 20 -20, 20 20, -20 20))"),
        ],
    );
    assert_eq!(planned.status, 303, "{}", planned.text());
    let plan = finished(&service, planned.header("location"));
    assert!(plan.contains("/view/view.png") && plan.contains("pulses"), "{plan}");
    let file = format!("{}/plan.toml", planned.header("location").trim_start_matches('/'));
    assert!(plan.contains(&format!("name=\"file\" value=\"{file}\"")), "{plan}");
    let forecast = send(
        &service,
        "/forms/run",
        &token,
        &[("file", &file), ("action", "dry-run"), ("format", "laz"), ("seed", "")],
    );
    let forecast = finished(&service, forecast.header("location"));
    assert!(forecast.contains("Points per m²") && forecast.contains("Time of the run"), "{forecast}");
    let run = send(
        &service,
        "/forms/run",
        &token,
        &[("file", &file), ("action", "run"), ("format", "laz"), ("seed", "3")],
    );
    let path = run.header("location").to_owned();
    let done = finished(&service, &path);
    let points = format!("{}/points.laz", path.trim_start_matches('/'));
    assert!(
        done.contains("/view/view.png") && done.contains(&points) && done.contains("vlscan run job.toml"),
        "{done}"
    );
    // LAZ is copied for the viewer, once.
    let copy = send(&service, "/forms/view", &token, &[("points", &points)]).header("location").to_owned();
    let address = format!("data-cloud=\"{copy}/results/preview.copc.laz\"");
    assert!(finished(&service, &copy).contains(&address), "{copy}");
    assert_eq!(send(&service, "/forms/view", &token, &[("points", &points)]).header("location"), copy);
    let octree =
        service.ask("GET", &format!("{copy}/results/preview.copc.laz"), &[("Range", "bytes=375-380")], b"");
    assert_eq!((octree.status, octree.body.get(2..6)), (206, Some(&b"copc"[..])));
    assert!(page(&service, &format!("/compare?first={points}")).contains(&points));
    let compared = send(&service, "/forms/compare", &token, &[("first", &points), ("second", &points)]);
    // One cloud alone is no choice, but the form takes it.
    assert!(finished(&service, compared.header("location")).contains("report.html"));
    let id = path.trim_start_matches("/jobs/").to_owned();
    let gone = send(&service, "/forms/dismiss", &token, &[("id", &id)]);
    assert_eq!(gone.status, 303);
    assert!(!page(&service, "/jobs").contains(&id));
    assert_eq!(send(&service, "/forms/remove-upload", &token, &[("name", "terrain")]).status, 303);
    assert!(!page(&service, "/").contains("aria-label=\"Remove terrain\""));
}

#[test]
fn clicks_on_the_scene_are_corners_of_an_area() {
    let service = Service::start(&[]);
    service.upload_fixture("terrain");
    let new = page(&service, "/new?scene=terrain/scene.xml");
    let token = token_of(&new).to_owned();
    assert!(new.contains("src=\"/map.png?scene=terrain%2Fscene.xml\""), "{new}");
    let frame = service.json("/map.json?scene=terrain/scene.xml");
    let pixel = frame["pixel"].as_f64().unwrap();
    let left = frame["corner"][0].as_f64().unwrap();
    let picture = service.get("/map.png?scene=terrain/scene.xml");
    assert!(picture.body.starts_with(b"\x89PNG") && pixel > 0.0);
    let mut corners = String::new();
    let mut area = String::new();
    for (x, y) in [("100", "100"), ("300", "100"), ("300", "250")] {
        let fields = [
            ("kind", "airborne"),
            ("scene", "terrain/scene.xml"),
            ("mapped", "terrain/scene.xml"),
            ("height", "55"),
            ("corners", &corners),
            ("area.x", x),
            ("area.y", y),
        ];
        let again = send(&service, "/forms/corner", &token, &fields).text();
        assert!(again.contains("name=\"height\" value=\"55\""), "{again}");
        let next = again.split("name=\"corners\" value=\"").nth(1).unwrap().split('"').next().unwrap();
        area = again.split("</textarea>").next().unwrap().rsplit('>').next().unwrap().to_owned();
        corners = next.to_owned();
    }
    let first: Vec<f64> = corners.split([',', ' ']).take(2).map(|number| number.parse().unwrap()).collect();
    assert!((first[0] - (left + 99.5 * pixel)).abs() < pixel, "{corners} {frame}");
    assert_eq!(area, format!("POLYGON (({corners}, {}))", corners.split(", ").next().unwrap()));
    let others = service.get("/map.json?scene=nothing/scene.xml");
    assert_eq!(others.status, 404);
    assert_eq!(service.get("/map.json?scene=../secret.xml").status, 400);
}

#[test]
fn an_inventory_becomes_a_scene() {
    let service = Service::start(&[]);
    let table = "x;y;Höhe;Baumart\n0;0;21,5;Fichte\n6;2;18;Rotbuche\n-4;7;12;Kiefer\n9;9;15;Unbekannt\n"
        .as_bytes()
        .to_vec();
    assert_eq!(service.upload("plot", &[("trees.csv", table)]).status, 201);
    let upload = page(&service, "/uploads/plot");
    let token = token_of(&upload).to_owned();
    assert!(upload.contains("/new?kind=stand&amp;inventory=plot%2Ftrees.csv"), "{upload}");
    assert!(!upload.contains("Compare points") && !upload.contains("Fly along"), "{upload}");
    let made = send(
        &service,
        "/forms/stand",
        &token,
        &[("inventory", "plot/trees.csv"), ("terrain", ""), ("flat", "on")],
    );
    let path = made.header("location").to_owned();
    let done = finished(&service, &path);
    let scene = format!("{}/stand/stand.xml", path.trim_start_matches('/'));
    let link = format!("/new?kind=airborne&amp;scene={}", scene.replace('/', "%2F"));
    assert!(done.contains(&link), "{done}");
    let labels = service.get(&format!("{path}/results/stand/labels.csv")).text();
    let models: Vec<&str> = labels.lines().skip(1).map(|line| line.split(',').nth(3).unwrap()).collect();
    let of = |species: &str| models.iter().filter(|model| model.starts_with(species)).count();
    assert!(models.len() == 4 && of("spruce") >= 2 && of("beech") >= 1, "{labels}");
    assert!(
        done.contains("<details open><summary>Warnings</summary>") && done.contains("Unbekannt"),
        "{done}"
    );
    let message = service.json(&path)["message"].as_str().unwrap_or_default().to_owned();
    assert!(message.contains("warning:") && !message.contains("../"), "{message}");
    // The tables do not tell where the service keeps its files.
    let trees = service.get(&format!("{path}/results/stand/trees.csv")).text();
    assert!(trees.lines().skip(1).all(|line| line.starts_with("models/")), "{trees}");
    let new = page(&service, &link.replace("&amp;", "&"));
    assert!(new.contains(&format!("<option value=\"{scene}\" selected")), "{new}");
    assert_eq!(service.json(&format!("/map.json?scene={scene}"))["corner"].as_array().unwrap().len(), 2);

    // The same with tree models of one's own.
    let model = b"v -1 0 0\nv 1 0 0\nv 0 0 12\nf 1 2 3\n".to_vec();
    let own = ["trees/spruce_a.obj", "trees/beech_a.obj", "trees/birch_a.obj", "a.txt"]
        .map(|name| (name, model.clone()));
    assert_eq!(service.upload("own", &own).status, 201);
    assert!(page(&service, "/new?kind=stand").contains("<option value=\"own/trees\">"));
    let fields = [("inventory", "plot/trees.csv"), ("trees", "own/trees"), ("terrain", ""), ("flat", "on")];
    let path = send(&service, "/forms/stand", &token, &fields).header("location").to_owned();
    finished(&service, &path);
    let labels = service.get(&format!("{path}/results/stand/labels.csv")).text();
    assert!(labels.lines().skip(1).all(|line| line.contains("_a")), "{labels}");
}

#[test]
fn slips_in_a_form_are_told_with_what_was_filled_in() {
    let service = Service::start(&[]);
    service.upload_fixture("terrain");
    let token = token_of(&page(&service, "/new")).to_owned();
    let fields = [
        ("kind", "airborne"),
        ("scene", "terrain/scene.xml"),
        ("scanner", "data/scanners_als.xml#riegl_vux-1uav"),
        ("height", "-5"),
        ("density", "12"),
        ("area", "POLYGON ((-20 -20, 20 -20, 20 20, -20 20))"),
    ];
    let again = send(&service, "/forms/plan", &token, &fields);
    let text = again.text();
    assert_eq!(again.status, 400);
    assert!(text.contains("Height above ground: expected a number above 0"), "{text}");
    for kept in ["name=\"height\" value=\"-5\"", "name=\"density\" value=\"12\"", "20 20, -20 20))"] {
        assert!(text.contains(kept), "{kept}: {text}");
    }
    assert!(service.json("/jobs")["jobs"].as_array().unwrap().is_empty());
    // What vlscan finds has the words of the page.
    let mut fields = fields;
    fields[3] = ("height", "50");
    fields[4] = ("density", "1e6");
    let failed = finished(&service, send(&service, "/forms/plan", &token, &fields).header("location"));
    let message = failed.split("role=\"alert\">").nth(1).unwrap().split("</pre>").next().unwrap();
    assert!(message.contains("Density") && !message.contains("--"), "{message}");
    // The page has the form itself, with what was filled in.
    assert!(
        failed.contains("name=\"height\" value=\"50\"") && failed.contains("name=\"overlap\" value=\"\""),
        "{failed}"
    );
}

#[test]
fn a_recorded_flight_is_flown() {
    let service = Service::start(&[]);
    service.upload_fixture("terrain");
    let flight = std::fs::read(fixtures().join("flight.csv")).unwrap();
    assert_eq!(service.upload("flight", &[("flight.csv", flight)]).status, 201);
    let token = token_of(&page(&service, "/new?kind=trajectory&upload=flight")).to_owned();
    let fields = [
        ("kind", "trajectory"),
        ("trajectory", "flight/flight.csv"),
        ("scene", "terrain/scene.xml"),
        ("scanner", "data/scanners_als.xml#riegl_vux-1uav"),
        ("platform", "data/platforms.xml#copter_linearpath"),
        ("pulse_freq_hz", "50000"),
        ("scan_freq_hz", "50"),
        ("action", "dry-run"),
    ];
    let forecast = send(&service, "/forms/trajectory", &token, &fields);
    let forecast = finished(&service, forecast.header("location"));
    assert!(forecast.contains("Pulses"), "{forecast}");
}

/// Runs with several files, and uploads that are read in ranges as they are.
#[test]
fn the_points_of_each_file_are_shown() {
    let service = Service::start(&[]);
    with_field(&service);
    let mut inputs = flight(1, 1);
    inputs["output"] = json!([{ "path": "a.copc.laz" }, { "path": "b c.copc.laz" }, { "path": "c.laz" }]);
    let job = service.run("run", &inputs);
    assert_eq!(job["status"], "successful", "{job}");
    let job = format!("/jobs/{}", job["jobID"].as_str().unwrap());
    let shown = |path: &str| {
        let text = page(&service, path);
        let address =
            text.split("data-cloud=\"").nth(1).unwrap_or_default().split('"').next().unwrap_or_default();
        (address.to_owned(), text)
    };
    let (first, text) = shown(&job);
    assert_eq!(first, format!("{job}/results/a.copc.laz"));
    let link = format!("{job}?points=b%20c.copc.laz");
    let third = format!("name=\"points\" value=\"{}/c.laz\"", job.trim_start_matches('/'));
    assert!(text.contains(&link) && text.contains(&third), "{text}");
    assert_eq!(shown(&link).0, format!("{job}/results/b%20c.copc.laz"));
    assert_eq!(shown(&format!("{job}?points=..%2Fb")).0, first);

    let octree = service.get(&first).body;
    let files = [("my cloud.copc.laz", octree.clone()), ("a.html", b"<script>alert(1)</script>".to_vec())];
    assert_eq!(service.upload("clouds", &files).status, 201);
    let link = "/uploads/clouds?points=my%20cloud.copc.laz";
    let (address, text) = shown("/uploads/clouds");
    assert!(address.is_empty() && text.contains(link), "{text}");
    let (address, _) = shown(link);
    assert_eq!(address, "/uploads/clouds/files/my%20cloud.copc.laz");
    let part = service.ask("GET", &address, &[("Range", "bytes=375-439")], b"");
    assert_eq!((part.status, part.body.as_slice()), (206, &octree[375..440]));
    // Browsers save what was uploaded, whatever it is.
    for address in [address.as_str(), "/uploads/clouds/files/a.html"] {
        let whole = service.get(address);
        assert_eq!(whole.header("content-type"), "application/octet-stream", "{address}");
        assert_eq!(whole.header("content-disposition"), "attachment", "{address}");
    }
    assert!(shown("/uploads/clouds?points=other.copc.laz").0.is_empty());
    for absent in ["/uploads/clouds/files/other.laz", "/uploads/other/files/my%20cloud.copc.laz"] {
        assert_eq!(service.get(absent).status, 404, "{absent}");
    }
}

#[test]
fn the_decoder_has_no_network() {
    let service = Service::start(&["--workers", "0"]);
    let policy = |path: &str| service.get(path).header("content-security-policy").to_owned();
    let worker = policy("/static/viewer/decoder.js");
    assert_eq!(worker, "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'");
    for path in ["/", "/static/viewer/viewer.js", "/static/laz-perf.js"] {
        assert!(!policy(path).contains("unsafe"), "{path}");
    }
    assert_eq!(service.get("/static/laz-perf.wasm").header("content-type"), "application/wasm");
    for path in ["/static/../Cargo.toml", "/static/laz-perf.md", "/static/"] {
        assert_eq!(service.get(path).status, 404, "{path}");
    }
}

#[test]
fn every_page_stands_alone() {
    let service = Service::start(&["--workers", "0"]);
    for path in [
        "/",
        "/new",
        "/new?kind=stand",
        "/new?kind=trajectory",
        "/jobs",
        "/compare",
        "/instruments",
        "/instruments/3",
        "/api",
        "/api?f=html",
    ] {
        let text = page(&service, path);
        assert!(text.contains("<html lang=\"en\">") && text.contains("name=\"viewport\""), "{path}");
        for part in ["http://", "https://", "javascript:", " style=", "onclick", "<script>"] {
            assert!(!text.contains(part), "{path} has {part}");
        }
    }
    assert!(page(&service, "/instruments").contains("VUX-1"));
    let forged = send(&service, "/forms/run", "0", &[("file", "a.xml")]);
    assert_eq!(forged.status, 403);
    let token = token_of(&page(&service, "/")).to_owned();
    let wrong = send(&service, "/forms/run", &token, &[("file", "../a.xml")]);
    assert_eq!(wrong.status, 400);
    assert!(wrong.text().contains("leads out of the job"), "{}", wrong.text());
}
