"""Scenes of files and arrays, materials, instances, patterns of one's own."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

import vlscan
from conftest import FIXTURES
from vlscan import Material, Part, Scene

DOWN = np.array([[0.0, 0.0, -1.0]])


def square(z=0.0, size=1.0):
    corners = [[-size, -size, z], [size, -size, z], [size, size, z], [-size, size, z]]
    return corners, [[0, 1, 2, 3]]


def heights(scene, origins, directions=DOWN, **options):
    """Heights of the first echoes of narrow beams."""
    scanner = vlscan.Scanner("riegl_vz400", accuracy_m=0, beam_divergence_rad=1e-4)
    directions = np.broadcast_to(directions, np.shape(origins))
    return vlscan.trace(scene, origins, directions, scanner=scanner, **options).points


def test_a_pattern_of_ones_own_hits_what_geometry_says():
    origins = np.array([[0.5, 0.25, 10.0], [0.1, 0.9, 20.0], [5.0, 5.0, 10.0]])
    points = heights([Part.mesh(*square())], origins, np.broadcast_to(DOWN, (3, 3)), time=[1.0, 2.0, 3.0])
    assert len(points) == 2 and np.allclose(points.xyz, [[0.5, 0.25, 0], [0.1, 0.9, 0]], atol=0.01)
    assert points["GpsTime"].tolist() == [1.0, 2.0] and points["PulseNumber"].tolist() == [1, 2]
    missed = heights([Part.mesh(*square())], origins, misses=True)
    assert missed["NumberOfReturns"].tolist() == [1, 1, 0]


def test_materials_belong_to_faces():
    vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 0]]
    faces = [[0, 1, 2, 3], [1, 4, 5, 2]]
    materials = [Material("soil", reflectance=0.2, classification=2), Material("roof", reflectance=0.8, classification=6)]
    scene = Scene([Part.mesh(vertices, faces, materials, [1, 0])])
    points = heights(scene, [[0.5, 0.4, 10], [1.5, 0.4, 10]])
    assert points["Classification"].tolist() == [6, 2]
    assert points["Amplitude"][0] == pytest.approx(4 * points["Amplitude"][1])
    assert scene.materials == {"soil": (0.2, 2), "roof": (0.8, 6)} and scene.primitives == 4


def test_materials_of_parts_are_replaced():
    vertices, faces = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]]
    part = Part.mesh(vertices, faces, Material("leaf", classification=1))
    bark = Material("bark", classification=2)
    for changed, expected in [
        (part, [1, 1]),
        (part.with_material(bark), [2, 2]),
        (part.with_material(bark, of="leaf"), [2, 2]),
        (part.with_material(bark, of="wood"), [1, 1]),
        (part.with_material(bark, of=[1]), [2, 1]),
    ]:
        points = heights([changed], [[0.2, 0.7, 10], [0.7, 0.2, 10]])
        assert points["Classification"].tolist() == expected


def strip(count=4):
    """Squares in a row along x, and a beam into both triangles of each."""
    vertices = [[x, y, 0] for x in range(count + 1) for y in (0, 1)]
    faces = np.array([[2 * i, 2 * i + 2, 2 * i + 3, 2 * i + 1] for i in range(count)])
    return vertices, faces, [[i + x, y, 10] for i in range(count) for x, y in [(0.7, 0.2), (0.2, 0.7)]]


ROOF = Material("roof", classification=6)


def test_indices_of_quadrilaterals_are_those_of_the_faces_given():
    vertices, faces, above = strip()
    part = Part.mesh(vertices, faces)
    for of in ([1, 3], np.array([3, 1, 1]), np.array([False, True, False, True])):
        points = heights([part.translate(0, 0, 1).with_material(ROOF, of=of)], above)
        assert points["Classification"].tolist() == [0, 0, 6, 6, 0, 0, 6, 6]


def test_indices_count_faces_without_area(tmp_path):
    vertices, faces, above = strip()
    triangles = faces[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    triangles = np.insert(triangles, [0, 3, 3], [5, 5, 6], axis=0)
    file = tmp_path / "strip.obj"
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in triangles]
    file.write_text("\n".join(lines) + "\n")
    for part in (Part.mesh(vertices, triangles), Part.obj(file)):
        for index, hit in [(1, 0), (3, 2), (6, 3), (10, 7)]:
            with pytest.warns(vlscan.VlscanWarning, match="3 triangles without area"):
                points = heights([part.with_material(ROOF, of=[index])], above)
            assert np.flatnonzero(points["Classification"]).tolist() == [hit]
        with pytest.warns(vlscan.VlscanWarning):
            points = heights([part.with_material(ROOF, of=[0, 4, 5])], above)
        assert not points["Classification"].any()


def test_indices_count_the_faces_of_a_file(tmp_path):
    vertices, faces, above = strip()
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + ["f " + " ".join(str(corner + 1) for corner in face) for face in faces]
    (tmp_path / "strip.obj").write_text("\n".join(lines) + "\n")
    part = Part.file(tmp_path / "strip.obj")
    for index in range(4):
        points = heights([part.with_material(ROOF, of=[index])], above)
        assert np.flatnonzero(points["Classification"]).tolist() == [2 * index, 2 * index + 1]
    with pytest.raises(vlscan.InputError, match="face 4, but the part has 4"):
        Scene([part.with_material(ROOF, of=[4])]).load()


def test_odd_indices_of_faces_are_refused():
    vertices, faces, above = strip()
    part = Part.mesh(vertices, faces)
    for of, message in [
        ([-1], "-1 to -1, expected 0 to 3"), ([0, 4], "0 to 4"), ([0.5], "indices of faces"), ([[1]], "indices of faces"),
        ([True, False], "one per face"), (np.ones(8, bool), "one per face"),
    ]:  # fmt: skip
        with pytest.raises(ValueError, match=message):
            part.with_material(ROOF, of=of)
    assert not heights([part.with_material(ROOF, of=[])], above)["Classification"].any()
    tree = Part.obj(FIXTURES / "forest/beech.obj")
    with pytest.raises(ValueError, match="mask"):
        tree.with_material(ROOF, of=[True])
    with pytest.raises(vlscan.InputError, match="face 4000000, but the part has"):
        Scene([tree.with_material(ROOF, of=[4_000_000])]).load()


def test_materials_are_checked():
    assert replace(Material(), spectrum="grass").reflectance is None
    for wrong in (
        {"reflectance": 1.5}, {"reflectance": float("nan")}, {"reflectance": -0.1}, {"roughness_deg": 91}, {"classification": 256},
        {"classification": -1}, {"mirror": 1.1}, {"pane_index": 0.9}, {"pane_thickness_m": -0.1}, {"pane_sheets": 3}, {"retro": -1},
        {"water_index": 0}, {"water_secchi_m": 0}, {"water_attenuation": -1}, {"water_wind_m_s": float("nan")},
    ):  # fmt: skip
        with pytest.raises(ValueError, match=f"{next(iter(wrong))} of the material 'a' is"):
            Material("a", **wrong)
    scene = Scene([Part.mesh(*square(), materials=Material("plain"))])
    assert scene.materials["plain"] == (0.5, 0)


def test_parts_stand_where_they_are_put():
    part = Part.mesh(*square(), id="lid")
    up = part.translate(0, 0, 1).rotate((0, 1, 0), 180)
    scene = Scene([part.scale(10), part.translate(20, 0, 3).named("far"), up.translate(-20, 0, 0)])
    points = heights(scene, [[0, 0, 10], [9.5, 9.5, 10], [20.5, 0.5, 10], [-20.5, 0.5, 10]])
    assert np.allclose(points["Z"], [0, 0, 3, -1], atol=0.01)
    assert scene.parts == ["lid", "far", "lid"]
    assert scene.bounds.tolist() == [[-21, -10, -1], [21, 10, 3]]


def test_parts_drop_to_the_ground():
    ground = Part.mesh(*square(z=2.0, size=50), materials=Material("soil", is_ground=True))
    box = Part.mesh(*square(z=10.0)).translate(3, 3, 0).drop_to_ground()
    scene = Scene([ground, box])
    assert scene.ground_height(20, 20) == pytest.approx(2) and scene.ground_height(500, 0) is None
    assert scene.bounds[1, 2] == pytest.approx(2)


def test_copies_share_their_mesh():
    grid = np.stack(np.meshgrid(np.arange(50.0), np.arange(50.0)), -1).reshape(-1, 2)
    vertices = np.column_stack([grid, np.sin(grid[:, 0])])
    corner = (np.arange(49)[:, None] * 50 + np.arange(49)).reshape(-1)
    faces = np.column_stack([corner, corner + 1, corner + 51, corner + 50])
    part = Part.mesh(vertices, faces)
    parts = [part.translate(50 * i, 0, 0) for i in range(100)]
    stored = Scene(parts).load(instances="never")
    shared = Scene(parts).load(instances="always")
    assert shared.primitives == stored.primitives == 100 * 2 * 49 * 49
    assert shared.memory < stored.memory / 20
    origins = np.random.default_rng(1).uniform((0, 0, 10), (4500, 49, 20), (2000, 3))
    a, b = (heights(scene, origins, instances=how) for scene, how in [(stored, "never"), (shared, "always")])
    assert len(a) > 1000 and np.allclose(a.xyz, b.xyz, atol=1e-9)


def test_a_scene_is_loaded_once(tmp_path):
    scene = Scene([Part.mesh(*square())])
    assert not scene.is_loaded
    heights(scene, [[0, 0, 5]])
    assert scene.is_loaded
    file = tmp_path / "a.obj"
    file.write_text("v -1 -1 0\nv 1 -1 0\nv 0 1 0\nf 1 2 3\n")
    scene = Scene([Part.obj(file)])
    first = heights(scene, [[0, 0, 5]])
    file.unlink()
    again = heights(scene, [[0, 0, 5]], seed=5, threads=1)
    assert len(first) == 1 and np.allclose(first.xyz, again.xyz, atol=0.01)
    scene.unload()
    with pytest.raises(vlscan.InputError, match="a.obj"):
        heights(scene, [[0, 0, 5]])
    assert not scene.is_loaded


def test_files_are_scenes():
    scene = Scene(FIXTURES / "forest/scene.xml")
    assert scene.primitives > 100 and len(scene.parts) > 3 and len(scene.sample(1000)) > 900
    parts = [Part.file(FIXTURES / "forest/ground.obj"), Part.obj(FIXTURES / "forest/beech.obj").translate(5, 5).drop_to_ground()]
    assert len(Scene(parts).parts) == 2
    voxels = Scene([Part.voxels(FIXTURES / "voxels/crown.vox")])
    assert voxels.primitives > 10
    with pytest.raises(vlscan.InputError, match="cannot find"):
        Scene("nowhere.obj")
    with pytest.raises(ValueError, match="ends in"):
        Part.file("a.e57")


def test_mesh_files_of_any_format_are_parts(tmp_path):
    facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 100 0 0\nvertex 0 200 50\nendloop\nendfacet\n"
    (tmp_path / "a.stl").write_text(f"solid a\n{facet}endsolid a\n")
    corners = "0 0 0\n100 0 0\n0 200 50\n"
    header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    (tmp_path / "a.ply").write_text(header + f"element face 1\nproperty list uchar int vertex_indices\nend_header\n{corners}3 0 1 2\n")
    for name in ("a.stl", "a.ply"):
        assert Scene([Part.file(tmp_path / name)]).bounds.tolist() == [[0, 0, 0], [100, 200, 50]]
        turned = Scene([Part.mesh_file(tmp_path / name, up="y", unit="cm")])
        assert np.allclose(turned.bounds, [[0, -0.5, 0], [1, 0, 2]])
        assert np.allclose(Scene([Part.file(tmp_path / name, unit=2)]).bounds[1], [200, 400, 100])
    with pytest.raises(ValueError, match="unit is"):
        Scene([Part.mesh_file(tmp_path / "a.stl", unit="furlong")])
    with pytest.raises(ValueError, match="up is"):
        Part.file(tmp_path / "a.stl", up="x")
    for odd in (b"", b"ply\nformat ascii 1.0\nelement vertex 999999999999\nproperty float x\nend_header\n", b"solid\nvertex nan"):
        for name in ("b.stl", "b.ply", "b.glb", "b.gltf"):
            (tmp_path / name).write_bytes(odd)
            with pytest.raises(vlscan.Error):
                Scene([Part.file(tmp_path / name)]).load()


def test_meshes_of_other_libraries():
    class Mesh:
        vertices, faces = square()

    assert Scene([Part.of(Mesh())]).primitives == 2
    with pytest.raises(TypeError, match="no vertices"):
        Part.of(3)


def test_pulses_of_a_survey_can_be_traced_again(room):
    first = vlscan.run(room, pulses=True, seed=2)
    scene = Scene(FIXTURES / "room/scene.xml")
    scanner = vlscan.Scanner(str(FIXTURES / "room/scanners.xml"))
    points = vlscan.trace(scene, pulses=first.pulses, scanner=scanner, seed=2).points
    assert abs(len(points) - len(first.points)) < len(points) / 100


def test_pictures_and_pages(tmp_path):
    scene = Scene(FIXTURES / "forest/scene.xml")
    points = scene.sample(5000)
    assert points.png(width=400, height=300)[:4] == b"\x89PNG" and "<canvas" in points.html("class")
    assert "<img" in points._repr_html_() and "primitives" in scene._repr_html_()
    points.save_preview(tmp_path / "a.png", width=400, height=300)
    points.save_preview(tmp_path / "a.html", "class")
    assert (tmp_path / "a.png").stat().st_size > 1000 and (tmp_path / "a.html").stat().st_size > 10_000
    with pytest.raises(ValueError, match="png or .html"):
        points.save_preview(tmp_path / "a.jpg")
    assert not (tmp_path / "a.jpg").exists()
    with pytest.raises(ValueError, match="height, class"):
        points.png("colour")


def test_rays_are_cast_without_an_instrument():
    low = [[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]]
    floor = vlscan.Part.mesh(low, [[0, 1, 2, 3]], id="floor")
    scene = vlscan.Scene([floor, floor.translate(1000, 0, 2).named("shelf")])
    hits = scene.cast([[0, 1, 5], [1000, 1, -5], [99, 0, 5], [0, 0, 5]], [[0, 0, -3], [0, 0, 1], [0, 0, -1], [0, 0, 0]])
    assert hits.distance[:2].tolist() == [5, 7] and np.isnan(hits.distance[2:]).all()
    assert [scene.parts[part] if part >= 0 else None for part in hits.part] == ["floor", "shelf", None, None]
    assert hits.primitive[:2].min() >= 0 and hits.primitive[2:].tolist() == [-1, -1]
    assert np.allclose(hits.normal[:2], [[0, 0, 1], [0, 0, -1]]) and np.isnan(hits.normal[2:]).all()
    assert scene.cast(np.zeros((0, 3)), np.zeros((0, 3))).distance.shape == (0,)
    with pytest.raises(ValueError, match="n by 3"):
        scene.cast([[0, 0]], [[0, 0, 1]])


def test_primitives_are_arrays_in_the_world():
    floor = Part.mesh(*square(size=9.0), id="floor")
    scene = Scene([floor, floor.translate(1000, 0, 2).named("shelf")])
    whole, shelf = scene.geometry(), scene.geometry("shelf")
    assert whole.vertices.shape == (8, 3) and whole.triangles.shape == (4, 3) and whole.vertices.dtype == np.float64
    assert np.array_equal(shelf.vertices.min(axis=0), [991, -9, 2]) and np.array_equal(shelf.vertices.max(axis=0), [1009, 9, 2])
    assert shelf.primitive.tolist() == [2, 3] and shelf.part.tolist() == [1, 1] and whole.part.tolist() == [0, 0, 1, 1]
    assert shelf.voxel_centres.shape == (0, 3) and len(shelf.voxel_edges) == 0
    # A part of them is the same scene.
    again = Scene(Part.mesh(whole.vertices, whole.triangles))
    assert np.array_equal(again.bounds, scene.bounds) and again.primitives == 4
    assert np.array_equal(scene.geometry(-1).vertices, shelf.vertices)
    with pytest.raises(ValueError, match="no part has the id 'roof'; there are floor, shelf"):
        scene.geometry("roof")
    with pytest.raises(IndexError, match="index of a part is 2, and there are 2 parts"):
        scene.geometry(2)


def test_numbers_of_primitives_are_those_of_points_and_rays():
    scene = Scene(FIXTURES / "forest/scene.xml")
    geometry = scene.geometry()
    assert geometry.primitive.tolist() == list(range(scene.primitives))
    points = vlscan.run(FIXTURES / "forest/survey.xml", seed=1, columns=["Part", "Primitive"]).points
    assert np.array_equal(geometry.part[points["Primitive"]], points["Part"])
    corners = geometry.vertices[geometry.triangles]
    hits = scene.cast(corners.mean(axis=1) + [0, 0, 1e-3], DOWN)
    near = np.flatnonzero((hits.primitive == geometry.primitive) & (hits.distance < 0.01))
    assert len(near) > 100
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[near]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert np.allclose(np.abs((normals * hits.normal[near]).sum(axis=1)), 1)


def test_voxels_have_centres_and_edges(tmp_path):
    (tmp_path / "cloud.xyz").write_text("0.5 0.5 0.5\n2.5 0.5 0.5\n2.6 0.4 0.5\n")
    geometry = Scene(Part.points(tmp_path / "cloud.xyz", voxel_size=1.0).translate(10, 0, 0)).geometry()
    assert geometry.voxel_edges.tolist() == [1, 1] and geometry.triangles.shape == (0, 3)
    distance = np.diff(np.sort(geometry.voxel_centres[:, 0]))
    assert np.allclose(distance, 2) and geometry.voxel_centres[:, 0].min() > 9 and geometry.part.tolist() == [0, 0]


def test_instances_have_triangles_of_their_own():
    tree = Part.mesh(*square())
    parts = [tree.translate(x, 0, 0).named(f"tree {x}") for x in (0, 10, 20)]
    stored, shared = Scene(parts).load(instances="never").geometry(), Scene(parts).load(instances="always").geometry()
    assert shared.primitive.tolist() == [0, 1, 2, 3, 4, 5] and shared.part.tolist() == [0, 0, 1, 1, 2, 2]
    assert len(shared.vertices) == len(stored.vertices) == 12 and np.array_equal(shared.part, stored.part)
    assert np.allclose(stored.vertices[stored.triangles], shared.vertices[shared.triangles])


def test_rays_of_threads_and_of_one_are_the_same():
    random = np.random.default_rng(1)
    scene = vlscan.Scene(FIXTURES / "forest/ground.obj")
    low, high = scene.bounds
    origins = np.column_stack([random.uniform(low[:2], high[:2], (40_000, 2)), np.full(40_000, high[2] + 10)])
    down = (0.1, 0, -1)
    many = scene.cast(origins, down)
    assert np.isfinite(many.distance).mean() > 0.5 and many.distance.dtype == np.float64
    few = [scene.cast(origins[first : first + 100], down).distance for first in range(0, 500, 100)]
    assert np.array_equal(np.concatenate(few), many.distance[:500], equal_nan=True)


LIBRARY = """newmtl leaf
Kd 0.1 0.2 0.3
helios_reflectance 45
vlscan_roughness_deg 18
vlscan_leaf true
newmtl soil
helios_classification 2
helios_isGround true
"""


def test_materials_of_files_are_read(tmp_path):
    (tmp_path / "m.mtl").write_text(LIBRARY)
    (tmp_path / "x.obj").write_text("mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl soil\nf 1 2 3\nusemtl nowhere\nf 1 2 3\n")
    found = Material.read(tmp_path / "m.mtl")
    leaf, soil = found["leaf"], found["soil"]
    assert list(found) == ["leaf", "soil"] and (leaf.reflectance, leaf.diffuse, leaf.is_leaf) == (45, (0.1, 0.2, 0.3), True)
    assert leaf.roughness_deg == 18 and (soil.reflectance, soil.classification, soil.is_ground) == (None, 2, True)
    assert Material.read(tmp_path / "x.obj") == {"soil": soil} == Part.obj(tmp_path / "x.obj").materials
    with pytest.raises(OSError, match="none.mtl"):
        Material.read(tmp_path / "none.mtl")
    (tmp_path / "m.mtl").write_text("newmtl a\nhelios_reflectance much\n")
    with pytest.raises(ValueError, match="much"):
        Material.read(tmp_path / "m.mtl")


def test_parts_have_their_materials(tmp_path):
    (tmp_path / "m.mtl").write_text(LIBRARY)
    part = Part.mesh(*square(), materials=Material("plain", reflectance=0.2, roughness_deg=18))
    assert part.materials["plain"].reflectance == 0.2 and part.materials["plain"].roughness_deg == 18
    assert list(part.with_material(ROOF, of="plain").materials) == list(part.with_material(ROOF).materials) == [ROOF.name]
    assert list(part.with_material(ROOF, of=[0]).materials) == ["plain", ROOF.name]
    assert list(part.with_material(ROOF, of="other").materials) == ["plain"]
    assert Part.mesh(*square()).materials == {}
    cloud = [[0.0, 0, 0], [1, 0, 0]]
    assert list(Part.points(cloud, 0.5, material_file=tmp_path / "m.mtl").materials) == ["leaf"]
    assert list(Part.voxels("crown.vox", material_file=tmp_path / "m.mtl", material="soil").materials) == ["soil"]
    assert Part.raster("ground.tif").materials == {}
    facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 2 0\nendloop\nendfacet\n"
    (tmp_path / "a.stl").write_text(f"solid a\n{facet}endsolid a\n")
    assert {name: known.classification for name, known in Part.file(tmp_path / "a.stl").materials.items()} == {"a": 0}


@pytest.mark.parametrize("folder", ["room", "forest", "voxels", "terrain", "street"])
def test_parts_of_scene_files_make_the_same_scene(folder):
    whole = Scene(FIXTURES / folder / "scene.xml", [FIXTURES / folder])
    parts = whole.read_parts()
    built = Scene(parts, [FIXTURES / folder])
    assert built.parts == whole.parts == [part.id for part in parts] and built.primitives == whole.primitives
    assert np.allclose(built.bounds, whole.bounds) and built.materials == whole.materials
    assert all(part.only_in_scene is None for part in parts) and built.read_parts() == parts
    assert Scene(pickle.loads(pickle.dumps(parts))).primitives == whole.primitives


def test_parts_that_only_their_scene_can_have_say_why():
    still, *others = Scene(FIXTURES / "moving/scene.xml").read_parts()
    assert still.only_in_scene is None and {"<dmotion>", "<swap>"} == {part.only_in_scene.split()[3] for part in others}
    with pytest.raises(NotImplementedError, match="exists only in its scene: a part with <dmotion>"):
        Scene([still, others[0].translate(1, 0)])
    assert others[0].materials == {}


def test_filters_of_scene_files_are_those_of_parts(tmp_path):
    (tmp_path / "m.mtl").write_text(LIBRARY)
    (tmp_path / "x.obj").write_text("mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 2 0\nusemtl soil\nf 1 2 3\n")
    (tmp_path / "places.csv").write_text("file,x,y,z\nx.obj,1,2,0\nx.obj,3,2,0\n")
    loader = '<filter type="objloader"><param type="string" key="filepath" value="x.obj"/></filter>'
    turns = '<rot axis="z" angle_deg="90"/><rot axis="x" angle_deg="90"/>'
    (tmp_path / "scene.xml").write_text(f"""<document><scene id="s">
        <part>{loader}<filter type="rotate"><param type="rotation" key="rotation">{turns}</param></filter>
        <filter type="scale"><param type="double" key="scale" value="2"/></filter>
        <filter type="translate"><param type="vec3" key="offset" value="1;2;3"/></filter></part>
        <part id="low">{loader}<filter type="translate"><param type="vec3" key="offset" value="0;0;0"/>
        <param type="integer" key="onGround" value="-1"/></filter></part>
        <part><filter type="instances"><param type="string" key="filepath" value="places.csv"/></filter></part>
        </scene></document>""")
    turned, low, table = Scene(tmp_path / "scene.xml#s").read_parts()
    # x to y to z, and y to -x.
    assert np.allclose(Scene([turned]).bounds, [[-3, 2, 3], [1, 2, 5]])
    assert (turned.id, low.id, turned.on_ground, low.on_ground) == ("0", "low", 0, -1) and list(low.materials) == ["soil"]
    assert table.only_in_scene == "instances belong to their table"
