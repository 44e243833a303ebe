//! Mirrors, panes, water and weather in complete runs: the image of a mirror, surfaces behind a pane, below
//! water or in fog, labels, hostile materials.

use crate::common::{folder, run, succeed, text};
use arrow_array::RecordBatch;
use arrow_array::cast::AsArray;
use arrow_array::types::Float64Type;
use std::fs;
use std::path::Path;
use vlscan::base::corrections::Corrections;
use vlscan::survey::{MaterialDefinition, OpticsDefinition, find_scanner};
use vlscan::{DVec3, Mesh, ReadOptions, Scan};

/// Rectangles as triangles of two materials: the first ones of walls, the last of a mirror if `is_mirror`.
fn mesh(walls: &[[DVec3; 4]], mirror: Option<[DVec3; 4]>) -> Mesh {
    let all: Vec<[DVec3; 4]> = walls.iter().copied().chain(mirror).collect();
    let triangles = (0..all.len() as u32).flat_map(|i| [[0, 1, 2], [0, 2, 3]].map(|t| t.map(|k| 4 * i + k)));
    let material_of = (0..all.len() * 2).map(|i| u32::from(i / 2 == walls.len())).collect();
    let plain =
        MaterialDefinition { kd: [1.0; 3], reflectance: Some(0.5), ..MaterialDefinition::new("plain") };
    let optics = OpticsDefinition { mirror: Some(1.0), ..OpticsDefinition::default() };
    let shiny = MaterialDefinition { optics, ..MaterialDefinition::new("mirror") };
    Mesh::new(all.concat(), triangles.collect(), vec![plain, shiny], material_of).unwrap()
}

/// A rectangle across x with these bounds of y and z.
fn across(x: f64, y: [f64; 2], z: [f64; 2]) -> [DVec3; 4] {
    [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(i, j)| DVec3::new(x, y[i], z[j]))
}

/// Numbers of the points of one turn of a scanner at the origin, column by column.
fn turn(scene: Mesh) -> Vec<[f64; 6]> {
    let (scanner, _) = find_scanner("vlp16", &ReadOptions::default()).unwrap();
    let full = std::f64::consts::TAU;
    let scan = Scan::new(scene, scanner)
        .station(DVec3::Z * 1.5)
        // The light of a slope is continuous only where no mirror is.
        .corrections(Corrections { smooth_slopes: false, ..Corrections::REFINED })
        .configure(|settings| (settings.head_rate, settings.head_stop) = (20.0 * full, full));
    let rows = |batch: RecordBatch| {
        let columns = ["X", "Y", "Z", "Range", "TrueRange", "Amplitude"];
        let columns = columns.map(|name| batch.column_by_name(name).unwrap().as_primitive::<Float64Type>());
        (0..batch.num_rows()).map(|row| columns.map(|column| column.value(row))).collect::<Vec<_>>()
    };
    scan.batches(10_000).unwrap().flat_map(|batch| rows(batch.unwrap())).collect()
}

#[test]
fn a_room_with_a_mirror_is_the_room_with_its_copy_behind_a_hole() {
    let (hole, wide, high) = ([-2.0, 2.0], [-40.0, 40.0], [-20.0, 25.0]);
    let pane = across(3.0, hole, [0.5, 2.5]);
    let frame = [
        across(3.0, [wide[0], hole[0]], high),
        across(3.0, [hole[1], wide[1]], high),
        across(3.0, hole, [high[0], 0.5]),
        across(3.0, hole, [2.5, high[1]]),
    ];
    let board = [(-1.0, 3.0, 0.5), (-2.0, 5.0, 0.5), (-2.0, 5.0, 3.0), (-1.0, 3.0, 3.0)];
    let room = [across(-5.0, [-30.0, 30.0], [-10.0, 12.0]), board.map(|(x, y, z)| DVec3::new(x, y, z))];
    let copy = room.map(|wall| wall.map(|corner| DVec3::new(6.0 - corner.x, corner.y, corner.z)));
    let mirrored = turn(mesh(&[&frame[..], &room].concat(), Some(pane)));
    let copied = turn(mesh(&[&frame[..], &room, &copy].concat(), None));
    assert_eq!(mirrored.len(), copied.len());
    let ghosts = mirrored.iter().filter(|row| row[0] > 3.5).count();
    assert!(ghosts > 100, "{ghosts} ghosts of {} points", mirrored.len());
    for (one, other) in mirrored.iter().zip(&copied) {
        let are_equal = one[..5].iter().zip(&other[..5]).all(|(a, b)| (a - b).abs() < 1e-9);
        assert!(are_equal, "{one:?} is not {other:?}");
        assert!((one[5] / other[5] - 1.0).abs() < 1e-9, "{one:?} is not {other:?}");
    }
}

