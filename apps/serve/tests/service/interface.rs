//! The interface for programs.

use crate::client::{Service, files_of, fixtures, vlscan};
use serde_json::{Value, json};
use std::process::Command;

#[test]
fn the_service_describes_itself() {
    let service = Service::start(&["--workers", "0"]);
    let landing = service.json("/");
    let rels: Vec<&str> =
        landing["links"].as_array().unwrap().iter().map(|link| link["rel"].as_str().unwrap()).collect();
    for rel in [
        "service-desc",
        "service-doc",
        "http://www.opengis.net/def/rel/ogc/1.0/conformance",
        "http://www.opengis.net/def/rel/ogc/1.0/processes",
    ] {
        assert!(rels.contains(&rel), "{rels:?}");
    }
    let classes = service.json("/conformance")["conformsTo"].to_string();
    assert!(
        classes.contains("ogcapi-processes-1/1.0/conf/core") && classes.contains("conf/dismiss"),
        "{classes}"
    );
    let processes = service.json("/processes");
    let ids: Vec<&str> = processes["processes"]
        .as_array()
        .unwrap()
        .iter()
        .map(|process| process["id"].as_str().unwrap())
        .collect();
    assert_eq!(ids, ["run", "plan", "dry-run", "campaign", "compare", "stand", "preview"]);
    let definition = service.json("/api");
    assert_eq!(definition["openapi"], "3.0.3");
    for id in ids {
        let process = service.json(&format!("/processes/{id}"));
        assert_eq!(process["id"], id);
        for (key, input) in process["inputs"].as_object().unwrap() {
            assert!(
                input["schema"].is_object() && !input["description"].as_str().unwrap().is_empty(),
                "{id}: {key}: {input}"
            );
        }
        assert!(!process.to_string().contains("\"x-option\""));
        assert!(definition["paths"][format!("/processes/{id}/execution")]["post"].is_object());
    }
    // Inputs are the pipeline's keys and the options of commands, with their types.
    let run = service.json("/processes/run");
    assert_eq!(run["inputs"]["seed"]["schema"]["anyOf"][0]["type"], "integer");
    assert_eq!(run["inputs"]["misses"]["schema"]["type"], "boolean");
    assert!(run["inputs"]["scanner"]["schema"]["anyOf"][0]["properties"]["wavelength_nm"].is_object());
    assert!(run["inputs"].get("force").is_none() && run["inputs"].get("assets").is_none());
    let plan = service.json("/processes/plan");
    assert_eq!(plan["inputs"]["height"]["schema"]["type"], "number");
    let absent = service.get("/processes/nothing");
    assert_eq!(absent.status, 404);
    assert!(absent.json()["type"].as_str().unwrap().ends_with("no-such-process"));
    assert!(service.get("/jobs/nothing").json()["type"].as_str().unwrap().ends_with("no-such-job"));
}

