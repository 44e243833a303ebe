//! Meshes of a room whose walls are known, and those that other programs write: trimesh (PLY, STL, GLB with
//! instances) and pygltflib (glTF with buffers beside it).

use crate::common::{folder, judge, python, succeed, text};
use base64::Engine;
use std::fmt::Write;
use std::fs;
use std::path::Path;

/// Output of `scene info` for a file.
fn facts(folder: &Path, scene: &str) -> serde_json::Value {
    let output = succeed(folder, &["scene", "info", scene, "--json", "-q"]);
    serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{e}: {}", text(&output.stdout)))
}

/// Lowest and highest corner of the scene.
fn extent(facts: &serde_json::Value) -> Vec<f64> {
    ["min", "max"]
        .iter()
        .flat_map(|end| facts["bounds_m"][end].as_array().unwrap_or_else(|| panic!("{facts}")))
        .map(|v| v.as_f64().unwrap())
        .collect()
}

/// Lower and upper corner of a room, m.
const ROOM: [[f64; 3]; 2] = [[-10.0, -15.0, -2.0], [10.0, 15.0, 6.0]];

/// The corners of the room, of which the bits of the index are the upper sides, and the triangles of its
/// faces.
fn room() -> (Vec<[f64; 3]>, Vec<[usize; 3]>) {
    let corner = |i: usize| [0, 1, 2].map(|axis| ROOM[i >> axis & 1][axis]);
    let face = |axis: usize, side: usize| {
        let (u, v) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
        let first = side << axis;
        [[first, first + u, first + u + v], [first, first + u + v, first + v]]
    };
    let faces = (0..6).flat_map(|i| face(i / 2, i % 2)).collect();
    ((0..8).map(corner).collect(), faces)
}

/// The room as PLY, STL and glTF, whose material is `room`.
fn rooms() -> [(&'static str, Vec<u8>); 3] {
    let (corners, faces) = room();
    let mut ply =
        "ply\nformat ascii 1.0\nelement vertex 8\nproperty double x\nproperty double y\nproperty double z\n\
                   element face 12\nproperty list uchar int vertex_indices\nend_header\n"
            .to_owned();
    corners.iter().for_each(|[x, y, z]| writeln!(ply, "{x} {y} {z}").unwrap());
    faces.iter().for_each(|[a, b, c]| writeln!(ply, "3 {a} {b} {c}").unwrap());
    let mut stl = "solid room\n".to_owned();
    for face in &faces {
        stl.push_str("facet normal 0 0 0\nouter loop\n");
        face.map(|i| corners[i]).iter().for_each(|[x, y, z]| writeln!(stl, "vertex {x} {y} {z}").unwrap());
        stl.push_str("endloop\nendfacet\n");
    }
    stl.push_str("endsolid room\n");
    // The y axis of glTF is up.
    let floats = corners.iter().flat_map(|&[x, y, z]| [x, z, -y]);
    let mut buffer: Vec<u8> = floats.flat_map(|v| (v as f32).to_le_bytes()).collect();
    buffer.extend(faces.iter().flatten().map(|&i| i as u8));
    let data = base64::engine::general_purpose::STANDARD.encode(&buffer);
    let gltf = serde_json::json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
        "materials": [{"name": "room"}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3"},
                      {"bufferView": 1, "componentType": 5121, "count": 36, "type": "SCALAR"}],
        "bufferViews": [{"buffer": 0, "byteLength": 96}, {"buffer": 0, "byteOffset": 96, "byteLength": 36}],
        "buffers": [{"byteLength": 132, "uri": format!("data:application/octet-stream;base64,{data}")}]
    });
    [
        ("room.ply", ply.into_bytes()),
        ("room.stl", stl.into_bytes()),
        ("room.gltf", gltf.to_string().into_bytes()),
    ]
}