const SCANNER: &str = "[platform]\nkind = \"linear_path\"\nmount = { rotate_deg = [{ x = -90 }, { z = 90 }] }\n\
    [scanner]\nid = \"exact\"\noptics = \"rotating\"\npulse_freqs_hz = [10000]\nscan_angle_max_deg = 30\n\
    scan_angle_effective_max_deg = 30\nscan_freq_min_hz = 1\nscan_freq_max_hz = 100\nwavelength_nm = 1064\n\
    beam_divergence_rad = 0.0001\npulse_length_ns = 4\nvisibility_km = 100000\naccuracy_m = 0\n\
    range_min_m = 0.5\nrange_max_m = 2000\n[settings]\npulse_freq_hz = 10000\nscan_freq_hz = 20\n\
    [waveform]\nquality = 1\n[[leg]]\nposition_m = [-5, 0, 100]\nspeed_m_per_s = 50\n\
    [[leg]]\nposition_m = [5, 0, 100]\nactive = false\n";

/// A square of 2 km at a height.
fn square(material: &str, z: f64) -> String {
    format!(
        "usemtl {material}\nv -1000 -1000 {z}\nv 1000 -1000 {z}\nv 1000 1000 {z}\nv -1000 1000 {z}\nf -4 -3 -2 -1\n"
    )
}

/// Writes a scene of squares of these materials at these heights, and a flight 100 m above 0.
fn write(dir: &Path, materials: &str, squares: &[(&str, f64)]) {
    let faces: String = squares.iter().map(|(material, z)| square(material, *z)).collect();
    fs::write(dir.join("m.mtl"), materials).unwrap();
    fs::write(dir.join("s.obj"), format!("mtllib m.mtl\n{faces}")).unwrap();
    fs::write(dir.join("p.toml"), format!("scene = \"s.obj\"\n{SCANNER}")).unwrap();
}

const GROUND: &str = "newmtl ground\nKd 1 1 1\nhelios_reflectance 0.3\n";
const COLUMNS: &str = "PulseNumber,Z,Range,Amplitude,BeamDirectionZ,Path,PathOrder,SurfaceZ,ReturnNumber";

/// The rows of a flight, in the order of [`COLUMNS`].
fn flown(dir: &Path, more: &[&str]) -> Vec<Vec<f64>> {
    let base = ["run", "p.toml", "-q", "--force", "-o", "a.csv", "--columns", COLUMNS];
    succeed(dir, &[&base[..], more].concat());
    let table = fs::read_to_string(dir.join("a.csv")).unwrap();
    let numbers = |line: &str| line.split(',').map(|word| word.parse().unwrap()).collect();
    table.lines().skip(1).map(numbers).collect()
}

/// The rows with this path, and the others.
fn split(rows: Vec<Vec<f64>>, path: f64) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
    rows.into_iter().partition(|row| row[5] == path)
}

#[test]
fn ground_below_a_pane_is_labelled_farther_and_darker() {
    let dir = folder();
    let pane = format!("{GROUND}newmtl pane\nvlscan_pane_index 1.5\nvlscan_pane_thickness_m 0.004\n");
    write(dir.path(), &pane, &[("ground", 0.0)]);
    let bare = flown(dir.path(), &[]);
    write(dir.path(), &pane, &[("ground", 0.0), ("pane", 50.0)]);
    let (own, seen) = split(flown(dir.path(), &[]), 8.0);
    assert_eq!((bare.len(), seen.len()), (2001, 2001));
    // Once per turn the beam points straight down, and the pane sends it back.
    assert_eq!(own.len(), 5);
    let is_pane = |row: &Vec<f64>| (row[2] - 50.0).abs() < 1e-3 && row[6..8] == [0.0, 50.0];
    assert!(own.iter().all(|row| is_pane(row) && row[3] > 1e3 * bare[0][3]), "{own:?}");
    for (bare, seen) in bare.iter().zip(&seen) {
        let cosine = -bare[4];
        let root = (2.25 - (1.0 - cosine * cosine)).sqrt();
        let surplus = 0.004 * (2.25 / root - 1.0 / cosine);
        assert!((seen[2] - bare[2] - surplus).abs() < 1.1e-4, "{bare:?} {seen:?}");
        let [s, p] = [(cosine - root) / (cosine + root), (2.25 * cosine - root) / (2.25 * cosine + root)];
        let passed = [s, p].map(|r| (1.0 - r * r) / (1.0 + r * r));
        let squared = (0.5 * (passed[0] + passed[1])).powi(2);
        assert!((seen[3] / bare[3] / squared - 1.0).abs() < 2e-3, "{bare:?} {seen:?}");
        assert_eq!((bare[5], bare[6], seen[5], seen[6]), (0.0, 0.0, 1.0, 1.0));
        assert!(seen[7].abs() < 1e-4 && (seen[1] + surplus * cosine).abs() < 2e-4, "{seen:?}");
    }
    let bytes = |more: &[&str]| {
        flown(dir.path(), more);
        fs::read(dir.path().join("a.csv")).unwrap()
    };
    assert!(bytes(&["-j", "1"]) == bytes(&["-j", "4", "--chunk-size", "7"]));
}

