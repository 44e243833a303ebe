//! Files of other programs: variants of the formats, and formats that are not read.

use super::*;

/// The table of materials that the documentation shows.
#[test]
fn the_table_of_the_documentation_is_read() {
    let page = include_str!("../../../../../../docs/scenes.md");
    let start = page.find("  name,reflectance,class,ground,leaf,spectrum\n").unwrap();
    let rows = page[start..].lines().map(str::trim).take_while(|line| !line.starts_with("```"));
    let table: String = rows.map(|row| format!("{row}\n")).collect();
    assert!(table.lines().any(|row| row.ends_with(',')), "an example has an empty last field: {table}");
    let names: Vec<&str> = table.lines().skip(1).map(|row| row.split(',').next().unwrap()).collect();
    let stl = SQUARE_STL.replace("roof", names[0]).replace("wall", names[1]);
    let mut f = fixture("a.stl", stl.as_bytes());
    f.file("materials.csv", &table);
    let scene = load(&mut f, "a.stl", MeshReading::default());
    let found: Vec<_> =
        scene.materials.iter().map(|m| (m.name.as_str(), m.classification, m.is_ground, m.leaf)).collect();
    assert_eq!(found, [("bark", 5, false, Some(false)), ("soil", 2, true, None)]);
}

#[test]
fn fields_of_a_table_may_be_quoted_and_the_last_one_empty() {
    let stl = SQUARE_STL.replace("roof", "roof, old").replace("wall", "the \"wall\"");
    for table in [
        "name,class,spectrum\n\"roof, old\",6,\n\"the \"\"wall\"\"\",7,\n",
        "\u{feff}name;class;spectrum\r\n\"roof, old\";6;\r\n\"the \"\"wall\"\"\";7;\r\n",
        "name\tclass\tspectrum\nroof, old\t6\t\nthe \"wall\"\t7\t\n",
    ] {
        let mut f = fixture("a.stl", stl.as_bytes());
        f.file("materials.csv", table);
        let scene = load(&mut f, "a.stl", MeshReading::default());
        let found: Vec<_> = scene.materials.iter().map(|m| m.classification).collect();
        assert_eq!(found, [6, 7], "{table}");
    }
}

/// The outline of an arrow: (4, 1) is outside, (4, 5) and (1, 2) are inside.
const ARROW: [[f64; 2]; 5] = [[0.0, 0.0], [4.0, 3.0], [8.0, 0.0], [8.0, 8.0], [0.0, 8.0]];

#[test]
fn a_concave_polygon_is_the_same_in_every_format() {
    let rows =
        |before: &str| -> String { ARROW.iter().map(|[x, y]| format!("{before}{x} {y} 0\n")).collect() };
    let ply = format!(
        "ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int vertex_indices\nelement vertex 5\nproperty float x\n\
         property float y\nproperty float z\nend_header\n5 0 1 2 3 4\n{}",
        rows("")
    );
    let absolute = format!("f 1 2 3 4 5\n{}", rows("v "));
    let relative = format!("{}f -5 -4 -3 -2 -1\n", rows("v "));
    let stl = format!(
        "solid a\nfacet normal 0 0 1\nouter loop\n{}endloop\nendfacet\nendsolid a\n",
        rows("vertex ")
    );
    for (name, text) in [("a.ply", ply), ("b.obj", absolute), ("c.obj", relative), ("a.stl", stl)] {
        let scene = load(&mut fixture(name, text.as_bytes()), name, MeshReading::default());
        let triangles: Vec<[f64; 3]> = corners(&scene);
        let covers = |x: f64, y: f64| {
            triangles.chunks(3).any(|t| {
                let side = |a: [f64; 3], b: [f64; 3]| (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]);
                let sides = [side(t[0], t[1]), side(t[1], t[2]), side(t[2], t[0])];
                sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0)
            })
        };
        assert_eq!([covers(4.0, 1.0), covers(4.0, 5.0), covers(1.0, 2.0)], [false, true, true], "{name}");
        assert_eq!(triangles.len(), 9, "{name}");
    }
}

