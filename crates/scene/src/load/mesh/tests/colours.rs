//! Colours of meshes: materials, textures, corners.

use super::glb;
use crate::Scene;
use crate::builder::Sharing;
use crate::fingerprint::fingerprint;
use crate::fixture::Fixture;
use crate::texture::tests::png_of;
use crate::tiles::TileOptions;
use vlscan_geom::DVec3;
use vlscan_survey::{Loader, MeshReading};
use vlscan_trace::BuildOptions;

/// Four texels: red and green above, blue and grey below.
const TEXELS: [u8; 12] = [200, 0, 0, 0, 100, 0, 0, 0, 50, 128, 128, 128];

fn fixture() -> Fixture {
    let mut f = Fixture::new();
    f.options.colours = true;
    f.file("t.png", png_of(2, 2, &TEXELS));
    f
}

/// The colour at a point of the plane z = 0, world frame, by the triangle that contains it.
fn colour(scene: &Scene, x: f64, y: f64) -> [u8; 3] {
    let at = scene.to_local(DVec3::new(x, y, 0.0));
    let contains = |[a, b, c]: [DVec3; 3]| {
        let side = |p: DVec3, q: DVec3| (q - p).cross(at - p).z;
        let sides = [side(a, b), side(b, c), side(c, a)];
        sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0)
    };
    let found = (0..scene.numbers() as u32).find(|i| scene.triangle(*i).is_some_and(contains)).unwrap();
    scene.colour_at(found, scene.triangle(found), at)
}

const SQUARE: &str = "mtllib m.mtl\nv 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
                      usemtl a\nf 1/1 2/2 3/3 4/4\n";

#[test]
fn texels_of_obj_files_are_those_of_the_lower_left_corner_times_kd() {
    let mut f = fixture();
    f.file("m.mtl", "newmtl a\nKd 1 1 0.5\nmap_Kd t.png\nhelios_reflectance 0.3\n");
    f.obj("a.obj", SQUARE);
    let scene = f.scene();
    assert_eq!(colour(&scene, 1.0, 3.0), [200, 0, 0]);
    assert_eq!(colour(&scene, 3.0, 3.9), [0, 100, 0]);
    assert_eq!(colour(&scene, 1.9, 0.1), [0, 0, 25]);
    assert_eq!(colour(&scene, 3.5, 1.9), [128, 128, 64]);
    f.options.colours = false;
    let scene = f.scene();
    assert!(scene.colours.is_none());
    assert_eq!(colour(&scene, 1.0, 3.0), [0; 3]);
}

#[test]
fn colours_are_the_same_in_instances_and_in_tiles() {
    let mut f = fixture();
    f.file("m.mtl", "newmtl a\nKd 1 1 0.5\nmap_Kd t.png\nhelios_reflectance 0.3\n");
    f.obj("a.obj", SQUARE);
    f.obj("b.obj", SQUARE).transform.offset = DVec3::new(10.0, 0.0, 0.0);
    let stored = f.scene();
    f.options.sharing = Sharing::Always;
    let shared = f.scene();
    assert!(shared.instances.is_some());
    for (x, y) in [(1.0, 3.0), (3.5, 1.9), (11.0, 3.0), (13.5, 1.9)] {
        assert_eq!(colour(&stored, x, y), colour(&shared, x, y), "{x} {y}");
    }
    f.options.sharing = Sharing::Never;
    f.options.tiles = Some(TileOptions { memory: 1 << 20, trees: BuildOptions::default() });
    let bytes = |f: &Fixture| {
        let (scene, _) = f.load().unwrap();
        scene.tiles.as_ref().unwrap().facts().iter().map(|tile| tile.bytes).collect::<Vec<_>>()
    };
    let with = bytes(&f);
    f.options.colours = false;
    let without = bytes(&f);
    // Two triangles with texture coordinates, and four texels.
    assert!(with.len() == 2 && with.iter().zip(&without).all(|(a, b)| *a >= b + 2 * 24 + 12), "{with:?}");
}

