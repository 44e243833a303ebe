//! Surveys whose points are known in closed form, by the refined physics: geometry, timing, strength of
//! echoes, attributes. They need no other program and no reference data.

use crate::common::{folder, raster, run, text};
use std::fs;

/// A point and the pulse that it comes from.
#[derive(Debug)]
struct Point {
    position: [f64; 3],
    amplitude: f64,
    range: f64,
    time: f64,
    /// Cosine of the angle between beam and normal.
    cosine: f64,
    origin: [f64; 3],
    direction: [f64; 3],
    nth: f64,
    of: f64,
    class: f64,
    object: f64,
    pulse: f64,
}

const COLUMNS: &str = "X,Y,Z,Amplitude,Range,GpsTime,IncidenceAngle,BeamOriginX,BeamOriginY,BeamOriginZ,BeamDirectionX,\
                       BeamDirectionY,BeamDirectionZ,ReturnNumber,NumberOfReturns,SurfaceClass,ObjectId,PulseNumber";

const MATERIALS: &str = "newmtl ground\nKd 1 1 1\nhelios_reflectance 0.3\nhelios_classification 2\nhelios_isGround true\n\
                         newmtl bright\nKd 1 1 1\nhelios_reflectance 0.6\nhelios_classification 6\n";

/// A rectangle in OBJ from one corner to the opposite one, at height `z` plus `slope` times x.
fn rectangle(material: &str, low: [f64; 2], high: [f64; 2], z: f64, slope: f64) -> String {
    let corner = |x: f64, y: f64| format!("v {x} {y} {}\n", z + slope * x);
    format!(
        "mtllib m.mtl\nusemtl {material}\n{}{}{}{}f -4 -3 -2 -1\n",
        corner(low[0], low[1]),
        corner(high[0], low[1]),
        corner(high[0], high[1]),
        corner(low[0], high[1])
    )
}

/// An instrument without errors in clear air whose mirror sweeps 30° to either side: 10 000 pulses and 20
/// lines per second.
const SCANNER: &str = "[scanner]\nid = \"exact\"\noptics = \"rotating\"\npulse_freqs_hz = [10000]\nscan_angle_max_deg = 30\n\
                       scan_angle_effective_max_deg = 30\nscan_freq_min_hz = 1\nscan_freq_max_hz = 100\nwavelength_nm = 1064\n\
                       beam_divergence_rad = 0.0001\npulse_length_ns = 4\nvisibility_km = 100000\n\
                       accuracy_m = 0\nrange_min_m = 0.5\nrange_max_m = 1000\n\
                       [settings]\npulse_freq_hz = 10000\nscan_freq_hz = 20\n";

/// The instrument flown to the east for two seconds at 50 m/s through x = 0, looking down.
fn flown(scene: &str, [x, y, z]: [f64; 3]) -> String {
    format!(
        "scene = \"{scene}\"\n[platform]\nkind = \"linear_path\"\nmount = {{ rotate_deg = [{{ x = -90 }}, {{ z = 90 }}] }}\n\
         {SCANNER}[waveform]\nquality = 1\n[[leg]]\nposition_m = [{}, {y}, {z}]\nspeed_m_per_s = 50\n\
         [[leg]]\nposition_m = [{}, {y}, {z}]\nactive = false\n",
        x - 50.0,
        x + 50.0
    )
}

