//! Mesh files that are small enough to be checked by hand, and damaged ones.

use crate::geom::DVec3;
use crate::scene::Scene;
use crate::scene::fixture::{Fixture, report};
use crate::survey::{Loader, MeshReading, UpAxis};
use base64::Engine;
use std::path::PathBuf;

const SQUARE_STL: &str = "solid roof
facet normal 0 0 1
 outer loop
  vertex 0 0 1
  vertex 2 0 1
  vertex 2 3 1
 endloop
endfacet
endsolid roof
solid wall
facet normal 0 0 1
 outer loop
  vertex 0 0 1
  vertex 2 3 1
  vertex 0 3 1
 endloop
endfacet
endsolid wall
";

const SQUARE_PLY: &str = "ply
format ascii 1.0
comment a quad with a property that is not read
element vertex 4
property float x
property float y
property float z
property uchar red
element face 1
property list uchar int vertex_indices
end_header
0 0 1 9
2 0 1 9
2 3 1 9
0 3 1 9
4 0 1 2 3
";

/// A GLB file of this JSON and these bytes.
fn glb(json: &str, chunk: &[u8]) -> Vec<u8> {
    let mut json = json.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut file = b"glTF\x02\0\0\0".to_vec();
    file.extend((28 + json.len() as u32 + chunk.len() as u32).to_le_bytes());
    file.extend((json.len() as u32).to_le_bytes());
    file.extend(b"JSON");
    file.extend(json);
    file.extend((chunk.len() as u32).to_le_bytes());
    file.extend(b"BIN\0");
    file.extend(chunk);
    file
}

/// The triangle (0 0 0), (1 0 0), (0 1 0) as floats, then its indices.
fn triangle_bytes() -> Vec<u8> {
    let floats = [0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let indices = [0u16, 1, 2, 0];
    floats.iter().flat_map(|v| v.to_le_bytes()).chain(indices.iter().flat_map(|v| v.to_le_bytes())).collect()
}

fn triangle_json(nodes: &str, buffer: &str) -> String {
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":{nodes},
        "meshes":[{{"name":"leaf","primitives":[{{"attributes":{{"POSITION":0}},"indices":1,"material":0}}]}}],
        "materials":[{{"name":"green","extras":{{"helios_reflectance":0.4,"helios_classification":5}}}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}},
                     {{"bufferView":1,"componentType":5123,"count":3,"type":"SCALAR"}}],
        "bufferViews":[{{"buffer":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":6}}],
        "buffers":[{{{buffer}"byteLength":42}}]}}"#
    )
}

fn fixture(name: &str, bytes: &[u8]) -> Fixture {
    let f = Fixture::new();
    f.file(name, bytes);
    f
}

fn load(f: &mut Fixture, name: &str, reading: MeshReading) -> Scene {
    let files: Vec<PathBuf> = vec![f.path().join(name)];
    f.part(Loader::MeshFiles { files, reading });
    let (scene, _) = f.load().unwrap_or_else(|e| panic!("{}", report(&e)));
    scene
}

fn refused(name: &str, bytes: &[u8]) -> String {
    let mut f = fixture(name, bytes);
    let files: Vec<PathBuf> = vec![f.path().join(name)];
    f.part(Loader::MeshFiles { files, reading: MeshReading::default() });
    f.error()
}

/// The corners of the triangles in the world.
fn corners(scene: &Scene) -> Vec<[f64; 3]> {
    let g = &scene.geometry;
    let corner = |v: DVec3| (v + scene.shift).to_array().map(|x| (x * 1e9).round() / 1e9);
    (0..g.triangles.len()).flat_map(|i| g.triangle(i)).map(corner).collect()
}

const SQUARE: [[f64; 3]; 6] =
    [[0.0, 0.0, 1.0], [2.0, 0.0, 1.0], [2.0, 3.0, 1.0], [0.0, 0.0, 1.0], [2.0, 3.0, 1.0], [0.0, 3.0, 1.0]];