/// From files to points: plan, forecast, run, comparison, picture, each from the results of the one before.
#[test]
fn a_plan_becomes_a_cloud_that_is_that_of_the_program() {
    let service = Service::start(&[]);
    service.upload_fixture("terrain");
    let plan = service.execute("plan", &json!({
        "kind": "airborne", "scanner": "riegl_vux-1uav", "scene": "terrain/scene.xml", "height": 60, "density": 4, "overlap": 20,
        "area": { "type": "Polygon", "crs": null, "coordinates": [[[-20, -20], [20, -20], [20, 20], [-20, 20], [-20, -20]]] },
    }));
    assert_eq!(plan.status, 200, "{}", plan.text());
    let href = plan.json()["plan.toml"]["href"].as_str().unwrap().to_owned();
    let text = service.get(&href).text();
    assert!(text.contains("scene = \"terrain/scene.xml"), "{text}");
    let file = href.trim_start_matches('/').replace("/results/", "/");
    let forecast = service.execute("dry-run", &json!({ "pipeline": file }));
    assert_eq!(forecast.status, 200, "{}", forecast.text());
    assert!(forecast.json()["report.json"]["value"]["pulses"].as_f64().unwrap() > 1000.0);
    let raw = service.post_json(
        "/processes/dry-run/execution",
        &json!({ "inputs": { "pipeline": file }, "response": "raw" }),
        &[],
    );
    assert!(raw.json()["pulses"].as_f64().unwrap() > 1000.0);
    let job = service.run("run", &json!({ "pipeline": file, "seed": 7 }));
    assert_eq!(job["status"], "successful", "{job}");
    let id = job["jobID"].as_str().unwrap();
    let results = service.json(&format!("/jobs/{id}/results"));
    let points = service.get(results["points.laz"]["href"].as_str().unwrap());
    assert_eq!((points.status, points.header("content-type")), (200, "application/vnd.laszip"));

    let view = service.get(&format!("/jobs/{id}/view/view.png"));
    assert!(view.status == 200 && view.body.starts_with(b"\x89PNG"), "{}", view.text());

    // The same by hand.
    let folder = tempfile::tempdir().unwrap();
    let terrain = folder.path().join("terrain");
    std::fs::create_dir(&terrain).unwrap();
    for (name, content) in files_of(&fixtures().join("terrain")) {
        std::fs::write(terrain.join(name), content).unwrap();
    }
    std::fs::write(folder.path().join("plan.toml"), &text).unwrap();
    let words = ["run", "plan.toml", "--seed", "7", "-o", "points.laz", "-q"];
    let done = Command::new(vlscan()).args(words).current_dir(folder.path()).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    assert!(
        std::fs::read(folder.path().join("points.laz")).unwrap() == points.body,
        "the service changes no byte"
    );

    // A part of the file.
    let part =
        service.ask("GET", results["points.laz"]["href"].as_str().unwrap(), &[("Range", "bytes=0-3")], b"");
    assert_eq!((part.status, part.body.as_slice()), (206, b"LASF".as_slice()));
    let first = format!("jobs/{id}/points.laz");
    let compared = service.execute("compare", &json!({ "first": first, "second": first }));
    assert_eq!(compared.status, 200, "{}", compared.text());
    assert!(compared.json()["report.json"]["value"].is_object());
    let page = service.get(compared.json()["report.html"]["href"].as_str().unwrap());
    assert!(page.header("content-security-policy").starts_with("sandbox"), "{:?}", page.headers);
    let picture = service.execute("preview", &json!({ "points": first, "width": 400, "height": 300 }));
    let picture = service.get(picture.json()["preview.png"]["href"].as_str().unwrap());
    assert!(picture.body.starts_with(b"\x89PNG"));
}

#[test]
fn a_campaign_becomes_a_data_set() {
    let service = Service::start(&[]);
    let job = service.run("campaign", &json!({
        "seeds": 2,
        "scene": [{ "name": "wood", "make": "forest -n 2k" }],
        "variant": [{ "name": "drone", "plan": "airborne --scanner riegl_vux-1uav --height 60 --density 2 --overlap 20" }],
    }));
    assert_eq!(job["status"], "successful", "{job}");
    let results = service.json(&format!("/jobs/{}/results", job["jobID"].as_str().unwrap()));
    let manifest = service.get(results["dataset/manifest.jsonl"]["href"].as_str().unwrap()).text();
    assert_eq!(manifest.lines().count(), 2, "{manifest}");
    assert_eq!(
        results.as_object().unwrap().keys().filter(|key| key.ends_with("points.laz")).count(),
        2,
        "{results}"
    );
}

#[test]
fn inputs_are_checked_before_a_job_is_accepted() {
    let service = Service::start(&["--workers", "0"]);
    service.upload_fixture("room");
    for (process, inputs, told) in [
        ("run", json!({ "scen": "room/scene.xml" }), "did you mean `scene`"),
        ("run", json!({ "seed": [1] }), "seed: expected integer or number or string"),
        ("run", json!({ "misses": "yes" }), "misses: expected boolean"),
        ("run", json!({ "survey": null }), "null"),
        ("run", json!({ "survey": { "href": "http://127.0.0.1/x.xml" } }), "not fetched"),
        ("run", json!({ "pipeline": "room/nothing.toml" }), "there is no file"),
        ("run", json!({ "survey": "jobs/0/x.xml" }), "there is no job"),
        ("run", json!({ "force": true }), "no such input"),
        ("run", json!({ "schedule": { "threads": 64 } }), "no such input"),
        ("plan", json!({ "kind": "airborne" }), "scanner"),
        ("plan", json!({ "kind": "orbital", "scanner": "x" }), "expected one of airborne"),
        ("plan", json!({ "kind": "mobile", "scanner": "x", "density": 3 }), "plans of the kind mobile"),
        ("preview", json!({ "points": "room/a.laz", "format": "exe" }), "expected one of"),
        ("preview", json!({ "points": "room/a.laz", "force": true }), "no such input"),
        ("campaign", json!({ "scene": [], "variant": [], "out": "x" }), "no such input"),
    ] {
        let answer = service.execute(process, &inputs);
        assert_eq!(answer.status, 400, "{process} {inputs}: {}", answer.text());
        let detail = answer.json()["detail"].as_str().unwrap().to_owned();
        assert!(detail.contains(told), "{process} {inputs}: {detail}");
    }
    for (request, told) in [
        (json!({ "inputs": {}, "outputs": { "cloud.laz": {} } }), "it has points.laz"),
        (json!({ "outputs": { "points.laz": { "transmissionMode": "carrier-pigeon" } } }), "carrier-pigeon"),
        (json!({ "inputs": {}, "output": {} }), "output"),
    ] {
        let answer = service.post_json("/processes/run/execution", &request, &[]);
        assert_eq!((answer.status, answer.header("content-type")), (400, "application/problem+json"));
        assert!(answer.text().contains(told), "{request}: {}", answer.text());
    }
    let body = json!({ "inputs": {}, "subscriber": { "successUri": "http://127.0.0.1:1/" } });
    assert_eq!(service.post_json("/processes/run/execution", &body, &[]).status, 400);
    let text = service.ask("POST", "/processes/run/execution", &[("Content-Type", "text/plain")], b"{}");
    assert_eq!(text.status, 415);
    let damaged = service.ask(
        "POST",
        "/processes/run/execution",
        &[("Content-Type", "application/json")],
        b"{\"inputs\": ",
    );
    assert_eq!(damaged.status, 400);
    assert_eq!(service.json("/jobs")["jobs"], json!([]));
}

