//! Tests of complete voxel files.

use super::*;
use crate::fixture::Fixture;
use crate::{LadTable, Scene};
use vlscan_base::diag::{Diagnostic, Severity};
use vlscan_survey::{Loader, MaterialChoice};

const HEADER: &str = "VOXEL SPACE\n#min_corner: 0 0 0\n#max_corner: 100 1 2\n#split: 200 2 4\n#res:0.5 #type:TLS \
    #max_pad:4.0\ni j k PadBVTotal angleMean a b c d e f g h transmittance l m\n";

fn row(index: [u32; 3], density: &str, transmittance: &str) -> String {
    let [i, j, k] = index;
    format!("{i} {j} {k} {density} 54.2 0.4 0.1 0.6 1.25 0.3 12.5 7 60 {transmittance} 0.9 0.0\n")
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
    let (scene, found) = f.load().unwrap();
    // Cells without a density are usual in voxels of measurements.
    let is_note = |d: &Diagnostic| d.severity == Severity::Note;
    assert!(found.items().iter().all(is_note), "{}", found.text());
    scene
}

#[test]
fn the_example_file_has_one_voxel() {
    let text = format!("{HEADER}{}", row([0, 0, 2], "1.3", "0.72"));
    let (mut f, loader) = fixture(&text, VoxelMode::Transmittive);
    let scene = load(&mut f, loader);
    assert_eq!(scene.to_world(scene.geometry.cubes[0].centre), DVec3::new(0.25, 0.25, 1.25));
    assert_eq!(scene.geometry.cubes[0].half, 0.25);
    assert_eq!(scene.voxel(0).unwrap(), Voxel::of_plants(1.3, VoxelKind::Transmittive));
    assert_eq!(*scene.material_of(0), crate::Material::unnamed("default", Default::default()));
}

#[test]
fn empty_voxels_are_dropped_only_when_the_mode_is_not_spelled_out() {
    let text = format!("{HEADER}{}\n# note\n{}", row([0, 0, 0], "0", "1"), row([1, 0, 0], "NaN", "NaN"))
        .replace("#max_corner: 100 1 2\n#split: 200 2 4", "#max_corner: 1 0.5 0.5\n#split: 2 1 1");
    let (mut f, mut loader) = fixture(&text, VoxelMode::Transmittive);
    assert_eq!(load(&mut f, loader.clone()).voxels.len(), 2);
    loader.drop_empty = true;
    let scene = load(&mut f, loader);
    assert!(scene.voxels.len() == 1 && scene.voxels[0].density.is_nan());
}

#[test]
fn fixed_voxels_stop_rays_unless_they_transmit_all() {
    let rows: String = (0..).zip(["1", "NaN", "0.99", "0"]).map(|(i, t)| row([i, 0, 1], "1", t)).collect();
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
    assert_eq!(load(&mut f, loader).geometry.cubes[0].half, 0.25, "the largest density is that of the file");
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
    part.transform.rotation = vlscan_geom::Rotation::about_z(std::f64::consts::FRAC_PI_2);
    part.transform.offset = DVec3::new(10.0, 0.0, 0.0);
    let scene = f.scene();
    let centre = scene.to_world(scene.geometry.cubes[0].centre);
    assert!((centre - DVec3::new(9.75, 0.25, 0.25)).length() < 1e-12);
    assert_eq!(scene.geometry.cubes[0].half, 0.125);
}

const START: &str = "VOXEL SPACE\n#min_corner:(0.0, 0.0, 0.0)\n#max_corner:(2.0, 2.0, 2.0)\n#res:(1.0, 1.0, 1.0)\n\
    #split:(2, 2, 2)\n#max_pad:5.0\n";

/// The first voxel of a file with these columns, in opaque mode, and the warnings.
fn first_voxel(columns: &str, row: &str) -> (Voxel, usize) {
    let (mut f, loader) = fixture(&format!("{START}{columns}\n{row}\n"), VoxelMode::Fixed);
    f.part(Loader::DetailedVoxels(Box::new(loader)));
    let (scene, warnings) = f.load().unwrap();
    (scene.voxel(0).unwrap(), warnings.items().len())
}

#[test]
fn columns_are_found_by_their_names() {
    // The orders of AMAPVox 1.6, 1.8 and 2.
    for (columns, row) in [
        (
            "i j k PadBVTotal angleMean bsEntering bsIntercepted bsPotential ground_distance lMeanTotal lgTotal nbEchos \
             nbSampling transmittance attenuation attenuationBiasCorrection",
            "1 0 0 1.5 57 1 0 1 0.5 0.5 50 0 100 1 0 0",
        ),
        (
            "i j k ground_distance nbEchos nbSampling lgTotal lMeanTotal sdLength angleMean bsPotential bsEntering \
             bsIntercepted transmittance PadBVTotal attenuation distLaser",
            "1 0 0 0.5 0 100 50 0.5 0.1 57 1 1 0 1 1.5 0 5",
        ),
        ("\"i\" \"j\" \"k\" \"transmittance\" \"pad_capped\"", "1 0 0 1 1.5"),
    ] {
        let found = first_voxel(columns, row);
        assert_eq!(found, (Voxel::of_plants(1.5, VoxelKind::Transparent), 0), "{columns}");
    }
    assert_eq!(first_voxel("k j i pad", "0 0 1 1.5"), (Voxel::of_plants(1.5, VoxelKind::Opaque), 1));
    assert_eq!(first_voxel("k j i pad transmittance", "0 0 1 1.5 1 7").1, 1);
}

