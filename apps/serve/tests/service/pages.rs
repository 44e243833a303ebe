//! Examples, uploads from pages, forms that are shown again with a fix, and the way through the jobs of a
//! scan.

use super::browser::{finished, page, send, token_of};
use super::jobs::{flight, with_field};
use crate::client::{Service, form};
use serde_json::json;

const HTML: (&str, &str) = ("Accept", "text/html");

#[test]
fn examples_are_scanned_by_one_click() {
    let service = Service::start(&[]);
    let home = page(&service, "/");
    let token = token_of(&home).to_owned();
    for (example, upload) in [("forest", "example-forest"), ("terrain", "example-terrain")] {
        assert!(home.contains(&format!("name=\"example\" value=\"{example}\"")), "{home}");
        let begun = send(&service, "/forms/example", &token, &[("example", example)]);
        assert_eq!(begun.status, 303, "{}", begun.text());
        let done = finished(&service, begun.header("location"));
        assert!(done.contains("/results/points.copc.laz\""), "{done}");
        assert!(page(&service, &format!("/uploads/{upload}")).contains(upload));
        // The second click leads to the same results.
        let again = send(&service, "/forms/example", &token, &[("example", example)]);
        assert_eq!(again.header("location"), begun.header("location"));
    }
    assert_eq!(service.json("/uploads")["uploads"].as_array().unwrap().len(), 2);
    assert!(!page(&service, "/").contains("/forms/example"), "examples are for empty pages");
    assert_eq!(send(&service, "/forms/example", &token, &[("example", "sea")]).status, 400);
}

#[test]
fn uploads_of_pages_get_a_number_and_keep_their_form() {
    let service = Service::start(&["--workers", "0"]);
    let (media, body) = form("plot", &[("a.obj", b"v 0 0 0\n".to_vec())]);
    let numbered = |text: &[u8]| {
        let field = "Content-Disposition: form-data; name=\"taken\"\r\n\r\nnumber\r\n";
        let boundary = media.split_once("boundary=").unwrap().1;
        [format!("--{boundary}\r\n{field}").as_bytes(), text].concat()
    };
    for expected in ["/uploads/plot", "/uploads/plot-2", "/uploads/plot-3"] {
        let answer = service.ask("POST", "/uploads", &[HTML, ("Content-Type", &media)], &numbered(&body));
        assert_eq!((answer.status, answer.header("location")), (303, expected));
    }
    // Programs choose names themselves.
    assert_eq!(service.ask("POST", "/uploads", &[("Content-Type", &media)], &body).status, 409);
    let (media, body) = form("none", &[]);
    let failed = service.ask("POST", "/uploads", &[HTML, ("Content-Type", &media)], &body);
    let text = failed.text();
    assert_eq!(failed.status, 400);
    assert!(text.contains("the upload has no files") && text.contains("action=\"/uploads\""), "{text}");
}

#[test]
fn forms_that_are_open_outlive_a_restart() {
    let mut service = Service::start(&["--workers", "0"]);
    with_field(&service);
    let token = token_of(&page(&service, "/")).to_owned();
    service.restart();
    assert_eq!(send(&service, "/forms/remove-upload", &token, &[("name", "field")]).status, 303);
    assert!(service.json("/uploads")["uploads"].as_array().unwrap().is_empty());
    let other = Service::start(&["--workers", "0"]);
    assert_eq!(send(&other, "/forms/remove-upload", &token, &[("name", "field")]).status, 403);
}

const UAV: &str = "data/scanners_als.xml#riegl_vux-1uav";

#[test]
fn a_failed_plan_shows_its_form_with_a_fix() {
    let service = Service::start(&[]);
    with_field(&service);
    let new = page(&service, "/new?kind=terrestrial&scene=field/field.obj");
    let token = token_of(&new).to_owned();
    assert!(new.contains("name=\"ground\" value=\"0\""), "the lowest place of a mesh without ground: {new}");
    let terrestrial = new.find("Terrestrial and mobile").unwrap();
    assert!(terrestrial < new.find("label=\"Airborne\"").unwrap(), "{new}");
    let fields = [
        ("kind", "terrestrial"),
        ("scene", "field/field.obj"),
        ("scanner", "data/scanners_tls.xml#riegl_vz400"),
        ("around", "0,0"),
        ("radius", "10"),
        ("positions", "3"),
        ("resolution", "0.1"),
    ];
    let begun = send(&service, "/forms/plan", &token, &fields);
    let failed = finished(&service, begun.header("location"));
    assert!(failed.contains("Level ground at 0 m") && failed.contains("aria-invalid=\"true\""), "{failed}");
    assert!(
        failed.contains("name=\"around\" value=\"0,0\"") && failed.contains("<details open>"),
        "{failed}"
    );
    // The button sends the fields with the value.
    let button = failed.split("Level ground at 0 m").next().unwrap().rsplit("<form").next().unwrap();
    for (field, value) in fields.iter().chain(&[("ground", "0")]) {
        assert!(button.contains(&format!("name=\"{field}\" value=\"{value}\"")), "{field}: {button}");
    }
    let fixed = send(&service, "/forms/plan", &token, &[&fields[..], &[("ground", "0")]].concat());
    let planned = finished(&service, fixed.header("location"));
    assert!(planned.contains("plan.toml"), "{planned}");
    // A request that is refused leads back to its form, too.
    let mut absent = fields;
    absent[1] = ("scene", "jobs/0123/stand/stand.xml");
    let refused = send(&service, "/forms/plan", &token, &absent);
    assert_eq!(refused.status, 400);
    assert!(refused.text().contains("action=\"/forms/plan\""), "{}", refused.text());
}

