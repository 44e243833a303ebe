//! AMAPVox vegetation voxels (spec input-formats §4.5).

use super::builder::{MAX_COORDINATE, PartSource, SceneBuilder};
use super::number::float;
use super::text::{Line, Lines, Problems, Source, Words, cut_into_pieces, is_empty_line, shown};
use super::voxel::{Voxel, VoxelKind};
use crate::error::Result;
use crate::geom::DVec3;
use crate::rng::{Purpose, Stream};
use crate::survey::{VoxelLoader, VoxelMode};
use crate::tree::Cube;
use rayon::prelude::*;
use std::ops::Range;

/// Number of columns of a voxel that the format always has.
const COLUMNS: usize = 16;
const DENSITY: usize = 3;
const TRANSMITTANCE: usize = 13;

/// Bytes read by one task.
const PIECE_BYTES: usize = 1 << 20;

/// The header of a file.
#[derive(Debug, PartialEq)]
struct Header {
    min_corner: DVec3,
    resolution: f64,
    /// Number of cells along x, y, z.
    split: [f64; 3],
    max_density: Option<f64>,
    /// Start of the voxels: bytes and lines before them.
    body: (usize, usize),
}

/// Maximum density of a part's file, for scaling its voxels.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Densities {
    /// The file's cubes, as indices in the scene.
    pub cubes: Range<usize>,
    /// PAD_max, the maximum plant area density, 1/m.
    pub largest: f64,
}

/// Appends the voxels of a file, without the part's transform and scaling. Returns the data for scaling; `None` after
/// an error.
pub(super) fn load(
    scene: &mut SceneBuilder,
    part: &PartSource,
    source: &Source,
    loader: &VoxelLoader,
    materials: &[u32],
) -> Result<Option<Densities>> {
    if !source.is_text("a voxel file", &mut scene.diagnostics) {
        return Ok(None);
    }
    let mut problems = Problems::default();
    let header = read_header(source, &mut problems);
    let is_sound = problems.report(source, &mut scene.diagnostics);
    let Some(header) = header.filter(|_| is_sound) else { return Ok(None) };
    let first = scene.geometry.cubes.len();
    let ((body, mut lines), mut rows) = (header.body, 0);
    let text = &source.bytes()[body..];
    let mut problems = Problems::default();
    for wave in cut_into_pieces(text, PIECE_BYTES).chunks(4 * rayon::current_num_threads()) {
        let read: Vec<Slice> =
            wave.par_iter().map(|piece| read_voxels(&text[piece.clone()], &header, loader)).collect();
        scene.reserve(0, 0, read.iter().map(|s| s.cubes.len()).sum(), source.path())?;
        for (slice, piece) in read.into_iter().zip(wave) {
            problems.append(slice.problems, lines, body + piece.start);
            lines += slice.lines;
            rows += slice.rows;
            scene.geometry.cubes.extend(slice.cubes);
            scene.voxels.extend(slice.voxels);
        }
        source.release(body + wave[0].start..body + wave[wave.len() - 1].end);
    }
    scene.check_counts()?;
    check_last_row(source, body, &mut problems);
    if rows == 0 {
        let end = source.bytes().len();
        problems.error(lines.max(1), end.saturating_sub(1)..end, || "expected voxels, found none".to_owned());
    }
    let is_sound = problems.report(source, &mut scene.diagnostics);
    let cubes = first..scene.geometry.cubes.len();
    scene.assign_materials_in_turn(part.index, materials, cubes.len());
    let largest = header.max_density.unwrap_or_else(|| largest_density(&scene.voxels[cubes.clone()]));
    Ok(is_sound.then_some(Densities { cubes, largest }))
}

