//! Foliage as opaque voxels, written as an AMAPVox file like the voxelised laser scans of real trees.

use super::obj::SceneFolder;
use super::random::{Random, Topic};
use super::tree::Tree;
use std::collections::HashSet;
use std::fmt::Write as _;
use std::path::PathBuf;
use vlscan_base::error::{Error, Result};
use vlscan_geom::{Aabb, DVec3};

/// Edge of a cell, m.
pub(super) const CELL: f64 = 0.25;

pub(super) const FILE: &str = "crowns.vox";

/// Summary of a written voxel file.
pub(super) struct Cells {
    pub(super) path: PathBuf,
    pub(super) count: u64,
    pub(super) bounds: Aabb,
}

/// Writes about `wanted` cells within the crowns of `trees`, distributed in proportion to leaf area. Fails
/// when the crowns are too small for that number of cells.
pub(super) fn write(trees: &[Tree], seed: u64, wanted: u64, folder: &SceneFolder) -> Result<Cells> {
    let area: f64 = trees.iter().map(Tree::leaf_area).sum();
    let volume = |tree: &Tree| {
        let radii = tree.crown().1;
        4.0 / 3.0 * std::f64::consts::PI * radii.x * radii.y * radii.z
    };
    let room = trees.iter().map(volume).sum::<f64>() / (CELL * CELL * CELL);
    if wanted as f64 > 0.5 * room {
        return Err(too_many(wanted, 0.5 * room));
    }
    let mut cells: Vec<[i64; 3]> = Vec::new();
    for tree in trees {
        let share = (wanted as f64 * tree.leaf_area() / area).round() as usize;
        let (centre, radii) = tree.crown();
        let mut random = Random::new(seed, Topic::Crown, tree.number());
        let mut taken = HashSet::new();
        for _ in 0..20 * share {
            if taken.len() == share {
                break;
            }
            let p = DVec3::new(random.unit(), random.unit(), random.unit()) * 2.0 - DVec3::ONE;
            if p.length_squared() <= 1.0 {
                let cell = ((centre + p * radii) / CELL).to_array().map(|c| c.floor() as i64);
                if taken.insert(cell) {
                    cells.push(cell);
                }
            }
        }
    }
    // Crowns overlap, so a cell may occur more than once.
    cells.sort_unstable_by_key(|&[x, y, z]| (z, y, x));
    cells.dedup();
    if cells.is_empty() || (cells.len() as f64) < 0.9 * wanted as f64 {
        return Err(too_many(wanted, cells.len() as f64));
    }
    write_cells(&cells, folder)
}

fn too_many(wanted: u64, room: f64) -> Error {
    Error::input(format!(
        "{wanted} voxels of {CELL} m: the crowns hold about {room:.0} only; a larger --extent makes more \
         trees"
    ))
}

fn write_cells(cells: &[[i64; 3]], folder: &SceneFolder) -> Result<Cells> {
    let fold = |pick: fn(i64, i64) -> i64| {
        cells.iter().copied().reduce(|a, b| [0, 1, 2].map(|i| pick(a[i], b[i]))).unwrap_or_default()
    };
    let (lo, hi) = (fold(i64::min), fold(i64::max).map(|c| c + 1));
    let metres = |c: [i64; 3]| c.map(|c| c as f64 * CELL);
    let (min, max) = (metres(lo), metres(hi));
    let mut text = format!(
        "VOXEL SPACE\n#min_corner: {} {} {}\n#max_corner: {} {} {}\n#split: {} {} {}\n\
         #res: {CELL} #max_pad: 5.0\n\
         i j k PadBVTotal angleMean bsEntering bsIntercepted bsPotential ground_distance lMeanTotal lgTotal \
         nbEchos nbSampling transmittance attenuation attenuationBiasCorrection\n",
        min[0],
        min[1],
        min[2],
        max[0],
        max[1],
        max[2],
        hi[0] - lo[0],
        hi[1] - lo[1],
        hi[2] - lo[2],
    );
    let mut file = folder.file(FILE)?;
    for [x, y, z] in cells {
        let _ = writeln!(text, "{} {} {} 1 0 0 0 0 0 0 0 0 0 0.5 0 0", x - lo[0], y - lo[1], z - lo[2]);
        if text.len() > 1 << 20 {
            file.write(text.as_bytes())?;
            text.clear();
        }
    }
    file.write(text.as_bytes())?;
    let bounds = Aabb { min: DVec3::from(min), max: DVec3::from(max) };
    Ok(Cells { path: file.finish(), count: cells.len() as u64, bounds })
}