#[test]
fn a_square_is_the_same_in_every_format() {
    let mut binary = [b's'; 80].to_vec();
    binary.extend(2u32.to_le_bytes());
    for triangle in SQUARE.chunks(3) {
        let floats = [[0.0; 3], triangle[0], triangle[1], triangle[2]];
        binary.extend(floats.iter().flatten().flat_map(|&v| (v as f32).to_le_bytes()));
        binary.extend([0; 2]);
    }
    for (name, bytes) in [
        ("a.stl", SQUARE_STL.as_bytes()),
        ("b.stl", &binary),
        ("c.ply", SQUARE_PLY.as_bytes()),
        // Recognised by their contents.
        ("d.obj", SQUARE_PLY.as_bytes()),
        ("e.mesh", SQUARE_STL.as_bytes()),
    ] {
        let scene = load(&mut fixture(name, bytes), name, MeshReading::default());
        assert_eq!(corners(&scene), SQUARE, "{name}");
    }
    let reading = MeshReading { up: Some(UpAxis::Y), unit_m: 0.01, materials: None };
    let scene = load(&mut fixture("a.stl", SQUARE_STL.as_bytes()), "a.stl", reading);
    assert_eq!(corners(&scene)[2], [0.02, -0.01, 0.03]);
}

#[test]
fn tables_give_materials_their_properties_by_name() {
    let mut f = fixture("a.stl", SQUARE_STL.as_bytes());
    f.file("materials.csv", b"name;class;reflectance;ground\n# roofs\nroof;6;0.25;0\nwall;;0.5;true\n");
    let scene = load(&mut f, "a.stl", MeshReading::default());
    let found: Vec<_> = scene
        .materials
        .iter()
        .map(|m| (m.name.as_str(), m.reflectance, m.classification, m.is_ground))
        .collect();
    assert_eq!(found, [("roof", 0.25, 6, false), ("wall", 0.5, 0, true)]);

    // OBJ has a table only if the loader names it.
    let mut f = fixture("a.obj", b"usemtl roof\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    f.file("roofs.csv", b"reflectance,name\n0.25,roof\n");
    let reading = MeshReading { materials: Some(f.path().join("roofs.csv")), ..MeshReading::default() };
    assert_eq!(load(&mut f, "a.obj", reading).materials[0].reflectance, 0.25);

    for (table, message) in [
        ("name,colour\nroof,red\n", "the column \"colour\""),
        ("reflectance\n0.5\n", "no column \"name\""),
        ("name,reflectance\nroof,25\n", "expected a reflectance from 0 to 1, found \"25\""),
        ("name,class\nroof,256\n", "expected a class from 0 to 255"),
        ("name,ground\nroof,maybe\n", "expected true or false"),
        ("name,ground\nroof,1\nroof,0\n", "is described twice"),
        ("", "is empty"),
    ] {
        let mut f = fixture("a.stl", SQUARE_STL.as_bytes());
        f.file("materials.csv", table.as_bytes());
        let files: Vec<PathBuf> = vec![f.path().join("a.stl")];
        f.part(Loader::MeshFiles { files, reading: MeshReading::default() });
        assert!(f.error().contains(message), "{table}: {}", f.error());
    }
}

#[test]
fn nodes_of_gltf_are_parts_of_shared_meshes() {
    // A parent that turns by 90° about y (up), a child shifted by 1 along x, a child stretched unevenly, one that mirrors.
    let h = 0.5f64.sqrt();
    let nodes = format!(
        r#"[{{"children":[1,2,3],"rotation":[0,{h},0,{h}],"translation":[10,20,30]}},
            {{"mesh":0,"translation":[1,0,0]}},{{"mesh":0,"scale":[2,3,4]}},{{"mesh":0,"scale":[-2,-2,-2]}}]"#
    );
    let mut f = fixture("a.glb", &glb(&triangle_json(&nodes, ""), &triangle_bytes()));
    let scene = load(&mut f, "a.glb", MeshReading::default());
    // By hand: y up to z up is (x, -z, y); the rotation takes x to -z, which is +y in the world.
    let (x, y, z) = (10.0, -30.0, 20.0);
    let expected = [
        [[x, y + 1.0, z], [x, y + 2.0, z], [x, y + 1.0, z + 1.0]],
        [[x, y, z], [x, y + 2.0, z], [x, y, z + 3.0]],
        [[x, y, z], [x, y - 2.0, z], [x, y, z - 2.0]],
    ];
    assert_eq!(corners(&scene), expected.concat());
    let parts: Vec<_> = scene.parts.iter().map(|p| (p.id.as_str(), p.name.as_str())).collect();
    assert_eq!(parts, [("0", "leaf"), ("1", "leaf"), ("2", "leaf")]);
    assert_eq!((scene.materials[0].name.as_str(), scene.materials[0].reflectance), ("green", 0.4));
    assert_eq!(scene.materials[0].classification, 5);

    // As instances: two share the mesh, the stretched one has its own.
    let mut f = fixture("a.glb", &glb(&triangle_json(&nodes, ""), &triangle_bytes()));
    f.options.sharing = crate::scene::Sharing::Always;
    let shared = load(&mut f, "a.glb", MeshReading::default());
    let instances = &shared.instances.as_ref().unwrap().instances;
    assert_eq!((shared.geometry.triangles.len(), instances.models.len()), (0, 2));

    // With an id the file is one part.
    let mut f = fixture("a.glb", &glb(&triangle_json(&nodes, ""), &triangle_bytes()));
    let files: Vec<PathBuf> = vec![f.path().join("a.glb")];
    f.part(Loader::MeshFiles { files, reading: MeshReading::default() }).id = Some("tree".to_owned());
    let whole = f.load().unwrap().0;
    assert_eq!((whole.parts.len(), corners(&whole)), (1, expected.concat()));
}

