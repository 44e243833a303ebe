//! Random scenes: meshes, rasters, voxels, point clouds, instances, moving parts, swaps.

use super::draw::Draw;
use std::fmt::Write as _;
use std::path::Path;

/// Half the width of every scene, m.
pub const HALF_WIDTH: f64 = 30.0;

/// Writes the files of a scene into `folder`, as `scene.xml#s`.
pub fn write(draw: &mut Draw, folder: &Path) {
    let put = |name: &str, bytes: &[u8]| std::fs::write(folder.join(name), bytes).expect("a file of a scene");
    put("m.mtl", materials(draw).as_bytes());
    put("ground.obj", ground(draw).as_bytes());
    put("box.obj", BOX.as_bytes());
    put("soup.obj", soup(draw).as_bytes());
    put("crown.vox", voxels(draw).as_bytes());
    put("cloud.xyz", cloud(draw).as_bytes());
    put("places.csv", places(draw).as_bytes());
    let mut parts = part(&obj("ground.obj"), "");
    for _ in 0..draw.between(1, 6) {
        parts.push_str(&random_part(draw));
    }
    let text =
        format!("<?xml version=\"1.0\"?>\n<document>\n<scene id=\"s\">\n{parts}</scene>\n</document>\n");
    put("scene.xml", text.as_bytes());
}

fn filter(kind: &str, params: &[(&str, &str, String)]) -> String {
    let params = params
        .iter()
        .map(|(kind, key, value)| format!("<param type=\"{kind}\" key=\"{key}\" value=\"{value}\"/>"))
        .collect::<String>();
    format!("<filter type=\"{kind}\">{params}</filter>")
}

fn obj(name: &str) -> String {
    filter("objloader", &[("string", "filepath", name.to_owned())])
}

fn part(filters: &str, attributes: &str) -> String {
    format!("<part{attributes}>{filters}</part>\n")
}

fn place(draw: &mut Draw) -> String {
    let across = |draw: &mut Draw| draw.number(-0.6 * HALF_WIDTH, 0.6 * HALF_WIDTH);
    format!("{};{};{}", across(draw), across(draw), draw.number(0.0, 4.0))
}

fn translate(draw: &mut Draw) -> String {
    let mut params = vec![("vec3", "offset", place(draw))];
    if draw.chance(0.2) {
        params.push(("integer", "onGround", draw.pick(&["-1", "1", "2"]).to_string()));
    }
    filter("translate", &params)
}

fn scale(draw: &mut Draw) -> String {
    filter("scale", &[("double", "scale", draw.number(0.5, 3.0).to_string())])
}

fn random_part(draw: &mut Draw) -> String {
    match draw.below(7) {
        0 => {
            let filters = obj(draw.pick(&["soup.obj", "box.obj"])) + &scale(draw) + &translate(draw);
            part(&filters, "")
        }
        1 => part(
            &(filter("instances", &[("string", "filepath", "places.csv".to_owned())]) + &scale(draw)),
            "",
        ),
        // Several parts of one file, which may share it.
        2 => (0..draw.between(2, 6)).map(|_| part(&(obj("soup.obj") + &translate(draw)), "")).collect(),
        3 => {
            let mode = draw.pick(&["transmittive", "fixed", "scaled"]).to_string();
            let loader = filter(
                "detailedvoxels",
                &[("string", "filepath", "crown.vox".to_owned()), ("string", "intersectionMode", mode)],
            );
            part(&(loader + &translate(draw)), "")
        }
        4 => {
            let loader = filter(
                "xyzloader",
                &[
                    ("string", "filepath", "cloud.xyz".to_owned()),
                    ("string", "separator", " ".to_owned()),
                    ("double", "voxelSize", draw.pick(&["0.5", "1.0"]).to_string()),
                ],
            );
            part(&(loader + &translate(draw)), "")
        }
        5 => moving_part(draw),
        _ => {
            let filters = obj("box.obj") + &translate(draw);
            let swaps = match draw.below(3) {
                0 => format!("<swap>{}</swap>", scale(draw)),
                1 => {
                    format!("<swap>{}</swap><swap force_null=\"true\"/>", obj("soup.obj") + &translate(draw))
                }
                _ => "<swap swapStep=\"2\" force_null=\"true\"/>".to_owned(),
            };
            part(&(filters + &swaps), "")
        }
    }
}