#[test]
fn glass_of_pictures_lets_light_pass_in_the_refined_physics_only() {
    let dir = folder();
    let glass = format!("{GROUND}newmtl glass\nKd 1 1 1\nhelios_reflectance 0.1\nd 0\nillum 4\nNi 1.5\n");
    write(dir.path(), &glass, &[("ground", 0.0), ("glass", 50.0)]);
    let (_, refined) = split(flown(dir.path(), &["--physics", "refined"]), 8.0);
    assert!(refined.iter().all(|row| row[5] == 1.0) && refined.len() == 2001, "{}", refined.len());
    let done =
        run(dir.path(), &["run", "p.toml", "--physics", "helios", "-o", "b.csv", "--columns", COLUMNS]);
    assert!(text(&done.stderr).contains("material \"glass\" is opaque"), "{}", text(&done.stderr));
    let table = fs::read_to_string(dir.path().join("b.csv")).unwrap();
    assert!(table.lines().skip(1).all(|line| line.split(',').nth(5) == Some("0")), "{table}");
}

#[test]
fn facing_mirrors_give_ghosts_up_to_the_maximum_order() {
    let dir = folder();
    let mirror = "newmtl mirror\nKd 1 1 1\nhelios_reflectance 0.1\nvlscan_mirror 1\n";
    write(dir.path(), mirror, &[("mirror", 0.0), ("mirror", 200.0)]);
    let (own, rows) = split(flown(dir.path(), &[]), 8.0);
    assert!(!own.is_empty() && own.iter().all(|row| row[7].abs() < 1e-3), "{own:?}");
    let greatest = rows.iter().map(|row| row[6]).fold(0.0, f64::max);
    assert_eq!(greatest, 4.0);
    for row in &rows {
        assert!(row[5] == if row[6] == 0.0 { 0.0 } else { 2.0 }, "{row:?}");
        let height = if row[6] % 2.0 == 0.0 { 0.0 } else { 200.0 };
        assert!((row[7] - height).abs() < 1e-3, "{row:?}");
    }
}

#[test]
fn the_maximum_order_is_a_key_and_an_option() {
    let dir = folder();
    let mirror = "newmtl mirror\nKd 1 1 1\nhelios_reflectance 0.1\nvlscan_mirror 1\n";
    write(dir.path(), mirror, &[("mirror", 0.0), ("mirror", 200.0)]);
    let greatest = |more: &[&str]| flown(dir.path(), more).iter().map(|row| row[6]).fold(0.0, f64::max);
    let plain = fs::read_to_string(dir.path().join("p.toml")).unwrap();
    let with = |key: &str| {
        fs::write(dir.path().join("p.toml"), format!("{plain}[physics]\n{key}\n")).unwrap();
    };
    with("max_order = 7");
    assert_eq!((greatest(&[]), greatest(&["--max-order", "2"])), (7.0, 2.0));
    // The maximum range ends the ways before.
    with("max_order = 64");
    assert!((8.0..=10.0).contains(&greatest(&[])), "{}", greatest(&[]));
    with("max_order = 0");
    assert!(flown(dir.path(), &[]).iter().all(|row| row[5..7] == [0.0, 0.0]));
    for bad in ["65", "-1", "1.5", "nan"] {
        with(&format!("max_order = {bad}"));
        let done = run(dir.path(), &["run", "p.toml", "-o", "b.csv"]);
        assert!(!done.status.success(), "{bad}");
        assert!(
            text(&done.stderr).contains("expected 0 to 64 mirrors and panes"),
            "{bad}: {}",
            text(&done.stderr)
        );
    }
}