#[test]
fn pages_of_a_scan_lead_back_to_its_files() {
    let service = Service::start(&[]);
    service.upload_fixture("terrain");
    let token = token_of(&page(&service, "/")).to_owned();
    let area = "POLYGON ((-15 -15, 15 -15, 15 15, -15 15))";
    let fields = [
        ("kind", "airborne"),
        ("scene", "terrain/scene.xml"),
        ("scanner", UAV),
        ("height", "60"),
        ("density", "2"),
        ("overlap", "20"),
        ("area", area),
    ];
    let plan = send(&service, "/forms/plan", &token, &fields).header("location").to_owned();
    let planned = finished(&service, &plan);
    assert!(
        planned.contains("RIEGL VUX-1UAV, 60 m</h1>") && !planned.contains("message-format"),
        "{planned}"
    );
    let file = format!("{}/plan.toml", plan.trim_start_matches('/'));
    let next = |action: &str| {
        let fields = [("file", file.as_str()), ("action", action), ("format", "copc.laz"), ("seed", "3")];
        send(&service, "/forms/run", &token, &fields).header("location").to_owned()
    };
    let forecast = next("dry-run");
    finished(&service, &forecast);
    let run = next("run");
    let points = finished(&service, &run);
    let path = points.split("aria-label=\"Path\"").nth(1).unwrap().split("</nav>").next().unwrap();
    let steps = [
        ("/", "Files"),
        ("/uploads/terrain", "terrain"),
        (plan.as_str(), "Plan"),
        (forecast.as_str(), "Forecast"),
    ];
    let mut rest = path;
    for (address, label) in steps {
        let link = format!("<a href=\"{address}\">{label}</a>");
        rest = rest.split_once(&link).unwrap_or_else(|| panic!("{link}: {path}")).1;
    }
    assert!(rest.contains("aria-current=\"page\">Points<"), "{path}");
    // Jobs of one scan are below its title.
    let jobs = page(&service, "/jobs");
    assert_eq!(jobs.matches("scope=\"rowgroup\"").count(), 1, "{jobs}");
    assert!(jobs.contains("RIEGL VUX-1UAV, 60 m</th>") && jobs.contains(">Points, seed 3</a>"), "{jobs}");
    assert!(points.contains("Again with seed 4"), "{points}");
    let id = run.trim_start_matches("/jobs/");
    let again = send(&service, "/forms/again", &token, &[("id", id)]).header("location").to_owned();
    assert!(again != run && finished(&service, &again).contains("seed 4</h1>"));
    let of_plan = plan.trim_start_matches("/jobs/");
    assert_eq!(send(&service, "/forms/again", &token, &[("id", of_plan)]).status, 404);
}

#[test]
fn jobs_tell_their_place_in_the_queue_and_are_removed_after_a_question() {
    let mut service = Service::start(&["--workers", "0"]);
    with_field(&service);
    let ids = [1, 2].map(|seed| service.submit("run", &flight(seed, 1)));
    for (id, place) in ids.iter().zip(["Next in the queue", "1 job before this one"]) {
        let text = page(&service, &format!("/jobs/{id}"));
        assert!(text.contains(place) && text.contains("<summary>Give up</summary>"), "{text}");
        assert!(text.contains("name=\"unfinished\""), "{text}");
    }
    let token = token_of(&page(&service, "/")).to_owned();
    let path = format!("/jobs/{}", ids[1]);
    let gone = send(&service, "/forms/dismiss", &token, &[("id", &ids[1])]);
    assert_eq!((gone.status, gone.header("location")), (303, path.as_str()));
    assert!(page(&service, &path).contains("given up"));
    service.kill();
    let service = Service::at(&service.data, &[]);
    assert_eq!(service.wait(&ids[0])["status"], "successful");
    let path = format!("/jobs/{}", ids[0]);
    let done = page(&service, &path);
    assert!(done.contains("<summary>Remove</summary>") && done.contains("The picture is drawn"), "{done}");
    assert!(done.contains("<script src=\"/static/page.js\" defer>"), "{done}");
    let token = token_of(&done).to_owned();
    // A job that was finished before it was given up keeps its results.
    let late = send(&service, "/forms/dismiss", &token, &[("id", &ids[0]), ("unfinished", "on")]);
    assert_eq!((late.status, late.header("location")), (303, path.as_str()));
    assert_eq!(service.json(&path)["status"], "successful");
    assert_eq!(send(&service, "/forms/dismiss", &token, &[("id", &ids[0])]).header("location"), path);
    let removed = page(&service, &path);
    assert!(removed.contains(">removed<") && !removed.contains("/forms/dismiss"), "{removed}");
    assert!(!page(&service, "/jobs").contains(&ids[0]));
}