fn moving_part(draw: &mut Draw) -> String {
    let step = |draw: &mut Draw| draw.number(-0.1, 0.1);
    let axis = draw.pick(&["0;0;1", "1;0;0", "0.3;-0.5;1"]);
    let (angle, by) = (draw.number(-3.0, 3.0), format!("{};{};{}", step(draw), step(draw), step(draw)));
    let motion = match draw.below(5) {
        0 => format!("<motion type=\"translation\" vec=\"{by}\"/>"),
        1 => format!("<motion type=\"rotation\" axis=\"{axis}\" angle=\"{angle}\" selfMode=\"true\"/>"),
        2 => format!("<motion type=\"rotation\" axis=\"{axis}\" angle=\"{angle}\" center=\"0;0;1\"/>"),
        3 => format!("<motion type=\"helical\" axis=\"0;0;1\" angle=\"{angle}\" glide=\"{}\"/>", step(draw)),
        _ => format!(
            "<motion type=\"translation\" vec=\"{by}\"/><motion type=\"rotation\" axis=\"0;0;1\" angle=\"{angle}\"/>"
        ),
    };
    let (loops, again) = (draw.between(5, 60), draw.chance(0.5));
    let next = if again { " next=\"back\"" } else { "" };
    let mut motions = format!("<dmotion id=\"go\" loop=\"{loops}\"{next}>{motion}</dmotion>");
    if again {
        motions.push_str("<dmotion id=\"back\" loop=\"30\" next=\"go\"><motion type=\"translation\" vec=\"0;0;0.01\"/></dmotion>");
    }
    let attributes = format!(" dynStep=\"{}\" kdtDynStep=\"{}\"", draw.between(1, 40), draw.between(1, 3));
    part(&(obj("box.obj") + &scale(draw) + &translate(draw) + &motions), &attributes)
}

fn materials(draw: &mut Draw) -> String {
    let mut text = String::new();
    for (i, name) in ["a", "b"].iter().enumerate() {
        let _ = write!(
            text,
            "newmtl {name}\nKd 0.5 0.5 0.5\nKs {} 0.1 0.1\nNs {}\nhelios_reflectance {}\nhelios_classification {i}\n\
             helios_isGround {}\n",
            draw.number(0.0, 0.9),
            draw.between(1, 40),
            draw.number(0.05, 0.95),
            i == 0,
        );
    }
    text
}

/// A grid of random heights.
fn ground(draw: &mut Draw) -> String {
    let cells = draw.between(1, 14);
    let mut text = "mtllib m.mtl\nusemtl a\n".to_owned();
    for i in 0..=cells {
        for j in 0..=cells {
            let along = |k: u64| HALF_WIDTH * (2.0 * k as f64 / cells as f64 - 1.0);
            let _ = writeln!(text, "v {:.3} {:.3} {}", along(i), along(j), draw.number(-1.0, 0.5));
        }
    }
    for i in 0..cells {
        for j in 0..cells {
            let at = |i: u64, j: u64| i * (cells + 1) + j + 1;
            let _ = writeln!(text, "f {} {} {} {}", at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
        }
    }
    text
}

const BOX: &str = "mtllib m.mtl\nusemtl b\nv -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nv -1 -1 2\nv 1 -1 2\nv 1 1 2\nv -1 1 2\n\
    f 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\nf 5 6 7 8\nf 1 4 3 2\n";

/// Triangles without order, some of them with normals.
fn soup(draw: &mut Draw) -> String {
    let mut text = "mtllib m.mtl\n".to_owned();
    let count = draw.pick(&[1, 5, 40, 300]);
    for i in 0..count {
        let centre: [f64; 3] =
            std::array::from_fn(|axis| draw.number(if axis == 2 { 0.0 } else { -3.0 }, 3.0));
        for _ in 0..3 {
            let [x, y, z] = centre.map(|c| c + draw.number(-0.7, 0.7));
            let _ = writeln!(text, "v {x:.3} {y:.3} {z:.3}");
        }
        let (a, b, c) = (3 * i + 1, 3 * i + 2, 3 * i + 3);
        let _ = writeln!(text, "usemtl {}\nf {a} {b} {c}", draw.pick(&["a", "b"]));
    }
    text
}

fn voxels(draw: &mut Draw) -> String {
    let mut text =
        "VOXEL SPACE\n#min_corner: -2 -2 0\n#max_corner: 2 2 4\n#split: 4 4 4\n#res: 1.0 #max_pad: 5.0\n\
        i j k PadBVTotal a b c d e f g h n transmittance m l\n"
            .to_owned();
    for cell in 0..64 {
        if draw.chance(0.6) {
            let (i, j, k) = (cell / 16, cell / 4 % 4, cell % 4);
            let density = draw.number(0.0, 3.0);
            let _ =
                writeln!(text, "{i} {j} {k} {density} 54.25 0.5 0.5 0.5 1.25 0.5 12.5 7 60 0.75 0.5 0.25");
        }
    }
    // A file without voxels is refused.
    text.push_str("0 0 0 1.25 54.25 0.5 0.5 0.5 1.25 0.5 12.5 7 60 0.75 0.5 0.25\n");
    text
}

fn cloud(draw: &mut Draw) -> String {
    let mut text = String::new();
    for _ in 0..draw.between(3, 200) {
        let [x, y, z, a, b, c]: [f64; 6] = std::array::from_fn(|_| draw.number(-2.0, 2.0));
        let _ = writeln!(text, "{x} {y} {z} {a} {b} {c}");
    }
    text
}

fn places(draw: &mut Draw) -> String {
    let mut text = "file,x,y,z,yaw,scale\n".to_owned();
    for _ in 0..draw.between(1, 12) {
        let place = place(draw).replace(';', ",");
        let (yaw, size) = (draw.number(0.0, 360.0), draw.number(0.3, 2.0));
        let _ = writeln!(text, "{},{place},{yaw},{size}", draw.pick(&["box.obj", "soup.obj"]));
    }
    text
}
