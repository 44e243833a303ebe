//! Hills with boulders and a few houses.

use super::obj::{Mesh, ObjFile, SceneFolder};
use super::random::{Octave, Random, Relief, Topic};
use super::solid::{BOX_FACES, ball, ball_triangles, box_corners, ground, ground_cells};
use super::{Materials, SceneFiles, SceneOptions};
use vlscan_base::error::Result;
use vlscan_geom::DVec3;

pub(super) const MATERIAL_FILE: &str = "terrain.mtl";
pub(super) const MATERIALS: Materials = Materials {
    comment: "helios_reflectance: 0 to 1, at 1064 nm. Classes: 2 ground, 6 buildings, 64 rocks.",
    all: &[
        ("meadow", "0.34 0.46 0.20", 0.45, 2, true),
        ("rock", "0.52 0.50 0.47", 0.3, 64, false),
        ("plaster", "0.84 0.81 0.74", 0.6, 6, false),
        ("tiles", "0.58 0.25 0.18", 0.28, 6, false),
    ],
};

/// Default edge of the square, m: 1 M triangles cover 500 m × 500 m.
pub(super) fn default_extent(triangles: u64) -> f64 {
    (500.0 * (triangles as f64 / 1e6).sqrt()).max(60.0)
}

const RELIEF: [Octave; 8] = [
    Octave { wavelength: 420.0, amplitude: 34.0 },
    Octave { wavelength: 170.0, amplitude: 13.0 },
    Octave { wavelength: 75.0, amplitude: 4.5 },
    Octave { wavelength: 32.0, amplitude: 1.6 },
    Octave { wavelength: 13.0, amplitude: 0.5 },
    Octave { wavelength: 5.5, amplitude: 0.18 },
    Octave { wavelength: 2.3, amplitude: 0.07 },
    Octave { wavelength: 1.0, amplitude: 0.025 },
];
const HOUSE: u64 = 26;
const STONE: u64 = 8;

/// Writes the ground, the houses and the boulders.
pub(super) fn write(options: &SceneOptions, extent: f64, folder: &SceneFolder) -> Result<SceneFiles> {
    let cells = ground_cells(options.triangles * 93 / 100);
    let rest = options.triangles - 2 * cells * cells;
    let relief = Relief::new(options.seed, &RELIEF, extent / cells as f64);
    let mut files = SceneFiles::default();

    let mut hills = ObjFile::create(folder, "ground.obj", MATERIAL_FILE)?;
    hills.material("meadow");
    ground(&mut hills, &relief, extent, cells)?;
    files.add("ground", hills.finish()?);

    let wanted = (extent * extent / 9000.0).round() as u64;
    let houses = wanted.clamp(1, (rest / 3 / HOUSE).max(1));
    files.add("houses", write_houses(options.seed, &relief, extent, folder, houses)?);
    files.add("boulders", write_boulders(options.seed, &relief, extent, folder, rest - houses * HOUSE)?);
    Ok(files)
}

fn write_houses(seed: u64, relief: &Relief, extent: f64, folder: &SceneFolder, houses: u64) -> Result<Mesh> {
    let mut out = ObjFile::create(folder, "houses.obj", MATERIAL_FILE)?;
    for number in 0..houses {
        house(&mut out, &mut Random::new(seed, Topic::House, number), relief, extent)?;
    }
    out.finish()
}

