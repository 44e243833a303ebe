//! What is written, as other people's readers read it.

mod common;

use common::{fixture, folder, python_with_laspy, succeed, text};
use std::path::Path;
use std::process::Command;

fn forest() -> String {
    fixture("forest/survey.xml").to_str().unwrap().to_owned()
}

/// Runs a script in `folder`; it fails by raising.
fn judge(python: &Path, folder: &Path, script: &str) {
    let judged = Command::new(python).arg("-c").arg(script).current_dir(folder).output().unwrap();
    assert!(judged.status.success(), "{}", text(&judged.stderr));
}

#[test]
fn laspy_finds_the_waveforms_of_the_points() {
    let Some(python) = python_with_laspy() else { return };
    let dir = folder();
    let run = |places: &[&str]| {
        let survey = forest();
        let usual = ["run", &survey, "-q", "--seed", "3", "--waveforms", "--waveform-noise"];
        succeed(dir.path(), &[&usual[..], places].concat());
    };
    run(&["-o", "a.las", "-o", "a.laz", "--wave-packets", "inside"]);
    run(&["-o", "b.las", "--wave-packets", "beside"]);
    run(&["-o", "c.laz", "--wave-packets", "beside"]);
    judge(
        &python,
        dir.path(),
        r#"
import laspy, numpy as np, struct

text = {}
for line in open("a_fullwave.txt"):
    words = line.split()
    text[int(words[0])] = np.array(words[1:], float)
assert len(text) > 1000

for name in ("a.las", "a.laz", "b.las", "c.laz"):
    las = laspy.read(name)
    h = las.header
    assert h.point_format.id == 9, h.point_format
    inside = name.startswith("a")
    assert h.global_encoding.waveform_data_packets_internal == inside
    assert h.global_encoding.waveform_data_packets_external == (not inside)
    if inside:
        raw = open(name, "rb").read()[h.start_of_waveform_data_packet_record:]
    else:
        raw = open(name[0] + ".wdp", "rb").read()
    assert raw[2:11] == b"LASF_Spec" and raw[18:20] == b"\xff\xff"
    assert struct.unpack("<Q", raw[20:28])[0] == len(raw) - 60
    how = {v.record_id - 99: v.record_data_bytes() for v in h.vlrs if 100 <= v.record_id <= 354}
    how = {i: struct.unpack("<BBIIdd", d) for i, d in how.items()}
    index, at, size = (np.array(las["wavepacket_" + n]) for n in ("index", "offset", "size"))
    location, number = np.array(las.return_point_wave_location), np.array(las["fullwaveIndex"])
    steps = np.column_stack([las.x_t, las.y_t, las.z_t]).astype(float)
    seen = set()
    xyz = np.column_stack([las.x, las.y, las.z])
    worst = 0
    for i in range(len(las)):
        bits, packed, samples, spacing, gain, offset = how[int(index[i])]
        assert (bits, packed) == (16, 0) and size[i] == 2 * samples
        got = offset + gain * np.frombuffer(raw, "<u2", samples, int(at[i]))
        wave = text[int(number[i])]
        put = wave[10 - 1:]
        assert len(got) >= len(put) and (got[len(put):] == 0).all()
        assert np.abs(got[:len(put)] - put).max() <= 0.51 * gain + 1e-9, (got, put)
        assert gain <= max(np.abs(put).max(), 1e-13) / 1000, (gain, np.abs(put).max())
        seen.add(int(number[i]))
        # The first sample lies where the text has it: origin + direction * c * start.
        step = steps[i]
        first = xyz[i] + location[i] * step
        start = wave[:3] + wave[3:6] / np.linalg.norm(wave[3:6]) * 0.299792458 * wave[6]
        worst = max(worst, np.abs(first - start).max())
        assert 0 <= location[i] <= (len(put) + 8) * spacing
        assert abs(np.linalg.norm(step) * spacing - 0.299792458 * (wave[7] - wave[6]) / max(len(put) - 1, 1)) < 1e-4
    # Directions have four decimals in the text.
    assert worst < 0.1, worst
    assert seen == set(text), (len(seen), len(text))
"#,
    );
}

#[test]
fn packets_are_the_same_for_any_threads_and_chunks() {
    let bytes = |extra: &[&str]| {
        let dir = folder();
        let survey = forest();
        let usual = ["run", &survey, "-q", "--waveform-noise", "-o", "a.laz", "--wave-packets", "beside"];
        succeed(dir.path(), &[&usual[..], extra].concat());
        ["a.laz", "a.wdp"].map(|name| std::fs::read(dir.path().join(name)).unwrap())
    };
    let one = bytes(&["-j", "1"]);
    assert!(one[1].len() > 100_000);
    assert!(one == bytes(&["-j", "8", "--chunk-size", "37"]));
}
