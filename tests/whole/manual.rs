//! The manual pages in `man/` are up to date with the command line, and shells accept the completions.

use crate::common;
use crate::common::{files, folder, succeed, text};
use std::path::Path;
use std::process::Command;

#[test]
fn the_pages_in_man_are_those_of_this_command_line() {
    let kept = Path::new(env!("CARGO_MANIFEST_DIR")).join("man");
    let made = folder();
    succeed(made.path(), &["man", ".", "-q"]);
    let renew = "the command line has changed: renew the manual with `cargo run -- man man` and commit man/";
    assert_eq!(files(&kept), files(made.path()), "{renew}\n(remove pages of commands that are no more)");
    for name in files(&kept) {
        let (kept, made) =
            (std::fs::read(kept.join(&name)).unwrap(), std::fs::read(made.path().join(&name)).unwrap());
        assert!(kept == made, "man/{} is stale: {renew}", name.display());
    }
}

#[test]
fn the_options_of_the_python_package_are_those_of_this_command_line() {
    let made = folder();
    succeed(made.path(), &["man", "--python", "."]);
    let kept = Path::new(env!("CARGO_MANIFEST_DIR")).join("python/vlscan/_options.py");
    let (kept, made) =
        (std::fs::read(kept).unwrap(), std::fs::read(made.path().join("_options.py")).unwrap());
    assert!(kept == made, "python/vlscan/_options.py is stale: `cargo run -- man --python python/vlscan`");
}

#[test]
fn man_finds_nothing_wrong_with_them() {
    let pages = Path::new(env!("CARGO_MANIFEST_DIR")).join("man");
    for name in files(&pages) {
        let checked =
            Command::new("groff").args(["-man", "-ww", "-z", "-Tutf8"]).arg(pages.join(&name)).output();
        let Ok(checked) = checked else {
            common::missing("groff", "apt install groff");
            return;
        };
        assert!(
            checked.status.success() && checked.stderr.is_empty(),
            "{}: {}",
            name.display(),
            text(&checked.stderr)
        );
    }
}

#[test]
fn every_shell_gets_completions() {
    let dir = folder();
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = text(&succeed(dir.path(), &["completions", shell]).stdout);
        assert!(
            script.contains("vlscan") && script.contains("--max-memory") || script.contains("max-memory"),
            "{shell}"
        );
        let path = dir.path().join(shell);
        std::fs::write(&path, script).unwrap();
        // A shell that is installed reads its own script.
        let read = match shell {
            "bash" => "source $0 && complete -p vlscan",
            "fish" | "zsh" => "source $0",
            _ => continue,
        };
        match Command::new(shell).args(["-c", read]).arg(&path).output() {
            Ok(read) if shell == "zsh" => {
                // compdef exists in interactive shells only
                assert!(!text(&read.stderr).contains("parse error"), "{shell}: {}", text(&read.stderr));
            }
            Ok(read) => assert!(read.status.success(), "{shell}: {}", text(&read.stderr)),
            Err(_) => common::missing(shell, &format!("apt install {shell}")),
        }
    }
}
