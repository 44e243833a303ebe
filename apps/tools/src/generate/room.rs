//! A furnished room under a sloping roof.

use super::obj::{ObjFile, SceneFolder};
use super::random::{Random, Topic};
use super::solid::{BOX_FACES, ball, ball_triangles, box_corners, patch, tube};
use super::tree::leaf_around;
use super::{Materials, SceneFiles, SceneOptions};
use libm::{cos, sin};
use vlscan_base::error::Result;
use vlscan_geom::{DVec3, radians};

pub(super) const MATERIAL_FILE: &str = "room.mtl";
pub(super) const MATERIALS: Materials = Materials {
    comment: "helios_reflectance: 0 to 1, at 1550 nm. Classes: 2 floor, 5 leaves, 6 walls and ceiling, 64 \
              furniture,\n# 65 books, 66 reference spheres.",
    all: &[
        ("parquet", "0.55 0.40 0.26", 0.45, 2, true),
        ("wall", "0.88 0.87 0.83", 0.75, 6, false),
        ("wood", "0.50 0.34 0.20", 0.5, 64, false),
        ("book", "0.42 0.20 0.22", 0.35, 65, false),
        ("sphere", "0.95 0.95 0.95", 0.9, 66, false),
        ("pot", "0.66 0.36 0.24", 0.4, 64, false),
        ("plant", "0.18 0.46 0.16", 0.52, 5, false),
    ],
};

/// Length of the room, m.
pub(super) const DEFAULT_EXTENT: f64 = 8.0;
/// Rotation of the room about the vertical, so that no wall is parallel to an axis.
const YAW_DEGREES: f64 = 8.0;
const HEIGHT: f64 = 2.8;

/// Scene coordinates of a point given in coordinates of the floor plan.
pub(super) fn placed(x: f64, y: f64, z: f64) -> DVec3 {
    turned(DVec3::new(x, y, z))
}

fn turned(p: DVec3) -> DVec3 {
    let (s, c) = (sin(radians(YAW_DEGREES)), cos(radians(YAW_DEGREES)));
    DVec3::new(c * p.x - s * p.y, s * p.x + c * p.y, p.z)
}

/// A face or solid whose number of triangles follows from a mesh width.
enum Shape {
    /// Four corners; a bumpy patch is uneven like plaster, but flat at its rim.
    Patch { corners: [DVec3; 4], bumpy: bool },
    /// A sphere.
    Ball { centre: DVec3, radius: f64 },
    /// A cylinder between two points.
    Post { from: DVec3, to: DVec3, radius: f64 },
}

impl Shape {
    /// Columns and rows of a patch.
    fn grid(corners: &[DVec3; 4], width: f64) -> (u64, u64) {
        let [a, b, c, d] = corners;
        let steps = |x: f64, y: f64| ((x.max(y) / width).round() as u64).max(1);
        (steps(a.distance(*b), d.distance(*c)), steps(b.distance(*c), a.distance(*d)))
    }

    fn rings(radius: f64, width: f64) -> u64 {
        // Curved faces get a finer mesh than flat ones.
        ((std::f64::consts::PI * radius / (0.4 * width)).round() as u64).max(3)
    }

    fn sides(radius: f64, width: f64) -> u64 {
        ((std::f64::consts::TAU * radius / (0.4 * width)).round() as u64).clamp(5, 64)
    }

    fn triangles(&self, width: f64) -> u64 {
        match self {
            Shape::Patch { corners, .. } => {
                let (columns, rows) = Shape::grid(corners, width);
                2 * columns * rows
            }
            Shape::Ball { radius, .. } => ball_triangles(Shape::rings(*radius, width)),
            Shape::Post { radius, .. } => 2 * Shape::sides(*radius, width),
        }
    }

    fn write(&self, out: &mut ObjFile, width: f64) -> Result<()> {
        match self {
            Shape::Patch { corners, bumpy } => {
                let (columns, rows) = Shape::grid(corners, width);
                let [a, b, _, d] = *corners;
                let normal = vlscan_geom::unit((b - a).cross(d - a));
                let size = (a.distance(b), a.distance(d));
                patch(out, corners.map(turned), columns, rows, |u, v| {
                    let rim = if *bumpy { 16.0 * u * (1.0 - u) * v * (1.0 - v) } else { 0.0 };
                    let waves = sin(7.1 * u * size.0 + 1.3) * cos(5.3 * v * size.1)
                        + sin(2.2 * (u * size.0 + v * size.1));
                    turned(normal * (0.002 * rim * waves))
                })
            }
            Shape::Ball { centre, radius } => {
                ball(out, turned(*centre), Shape::rings(*radius, width), |d| d * *radius)
            }
            Shape::Post { from, to, radius } => {
                let spine = [(turned(*from), *radius), (turned(*to), *radius)];
                tube(out, &spine, Shape::sides(*radius, width))
            }
        }
    }
}

/// Shapes of one material.
struct Piece {
    material: &'static str,
    shapes: Vec<Shape>,
}

/// The pieces of one part of the scene.
struct Group {
    name: &'static str,
    pieces: Vec<Piece>,
}