#[test]
fn jobs_are_listed_filtered_and_dismissed() {
    let service = Service::start(&["--workers", "0"]);
    service.upload_fixture("room");
    let ids: Vec<String> = (0..3)
        .map(|seed| service.submit("run", &json!({ "survey": "room/survey.xml", "seed": seed })))
        .collect();
    let listed = |query: &str| -> Vec<Value> {
        service.json(&format!("/jobs{query}"))["jobs"].as_array().unwrap().clone()
    };
    assert_eq!(listed("").len(), 3);
    assert_eq!(listed("?limit=1")[0]["jobID"], ids[2].as_str());
    assert_eq!(listed("?limit=1&offset=2")[0]["jobID"], ids[0].as_str());
    assert_eq!(listed("?status=accepted,running&processID=run").len(), 3);
    assert_eq!(listed("?status=failed").len() + listed("?processID=plan").len(), 0);
    assert_eq!(service.get("/jobs?status=lost").status, 400);
    assert_eq!(listed("?processID=plan%2Crun").len(), 3);
    let page = service.json("/jobs?processID=run&limit=1");
    let next = page["links"].as_array().unwrap().iter().find(|link| link["rel"] == "next").unwrap();
    assert_eq!(next["href"], "/jobs?limit=1&offset=1&processID=run", "links keep their filters");
    for (address, told) in [
        ("/jobs?statsu=failed", "did you mean `status`?"),
        ("/jobs?status=%zz", "%zz"),
        ("/jobs/%ff", "%ff"),
        ("/conformance?x=1", "no parameter `x`"),
        ("/processes?f=xml", "json or html"),
    ] {
        let answer = service.get(address);
        assert_eq!((answer.status, answer.header("content-type")), (400, "application/problem+json"));
        assert!(answer.json()["detail"].as_str().unwrap().contains(told), "{address}: {}", answer.text());
    }
    assert_eq!(service.json("/processes?limit=2")["processes"].as_array().unwrap().len(), 2);
    assert_eq!(service.get(&format!("/jobs/{}/results", ids[0])).status, 404);
    let dismissed = service.ask("DELETE", &format!("/jobs/{}", ids[0]), &[], b"");
    assert_eq!((dismissed.status, dismissed.json()["status"].as_str()), (200, Some("dismissed")));
    assert_eq!(service.ask("DELETE", &format!("/jobs/{}", ids[0]), &[], b"").status, 410);
    assert_eq!(service.get(&format!("/jobs/{}/results", ids[0])).status, 410);
    assert_eq!(listed("?status=accepted").len(), 2);
}

#[test]
fn progress_is_streamed_until_the_end() {
    let service = Service::start(&[]);
    service.upload_fixture("room");
    let id = service.submit("run", &json!({ "survey": "room/survey.xml" }));
    let events = service.get(&format!("/jobs/{id}/events"));
    assert_eq!(events.header("content-type"), "text/event-stream");
    let text = events.text();
    let last = text.split("\n\n").filter(|event| event.contains("data:")).last().unwrap();
    assert!(last.starts_with("event: successful"), "{text}");
    let data: Value = serde_json::from_str(last.split_once("data: ").unwrap().1).unwrap();
    assert_eq!((data["status"].as_str(), data["progress"].as_u64()), (Some("successful"), Some(100)));
}