/// A last line without a line end is truncated if it has fewer columns than the first row.
fn check_last_row(source: &Source, body: usize, problems: &mut Problems) {
    let Some((number, at, text)) = source.unended_line().filter(|(_, at, _)| *at >= body) else { return };
    let columns = |line: &[u8]| Words::new(line, 0).count();
    let is_row = |l: &Line| !is_empty_line(&l.text) && l.text.trim_ascii_start()[0] != b'#';
    let first = Lines::new(&source.bytes()[body..], false).find(is_row).map_or(0, |l| columns(&l.text));
    let last = columns(text);
    if last >= COLUMNS && last < first {
        problems.error(number, at..at + text.len(), || {
            format!("expected {first} columns as in the first row, found {last}; is the file whole?")
        });
    }
}

fn largest_density(voxels: &[Voxel]) -> f64 {
    voxels.iter().map(|v| v.density).filter(|d| d.is_finite()).fold(0.0, f64::max)
}

/// Reads everything before the voxels: fields, and the two lines that are neither fields nor blank.
fn read_header(source: &Source, problems: &mut Problems) -> Option<Header> {
    let mut fields = Fields::default();
    let mut titles = 0;
    let mut lines = Lines::new(source.bytes(), false);
    let mut end = None;
    for line in lines.by_ref() {
        let text = line.text.trim_ascii_start();
        if text.is_empty() {
            continue;
        }
        if text[0] == b'#' {
            fields.read(&line, problems);
        } else if titles == 2 {
            end = Some((line.start, line.number - 1));
            break;
        } else {
            titles += 1;
        }
    }
    let end = end.unwrap_or((source.bytes().len(), lines.passed));
    let mut required = |value: Option<Vec<f64>>, name: &str, count: usize| {
        let value = value.filter(|v| v.len() >= count);
        if value.is_none() {
            problems.error(1, 0..0, || format!("the header lacks \"#{name}\" with {count} numbers"));
        }
        value
    };
    let corner = required(fields.min_corner, "min_corner:", 3);
    required(fields.max_corner, "max_corner:", 3);
    let split = required(fields.split, "split:", 3);
    let size = required(fields.resolution, "res:", 1)?;
    if size[0] <= 0.0 || size.iter().any(|s| *s != size[0]) {
        problems.error(1, 0..0, || format!("expected cubes of a size above 0 as #res, found {size:?}"));
    }
    let (corner, split) = (corner?, split?);
    let split = [split[0], split[1], split[2]];
    let min_corner = DVec3::new(corner[0], corner[1], corner[2]);
    let max_density = fields.max_density.and_then(|v| v.first().copied());
    Some(Header { min_corner, resolution: size[0], split, max_density, body: end })
}

#[derive(Default)]
struct Fields {
    min_corner: Option<Vec<f64>>,
    max_corner: Option<Vec<f64>>,
    split: Option<Vec<f64>>,
    resolution: Option<Vec<f64>>,
    max_density: Option<Vec<f64>>,
}

impl Fields {
    /// Parses a header line with one or more fields `#name: values`.
    fn read(&mut self, line: &Line, problems: &mut Problems) {
        for field in line.text.split(|&b| b == b'#') {
            let Some(colon) = field.iter().position(|&b| b == b':') else { continue };
            let slot = match &field[..colon] {
                b"min_corner" => &mut self.min_corner,
                b"max_corner" => &mut self.max_corner,
                b"split" => &mut self.split,
                b"res" => &mut self.resolution,
                b"max_pad" => &mut self.max_density,
                _ => continue,
            };
            let words = field[colon + 1..].split(|b| b" \t\r,()".contains(b)).filter(|w| !w.is_empty());
            let values: Option<Vec<f64>> =
                words.map(|w| float(w).filter(|v| v.abs() <= MAX_COORDINATE)).collect();
            match values {
                Some(values) => *slot = Some(values),
                None => problems.error(line.number, line.start..line.start + line.text.len(), || {
                    format!("expected numbers after \"#{}\"", shown(&field[..=colon]))
                }),
            }
        }
    }
}

#[derive(Default)]
struct Slice {
    cubes: Vec<Cube>,
    voxels: Vec<Voxel>,
    problems: Problems,
    lines: usize,
    rows: usize,
}

