//! Colours of points in complete runs: texels exactly, in every format that has colours, from shards and from
//! any number of threads.

use crate::common::{folder, run, succeed, text};
use std::fs;
use std::path::Path;

const FLIGHT: &str = "scene = \"s.obj\"\n[platform]\nkind = \"linear_path\"\n\
    mount = { rotate_deg = [{ x = -90 }, { z = 90 }] }\n\
    [scanner]\nid = \"exact\"\noptics = \"rotating\"\npulse_freqs_hz = [10000]\nscan_angle_max_deg = 30\n\
    scan_angle_effective_max_deg = 30\nscan_freq_min_hz = 1\nscan_freq_max_hz = 100\nwavelength_nm = 1064\n\
    beam_divergence_rad = 0.0001\npulse_length_ns = 4\nvisibility_km = 100000\naccuracy_m = 0\n\
    range_min_m = 0.5\nrange_max_m = 2000\n[settings]\npulse_freq_hz = 10000\nscan_freq_hz = 20\n\
    [waveform]\nquality = 1\n[[leg]]\nposition_m = [-5, 0, 100]\nspeed_m_per_s = 50\n\
    [[leg]]\nposition_m = [5, 0, 100]\nactive = false\n";

/// Texels of 4 by 4, by rows from the upper edge.
fn texel(column: usize, row: usize) -> [u8; 3] {
    [10 + 60 * column as u8, 5 + 60 * row as u8, 200]
}

/// A ground of 200 m with a texture that repeats every 20 m, and a flight over it.
fn write(dir: &Path) {
    let texels: Vec<u8> = (0..16).flat_map(|i| texel(i % 4, i / 4)).collect();
    let mut image = Vec::new();
    let mut encoder = png::Encoder::new(&mut image, 4, 4);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header().unwrap().write_image_data(&texels).unwrap();
    fs::write(dir.join("t.png"), image).unwrap();
    fs::write(dir.join("m.mtl"), "newmtl a\nKd 1 1 1\nmap_Kd t.png\nhelios_reflectance 0.3\n").unwrap();
    let square = "mtllib m.mtl\nv -100 -100 0\nv 100 -100 0\nv 100 100 0\nv -100 100 0\n\
                  vt -5 -5\nvt 5 -5\nvt 5 5\nvt -5 5\nusemtl a\nf 1/1 2/2 3/3 4/4\n";
    fs::write(dir.join("s.obj"), square).unwrap();
    fs::write(dir.join("p.toml"), FLIGHT).unwrap();
}

#[test]
fn points_have_the_texel_that_the_beam_hit() {
    let dir = folder();
    write(dir.path());
    let columns = "SurfaceX,SurfaceY,Red,Green,Blue";
    succeed(dir.path(), &["run", "p.toml", "-q", "-o", "a.csv", "--columns", columns]);
    let table = fs::read_to_string(dir.path().join("a.csv")).unwrap();
    let mut seen = 0;
    for line in table.lines().skip(1) {
        let row: Vec<f64> = line.split(',').map(|word| word.parse().unwrap()).collect();
        // Texels of 5 m; positions have four decimals.
        let [u, v] = [row[0] / 5.0, row[1] / 5.0];
        if [u, v].iter().any(|c| (c - c.round()).abs() < 1e-4) {
            continue;
        }
        let column = u.floor().rem_euclid(4.0) as usize;
        let row_up = v.floor().rem_euclid(4.0) as usize;
        let expected = texel(column, 3 - row_up).map(|component| f64::from(component) * 256.0);
        assert_eq!(row[2..], expected, "{line}");
        seen += 1;
    }
    assert!(seen > 1500, "{seen}");
    let bytes = |more: &[&str]| {
        let base = ["run", "p.toml", "-q", "--force", "-o", "a.csv", "--columns", columns];
        succeed(dir.path(), &[&base[..], more].concat());
        fs::read(dir.path().join("a.csv")).unwrap()
    };
    let one = bytes(&["-j", "1"]);
    assert!(one == bytes(&["-j", "4", "--chunk-size", "7"]) && one == bytes(&["--scene-memory", "1M"]));
}

#[test]
fn las_files_have_point_format_7_with_256_times_the_bits() {
    let dir = folder();
    write(dir.path());
    succeed(dir.path(), &["run", "p.toml", "-q", "-o", "a.las", "--columns", "Red,Green,Blue"]);
    let las = fs::read(dir.path().join("a.las")).unwrap();
    let short = |at: usize| u16::from_le_bytes([las[at], las[at + 1]]);
    let first = u32::from_le_bytes([las[96], las[97], las[98], las[99]]) as usize;
    assert_eq!((las[104], short(105) >= 36), (7, true));
    let blue: Vec<u16> = (0..100).map(|i| short(first + i * usize::from(short(105)) + 34)).collect();
    assert_eq!(blue, [200 * 256; 100]);
    succeed(dir.path(), &["run", "p.toml", "-q", "-o", "plain.las"]);
    assert_eq!(fs::read(dir.path().join("plain.las")).unwrap()[104], 6);
    let refused = run(dir.path(), &["run", "p.toml", "-o", "b.las", "--las10", "--columns", "Red"]);
    assert!(text(&refused.stderr).contains("LAS 1.0 has no colours"), "{}", text(&refused.stderr));
}