#[test]
fn points_lie_on_the_walls_of_a_room_in_every_format() {
    let dir = folder();
    fs::write(dir.path().join("materials.csv"), "name,reflectance,class\nroom,0.4,6\n").unwrap();
    for (file, content) in rooms() {
        fs::write(dir.path().join(file), content).unwrap();
        let found = facts(dir.path(), file);
        assert_eq!((&found["triangles"], extent(&found)), (&serde_json::json!(12), ROOM.concat()), "{file}");
        let pipeline = format!(
            "scene = '{file}'\n[platform]\ncatalogue = 'data/platforms.xml#tripod'\n[scanner]\n\
             catalogue = 'data/scanners_tls.xml#riegl_vz400'\naccuracy_m = 0\n[settings]\npulse_freq_hz = 100000\n\
             scan_freq_hz = 100\nhead_rate_deg_per_s = 120\nhead_stop_deg = 360\n[waveform]\nquality = 1\n\
             [[leg]]\nposition_m = [1, 2, -2]\n"
        );
        fs::write(dir.path().join("p.toml"), pipeline).unwrap();
        let columns = "X,Y,Z,SurfaceClass";
        succeed(dir.path(), &["run", "p.toml", "-o", "a.csv", "--columns", columns, "--force", "-q"]);
        let points = fs::read_to_string(dir.path().join("a.csv")).unwrap();
        let mut hits = [0; 6];
        for line in points.lines().skip(1) {
            let row: Vec<f64> = line.split(',').map(|v| v.parse().unwrap()).collect();
            let on = |side: usize| (row[side % 3] - ROOM[side / 3][side % 3]).abs() < 0.002;
            let side = (0..6).find(|&side| on(side)).unwrap_or_else(|| panic!("{file}: {line}"));
            assert_eq!(row[3], 6.0, "{file}: {line}");
            hits[side] += 1;
        }
        assert!(hits.iter().all(|&count| count > 1000), "{file}: {hits:?}");
    }
}

const TRIMESH: &str = r#"
import json, math
import numpy as np
import trimesh
box = trimesh.creation.box(extents=(2, 3, 4))
ball = trimesh.creation.icosphere(subdivisions=2, radius=1.5)
ball.export("ball.ply")
ball.export("ball_ascii.ply", encoding="ascii")
ball.export("ball.stl")
ball.export("ball_ascii.stl", file_type="stl_ascii")
ball.export("ball.glb")
scene = trimesh.Scene()
turn = trimesh.transformations.rotation_matrix(math.radians(30), (1, 2, 3))
turn[:3, 3] = (10, 20, 30)
scene.add_geometry(box, node_name="one", geom_name="crate", transform=turn)
far = np.diag((2.0, 2.0, 2.0, 1.0)); far[:3, 3] = (-5, 0, 1)
scene.add_geometry(ball, node_name="two", geom_name="ball", transform=far)
scene.graph.update("three", geometry="crate", matrix=np.diag((1.0, 0.5, 3.0, 1.0)))
scene.export("scene.glb")
areas = [m.area for m in (box.copy().apply_transform(turn), ball.copy().apply_transform(far), box.copy().apply_transform(np.diag((1.0, 0.5, 3.0, 1.0))))]
print(json.dumps({"areas": areas, "faces": len(ball.faces), "bounds": scene.bounds.tolist(), "all": len(scene.to_geometry().faces)}))
"#;

#[test]
fn files_of_trimesh_are_read_as_trimesh_reads_them() {
    let Some(python) = python("trimesh") else { return };
    let dir = folder();
    let known: serde_json::Value = serde_json::from_str(&judge(&python, dir.path(), TRIMESH)).unwrap();
    for file in ["ball.ply", "ball_ascii.ply", "ball.stl", "ball_ascii.stl", "ball.glb"] {
        let found = facts(dir.path(), file);
        assert_eq!(found["triangles"], known["faces"], "{file}: {found}");
        let radius = extent(&found);
        assert!(radius.iter().all(|r| (r.abs() - 1.5).abs() < 1e-6), "{file}: {radius:?}");
    }
    let found = facts(dir.path(), "scene.glb");
    assert_eq!(found["triangles"], known["all"], "{found}");
    let names: Vec<_> = found["parts"].as_array().unwrap().iter().map(|p| p["name"].clone()).collect();
    assert_eq!(names, ["one", "two", "three"], "the nodes, which are the objects of the scene");
    let areas: Vec<f64> =
        found["parts"].as_array().unwrap().iter().map(|p| p["areas_m2"][0].as_f64().unwrap()).collect();
    for (area, expected) in areas.iter().zip(known["areas"].as_array().unwrap()) {
        assert!(
            (area / expected.as_f64().unwrap() - 1.0).abs() < 1e-5,
            "{areas:?} is not {}",
            known["areas"]
        );
    }
    assert_eq!(
        found["materials"].as_array().unwrap().len(),
        1,
        "the meshes share the material without a name"
    );
    // trimesh gives the bounds in the frame of the file, y up.
    let corner = |i: usize| -> Vec<f64> {
        known["bounds"][i].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
    };
    let (low, high) = (corner(0), corner(1));
    let expected = [low[0], -high[2], low[1], high[0], -low[2], high[1]];
    let near = extent(&found).iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5);
    assert!(near, "{:?} is not {expected:?}", extent(&found));
}

