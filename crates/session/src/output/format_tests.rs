//! LAS, LAZ and PLY read back by independent readers.

use super::testing::{batch, echo, scene, survey, write};
use super::*;
use ::las::{PointData, Reader};
use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::{DefaultElement, Property};
use std::collections::VecDeque;
use std::fs;
use std::io::{Cursor, Read};
use std::path::Path;
use std::sync::{Arc, Mutex};
use vlscan_base::error::Error;
use vlscan_formats::Job;
use vlscan_geom::DVec3;
use vlscan_lidar::pulse::Batch;
use vlscan_lidar::pulse::Echo;

const WKT: &str =
    r#"PROJCS["ETRS89 / UTM 32N",GEOGCS["ETRS89",AUTHORITY["EPSG","4258"]],AUTHORITY["EPSG","25832"]]"#;

fn request(path: &Path, format: PointFormat) -> OutputRequest {
    let mut cloud = CloudSettings::default();
    (cloud.crs, cloud.creation) = (Some(WKT.to_owned()), (2026, 324));
    OutputRequest { sinks: vec![(Target::File(path.into()), format)], cloud, ..OutputRequest::default() }
}

/// Returns the bytes of a file with `batches`.
fn bytes(request: OutputRequest, batches: &[Batch]) -> Vec<u8> {
    let Target::File(path) = request.sinks[0].0.clone() else { unreachable!() };
    write(request, &survey(2, &[None, None, None]), batches).unwrap();
    let bytes = fs::read(&path).unwrap();
    fs::remove_file(path).unwrap();
    bytes
}

fn read(bytes: Vec<u8>) -> (::las::Header, PointData) {
    let mut reader = Reader::new(Cursor::new(bytes)).unwrap();
    let points = reader.read_all().unwrap();
    (reader.header().clone(), points)
}

fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes(bytes[at..at + 2].try_into().unwrap())
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

