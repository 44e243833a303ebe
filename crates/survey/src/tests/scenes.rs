//! Scenes, filters, motions, swaps.

use super::*;
use vlscan_geom::{DVec3, Rotation, radians};

fn scene_in(files: &[(&str, &str)], content: &str) -> vlscan_base::Result<(SceneRecipe, Diagnostics)> {
    let folder = Folder::new(files);
    folder.write("scene.xml", &format!("<document>\n<scene id='s'>\n{content}\n</scene>\n</document>"));
    read_scene(&format!("{}#s", folder.path("scene.xml").display()), &ReadOptions::default())
}

fn scene_of(content: &str) -> vlscan_base::Result<(SceneRecipe, Diagnostics)> {
    let files = ["a.obj", "b1.obj", "b2.obj", "c.xyz", "v.vox", "m.mtl", "t.tif"].map(|name| (name, ""));
    scene_in(&files, content)
}

fn clean_scene(content: &str) -> SceneRecipe {
    let (scene, warnings) = scene_of(content).unwrap_or_else(|e| panic!("{}", report(&e)));
    assert!(warnings.is_empty(), "{}", warnings.render(false));
    scene
}

fn warned(content: &str) -> (SceneRecipe, String) {
    let (scene, warnings) = scene_of(content).unwrap_or_else(|e| panic!("{}", report(&e)));
    (scene, warnings.render(false))
}

fn param(kind: &str, key: &str, value: &str) -> String {
    format!("<param type='{kind}' key='{key}' value='{value}'/>")
}

fn filter(kind: &str, params: &str) -> String {
    format!("<filter type='{kind}'>{params}</filter>")
}

fn obj() -> String {
    filter("objloader", &param("string", "filepath", "a.obj"))
}

fn scale(factor: &str) -> String {
    filter("scale", &param("double", "scale", factor))
}

fn translate(offset: &str) -> String {
    filter("translate", &param("vec3", "offset", offset))
}

fn rotate(axis: &str, angle: &str) -> String {
    filter(
        "rotate",
        &format!("<param type='rotation' key='rotation'><rot axis='{axis}' angle_deg='{angle}'/></param>"),
    )
}

#[test]
fn transforms_accumulate_as_the_format_says() {
    // spec input-formats §3.3: rotations accumulate, the last scale and offset win, the order of different
    // kinds is irrelevant
    let part = [
        obj(),
        translate("9;9;9"),
        rotate("x", "30"),
        scale("3"),
        rotate("z", "60"),
        scale("0.5"),
        translate("1;+2;3"),
    ];
    let (scene, text) = warned(&format!("<part>{}</part>", part.concat()));
    contains(
        &text,
        &[
            "this scale replaces the one before, 3: they do not multiply",
            "one scale of 1.5",
            "this offset replaces the one before, 9;9;9: they do not add up",
            "one offset of 10;11;12",
        ],
    );
    let t = scene.parts[0].transform;
    assert_eq!((t.scale, t.offset, t.on_ground), (0.5, DVec3::new(1.0, 2.0, 3.0), 0));
    assert_eq!(t.rotation, Rotation::about_z(radians(60.0)).after(Rotation::about_x(radians(30.0))));
    let (scene, text) = warned(&format!("<part>{}{}{}</part>", scale("7"), obj(), scale("0")));
    assert_eq!(scene.parts[0].transform.scale, 1.0);
    contains(&text, &["filters before the loader have no effect", "a scale of 0 is ignored"]);
    let (scene, text) = warned(&format!("<part>{}{}</part>", obj(), scale("-1")));
    assert_eq!(scene.parts[0].transform.scale, -1.0);
    contains(&text, &["a scale of -1 mirrors the part"]);
    let (scene, text) = warned(&format!("<part>{}{}{}</part>", obj(), scale("7"), obj()));
    assert_eq!(scene.parts[0].transform, Transform::IDENTITY);
    contains(&text, &["a second loader replaces the first"]);
}

