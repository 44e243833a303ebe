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

/// A Python that has pyarrow, or `None` (with a printed note) where there is none.
fn python_with_pyarrow() -> Option<std::path::PathBuf> {
    let python = std::env::var("VLSCAN_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let works = Command::new(&python).args(["-c", "import pyarrow.parquet, numpy"]).output();
    if works.is_ok_and(|w| w.status.success()) {
        return Some(python.into());
    }
    println!("skipped: no python3 with pyarrow (pip install pyarrow)");
    None
}

#[test]
fn pyarrow_reads_streams_and_parquet_with_units_and_labels() {
    let Some(python) = python_with_pyarrow() else { return };
    let dir = folder();
    let survey = forest();
    let crs = r#"PROJCRS["ETRS89 / UTM zone 32N",ID["EPSG",25832]]"#;
    let usual = ["run", &survey, "-q", "--seed", "3", "--crs", crs];
    let sinks = ["-o", "a.arrow", "-o", "a.parquet", "-o", "a.csv", "-o", "a.xyz", "-o", "a.ply"];
    succeed(dir.path(), &[&usual[..], &sinks].concat());
    judge(
        &python,
        dir.path(),
        r#"
import pyarrow as pa, pyarrow.parquet as pq, pyarrow.csv as pc, numpy as np

stream = pa.ipc.open_stream("a.arrow")
batches = list(stream)
assert len(batches) > 1 and all(b.num_rows == batches[0].num_rows for b in batches[:-1])
table = pa.Table.from_batches(batches)
parquet = pq.read_table("a.parquet")
assert parquet.equals(table), "Parquet and Arrow differ"
table.validate(full=True)
for schema in (table.schema, parquet.schema):
    assert b"25832" in schema.metadata[b"crs"] and schema.metadata[b"generator"].startswith(b"vlscan")
    assert schema.field("X").metadata[b"unit"] == b"m"
    assert schema.field("GpsTime").metadata[b"unit"] == b"s"
    assert b"state" not in schema.metadata
types = {"X": "double", "Intensity": "uint16", "ReturnNumber": "uint8", "NumberOfReturns": "uint8",
         "Classification": "uint8", "ScanAngle": "float", "PointSourceId": "uint16", "GpsTime": "double",
         "ObjectId": "int32", "Part": "uint32", "Primitive": "uint32", "PulseNumber": "uint64"}
for name, kind in types.items():
    assert str(table.schema.field(name).type) == kind, (name, table.schema.field(name).type)

text = np.loadtxt("a.xyz")
at = lambda name: table[name].to_numpy()
for i, name in enumerate(("X", "Y", "Z", "Amplitude", "EchoWidth")):
    assert np.abs(at(name) - text[:, i]).max() < 6e-5, name
for i, name in ((5, "ReturnNumber"), (6, "NumberOfReturns"), (7, "PulseNumber"), (8, "ObjectId"), (9, "Classification")):
    assert (at(name) == text[:, i]).all(), name
assert np.abs(at("GpsTime") - text[:, 10]).max() < 1e-8
off = at("Range") - at("TrueRange")
assert np.abs(off).max() < 5 and 0.001 < np.median(np.abs(off)) < 0.2, np.median(np.abs(off))
assert at("IncidenceAngle").min() >= 0 and at("IncidenceAngle").max() <= 90.001
assert len(set(at("Primitive"))) > 100

csv = pc.read_csv("a.csv")
assert csv.column_names == table.column_names
for name in csv.column_names:
    assert np.allclose(csv[name].to_numpy(), at(name), atol=6e-5), name
"#,
    );
}

#[test]
fn columns_are_chosen_and_misses_are_among_the_points() {
    let dir = folder();
    let survey = forest();
    let columns = "X,Y,Z,NumberOfReturns,PulseNumber,BeamDirectionZ";
    let usual = ["run", &survey, "-q", "--columns", columns, "--misses"];
    succeed(dir.path(), &[&usual[..], &["-o", "a.csv", "-o", "a.xyz", "--pulses"]].concat());
    let read = |name: &str| std::fs::read_to_string(dir.path().join(name)).unwrap();
    let (csv, xyz) = (read("a.csv"), read("a.xyz"));
    assert_eq!(csv.lines().next().unwrap(), columns);
    assert_eq!(csv.replace(',', " "), xyz);
    // Every pulse is there: as echoes, or once as a miss that points downward from the aeroplane.
    let rows: Vec<Vec<f64>> =
        csv.lines().skip(1).map(|l| l.split(',').map(|w| w.parse().unwrap()).collect()).collect();
    let missed: Vec<_> = rows.iter().filter(|r| r[3] == 0.0).collect();
    let mut numbers: Vec<f64> = rows.iter().map(|r| r[4]).collect();
    assert!(numbers.is_sorted(), "misses are not in the order of emission");
    numbers.dedup();
    assert_eq!(numbers.len(), read("a_pulse.txt").lines().count());
    assert!(missed.len() > 10 && missed.len() < rows.len(), "{} of {}", missed.len(), rows.len());
    assert!(missed.iter().all(|r| r[2] > 200.0 && r[5] < -0.5), "{:?}", missed[0]);

    let wrong = common::run(dir.path(), &["run", &survey, "-o", "b.csv", "--columns", "X,Hight"]);
    assert_eq!(wrong.status.code(), Some(2));
    assert!(text(&wrong.stderr).contains("TrueRange"), "{}", text(&wrong.stderr));
    let nowhere = common::run(dir.path(), &["run", &survey, "-o", "b.las", "--columns", "X"]);
    assert_eq!(nowhere.status.code(), Some(2));
}

#[test]
fn las_and_ply_get_labels_and_misses() {
    let Some(python) = python_with_laspy() else { return };
    let dir = folder();
    let survey = forest();
    let usual = ["run", &survey, "-q", "--labels", "--misses"];
    let sinks = ["-o", "a.las", "-o", "a.laz", "-o", "a.ply", "-o", "a.csv"];
    succeed(dir.path(), &[&usual[..], &sinks].concat());
    judge(
        &python,
        dir.path(),
        r#"
import laspy, numpy as np
head = open("a.csv").readline().strip().split(",")
rows = np.loadtxt("a.csv", delimiter=",", skiprows=1)
at = lambda name: rows[:, head.index(name)]
missed = at("NumberOfReturns") == 0
assert 0 < missed.sum() < len(rows)
for name in ("a.las", "a.laz"):
    las = laspy.read(name)
    assert len(las) == len(rows)
    assert (las["part"] == at("Part")).all() and (las["primitive"] == at("Primitive")).all()
    assert np.abs(las["true_range"] - at("TrueRange")).max() < 1e-3
    assert (np.array(las.withheld, bool) == missed).all()
    assert (las.number_of_returns == at("NumberOfReturns")).all()
    for axis in "XYZ":
        assert np.abs(las["BeamDirection" + axis] - at("BeamDirection" + axis)).max() < 1e-6
    assert sum(las.header.number_of_points_by_return) == (~missed).sum()
ply = open("a.ply", "rb").read()
header, body = ply.split(b"end_header\n", 1)
names = {"double": "<f8", "float": "<f4", "uchar": "u1", "int": "<i4", "ushort": "<u2", "uint": "<u4"}
fields = [l.split() for l in header.decode().splitlines() if l.startswith("property")]
points = np.frombuffer(body, np.dtype([(n, names[t]) for _, t, n in fields]))
assert len(points) == len(rows)
assert (points["primitive"] == at("Primitive")).all()
assert np.abs(points["beam_direction_z"] - at("BeamDirectionZ")).max() < 1e-6
"#,
    );
}

#[test]
fn las_leaves_at_once_with_an_upper_bound_in_its_header() {
    let Some(python) = python_with_laspy() else { return };
    let dir = folder();
    let survey = forest();
    let usual = ["run", &survey, "-q", "--format", "las", "-o", "-", "--las-at-most"];
    let piped = succeed(dir.path(), &[&usual[..], &["10M"]].concat());
    std::fs::write(dir.path().join("piped.las"), &piped.stdout).unwrap();
    succeed(dir.path(), &["run", &survey, "-q", "-o", "exact.las"]);
    judge(
        &python,
        dir.path(),
        r#"
import laspy, io, numpy as np
exact, piped = laspy.read("exact.las"), laspy.read("piped.las")
assert piped.header.point_count >= len(exact)
assert len(piped.points) == len(exact.points), (len(piped.points), len(exact.points))
assert (piped.points.array == exact.points.array).all()
assert (piped.header.mins <= exact.header.mins).all() and (piped.header.maxs >= exact.header.maxs).all()
assert open("piped.las", "rb").read()[107 + 140:][:8] == (10**7).to_bytes(8, "little")
"#,
    );
    let few = common::run(dir.path(), &[&usual[..], &["10"]].concat());
    assert_eq!(few.status.code(), Some(2));
    assert!(text(&few.stderr).contains("--las-at-most"), "{}", text(&few.stderr));
}