/// Runs a pipeline over files and returns its points.
fn scan(files: &[(&str, &[u8])], pipeline: &str, more: &[&str]) -> Vec<Point> {
    let dir = folder();
    fs::write(dir.path().join("m.mtl"), MATERIALS).unwrap();
    files.iter().for_each(|(name, content)| fs::write(dir.path().join(name), content).unwrap());
    fs::write(dir.path().join("p.toml"), pipeline).unwrap();
    let base = ["run", "p.toml", "--physics", "refined", "-o", "a.csv", "--columns", COLUMNS];
    let done = run(dir.path(), &[&base[..], more].concat());
    assert!(done.status.success(), "{}", text(&done.stderr));
    let rows = fs::read_to_string(dir.path().join("a.csv")).unwrap();
    let point = |line: &str| {
        let v: Vec<f64> = line.split(',').map(|word| word.parse().unwrap()).collect();
        Point {
            position: [v[0], v[1], v[2]],
            amplitude: v[3],
            range: v[4],
            time: v[5],
            cosine: v[6].to_radians().cos(),
            origin: [v[7], v[8], v[9]],
            direction: [v[10], v[11], v[12]],
            nth: v[13],
            of: v[14],
            class: v[15],
            object: v[16],
            pulse: v[17],
        }
    };
    rows.lines().skip(1).map(point).collect()
}

fn obj(name: &'static str, content: &str) -> (&'static str, Vec<u8>) {
    (name, content.as_bytes().to_vec())
}