#[test]
fn parameters_of_other_types_are_read_all_the_same() {
    let ground = param("double", "onGround", "-1.0");
    let (scene, text) = warned(&format!(
        "<part>{}{}{}</part>",
        obj(),
        filter("SCALE", &param("int", "scale", "2")),
        filter("translate", &(param("vec", "offset", "1;2;3") + &ground))
    ));
    assert_eq!((scene.parts[0].transform.scale, scene.parts[0].transform.on_ground), (2.0, -1));
    contains(&text, &["`scale` is declared as `int`, it is read as `double`", "did you mean `vec3`?"]);
    for (wrong, message) in [
        (
            filter("scale", &param("double", "scale", "big")),
            "the parameter `scale` must be a number, found `big`",
        ),
        (filter("scale", ""), "the filter `scale` needs the parameter `scale`"),
        (filter("translate", &param("vec3", "offset", "1;2")), "must be three numbers with semicolons"),
        (filter("translate", &param("vec3", "offset", "1e13;2;3")), "within ±1e12"),
        (filter("rotate", ""), "needs the parameter `rotation`"),
        (filter("twist", ""), "unknown filter type `twist`"),
    ] {
        contains(&refused(scene_of(&format!("<part>{}{wrong}</part>", obj()))), &[message, "scene.xml:3:"]);
    }
    let (_, text) = warned(&format!(
        "<part>{}</part>",
        filter("objloader", &(param("string", "filepath", "a.obj") + &param("string", "Up", "y")))
    ));
    contains(&text, &["unknown parameter `Up` of `objloader`", "did you mean `up`?"]);
}

#[test]
fn ids_are_running_numbers_of_the_parts() {
    let group = filter("objloader", &param("string", "efilepath", r"b\d\.obj"));
    let scene = clean_scene(&format!(
        "<part>{0}</part><part id='x'>{group}</part><part id=''>{group}</part><part>{0}</part>",
        obj()
    ));
    let ids: Vec<_> = scene.parts.iter().map(|p| (p.id.as_deref(), p.number)).collect();
    // each file of a part without an id becomes a part
    assert_eq!(ids, [(None, 0), (Some("x"), 1), (None, 2), (None, 3), (None, 4)]);
    assert!(matches!(&scene.parts[1].loader, Loader::MeshFiles { files, .. } if files.len() == 2));
    assert!(
        matches!(&scene.parts[3].loader, Loader::MeshFiles { files, .. } if files[0].ends_with("b2.obj"))
    );
    let (scene, text) = warned(&format!("<part>{}</part><part>{}</part>", scale("2"), obj()));
    assert_eq!((scene.parts.len(), scene.parts[0].number), (1, 1));
    contains(&text, &["a part without a loader is skipped"]);
    contains(&refused(scene_of("<part/>")), &["a <part> needs a <filter>"]);
    contains(&refused(scene_of("")), &["the scene has no parts"]);
}

#[test]
fn obj_and_geotiff() {
    let up = |axis: &str| {
        filter("objloader", &(param("string", "filepath", "a.obj") + &param("string", "up", axis)))
    };
    let scene = clean_scene(&format!("<part>{}</part>", up("y")));
    assert!(matches!(
        scene.parts[0].loader,
        Loader::MeshFiles { reading: MeshReading { up: Some(UpAxis::Y), .. }, .. }
    ));
    let (_, text) = warned(&format!("<part>{}</part>", up("x")));
    contains(&text, &["expected y or z for the parameter `up`, found `x`; z is used"]);
    let tiff = filter(
        "geotiffloader",
        &(param("string", "filepath", "t.tif") + &param("string", "matfile", "m.mtl")),
    );
    let scene = clean_scene(&format!("<part>{tiff}</part>"));
    assert!(matches!(&scene.parts[0].loader, Loader::GeoTiff { material, .. } if material.file.is_some()));
    let missing = refused(scene_of(&format!(
        "<part>{}</part>",
        filter("geotiffloader", &param("string", "matfile", "no.mtl"))
    )));
    contains(&missing, &["cannot find the file `no.mtl`", "needs the parameter `filepath`"]);
}