impl Group {
    fn triangles(&self, width: f64) -> u64 {
        self.pieces.iter().flat_map(|p| &p.shapes).map(|s| s.triangles(width)).sum()
    }

    fn write(&self, out: &mut ObjFile, width: f64) -> Result<()> {
        for piece in &self.pieces {
            out.material(piece.material);
            for shape in &piece.shapes {
                shape.write(out, width)?;
            }
        }
        Ok(())
    }
}

/// Writes the room and its furniture.
pub(super) fn write(options: &SceneOptions, extent: f64, folder: &SceneFolder) -> Result<SceneFiles> {
    let groups = furnish(options, extent);
    let total = |width: f64| groups.iter().map(|g| g.triangles(width)).sum::<u64>();
    let width = mesh_width(total, options.triangles * 92 / 100);
    let mut files = SceneFiles::default();
    let mut written = 0;
    for group in &groups {
        let mut out = ObjFile::create(folder, &format!("{}.obj", group.name), MATERIAL_FILE)?;
        group.write(&mut out, width)?;
        written += out.triangles;
        files.add(group.name, out.finish()?);
    }
    let mut out = ObjFile::create(folder, "plant.obj", MATERIAL_FILE)?;
    plant(&mut out, options, extent, options.triangles.saturating_sub(written))?;
    files.add("plant", out.finish()?);
    Ok(files)
}

/// The smallest mesh width (by bisection) with at most `triangles` triangles in total.
fn mesh_width(total: impl Fn(f64) -> u64, triangles: u64) -> f64 {
    let (mut fine, mut coarse) = (1e-5_f64, 100.0_f64);
    for _ in 0..60 {
        let middle = (fine * coarse).sqrt();
        if total(middle) > triangles { fine = middle } else { coarse = middle }
    }
    coarse
}

fn furnish(options: &SceneOptions, extent: f64) -> Vec<Group> {
    let (a, b) = (0.5 * extent, 0.375 * extent);
    let p = DVec3::new;
    // Cross-section with a low wall at +x and the slope of the roof above it.
    let (low, flat) = (1.4, a - 2.0);
    let face = |corners| Shape::Patch { corners, bumpy: true };
    let walls = vec![
        face([p(-a, b, 0.0), p(-a, -b, 0.0), p(-a, -b, HEIGHT), p(-a, b, HEIGHT)]),
        face([p(a, -b, 0.0), p(a, b, 0.0), p(a, b, low), p(a, -b, low)]),
        face([p(a, -b, low), p(a, b, low), p(flat, b, HEIGHT), p(flat, -b, HEIGHT)]),
        face([p(-a, b, HEIGHT), p(-a, -b, HEIGHT), p(flat, -b, HEIGHT), p(flat, b, HEIGHT)]),
        face([p(-a, -b, 0.0), p(flat, -b, 0.0), p(flat, -b, HEIGHT), p(-a, -b, HEIGHT)]),
        face([p(flat, -b, 0.0), p(a, -b, 0.0), p(a, -b, low), p(flat, -b, HEIGHT)]),
        face([p(flat, b, 0.0), p(-a, b, 0.0), p(-a, b, HEIGHT), p(flat, b, HEIGHT)]),
        face([p(a, b, 0.0), p(flat, b, 0.0), p(flat, b, HEIGHT), p(a, b, low)]),
    ];
    let floor = vec![Shape::Patch {
        corners: [p(-a, -b, 0.0), p(a, -b, 0.0), p(a, b, 0.0), p(-a, b, 0.0)],
        bumpy: false,
    }];
    let shell = vec![Piece { material: "parquet", shapes: floor }, Piece { material: "wall", shapes: walls }];
    vec![
        Group { name: "shell", pieces: shell },
        Group { name: "furniture", pieces: vec![Piece { material: "wood", shapes: furniture(b) }] },
        Group { name: "shelf", pieces: shelf(options, a) },
        Group { name: "spheres", pieces: spheres(a, b) },
    ]
}

/// Adds the faces of a box with the edge vectors `x`, `y` and `z`.
fn add_block(shapes: &mut Vec<Shape>, centre: DVec3, x: DVec3, y: DVec3, z: DVec3) {
    let corners = box_corners(centre, x, y, z);
    shapes.extend(BOX_FACES.map(|f| Shape::Patch { corners: f.map(|i| corners[i]), bumpy: false }));
}