#[test]
fn buffers_of_gltf_are_in_the_file_or_beside_it() {
    let nodes = r#"[{"mesh":0}]"#;
    let data = base64::engine::general_purpose::STANDARD.encode(triangle_bytes());
    let inline = format!("\"uri\":\"data:application/octet-stream;base64,{data}\",");
    let mut f = fixture("a.gltf", triangle_json(nodes, &inline).as_bytes());
    let expected = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
    assert_eq!(corners(&load(&mut f, "a.gltf", MeshReading::default())), expected);
    let mut f = fixture("a.gltf", triangle_json(nodes, "\"uri\":\"my%20mesh.bin\",").as_bytes());
    f.file("my mesh.bin", triangle_bytes());
    let scene = load(&mut f, "a.gltf", MeshReading::default());
    assert_eq!(corners(&scene), expected);
    assert!(scene.sources.iter().any(|s| s.ends_with("my mesh.bin")));
    let remote = refused("a.gltf", triangle_json(nodes, "\"uri\":\"https://example.org/a.bin\",").as_bytes());
    assert!(remote.contains("is not on this machine"), "{remote}");
}

#[test]
fn quantised_and_sparse_positions_are_read() {
    let json = r#"{"asset":{"version":"2.0"},"extensionsRequired":["KHR_mesh_quantization"],"nodes":[{"mesh":0}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0},"mode":5}]}],
        "accessors":[{"bufferView":0,"componentType":5122,"normalized":true,"count":4,"type":"VEC3",
          "sparse":{"count":1,"indices":{"bufferView":1,"componentType":5121},"values":{"bufferView":2}}}],
        "bufferViews":[{"buffer":0,"byteLength":32,"byteStride":8},{"buffer":0,"byteOffset":32,"byteLength":4},
                       {"buffer":0,"byteOffset":36,"byteLength":8}],
        "buffers":[{"byteLength":44}]}"#;
    let strip: [[i16; 4]; 4] = [[0, 0, 0, 7], [32767, 0, 0, 7], [0, 32767, 0, 7], [0, 0, 0, 7]];
    let mut bytes: Vec<u8> = strip.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
    bytes.extend([3, 0, 0, 0]);
    bytes.extend([32767i16, 32767, 0, 0].iter().flat_map(|v| v.to_le_bytes()));
    let scene = load(&mut fixture("q.glb", &glb(json, &bytes)), "q.glb", MeshReading::default());
    let (a, b, c, d) = ([0.0; 3], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 1.0]);
    assert_eq!(corners(&scene), [a, b, c, b, d, c]);
}