#[test]
fn point_clouds() {
    let required = param("string", "filepath", "c.xyz")
        + &param("string", "separator", "")
        + &param("double", "voxelSize", "0");
    let read = |more: &str| {
        let (scene, text) =
            warned(&format!("<part>{}</part>", filter("xyzloader", &format!("{required}{more}"))));
        contains(&text, &["`voxelSize` is 0; cubes of 1 m are used"]);
        if more.contains("rgbGIndex") {
            contains(&text, &["`rgbGIndex` has no effect without `rgbRIndex`"]);
        }
        match scene.parts.into_iter().next().unwrap().loader {
            Loader::Xyz(xyz) => *xyz,
            other => panic!("{other:?}"),
        }
    };
    let plain = read("");
    assert_eq!((plain.voxel_size, plain.max_color_value, plain.estimate_normals), (1.0, 255.0, 0));
    assert_eq!((plain.separator.as_str(), plain.default_normal, plain.normal_columns), ("", None, None));
    let more = [
        param("vec3", "defaultNormal", "0;0;2"),
        param("int", "normalXIndex", "6"),
        param("integer", "normalZIndex", "9"),
        param("int", "rgbGIndex", "1"),
        param("boolean", "snapNeighborNormal", "1"),
        param("bool", "sparse", "false"),
        param("string", "matfile", "m.mtl"),
        param("int", "randomMaterials", "3"),
        param("double", "randomRange", "0.2"),
    ];
    let xyz = read(&more.concat());
    assert_eq!((xyz.default_normal, xyz.normal_columns), (Some(DVec3::Z), Some([6, 4, 9])));
    // colours take effect only when the first column is given
    assert_eq!((xyz.rgb_columns, xyz.snap_neighbor_normal), (None, true));
    assert_eq!((xyz.material.random_variants, xyz.material.random_range), (3, 0.2));
    let bare = refused(scene_of(&format!(
        "<part>{}</part>",
        filter("xyzloader", &param("string", "filepath", "c.xyz"))
    )));
    contains(&bare, &["needs the parameter `separator`", "needs the parameter `voxelSize`"]);
}

#[test]
fn detailed_voxels() {
    let read = |more: &str| {
        let params = param("string", "filepath", "v.vox") + more;
        let (scene, text) = warned(&format!("<part>{}</part>", filter("detailedvoxels", &params)));
        match scene.parts.into_iter().next().unwrap().loader {
            Loader::DetailedVoxels(voxels) => (voxels.mode, voxels.drop_empty, text),
            other => panic!("{other:?}"),
        }
    };
    let mode = |text: &str| param("string", "intersectionMode", text);
    assert_eq!(read(""), (VoxelMode::Transmittive, true, String::new()));
    assert_eq!(read(&mode("Transmittive")), (VoxelMode::Transmittive, false, String::new()));
    assert_eq!(read(&mode("SCALED")), (VoxelMode::Scaled(0.5), false, String::new()));
    let argument = param("double", "intersectionArgument", "0.7");
    assert_eq!(read(&(mode("scaled") + &argument)).0, VoxelMode::Scaled(0.7));
    let (other, dropped, text) = read(&mode("opaque"));
    assert_eq!((other, dropped), (VoxelMode::Transmittive, false));
    contains(
        &text,
        &["expected transmittive, fixed or scaled for the parameter `intersectionMode`, found `opaque`"],
    );
}