#[test]
fn hostile_materials_are_refused_with_a_message() {
    for (bad, expected) in [
        ("vlscan_pane_index 0", "a refractive index from 1 to 5"),
        ("vlscan_pane_index -1.5", "a refractive index from 1 to 5"),
        ("vlscan_pane_index nan", "a refractive index from 1 to 5"),
        ("vlscan_pane_index inf", "a refractive index from 1 to 5"),
        ("vlscan_pane_thickness_m -0.004", "a thickness of 0 to 1 m"),
        ("vlscan_pane_thickness_m nan", "a thickness of 0 to 1 m"),
        ("vlscan_pane_absorption -1", "an absorption of 0 to 1e6 per metre"),
        ("vlscan_pane_absorption inf", "an absorption of 0 to 1e6 per metre"),
        ("vlscan_pane_sheets 9", "1 or 2 sheets"),
        ("vlscan_pane_sheets 0", "1 or 2 sheets"),
        ("vlscan_mirror 1.5", "a share from 0 to 1"),
        ("vlscan_mirror -0.1", "a share from 0 to 1"),
        ("vlscan_mirror nan", "a share from 0 to 1"),
        ("vlscan_retro -180", "a coefficient of 0 to 1e5"),
        ("vlscan_retro inf", "a coefficient of 0 to 1e5"),
        ("vlscan_mirror 1\nvlscan_roughness_deg nan", "a roughness of 0 to 90 degrees"),
        ("vlscan_mirror 1\nvlscan_pane_index 1.5", "both a mirror and a pane"),
    ] {
        let dir = folder();
        write(dir.path(), &format!("newmtl m\n{bad}\n"), &[("m", 0.0)]);
        let done = run(dir.path(), &["run", "p.toml", "-o", "a.csv"]);
        assert!(!done.status.success(), "{bad}");
        assert!(text(&done.stderr).contains(expected), "{bad}: {}", text(&done.stderr));
    }
    let dir = folder();
    let part = "[[part]]\nfile = \"s.obj\"\n[[part.material]]\npane_index = 0.5\n";
    write(dir.path(), GROUND, &[("ground", 0.0)]);
    fs::write(dir.path().join("p.toml"), format!("{SCANNER}{part}")).unwrap();
    let done = run(dir.path(), &["run", "p.toml", "-o", "a.csv"]);
    assert!(text(&done.stderr).contains("a refractive index from 1 to 5"), "{}", text(&done.stderr));
}

#[test]
fn ghosts_of_surfaces_aside_have_the_same_bytes_from_tiles_and_from_shards() {
    let dir = folder();
    let write = |name: &str, content: &str| fs::write(dir.path().join(name), content).unwrap();
    write("m.mtl", "newmtl wall\nKd 1 1 1\nhelios_reflectance 0.3\nnewmtl mirror\nvlscan_mirror 1\n");
    // A mirror at 45° below the flight, and the wall that it shows, which no beam meets by itself.
    let mirror = "v -75 -500 95\nv 75 -500 -55\nv 75 500 -55\nv -75 500 95\n";
    write("mirror.obj", &format!("mtllib m.mtl\nusemtl mirror\n{mirror}f 1 2 3 4\n"));
    let wall = "v 200 -500 -500\nv 200 500 -500\nv 200 500 500\nv 200 -500 500\n";
    write("wall.obj", &format!("mtllib m.mtl\nusemtl wall\n{wall}f 1 2 3 4\n"));
    write("p.toml", &format!("{SCANNER}[[part]]\nfile = \"mirror.obj\"\n[[part]]\nfile = \"wall.obj\"\n"));
    let bytes = |name: &str| fs::read(dir.path().join(name)).unwrap();
    let rows = flown(dir.path(), &[]);
    // The pulse at the end of the flight depends on the last bit of its duration.
    assert!((2000..=2001).contains(&rows.len()), "{}", rows.len());
    assert!(rows.iter().all(|row| row[5..7] == [2.0, 1.0]), "{:?}", rows[0]);
    let all = bytes("a.csv");
    assert_eq!(flown(dir.path(), &["--scene-memory", "1M"]), rows);
    assert!(bytes("a.csv") == all, "tiles");
    for shard in ["0/2", "1/2"] {
        succeed(dir.path(), &["run", "p.toml", "-q", "--shard", shard, "-o", "shards", "--columns", COLUMNS]);
    }
    succeed(dir.path(), &["merge", "shards", "-q", "-o", "b.csv", "--columns", COLUMNS]);
    assert!(bytes("b.csv") == all, "shards");
}

/// Ground at 0 under a lake whose level is 10, with these properties.
fn write_lake(dir: &Path, scanner: &str, water: &str) {
    let ground = square("ground", 0.0);
    fs::write(dir.join("m.mtl"), GROUND).unwrap();
    fs::write(dir.join("ground.obj"), format!("mtllib m.mtl\n{ground}")).unwrap();
    let lake = "[[part]]\nfile = \"ground.obj\"\n[[part]]\nwater_level_m = 10\n\
                water_area_m = [-1000, -1000, 1000, 1000]\n[[part.material]]\n";
    fs::write(dir.join("p.toml"), format!("{scanner}{lake}{water}")).unwrap();
}