#[test]
fn quadrangles_of_the_reference_are_not_divided_anew() {
    let mut f = Fixture::new();
    f.options.drop_polygons = true;
    f.obj("a.obj", "v 0 0 0\nv 4 3 0\nv 8 0 0\nv 4 8 0\nf 1 2 3 4\n");
    assert_eq!(f.load().unwrap().0.geometry.triangles.to_vec(), [[0, 1, 2], [0, 2, 3]]);
    f.options.drop_polygons = false;
    assert_ne!(f.load().unwrap().0.geometry.triangles.to_vec(), [[0, 1, 2], [0, 2, 3]]);
}

#[test]
fn polygons_that_cross_themselves_are_warned_of() {
    let mut f = Fixture::new();
    f.obj("a.obj", "v 0 0 0\nv 4 4 0\nv 4 0 0\nv 0 3 0\nv -1 1 0\n# the face\nf 1 2 3 4 5\n");
    let warnings = f.load().unwrap().1;
    assert!(warnings.items()[0].message.contains("crosses itself"), "{}", warnings.text());
    assert_eq!(warnings.items()[0].place.as_ref().unwrap().line, 7);
}

#[test]
fn strips_of_ply_are_triangles() {
    let ply = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n\
               element tristrips 1\nproperty list int int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n0 2 0\n\
               9 0 1 2 3 -1 2 3 4 -1\n";
    let scene = load(&mut fixture("a.ply", ply.as_bytes()), "a.ply", MeshReading::default());
    assert_eq!(scene.geometry.triangles.to_vec(), [[0, 1, 2], [1, 3, 2], [2, 3, 4]]);
}

#[test]
fn values_beyond_those_of_a_line_are_reported() {
    let said = |name: &str, text: &str| {
        let mut f = fixture(name, text.as_bytes());
        let files: Vec<PathBuf> = vec![f.path().join(name)];
        f.part(Loader::MeshFiles { files, reading: MeshReading::default() });
        match f.load() {
            Ok((_, warnings)) => warnings.text(),
            Err(vlscan_base::Error::Input(problems)) => problems.text(),
            Err(e) => panic!("{e}"),
        }
    };
    let ply = said("a.ply", &(SQUARE_PLY.to_owned() + "9\n"));
    assert!(ply.contains("values are left over after the last element"), "{ply}");
    let stl = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0 7\nendloop\nendfacet\nendsolid a\n";
    assert!(said("a.stl", stl).contains("three coordinates and no more, found \"vertex 0 1 0 7\""));
    for (vertex, expected) in [
        ("v 0 1 0 2", "the weight 2 of a vertex is ignored"),
        ("v 0 1 0 7 8", "expected a colour of three numbers"),
        ("v 0 1 0 m", "found \"m\"; it is ignored"),
    ] {
        let obj = said("a.obj", &format!("v 0 0 0\nv 1 0 0\n{vertex}\nf 1 2 3\n"));
        assert!(obj.contains(expected) && obj.contains("a.obj:3:9"), "{vertex}: {obj}");
    }
    for vertex in ["v 0 1 0 1.0", "v 0 1 0 0.5 0.5 0.5", "v 0 1 0 # corner", "v 0 1 0 0.5 0.5 0.5 1"] {
        let obj = said("a.obj", &format!("v 0 0 0\nv 1 0 0\n{vertex}\nf 1 2 3\n"));
        assert!(!obj.contains("ignored"), "{vertex}: {obj}");
    }
}