#[test]
fn motions() {
    let part = format!(
        "<part dynStep='5' kdtDynStep='2'>{}
          <dmotion id='go' loop='3' next='turn'><motion type='translation' vec='0;0.5;0' autoCRS='1'/></dmotion>
          <dmotion id='turn' loop='0' next='go'>
            <motion type='rotation' axis='0;0;2' angle='90' center='1;2;3' selfMode='true'/>
            <motion type='identity'/><motion type='reflection' ortho='3;0;0'/>
            <motion type='glideplane' ortho='0;1;0' shift='0.5;0;0.2'/>
            <motion type='helical' axis='0;0;1' angle='-1' glide='0.1'/><motion type='rotsym' axis='1;0;0' angle='5'/>
          </dmotion></part>",
        obj()
    );
    let scene = clean_scene(&part);
    let [go, turn] = &scene.parts[0].motions[..] else { panic!("two sequences") };
    assert_eq!((go.loops, go.next, turn.loops, turn.next, turn.motions.len()), (3, Some(1), 0, Some(0), 6));
    assert_eq!(
        (go.motions[0].kind, go.motions[0].auto_crs),
        (MotionKind::Translation { by: DVec3::new(0.0, 0.5, 0.0) }, 1.0)
    );
    let quarter = MotionKind::Rotation {
        axis: DVec3::Z,
        angle: radians(90.0),
        centre: Some(DVec3::new(1.0, 2.0, 3.0)),
    };
    assert_eq!((turn.motions[0].kind, turn.motions[0].about_self), (quarter, true));
    assert_eq!((scene.parts[0].timing.dyn_step, scene.parts[0].timing.tree_step), (5, 2));
    for (wrong, message) in [
        ("<dmotion id='a' loop='1'/>", "needs at least one <motion>"),
        (
            "<dmotion id='a' loop='1'><motion type='rotation' axis='0;0;0' angle='5'/></dmotion>",
            "`axis` must be a direction",
        ),
        ("<dmotion id='a'><motion type='identity'/></dmotion>", "<dmotion> needs the attribute `loop`"),
        (
            "<dmotion id='a' loop='1'><motion type='spin'/></dmotion>",
            "`type` must be identity, translation, rotation",
        ),
        (
            "<dmotion id='a' loop='1'><motion type='reflection' ortho='0;0;0'/></dmotion>",
            "`ortho` must be a direction",
        ),
        (
            "<dmotion id='a' loop='1'><motion type='glideplane' ortho='0;1;0' shift='0;1;0'/></dmotion>",
            "`shift` must be",
        ),
    ] {
        contains(&refused(scene_of(&format!("<part>{}{wrong}</part>", obj()))), &[message]);
    }
}

#[test]
fn motions_that_stand_still_or_end_are_pointed_out() {
    for still in [
        "type='rotation' axis='0.0;0;-0.0' angle='0.0' center='1;0;0'",
        // As a program writes it that rounds the axis to three digits.
        "type='rotation' axis='0.000;-0.000;0.000' angle='0.03956468' center='1;0;0'",
        "type='helical' axis='0;0;0' angle='-0.5' glide='3'",
    ] {
        let part = format!("<part>{}<dmotion id='a' loop='1'><motion {still}/></dmotion></part>", obj());
        // The same in several parts is told once.
        let (scene, text) = warned(&format!("{part}\n{part}\n{part}"));
        assert_eq!(scene.parts[2].motions[0].motions[0].kind, MotionKind::Identity);
        contains(&text, &["nothing moves", "^^^^^", "more digits", "also in line"]);
        assert_eq!(text.matches("nothing moves").count(), 1, "{text}");
    }
    let open = "<dmotion id='left' loop='3' next='rihgt'><motion type='identity'/></dmotion>\
                <dmotion id='right' loop='3'><motion type='identity'/></dmotion>";
    let (scene, text) = warned(&format!("<part>{}{open}</part>", obj()));
    assert_eq!(scene.parts[0].motions[0].next, None);
    contains(
        &text,
        &["there is no motion `rihgt` in this part, which stops after `left`", "did you mean `right`?"],
    );
}

#[test]
fn axes_named_after_attitudes_repeat_the_rotation_before() {
    let rotated = |rots: &str| {
        let rotate =
            format!("<filter type='rotate'><param type='rotation' key='rotation'>{rots}</param></filter>");
        let (scene, text) = warned(&format!("<part>{}{rotate}</part>", obj()));
        (scene.parts[0].transform.rotation, text)
    };
    let (none, text) = rotated("<rot axis='pitch' angle_deg='12.5'/><rot axis='yaw' angle_deg='33'/>");
    assert_eq!(none, Rotation::IDENTITY);
    contains(
        &text,
        &["the axis `pitch`", "it rotates nothing", "pitch is the rotation about x", "the axis `yaw`"],
    );
    let (twice, text) = rotated("<rot axis='z' angle_deg='30'/><rot axis='roll' angle_deg='5'/>");
    assert!((twice.angles_zyx().unwrap()[0] - radians(60.0)).abs() < 1e-12);
    contains(&text, &["it repeats the rotation before it", "roll is the rotation about y"]);
    let (once, _) = rotated("<rot axis='z' angle_deg='30'/><rot axis='roll' angle_deg='0'/>");
    assert_eq!(once, Rotation::about_z(radians(30.0)));
}