fn scan_meshes(meshes: &[(&'static str, Vec<u8>)], pipeline: &str) -> Vec<Point> {
    let files: Vec<(&str, &[u8])> = meshes.iter().map(|(name, content)| (*name, &content[..])).collect();
    scan(&files, pipeline, &[])
}

/// A scene of XML that loads these meshes, each a part.
fn parts(meshes: &[&str]) -> Vec<u8> {
    let part = |name: &&str| {
        format!(
            "<part id=\"{name}\"><filter type=\"objloader\"><param type=\"string\" key=\"filepath\" value=\"{name}.obj\"/>\
             </filter></part>"
        )
    };
    let parts: String = meshes.iter().map(part).collect();
    format!("<document><scene id=\"s\">{parts}</scene></document>").into_bytes()
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let all: Vec<f64> = values.collect();
    all.iter().sum::<f64>() / all.len() as f64
}

/// Coordinates are written with four decimals.
const ROUNDING: f64 = 1.1e-4;

fn assert_near(found: f64, expected: f64, tolerance: f64, what: &dyn std::fmt::Debug) {
    assert!((found - expected).abs() <= tolerance, "{found}, expected {expected}: {what:?}");
}

#[test]
fn a_plane_is_met_by_every_pulse_at_its_height() {
    let points = scan_meshes(
        &[obj("g.obj", &rectangle("ground", [-200.0; 2], [200.0; 2], 0.0, 0.0))],
        &flown("g.obj", [0.0, 0.0, 100.0]),
    );
    assert_eq!(points.len(), 20_000);
    for (i, p) in points.iter().enumerate() {
        assert_near(p.position[2], 0.0, ROUNDING, p);
        assert_near(p.range * -p.direction[2], 100.0, ROUNDING, p);
        assert_near(p.cosine, -p.direction[2], 1e-5, p);
        assert_eq!((p.pulse, p.nth, p.of, p.class), (i as f64 + 1.0, 1.0, 1.0, 2.0));
    }
}

#[test]
fn points_lie_on_their_beams_and_beams_leave_the_platform() {
    let points = scan_meshes(
        &[obj("g.obj", &rectangle("ground", [-200.0; 2], [200.0; 2], 0.0, 0.0))],
        &flown("g.obj", [0.0, 3.0, 100.0]),
    );
    for p in &points {
        let flown = (p.time - points[0].time) * 50.0 - 50.0;
        assert_near(p.origin[0], flown, 2e-2, p);
        assert!(p.origin[1] == 3.0 && p.origin[2] == 100.0, "{p:?}");
        for axis in 0..3 {
            let along = p.origin[axis] + p.range * p.direction[axis];
            assert_near(p.position[axis], along, 3e-4, p);
        }
    }
}

#[test]
fn pulses_and_lines_are_evenly_spaced() {
    let points = scan_meshes(
        &[obj("g.obj", &rectangle("ground", [-200.0; 2], [200.0; 2], 0.0, 0.0))],
        &flown("g.obj", [0.0, 0.0, 100.0]),
    );
    for pair in points.windows(2) {
        assert_near(pair[1].time - pair[0].time, 1e-4, 2e-9, &pair);
    }
    // 20 sweeps per second of 60° in steps of 0.12°.
    let angle = |p: &Point| p.direction[1].atan2(-p.direction[2]).to_degrees();
    let steps: Vec<f64> = points.windows(2).map(|pair| angle(&pair[1]) - angle(&pair[0])).collect();
    let turns = steps.iter().filter(|step| step.abs() > 1.0).count();
    assert!((39..=40).contains(&turns), "{turns} sweeps in two seconds");
    for step in steps.iter().filter(|step| step.abs() < 1.0) {
        assert_near(step.abs(), 0.12, 1e-5, step);
    }
}

#[test]
fn a_slope_is_met_at_its_angle() {
    let slope = 0.5;
    let points = scan_meshes(
        &[obj("g.obj", &rectangle("ground", [-200.0; 2], [200.0; 2], 0.0, slope))],
        &flown("g.obj", [0.0, 0.0, 150.0]),
    );
    assert_eq!(points.len(), 20_000);
    let length = (1.0 + slope * slope).sqrt();
    for p in &points {
        assert_near(p.position[2], slope * p.position[0], 2e-4, p);
        let cosine = (-slope * p.direction[0] + p.direction[2]).abs() / length;
        assert_near(p.cosine, cosine, 1e-5, p);
    }
}

#[test]
fn a_raster_is_the_surface_between_its_pixels() {
    // Pixel i has the height 300 + i: 1 m per 10 m to the east, 8 m per 10 m to the south.
    let dem = raster([0.0, 80.0], 10.0, None);
    let mut files: Vec<(&str, &[u8])> = vec![("dem.tif", &dem)];
    files.push(("unused", b""));
    let points = scan(&files, &flown("dem.tif", [40.0, 40.0, 420.0]), &[]);
    assert!(points.len() > 9_000, "{}", points.len());
    for p in &points {
        let [x, y, z] = p.position;
        assert_near(z, 300.0 + (x - 5.0) / 10.0 + 8.0 * (75.0 - y) / 10.0, 2e-3, p);
    }
}

#[test]
fn echoes_weaken_with_the_square_of_the_range() {
    // Looking down only: amplitude of a Lambert surface over the cosine, times range squared.
    let at = |height: f64| {
        let points = scan_meshes(
            &[obj("g.obj", &rectangle("ground", [-300.0; 2], [300.0; 2], 0.0, 0.0))],
            &flown("g.obj", [0.0, 0.0, height]),
        );
        mean(
            points
                .iter()
                .filter(|p| p.direction[2] < -0.999)
                .map(|p| p.amplitude * p.range * p.range / p.cosine),
        )
    };
    let (near, far) = (at(100.0), at(200.0));
    assert_near(far / near, 1.0, 1e-4, &(near, far));
}

#[test]
fn echoes_are_as_strong_as_the_reflectance() {
    let meshes = [
        obj("a.obj", &rectangle("ground", [-200.0, -200.0], [0.0, 200.0], 0.0, 0.0)),
        obj("b.obj", &rectangle("bright", [0.0, -200.0], [200.0, 200.0], 0.0, 0.0)),
        ("s.xml", parts(&["a", "b"])),
    ];
    let points = scan_meshes(&meshes, &flown("s.xml", [0.0, 0.0, 100.0]));
    assert_eq!(points.len(), 20_000);
    let strength = |class: f64| mean(points.iter().filter(|p| p.class == class).map(|p| p.amplitude));
    assert_near(strength(6.0) / strength(2.0), 2.0, 0.001, &"0.6 beside 0.3");
    let clear = points.iter().filter(|p| p.position[0].abs() > 0.02);
    clear.for_each(|p| assert_eq!(p.class == 6.0, p.position[0] > 0.0, "{p:?}"));
}

#[test]
fn objects_and_classes_are_those_of_the_parts() {
    let meshes = [
        obj("7.obj", &rectangle("ground", [-200.0; 2], [200.0; 2], 0.0, 0.0)),
        obj("8.obj", &rectangle("bright", [-10.0; 2], [10.0; 2], 20.0, 0.0)),
        ("s.xml", parts(&["7", "8"])),
    ];
    let points = scan_meshes(&meshes, &flown("s.xml", [0.0, 0.0, 100.0]));
    let upper: Vec<&Point> = points.iter().filter(|p| p.position[2] > 10.0).collect();
    assert!(upper.len() > 100);
    for p in &upper {
        assert_eq!((p.object, p.class), (8.0, 6.0));
        assert!(p.position[0].abs() <= 10.01 && p.position[1].abs() <= 10.01, "{p:?}");
    }
    assert!(points.iter().filter(|p| p.position[2] < 10.0).all(|p| (p.object, p.class) == (7.0, 2.0)));
    // Its shadow is as long as similar triangles say: 100 / 80 of its sides, across the track.
    let hidden = |p: &&Point| p.position[2] < 10.0 && p.origin[0].abs() < 9.0;
    assert!(points.iter().filter(hidden).all(|p| p.position[1].abs() > 12.4));
}

#[test]
fn a_wide_beam_at_an_edge_gives_two_returns() {
    let meshes = [
        obj("a.obj", &rectangle("ground", [-200.0; 2], [200.0; 2], 0.0, 0.0)),
        obj("b.obj", &rectangle("bright", [-200.0, -200.0], [200.0, 0.0], 20.0, 0.0)),
        ("s.xml", parts(&["a", "b"])),
    ];
    let pipeline = flown("s.xml", [0.0, 0.0, 100.0])
        .replace("beam_divergence_rad = 0.0001", "beam_divergence_rad = 0.003")
        .replace("quality = 1", "quality = 4");
    let points = scan_meshes(&meshes, &pipeline);
    let second: Vec<&Point> = points.iter().filter(|p| p.nth == 2.0).collect();
    assert!(second.len() > 30, "{}", second.len());
    for p in second {
        let first = points.iter().find(|q| q.pulse == p.pulse && q.nth == 1.0).unwrap();
        assert_eq!((first.of, p.of), (2.0, 2.0));
        assert_near(first.position[2], 20.0, 0.1, first);
        assert_near(p.position[2], 0.0, 0.1, p);
        // The edge is at y = 0; the beam is 0.3 m wide.
        assert!(first.position[1].abs() < 0.3 && p.position[1].abs() < 0.4, "{p:?}");
    }
}

#[test]
fn the_same_survey_far_from_the_origin_gives_the_same_points() {
    let at = |x: f64, y: f64| {
        let corner = |dx: f64, dy: f64| [x + dx, y + dy];
        let mesh = rectangle("ground", corner(-200.0, -200.0), corner(200.0, 200.0), 10.0, 0.0);
        scan_meshes(&[obj("g.obj", &mesh)], &flown("g.obj", [x, y, 100.0]))
    };
    let (near, far) = (at(0.0, 0.0), at(476_000.0, 5_429_000.0));
    assert_eq!(near.len(), far.len());
    for (p, q) in near.iter().zip(&far) {
        let offset = [476_000.0, 5_429_000.0, 0.0];
        (0..3).for_each(|axis| assert_near(q.position[axis] - offset[axis], p.position[axis], 2.1e-4, q));
        assert_near(p.amplitude, q.amplitude, 1e-6 * p.amplitude, q);
    }
}

#[test]
fn a_tripod_in_a_box_sees_its_walls_all_around() {
    let walls = "mtllib m.mtl\nusemtl bright\nv -5 -4 0\nv 5 -4 0\nv 5 4 0\nv -5 4 0\nv -5 -4 3\nv 5 -4 3\nv 5 4 3\nv -5 4 3\n\
                 f 1 2 3 4\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";
    let pipeline = format!(
        "scene = \"box.obj\"\n{}head_rate_deg_per_s = 180\nhead_stop_deg = 360\n[waveform]\nquality = 1\n[[leg]]\n\
         position_m = [1, 0.5, 1.5]\n",
        SCANNER.replace("[settings]", "head_rate_max_deg_per_s = 360\n[settings]")
    );
    let points = scan_meshes(&[obj("box.obj", walls)], &pipeline);
    assert!((19_990..=20_010).contains(&points.len()), "two seconds: {}", points.len());
    for p in &points {
        let [x, y, z] = p.position;
        let off = [(x.abs() - 5.0).abs(), (y.abs() - 4.0).abs(), z.abs(), (z - 3.0).abs()];
        assert!(off.iter().any(|d| *d < 3e-4), "{p:?}");
    }
    let side = |inside: &dyn Fn(&Point) -> bool| points.iter().filter(|p| inside(p)).count();
    let seen = [
        side(&|p| p.position[0] > 4.99),
        side(&|p| p.position[0] < -4.99),
        side(&|p| p.position[1] > 3.99),
        side(&|p| p.position[1] < -3.99),
    ];
    assert!(seen.iter().all(|n| *n > 1000), "{seen:?}");
}

#[test]
fn voxels_let_as_much_through_as_the_law_of_beer_and_lambert_says() {
    // A slab of 2 m with 0.5 m²/m³ over the whole track: exp(−0.5 · 0.5 · 2 / cos θ) of the beams reach the
    // ground.
    let cells = 200;
    let mut slab = format!(
        "VOXEL SPACE\n#min_corner: -100 -1 10\n#max_corner: 100 1 12\n#split: {cells} 2 2\n#res:1 #type:TLS #max_pad:5\n\
         i j k PadBVTotal angleMean bsEntering bsIntercepted bsPotential ground_distance lMeanTotal lgTotal nbEchos \
         nbSampling transmittance attenuation attenuationBiasCorrection\n"
    );
    for i in 0..cells {
        for (j, k) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            slab += &format!("{i} {j} {k} 0.5 30 1 0.5 1 5 0.25 10 5 20 0.7 0.9 0.9\n");
        }
    }
    let scene = "<document><scene id=\"s\"><part id=\"1\"><filter type=\"objloader\"><param type=\"string\" key=\"filepath\" \
                 value=\"g.obj\"/></filter></part><part id=\"2\"><filter type=\"detailedvoxels\"><param type=\"string\" \
                 key=\"intersectionMode\" value=\"transmittive\"/><param type=\"string\" key=\"filepath\" value=\"slab.vox\"/>\
                 <param type=\"string\" key=\"matfile\" value=\"m.mtl\"/><param type=\"string\" key=\"matname\" value=\"bright\"/>\
                 </filter></part></scene></document>";
    let ground = rectangle("ground", [-200.0; 2], [200.0; 2], 0.0, 0.0);
    let files: [(&str, &[u8]); 3] =
        [("g.obj", ground.as_bytes()), ("slab.vox", slab.as_bytes()), ("s.xml", scene.as_bytes())];
    let points = scan(&files, &flown("s.xml", [0.0, 0.0, 100.0]), &[]);
    // Beams through both faces of the slab.
    let crosses = |p: &&Point| {
        let at = |z: f64| p.origin[1] + p.direction[1] * (p.origin[2] - z) / -p.direction[2];
        p.nth == 1.0 && at(12.0).abs() < 1.0 && at(10.0).abs() < 1.0
    };
    let first: Vec<&Point> = points.iter().filter(crosses).collect();
    let through = first.iter().filter(|p| p.position[2] < 1.0).count() as f64 / first.len() as f64;
    let expected = mean(first.iter().map(|p| (-0.5 * 0.5 * 2.0 / -p.direction[2]).exp()));
    // Four standard deviations of this many draws.
    let tolerance = 4.0 * (expected * (1.0 - expected) / first.len() as f64).sqrt();
    assert!(first.len() > 200, "{}", first.len());
    assert_near(through, expected, tolerance, &first.len());
}