fn f64_at(bytes: &[u8], at: usize) -> f64 {
    f64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

#[test]
fn las_reads_back_as_it_was_measured() {
    let dir = tempfile::tempdir().unwrap();
    let batches = [batch(0, 0, 1500), batch(2, 1500, 500)];
    let (header, points) = read(bytes(request(&dir.path().join("a.las"), PointFormat::Las), &batches));
    assert_eq!((header.version().major, header.version().minor), (1, 4));
    assert_eq!((header.number_of_points(), points.len()), (2000, 2000));
    assert_eq!(header.generating_software(), concat!("vlscan ", env!("CARGO_PKG_VERSION")));
    assert_eq!(header.system_identifier(), "Test scanner");
    assert_eq!(header.date().unwrap().to_string(), "2026-11-20");
    assert!(header.has_wkt_crs() && header.has_crs_vlrs());
    let echoes: Vec<&Echo> = batches.iter().flat_map(|b| &b.echoes).collect();
    let by_return = |n: u32| echoes.iter().filter(|e| e.return_number.min(15) == n).count() as u64;
    for n in 1..=15u8 {
        assert_eq!(header.number_of_points_by_return(n), Some(by_return(n.into())), "return {n}");
    }
    let shift = scene().shift;
    let near = |stored: f64, exact: f64| (stored - exact).abs() <= 0.5001e-4;
    for (axis, stored) in
        [points.x().collect::<Vec<_>>(), points.y().collect(), points.z().collect()].iter().enumerate()
    {
        assert!(stored.iter().zip(&echoes).all(|(s, e)| near(*s, e.position[axis] + shift[axis])));
        let (min, max) = stored.iter().fold((f64::MAX, f64::MIN), |(min, max), s| (min.min(*s), max.max(*s)));
        let bounds = header.bounds();
        let found =
            [(bounds.min.x, bounds.max.x), (bounds.min.y, bounds.max.y), (bounds.min.z, bounds.max.z)][axis];
        assert_eq!(found, (min, max), "the box is that of the written integers");
    }
    let record = points.record_len();
    assert_eq!(record, 64);
    for (raw, e) in points.raw_bytes().chunks(record).zip(&echoes) {
        let returns = e.return_number.min(15) | e.number_of_returns.min(15) << 4;
        let leg = if e.time_ns < echoes[1500].time_ns { 1 } else { 3 };
        assert_eq!(
            (raw[14], raw[15], raw[16]),
            (returns as u8, (e.device as u8) << 4, e.classification as u8)
        );
        assert_eq!(
            i16::from_le_bytes([raw[18], raw[19]]),
            (e.scan_angle.to_degrees() / 0.006).round() as i16
        );
        assert_eq!((u16_at(raw, 20), f64_at(raw, 22)), (leg, e.time_ns / 1e9));
        let object = [0, 1, 0][e.part as usize];
        assert_eq!(
            (f64_at(raw, 30), u32_at(raw, 38), u32_at(raw, 42)),
            (e.echo_width, e.pulse_number as u32, object)
        );
        assert_eq!((f64_at(raw, 46), u16_at(raw, 54)), (e.intensity, e.device as u16));
        assert_eq!(f32::from_bits(u32_at(raw, 56)), e.range as f32);
        assert!(
            (f64::from(f32::from_bits(u32_at(raw, 60))) - e.incidence_cosine.acos().to_degrees()).abs()
                < 1e-4
        );
        let amplitude = libm::pow(10.0, (f64::from(u16_at(raw, 12)) - 10_000.0) / 1000.0);
        assert!((amplitude / e.intensity - 1.0).abs() < 0.0012, "{amplitude} {}", e.intensity);
    }
}

#[test]
fn the_header_conforms_to_the_standard() {
    let dir = tempfile::tempdir().unwrap();
    let raw = bytes(request(&dir.path().join("a.las"), PointFormat::Las), &[batch(0, 0, 60)]);
    assert_eq!((u16_at(&raw, 6), u16_at(&raw, 94), raw[104], u16_at(&raw, 105)), (0x10, 375, 6, 64));
    assert_eq!([u16_at(&raw, 90), u16_at(&raw, 92)], [324, 2026]);
    assert!(raw[107..131].iter().all(|&b| b == 0), "no legacy counts for format 6");
    assert_eq!(raw.len(), u32_at(&raw, 96) as usize + 60 * 64);
    let vlrs = vlrs(&raw);
    let named: Vec<(&str, u16)> = vlrs.iter().map(|(user, id, _)| (user.as_str(), *id)).collect();
    assert_eq!(
        named,
        [("LASF_Spec", 4), ("LASF_Projection", 2112), ("LASF_Spec", 3), ("vlscan", 1), ("vlscan", 2)]
    );
    assert_eq!(vlrs[1].2, [WKT.as_bytes(), b"\0"].concat());
    assert_eq!(vlrs[3].2, b"1\tnorth\n");
    assert_eq!(text(&vlrs[4].2), "complete");
    let names: Vec<(u8, String)> = vlrs[0].2.chunks(192).map(|d| (d[2], text(&d[4..36]))).collect();
    let expected = [
        (10, "echo_width"),
        (6, "fullwaveIndex"),
        (6, "hitObjectId"),
        (10, "heliosAmplitude"),
        (3, "device"),
        (9, "range"),
        (9, "incidence_angle"),
    ];
    assert_eq!(names, expected.map(|(t, n)| (t, n.to_owned())));
}

fn text(field: &[u8]) -> String {
    String::from_utf8(field.iter().copied().take_while(|&b| b != 0).collect()).unwrap()
}

/// Returns user, id and data of the variable length records before the points.
fn vlrs(raw: &[u8]) -> Vec<(String, u16, Vec<u8>)> {
    let mut at = usize::from(u16_at(raw, 94));
    let mut found = Vec::new();
    for _ in 0..u32_at(raw, 100) {
        let length = usize::from(u16_at(raw, at + 20));
        found.push((
            text(&raw[at + 2..at + 18]),
            u16_at(raw, at + 18),
            raw[at + 54..at + 54 + length].to_vec(),
        ));
        at += 54 + length;
    }
    assert_eq!(at, u32_at(raw, 96) as usize);
    found
}

#[test]
fn a_point_of_the_specification_in_the_layout_of_the_reference() {
    // spec outputs §4.4; rounded instead of truncated, relative to whole metres instead of the shift.
    let dir = tempfile::tempdir().unwrap();
    let world = DVec3::new(-2.838, -25.5432, -0.0065);
    let position = world - scene().shift;
    let echo = Echo { position, intensity: 5.6037077, time_ns: 86_391e9, ..echo(1, 1) };
    let mut scene = scene();
    scene.shift = DVec3::new(20.0, 0.0, 10.889053);
    let echo = Echo { position: world - scene.shift, ..echo };
    let mut request = request(&dir.path().join("a.las"), PointFormat::Las);
    request.cloud.las.extra = ExtraDimensions::Helios;
    request.cloud.crs = None;
    let survey = survey(1, &[None]);
    let plan = Arc::new(OutputPlan::new(request, &OutputContext::new(&survey, &scene)).unwrap());
    let mut writer = plan.open(Arc::new(NoOffload)).unwrap();
    writer.append(plan.encode(&Batch { echoes: vec![echo], ..Batch::default() }, None)).unwrap();
    writer.finish().unwrap();
    let raw = fs::read(dir.path().join("a.las")).unwrap();
    assert_eq!([f64_at(&raw, 155), f64_at(&raw, 163), f64_at(&raw, 171)], [20.0, 0.0, 11.0]);
    let point = &raw[u32_at(&raw, 96) as usize..];
    assert_eq!(point.len(), 54);
    assert_eq!(
        [u32_at(point, 0), u32_at(point, 4), u32_at(point, 8)].map(|c| c as i32),
        [-228_380, -255_432, -110_065]
    );
    assert_eq!((u16_at(point, 12), point[14]), (10_748, 0x11));
    assert_eq!(
        (f64_at(point, 30), u32_at(point, 38), u32_at(point, 42), f64_at(point, 46)),
        (0.0, 1, 0, 5.6037077)
    );
}

#[test]
fn las_1_0_reads_back() {
    let dir = tempfile::tempdir().unwrap();
    let mut request = request(&dir.path().join("a.las"), PointFormat::Las);
    request.cloud.las.version = LasVersion::V10;
    for format in [PointFormat::Las, PointFormat::Laz] {
        request.sinks[0].1 = format;
        let raw = bytes(request.clone(), &[batch(0, 0, 2000)]);
        assert_eq!(
            (u16_at(&raw, 94), raw[24], raw[25], raw[104] & 0x7f, u32_at(&raw, 107)),
            (227, 1, 0, 1, 2000)
        );
        let keys = vlrs(&raw).into_iter().find(|v| v.1 == 34735).unwrap().2;
        assert_eq!(u16_at(&keys, 30), 25832);
        let (header, points) = read(raw);
        assert_eq!((header.number_of_points(), points.len(), points.record_len()), (2000, 2000, 62));
        for (raw, e) in points.raw_bytes().chunks(62).zip(&batch(0, 0, 2000).echoes) {
            let returns = e.return_number.min(7) | e.number_of_returns.min(7) << 3;
            let class = if e.classification < 32 { e.classification as u8 } else { 0 };
            let angle = e.scan_angle.to_degrees().round() as i8;
            assert_eq!((raw[14], raw[15], raw[16] as i8, raw[17]), (returns as u8, class, angle, 0));
            assert_eq!(
                (u16_at(raw, 18), f64_at(raw, 20), f64_at(raw, 44)),
                (1, e.time_ns / 1e9, e.intensity)
            );
        }
    }
}

#[test]
fn a_coordinate_system_without_code_is_a_warning_in_las_1_0() {
    let survey = survey(1, &[None]);
    let context = OutputContext::new(&survey, &scene());
    let dir = tempfile::tempdir().unwrap();
    let mut request = request(&dir.path().join("a.las"), PointFormat::Las);
    request.cloud.crs = Some("LOCAL_CS[\"mine\"]".to_owned());
    assert!(OutputPlan::new(request.clone(), &context).unwrap().warnings().items().is_empty());
    request.cloud.las.version = LasVersion::V10;
    assert_eq!(OutputPlan::new(request.clone(), &context).unwrap().warnings().items().len(), 1);
    request.sinks[0].1 = PointFormat::Xyz;
    request.cloud.las.scale = Some(-1.0);
    assert!(OutputPlan::new(request.clone(), &context).is_ok(), "settings of LAS do not concern text");
    request.sinks[0].1 = PointFormat::Laz;
    assert!(matches!(OutputPlan::new(request, &context), Err(Error::Input(_))));
}

#[test]
fn a_coordinate_system_that_is_known_after_the_check_reaches_the_formats() {
    let survey = survey(1, &[None]);
    let before = OutputContext { crs: None, ..OutputContext::new(&survey, &scene()) };
    let dir = tempfile::tempdir().unwrap();
    let mut request = request(&dir.path().join("a.las"), PointFormat::Las);
    request.cloud.crs = None;
    request.cloud.las.version = LasVersion::V10;
    let checked = request.clone().check(&before).unwrap();
    assert!(checked.warnings().items().is_empty());
    let crs = Some("LOCAL_CS[\"mine\"]".to_owned());
    let after = OutputContext { crs: crs.clone(), time_origin: 1e9, ..before };
    let (plan, whole) = (checked.plan(&after).unwrap(), OutputPlan::new(request, &after).unwrap());
    assert_eq!(plan.settings.crs, crs);
    assert_eq!(plan.settings, whole.settings);
    let warnings = plan.warnings().items().len();
    assert!(warnings > 0 && warnings == whole.warnings().items().len());
}

#[test]
fn laz_holds_the_records_of_las() {
    let dir = tempfile::tempdir().unwrap();
    let batches: Vec<Batch> = (0..3).map(|leg| batch(leg, leg as usize * 40_000, 40_000)).collect();
    let las = bytes(request(&dir.path().join("a.las"), PointFormat::Las), &batches);
    let laz = bytes(request(&dir.path().join("a.laz"), PointFormat::Laz), &batches);
    assert!(laz.len() < las.len());
    let ((las_header, las), (laz_header, laz)) = (read(las), read(laz));
    assert_eq!(las.len(), 120_000);
    assert!(las.raw_bytes() == laz.raw_bytes());
    assert_eq!(las_header.bounds(), laz_header.bounds());
}

#[test]
fn empty_files_are_valid() {
    let dir = tempfile::tempdir().unwrap();
    for format in [PointFormat::Las, PointFormat::Laz] {
        let (header, points) = read(bytes(request(&dir.path().join("a"), format), &[batch(0, 0, 0)]));
        assert_eq!((header.number_of_points(), points.len()), (0, 0));
    }
    let ply = bytes(request(&dir.path().join("a"), PointFormat::PlyBinary), &[]);
    assert!(ply.ends_with(b"end_header\n"));
}

/// Accepts a limited number of jobs and runs, drops or keeps them.
struct Pool {
    jobs: Mutex<VecDeque<Job>>,
    room: usize,
    does: Does,
}

#[derive(Clone, Copy, PartialEq)]
enum Does {
    Runs,
    Drops,
    Keeps,
}

impl Offload for Pool {
    fn try_run(&self, job: Job) -> Result<(), Job> {
        let mut jobs = self.jobs.lock().unwrap();
        if jobs.len() >= self.room {
            return Err(job);
        }
        match self.does {
            Does::Runs => drop(std::thread::spawn(job)),
            Does::Drops => drop(job),
            Does::Keeps => jobs.push_back(job),
        }
        Ok(())
    }
}

#[test]
fn laz_has_the_same_bytes_for_all_batches_and_helpers() {
    let dir = tempfile::tempdir().unwrap();
    let survey = survey(2, &[None]);
    let total = 160_000;
    let run = |size: usize, offload: Arc<dyn Offload>| {
        let path = dir.path().join("a.laz");
        let request = OutputRequest { force: true, ..request(&path, PointFormat::Laz) };
        let plan = Arc::new(OutputPlan::new(request, &OutputContext::new(&survey, &scene())).unwrap());
        let mut writer = plan.open(offload).unwrap();
        for first in (0..total).step_by(size) {
            writer.append(plan.encode(&batch(0, first, size.min(total - first)), None)).unwrap();
        }
        writer.finish().unwrap();
        fs::read(path).unwrap()
    };
    let expected = run(total, Arc::new(NoOffload));
    assert!(run(777, Arc::new(NoOffload)) == expected);
    for does in [Does::Runs, Does::Drops, Does::Keeps] {
        // A pool that keeps jobs forever is equivalent to one whose workers all wait for the writer.
        let pool = Arc::new(Pool { jobs: Mutex::default(), room: 2, does });
        assert!(run(50_000, pool.clone()) == expected);
        let mut jobs = std::mem::take(&mut *pool.jobs.lock().unwrap());
        assert_eq!(jobs.len(), if does == Does::Keeps { 2 } else { 0 });
        jobs.drain(..).for_each(|job| job());
    }
}

#[test]
fn ply_reads_back() {
    let dir = tempfile::tempdir().unwrap();
    let batch = batch(1, 0, 700);
    for format in [PointFormat::PlyBinary, PointFormat::PlyAscii] {
        let raw = bytes(request(&dir.path().join("a.ply"), format), std::slice::from_ref(&batch));
        let ply = Parser::<DefaultElement>::new().read_ply(&mut raw.as_slice()).unwrap();
        assert!(
            ply.header.comments.iter().any(|c| c.contains("crs EPSG:25832")),
            "{:?}",
            ply.header.comments
        );
        assert!(ply.header.comments.iter().any(|c| c.contains("object 1 north")));
        let vertices = &ply.payload["vertex"];
        assert_eq!(vertices.len(), 700);
        let near = |p: &Property, exact: f64| match p {
            Property::Double(v) => (v - exact).abs() <= 0.5001e-4,
            Property::Float(v) => (f64::from(*v) - exact).abs() <= 0.5001e-4 + exact.abs() * 1e-6,
            other => panic!("{other:?}"),
        };
        for (v, e) in vertices.iter().zip(&batch.echoes) {
            let p = e.position + scene().shift;
            let reals = [
                ("x", p.x),
                ("y", p.y),
                ("z", p.z),
                ("intensity", e.intensity),
                ("scalar_EchoWidth", e.echo_width),
            ];
            assert!(reals.iter().all(|(name, exact)| near(&v[*name], *exact)), "{v:?}");
            let angles = [("scalar_ScanAngle", e.scan_angle.to_degrees()), ("scalar_Range", e.range)];
            assert!(angles.iter().all(|(name, exact)| near(&v[*name], *exact)), "{v:?}");
            assert!(near(&v["scalar_IncidenceAngle"], e.incidence_cosine.acos().to_degrees()));
            assert_eq!(v["scalar_GpsTime"], Property::Double(e.time_ns / 1e9));
            assert_eq!(v["scalar_ReturnNumber"], Property::UChar(e.return_number as u8));
            assert_eq!(v["scalar_NumberOfReturns"], Property::UChar(e.number_of_returns as u8));
            assert_eq!(v["scalar_Classification"], Property::Int(e.classification));
            assert_eq!(v["scalar_ObjectId"], Property::Int([0, 1, 0][e.part as usize]));
            assert_eq!(
                (&v["scalar_Device"], &v["scalar_Leg"]),
                (&Property::UShort(e.device as u16), &Property::UShort(1))
            );
            assert_eq!(v["scalar_PulseNumber"], Property::UInt(e.pulse_number as u32));
        }
    }
}

#[test]
fn what_a_format_cannot_hold_is_left_out_and_counted() {
    let dir = tempfile::tempdir().unwrap();
    let mut batch = batch(0, 0, 10);
    batch.echoes[3].position.x = f64::NAN;
    batch.echoes[4].position.z = 1e9;
    batch.echoes[5] = Echo {
        intensity: f64::INFINITY,
        classification: -3,
        device: u32::MAX,
        part: u32::MAX,
        scan_angle: f64::NAN,
        pulse_number: u64::MAX,
        return_number: 0,
        number_of_returns: u32::MAX,
        incidence_cosine: f64::NAN,
        ..batch.echoes[5]
    };
    for version in [LasVersion::V14, LasVersion::V10] {
        let mut request = request(&dir.path().join("a.las"), PointFormat::Las);
        request.cloud.las.version = version;
        request.force = true;
        let summary = write(request, &survey(1, &[None]), std::slice::from_ref(&batch)).unwrap();
        assert_eq!((summary.points, summary.files[0].left_out), (8, 2));
        let (header, points) = read(fs::read(dir.path().join("a.las")).unwrap());
        assert_eq!((header.number_of_points(), points.intensity().nth(3)), (8, Some(u16::MAX)));
    }
    // Text can represent every coordinate.
    let request = request(&dir.path().join("a.xyz"), PointFormat::Xyz);
    let summary = write(request, &survey(1, &[None]), &[batch]).unwrap();
    assert_eq!((summary.points, summary.files[0].left_out), (10, 0));
    assert!(fs::read_to_string(dir.path().join("a.xyz")).unwrap().contains("\nnan "));
}

#[cfg(target_os = "linux")]
#[test]
fn a_pipe_gets_the_bytes_of_a_file() {
    let dir = tempfile::tempdir().unwrap();
    let survey = survey(2, &[None]);
    for format in [PointFormat::Las, PointFormat::Laz, PointFormat::PlyBinary, PointFormat::PlyAscii] {
        let (mut reader, pipe) = std::io::pipe().unwrap();
        let name = format!("/proc/self/fd/{}", std::os::fd::AsRawFd::as_raw_fd(&pipe));
        let streamed = std::thread::spawn(move || {
            let mut bytes = Vec::new();
            reader.read_to_end(&mut bytes).unwrap();
            bytes
        });
        write(request(Path::new(&name), format), &survey, &[batch(0, 0, 60_000)]).unwrap();
        drop(pipe);
        let filed = bytes(request(&dir.path().join("a"), format), &[batch(0, 0, 60_000)]);
        assert!(streamed.join().unwrap() == filed, "{format:?}");
    }
}
