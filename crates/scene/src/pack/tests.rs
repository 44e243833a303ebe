//! Tests of packed scenes against their sources.

use super::*;
use crate::fixture::Fixture;
use crate::texture::tests::png_of;
use crate::{LoadOptions, MotionPlan, Scene, SceneFrame, Sharing, load_epoch};
use vlscan_geom::DVec3;
use vlscan_survey::{Loader, Motion, MotionKind, MotionSequence, Swap, VoxelLoader, VoxelMode};
use vlscan_survey::{MaterialChoice, SceneRecipe, XyzLoader};
use vlscan_trace::{BuildOptions, Builder};

const MESH: &str = "mtllib m.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 2 3 4\n";
const VOXELS: &str = "VOXEL SPACE\n#min_corner: 5 5 5\n#max_corner: 6 6 6\n#split: 2 2 2\n#res:0.5 #max_pad:4.0\ni j k PadBVTotal a b c d e f g h n transmittance m l\n\
    0 0 1 1.5 54.2 0.4 0.1 0.6 1.25 0.3 12.5 7 60 0.5 0.9 0.0\n1 0 1 2.5 54.2 0.4 0.1 0.6 1.25 0.3 12.5 7 60 0.5 0.9 0.0\n";

/// A fixture with every feature of a scene except instances.
fn everything() -> Fixture {
    let mut f = Fixture::new();
    f.file("m.mtl", "newmtl m\nKd .5 .5 .5\nKs .25 .25 .25\nhelios_spectra moss\nhelios_classification -3\n");
    let header = "h\n".repeat(26);
    f.file("spectra/moss.txt", format!("{header}0.5\t10\n1.5\t30\n"));
    f.obj("a.obj", MESH).id = Some("tree \u{e4}".to_owned());
    let turn = MotionKind::Rotation { axis: DVec3::Z, angle: 0.25, centre: Some(DVec3::X) };
    let motions = vec![Motion { kind: turn, about_self: true, auto_crs: 0.5 }];
    f.obj("b.obj", MESH).motions = vec![MotionSequence { id: "m".into(), loops: 3, next: Some(0), motions }];
    let lad_table = Some(f.file("l.txt", "0,0,1,0.5\n1,0,0,0.25\n"));
    let files = vec![f.file("v.vox", VOXELS)];
    f.part(Loader::DetailedVoxels(Box::new(VoxelLoader {
        files,
        mode: VoxelMode::Scaled(0.5),
        drop_empty: false,
        random_shift: true,
        lad_table,
        material: MaterialChoice::default(),
    })));
    f
}

fn packed(f: &Fixture, recipe: &SceneRecipe) -> std::path::PathBuf {
    let path = f.path().join("s.vlscene");
    pack(recipe, &f.options, &BuildOptions::default(), &path, &|_| Ok(())).unwrap();
    path
}

/// Everything in a scene that affects tracing and output, as text.
fn seen(scene: &Scene) -> String {
    let set = scene.instances.as_ref().map(|p| (&p.instances, &p.materials, &p.parts));
    format!(
        "{:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {set:?} {:?}",
        scene.shift,
        scene.bounds,
        scene.geometry,
        scene.surface_ids,
        scene.surfaces,
        scene.parts,
        scene.materials,
        scene.voxels,
        scene.moving_parts,
        (scene.dyn_step, scene.dyn_time_step),
        MotionPlan::new(scene, 100.0)
    )
}

#[test]
fn a_packed_scene_is_the_scene() {
    let f = everything();
    let scene = f.load().unwrap().0;
    let pack = Pack::open(&packed(&f, &f.recipe())).unwrap();
    let again = pack.scene(&f.options, 0).unwrap();
    assert_eq!(seen(&again), seen(&scene));
    assert_eq!((again.packed_sizes, scene.packed_sizes), (Some(scene.sizes()), None));
    assert!(scene.materials.iter().any(|m| (m.reflectance - 21.28).abs() < 0.01), "{:?}", scene.materials);
    pack.verify().unwrap();
    for builder in [Builder::Bvh, Builder::Median] {
        let options = BuildOptions::of(builder);
        let (ours, theirs) = (again.tree(&options), scene.tree(&options));
        assert_eq!(ours.statistics(), theirs.statistics(), "{builder:?}");
    }
}

/// The colours of all primitives of a scene, of triangles at their centroids.
fn colours(scene: &Scene) -> Vec<[u8; 3]> {
    let colour = |i: u32| {
        let corners = scene.triangle(i);
        let at = corners.map_or(DVec3::ZERO, |[a, b, c]| (a + b + c) / 3.0);
        scene.colour_at(i, corners, at)
    };
    (0..scene.primitives() as u32).map(colour).collect()
}