#[test]
fn a_polygon_and_a_changed_material_keep_the_texture() {
    use vlscan_survey::{MaterialChange, MaterialDefinition, Replaced};
    let mut f = fixture();
    f.file("m.mtl", "newmtl a\nmap_Kd t.png\nhelios_reflectance 0.3\n");
    // The second corner lies within the hull of the others, so the polygon is not divided as a fan.
    let text = "mtllib m.mtl\nv 0 0 0\nv 4 0 0\nv 1 1 0\nv 0 4 0\nv -4 -4 0\nvt 0 0\nvt 1 0\nvt .25 .25\nvt 0 1\n\
                vt -1 -1\nusemtl a\nf 2/2 3/3 4/4 5/5\n";
    let material = MaterialDefinition { reflectance: Some(0.2), ..MaterialDefinition::new("b") };
    f.obj("a.obj", text).changes = vec![MaterialChange { replaced: Replaced::All, material }].into();
    let scene = f.scene();
    // Texture coordinates are a quarter of the place everywhere.
    assert_eq!(colour(&scene, 1.0, 0.5), [0, 0, 50]);
    assert_eq!(colour(&scene, -1.0, -1.0), [0, 100, 0]);
}

/// A GLB file of a triangle with texture coordinates from 0 to 1, an image, and these properties of the
/// colour of its material.
fn textured_glb(image: &[u8], properties: &str) -> Vec<u8> {
    let mut chunk = Vec::new();
    let corners = [[0.0f32, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 0.0, -4.0]];
    corners.iter().flatten().for_each(|c| chunk.extend(c.to_le_bytes()));
    [[0.0f32, 0.0], [1.0, 0.0], [0.0, 1.0]].iter().flatten().for_each(|c| chunk.extend(c.to_le_bytes()));
    let at = chunk.len();
    chunk.extend(image);
    chunk.resize(chunk.len().next_multiple_of(4), 0);
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":1}},"material":0}}]}}],
        "materials":[{{"name":"m","extras":{{"helios_reflectance":0.3}},"pbrMetallicRoughness":
        {{{properties}}}}}],
        "textures":[{{"source":0}}],"images":[{{"bufferView":2,"mimeType":"image/png"}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}},
        {{"bufferView":1,"componentType":5126,"count":3,"type":"VEC2"}}],
        "bufferViews":[{{"buffer":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":24}},
        {{"buffer":0,"byteOffset":{at},"byteLength":{}}}],"buffers":[{{"byteLength":{}}}]}}"#,
        image.len(),
        chunk.len()
    );
    glb(&json, &chunk)
}

#[test]
fn glb_files_multiply_linear_light() {
    let mut f = fixture();
    let image = png_of(1, 1, &[200, 128, 255]);
    let properties = r#""baseColorFactor":[0.5,1,0.25,1],"baseColorTexture":{"index":0}"#;
    let files = vec![f.file("a.glb", textured_glb(&image, properties))];
    f.part(Loader::MeshFiles { files, reading: MeshReading::default() });
    assert_eq!(colour(&f.scene(), 1.0, 1.0), [146, 128, 137]);
}

