//! Mesh files that are small enough to be checked by hand, and damaged ones.

use super::{GltfError, MeshError, StlError};
use crate::Scene;
use crate::fixture::{Fixture, report};
use base64::Engine;
use std::path::PathBuf;
use vlscan_base::Error;
use vlscan_base::corrections::Corrections;
use vlscan_base::diag::ProblemKind;
use vlscan_geom::DVec3;
use vlscan_survey::{Loader, MaterialChange, MaterialDefinition, MeshReading, Replaced, Transform, UpAxis};

mod colours;
mod variants;

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
    let mut solid = binary.clone();
    solid[..30].copy_from_slice(b"solid made by a program: facet");
    let blanks =
        SQUARE_PLY.replace("element vertex", " element  vertex\t").replace("0 0 1 9", " 0\t0  1 9\n");
    for (name, bytes) in [
        ("a.stl", SQUARE_STL.as_bytes()),
        ("b.stl", &binary),
        ("c.ply", SQUARE_PLY.as_bytes()),
        ("windows.ply", SQUARE_PLY.replace('\n', "\r\n").as_bytes()),
        ("mac.ply", SQUARE_PLY.replace('\n', "\r").as_bytes()),
        ("blanks.ply", blanks.as_bytes()),
        ("capitals.stl", SQUARE_STL.to_uppercase().as_bytes()),
        ("blanks.stl", format!("\n  {}", SQUARE_STL.replace(' ', "\t ")).as_bytes()),
        ("solid.stl", &solid),
        ("solid.obj", &solid),
        // Recognised by their contents.
        ("d.obj", SQUARE_PLY.as_bytes()),
        ("e.mesh", SQUARE_STL.as_bytes()),
    ] {
        let scene = load(&mut fixture(name, bytes), name, MeshReading::default());
        assert_eq!(corners(&scene), SQUARE, "{name}");
    }
    let reading = MeshReading { up: Some(UpAxis::Y), unit_m: Some(0.01), materials: None };
    let scene = load(&mut fixture("a.stl", SQUARE_STL.as_bytes()), "a.stl", reading);
    assert_eq!(corners(&scene)[2], [0.02, -0.01, 0.03]);
}

