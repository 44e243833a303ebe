//! Meshes of elementary shapes.

use super::obj::ObjFile;
use super::random::Relief;
use libm::{cos, sin};
use std::f64::consts::{PI, TAU};
use vlscan_base::error::Result;
use vlscan_geom::DVec3;

/// Unit vectors (u, v) that form a right-handed frame with `w`.
pub(super) fn frame(w: DVec3) -> (DVec3, DVec3) {
    let helper = if w.z.abs() < 0.9 { DVec3::Z } else { DVec3::X };
    let u = vlscan_geom::unit(helper.cross(w));
    (u, w.cross(u))
}

/// Columns and rows of a square of ground with about `triangles` triangles.
pub(super) fn ground_cells(triangles: u64) -> u64 {
    ((triangles as f64 / 2.0).sqrt().floor() as u64).max(1)
}

/// Writes quads between `rows` + 1 rows of vertices, row by row; `closed` joins the last column to the first.
fn grid(
    out: &mut ObjFile,
    rows: u64,
    columns: u64,
    closed: bool,
    vertex: impl Fn(u64, u64) -> DVec3,
) -> Result<()> {
    let quads = if closed { columns } else { columns - 1 };
    let mut below = 0;
    for row in 0..=rows {
        let start = out.vertex(vertex(row, 0))?;
        for column in 1..columns {
            out.vertex(vertex(row, column))?;
        }
        for i in 0..if row == 0 { 0 } else { quads } {
            let next = (i + 1) % columns;
            out.face([below + i, below + next, start + next, start + i])?;
        }
        below = start;
    }
    Ok(())
}

/// A square of ground of `extent` metres about the origin with `cells` × `cells` quads.
pub(super) fn ground(out: &mut ObjFile, relief: &Relief, extent: f64, cells: u64) -> Result<()> {
    let at = |i: u64| extent * (i as f64 / cells as f64 - 0.5);
    grid(out, cells, cells + 1, false, |row, column| {
        let (x, y) = (at(column), at(row));
        DVec3::new(x, y, relief.height(x, y))
    })
}

/// Writes a tube along `spine`, whose entries are points with radii; the ends are open. 2·sides·(points − 1)
/// triangles.
pub(super) fn tube(out: &mut ObjFile, spine: &[(DVec3, f64)], sides: u64) -> Result<()> {
    let Some((&(first, _), &(last, _))) = spine.first().zip(spine.last()) else { return Ok(()) };
    let (u, v) = frame(vlscan_geom::unit(last - first));
    grid(out, spine.len() as u64 - 1, sides, true, |point, side| {
        let (centre, radius) = spine[point as usize];
        let angle = TAU * side as f64 / sides as f64;
        centre + u * (radius * cos(angle)) + v * (radius * sin(angle))
    })
}

/// Number of triangles of [`ball`].
pub(super) fn ball_triangles(rings: u64) -> u64 {
    4 * rings * (rings - 1)
}

/// Writes a closed ball of `rings` ≥ 2 rings and twice as many sectors; `shape` maps a unit direction to the
/// radius.
pub(super) fn ball(
    out: &mut ObjFile,
    centre: DVec3,
    rings: u64,
    shape: impl Fn(DVec3) -> DVec3,
) -> Result<()> {
    let sectors = 2 * rings;
    let south = out.vertex(centre + shape(DVec3::NEG_Z))?;
    let north = out.vertex(centre + shape(DVec3::Z))?;
    let mut below = 0;
    for ring in 1..rings {
        let polar = PI * ring as f64 / rings as f64;
        let (r, z) = (sin(polar), -cos(polar));
        let mut start = 0;
        for sector in 0..sectors {
            let angle = TAU * sector as f64 / sectors as f64;
            let number = out.vertex(centre + shape(DVec3::new(r * cos(angle), r * sin(angle), z)))?;
            if sector == 0 {
                start = number;
            }
        }
        for s in 0..sectors {
            let next = (s + 1) % sectors;
            if ring == 1 {
                out.face([south, start + next, start + s])?;
            } else {
                out.face([below + s, below + next, start + next, start + s])?;
            }
            if ring + 1 == rings {
                out.face([start + s, start + next, north])?;
            }
        }
        below = start;
    }
    Ok(())
}

/// Writes a leaf of two triangles of `area` m² each, folded along its midrib. `along` is the direction of the
/// midrib, `normal` roughly that of the upper side.
pub(super) fn leaf(out: &mut ObjFile, base: DVec3, along: DVec3, normal: DVec3, area: f64) -> Result<()> {
    // The leaf is twice as long as it is wide: each half has the area length · (length/4) / 2.
    let length = (8.0 * area).sqrt();
    let across = vlscan_geom::unit(along.cross(normal)) * (0.25 * length);
    let lift = vlscan_geom::unit(across.cross(along)) * (0.07 * length);
    let middle = base + along * (0.45 * length);
    let corners = [base, middle + across + lift, base + along * length - lift * 0.5, middle - across + lift];
    let mut numbers = [0; 4];
    for (number, corner) in numbers.iter_mut().zip(corners) {
        *number = out.vertex(corner)?;
    }
    out.face(numbers)
}

/// Writes a drooping spray of four triangles of about `area` m² each: a ribbon of two quads that bends
/// downwards.
pub(super) fn spray(out: &mut ObjFile, base: DVec3, along: DVec3, normal: DVec3, area: f64) -> Result<()> {
    // The ribbon is three times as long as it is wide.
    let length = (12.0 * area).sqrt();
    let across = vlscan_geom::unit(along.cross(normal)) * (length / 6.0);
    let droop = DVec3::NEG_Z * (0.12 * length);
    let spine = [(base, 0.7), (base + along * (0.5 * length), 1.3), (base + along * length + droop, 0.7)];
    let mut below = [0; 2];
    for (i, (centre, width)) in spine.into_iter().enumerate() {
        let pair = [out.vertex(centre - across * width)?, out.vertex(centre + across * width)?];
        if i > 0 {
            out.face([below[0], below[1], pair[1], pair[0]])?;
        }
        below = pair;
    }
    Ok(())
}

/// Writes a bilinear patch between four corners (in order around it) with `columns` × `rows` quads; `offset`
/// is added to the point at (u, v) of the unit square.
pub(super) fn patch(
    out: &mut ObjFile,
    corners: [DVec3; 4],
    columns: u64,
    rows: u64,
    offset: impl Fn(f64, f64) -> DVec3,
) -> Result<()> {
    let [a, b, c, d] = corners;
    grid(out, rows, columns + 1, false, |row, column| {
        let (u, v) = (column as f64 / columns as f64, row as f64 / rows as f64);
        let (left, right) = (a + (d - a) * v, b + (c - b) * v);
        left + (right - left) * u + offset(u, v)
    })
}

/// The eight corners of a box with edge vectors `x`, `y`, `z` around `centre`: lower four counter-clockwise,
/// then upper four.
pub(super) fn box_corners(centre: DVec3, x: DVec3, y: DVec3, z: DVec3) -> [DVec3; 8] {
    let at = |i: f64, j: f64, k: f64| centre + x * i + y * j + z * k;
    let (l, h) = (-0.5, 0.5);
    [at(l, l, l), at(h, l, l), at(h, h, l), at(l, h, l), at(l, l, h), at(h, l, h), at(h, h, h), at(l, h, h)]
}

/// Corner indices of the six faces of a box, oriented outward.
pub(super) const BOX_FACES: [[usize; 4]; 6] =
    [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]];