/// Writes a house with a gable roof of finite thickness: 4 walls, 2 gables and 2 × 4 roof faces.
fn house(out: &mut ObjFile, random: &mut Random, relief: &Relief, extent: f64) -> Result<()> {
    let mut at = || 0.42 * extent * (2.0 * random.unit() - 1.0);
    let (x, y) = (at(), at());
    let (c, s) = random.heading();
    let (along, across) = (DVec3::new(c, s, 0.0), DVec3::new(-s, c, 0.0));
    let (length, width, eaves) =
        (random.between(9.0, 14.0), random.between(7.0, 9.0), random.between(3.0, 5.5));
    let rise = 0.5 * width * random.between(0.7, 1.0);
    let corner = |i: f64, j: f64| DVec3::new(x, y, 0.0) + along * (i * length) + across * (j * width);
    let corners = [corner(-0.5, -0.5), corner(0.5, -0.5), corner(0.5, 0.5), corner(-0.5, 0.5)];
    let floor = corners.iter().map(|p| relief.height(p.x, p.y)).fold(relief.height(x, y), f64::max);
    let lowest = corners.iter().map(|p| relief.height(p.x, p.y)).fold(floor, f64::min) - 0.5;

    out.material("plaster");
    let at_height = |p: DVec3, z: f64| DVec3::new(p.x, p.y, z);
    let mut ring = [[0; 4]; 2];
    for (level, z) in [lowest, floor + eaves].into_iter().enumerate() {
        for (number, p) in ring[level].iter_mut().zip(corners) {
            *number = out.vertex(at_height(p, z))?;
        }
    }
    for i in 0..4 {
        let j = (i + 1) % 4;
        out.face([ring[0][i], ring[0][j], ring[1][j], ring[1][i]])?;
    }
    let ridge = floor + eaves + rise;
    let gables = [(-0.5, [3, 0]), (0.5, [1, 2])];
    for (end, [a, b]) in gables {
        let top = out.vertex(at_height(corner(end, 0.0), ridge))?;
        out.face([ring[1][a], ring[1][b], top])?;
    }
    out.material("tiles");
    for side in [-1.0, 1.0] {
        let lower = at_height(corner(0.0, 0.58 * side), floor + eaves - 0.16 * rise);
        let upper = at_height(corner(0.0, 0.0), ridge);
        let slope = upper - lower;
        let normal = vlscan_geom::unit(along.cross(slope) * -side);
        let slab =
            box_corners((lower + upper) * 0.5 + normal * 0.12, along * (1.08 * length), slope, normal * 0.2);
        // The faces towards the ridge are hidden within the other half; the two gable faces and the outer
        // four are visible.
        let mut numbers = [0; 8];
        for (number, p) in numbers.iter_mut().zip(slab) {
            *number = out.vertex(p)?;
        }
        for face in [BOX_FACES[1], BOX_FACES[2], BOX_FACES[3], BOX_FACES[5]] {
            out.face(face.map(|i| numbers[i]))?;
        }
    }
    Ok(())
}

/// Writes boulders of up to a few metres, then stones until at most seven of the triangles are left.
fn write_boulders(
    seed: u64,
    relief: &Relief,
    extent: f64,
    folder: &SceneFolder,
    triangles: u64,
) -> Result<Mesh> {
    let mut out = ObjFile::create(folder, "boulders.obj", MATERIAL_FILE)?;
    out.material("rock");
    let rings = match triangles {
        0..1_000 => 3,
        1_000..20_000 => 5,
        _ => 9,
    };
    let boulders = (triangles * 3 / 4 / ball_triangles(rings)).min((extent * extent / 150.0) as u64);
    for number in 0..boulders {
        boulder(&mut out, &mut Random::new(seed, Topic::Boulder, number), relief, extent, rings, 1.6)?;
    }
    for number in 0..(triangles - boulders * ball_triangles(rings)) / STONE {
        boulder(&mut out, &mut Random::new(seed, Topic::Stone, number), relief, extent, 2, 0.35)?;
    }
    out.finish()
}

fn boulder(
    out: &mut ObjFile,
    random: &mut Random,
    relief: &Relief,
    extent: f64,
    rings: u64,
    largest: f64,
) -> Result<()> {
    let mut at = || 0.48 * extent * (2.0 * random.unit() - 1.0);
    let (x, y) = (at(), at());
    let size = largest * random.between(0.25, 1.0);
    let stretch =
        DVec3::new(random.between(0.8, 1.3), random.between(0.8, 1.3), random.between(0.5, 0.9)) * size;
    let centre = DVec3::new(x, y, relief.height(x, y) + 0.3 * stretch.z);
    let bumps: [DVec3; 5] = std::array::from_fn(|_| random.direction());
    ball(out, centre, rings, |d| {
        let dents: f64 = bumps.iter().map(|b| (d.dot(*b) - 0.55).max(0.0)).sum();
        d * stretch * (1.0 - 0.5 * dents)
    })
}