#[test]
fn damaged_files_are_refused_with_their_name() {
    let whole = glb(&triangle_json(r#"[{"mesh":0}]"#, ""), &triangle_bytes());
    for cut in [4, 10, 16, 40, whole.len() - 30, whole.len() - 1] {
        assert!(refused("a.glb", &whole[..cut]).contains("a.glb"), "{cut}");
    }
    let json = |from: &str, to: &str| {
        let json = triangle_json(r#"[{"mesh":0}]"#, "");
        assert!(json.contains(from), "{from}");
        refused("a.glb", &glb(&json.replace(from, to), &triangle_bytes()))
    };
    for (from, to, message) in [
        ("\"2.0\"", "\"1.0\"", "found version 1.0"),
        ("\"count\":3", "\"count\":4000000000000", "is the file whole?"),
        ("\"count\":3", "\"count\":18446744073709551615", "is the file whole?"),
        ("\"byteOffset\":36", "\"byteOffset\":18446744073709551615", "is the file whole?"),
        ("\"bufferView\":0,", "", "VEC3"),
        ("\"mesh\":0", "\"mesh\":7", "no mesh 7"),
        ("{\"mesh\":0}", "{\"mesh\":0,\"children\":[0]}", "two parents"),
        ("{\"mesh\":0}", "{\"mesh\":0,\"scale\":[1e308,1e308,1e308],\"children\":[]}", "a.glb"),
        ("\"material\":0", "\"material\":9", "no material 9"),
        ("\"asset\"", "\"extensionsRequired\":[\"KHR_draco_mesh_compression\"],\"asset\"", "KHR_draco"),
        ("\"byteLength\":42", "\"byteLength\":420", "has 44 of 420 bytes"),
    ] {
        if message == "VEC3" {
            // Without data all corners are at the origin: no area, no part.
            assert!(!json(from, to).is_empty());
            continue;
        }
        let found = json(from, to);
        assert!(found.contains(message), "{to}: {found}");
    }
    for cut in [20, 150, SQUARE_PLY.len() - 12] {
        assert!(refused("a.ply", &SQUARE_PLY.as_bytes()[..cut]).contains("a.ply"), "{cut}");
    }
    assert!(
        refused("a.ply", SQUARE_PLY.replace("4 0 1 2 3", "4 0 1 2 9").as_bytes()).contains("there are 4")
    );
    assert!(refused("a.ply", SQUARE_PLY.replace("4 0 1 2 3", "4 0 1 2 -3").as_bytes()).contains("corner -3"));
    assert!(refused("a.ply", SQUARE_PLY.replace("face 1", "face 99999999999").as_bytes()).contains("whole?"));
    assert!(refused("a.ply", SQUARE_PLY.replace("2 0 1 9", "nan 0 1 9").as_bytes()).contains("a.ply"));
    let points = SQUARE_PLY.split("element face").next().unwrap().to_owned()
        + "end_header\n0 0 1 9\n2 0 1 9\n2 3 1 9\n0 3 1 9\n";
    assert!(refused("a.ply", points.as_bytes()).contains("xyzloader"));
    // A list that states four thousand million corners.
    let head = "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
                element face 1\nproperty list uint int vertex_indices\nend_header\n";
    let mut huge = head.as_bytes().to_vec();
    huge.extend([0; 12]);
    huge.extend([255; 8]);
    assert!(refused("a.ply", &huge).contains("a.ply"));
    for cut in [60, 200, SQUARE_STL.len() - 15] {
        assert!(refused("a.stl", &SQUARE_STL.as_bytes()[..cut]).contains("a.stl"), "{cut}");
    }
    assert!(refused("a.stl", SQUARE_STL.replace("vertex 2 0 1", "vertex 2 0").as_bytes()).contains("line 5"));
    let mut binary = vec![0; 84 + 50];
    binary[80] = 200;
    assert!(refused("a.stl", &binary).contains("states 200 triangles"));
    assert!(refused("a.stl", &[0; 10]).contains("fewer bytes"));
}
