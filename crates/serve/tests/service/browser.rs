//! Pages, as a browser without scripts uses them: links and forms alone lead from a scene to a cloud.

use crate::client::{Answer, Service, files_of, fixtures, form};
use std::time::{Duration, Instant};

const HTML: (&str, &str) = ("Accept", "text/html");

/// A page.
fn page(service: &Service, path: &str) -> String {
    let answer = service.ask("GET", path, &[HTML], b"");
    assert_eq!(answer.status, 200, "{path}: {}", answer.text());
    assert!(answer.header("content-type").starts_with("text/html"), "{path}");
    answer.text()
}

/// The hidden field of a page's forms.
fn token_of(page: &str) -> &str {
    page.split("name=\"csrf\" value=\"").nth(1).unwrap().split('"').next().unwrap()
}

/// Sends a form.
fn send(service: &Service, path: &str, token: &str, fields: &[(&str, &str)]) -> Answer {
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
fn finished(service: &Service, path: &str) -> String {
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
    assert_eq!((uploaded.status, uploaded.header("location")), (303, "/"));
    assert!(page(&service, "/").contains("terrain"));
    let new = page(&service, "/new?upload=terrain&scanner=data/scanners_als.xml%23riegl_vux-1uav");
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
    assert!(
        done.contains("points.laz") && done.contains("<iframe") && done.contains("vlscan run job.toml"),
        "{done}"
    );
    let viewer = service.get(&format!("{path}/view/view.html"));
    assert_eq!(viewer.status, 200);
    let policy = viewer.header("content-security-policy");
    assert!(policy.contains("sandbox") && policy.contains("frame-ancestors 'self'"), "{policy}");
    let points = format!("{}/points.laz", path.trim_start_matches('/'));
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
fn every_page_stands_alone() {
    let service = Service::start(&["--workers", "0"]);
    for path in ["/", "/new", "/jobs", "/compare", "/instruments", "/instruments/3", "/api", "/api?f=html"] {
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