#[test]
fn comparisons_name_their_clouds() {
    let service = Service::start(&[]);
    with_field(&service);
    let ids = [1, 2].map(|seed| service.run("run", &flight(seed, 1))["jobID"].as_str().unwrap().to_owned());
    let clouds = ids.clone().map(|id| format!("jobs/{id}/points.laz"));
    let token = token_of(&page(&service, "/compare")).to_owned();
    let fields = [("first", clouds[0].as_str()), ("second", clouds[1].as_str())];
    let path = send(&service, "/forms/compare", &token, &fields).header("location").to_owned();
    let compared = finished(&service, &path);
    let address = format!("/compared/{}/report.html", path.trim_start_matches("/jobs/"));
    assert!(compared.contains(&format!("src=\"{address}\"")), "{compared}");
    let report = service.get(&address);
    let text = report.text();
    assert!(report.header("content-security-policy").starts_with("sandbox"), "{text}");
    assert!(text.contains("points.laz of field/field.obj, RIEGL VUX-1UAV, seed 2"), "{text}");
    assert!(ids.iter().all(|id| !text.contains(id)), "{text}");
    assert_eq!(service.get(&format!("/compared/{}/report.html", ids[0])).status, 404);
}

#[test]
fn controls_of_points_are_above_them() {
    let service = Service::start(&[]);
    with_field(&service);
    let mut inputs = flight(1, 1);
    inputs["output"] = json!([{ "path": "points.copc.laz" }]);
    let job = service.run("run", &inputs);
    let text = page(&service, &format!("/jobs/{}", job["jobID"].as_str().unwrap()));
    let place = |part: &str| text.find(part).unwrap_or_else(|| panic!("{part}: {text}"));
    assert!(place("name=\"colouring\"") < place("<canvas"), "{text}");
    assert!(place("<canvas") < place("class=\"ruler\"") && place("class=\"ramp\"") > 0, "{text}");
    // A finger that moves up or down scrolls the page.
    assert!(service.get("/static/style.css").text().contains("touch-action: pan-y"));
}

#[test]
fn tripods_stand_at_the_places_that_are_clicked() {
    let service = Service::start(&[]);
    with_field(&service);
    let token = token_of(&page(&service, "/new?kind=terrestrial")).to_owned();
    let mut corners = String::new();
    let mut places = String::new();
    for (x, y) in [("100", "100"), ("300", "200")] {
        let fields = [
            ("kind", "terrestrial"),
            ("scene", "field/field.obj"),
            ("mapped", "field/field.obj"),
            ("corners", &corners),
            ("at.x", x),
            ("at.y", y),
        ];
        let again = send(&service, "/forms/corner", &token, &fields).text();
        places = again.split("</textarea>").next().unwrap().rsplit('>').next().unwrap().to_owned();
        corners =
            again.split("name=\"corners\" value=\"").nth(1).unwrap().split('"').next().unwrap().to_owned();
    }
    assert_eq!(places.lines().count(), 2, "{places}");
    let fields = [
        ("kind", "terrestrial"),
        ("scene", "field/field.obj"),
        ("scanner", "data/scanners_tls.xml#riegl_vz400"),
        ("at", &places),
        ("radius", "10"),
        ("positions", "4"),
        ("resolution", "0.1"),
        ("ground", "0"),
    ];
    let path = send(&service, "/forms/plan", &token, &fields).header("location").to_owned();
    let planned = finished(&service, &path);
    assert!(planned.contains("2 tripod positions with the RIEGL VZ-400"), "{planned}");
    let plan = service.get(&format!("{path}/results/plan.toml")).text();
    assert_eq!(plan.matches("[[leg]]").count(), 2, "{plan}");
}