#[test]
fn colours_are_packed_and_read_only_if_they_are_requested() {
    let mut f = Fixture::new();
    f.options.colours = true;
    f.options.sharing = Sharing::Always;
    f.file("t.png", png_of(2, 1, &[200, 10, 20, 30, 220, 40]));
    f.file("m.mtl", "newmtl m\nKd 1 1 1\nmap_Kd t.png\nhelios_reflectance 0.5\n");
    let square = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 0.4 0\nvt 0.6 1\nvt 1 1\n\
                  usemtl m\nf 1/1 2/2 4/1\nf 2/3 3/4 4/4\n";
    f.obj("a.obj", square);
    let tinted = "mtllib m.mtl\nv 5 0 0 1 0 0\nv 6 0 0 0 1 0\nv 5 1 0 0 0 1\nusemtl m\nf 1 2 3\n";
    for x in 0..3 {
        f.obj("b.obj", tinted).transform.offset = DVec3::X * f64::from(x);
    }
    let cloud = f.file("c.xyz", "20 0 0 250 240 230\n21 0 0 0 100 0\n");
    f.part(Loader::Xyz(Box::new(XyzLoader {
        files: vec![cloud],
        separator: " ".to_owned(),
        voxel_size: 1.0,
        max_color_value: 255.0,
        default_normal: None,
        rgb_columns: Some([3, 4, 5]),
        normal_columns: None,
        snap_neighbor_normal: false,
        estimate_normals: 0,
        material: MaterialChoice::default(),
    })));
    let scene = f.load().unwrap().0;
    let expected = colours(&scene);
    assert!(expected.contains(&[200, 10, 20]) && expected.contains(&[30, 220, 40]), "{expected:?}");
    // Both points are in one voxel.
    assert!(expected.contains(&[125, 170, 115]), "{expected:?}");
    assert!(scene.instances.is_some());
    let path = packed(&f, &f.recipe());
    let pack = Pack::open(&path).unwrap();
    pack.verify().unwrap();
    let again = pack.scene(&f.options, 0).unwrap();
    assert_eq!(colours(&again), expected);
    let plain = LoadOptions { colours: false, ..f.options.clone() };
    let without = pack.scene(&plain, 0).unwrap();
    assert!(without.colours.is_none() && pack.has_colours(0));
    assert_eq!(seen(&without), seen(&again));
    // A pack without colours: points are black, with a warning.
    let recipe = f.recipe();
    let bare = f.path().join("bare.vlscene");
    super::pack(&recipe, &plain, &BuildOptions::default(), &bare, &|_| Ok(())).unwrap();
    let recipe = SceneRecipe { packed: Some(bare), ..recipe };
    let (scene, warnings) = load_epoch(&recipe, &f.options, 0, None).unwrap();
    assert!(colours(&scene).iter().all(|colour| *colour == [0; 3]));
    assert!(warnings.text().contains("packed without colours"), "{}", warnings.text());
}

#[test]
fn mirrors_and_panes_are_packed() {
    let mut f = Fixture::new();
    f.file("m.mtl", "newmtl m\nvlscan_pane_index 1.5\nvlscan_pane_sheets 2\n");
    f.obj("a.obj", MESH);
    let scene = f.scene();
    assert!(scene.materials[0].optics.is_some());
    let pack = Pack::open(&packed(&f, &f.recipe())).unwrap();
    let again = pack.scene(&f.options, 0).unwrap();
    assert_eq!(again.materials, scene.materials);
    assert_eq!(seen(&again), seen(&scene));
}

#[test]
fn parts_without_primitives_are_left_out_of_packs_too() {
    let mut f = everything();
    let empty = |f: &mut Fixture, name: &str| {
        let files = vec![f.file(name, VOXELS.replace("1.5 54", "0 54").replace("2.5 54", "0 54"))];
        f.part(Loader::DetailedVoxels(Box::new(VoxelLoader {
            files,
            mode: VoxelMode::Transmittive,
            drop_empty: true,
            random_shift: false,
            lad_table: None,
            material: MaterialChoice::default(),
        })));
    };
    empty(&mut f, "middle.vox");
    f.obj("c.obj", MESH);
    empty(&mut f, "last.vox");
    let (scene, warnings) = f.load().unwrap();
    assert_eq!(warnings.text().matches("is left out").count(), 2);
    assert!(scene.surfaces.iter().all(|surface| (surface.part as usize) < scene.parts.len()));
    let pack = Pack::open(&packed(&f, &f.recipe())).unwrap();
    assert_eq!(seen(&pack.scene(&f.options, 0).unwrap()), seen(&scene));
    pack.verify().unwrap();
}

