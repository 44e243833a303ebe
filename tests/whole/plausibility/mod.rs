//! Mistakes that are easy to make: each ends with an error, or with a warning that `--strict` makes an error,
//! whose text names the cause. Correct input runs without a message.

mod files;
mod inputs;
mod instruments;
mod numbers;

use crate::common::{feed, fixture, folder, raster, run, succeed, text};
use files::{areas_and_inventories, words_and_files};
use inputs::*;
use numbers::plausible_numbers;
use std::fs;

/// A mistake, and what the program must say about it.
struct Mistake {
    name: &'static str,
    /// Files in the folder, besides those of `fixtures/terrain`.
    files: Vec<(&'static str, Vec<u8>)>,
    line: &'static str,
    stdin: String,
    answer: &'static str,
    /// A note that does not end a run with `--strict`.
    is_note: bool,
}

/// A mistake of a command line over the files of `fixtures/terrain`.
fn typed(name: &'static str, line: &'static str, answer: &'static str) -> Mistake {
    Mistake { name, files: Vec::new(), line, stdin: String::new(), answer, is_note: false }
}

/// A mistake in a file.
fn written(
    name: &'static str,
    file: &'static str,
    content: impl AsRef<[u8]>,
    line: &'static str,
    answer: &'static str,
) -> Mistake {
    Mistake { files: vec![(file, content.as_ref().to_vec())], ..typed(name, line, answer) }
}

/// A mistake in a stream of poses over a scene.
fn flown(name: &'static str, line: &'static str, poses: String, answer: &'static str) -> Mistake {
    Mistake { stdin: poses, ..typed(name, line, answer) }
}

#[test]
fn instruments_and_legs_that_contradict_themselves_are_reported() {
    check(&instruments::instruments());
}

#[test]
fn milliseconds_end_a_strict_run_before_anything_is_flown() {
    let mistake = recording("", in_milliseconds(&poses(UTM, TO_EAST)), "");
    let done = make(&mistake, true);
    let said = text(&done.stderr);
    assert_eq!((done.status.code(), said.matches("m/s on average").count()), (Some(2), 1), "{said}");
    assert!(!said.contains("what was measured"), "{said}");
}

/// Writes the files of a mistake and runs its command.
fn make(mistake: &Mistake, strict: bool) -> std::process::Output {
    let dir = folder();
    fs::create_dir(dir.path().join("sub")).unwrap();
    let lay = |name: &str, content: &[u8]| fs::write(dir.path().join(name), content).unwrap();
    for entry in fs::read_dir(fixture("terrain")).unwrap() {
        let path = entry.unwrap().path();
        lay(path.file_name().unwrap().to_str().unwrap(), &fs::read(&path).unwrap());
    }
    lay("utm.xml", utm_scene().as_bytes());
    lay("local.toml", stream("scene.xml#terrain").as_bytes());
    lay("utm.toml", stream("utm.xml#terrain").as_bytes());
    lay("wgs.toml", stream("utm.xml#terrain").as_bytes());
    let bare =
        stream("scene.xml#terrain").replace("[platform]\ncatalogue = \"data/platforms.xml#sr22\"\n", "");
    lay("bare.toml", bare.as_bytes());
    lay("dem.xml", raster_scene().as_bytes());
    let legs = "[[leg]]\nposition_m = [0, 0, 900]\nspeed_m_per_s = 60\n[[leg]]\nposition_m = [60, 0, 900]\nactive = false\n";
    lay("dem.toml", (pipeline("dem.xml#dem", "") + legs).as_bytes());
    lay("flight.toml", stream("dem.xml#dem").as_bytes());
    lay("taken.xyz", b"1 2 3\n");
    mistake.files.iter().for_each(|(name, content)| lay(name, content));
    let takes_strict = ["run ", "plan ", "scene "].iter().any(|command| mistake.line.starts_with(command));
    let strict = ["--strict"].into_iter().filter(|_| strict && takes_strict);
    let words: Vec<&str> = mistake.line.split(' ').chain(strict).collect();
    feed(dir.path(), &words, mistake.stdin.as_bytes())
}

fn check(mistakes: &[Mistake]) {
    let mut wrong = Vec::new();
    for mistake in mistakes {
        let done = make(mistake, false);
        let said = text(&done.stderr);
        let warned = !done.status.success() || mistake.is_note || said.contains("warning:");
        if !(warned && said.contains(mistake.answer)) {
            wrong.push(format!("{} ({}): no {:?} in\n{said}", mistake.name, done.status, mistake.answer));
        }
        let status = make(mistake, true).status.code();
        if !mistake.is_note && !matches!(status, Some(1..=3)) {
            wrong.push(format!("{}: status {status:?} with --strict", mistake.name));
        }
    }
    assert!(wrong.is_empty(), "{} of {}:\n{}", wrong.len(), mistakes.len(), wrong.join("\n"));
}

#[test]
fn numbers_that_cannot_be_meant_are_answered_with_their_cause() {
    check(&plausible_numbers());
}

#[test]
fn areas_and_inventories_that_are_not_used_as_written_are_told() {
    check(&areas_and_inventories());
}

#[test]
fn words_and_files_that_are_wrong_are_answered_with_their_cause() {
    check(&words_and_files());
    assert!(plausible_numbers().len() + words_and_files().len() >= 47);
}

#[test]
fn what_is_right_runs_without_a_word() {
    let right = [
        flown("a flight", STREAM, poses([0.0, 0.0, 400.0], TO_EAST), ""),
        flown("a flight in UTM", OVER_UTM, poses(UTM, TO_EAST), ""),
        // The first seconds are flown beside the scene, and nothing is measured in them.
        approach(
            "a flight that reaches the scene late",
            with_times(&along([-60.0, 0.0, 400.0], [8.0, 0.0, 0.0], TO_EAST), 4.0),
        ),
        approach(
            "an approach from 4 km away",
            with_times(&along([-1900.0, 0.0, 400.0], [42.0, 0.0, 0.0], TO_EAST), 20.0),
        ),
        flown("a level flight to the north", STREAM, along([0.0, 0.0, 400.0], [0.0, 0.6, 0.0], [0.0; 3]), ""),
        flown(
            "a flight in radians that says so",
            STREAM,
            poses([0.0, 0.0, 400.0], [0.01, 0.02, 1.56])
                .replace("roll,pitch,yaw", "roll_rad,pitch_rad,yaw_rad"),
            "",
        ),
        flown(
            "the same by an option",
            "run local.toml -o a.xyz --trajectory-angles rad",
            poses([0.0, 0.0, 400.0], [0.01, 0.02, 1.56]),
            "",
        ),
        written(
            "a tripod on the ground",
            "t.xml",
            tripod("x=\"0\" y=\"0\" onGround=\"true\""),
            "run t.xml -o a.xyz",
            "",
        ),
        // Its pulse is 5 ns wide at half maximum, which only the refined physics takes so.
        written(
            "bins that are wider than a short pulse, and narrower than that of the instrument",
            "t.xml",
            tripod("x=\"0\" y=\"0\" onGround=\"true\"").replacen(
                "<leg>",
                "<FWFSettings binSize_ns=\"6\" winSize_ns=\"12\"/><leg>",
                1,
            ),
            "run t.xml -o a.xyz --physics refined",
            "",
        ),
        written(
            "a raster in metres",
            "dem.tif",
            raster([0.0, 30.0], 10.0, None),
            "run dem.toml -o a.xyz --physics helios",
            "",
        ),
    ];
    for mistake in &right {
        let done = make(mistake, true);
        let said = text(&done.stderr);
        assert!(
            done.status.success() && !said.contains("warning") && !said.contains("error"),
            "{}: {said}",
            mistake.name
        );
    }
}

/// Every command that reads input of the user, with input that is warned of: an error with --strict, which
/// writes nothing.
#[test]
fn strict_is_for_all_commands() {
    let dir = folder();
    let write = |name: &str, text: &str| fs::write(dir.path().join(name), text).unwrap();
    write("flat.obj", "v -50 -50 0\nv 50 -50 0\nv 50 50 0\nv -50 50 0\nusemtl nowhere\nf 1 2 3 4\n");
    write("trees.csv", "id,x,y,height,species\na,0,0,9,beech\nb,0,0,9,beech\n");
    fs::create_dir(dir.path().join("models")).unwrap();
    fs::copy(fixture("forest/beech.obj"), dir.path().join("models/beech_1.obj")).unwrap();
    write("cloud.xyz", "0 0 0\n1 0 0\nnan nan nan\n1 1 1\n");
    let area = "POLYGON ((-9 -9, 9 -9, 9 9, -9 9))";
    let plan =
        ["plan", "airborne", "--scanner", "riegl_vux-1uav", "--height", "60", "--speed", "8", "--area", area];
    let commands: [(&[&str], &str); 6] = [
        (&["scene", "info", "flat.obj"], ""),
        (&["scene", "info", "flat.obj", "--json"], ""),
        (&["scene", "pack", "flat.obj", "-o", "flat.vlscene"], "flat.vlscene"),
        (&["scene", "stand", "trees.csv", "--trees", "models", "-o", "stand"], "stand"),
        (&["preview", "cloud.xyz", "-o", "cloud.png"], "cloud.png"),
        (&[&plan[..], &["--scene", "flat.obj", "-o", "plan.toml"]].concat(), "plan.toml"),
    ];
    for (command, made) in commands {
        let strict = run(dir.path(), &[command, &["--strict"]].concat());
        assert_eq!(strict.status.code(), Some(2), "{command:?}: {}", text(&strict.stderr));
        assert!(strict.stdout.is_empty(), "{command:?}");
        assert!(made.is_empty() || !dir.path().join(made).exists(), "{command:?}");
        succeed(dir.path(), command);
        assert!(made.is_empty() || dir.path().join(made).exists(), "{command:?}");
    }
}
