//! Warnings and errors of jobs, with their places and without the folders of the service.

use crate::client::{Service, files_of, fixtures};
use crate::jobs::{flight, with_field};
use serde_json::json;

#[test]
fn a_job_lists_its_warnings_with_place_and_help() {
    let service = Service::start(&[]);
    let mut files = files_of(&fixtures().join("room"));
    let survey = files.iter_mut().find(|(name, _)| name.ends_with("survey.xml")).unwrap();
    let text = String::from_utf8(survey.1.clone()).unwrap();
    survey.1 = text.replacen("pulseFreq_hz", "pulseFreq_Hz", 1).into_bytes();
    assert_eq!(service.upload("room", &files).status, 201);
    let job = service.run("run", &json!({ "survey": "room/survey.xml" }));
    assert_eq!(job["status"], "successful", "{job}");
    let warnings = job["warnings"].as_array().unwrap();
    let is_of_attribute = |text: &serde_json::Value| text.as_str().unwrap().contains("`pulseFreq_Hz`");
    let warning = warnings.iter().find(|warning| is_of_attribute(&warning["message"])).unwrap();
    assert!(warning["file"].as_str().unwrap().ends_with("room/survey.xml") && warning["line"] == 4, "{job}");
    assert!(warning["help"].as_str().unwrap().contains("pulseFreq_hz"), "{job}");
    let message = job["message"].as_str().unwrap();
    assert!(
        message.contains("warning: unknown attribute") && message.contains("room/survey.xml:4:"),
        "{message}"
    );
    assert!(message.contains(" pulses") && !message.contains("{"), "the summary of the run: {message}");
    for hidden in ["../", service.data.to_str().unwrap()] {
        assert!(!job["warnings"].to_string().contains(hidden) && !message.contains(hidden), "{job}");
    }
    let id = job["jobID"].as_str().unwrap();
    let page = service.ask("GET", &format!("/jobs/{id}"), &[("Accept", "text/html")], b"").text();
    assert!(page.contains("<summary>Warnings</summary><ul") && page.contains("room/survey.xml:4:"), "{page}");
    // A repeated request has the warnings of the first.
    let again = service.run("run", &json!({ "survey": "room/survey.xml" }));
    assert_eq!(again["warnings"], job["warnings"]);
}

#[test]
fn messages_name_inputs_and_no_options() {
    let service = Service::start(&[]);
    with_field(&service);
    let plan = json!({
        "kind": "airborne", "scene": "field/field.obj", "scanner": "riegl_vux-1uav", "height": -5, "density": 5
    });
    let refused = service.execute("plan", &plan);
    let detail = refused.text();
    assert!(refused.status == 422 && detail.contains("`height`") && !detail.contains("--"), "{detail}");
}

#[test]
fn a_failed_job_tells_the_error_with_its_place() {
    let service = Service::start(&[]);
    with_field(&service);
    let mut wrong = flight(1, 1);
    wrong["settings"]["pulse_freq_hx"] = json!(100_000);
    let job = service.run("run", &wrong);
    let message = job["message"].as_str().unwrap();
    assert!(job["status"] == "failed" && message.starts_with("error: "), "{job}");
    assert!(message.contains("pulse_freq_hx") && message.contains(" --> job.toml:"), "{message}");
    assert!(!message.contains("../") && !message.contains("\"kind\""), "{message}");
}