#[test]
fn a_pack_that_cannot_be_opened_gets_no_name() {
    use vlscan_base::store::{ArrayFile, ArrayFileWriter};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.vlscene");
    let out = ArrayFileWriter::create(&path).unwrap();
    let refused = out.finish_checked(|file| {
        assert!(ArrayFile::open(file).is_ok() && !path.exists());
        Err(vlscan_base::Error::Internal("unusable".to_owned()))
    });
    assert!(refused.is_err());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn instances_and_every_play_are_packed() {
    let mut f = Fixture::new();
    f.options.sharing = Sharing::Always;
    for x in 0..5 {
        f.obj("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").transform.offset = DVec3::X * f64::from(x);
    }
    let scene = f.load().unwrap().0;
    let pack = Pack::open(&packed(&f, &f.recipe())).unwrap();
    assert!(scene.instances.is_some());
    assert_eq!(seen(&pack.scene(&f.options, 0).unwrap()), seen(&scene));
    pack.verify().unwrap();

    let swap =
        Swap { epochs: 2, keep_crs: true, vanish: false, loader: None, scale: Some(2.0), offset: None };
    f.parts[1].swaps = vec![swap.clone()];
    // Later epochs have other models, which come first.
    let other = f.obj("b.obj", "v 0 0 0\nv 9 0 0\nv 0 9 0\nf 1 2 3\n").loader.clone();
    f.parts.pop();
    f.parts[0].swaps = vec![Swap { loader: Some(other), scale: None, ..swap }];
    let recipe = f.recipe();
    let pack = Pack::open(&packed(&f, &recipe)).unwrap();
    assert_eq!(pack.epochs(), 3);
    let first = load_epoch(&recipe, &f.options, 0, None).unwrap().0;
    for epoch in 0..3 {
        let stand = (epoch > 0).then(|| SceneFrame::of(&first));
        let scene = load_epoch(&recipe, &f.options, epoch, stand).unwrap().0;
        assert_eq!(seen(&pack.scene(&f.options, epoch).unwrap()), seen(&scene), "epoch {epoch}");
    }
}

#[test]
fn a_scene_whose_sources_changed_is_refused() {
    let f = everything();
    let path = packed(&f, &f.recipe());
    let changed = || Pack::open(&path).map(drop).unwrap_err().to_string();
    for file in ["a.obj", "m.mtl", "spectra/moss.txt", "l.txt", "v.vox"] {
        let before = std::fs::read(f.path().join(file)).unwrap();
        f.file(file, [&before[..], b"\n"].concat());
        assert!(changed().contains(file), "{file}: {}", changed());
        f.file(file, before);
        Pack::open(&path).unwrap_or_else(|e| panic!("{file} is as it was: {e}"));
    }
    let other = MESH.replace("v 1 0 0", "v 2 0 0");
    f.file("a.obj", other);
    assert!(changed().contains("a.obj"), "of the same length");
    std::fs::remove_file(f.path().join("a.obj")).unwrap();
    Pack::open(&path).unwrap_or_else(|e| panic!("packs may travel without their sources: {e}"));
}

#[test]
fn conditions_count_where_they_matter() {
    let f = everything();
    let pack = Pack::open(&packed(&f, &f.recipe())).unwrap();
    let refused = |change: fn(&mut LoadOptions)| {
        let mut options = f.options.clone();
        change(&mut options);
        pack.scene(&options, 0).unwrap_err().to_string()
    };
    assert!(refused(|o| o.wavelength_nm = 905.0).contains("905 nm"));
    assert!(refused(|o| o.seed = 5).contains("seed"));
    assert!(
        refused(|o| o.rules.specular_shares = true)
            .contains("read for --physics helios, but this run has other corrections")
    );
    assert!(
        refused(|o| o.rules.reflectance_fraction = true).contains("but this run has other corrections"),
        "there is a spectrum"
    );
    assert!(refused(|o| o.max_memory = Some(100)).contains("the limit is 100 B"));
    let mut plain = Fixture::new();
    plain.obj("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    let pack = Pack::open(&packed(&plain, &plain.recipe())).unwrap();
    let other = LoadOptions { wavelength_nm: 905.0, seed: 5, ..plain.options.clone() };
    pack.scene(&other, 0).unwrap();
}

#[test]
fn a_changed_byte_is_found_when_the_scene_is_opened() {
    let f = everything();
    let path = packed(&f, &f.recipe());
    let whole = std::fs::read(&path).unwrap();
    let open = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        Pack::open(&path)?.scene(&f.options, 0)
    };
    open(&whole).unwrap();
    for at in (0..whole.len()).step_by(7) {
        let mut bytes = whole.clone();
        bytes[at] ^= 1 << (at % 8);
        // Every time, also after another opening has failed.
        for _ in 0..2 {
            assert!(open(&bytes).is_err(), "byte {at}");
        }
        assert!(open(&whole[..at]).is_err(), "cut at {at}");
    }
}

#[test]
fn a_loaded_scene_stays_what_it_was() {
    let f = everything();
    let path = packed(&f, &f.recipe());
    let scene = Pack::open(&path).unwrap().scene(&f.options, 0).unwrap();
    let before = seen(&scene);
    // In place: the file that was opened is the one that changes.
    let length = std::fs::metadata(&path).unwrap().len();
    let file = std::fs::File::options().write(true).open(&path).unwrap();
    std::io::Write::write_all(&mut &file, &vec![0xff; length as usize]).unwrap();
    file.set_len(0).unwrap();
    assert_eq!(seen(&scene), before);
}