/// A table with two chairs, and a board leaning against the long wall.
fn furniture(b: f64) -> Vec<Shape> {
    let mut shapes = Vec::new();
    let mut block = |centre, x, y, z| add_block(&mut shapes, centre, x, y, z);
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    let table = DVec3::new(0.4, 0.1, 0.0);
    block(table + z * 0.745, x * 1.6, y * 0.85, z * 0.03);
    for (i, j) in [(-0.74, -0.36), (0.74, -0.36), (0.74, 0.36), (-0.74, 0.36)] {
        block(table + DVec3::new(i, j, 0.365), x * 0.05, y * 0.05, z * 0.73);
    }
    for (place, facing) in [(DVec3::new(0.1, -0.75, 0.0), 1.0), (DVec3::new(0.8, 0.95, 0.0), -1.0)] {
        block(place + z * 0.45, x * 0.44, y * 0.42, z * 0.03);
        for (i, j) in [(-0.19, -0.18), (0.19, -0.18), (0.19, 0.18), (-0.19, 0.18)] {
            block(place + DVec3::new(i, j, 0.2175), x * 0.035, y * 0.035, z * 0.435);
        }
        let lean = DVec3::new(0.0, -0.14 * facing, 0.5);
        block(place + DVec3::new(0.0, -0.2 * facing, 0.465) + lean * 0.5, x * 0.42, y * 0.02, lean);
    }
    let slope = DVec3::new(0.0, 0.5, 1.9);
    block(DVec3::new(-0.9, b - 0.29, 0.955), x * 0.9, y * 0.02, slope);
    shapes
}

/// Shelves along the high wall, with books if the number of triangles allows it.
fn shelf(options: &SceneOptions, a: f64) -> Vec<Piece> {
    let (mut boards, mut books) = (Vec::new(), Vec::new());
    let (length, depth, height, levels) = (2.4, 0.3, 1.9, 4);
    let foot = DVec3::new(-a + 0.2, -0.2, 0.0);
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    for side in [-0.5, 0.5] {
        add_block(
            &mut boards,
            foot + y * (side * length) + z * (0.5 * height),
            x * depth,
            y * 0.025,
            z * height,
        );
    }
    for level in 0..=levels {
        let at = 0.02 + (height - 0.04) * f64::from(level) / f64::from(levels);
        add_block(&mut boards, foot + z * at, x * depth, y * (length - 0.03), z * 0.025);
    }
    let most = (options.triangles / 100).min(160) as u32;
    let per_level = most / levels;
    for level in 0..levels {
        let bottom = 0.035 + (height - 0.04) * f64::from(level) / f64::from(levels);
        let mut random = Random::new(options.seed, Topic::Book, u64::from(level));
        let mut at = -0.5 * length + 0.05;
        for _ in 0..per_level {
            let (thick, tall, deep) =
                (random.between(0.018, 0.05), random.between(0.2, 0.34), random.between(0.16, 0.24));
            let tilt = if random.unit() < 0.15 { random.between(-0.12, 0.0) } else { 0.0 };
            let up = DVec3::new(0.0, -tilt, 1.0) * tall;
            at += thick;
            if at > 0.5 * length - 0.08 {
                break;
            }
            let centre = foot + DVec3::new(0.1 - 0.5 * deep + 0.03, at - 0.5 * thick, bottom) + up * 0.5;
            add_block(&mut books, centre, x * deep, y * (thick * 0.96), up);
            at += if tilt == 0.0 { 0.001 } else { 0.05 };
        }
    }
    let mut pieces = vec![Piece { material: "wood", shapes: boards }];
    if !books.is_empty() {
        pieces.push(Piece { material: "book", shapes: books });
    }
    pieces
}

/// Reference spheres of 14.5 cm diameter on posts, and a larger sphere on the table.
fn spheres(a: f64, b: f64) -> Vec<Piece> {
    let feet = [(a - 1.0, b - 0.9, 1.10), (a - 0.9, -b + 0.8, 0.95), (-a + 1.1, b - 0.8, 1.35)];
    let posts = feet.map(|(x, y, z)| Shape::Post {
        from: DVec3::new(x, y, 0.0),
        to: DVec3::new(x, y, z - 0.07),
        radius: 0.02,
    });
    let balls = feet.map(|(x, y, z)| Shape::Ball { centre: DVec3::new(x, y, z), radius: 0.0725 });
    let mut shapes: Vec<Shape> = balls.into();
    shapes.push(Shape::Ball { centre: DVec3::new(0.75, 0.15, 0.76 + 0.15), radius: 0.15 });
    vec![Piece { material: "wood", shapes: posts.into() }, Piece { material: "sphere", shapes }]
}

/// A pot with a bush in the corner; its leaves use up exactly the remaining triangles.
fn plant(out: &mut ObjFile, options: &SceneOptions, extent: f64, triangles: u64) -> Result<()> {
    let foot = placed(-0.5 * extent + 0.6, -0.375 * extent + 0.6, 0.0);
    out.material("pot");
    let sides = if triangles < 400 { 6 } else { 24 };
    let profile = [(0.001, 0.13), (0.32, 0.19), (0.321, 0.17), (0.29, 0.001)];
    let spine = profile.map(|(z, radius)| (foot + DVec3::Z * z, radius));
    tube(out, &spine, sides)?;
    out.material("plant");
    let pairs = triangles.saturating_sub(2 * sides * 3) / 2;
    let area = 0.5 * 3.0 / (2 * pairs).max(1) as f64;
    let middle = foot + DVec3::Z * 1.0;
    let mut random = Random::new(options.seed, Topic::Plant, 0);
    for _ in 0..pairs {
        let d = random.direction();
        let place = middle + d * DVec3::new(0.38, 0.38, 0.55) * random.between(0.3, 1.0);
        leaf_around(out, &mut random, place, d, area.min(0.03))?;
    }
    Ok(())
}
