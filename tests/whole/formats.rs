//! Outputs, read back by other programs and libraries.

use crate::common::{self, fixture, folder, forest, judge, python_with_laspy, run, succeed, text};
use vlscan::formats::Attribute;

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

#[test]
fn pyarrow_reads_streams_and_parquet_with_units_and_labels() {
    let Some(python) = common::python("pyarrow, numpy") else { return };
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
fn geoparquet_has_its_geometry_box_and_system() {
    let Some(python) = common::python("pyarrow, pyproj") else { return };
    let dir = folder();
    let survey = forest();
    let usual = ["run", &survey, "-q", "--seed", "3", "-o", "a.parquet"];
    let systems = ["25832", "5555", "2056", "31370", "3035", "31467", "2193", "28992"];
    for (number, code) in systems.iter().enumerate() {
        let geo = format!("{code}.geo.parquet");
        let more = ["-o", &geo, "--crs", code, "--columns", "Range,ObjectId"];
        let (usual, more) = if number == 0 { (&usual[..], &more[..4]) } else { (&usual[..5], &more[..]) };
        succeed(dir.path(), &[usual, more].concat());
    }
    let wkt = r#"PROJCRS["ETRS89 / UTM zone 32N",ID["EPSG",25832]]"#;
    let lost = run(dir.path(), &["run", &survey, "-o", "wkt.geo.parquet", "--crs", wkt]);
    assert!(lost.status.success() && text(&lost.stderr).contains("no PROJJSON"), "{}", text(&lost.stderr));
    judge(
        &python,
        dir.path(),
        r#"
import glob, json, struct
import pyarrow.parquet as pq
from pyproj import CRS, Transformer

table, plain = pq.read_table("25832.geo.parquet"), pq.read_table("a.parquet")
assert table.column_names == [*plain.column_names, "geometry", "bbox"]
rows = [struct.unpack("<bIddd", wkb) for wkb in table["geometry"].to_pylist()]
boxes = table["bbox"].to_pylist()
for row, x, y, z, box in zip(rows, *(table[c].to_pylist() for c in "XYZ"), boxes):
    assert row == (1, 1001, x, y, z)
    assert box["xmin"] <= x <= box["xmax"] and box["ymin"] <= y <= box["ymax"] and box["xmax"] - box["xmin"] < 0.1
found = lambda name: json.loads(pq.read_metadata(name).metadata[b"geo"])
geo = found("25832.geo.parquet")
column = geo["columns"][geo["primary_column"]]
assert (geo["version"], column["encoding"], column["geometry_types"]) == ("1.1.0", "WKB", ["Point Z"])
corners = [[f(r[2 + axis] for r in rows) for axis in range(3)] for f in (min, max)]
assert column["bbox"] == corners[0] + corners[1]
assert column["covering"]["bbox"]["ymax"] == ["bbox", "ymax"]
codes = sorted(int(name.split(".")[0]) for name in glob.glob("[0-9]*.geo.parquet"))
assert len(codes) == 8
for code in codes:
    system = CRS.from_json_dict(found(f"{code}.geo.parquet")["columns"]["geometry"]["crs"])
    assert system.to_epsg() == code, (code, system.to_epsg())
    known = CRS.from_epsg(code)
    area = known.area_of_use
    place = (area.west + area.east) / 2, (area.south + area.north) / 2
    here, there = (Transformer.from_crs(c.geodetic_crs, c, always_xy=True).transform(*place) for c in (system, known))
    assert all(abs(a - b) < 1e-3 for a, b in zip(here, there)), (code, here, there)
assert pq.read_table("2056.geo.parquet").column_names == ["Range", "ObjectId", "geometry", "bbox"]
assert found("wkt.geo.parquet")["columns"]["geometry"]["crs"] is None
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
assert (points["scalar_Primitive"] == at("Primitive")).all()
assert np.abs(points["scalar_BeamDirectionZ"] - at("BeamDirectionZ")).max() < 1e-6
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

#[test]
fn polars_reads_streams_and_parquet() {
    let Some(python) = common::python("polars") else { return };
    let dir = folder();
    let survey = forest();
    succeed(dir.path(), &["run", &survey, "-q", "-o", "a.arrow", "-o", "a.parquet", "-o", "a.csv"]);
    judge(
        &python,
        dir.path(),
        r#"
import polars as pl
csv = pl.read_csv("a.csv", infer_schema_length=None)
assert len(csv) > 1000
for frame in (pl.read_ipc_stream("a.arrow"), pl.read_parquet("a.parquet"), pl.scan_parquet("a.parquet").collect()):
    assert frame.columns == csv.columns and len(frame) == len(csv)
    for name in ("X", "Z", "GpsTime", "Primitive"):
        assert (frame[name].cast(pl.Float64) - csv[name].cast(pl.Float64)).abs().max() < 6e-5, name
"#,
    );
}

#[test]
fn a_pipeline_file_says_what_the_command_line_says() {
    let dir = folder();
    let scene = fixture("terrain/scene.xml");
    let pipeline = |keys: &str, outputs: &str| {
        format!(
            "scene = '{}'\nseed = 4\n{keys}\n[platform]\ncatalogue = 'data/platforms.xml#copter_linearpath'\n[scanner]\n\
             catalogue = 'data/scanners_als.xml#riegl_vux-1uav'\n[settings]\npulse_freq_hz = 50000\nscan_freq_hz = 50\n\
             scan_angle_deg = 30\n[[leg]]\nposition_m = [-20, 0, 100]\n[[leg]]\nposition_m = [20, 0, 100]\n\
             active = false\n{outputs}",
            scene.display()
        )
    };
    let sinks =
        |folder: &str| ["csv", "las", "ply"].map(|e| format!("[[output]]\npath = '{folder}.{e}'\n")).concat();
    let write = |name: &str, text: String| std::fs::write(dir.path().join(name), text).unwrap();
    let keys = "columns = ['X', 'Y', 'Z', 'NumberOfReturns']\nlabels = true\nmisses = true\nlas_scale = 0.001\n\
                wave_packets = 'beside'\nwaveforms = true\nzip_output = true";
    write("written.toml", pipeline(keys, &sinks("written")));
    write("plain.toml", pipeline("", &sinks("plain")));
    succeed(dir.path(), &["run", "written.toml", "-q"]);
    let typed = "run plain.toml -q --columns X,Y,Z,NumberOfReturns --labels --misses --las-scale 0.001 --wave-packets beside \
                 --waveforms --zip-output";
    succeed(dir.path(), &typed.split_whitespace().collect::<Vec<_>>());
    for name in [".csv", ".las", ".wdp", ".ply", "_fullwave.bin"] {
        let bytes = |stem: &str| std::fs::read(dir.path().join(format!("{stem}{name}"))).unwrap();
        assert!(bytes("written") == bytes("plain"), "{name} differs");
        assert!(bytes("written").len() > 500, "{name} is empty");
    }
    let las = std::fs::read(dir.path().join("written.las")).unwrap();
    assert_eq!(las[104], 9, "point format");
    // Columns of the file do not apply where the command line replaces its outputs.
    succeed(dir.path(), &["run", "written.toml", "-q", "-o", "other.laz", "-o", "others.xyz"]);
    for (keys, part) in [
        ("columns = 3", "no column is called"),
        ("columns = 'X,Hight'", "Hight"),
        ("wave_packets = 'within'", "expected inside, beside"),
        ("las_at_most = true", "expected a number such as"),
        ("las_at_most = 'many'", "expected a number such as"),
        ("colums = 'X'", "columns"),
    ] {
        write("wrong.toml", pipeline(keys, &sinks("wrong")));
        let out = common::run(dir.path(), &["run", "wrong.toml", "-q"]);
        assert_eq!(out.status.code(), Some(2), "{keys}: {}", text(&out.stderr));
        assert!(text(&out.stderr).contains(part), "{keys}: {}", text(&out.stderr));
    }
}

#[test]
fn laspy_finds_regions_and_detail_in_an_octree() {
    let Some(python) = python_with_laspy() else { return };
    let dir = folder();
    let crs = r#"PROJCRS["ETRS89 / UTM zone 32N",ID["EPSG",25832]]"#;
    succeed(dir.path(), &["scene", "make", "forest", "-n", "20k", "--pulses", "400k", "-o", "made", "-q"]);
    let usual = ["run", "made/survey.xml", "-q", "--labels", "--crs", crs];
    succeed(dir.path(), &[&usual[..], &["-o", "a.copc.laz", "-o", "a.laz"]].concat());
    judge(
        &python,
        dir.path(),
        r#"
import laspy, numpy as np
from laspy import CopcReader
from laspy.copc import Bounds
plain = laspy.read("a.laz")
assert len(plain) > 200_000
columns = list(plain.point_format.dimension_names)
def rows(points):
    table = np.rec.fromarrays([np.asarray(points[name]) for name in columns], names=columns)
    return np.sort(table, order=["gps_time", "return_number"])
all_rows = rows(plain)
reader = CopcReader.open("a.copc.laz")
assert reader.header.point_count == len(plain)
assert reader.header.parse_crs is not None and "25832" in open("a.copc.laz", "rb").read(4000).decode("latin1")
assert (rows(reader.query()) == all_rows).all(), "the octree lost or changed points"
assert (rows(laspy.read("a.copc.laz")) == all_rows).all(), "as plain LAZ it differs"

info = reader.copc_info
assert info.spacing == 2 * info.halfsize / 128
assert info.gps_min == plain.gps_time.min() and info.gps_max == plain.gps_time.max()
low, high = info.center - info.halfsize, info.center + info.halfsize
assert (low <= plain.xyz.min(axis=0) + 1e-6).all() and (high >= plain.xyz.max(axis=0) - 1e-6).all()
# Strict readers take the cube from the header: from its lower corner, as wide as its longest side.
mins, maxs = np.array(reader.header.mins), np.array(reader.header.maxs)
assert np.abs(low - mins).max() < 1e-9 * np.abs(mins).max() + 1e-9, (low, mins)
assert abs(2 * info.halfsize - (maxs - mins).max()) < 1e-9 * np.abs(maxs).max() + 1e-9, (info.halfsize, mins, maxs)

# Every node holds points of its own cube, as many as it says, and every point is in one node.
entries = reader.root_page.entries
assert len(entries) > 8, len(entries)
assert sum(e.point_count for e in entries.values()) == len(plain)
for level in range(max(k.level for k in entries) + 1):
    points = reader.query(level=level)
    edge = 2 * info.halfsize / 2 ** level
    keys = np.floor((np.stack([points.x, points.y, points.z], axis=1) - low) / edge + 1e-9).astype(int)
    # The upper faces of the root cube belong to it.
    keys = np.minimum(keys, 2 ** level - 1)
    found, counts = np.unique(keys, axis=0, return_counts=True)
    told = {(k.x, k.y, k.z): e.point_count for k, e in entries.items() if k.level == level}
    assert dict(zip(map(tuple, found.tolist()), counts.tolist())) == told, level

# Detail: the root is a thin cloud of the whole, and every level adds to it.
counts = [len(reader.query(level=range(0, n))) for n in (1, 2, 3)]
assert 0 < counts[0] < counts[1] <= counts[2] <= len(plain), counts
root = reader.query(level=0)
wide = lambda p: np.ptp(np.asarray(p.x))
assert wide(root) > 0.9 * wide(plain)
# Region
mid = plain.xyz.mean(axis=0)
bounds = Bounds(mins=mid[:2] - 5, maxs=mid[:2] + 5)
part = reader.query(bounds=bounds)
inside = (np.abs(plain.xyz[:, :2] - mid[:2]) <= 5).all(axis=1).sum()
assert abs(len(part) - inside) <= 2 and inside > 100, (len(part), inside)
"#,
    );
    // Threads, chunks and whether the output can seek make no difference.
    let bytes = |extra: &[&str]| {
        let out = succeed(dir.path(), &[&usual[..], &["-o", "-", "--format", "copc"], extra].concat());
        out.stdout
    };
    let whole = std::fs::read(dir.path().join("a.copc.laz")).unwrap();
    assert!(bytes(&["-j", "1"]) == whole && bytes(&["-j", "5", "--chunk-size", "77"]) == whole);
    // A folder gets one file per leg, and options that COPC does not have are refused.
    succeed(dir.path(), &[&usual[..], &["-o", "legs", "--format", "copc"]].concat());
    assert!(
        common::files(&dir.path().join("legs")).iter().all(|f| f.to_string_lossy().ends_with(".copc.laz"))
    );
    for (extra, part) in
        [("--las10", "COPC is LAS 1.4"), ("--wave-packets=inside", "COPC has no waveform packets")]
    {
        let out = common::run(dir.path(), &[&usual[..], &["-o", "b.copc.laz", extra]].concat());
        assert_eq!(out.status.code(), Some(2));
        assert!(text(&out.stderr).contains(part), "{}", text(&out.stderr));
    }
}

#[test]
fn an_octree_without_points_can_be_read() {
    let Some(python) = python_with_laspy() else { return };
    let dir = folder();
    let scene = fixture("terrain/scene.xml");
    let upwards = "x,y,z,dx,dy,dz\n0,0,500,0,0,1\n";
    let args =
        ["trace", "-q", "--scene", scene.to_str().unwrap(), "--scanner", "riegl_vz400", "-o", "a.copc.laz"];
    let out = common::feed(dir.path(), &args, upwards.as_bytes());
    assert!(out.status.success(), "{}", text(&out.stderr));
    judge(
        &python,
        dir.path(),
        "import laspy\nassert len(laspy.CopcReader.open('a.copc.laz').query()) == 0\n",
    );
}

#[test]
fn previews_show_tables_and_wave_packets() {
    let dir = folder();
    let survey = forest();
    let sinks =
        ["-o", "a.arrow", "-o", "a.parquet", "-o", "a.laz", "--wave-packets", "inside", "--waveforms"];
    succeed(dir.path(), &[&["run", &survey, "-q"], &sinks[..]].concat());
    let clouds = ["a.arrow", "a.parquet", "a.laz"].map(|name| {
        let size = ["--width", "800", "--height", "600", "-q"];
        let picture = format!("{name}.png");
        let args = ["preview", name, "-o", &picture, "--colour", "return"];
        succeed(dir.path(), &[&args[..], &size].concat());
        let picture = std::fs::read(dir.path().join(picture)).unwrap();
        assert!(picture.len() > 5000 && picture.starts_with(b"\x89PNG"));
        vlscan::tools::cloud::read_points(&dir.path().join(name)).unwrap().0
    });
    for cloud in &clouds {
        assert!(cloud.len() > 1000 && cloud.len() == clouds[0].len());
        assert!((cloud.bounds().max - clouds[0].bounds().max).length() < 1e-3);
        assert!(
            [Attribute::ReturnNumber, Attribute::Object, Attribute::Intensity]
                .into_iter()
                .all(|a| cloud.has(a))
        );
    }
    let stream = std::fs::read(dir.path().join("a.arrow")).unwrap();
    let piped = common::feed(dir.path(), &["preview", "-", "-o", "-", "-q"], &stream);
    assert!(piped.stdout.starts_with(b"\x89PNG"), "{}", text(&piped.stderr));
    // The waveform of a pulse is the same in text and in packets, within 16 bits.
    let wave = std::fs::read_to_string(dir.path().join("a_fullwave.txt")).unwrap();
    let longest = wave.lines().max_by_key(|line| line.len()).unwrap();
    let fields: Vec<f64> = longest.split_whitespace().map(|f| f.parse().unwrap()).collect();
    let from_packet = vlscan::tools::cloud::read_packet(&dir.path().join("a.laz"), fields[0] as u64).unwrap();
    let highest = fields[10..].iter().copied().fold(0.0, f64::max);
    assert!(from_packet.samples.len() > 10 && from_packet.samples.len() <= fields.len() - 10);
    for (packet, text) in from_packet.samples.iter().zip(&fields[10..]) {
        assert!((packet - text).abs() < highest / 1000.0, "{packet} for {text}");
    }
    assert!((from_packet.start - fields[7]).abs() < 1e-2, "{} for {}", from_packet.start, fields[7]);
    assert!((from_packet.direction.z - fields[6]).abs() < 1e-4);
    assert!((from_packet.interval() - (fields[8] - fields[7]) / (fields.len() - 11) as f64).abs() < 1e-4);
    let pulse = fields[0].to_string();
    succeed(dir.path(), &["preview", "a.laz", "--pulse", &pulse, "-o", "wave.png", "-q"]);
    let none = common::run(dir.path(), &["preview", "a.laz", "--pulse", "0", "-o", "none.png"]);
    assert!(
        none.status.code() == Some(2) && text(&none.stderr).contains("nearest"),
        "{}",
        text(&none.stderr)
    );
    succeed(dir.path(), &["run", &survey, "-q", "-o", "plain.laz"]);
    let plain = common::run(dir.path(), &["preview", "plain.laz", "--pulse", "1", "-o", "none.png"]);
    assert!(text(&plain.stderr).contains("--wave-packets"), "{}", text(&plain.stderr));
}

#[test]
fn classes_that_las_1_0_has_not_are_told() {
    let dir = folder();
    std::fs::write(
        dir.path().join("m.mtl"),
        "newmtl roof\nhelios_reflectance 0.5\nhelios_classification 77\n",
    )
    .unwrap();
    let ground = "mtllib m.mtl\nusemtl roof\nv -50 -50 0\nv 50 -50 0\nv 50 50 0\nv -50 50 0\nf 1 2 3 4\n";
    std::fs::write(dir.path().join("g.obj"), ground).unwrap();
    std::fs::write(dir.path().join("p.csv"), "x,y,z,dx,dy,dz\n0,0,60,0,0,-1\n").unwrap();
    let args = ["trace", "p.csv", "--scene", "g.obj", "--scanner", "riegl_vz400", "-o", "a.las", "--force"];
    let said = text(&succeed(dir.path(), &[&args[..], &["--las10"]].concat()).stderr);
    assert!(said.contains("--las10 has classes 0 to 31, the scene has up to 77"), "{said}");
    let strict = common::run(dir.path(), &[&args[..], &["--las10", "--strict"]].concat());
    assert_eq!(strict.status.code(), Some(2));
    let said = text(&succeed(dir.path(), &args).stderr);
    assert!(!said.contains("class"), "{said}");
    // Whichever way the points take into the file.
    let survey = "scene = \"g.obj\"\nplatform = { catalogue = \"data/platforms.xml#tripod\" }\nscanner = { catalogue = \"riegl_vz400\" }\n\
        settings = { pulse_freq_hz = 100000, scan_freq_hz = 100, scan_angle_deg = 30, head_rate_deg_per_s = 60, \
        head_start_deg = 0, head_stop_deg = 6 }\n[[leg]]\nposition_m = [0, 0, 9]\n";
    std::fs::write(dir.path().join("s.toml"), survey).unwrap();
    succeed(dir.path(), &["run", "s.toml", "--shard", "0/1", "-o", "shards"]);
    for command in [
        &["run", "s.toml", "-o", "b.las"][..],
        &["run", "s.toml", "-o", "b.las", "--resume"],
        &["run", "s.toml", "-o", "b.las", "--dry-run"],
        &["merge", "shards", "-o", "b.las"],
    ] {
        let strict = common::run(dir.path(), &[command, &["--las10", "--strict"]].concat());
        let said = text(&strict.stderr);
        assert!(strict.status.code() == Some(2) && said.contains("classes 0 to 31"), "{command:?}: {said}");
    }
    let merge = ["merge", "shards", "-o", "b.las", "--crs", "EPSG:25832"];
    let said = text(&succeed(dir.path(), &merge).stderr);
    assert!(said.contains("does not fit"), "{said}");
}

#[test]
fn a_merge_checks_the_coordinate_reference_system_as_a_run_does() {
    let dir = folder();
    let write = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).unwrap();
    let survey = "platform = { catalogue = \"data/platforms.xml#tripod\" }\n\
        scanner = { catalogue = \"riegl_vz400\" }\nsettings = { pulse_freq_hz = 100000, scan_freq_hz = 100, \
        scan_angle_deg = 30, head_rate_deg_per_s = 60, head_start_deg = 0, head_stop_deg = 3 }\n";
    write("m.mtl", "newmtl a\nhelios_reflectance 0.4\n");
    for (name, x, y) in [("local", 0.0, 0.0), ("far", 476_000.0, 5_429_000.0)] {
        let corner = |dx: f64, dy: f64| format!("v {} {} 0\n", x + dx, y + dy);
        let corners = [corner(-50.0, -50.0), corner(50.0, -50.0), corner(50.0, 50.0), corner(-50.0, 50.0)];
        let corners = corners.concat();
        write(&format!("{name}.obj"), &format!("mtllib m.mtl\nusemtl a\n{corners}f 1 2 3 4\n"));
        let toml = format!("scene = \"{name}.obj\"\n{survey}[[leg]]\nposition_m = [{x:.1}, {y:.1}, 9.0]\n");
        write(&format!("{name}.toml"), &toml);
        succeed(dir.path(), &["run", &format!("{name}.toml"), "--shard", "0/1", "-o", name]);
    }
    let feet = "COMPD_CS[\"site\",PROJCS[\"grid\",UNIT[\"metre\",1]],VERT_CS[\"up\",UNIT[\"foot\",0.3048]]]";
    for (name, system, expected, strict) in [
        ("local", "EPSG:1", "give its WKT", 2),
        ("local", "EPSG:25832", "the scene has local coordinates", 2),
        ("local", "EPSG:2263", "its coordinates are US survey feet", 2),
        ("local", "EPSG:5498", "its coordinates are degrees", 2),
        ("local", feet, "its heights are feet", 2),
        ("far", "EPSG:25832", "the scene is at 49.0", 0),
        ("far", "", "the coordinate reference system is unknown", 0),
    ] {
        let file = format!("{name}.toml");
        for command in [["run", &file], ["merge", name]] {
            let chosen = ["--crs", system];
            let chosen = if system.is_empty() { &chosen[..0] } else { &chosen[..] };
            let words = [&command[..], &["-o", "a.las", "--force", "--strict"], chosen].concat();
            let done = run(dir.path(), &words);
            let said = text(&done.stderr);
            assert!(said.contains(expected), "{command:?} {system}: {said}");
            assert_eq!(done.status.code(), Some(strict), "{command:?} {system}: {said}");
        }
    }
}
