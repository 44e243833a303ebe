//! AMAPVox vegetation voxels (spec input-formats §4.5). Their header is in `header`, their columns are in
//! `layout`, and `cells` holds the properties of all cells of a file.

mod cells;
mod header;
mod layout;
#[cfg(test)]
mod tests;

use crate::builder::{PartSource, SceneBuilder};
use crate::load::voxel_store::VoxelStore;
use crate::number::float;
use crate::text::{Line, Lines, Problems, Source, Words, cut_into_pieces, is_empty_line, shown};
use crate::voxel::{Voxel, VoxelKind};
use cells::CellCheck;
use header::{Header, read_header};
use layout::Layout;
use rayon::prelude::*;
use std::ops::Range;
use vlscan_base::columns::comma_note;
use vlscan_base::diag::Place;
use vlscan_base::error::Result;
use vlscan_base::recognise::Expected;
use vlscan_base::rng::{Purpose, Stream};
use vlscan_geom::DVec3;
use vlscan_survey::{VoxelLoader, VoxelMode};
use vlscan_trace::GridPlace;

/// Bytes read by one task.
const PIECE_BYTES: usize = 1 << 20;

/// Maximum density of a part's file, for scaling its voxels.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Densities {
    /// The file's cubes, as indices in the scene.
    pub cubes: Range<usize>,
    /// PAD_max, the maximum plant area density, 1/m.
    pub largest: f64,
}

/// Appends the voxels of a file, without the part's transform and scaling. Returns the data for scaling;
/// `None` after an error.
pub(crate) fn load(
    scene: &mut SceneBuilder,
    part: &PartSource,
    source: &Source,
    loader: &VoxelLoader,
    (materials, keeps_grid): (&[u32], bool),
) -> Result<Option<Densities>> {
    if !source.is_text(&Expected::VOXELS, &mut scene.diagnostics) {
        return Ok(None);
    }
    let mut problems = Problems::default();
    let header = read_header(source, &mut problems);
    let is_valid = problems.report(source, &mut scene.diagnostics);
    let Some(header) = header.filter(|_| is_valid) else { return Ok(None) };
    let first = scene.geometry.cubes.len();
    let ((body, mut lines), mut cells) = (header.body, CellCheck::default());
    let text = &source.bytes()[body..];
    let mut problems = Problems::default();
    let width = first_row(source, body).map_or(0, |row| Words::new(&row.text, 0).count());
    let place = GridPlace::new(header.min_corner, header.resolution);
    let mut store = VoxelStore::new(place, header.split.map(|count| count as u32), keeps_grid);
    let mut at = 0;
    while at < text.len() {
        let wave = next_pieces(text, at);
        let read: Vec<Slice> =
            wave.par_iter().map(|piece| read_voxels(&text[piece.clone()], &header, width, loader)).collect();
        store.reserve(scene, read.iter().map(|s| s.voxels.len()).sum(), source.path())?;
        for (slice, piece) in read.into_iter().zip(&wave) {
            problems.append(slice.problems, lines, body + piece.start);
            lines += slice.lines;
            cells.append(slice.cells);
            slice.voxels.iter().for_each(|(cell, voxel)| store.push(scene, *cell, voxel));
        }
        let end = wave.last().map_or(text.len(), |piece| piece.end);
        // What has been read of a mapped file would count as memory.
        source.release(body + at..body + end);
        at = end;
    }
    let surfaces = scene.surfaces_in_turn(part.index, materials);
    store.finish(scene, surfaces)?;
    check_last_row(source, body, header.layout.count, &mut problems);
    check_columns(source, &header, loader.mode, &mut problems);
    if let Some(note) = cells.note() {
        scene.diagnostics.note(Some(Place::of_file(source.path())), note);
    }
    let end = source.bytes().len();
    cells.report(header.split, lines.max(1), end.saturating_sub(1)..end, &mut problems);
    let is_valid = problems.report(source, &mut scene.diagnostics);
    let cubes = first..scene.geometry.cubes.len();
    // Only cubes are scaled.
    let largest = header.max_density.unwrap_or_else(|| largest_density(&scene.voxels[cubes.clone()]));
    Ok(is_valid.then_some(Densities { cubes, largest }))
}

