//! Versions of files, tokens, cookies and names of hosts, as HTTP has them.

use crate::client::Service;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

const FORM: (&str, &str) = ("Content-Type", "application/x-www-form-urlencoded");

#[test]
fn versions_of_an_upload_do_not_mix() {
    let service = Service::start(&["--workers", "0"]);
    let path = "/uploads/a/files/a.obj";
    assert_eq!(service.upload("a", &[("a.obj", b"first version".to_vec())]).status, 201);
    let whole = service.get(path);
    let tag = whole.header("etag").to_owned();
    assert!(tag.len() > 20 && tag.starts_with('"') && tag.ends_with('"'), "{tag}");
    assert_eq!(service.get(path).header("etag"), tag);
    let known = service.ask("GET", path, &[("If-None-Match", &tag)], b"");
    assert_eq!((known.status, known.body.len(), known.header("etag")), (304, 0, tag.as_str()));
    let range = [("Range", "bytes=6-"), ("If-Range", tag.as_str())];
    let part = service.ask("GET", path, &range, b"");
    assert_eq!((part.status, part.text().as_str()), (206, "version"));

    assert_eq!(service.ask("DELETE", "/uploads/a", &[], b"").status, 204);
    assert_eq!(service.upload("a", &[("a.obj", b"other content".to_vec())]).status, 201);
    let part = service.ask("GET", path, &range, b"");
    assert_eq!((part.status, part.text().as_str()), (200, "other content"));
    assert_ne!(part.header("etag"), tag);
    assert_eq!(service.ask("GET", path, &[("If-None-Match", &tag)], b"").status, 200);
    let beyond = service.ask("GET", path, &[("Range", "bytes=99-")], b"");
    assert_eq!((beyond.status, beyond.header("content-range")), (416, "bytes */13"));
}

#[test]
fn names_of_schemes_and_hosts_have_no_case() {
    let service = Service::with_token(&["--workers", "0"], "a-token-that-nobody-guesses");
    for (value, status) in [
        ("bearer a-token-that-nobody-guesses", 200),
        ("BEARER  a-token-that-nobody-guesses", 200),
        ("Basic a-token-that-nobody-guesses", 401),
        ("Bearera-token-that-nobody-guesses", 401),
        ("a-token-that-nobody-guesses", 401),
        ("Bearer", 401),
    ] {
        let answer = service.ask_stranger("GET", "/jobs", &[("Authorization", value)], b"");
        assert_eq!(answer.status, status, "{value}");
    }
    let open = Service::start(&["--workers", "0", "--host", "LocalHost."]);
    for (host, status) in [
        ("LOCALHOST", 200),
        ("localhost.:80", 200),
        ("[::1]:80", 200),
        ("localhost.example.org", 421),
        (".", 421),
    ] {
        assert_eq!(open.ask_stranger("GET", "/jobs", &[("Host", host)], b"").status, status, "{host}");
    }
}

/// Makes a token of an owner: the token, and its line of the file.
fn make(owner: &str) -> (String, String) {
    let made = Command::new(env!("CARGO_BIN_EXE_vlscan-serve")).args(["token", owner]).output().unwrap();
    let token = String::from_utf8(made.stderr).unwrap().trim().rsplit(' ').next().unwrap().to_owned();
    (token, String::from_utf8(made.stdout).unwrap())
}

fn status(service: &Service, token: &str) -> u16 {
    let bearer = format!("Bearer {token}");
    service.ask_stranger("GET", "/jobs", &[("Authorization", &bearer)], b"").status
}

/// Writes the file of tokens and waits until a token has a status.
fn reload(service: &Service, file: &Path, text: &str, token: &str, expected: u16) {
    std::fs::write(file, text).unwrap();
    service.signal("HUP");
    let start = Instant::now();
    while status(service, token) != expected {
        assert!(start.elapsed() < Duration::from_secs(20), "{text}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn tokens_are_read_again_on_a_signal() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("tokens");
    let (anna, first) = make("anna");
    let (ben, second) = make("ben");
    let (eve, third) = make("eve");
    std::fs::write(&file, format!("{first}{second}")).unwrap();
    let service = Service::start(&["--workers", "0", "--token-file", file.to_str().unwrap()]);
    let login = service.ask_stranger("POST", "/login", &[FORM], format!("token={anna}").as_bytes());
    let cookie = login.header("set-cookie").split(';').next().unwrap().to_owned();
    let by_cookie = || service.ask_stranger("GET", "/jobs", &[("Cookie", &cookie)], b"").status;
    assert_eq!((by_cookie(), status(&service, &ben), status(&service, &eve)), (200, 200, 401));
    // Anna's token is revoked, and with it her session.
    reload(&service, &file, &format!("{second}{third}"), &eve, 200);
    let start = Instant::now();
    while by_cookie() != 401 {
        assert!(start.elapsed() < Duration::from_secs(20), "the session goes on");
    }
    assert_eq!((status(&service, &anna), status(&service, &ben)), (401, 200));
    // An edit that fails changes nothing, and lets nobody in.
    for damaged in ["", "anna\n"] {
        std::fs::write(&file, damaged).unwrap();
        service.signal("HUP");
        std::thread::sleep(Duration::from_millis(200));
        assert_eq!((status(&service, &eve), status(&service, &anna)), (200, 401), "{damaged:?}");
    }
    reload(&service, &file, &first, &anna, 200);
    assert_eq!((status(&service, &ben), status(&service, "")), (401, 401));
}

#[test]
fn services_on_ports_of_a_host_do_not_end_each_others_sessions() {
    let token = "a-token-that-nobody-guesses";
    let services = [0, 1].map(|_| Service::with_token(&["--workers", "0"], token));
    let cookies = services.each_ref().map(|service| {
        let login = service.ask_stranger("POST", "/login", &[FORM], format!("token={token}").as_bytes());
        login.header("set-cookie").split(';').next().unwrap().to_owned()
    });
    let names = cookies.each_ref().map(|cookie| cookie.split('=').next().unwrap());
    assert_ne!(names[0], names[1]);
    for service in &services {
        let both = cookies.join("; ");
        assert_eq!(service.ask_stranger("GET", "/jobs", &[("Cookie", &both)], b"").status, 200);
    }
}