const PYGLTFLIB: &str = r#"
import numpy as np
import pygltflib as g
corners = np.array([[0, 0, 0], [4, 0, 0], [4, 0, -6], [0, 0, -6]], dtype=np.float32)
faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint8)
blob = corners.tobytes() + faces.tobytes()
file = g.GLTF2(
    scene=0, scenes=[g.Scene(nodes=[0])],
    nodes=[g.Node(children=[1], translation=[0, 2, 0]), g.Node(mesh=0, rotation=[0, 0.7071067811865476, 0, 0.7071067811865476])],
    meshes=[g.Mesh(name="field", primitives=[g.Primitive(attributes=g.Attributes(POSITION=0), indices=1, material=0)])],
    materials=[g.Material(name="grass")],
    accessors=[
        g.Accessor(bufferView=0, componentType=g.FLOAT, count=4, type=g.VEC3, min=[0, 0, -6], max=[4, 0, 0]),
        g.Accessor(bufferView=1, componentType=g.UNSIGNED_BYTE, count=6, type=g.SCALAR)],
    bufferViews=[g.BufferView(buffer=0, byteLength=48), g.BufferView(buffer=0, byteOffset=48, byteLength=6)],
    buffers=[g.Buffer(byteLength=len(blob), uri="field.bin")])
open("field.bin", "wb").write(blob)
file.save_json("field.gltf")
"#;

#[test]
fn files_of_pygltflib_are_scanned_with_a_table_of_materials() {
    let Some(python) = python("pygltflib") else { return };
    let dir = folder();
    judge(&python, dir.path(), PYGLTFLIB);
    fs::write(dir.path().join("materials.csv"), "name,reflectance,class,ground\ngrass,0.3,2,true\n").unwrap();
    // The field of 4 x 6 m lies 2 m above the origin, after the turn by 90° about the vertical from -6 to 0
    // and 0 to 4.
    let found = extent(&facts(dir.path(), "field.gltf"));
    let near = found.iter().zip([-6.0, 0.0, 2.0, 0.0, 4.0, 2.0]).all(|(a, b)| (a - b).abs() < 1e-6);
    assert!(near, "{found:?}");
    let pipeline = r#"
scene = "field.gltf"
[platform]
catalogue = "data/platforms.xml#tripod"
[scanner]
catalogue = "data/scanners_tls.xml#riegl_vz400"
[settings]
pulse_freq_hz = 100000
scan_freq_hz = 100
head_rate_deg_per_s = 60
head_stop_deg = 360
[[leg]]
position_m = [3, 2, 2]
"#;
    fs::write(dir.path().join("p.toml"), pipeline).unwrap();
    succeed(dir.path(), &["run", "p.toml", "-o", "points.csv", "-q"]);
    let points = fs::read_to_string(dir.path().join("points.csv")).unwrap();
    let mut lines = points.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let column = |name: &str| names.iter().position(|n| *n == name).unwrap();
    let (z, class) = (column("Z"), column("Classification"));
    let rows: Vec<Vec<&str>> = lines.map(|l| l.split(',').collect()).collect();
    assert!(rows.len() > 1000, "{}", rows.len());
    assert!(rows.iter().all(|r| r[class] == "2" && (r[z].parse::<f64>().unwrap() - 2.0).abs() < 0.05));
}