#[test]
fn a_lake_has_surface_column_and_bottom_with_the_same_bytes_in_every_way() {
    let dir = folder();
    write_lake(dir.path(), SCANNER, "water_attenuation = 0.05\nwater_wind_m_s = 6\nwater_wind_deg = 30\n");
    let rows = flown(dir.path(), &[]);
    let of = |path: f64| rows.iter().filter(move |row| row[5] == path);
    assert!(of(5.0).count() > 1900 && of(3.0).count() > 500, "{} {}", of(5.0).count(), of(3.0).count());
    assert!(of(5.0).all(|row| row[7].abs() < 1e-3 && row[6] == 1.0));
    assert!(of(3.0).all(|row| (row[7] - 10.0).abs() < 1e-3 && row[6] == 0.0));
    assert!(of(4.0).all(|row| (0.0..=10.0).contains(&row[7])));
    assert!(rows.iter().all(|row| (3.0..=5.0).contains(&row[5])));
    // Bottoms are too deep: light is slower in water, by 10 m · 0.357 at nadir and less aside.
    assert!(of(5.0).all(|row| (-4.0..-1.5).contains(&row[1])));
    let bytes = |name: &str| fs::read(dir.path().join(name)).unwrap();
    let all = bytes("a.csv");
    for way in [
        &["-j", "1", "--chunk-size", "7"][..],
        &["-j", "4", "--chunk-size", "4096"],
        &["-j", "2", "--tree", "sah"],
        &["-j", "2", "--tree", "fsah"],
        &["--scene-memory", "1M"],
    ] {
        flown(dir.path(), way);
        assert!(bytes("a.csv") == all, "{way:?}");
    }
    for shard in ["0/2", "1/2"] {
        succeed(dir.path(), &["run", "p.toml", "-q", "--shard", shard, "-o", "shards", "--columns", COLUMNS]);
    }
    succeed(dir.path(), &["merge", "shards", "-q", "-o", "b.csv", "--columns", COLUMNS]);
    assert!(bytes("b.csv") == all, "shards");
}

#[test]
fn points_below_water_are_corrected_for_refraction_and_have_classes_of_bathymetry() {
    let dir = folder();
    let corrected = SCANNER.replace("accuracy_m = 0", "accuracy_m = 0\nrefraction_corrected = true");
    assert_ne!(corrected, SCANNER);
    let flat = "water_attenuation = 0.05\nwater_wind_m_s = 0\nwater_backscatter = 0\n";
    write_lake(dir.path(), SCANNER, flat);
    // Flat water sends the beam back that points straight down, once per turn.
    let (surface, recorded) = split(flown(dir.path(), &[]), 3.0);
    write_lake(dir.path(), &corrected, flat);
    let (_, rows) = split(flown(dir.path(), &[]), 3.0);
    assert_eq!((rows.len(), recorded.len(), surface.len()), (2001, 2001, 5));
    for (row, recorded) in rows.iter().zip(&recorded) {
        assert!(row[1].abs() < 2e-3 && row[2] == recorded[2], "{row:?} {recorded:?}");
        let (cosine, index) = (-row[4], 1.335035f64);
        let inner = (1.0 - (1.0 - cosine * cosine) / (index * index)).sqrt();
        let range = 90.0 / cosine + 10.0 * 1.356954 / inner;
        assert!((recorded[2] - range).abs() < 1e-3, "{recorded:?}: {range}");
        assert!((recorded[1] - (100.0 - range * cosine)).abs() < 2e-3, "{recorded:?}");
    }
    write_lake(dir.path(), &corrected, "water_secchi_m = 20\nwater_wind_m_s = 8\n");
    succeed(dir.path(), &["run", "p.toml", "-q", "-o", "c.csv", "--columns", "Path,Classification"]);
    let table = fs::read_to_string(dir.path().join("c.csv")).unwrap();
    let has = |row: &str| table.lines().any(|line| line == row);
    assert!(has("3,41") && has("5,40") && !has("3,0") && !has("5,0"), "{table}");
}