fn read_voxels(bytes: &[u8], header: &Header, loader: &VoxelLoader) -> Slice {
    let mut slice = Slice::default();
    let mut lines = Lines::new(bytes, false);
    for line in lines.by_ref() {
        if is_empty_line(&line.text) || line.text.trim_ascii_start()[0] == b'#' {
            continue;
        }
        slice.rows += 1;
        match read_row(&line) {
            Ok(row) if loader.drop_empty && row.density == 0.0 => {}
            Ok(row) => {
                let index = DVec3::from(row.index.map(f64::from));
                if index.cmpge(DVec3::from(header.split)).any() {
                    // The reference uses the lower corner only, so the position is well-defined.
                    slice.problems.warn(line.number, line.start..line.start + line.text.len(), || {
                        format!("the cell lies outside of the header's #split of {:?}", header.split)
                    });
                }
                let centre = header.min_corner + (index + 0.5) * header.resolution;
                slice.cubes.push(Cube { centre, half: 0.5 * header.resolution });
                slice.voxels.push(Voxel::of_plants(row.density, kind(loader.mode, row.transmittance)));
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

fn read_row(line: &Line) -> std::result::Result<Row, (Range<usize>, String)> {
    let words: Vec<(&[u8], Range<usize>)> = Words::new(&line.text, 0).collect();
    let at = |range: &Range<usize>| line.start + range.start..line.start + range.end;
    if words.len() < COLUMNS {
        let message = format!("expected at least {COLUMNS} columns, found {}", words.len());
        return Err((line.start..line.start + line.text.len(), message));
    }
    let value = |column: usize, name: &str, is_valid: fn(f64) -> bool| {
        let (word, range) = &words[column];
        float(word).filter(|v| is_valid(*v)).ok_or_else(|| {
            (at(range), format!("expected {name} in column {}, found \"{}\"", column + 1, shown(word)))
        })
    };
    let index = |column| {
        let is_index = |v: f64| v.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&v);
        value(column, "a cell number, 0 or greater,", is_index).map(|v| v as u32)
    };
    Ok(Row {
        index: [index(0)?, index(1)?, index(2)?],
        density: value(DENSITY, "a density, 0 or greater or NaN,", |v| {
            v.is_nan() || (v >= 0.0 && v.is_finite())
        })?,
        transmittance: value(TRANSMITTANCE, "a transmittance", |_| true)?,
    })
}

/// Applies `scaled` to voxels after the part's transform: the edge is multiplied by (PAD/PAD_max)^exponent, and with
/// `random_shift` the cube gets a random position within the original one. A voxel without density (NaN) has no size
/// and is removed.
pub(super) fn scale_by_density(
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::fixture::Fixture;
    use crate::scene::{LadTable, Scene};
    use crate::survey::{Loader, MaterialChoice};

    const HEADER: &str = "VOXEL SPACE\n#min_corner: 0 0 0\n#max_corner: 100 1 2\n#split: 200 2 4\n#res:0.5 #type:TLS \
        #max_pad:4.0\ni j k PadBVTotal and so on\n";

    fn row(index: [u32; 3], density: &str, transmittance: &str) -> String {
        let [i, j, k] = index;
        format!("{i} {j} {k} {density} 54.2 0.4 0.1 0.6 1.25 0.3 12.5 7 60 {transmittance} 0.9 0.0 extra 7\n")
    }

    fn loader(file: std::path::PathBuf, mode: VoxelMode) -> VoxelLoader {
        VoxelLoader {
            files: vec![file],
            mode,
            drop_empty: false,
            random_shift: false,
            lad_table: None,
            material: MaterialChoice::default(),
        }
    }

    fn fixture(text: &str, mode: VoxelMode) -> (Fixture, VoxelLoader) {
        let f = Fixture::new();
        let file = f.file("a.vox", text);
        (f, loader(file, mode))
    }

    fn load(f: &mut Fixture, loader: VoxelLoader) -> Scene {
        f.parts.clear();
        f.part(Loader::DetailedVoxels(Box::new(loader)));
        f.scene()
    }

    #[test]
    fn the_example_file_has_one_voxel() {
        let text = format!("{HEADER}{}", row([0, 0, 2], "1.3", "0.72"));
        let (mut f, loader) = fixture(&text, VoxelMode::Transmittive);
        let scene = load(&mut f, loader);
        assert_eq!(scene.to_world(scene.geometry.cubes[0].centre), DVec3::new(0.25, 0.25, 1.25));
        assert_eq!(scene.geometry.cubes[0].half, 0.25);
        assert_eq!(*scene.voxel(0).unwrap(), Voxel::of_plants(1.3, VoxelKind::Transmittive));
        assert_eq!(*scene.material_of(0), crate::scene::Material::unnamed("default", Default::default()));
    }

    #[test]
    fn empty_voxels_are_dropped_only_when_the_mode_is_not_spelled_out() {
        let text = format!("{HEADER}{}\n# note\n{}", row([0, 0, 0], "0", "1"), row([1, 0, 0], "NaN", "NaN"));
        let (mut f, mut loader) = fixture(&text, VoxelMode::Transmittive);
        assert_eq!(load(&mut f, loader.clone()).voxels.len(), 2);
        loader.drop_empty = true;
        let scene = load(&mut f, loader);
        assert!(scene.voxels.len() == 1 && scene.voxels[0].density.is_nan());
    }

    #[test]
    fn fixed_voxels_stop_rays_unless_they_transmit_all() {
        let rows: String = ["1", "NaN", "0.99", "0"].iter().map(|t| row([0, 0, 1], "1", t)).collect();
        let (mut f, loader) = fixture(&format!("{HEADER}{rows}"), VoxelMode::Fixed);
        let kinds: Vec<VoxelKind> = load(&mut f, loader).voxels.iter().map(|v| v.kind()).collect();
        use VoxelKind::{Opaque, Transparent};
        assert_eq!(kinds, [Transparent, Transparent, Opaque, Opaque]);
    }

    #[test]
    fn scaled_voxels_shrink_by_density_in_place() {
        let text = format!("{HEADER}{}{}", row([0, 0, 0], "1", "0"), row([1, 1, 1], "nan", "0"));
        let (mut f, loader) = fixture(&text, VoxelMode::Scaled(0.5));
        let scene = load(&mut f, loader);
        // spec pulse-physics §2.8 (f) with PAD/PAD_max = 1/4
        assert_eq!(scene.geometry.cubes.len(), 1, "a voxel without density has no size");
        assert!((scene.geometry.cubes[0].half - 0.125).abs() < 1e-15);
        assert_eq!((scene.voxels.len(), scene.surface_ids.len()), (1, 1));
        let (mut f, loader) = fixture(&text.replace("#max_pad:4.0", ""), VoxelMode::Scaled(0.5));
        assert_eq!(
            load(&mut f, loader).geometry.cubes[0].half,
            0.25,
            "the largest density is that of the file"
        );
    }

    #[test]
    fn random_shifts_stay_within_the_cell_and_depend_on_the_seed() {
        let rows: String = (0..200).map(|i| row([i, 0, 0], "1", "0")).collect();
        let (mut f, mut loader) = fixture(&format!("{HEADER}{rows}"), VoxelMode::Scaled(0.5));
        loader.random_shift = true;
        let centres =
            |scene: &Scene| scene.geometry.cubes.iter().map(|c| scene.to_world(c.centre)).collect::<Vec<_>>();
        let first = centres(&load(&mut f, loader.clone()));
        for (i, c) in first.iter().enumerate() {
            let by = *c - DVec3::new(0.25 + 0.5 * i as f64, 0.25, 0.25);
            assert!(by.abs().max_element() <= 0.125 + 1e-12 && by != DVec3::ZERO);
        }
        assert_eq!(centres(&load(&mut f, loader.clone())), first);
        f.options.seed = 2;
        assert_ne!(centres(&load(&mut f, loader)), first);
    }

    #[test]
    fn scale_shrinks_cubes_in_place_and_rotation_moves_centres() {
        let text = format!("{HEADER}{}", row([0, 0, 0], "1", "0"));
        let (mut f, loader) = fixture(&text, VoxelMode::Fixed);
        let part = f.part(Loader::DetailedVoxels(Box::new(loader)));
        part.transform.scale = 0.5;
        part.transform.rotation = crate::geom::Rotation::about_z(std::f64::consts::FRAC_PI_2);
        part.transform.offset = DVec3::new(10.0, 0.0, 0.0);
        let scene = f.scene();
        let centre = scene.to_world(scene.geometry.cubes[0].centre);
        assert!((centre - DVec3::new(9.75, 0.25, 0.25)).length() < 1e-12);
        assert_eq!(scene.geometry.cubes[0].half, 0.125);
    }

    #[test]
    fn randomised_materials_alternate() {
        let rows: String = (0..6).map(|i| row([i, 0, 0], "1", "0")).collect();
        let (mut f, mut loader) = fixture(&format!("{HEADER}{rows}"), VoxelMode::Fixed);
        loader.material = MaterialChoice {
            file: Some(f.file("m.mtl", "newmtl leaf\nKd .5 .5 .5\nKs .5 .5 .5\nhelios_reflectance 40\n")),
            random_variants: 2,
            random_range: 0.4,
            name: None,
        };
        let scene = load(&mut f, loader);
        assert_eq!(scene.surface_ids, vec![0, 1, 2, 0, 1, 2].into());
        assert_ne!(scene.material_of(1).reflection, scene.material_of(2).reflection);
    }

    #[test]
    fn the_leaf_angle_table_belongs_to_the_part() {
        let text = format!("{HEADER}{}", row([0, 0, 0], "1", "0"));
        let (mut f, mut loader) = fixture(&text, VoxelMode::Transmittive);
        loader.lad_table = Some(f.file("s.lut", "1,0,0,0.5\n0,0,1,0.25\n"));
        let scene = load(&mut f, loader.clone());
        assert_eq!(scene.parts[0].lad.as_deref().map(|l| l.g(DVec3::Z)), Some(0.25));
        assert_eq!(LadTable::new([(DVec3::Z, 1.0)]).unwrap().g(DVec3::X), 1.0);
        loader.lad_table = Some(f.path().join("gone.lut"));
        f.parts.clear();
        f.part(Loader::DetailedVoxels(Box::new(loader)));
        assert!(f.error().contains("gone.lut"));
    }

    #[test]
    fn mistakes_are_errors_with_their_lines() {
        let bad = "0 0 0 1 2 3\n0 0 -1 1 0 0 0 0 0 0 0 0 0 1 0 0\n0 0 0 x 0 0 0 0 0 0 0 0 0 1 0 0\n0 0 0 -1 0 0 0 0 0 0 0 0 0 1 0 0\n";
        let (mut f, loader_) = fixture(&format!("{HEADER}{bad}"), VoxelMode::Fixed);
        f.part(Loader::DetailedVoxels(Box::new(loader_)));
        let report = f.error();
        for place in ["a.vox:7:1", "a.vox:8:5", "a.vox:9:7", "a.vox:10:7"] {
            assert!(report.contains(place), "{place} is missing from {report}");
        }
        for text in ["", "VOXEL SPACE\n", "#res: x\n", "\u{0}\u{1}", &HEADER.replace("#res:0.5", "#res:0")] {
            let (mut f, loader) = fixture(text, VoxelMode::Fixed);
            f.part(Loader::DetailedVoxels(Box::new(loader)));
            f.error();
        }
    }
}