/// The next pieces of a text from byte `at` on, one or more for each thread.
fn next_pieces(text: &[u8], at: usize) -> Vec<Range<usize>> {
    let length = 4 * rayon::current_num_threads() * PIECE_BYTES;
    let rest = &text[at..];
    let end = match rest.get(length..).map(|behind| memchr::memchr(b'\n', behind)) {
        Some(Some(n)) => length + n + 1,
        _ => rest.len(),
    };
    let pieces = cut_into_pieces(&rest[..end], PIECE_BYTES);
    pieces.into_iter().map(|piece| at + piece.start..at + piece.end).collect()
}

/// A last line without a line end is truncated if it has fewer columns than the first row.
fn check_last_row(source: &Source, body: usize, named: usize, problems: &mut Problems) {
    let Some((number, at, text)) = source.unended_line().filter(|(_, at, _)| *at >= body) else { return };
    let columns = |line: &[u8]| Words::new(line, 0).count();
    let first = first_row(source, body).map_or(0, |l| columns(&l.text));
    let last = columns(text);
    if last >= named && last < first {
        problems.error(number, at..at + text.len(), || {
            format!("expected {first} columns as in the first row, found {last}; is the file truncated?")
        });
    }
}

/// The first line of voxels, with its place counted from there.
fn first_row(source: &Source, body: usize) -> Option<Line<'_>> {
    let is_row = |l: &Line| !is_empty_line(&l.text) && l.text.trim_ascii_start()[0] != b'#';
    Lines::new(&source.bytes()[body..], false).find(is_row)
}

/// Warns of columns without a name, and of a transmittance that is needed and missing.
fn check_columns(source: &Source, header: &Header, mode: VoxelMode, problems: &mut Problems) {
    let (body, lines) = header.body;
    let named = header.layout.count;
    if let Some(row) = first_row(source, body) {
        let found = Words::new(&row.text, 0).count();
        let start = body + row.start;
        if found > named && header.layout != Layout::UNNAMED {
            problems.warn(lines + row.number, start..start + row.text.len(), || {
                format!(
                    "the file names {named} columns and has {found}; the last {} are left out",
                    found - named
                )
            });
        }
    }
    if header.layout.transmittance.is_none() && mode != VoxelMode::Transmittive {
        problems.warn(lines, body.saturating_sub(1)..body.saturating_sub(1), || {
            "no column is named transmittance: no cell lets light through".to_owned()
        });
    }
}

fn largest_density(voxels: &[Voxel]) -> f64 {
    voxels.iter().map(|v| v.density).filter(|d| d.is_finite()).fold(0.0, f64::max)
}

#[derive(Default)]
struct Slice {
    /// Cells and attributes.
    voxels: Vec<([u32; 3], Voxel)>,
    problems: Problems,
    lines: usize,
    cells: CellCheck,
}

/// Reads the rows of a piece of a file whose first row has `width` values.
fn read_voxels(bytes: &[u8], header: &Header, width: usize, loader: &VoxelLoader) -> Slice {
    let mut slice = Slice::default();
    let mut lines = Lines::new(bytes, false);
    let mut words = Vec::new();
    for line in lines.by_ref() {
        if is_empty_line(&line.text) || line.text.trim_ascii_start()[0] == b'#' {
            continue;
        }
        let row = read_row(&line, &header.layout, &mut words);
        slice.cells.add(header.split, row.as_ref().ok().map(|row| (row.index, row.density)));
        if words.len() != width && row.is_ok() {
            slice.cells.add_other_width();
        }
        match row {
            Ok(row) if loader.drop_empty && row.density == 0.0 => {}
            Ok(row) => {
                let index = DVec3::from(row.index.map(f64::from));
                if index.cmpge(DVec3::from(header.split)).any() {
                    // The reference uses the lower corner only, so the position is well-defined.
                    slice.problems.warn(line.number, line.start..line.start + line.text.len(), || {
                        format!(
                            "the cell is outside of the header's #split of {}",
                            header::numbers_of(&header.split)
                        )
                    });
                }
                let voxel = Voxel::of_plants(row.density, kind(loader.mode, row.transmittance));
                slice.voxels.push((row.index, voxel));
            }
            Err((at, message)) => slice.problems.error(line.number, at, || message),
        }
    }
    slice.lines = lines.passed;
    slice
}