#[test]
fn impossible_water_is_refused_with_a_message() {
    for (bad, expected) in [
        ("vlscan_water_index 0", "a refractive index from 1 to 5"),
        ("vlscan_water_index -1.33", "a refractive index from 1 to 5"),
        ("vlscan_water_group_index nan", "a refractive index from 1 to 5"),
        ("vlscan_water_group_index 0", "a refractive index from 1 to 5"),
        ("vlscan_water_attenuation -1", "an attenuation of 0 to 1e4 per metre"),
        ("vlscan_water_attenuation inf", "an attenuation of 0 to 1e4 per metre"),
        ("vlscan_water_secchi_m 0", "a Secchi depth of 0.01 to 100 m"),
        ("vlscan_water_secchi_m -4", "a Secchi depth of 0.01 to 100 m"),
        ("vlscan_water_secchi_m nan", "a Secchi depth of 0.01 to 100 m"),
        ("vlscan_water_backscatter -1", "a backscatter of 0 to 10"),
        ("vlscan_water_wind_m_s nan", "a wind speed of 0 to 50 m/s"),
        ("vlscan_water_wind_m_s -3", "a wind speed of 0 to 50 m/s"),
        ("vlscan_water_wind_m_s inf", "a wind speed of 0 to 50 m/s"),
        ("vlscan_water_wind_deg nan", "a direction of -360 to 360 degrees"),
        ("vlscan_water_wind_m_s 1\nvlscan_mirror 1", "both a mirror and water"),
        ("vlscan_water_secchi_m 1\nvlscan_water_attenuation 1", "both an attenuation and a Secchi depth"),
        ("vlscan_water_beam_attenuation 0.01", "a beam attenuation of at least"),
    ] {
        let dir = folder();
        write(dir.path(), &format!("newmtl m\n{bad}\n"), &[("m", 0.0)]);
        let done = run(dir.path(), &["run", "p.toml", "-o", "a.csv"]);
        assert!(!done.status.success(), "{bad}");
        assert!(text(&done.stderr).contains(expected), "{bad}: {}", text(&done.stderr));
    }
    for (bad, expected) in [
        ("[[part]]\nwater_level_m = 1\n", "needs the key `water_area_m`"),
        ("[[part]]\nwater_area_m = [0, 0, 1, 1]\n", "water_level_m"),
        ("[[part]]\nwater_level_m = nan\nwater_area_m = [0, 0, 1, 1]\n", "a height of -1e5 to 1e5 m"),
        (
            "[[part]]\nwater_level_m = 1\nwater_area_m = [1, 0, 0, 1]\n",
            "the smallest x and y, then the largest",
        ),
        ("[[part]]\nfile = \"s.obj\"\nwater_level_m = 1\nwater_area_m = [0, 0, 1, 1]\n", "has no meaning"),
        (
            "[[part]]\nfile = \"s.obj\"\n[[part.material]]\nwater_index = 0.5\n",
            "a refractive index from 1 to 5",
        ),
        (
            "[[part]]\nfile = \"s.obj\"\n[[part.material]]\nwater_secchi_m = 1\nwater_attenuation = 1\n",
            "not both",
        ),
    ] {
        let dir = folder();
        write(dir.path(), GROUND, &[("ground", 0.0)]);
        fs::write(dir.path().join("p.toml"), format!("{SCANNER}{bad}")).unwrap();
        let done = run(dir.path(), &["run", "p.toml", "-o", "a.csv"]);
        assert!(!done.status.success(), "{bad}");
        assert!(text(&done.stderr).contains(expected), "{bad}: {}", text(&done.stderr));
    }
}

#[test]
fn weather_dims_the_ground_and_is_labelled() {
    let dir = folder();
    write(dir.path(), GROUND, &[("ground", 0.0)]);
    let dry = flown(dir.path(), &[]);
    let pipeline = fs::read_to_string(dir.path().join("p.toml")).unwrap();
    let weather = "[settings]\nweather = { mor_m = 1000, rain_mm_h = 20 }\n";
    fs::write(dir.path().join("p.toml"), pipeline.replace("[settings]\n", weather)).unwrap();
    let wet = flown(dir.path(), &[]);
    let of = |path: f64| wet.iter().filter(move |row| row[5] == path);
    assert_eq!(of(0.0).count(), dry.len());
    assert!(of(6.0).count() >= dry.len() && of(7.0).count() > 100, "{} {}", of(6.0).count(), of(7.0).count());
    let slope = 4.1 * 20f64.powf(-0.21);
    let extinction = 20f64.ln() / 1000.0 + std::f64::consts::PI * 8e-3 / slope.powi(3);
    let mut sum = 0.0;
    for (wet, dry) in of(0.0).zip(&dry) {
        let share = wet[3] / dry[3] / (-2.0 * extinction * dry[2]).exp();
        // A large drop just above the ground adds a little.
        assert!((share - 1.0).abs() < 0.05, "{wet:?} {dry:?}");
        sum += share;
    }
    assert!((sum / dry.len() as f64 - 1.0).abs() < 0.005, "{sum}");
    let bytes = |more: &[&str]| {
        flown(dir.path(), more);
        fs::read(dir.path().join("a.csv")).unwrap()
    };
    assert!(bytes(&["-j", "1"]) == bytes(&["-j", "4", "--chunk-size", "7"]));
    let with = |keys: &str| {
        let foul = pipeline.replace("[settings]\n", &format!("[settings]\nweather = {{ {keys} }}\n"));
        fs::write(dir.path().join("p.toml"), foul).unwrap();
        let done = run(dir.path(), &["run", "p.toml", "-q", "--force", "-o", "a.csv"]);
        assert_eq!(done.status.code(), Some(2), "{keys}");
        text(&done.stderr)
    };
    for (keys, message) in [
        ("mor_m = 100, visibility_km = 5", "give either `mor_m` or `visibility_km`, not both"),
        ("rain_mm_h = -1", "`rain_mm_h` must be a rate of 0 to 1000 mm/h, found `-1`"),
        ("dust = nan", "`dust` must be an extinction of 0 to 100 per metre, found `nan`"),
    ] {
        let found = with(keys);
        assert!(found.contains(message), "{keys}: {found}");
    }
}