#[test]
fn tables_give_materials_their_properties_by_name() {
    let mut f = fixture("a.stl", SQUARE_STL.as_bytes());
    f.file("materials.csv", b"\"name\";class;reflectance;ground\n# roofs\nroof;6;0,25;0\nwall;;0.5;true\n");
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
        ("name,reflectence\nroof,0.5\n", "did you mean `reflectance` by `reflectence`?"),
        ("reflectance\n0.5\n", "no column \"name\""),
        ("name,reflectance\nroof,25\n", "expected a reflectance from 0 to 1, found \"25\""),
        ("name,class\nroof,256\n", "expected a class from 0 to 255"),
        ("name,ground\nroof,maybe\n", "expected true or false"),
        ("name,ground\nroof,1\nroof,0\n", "is described twice"),
        ("name,class,ground\nroof,1\n", "2 fields, expected 3 as in the heading"),
        ("name,class,ground\nroof,1,yes,2\n", "4 fields, expected 3 as in the heading"),
        ("name,class,Class\nroof,1,1\n", "materials.csv:1:12"),
        ("name,reflectance\nroof,\"0,25\"\n", "found \"0,25\", which has a decimal comma"),
        ("name,class\nroof,1,true\n", "materials.csv:2"),
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
fn warnings_about_materials_name_the_file_and_the_row_that_define_them() {
    let table: &[u8] = b"name,reflectance,class,spectrum\nroof,0.4,6,grass\nwall,,7,\n";
    let obj = b"usemtl roof\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nusemtl wall\nf 1 3 2\n";
    let glb = |extras: &str| {
        let json = triangle_json(r#"[{"mesh":0}]"#, "").replace(r#""helios_classification":5"#, extras);
        glb(&json, &triangle_bytes())
    };
    let both = "material \"roof\" has a reflectance, which is used, and a spectrum, grass";
    let none = "material \"wall\" has no reflectance";
    for (mesh, bytes, table, expected) in [
        (
            "a.stl",
            SQUARE_STL.as_bytes(),
            table,
            &[(both, "materials.csv", 2), (none, "materials.csv", 3)][..],
        ),
        ("a.obj", obj, table, &[(both, "materials.csv", 2), (none, "materials.csv", 3)]),
        (
            "a.stl",
            SQUARE_STL.as_bytes(),
            b"name\nroof\n",
            &[
                ("\"roof\" has no ref", "materials.csv", 2),
                ("material \"wall\" has no reflectance", "a.stl", 0),
            ],
        ),
        ("a.glb", &glb(r#""helios_classification":300"#), b"name\n", &[("has the class 300", "a.glb", 0)]),
        (
            "a.glb",
            &glb(r#""helios_spectra":"moss""#),
            b"name\n",
            &[("which is used, and a spectrum, moss", "a.glb", 0)],
        ),
    ] {
        let mut f = fixture(mesh, bytes);
        let materials = Some(f.file("materials.csv", table));
        let reading = MeshReading { materials, ..MeshReading::default() };
        f.options.rules = Corrections { reflectance_fraction: true, ..Corrections::NONE };
        f.part(Loader::MeshFiles { files: vec![f.path().join(mesh)], reading });
        let (_, found) = f.load().unwrap_or_else(|e| panic!("{}", report(&e)));
        let reported = found.items();
        assert_eq!(reported.len(), expected.len(), "{mesh}:\n{}", found.text());
        for (message, file, line) in expected {
            let one = reported.iter().find(|one| one.message.contains(message));
            let one = one.unwrap_or_else(|| panic!("{message} is not in\n{}", found.text()));
            let place = one.place.as_ref().unwrap_or_else(|| panic!("{mesh}: {} has no place", one.message));
            assert!(place.path.ends_with(file) && place.line == *line, "{mesh}: {} {place:?}", one.message);
        }
    }
}

#[test]
fn materials_without_a_line_are_reported_with_the_lines_of_their_table() {
    for (table, expected) in [
        ("name,reflectance\nrof,0.4\nwall,0.5\n", "has no line for it, but for: rof, wall"),
        ("name,reflectance\n", "has no line for it, but for: none"),
    ] {
        let mut f = fixture("a.stl", SQUARE_STL.as_bytes());
        f.file("materials.csv", table.as_bytes());
        let files: Vec<PathBuf> = vec![f.path().join("a.stl")];
        f.part(Loader::MeshFiles { files, reading: MeshReading::default() });
        let (_, found) = f.load().unwrap_or_else(|e| panic!("{}", report(&e)));
        assert!(found.text().contains(expected), "{table}: {}", found.text());
    }
}

#[test]
fn nodes_of_gltf_are_parts_of_shared_meshes() {
    // A parent that turns by 90° about y (up), a child shifted by 1 along x, a child stretched unevenly, one
    // that mirrors.
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
    f.options.sharing = crate::Sharing::Always;
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
fn parts_on_the_ground_and_with_numbered_primitives_stay_whole() {
    // Two meshes one above the other: the upper one does not fall.
    let nodes = r#"[{"children":[1,2]},{"mesh":0},{"mesh":0,"translation":[0,5,0]}]"#;
    let file = glb(&triangle_json(nodes, ""), &triangle_bytes());
    let mut f = fixture("a.glb", &file);
    f.file("ground.obj", "mtllib g.mtl\nusemtl g\nv -9 -9 0\nv 9 -9 0\nv 0 9 0\nf 1 2 3\n");
    f.file("g.mtl", "newmtl g\nhelios_isGround true\n");
    for name in ["ground.obj", "a.glb"] {
        let files = vec![f.path().join(name)];
        f.part(Loader::MeshFiles { files, reading: MeshReading::default() });
    }
    f.parts[1].transform.on_ground = 1;
    f.parts[1].transform.offset.z = 3.0;
    let (scene, _) = f.load().unwrap();
    assert_eq!(scene.parts.len(), 2);
    let heights: Vec<f64> = corners(&scene).iter().skip(3).map(|corner| corner[2]).collect();
    assert_eq!(heights, [0.0, 0.0, 1.0, 5.0, 5.0, 6.0]);

    f.parts.remove(0);
    f.parts[0].transform = Transform::IDENTITY;
    let mut class_of = |replaced| {
        let material = MaterialDefinition { classification: 9, ..MaterialDefinition::new("new") };
        f.parts[0].changes = vec![MaterialChange { replaced, material }].into();
        let (scene, warnings) = f.load().unwrap();
        let classes: Vec<i32> = (0..2).map(|i| scene.material_of(i).classification).collect();
        (scene.parts.len(), classes, warnings.text())
    };
    let (parts, classes, _) = class_of(Replaced::Faces(vec![1]));
    assert_eq!((parts, classes), (1, vec![5, 9]));
    let (parts, classes, warnings) = class_of(Replaced::Named("green".to_owned()));
    assert_eq!((parts, classes), (2, vec![9, 9]));
    assert!(!warnings.contains("replaced"), "{warnings}");
}

#[test]
fn meshes_of_a_document_share_its_table_and_one_warning() {
    let count = 300;
    let nodes: Vec<String> =
        (0..count).map(|i| format!(r#"{{"mesh":{i},"translation":[{i},0,0]}}"#)).collect();
    let meshes: Vec<String> = (0..count)
        .map(|i| {
            format!(r#"{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1,"material":{i}}}]}}"#)
        })
        .collect();
    let materials: Vec<String> = (0..count).map(|i| format!(r#"{{"name":"m{i}\n"}}"#)).collect();
    let json = triangle_json(&format!("[{}]", nodes.join(",")), "");
    let (head, tail) = json.split_once("\"meshes\"").unwrap();
    let json = format!(
        "{}\"meshes\":[{}],\"materials\":[{}],\"accessors\"{}",
        head.replace("\"nodes\":[0]}", &format!("\"nodes\":{:?}}}", (0..count).collect::<Vec<_>>())),
        meshes.join(","),
        materials.join(","),
        tail.split_once("\"accessors\"").unwrap().1
    );
    let file = glb(&json, &triangle_bytes());
    let mut f = fixture("a.glb", &file);
    let files = vec![f.path().join("a.glb")];
    f.part(Loader::MeshFiles { files, reading: MeshReading::default() });
    let (scene, warnings) = f.load().unwrap();
    assert_eq!((scene.parts.len(), scene.materials.len()), (count, count));
    assert_eq!(scene.materials[7].name, "m7_");
    assert_eq!(warnings.items().len(), 1, "{}", warnings.text());
    assert!(warnings.items()[0].message.contains("and 292 more"));
    f.file("materials.csv", "name,reflectance\nm0_,5\n");
    let found = f.error();
    assert_eq!(found.matches("a reflectance from 0 to 1").count(), 1, "{found}");
}

#[test]
fn few_bytes_do_not_become_many_meshes() {
    let json = triangle_json(r#"[{"mesh":0}]"#, "");
    let zeros = r#""accessors":[{"componentType":5126,"count":16777216,"type":"VEC3"},"#;
    let bomb = json.replace("\"accessors\":[", zeros);
    let instances = bomb.replace(
        r#"{"mesh":0}"#,
        r#"{"mesh":0,"extensions":{"EXT_mesh_gpu_instancing":{"attributes":{"TRANSLATION":0}}}}"#,
    );
    let found = refused("a.glb", &glb(&instances, &triangle_bytes()));
    assert!(found.contains("of instances has no data"), "{found}");

    let limited = |json: &str, limit: Option<u64>| {
        let mut f = fixture("a.glb", &glb(json, &triangle_bytes()));
        f.options.max_memory = limit;
        let files = vec![f.path().join("a.glb")];
        f.part(Loader::MeshFiles { files, reading: MeshReading::default() });
        f.load().map(|(scene, _)| scene.geometry.triangles.len()).map_err(|e| report(&e))
    };
    let primitive = |accessor: u32, count: usize| {
        let list = vec![format!(r#"{{"attributes":{{"POSITION":{accessor}}}}}"#); count].join(",");
        format!(r#""primitives":[{list}],"unused":["#)
    };
    let primitives = bomb.replace("\"primitives\":[", &primitive(0, 8));
    let found = limited(&primitives, Some(20 << 20)).unwrap_err();
    assert!(found.contains("need at least 492.13 MB, the memory limit leaves 20.97 MB"), "{found}");
    // Primitives of one accessor share its vertices: 3 · 24 bytes, and 16 for each triangle.
    let shared = json.replace("\"primitives\":[", &primitive(0, 100));
    assert_eq!(limited(&shared, Some(3 * 24 + 100 * 16)), Ok(100));
    assert!(limited(&shared, Some(3 * 24 + 99 * 16)).unwrap_err().contains("the memory limit leaves"));

    let many = vec![r#"{"mesh":0}"#; 1000].join(",");
    let roots = format!("\"nodes\":{:?}}}", (0..1000).collect::<Vec<_>>());
    let placed = triangle_json(&format!("[{many}]"), "").replace("\"nodes\":[0]}", &roots);
    assert!(limited(&placed, Some(100_000)).unwrap_err().contains("the memory limit leaves"));
    assert_eq!(limited(&placed, None), Ok(1000));
}

#[test]
fn buffers_are_regular_files_beside_the_document() {
    let f = fixture("buffer.bin", &triangle_bytes());
    let outside = f.path().join("buffer.bin");
    for (uri, message) in [
        (outside.to_str().unwrap(), "only files in its folder are read"),
        ("../buffer.bin", "only files in its folder are read"),
        ("sub/%2e%2e/../buffer.bin", "only files in its folder are read"),
        ("sub", "is not a regular file"),
        ("https://example.org/buffer.bin", "is not on this machine"),
    ] {
        let json = triangle_json(r#"[{"mesh":0}]"#, &format!("\"uri\":\"{uri}\","));
        let mut g = fixture("a.gltf", json.as_bytes());
        std::fs::create_dir(g.path().join("sub")).unwrap();
        let files: Vec<PathBuf> = vec![g.path().join("a.gltf")];
        g.part(Loader::MeshFiles { files, reading: MeshReading::default() });
        assert!(g.error().contains(message), "{uri}: {}", g.error());
    }
    let json = triangle_json(r#"[{"mesh":0}]"#, "\"uri\":\"./sub/b%201.bin\",");
    let mut g = fixture("a.gltf", json.as_bytes());
    std::fs::create_dir(g.path().join("sub")).unwrap();
    g.file("sub/b 1.bin", triangle_bytes());
    assert_eq!(corners(&load(&mut g, "a.gltf", MeshReading::default())).len(), 3);
}

#[test]
fn many_solids_are_read_in_linear_time() {
    let solid = |i: u32| {
        format!(
            "solid s{i}\nfacet\nouter loop\nvertex 0 0 {i}\nvertex 1 0 {i}\nvertex 0 1 {i}\nendloop\nendsolid\n"
        )
    };
    let text: String = (0..100_000).chain([7]).map(solid).collect();
    let started = std::time::Instant::now();
    let scene = load(&mut fixture("a.stl", text.as_bytes()), "a.stl", MeshReading::default());
    assert_eq!((scene.geometry.triangles.len(), scene.materials.len()), (100_001, 100_000));
    // A search through all names would take 5·10⁹ comparisons.
    assert!(started.elapsed().as_secs() < 20, "{:?}", started.elapsed());
}

#[test]
fn programs_can_match_the_cause_of_a_refused_file() {
    let problems = |name: &str, bytes: &[u8]| {
        let mut f = fixture(name, bytes);
        let files: Vec<PathBuf> = vec![f.path().join(name)];
        f.part(Loader::MeshFiles { files, reading: MeshReading::default() });
        match f.load() {
            Err(Error::Input(found)) => found,
            _ => panic!("{name} must not load"),
        }
    };
    let found = problems("a.stl", SQUARE_STL.replace("endsolid wall", "").as_bytes());
    assert!(matches!(found.cause::<MeshError>(), Some(MeshError::Stl(StlError::NoEnd))), "{found:?}");
    assert!(found.has(ProblemKind::Truncated));
    let document = glb(&triangle_json(r#"[{"mesh":7}]"#, ""), &triangle_bytes());
    let found = problems("a.glb", &document);
    let cause = found.cause::<MeshError>();
    let missing = Some(GltfError::Missing { what: "mesh", number: 7 }.to_string());
    assert!(matches!(cause, Some(MeshError::Gltf(_))) && cause.map(MeshError::to_string) == missing);
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
        ("\"count\":3", "\"count\":4000000000000", "is the file truncated?"),
        ("\"count\":3", "\"count\":18446744073709551615", "is the file truncated?"),
        ("\"byteOffset\":36", "\"byteOffset\":18446744073709551615", "is the file truncated?"),
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
    assert!(
        refused("a.ply", SQUARE_PLY.replace("face 1", "face 99999999999").as_bytes()).contains("truncated?")
    );
    assert!(refused("a.ply", SQUARE_PLY.replace("2 0 1 9", "nan 0 1 9").as_bytes()).contains("a.ply"));
    let points = SQUARE_PLY.split("element face").next().unwrap().to_owned()
        + "end_header\n0 0 1 9\n2 0 1 9\n2 3 1 9\n0 3 1 9\n";
    assert!(refused("a.ply", points.as_bytes()).contains("xyzloader"));
    let floats = SQUARE_PLY.replace("list uchar int", "list uchar float");
    assert!(refused("a.ply", floats.as_bytes()).contains("found a list of floats"));
    let word = refused("a.ply", SQUARE_PLY.replace("4 0 1 2 3", "4 0 1").as_bytes());
    assert!(word.contains("after 0 of 1 elements") && !word.contains(". after"), "{word}");
    let far = refused(
        "a.ply",
        SQUARE_PLY.replace("float x", "double x").replace("2 0 1 9", "1e300 0 1 9").as_bytes(),
    );
    assert!(far.contains("is at 1e300, 0, 1"), "{far}");
    let escape = SQUARE_STL.replace("solid roof", "solid \u{1b}[31mroof");
    let scene = load(&mut fixture("e.stl", escape.as_bytes()), "e.stl", MeshReading::default());
    assert_eq!(scene.materials[0].name, "_[31mroof");
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

#[test]
fn parts_of_gltf_have_the_names_of_their_nodes() {
    let nodes = r#"[{"name":"oak","children":[1,2,3]},{"mesh":0},{"name":"twig","mesh":0},
        {"name":"grass","mesh":0,"extensions":{"EXT_mesh_gpu_instancing":{"attributes":{"TRANSLATION":0}}}}]"#;
    let named = |nodes: &str| -> Vec<String> {
        let mut f = fixture("a.glb", &glb(&triangle_json(nodes, ""), &triangle_bytes()));
        load(&mut f, "a.glb", MeshReading::default()).parts.into_iter().map(|part| part.name).collect()
    };
    assert_eq!(named(nodes), ["oak", "twig", "grass_0", "grass_1", "grass_2"]);
    assert_eq!(named(r#"[{"mesh":0}]"#), ["leaf"], "the mesh, where no node has a name");
}