#[test]
fn what_is_left_out_is_warned_of() {
    let warnings = |name: &str, bytes: &[u8]| {
        let mut f = fixture(name, bytes);
        let files: Vec<PathBuf> = vec![f.path().join(name)];
        f.part(Loader::MeshFiles { files, reading: MeshReading::default() });
        f.load().unwrap().1.text()
    };
    let ply = SQUARE_PLY.replace("face 1", "face 2") + "2 0 1\n";
    assert!(warnings("a.ply", ply.as_bytes()).contains("1 faces with fewer than three corners"));
    let mut stl = vec![0; 84 + 50 + 7];
    stl[80] = 1;
    stl[84 + 12 + 12..84 + 12 + 16].copy_from_slice(&1f32.to_le_bytes());
    stl[84 + 12 + 28..84 + 12 + 32].copy_from_slice(&1f32.to_le_bytes());
    assert!(warnings("a.stl", &stl).contains("the 7 bytes after them"));
    let json = triangle_json(r#"[{"mesh":0,"skin":0}]"#, "");
    let json = json.replace("\"indices\":1", "\"indices\":1,\"targets\":[{\"POSITION\":0}]");
    let found = warnings("a.glb", &glb(&json, &triangle_bytes()));
    assert!(found.contains("skins are left out") && found.contains("morph targets are left out"), "{found}");
}

/// The square as PLY of binary numbers.
fn binary_ply(is_big_endian: bool) -> Vec<u8> {
    let order = if is_big_endian { "big" } else { "little" };
    let mut file = format!(
        "ply\nformat binary_{order}_endian 1.0\nelement vertex 4\nproperty double x\nproperty float y\nproperty short z\n\
         element face 1\nproperty uchar red\nproperty list uchar ushort vertex_index\nend_header\n"
    )
    .into_bytes();
    let mut put = |little: &[u8]| match is_big_endian {
        true => file.extend(little.iter().rev()),
        false => file.extend(little),
    };
    for [x, y] in [[0.0, 0.0], [2.0, 0.0], [2.0, 3.0], [0.0, 3.0f64]] {
        put(&x.to_le_bytes());
        put(&(y as f32).to_le_bytes());
        put(&1u16.to_le_bytes());
    }
    put(&[7]);
    put(&[4]);
    (0..4u16).for_each(|corner| put(&corner.to_le_bytes()));
    file
}

#[test]
fn binary_ply_is_read_in_both_byte_orders() {
    for is_big_endian in [false, true] {
        let scene = load(&mut fixture("a.ply", &binary_ply(is_big_endian)), "a.ply", MeshReading::default());
        assert_eq!(corners(&scene), SQUARE, "{is_big_endian}");
    }
}

#[test]
fn buffers_of_gltf_in_folders_written_with_backslashes_are_warned_of() {
    let json = triangle_json(r#"[{"mesh":0}]"#, "\"uri\":\"parts\\\\a%20b.bin\",");
    let mut f = fixture("a.gltf", json.as_bytes());
    f.file("parts/a b.bin", triangle_bytes());
    let files: Vec<PathBuf> = vec![f.path().join("a.gltf")];
    f.part(Loader::MeshFiles { files, reading: MeshReading::default() });
    let (scene, warnings) = f.load().unwrap();
    assert_eq!(scene.geometry.triangles.len(), 1);
    assert!(warnings.items()[0].message.contains("`parts/a b.bin` is read"), "{}", warnings.text());
}

#[test]
fn coordinates_of_text_keep_all_digits_and_have_points() {
    let far = SQUARE_STL.replace(" 2 ", " 476000.125 ").replace(" 3 ", " 5429000.0625 ");
    let scene = load(&mut fixture("a.stl", far.as_bytes()), "a.stl", MeshReading::default());
    assert_eq!(corners(&scene)[2], [476_000.125, 5_429_000.062_5, 1.0]);
    let obj = "v 0,5 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    for (name, text) in [
        ("a.obj", obj.to_owned()),
        ("a.stl", SQUARE_STL.replace(" 2 ", " 2,5 ")),
        ("a.ply", SQUARE_PLY.replace("2 0 1 9", "2,5 0 1 9")),
    ] {
        let report = refused(name, text.as_bytes());
        assert!(report.contains("a decimal comma"), "{name}: {report}");
    }
}

#[test]
fn formats_that_are_not_read_are_named_whatever_the_name_of_the_file() {
    for (bytes, name, help) in [
        (&b"Kaydara FBX Binary  \0"[..], "an FBX mesh", "assimp"),
        (b"<?xml version=\"1.0\"?>\n<COLLADA>", "a COLLADA scene", "assimp"),
        (b"ISO-10303-21;\nFILE_SCHEMA(('IFC2X3'));", "an IFC model", "IfcConvert"),
        (b"LASF\0\0", "a LAS point cloud", "xyzloader"),
        (b"ASTM-E57\0", "an E57 point cloud", "xyzloader"),
        (b"II*\0\x08\0\0\0", "a TIFF raster", "geotiffloader"),
        (b"PK\x03\x04\0", "a ZIP archive", "unzip"),
    ] {
        for file in ["a.obj", "a.ply", "a.stl", "a.glb"] {
            let report = refused(file, bytes);
            assert!(report.contains(&format!("found {name}")) && report.contains(help), "{file}: {report}");
            assert!(!report.contains("damaged") && !report.contains("truncated?"), "{file}: {report}");
        }
    }
    for ending in ["dae", "skp", "3mf", "dwg", "igs"] {
        let report = refused(&format!("a.{ending}"), b"anything\n");
        assert!(report.contains("found ") && report.contains("export"), "{ending}: {report}");
    }
}

#[test]
fn gltf_may_require_what_does_not_concern_geometry() {
    let required = |extension: &str| {
        let json = triangle_json(r#"[{"mesh":0}]"#, "");
        let required = format!("\"extensionsRequired\":[\"{extension}\"],\"asset\"");
        glb(&json.replace("\"asset\"", &required), &triangle_bytes())
    };
    for extension in [
        "EXT_texture_webp",
        "EXT_texture_avif",
        "KHR_texture_basisu",
        "MSFT_texture_dds",
        "KHR_materials_unlit",
        "KHR_lights_punctual",
        "KHR_xmp_json_ld",
        "KHR_mesh_quantization",
    ] {
        let scene = load(&mut fixture("a.glb", &required(extension)), "a.glb", MeshReading::default());
        assert_eq!(scene.geometry.triangles.len(), 1, "{extension}");
    }
    for (extension, help) in [
        ("KHR_draco_mesh_compression", "export it without"),
        ("EXT_meshopt_compression", "gltfpack -noq"),
        ("CESIUM_RTC", "export it without this extension"),
        ("KHR_node_visibility", "export it without this extension"),
    ] {
        let report = refused("a.glb", &required(extension));
        assert!(report.contains(extension) && report.contains(help), "{report}");
    }
    // Beside compressed data a file may have them uncompressed.
    let json = triangle_json(r#"[{"mesh":0}]"#, "");
    let draco = r#""extensions":{"KHR_draco_mesh_compression":{"bufferView":0}},"attributes""#;
    let with_fallback = json.replace("\"attributes\"", draco);
    let file = glb(&with_fallback, &triangle_bytes());
    let scene = load(&mut fixture("a.glb", &file), "a.glb", MeshReading::default());
    assert_eq!(scene.geometry.triangles.len(), 1);
    let without = with_fallback.replace("\"bufferView\":0,\"componentType\"", "\"componentType\"");
    assert!(refused("a.glb", &glb(&without, &triangle_bytes())).contains("compressed by KHR_draco"));
}

#[test]
fn coordinates_of_32_bits_that_are_rounded_to_centimetres_are_warned_of() {
    let warnings = |name: &str, bytes: &[u8]| {
        let mut f = fixture(name, bytes);
        let files: Vec<PathBuf> = vec![f.path().join(name)];
        f.part(Loader::MeshFiles { files, reading: MeshReading::default() });
        let (_, found) = f.load().unwrap_or_else(|e| panic!("{}", report(&e)));
        found.text()
    };
    let stl = |x: f32| {
        let mut bytes = vec![0; 80];
        bytes.extend(1u32.to_le_bytes());
        for number in [0.0, 0.0, 1.0, x, 0.0, 0.0, x + 10.0, 0.0, 0.0, x, 10.0, 0.0] {
            bytes.extend(number.to_le_bytes());
        }
        bytes.extend([0, 0]);
        bytes
    };
    let found = warnings("a.stl", &stl(475_000.0));
    assert!(found.contains("steps of 0.031") && found.contains(" m at 475010: "), "{found}");
    assert!(!warnings("a.stl", &stl(10_000.0)).contains("32 bits"));
    let ply = |kind: &str, corners: Vec<u8>| {
        let property = |name: &str| format!("property {kind} {name}\n");
        let head = format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex 3\n{}element face 1\n\
             property list uchar int vertex_indices\nend_header\n",
            ["x", "y", "z"].map(property).concat()
        );
        let face = [3, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0];
        [head.as_bytes(), &corners, &face].concat()
    };
    let corners = [475_000.0, 0.0, 0.0, 475_010.0, 0.0, 0.0, 475_000.0, 10.0, 0.0];
    let single: Vec<u8> = corners.iter().flat_map(|c| (*c as f32).to_le_bytes()).collect();
    let double: Vec<u8> = corners.iter().flat_map(|c: &f64| c.to_le_bytes()).collect();
    assert!(warnings("a.ply", &ply("float", single)).contains("steps of 0.031"));
    assert!(!warnings("a.ply", &ply("double", double)).contains("32 bits"));
}