#[test]
fn columns_of_radial_velocity_are_in_tables_and_point_files() {
    let dir = folder();
    write(dir.path(), GROUND, &[("ground", 0.0)]);
    // Turned by 30 degrees, the fan of beams looks ahead and back, too.
    let pipeline = fs::read_to_string(dir.path().join("p.toml")).unwrap();
    fs::write(dir.path().join("p.toml"), pipeline.replace("{ z = 90 }", "{ z = 60 }")).unwrap();
    let base = ["run", "p.toml", "-q", "--force", "-o"];
    let columns = ["--columns", "BeamDirectionX,Doppler,DopplerWidth"];
    let table = |name: &str, more: &[&str]| {
        succeed(dir.path(), &[&base[..], &[name], &columns, more].concat());
        fs::read(dir.path().join(name)).unwrap()
    };
    let csv = table("a.csv", &["-j", "1"]);
    assert!(csv == table("b.csv", &["-j", "3", "--chunk-size", "5"]));
    let rows = text(&csv);
    let rows: Vec<&str> = rows.lines().collect();
    // The flight goes towards +x at 50 m/s; its first and last pulses leave where it starts and ends.
    let mut farthest = 0.0f64;
    for row in &rows[3..rows.len() - 2] {
        let numbers: Vec<f64> = row.split(',').map(|word| word.parse().unwrap()).collect();
        let [along, doppler, width] = numbers[..] else { panic!("{row}") };
        assert!((doppler + 50.0 * along).abs() < 1e-7 && width == 0.0, "{row}");
        farthest = farthest.max(along.abs());
    }
    assert!(farthest > 0.2, "{farthest}");
    let has = |name: &str, field: &str, more: &[&str]| {
        let bytes = table(name, more);
        assert!(bytes.windows(field.len()).any(|found| found == field.as_bytes()), "{name} has no {field}");
    };
    has("a.las", "Doppler", &[]);
    has("a.pcd", "doppler", &[]);
    has("a.mcap", "doppler", &["--frame-s", "0.1"]);
    has("a.arrow", "DopplerWidth", &[]);
    let plain = ["run", "p.toml", "-q", "--force", "-o", "plain.las"];
    succeed(dir.path(), &plain);
    let bytes = fs::read(dir.path().join("plain.las")).unwrap();
    assert!(!bytes.windows(7).any(|found| found == b"Doppler"));
}

/// Labels of the way of light that a file without columns has.
const LABELS: &str = "Path,PathOrder,Primitive,SurfaceX,SurfaceY,SurfaceZ";

