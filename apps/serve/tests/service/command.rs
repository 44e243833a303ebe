//! The commands: `vlscan serve`, tokens, and the restrictions of processes.

use crate::client::vlscan;
use std::net::TcpListener;
use std::path::Path;
use std::process::{Command, Output};

fn text(output: &[u8]) -> String {
    String::from_utf8_lossy(output).into_owned()
}

#[test]
fn vlscan_serve_starts_this_program_or_tells_how_to_install_it() {
    let help = Command::new(vlscan()).args(["serve", "--help"]).output().unwrap();
    assert!(help.status.success(), "{}", text(&help.stderr));
    assert!(
        text(&help.stdout).contains("Usage: vlscan serve") && text(&help.stdout).contains("--token-file")
    );
    let folder = tempfile::tempdir().unwrap();
    let alone = folder.path().join("vlscan");
    if std::fs::hard_link(vlscan(), &alone).is_err() {
        std::fs::copy(vlscan(), &alone).unwrap();
    }
    let absent = Command::new(alone).arg("serve").env("PATH", folder.path()).output().unwrap();
    assert_eq!(absent.status.code(), Some(2));
    let told = text(&absent.stderr);
    assert!(told.contains("needs the program vlscan-serve") && told.contains("cargo install"), "{told}");
}

fn serve(words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_vlscan-serve")).args(words).output().unwrap()
}

#[test]
fn tokens_are_shown_once_and_kept_as_hashes() {
    let made = serve(&["token", "anna", "--quota", "2G"]);
    let (line, told) = (text(&made.stdout), text(&made.stderr));
    let token = told.trim().rsplit(' ').next().unwrap();
    assert!(line.starts_with("anna sha256:") && line.ends_with(" 2000000000\n"), "{line}");
    assert!(token.len() == 64 && !line.contains(token));
    assert_eq!(serve(&["token", "a/b"]).status.code(), Some(2));
}

/// Runs a program under restrictions.
fn confined(read: &Path, write: &Path, program: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_vlscan-serve"));
    command.arg("confine").arg("--read").arg(read).arg("--write").arg(write);
    command
        .args(["--memory", "1G", "--time", "20", "--file-size", "1k", "--"])
        .args(program)
        .output()
        .unwrap()
}

#[test]
fn a_start_tells_why_a_program_cannot_be_executed_in_the_sandbox() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("program");
    // The interpreter is not one of the libraries that a job can read.
    let script = format!("#!/usr/bin/env sh\nexec {} \"$@\"\n", vlscan().display());
    std::fs::write(&program, script).unwrap();
    std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
    let data = folder.path().join("data");
    let options = ["--listen", "127.0.0.1:0", "--program", program.to_str().unwrap(), "--data"];
    let told = serve(&[&options[..], &[data.to_str().unwrap()]].concat());
    let message = text(&told.stderr);
    assert_eq!(told.status.code(), Some(2), "{message}");
    assert!(message.contains("the sandbox of jobs fails"), "{message}");
}

#[test]
fn a_program_without_messages_in_json_is_refused_at_the_start() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("program");
    let refusal = "echo \"error: unexpected argument '$1' found\" >&2; exit 2";
    let script = format!(
        "#!/bin/sh\ncase \"$1\" in --message-format*) {refusal};; esac\nexec {} \"$@\"\n",
        vlscan().display()
    );
    std::fs::write(&program, script).unwrap();
    std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
    let data = folder.path().join("data");
    let options = ["--listen", "127.0.0.1:0", "--program", program.to_str().unwrap(), "--data"];
    let told = serve(&[&options[..], &[data.to_str().unwrap()]].concat());
    let message = text(&told.stderr);
    assert_eq!(told.status.code(), Some(2), "{message}");
    assert!(message.contains("unexpected argument '--message-format=json'"), "{message}");
}

#[test]
fn restricted_processes_reach_their_own_files_only_and_no_network() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for name in ["in", "out", "else"] {
        std::fs::create_dir(at(name)).unwrap();
        std::fs::write(at(name).join("file"), "text").unwrap();
    }
    std::os::unix::fs::symlink(at("else"), at("in/link")).unwrap();
    let bash = |script: &str| confined(&at("in"), &at("out"), &["/bin/bash", "-c", script]);
    let path = |name: &str| at(name).display().to_string();
    let ours = bash(&format!("echo $(< {}) > {}", path("in/file"), path("out/copy")));
    assert!(ours.status.success(), "{}", text(&ours.stderr));
    assert_eq!(std::fs::read_to_string(at("out/copy")).unwrap(), "text\n");
    for script in [
        format!("echo $(< {})", path("else/file")),
        format!("echo $(< {}/in/link/file)", folder.path().display()),
        format!("echo $(< {}/in/../else/file)", folder.path().display()),
        "echo $(< /etc/passwd)".to_owned(),
        "echo $(< /proc/1/environ)".to_owned(),
    ] {
        let tried = bash(&script);
        assert!(text(&tried.stdout).trim().is_empty() && !tried.stderr.is_empty(), "{script}: {tried:?}");
    }
    for name in ["in/file", "in/new", "else/file", "else/new", "new"] {
        assert!(!bash(&format!("echo changed > {}", path(name))).status.success(), "{name}");
    }
    assert!(!at("new").exists() && std::fs::read_to_string(at("else/file")).unwrap() == "text");
    assert!(!bash("/bin/ls").status.success(), "no other program");
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    assert!(!bash(&format!("echo hello > /dev/tcp/127.0.0.1/{port}")).status.success());
    assert!(!bash(&format!("echo hello > /dev/udp/127.0.0.1/{port}")).status.success());
    let large = bash(&format!("printf '%02000d' 1 > {}", path("out/large")));
    assert!(!large.status.success() && std::fs::metadata(at("out/large")).unwrap().len() <= 1000);
}
