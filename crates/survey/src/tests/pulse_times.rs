//! Pulse times of pipeline files.

use super::*;

/// The settings of the legs of a pipeline with these keys in `[settings]` and in those of its first leg.
fn settings(common: &str, own: &str) -> vlscan_base::Result<(Vec<ScannerSettings>, Diagnostics)> {
    let text = format!(
        "scene = \"a.obj\"\n[platform]\nkind = \"linear_path\"\n[scanner]\noptics = \"conic\"\nscan_angle_max_deg = 30\npulse_freqs_hz = [5000]\n\
         [settings]\n{common}\n[[leg]]\nposition_m = [0, 0, 0]\nspeed_m_per_s = 70\n[leg.settings]\nscan_freq_hz = 1\n{own}\n\
         [[leg]]\nposition_m = [5, 0, 0]\nactive = false\n"
    );
    let files = [
        ("p.toml", text.as_str()),
        ("a.obj", ""),
        ("t.txt", "# s\n0.25\n0.5\n1.25\n"),
        ("back.txt", "0\n2\n1\n"),
        ("early.txt", "-1\n2\n"),
        ("two.txt", "0 1\n"),
        ("one.txt", "3\n"),
        ("fast.txt", "0\n1e-11\n"),
    ];
    let folder = Folder::new(&files);
    let read = read_pipeline(&folder.path("p.toml"));
    read.map(|(survey, warnings)| (survey.legs.into_iter().map(|leg| leg.scanner).collect(), warnings))
}

#[test]
fn legs_have_the_times_of_all_or_their_own() {
    let recorded = PulseTimes::Recorded([0.25, 0.5, 1.25].into());
    let (legs, warnings) = settings("pulse_times = \"t.txt\"", "").unwrap();
    assert!(warnings.is_empty(), "{}", warnings.render(false));
    assert_eq!(legs[0].pulse_times, Some(recorded.clone()));
    assert_eq!((legs[0].pulse_freq, legs[0].pulse_rate()), (2, 2.0));
    let (legs, _) = settings("pulse_times = \"t.txt\"", "pulse_intervals_us = [100, 300]").unwrap();
    assert_eq!(legs[0].pulse_times, Some(PulseTimes::of_intervals(&[1e-4, 3e-4])));
    assert_eq!((legs[0].pulse_freq, legs[1].pulse_times.clone()), (5000, Some(recorded)));
    let (legs, warnings) = settings("pulse_times = \"t.txt\"", "pulse_freq_hz = 5000").unwrap();
    assert!(warnings.is_empty() && legs[0].pulse_times.is_none() && legs[0].pulse_freq == 5000);
    let (_, warnings) = settings("pulse_times = \"t.txt\"\npulse_freq_hz = 7", "").unwrap();
    contains(&warnings.render(false), &["`pulse_freq_hz` has no effect beside `pulse_times`"]);
}

#[test]
fn times_that_cannot_be_are_named_with_their_line() {
    for (keys, message) in [
        ("pulse_times = \"back.txt\"", "a time later than that of the line before"),
        ("pulse_times = \"early.txt\"", "a time from 0 to"),
        ("pulse_times = \"two.txt\"", "the time of a pulse in s"),
        ("pulse_times = \"one.txt\"", "has fewer than two times"),
        ("pulse_times = \"fast.txt\"", "pulses per second on average"),
        ("pulse_times = \"none.txt\"", "cannot find the file `none.txt`"),
        (
            "pulse_times = \"t.txt\"\npulse_intervals_us = [1]",
            "give either `pulse_times` or `pulse_intervals_us`",
        ),
        ("pulse_intervals_us = []", "numbers of µs"),
        ("pulse_intervals_us = [1, 0]", "numbers of µs"),
        ("pulse_intervals_us = 3", "expected"),
    ] {
        contains(&refused(settings(keys, "")), &[message, "^"]);
    }
}