#[test]
fn labels_of_light_are_in_every_format() {
    let dir = folder();
    let pane = format!("{GROUND}newmtl pane\nvlscan_pane_index 1.5\n");
    write(dir.path(), &pane, &[("ground", 0.0), ("pane", 50.0)]);
    let base = ["run", "p.toml", "-q", "--force", "--columns", LABELS];
    let bytes = |name: &str, more: &[&str]| {
        succeed(dir.path(), &[&base[..], &["-o", name], more].concat());
        fs::read(dir.path().join(name)).unwrap()
    };
    let numbers = |line: &str, separator: char| -> Vec<f64> {
        line.split(separator).map(|word| word.parse().unwrap()).collect()
    };
    let csv = text(&bytes("a.csv", &[]));
    let rows: Vec<Vec<f64>> = csv.lines().skip(1).map(|line| numbers(line, ',')).collect();
    assert!(rows.iter().any(|row| row[0] == 1.0) && rows.iter().any(|row| row[0] == 8.0));
    let is_near = |one: &[f64], other: &[f64]| one.iter().zip(other).all(|(a, b)| (a - b).abs() < 1e-4);

    // The labels are the last extra bytes of a record; with `--labels` the primitive is among these.
    for (more, primitive) in [(vec![], 4), (vec!["--labels"], 0)] {
        let las = bytes("a.las", &more);
        let word = |at: usize| u32::from_le_bytes(las[at..at + 4].try_into().unwrap()) as usize;
        let length = usize::from(u16::from_le_bytes([las[105], las[106]]));
        let records: Vec<&[u8]> = las[word(96)..].chunks_exact(length).take(rows.len()).collect();
        assert_eq!(records.len(), rows.len());
        for (record, row) in records.into_iter().zip(&rows) {
            let own = &record[length - 26 - primitive..];
            assert_eq!([f64::from(own[0]), f64::from(own[1])], row[..2], "{row:?}");
            let surface: Vec<f64> = own[2 + primitive..]
                .chunks_exact(8)
                .map(|bytes| f64::from_le_bytes(bytes.try_into().unwrap()))
                .collect();
            assert!(is_near(&surface, &row[3..]), "{surface:?} is not {row:?}");
        }
    }
    let ply = text(&bytes("a.ply", &["--format", "ply-ascii"]));
    let at = ply.find("end_header\n").unwrap() + "end_header\n".len();
    for (line, row) in ply[at..].lines().zip(&rows) {
        let own = numbers(line, ' ');
        assert!(is_near(&own[own.len() - 6..], row), "{line} is not {row:?}");
    }
    for (name, label) in [
        ("a.laz", "PathOrder"),
        ("a.copc.laz", "PathOrder"),
        ("a.ply", "property uchar scalar_PathOrder"),
        ("a.pcd", "path path_order primitive surface_x surface_y surface_z"),
        ("a.e57", "path_order"),
        ("a.mcap", "path_order"),
    ] {
        let found = bytes(name, &[]);
        assert!(found.windows(label.len()).any(|window| window == label.as_bytes()), "{name}");
        if name != "a.mcap" {
            let info = text(&succeed(dir.path(), &["info", name]).stdout);
            assert!(info.contains("through panes") && info.contains("straight back"), "{name}: {info}");
        }
        let plain = ["run", "p.toml", "-q", "--force", "-o", name];
        succeed(dir.path(), &plain);
        let plain = fs::read(dir.path().join(name)).unwrap();
        assert!(!plain.windows(label.len()).any(|window| window == label.as_bytes()), "{name}");
    }
    let done = run(dir.path(), &[&base[..], &["-o", "a.raycloud.ply"]].concat());
    assert_eq!(done.status.code(), Some(2));
}

#[test]
fn doubtful_materials_and_levels_are_warnings_that_name_what_was_typed() {
    let dir = folder();
    let said = |done: std::process::Output| {
        assert!(done.status.success(), "{}", text(&done.stderr));
        text(&done.stderr)
    };
    let args = ["run", "p.toml", "--force", "-o", "a.csv"];
    for (lines, expected) in [
        ("illum 4\nNi -1\n", "Ni -1 is no refractive index from 1 to 5; the pane has 1.5"),
        ("d 2\nhelios_reflectance 0.5\n", "d 2 is no share from 0 to 1; it is read as 1"),
        ("vlscan_mirror 0.5\nvlscan_mirror 0.7\n", "has vlscan_mirror already; the last one counts"),
    ] {
        write(dir.path(), &format!("{GROUND}newmtl m\n{lines}"), &[("ground", 0.0), ("m", 50.0)]);
        let found = said(run(dir.path(), &args));
        assert!(found.contains(expected), "{lines}: {found}");
    }
    let level = |level: &str| {
        write_lake(dir.path(), SCANNER, "water_secchi_m = 4\n");
        let pipeline = fs::read_to_string(dir.path().join("p.toml")).unwrap();
        let pipeline = pipeline.replace("water_level_m = 10", &format!("water_level_m = {level}"));
        fs::write(dir.path().join("p.toml"), pipeline).unwrap();
        said(run(dir.path(), &args))
    };
    for low in ["-5", "0"] {
        let found = level(low);
        let expected = format!("at z {low} m lies below everything else in its area, which begins at z 0 m");
        assert!(found.contains(&expected), "{found}");
    }
    assert!(!level("0.5").contains("lies below"));
    let found = level("150");
    assert!(found.contains("is in water: its height is 100.0, the water's 150.0"), "{found}");
    write_lake(dir.path(), SCANNER, "water_secchi_m = 17\nwater_beam_attenuation = 0.05\n");
    let done = run(dir.path(), &args);
    let expected = "its water_beam_attenuation is 0.05, expected a beam attenuation of at least the diffuse \
                    attenuation, 0.1 per metre";
    assert!(text(&done.stderr).contains(expected), "{}", text(&done.stderr));
}