#[test]
fn swaps() {
    let ground = param("int", "onGround", "1");
    let scene = clean_scene(&format!(
        "<part>{0}{1}<swap swapStep='2' keepCRS='false'>{1}{2}</swap><swap force_null='true'/><swap>{0}</swap></part>",
        obj(),
        scale("2"),
        filter("translate", &(param("vec3", "offset", "1;2;3") + &ground)),
    ));
    let [a, b, c] = &scene.parts[0].swaps[..] else { panic!("three swaps") };
    assert_eq!(
        (a.epochs, a.keep_crs, a.vanish, a.scale, a.offset),
        (2, false, false, Some(2.0), Some((DVec3::new(1.0, 2.0, 3.0), 1)))
    );
    // the attribute takes effect by its presence; the scene shift is inherited
    assert!(b.vanish && b.loader.is_none() && !b.keep_crs && a.loader.is_none());
    assert!(c.loader.is_some() && c.scale.is_none() && c.offset.is_none());
    let (scene, text) = warned(&format!("<part>{0}<swap>{1}</swap></part>", obj(), rotate("x", "5")));
    assert_eq!(scene.parts[0].swaps.len(), 1);
    contains(&text, &["`rotate` has no effect in a <swap>"]);
    contains(
        &refused(scene_of(&format!("<part>{0}{0}<swap/></part>", obj()))),
        &["may have one loader only"],
    );
    contains(
        &refused(scene_of(&format!("<part>{0}<swap>{1}{0}</swap></part>", obj(), scale("2")))),
        &["must be the first filter"],
    );
    let motion = "<dmotion id='a' loop='1'><motion type='identity'/></dmotion>";
    let (scene, text) = warned(&format!("<part>{0}<swap/>{motion}</part>", obj()));
    assert!(scene.parts[0].swaps.is_empty());
    contains(&text, &["a moving part cannot be swapped"]);
}

#[test]
fn file_expressions() {
    let group = |expression: &str| {
        scene_of(&format!("<part>{}</part>", filter("objloader", &param("string", "efilepath", expression))))
    };
    contains(&refused(group("b(")), &["is not a valid regular expression"]);
    contains(&refused(group(r"z.*\.obj")), &["no file matches", "searched in"]);
}

#[test]
fn geometry_files_are_scenes_of_one_part() {
    let folder = Folder::new(&[("hill.obj", ""), ("scene.xml", "<document><scene id='a'/></document>")]);
    let (scene, _) = read_scene(&folder.path("hill.obj").to_string_lossy(), &ReadOptions::default()).unwrap();
    assert_eq!((scene.id.as_str(), scene.parts.len(), scene.parts[0].number), ("hill", 1, 0));
    assert_eq!(scene.asset_folders.last(), Some(&folder.0.path().to_path_buf()));
    // A raster is ground.
    let rasters = Folder::new(&[("dem.tif", "")]);
    let (scene, _) = read_scene(&rasters.path("dem.tif").to_string_lossy(), &ReadOptions::default()).unwrap();
    let material = &scene.parts[0].changes[0].material;
    assert_eq!((scene.parts.len(), material), (1, &crate::MaterialDefinition::soil()));
    contains(
        &refused(read_scene("nowhere.obj", &ReadOptions::default())),
        &["cannot find the file `nowhere.obj`"],
    );
    let empty = read_scene(&folder.path("scene.xml").to_string_lossy(), &ReadOptions::default());
    contains(&refused(empty), &["the scene has no parts"]);
}