/// The interaction of rays with a voxel (spec pulse-physics §2.5).
fn kind(mode: VoxelMode, transmittance: f64) -> VoxelKind {
    match mode {
        VoxelMode::Transmittive => VoxelKind::Transmittive,
        VoxelMode::Fixed | VoxelMode::Scaled(_) if transmittance == 1.0 || transmittance.is_nan() => {
            VoxelKind::Transparent
        }
        VoxelMode::Fixed | VoxelMode::Scaled(_) => VoxelKind::Opaque,
    }
}

struct Row {
    index: [u32; 3],
    density: f64,
    transmittance: f64,
}

/// The voxel of a line; `words` is overwritten with its words.
fn read_row(
    line: &Line,
    layout: &Layout,
    words: &mut Vec<Range<usize>>,
) -> std::result::Result<Row, (Range<usize>, String)> {
    words.clear();
    words.extend(Words::new(&line.text, 0).map(|(_, at)| at));
    let at = |range: &Range<usize>| line.start + range.start..line.start + range.end;
    if words.len() < layout.count {
        let message = format!("expected at least {} columns, found {}", layout.count, words.len());
        return Err((line.start..line.start + line.text.len(), message));
    }
    let value = |column: usize, name: &str, is_valid: fn(f64) -> bool| {
        let range = &words[column];
        let word = &line.text[range.clone()];
        float(word).filter(|v| is_valid(*v)).ok_or_else(|| {
            let (found, number) = (shown(word), column + 1);
            let hint = comma_note(&found);
            (at(range), format!("expected {name} in column {number}, found \"{found}\"{hint}"))
        })
    };
    let index = |column| {
        let is_index = |v: f64| v.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&v);
        value(column, "a cell number, 0 or greater,", is_index).map(|v| v as u32)
    };
    Ok(Row {
        index: [index(layout.index[0])?, index(layout.index[1])?, index(layout.index[2])?],
        density: value(layout.density, "a density, 0 or greater or NaN,", |v| {
            v.is_nan() || (v >= 0.0 && v.is_finite())
        })?,
        transmittance: layout
            .transmittance
            .map_or(Ok(0.0), |column| value(column, "a transmittance", |_| true))?,
    })
}

/// Applies `scaled` to voxels after the part's transform: the edge is multiplied by (PAD/PAD_max)^exponent,
/// and with `random_shift` the cube gets a random position within the original one. A voxel without density
/// (NaN) has no size and is removed.
pub(crate) fn scale_by_density(
    scene: &mut SceneBuilder,
    files: &[Densities],
    exponent: f64,
    random_shift: Option<u32>,
) {
    let Some(first) = files.first().map(|f| f.cubes.start) else { return };
    let shifts = Stream::new(scene.options.seed, Purpose::VoxelShift);
    for file in files {
        let cubes = scene.geometry.cubes[file.cubes.clone()].par_iter_mut();
        let numbered = cubes.zip(&scene.voxels[file.cubes.clone()]).enumerate();
        numbered.for_each(|(i, (cube, voxel))| {
            let half = cube.half * libm::pow(voxel.density / file.largest, exponent);
            if let Some(part) = random_shift {
                let number = (file.cubes.start - first + i) as u64;
                let u = |axis| 2.0 * shifts.uniform(part, number, axis) - 1.0;
                let by = DVec3::new(u(0), u(1), u(2)) * (cube.half - half);
                if by.is_finite() {
                    cube.centre += by;
                }
            }
            cube.half = half;
        });
    }
    scene.retain_cubes(first, |cube| cube.half.is_finite());
}