#[test]
fn transforms_of_textures_choose_and_turn_a_part_of_the_image() {
    let of = |transform: &str, x: f64, y: f64| {
        let mut f = fixture();
        let moved = format!(r#""extensions":{{"KHR_texture_transform":{transform}}}"#);
        let properties = format!(r#""baseColorTexture":{{"index":0,{moved}}}"#);
        let files = vec![f.file("a.glb", textured_glb(&png_of(2, 2, &TEXELS), &properties))];
        f.part(Loader::MeshFiles { files, reading: MeshReading::default() });
        colour(&f.scene(), x, y)
    };
    let [red, green, blue, grey] = [[200, 0, 0], [0, 100, 0], [0, 0, 50], [128; 3]];
    // Positions are 4 times the texture coordinates.
    let corners = [(0.2, 0.2), (3.6, 0.2), (0.2, 3.6)];
    for (transform, expected) in [
        ("{}", [red, green, blue]),
        // The example of the extension: the lower left quadrant.
        (r#"{"offset":[0,1],"rotation":1.57079632679,"scale":[0.5,0.5]}"#, [blue; 3]),
        // The whole image, turned likewise: the first corner is the lower left one, the second the upper
        // left.
        (r#"{"offset":[0,1],"rotation":1.57079632679}"#, [blue, red, grey]),
        (r#"{"offset":[0.5,0]}"#, [green, red, grey]),
        (r#"{"offset":[0,1],"scale":[1,-1]}"#, [blue, grey, red]),
    ] {
        assert_eq!(corners.map(|(x, y)| of(transform, x, y)), expected, "{transform}");
    }
}

#[test]
fn colours_of_vertices_of_ply_files_are_mixed() {
    let mut f = fixture();
    let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n\
                property list uchar int vertex_indices\nend_header\n0 0 0 200 0 10\n4 0 0 0 100 10\n\
                0 4 0 0 0 10\n3 0 1 2\n";
    let files = vec![f.file("a.ply", text)];
    f.file("materials.csv", "name,reflectance\na,0.3\n");
    f.part(Loader::MeshFiles { files, reading: MeshReading::default() });
    let scene = f.scene();
    assert_eq!(colour(&scene, 0.0, 0.0), [200, 0, 10]);
    assert_eq!(colour(&scene, 2.0, 0.0), [100, 50, 10]);
    assert_eq!(colour(&scene, 1.0, 1.0), [100, 25, 10]);
}

#[test]
fn textures_that_cannot_be_used_are_warned_of_once() {
    let mut f = fixture();
    f.file("m.mtl", "newmtl a\nKd 1 0 0\nmap_Kd /home/me/none.png\nhelios_reflectance 0.3\n");
    f.obj("a.obj", SQUARE);
    f.obj("b.obj", SQUARE);
    let (scene, found) = f.load().unwrap();
    let said = found.text();
    assert_eq!(said.matches("cannot use the texture /home/me/none.png").count(), 1, "{said}");
    assert_eq!(colour(&scene, 1.0, 1.0), [255, 0, 0]);
    // A file of the same name beside replaces one of another machine.
    f.file("m.mtl", "newmtl a\nmap_Kd C:\\images\\t.png\nhelios_reflectance 0.3\n");
    let (scene, found) = f.load().unwrap();
    assert!(found.text().contains("there is no texture C:\\images\\t.png"), "{}", found.text());
    assert_eq!(colour(&scene, 1.0, 3.0), [200, 0, 0]);
}

/// The warnings of a scene of one file with colours.
fn warned(name: &str, content: impl AsRef<[u8]>) -> String {
    let mut f = fixture();
    f.file("m.mtl", "newmtl a\nmap_Kd t.png\nhelios_reflectance 0.3\n");
    f.file("materials.csv", "name,reflectance\na,0.3\n");
    let files = vec![f.file(name, content)];
    f.part(Loader::MeshFiles { files, reading: MeshReading::default() });
    f.load().unwrap().1.text()
}

#[test]
fn triangles_without_texture_coordinates_are_warned_of() {
    for (vt, face, expected) in [
        ("", "1 2 3", "m.obj:6:1: 2 triangles without texture: the material has one, but the faces have no"),
        ("vt 0 0\n", "1 2/1 3/1", "m.obj:7:1: 2 triangles without texture: the material has one"),
        ("vt 0 0\n", "-3/-2 -2/-1 -1/-1", "1 triangle without texture: texture coordinates do not exist"),
    ] {
        let faces = format!("usemtl a\nf {face}\nf 1 2 3\n");
        let said = warned("m.obj", format!("mtllib m.mtl\nv 0 0 0\nv 4 0 0\nv 4 4 0\n{vt}{faces}"));
        assert!(said.contains(expected), "{said}");
    }
    let glb = textured_glb(&png_of(1, 1, &[9; 3]), r#""baseColorTexture":{"index":0,"texCoord":1}"#);
    let said = warned("a.glb", glb);
    assert!(said.contains("the material \"m\" has a texture, which triangles without"), "{said}");
}

#[test]
fn colours_that_are_not_read_are_warned_of() {
    let ply = |vertex: &str, face: &str, comment: &str, values: &str| {
        format!(
            "ply\nformat ascii 1.0\n{comment}element vertex 3\nproperty float x\nproperty float y\n\
             property float z\n{vertex}element face 1\nproperty list uchar int vertex_indices\n{face}\
             end_header\n0 0 0{values}\n4 0 0{values}\n0 4 0{values}\n3 0 1 2{}\n",
            if face.is_empty() { "" } else { " 9 9 9" }
        )
    };
    let components =
        |kind: &str| ["red", "green", "blue"].map(|name| format!("property {kind} {name}\n")).concat();
    let (bytes, wide) = (components("uchar"), components("uchar").replace(" red", " diffuse_red"));
    for (file, expected) in [
        (ply("", "", "", ""), ""),
        (ply(&bytes, "", "", " 1 2 3"), ""),
        (ply(&wide, "", "", " 1 2 3"), ""),
        (
            ply(&format!("{bytes}property uchar diffuse_red\n"), "", "", " 1 2 3 4"),
            "the properties red and diffuse_red of an element vertex mean the same; diffuse_red is read",
        ),
        (
            ply(&format!("{bytes}property uchar red\n"), "", "", " 1 2 3 4"),
            "an element vertex has several properties red, of which the first one is read",
        ),
        (ply("property uchar red\n", "", "", " 1"), "the colours of its vertices are not read"),
        (ply("", &bytes, "", ""), "the colours of its faces are not read"),
        (ply("", "", "comment TextureFile t.png\n", ""), "its texture is not read"),
    ] {
        let said = warned("a.ply", &file);
        assert!(said.contains(expected) && said.is_empty() == expected.is_empty(), "{file}: {said}");
    }
    let mut stl = [0; 84].to_vec();
    stl[80] = 1;
    let corners = [[0.0f32; 3], [0.0; 3], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]];
    corners.iter().flatten().for_each(|c| stl.extend(c.to_le_bytes()));
    let [plain, coloured] = [0, 0x80].map(|last| [&stl[..], &[0, last]].concat());
    let named = [&b"COLOR="[..], &plain[6..]].concat();
    for (file, is_warned) in [(plain, false), (coloured, true), (named, true)] {
        assert_eq!(warned("a.stl", file).contains("its colours are not read"), is_warned);
    }
    let off = "OFF\n3 1 0\n0 0 0\n4 0 0\n0 4 0\n3 0 1 2 255 0 0\n";
    assert!(warned("a.off", off).contains("its colours are not read"));
    for (properties, expected) in [
        (r#""baseColorFactor":[2,1,1,1]"#, "baseColorFactor is no colour of numbers from 0 to 1"),
        (r#""baseColorTexture":{}"#, "baseColorTexture has no index and is ignored"),
        (r#""baseColorTexture":{"index":3}"#, "texture 3 does not exist"),
        (r#"},"extensions":{"KHR_materials_pbrSpecularGlossiness":{}"#, "SpecularGlossiness are not read"),
    ] {
        let said = warned("a.glb", textured_glb(&png_of(1, 1, &[9; 3]), properties));
        assert!(said.contains("the material \"m\": ") && said.contains(expected), "{said}");
    }
}

#[test]
fn checksums_depend_on_texels_only_if_colours_are_requested() {
    let mut f = fixture();
    f.file("m.mtl", "newmtl a\nmap_Kd t.png\nhelios_reflectance 0.3\n");
    f.obj("a.obj", SQUARE);
    let sums = |f: &Fixture| {
        [&TEXELS, &[7; 12]].map(|texels| {
            f.file("t.png", png_of(2, 2, texels));
            fingerprint(&f.load().unwrap().0, &f.recipe()).unwrap()
        })
    };
    let [one, other] = sums(&f);
    assert_ne!(one, other);
    assert_eq!(sums(&f), [one, other]);
    f.options.colours = false;
    let [plain, again] = sums(&f);
    assert!(plain == again && plain != one);
}