#[test]
fn every_format_with_colours_is_read_back_with_them() {
    let dir = folder();
    write(dir.path());
    for name in ["a.laz", "a.copc.laz", "a.ply", "a.pcd", "a.e57", "a.parquet", "a.csv"] {
        let columns = if name.ends_with("csv") || name.ends_with("parquet") {
            "X,Y,Z,Red,Green,Blue"
        } else {
            "Red,Green,Blue"
        };
        succeed(dir.path(), &["run", "p.toml", "-q", "-o", name, "--columns", columns]);
        succeed(dir.path(), &["preview", name, "-o", "a.html", "--force", "-q", "--colour", "rgb"]);
        let page = fs::read_to_string(dir.path().join("a.html")).unwrap();
        assert!(page.contains("\"colour\":\"rgb\"") && page.contains("\"own\":true"), "{name}");
    }
    for name in ["a.pcd", "a.mcap"] {
        succeed(dir.path(), &["run", "p.toml", "-q", "--force", "-o", name, "--columns", "Red,Green,Blue"]);
        let bytes = fs::read(dir.path().join(name)).unwrap();
        assert!(bytes.windows(3).any(|window| window == b"rgb"), "{name}");
    }
}

#[test]
fn the_octree_of_preview_keeps_colours() {
    let dir = folder();
    write(dir.path());
    succeed(dir.path(), &["run", "p.toml", "-q", "-o", "a.laz", "--columns", "Red,Green,Blue"]);
    succeed(dir.path(), &["preview", "a.laz", "-o", "b.copc.laz", "-q"]);
    let copy = fs::read(dir.path().join("b.copc.laz")).unwrap();
    assert_eq!(copy[104] & 0x3f, 7);
    succeed(dir.path(), &["preview", "b.copc.laz", "-o", "b.html", "-q", "--colour", "rgb"]);
    let page = fs::read_to_string(dir.path().join("b.html")).unwrap();
    assert!(page.contains("\"own\":true"));
}

#[test]
fn packed_scenes_have_the_colours_that_they_were_packed_with() {
    let dir = folder();
    write(dir.path());
    let columns = ["--columns", "X,Y,Z,Red,Green,Blue"];
    succeed(dir.path(), &[&["run", "p.toml", "-q", "-o", "a.csv"], &columns[..]].concat());
    let expected = fs::read(dir.path().join("a.csv")).unwrap();
    let (whole, paged): (&[&str], &[&str]) = (&[], &["--scene-memory", "1M"]);
    for more in [whole, paged] {
        let pack = ["scene", "pack", "p.toml", "-q", "--force", "-o", "s.vlscene", "--colours"];
        succeed(dir.path(), &[&pack[..], more].concat());
        let scan = ["run", "p.toml", "-q", "--force", "-o", "b.csv", "--scene", "s.vlscene"];
        succeed(dir.path(), &[&scan[..], more, &columns[..]].concat());
        assert!(fs::read(dir.path().join("b.csv")).unwrap() == expected, "{more:?}");
    }
    succeed(dir.path(), &["scene", "pack", "p.toml", "-q", "--force", "-o", "s.vlscene"]);
    let scan = ["run", "p.toml", "--force", "-o", "b.csv", "--scene", "s.vlscene"];
    let black = run(dir.path(), &[&scan[..], &columns[..]].concat());
    assert!(text(&black.stderr).contains("packed without colours"), "{}", text(&black.stderr));
}

#[test]
fn shards_have_colours_if_they_are_computed_with_them() {
    let dir = folder();
    write(dir.path());
    let columns = ["--columns", "X,Y,Z,Red,Green,Blue"];
    succeed(dir.path(), &[&["run", "p.toml", "-q", "-o", "whole.csv"], &columns[..]].concat());
    for number in ["0/2", "1/2"] {
        let shard = ["run", "p.toml", "-q", "--shard", number, "-o", "shards"];
        succeed(dir.path(), &[&shard[..], &columns].concat());
    }
    succeed(dir.path(), &[&["merge", "shards", "-q", "-o", "merged.csv"], &columns[..]].concat());
    let [whole, merged] = ["whole.csv", "merged.csv"].map(|name| fs::read(dir.path().join(name)).unwrap());
    assert!(whole == merged);
}