#[test]
fn files_without_a_density_are_refused_and_unnamed_columns_warned_of() {
    for (columns, row, expected) in [
        ("i j k transmittance attenuation_FPL_unbiasedMLE", "0 0 0 1 0.3", "PadBVTotal); plantAreaDensity"),
        ("i j k pad_a pad_b", "0 0 0 1 2", "no column of plant area density"),
        ("i k PadBVTotal", "0 0 1", "no column of cells (j)"),
        ("i j k pad", "0 0 0", "at least 4 columns, found 3"),
        ("i j k pad", "0 0 0 1,5", "a decimal comma"),
    ] {
        let (mut f, loader) = fixture(&format!("{START}{columns}\n{row}\n"), VoxelMode::Transmittive);
        f.part(Loader::DetailedVoxels(Box::new(loader)));
        let report = f.error();
        assert!(report.contains(expected) && report.contains("a.vox:"), "{columns}: {report}");
    }
    let row = "1 0 0 1.5 57 1 0 1 0.5 0.5 50 0 100 1 0 0";
    assert_eq!(first_voxel("made by hand", row), (Voxel::of_plants(1.5, VoxelKind::Transparent), 1));
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

/// The warnings, or the error, of a file.
fn said(text: &str) -> String {
    let (mut f, loader) = fixture(text, VoxelMode::Transmittive);
    f.part(Loader::DetailedVoxels(Box::new(loader)));
    match f.load() {
        Ok((_, warnings)) => warnings.text(),
        Err(vlscan_base::Error::Input(problems)) => problems.text(),
        Err(e) => panic!("{e}"),
    }
}

#[test]
fn headers_that_contradict_themselves_or_the_cells_are_reported() {
    let rows: String = (0..8).map(|n| format!("{} {} {} 1.5\n", n / 4, n / 2 % 2, n % 2)).collect();
    let file = format!("{START}i j k PadBVTotal\n{rows}");
    assert_eq!(said(&file), "");
    for (from, to, expected) in [
        (
            "#min_corner:(0.0, 0.0, 0.0)",
            "#min_corner: -2,5 -2 0",
            "3 numbers after \"#min_corner:\", found \"-2,5 -2 0\"; a comma",
        ),
        ("#min_corner:(0.0, 0.0, 0.0)", "#min_corner: 0 0 0 7", "found \"0 0 0 7\""),
        ("#split:(2, 2, 2)", "#split: 2 2", "expected 3 numbers after \"#split:\""),
        ("#split:(2, 2, 2)", "#split: 2 2 2.5", "whole numbers of cells"),
        ("#split:(2, 2, 2)", "#split: 2 2 0", "whole numbers of cells"),
        ("#split:(2, 2, 2)", "#split: 2 2 3", "#max_corner is not where"),
        ("#split:(2, 2, 2)", "#split: 2 2 3", "the file has 8 of the 12 cells of #split"),
        ("#res:(1.0, 1.0, 1.0)", "#res: 0,5", "1 or 3 numbers after \"#res:\""),
        ("#max_pad:5.0", "#max_pad: 5 6", "1 number after \"#max_pad:\""),
        ("#max_pad:5.0", "#max_pad: 5 #max_pad: 6", "#max_pad is given twice"),
        ("#max_corner:(2.0, 2.0, 2.0)", "#max_corner: 9 9 9", "#max_corner is not where"),
        ("0 1 1 1.5\n", "0 1 1 nan\n", "1 cell has no density"),
        ("0 1 1 1.5\n", "0 1 1 1e30\n", "1 cell has a density above 1000"),
        ("0 1 1 1.5\n", "0 1 1 1.5 7\n", "1 row has more or fewer values"),
        ("1 1 0 1.5\n1 1 1 1.5\n", "", "the file has 6 of the 8 cells of #split; the others are empty"),
        ("1 1 1 1.5\n", "1 1 1 1.5\n1 1 1 1.5\n", "the file has 9 of the 8 cells"),
        ("1 1 1 1.5\n", "1 1 0 1.5\n", "1 row has the cell of the row before"),
        ("1 1 1 1.5\n", "0 0 0 1.5\n", "some cells occur twice, and others are missing"),
        ("k PadBVTotal", "k PadBVTotaq", "\"padbvtotaq\" is read as plant area density"),
    ] {
        assert!(file.contains(from), "{from}");
        let found = said(&file.replacen(from, to, 1));
        assert!(found.contains(expected), "{to}: {found}");
    }
    // Files may list only the cells with plants.
    assert_eq!(said(&format!("{START}i j k PadBVTotal\n0 1 0 2\n1 1 1 2\n")), "");
}
