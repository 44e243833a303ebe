"""Scenes of files and arrays, materials, instances, patterns of one's own."""

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
    vertices, faces = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]]
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
    grid = np.stack(np.meshgrid(np.arange(100.0), np.arange(100.0)), -1).reshape(-1, 2)
    vertices = np.column_stack([grid, np.sin(grid[:, 0])])
    corner = (np.arange(99)[:, None] * 100 + np.arange(99)).reshape(-1)
    faces = np.column_stack([corner, corner + 1, corner + 101, corner + 100])
    part = Part.mesh(vertices, faces)
    parts = [part.translate(100 * i, 0, 0) for i in range(100)]
    stored = Scene(parts).load(instances="never")
    shared = Scene(parts).load(instances="always")
    assert shared.primitives == stored.primitives == 100 * 2 * 99 * 99
    assert shared.memory < stored.memory / 20
    origins = np.random.default_rng(1).uniform((0, 0, 10), (9000, 99, 20), (2000, 3))
    a, b = (heights(scene, origins, instances=how) for scene, how in [(stored, "never"), (shared, "always")])
    assert len(a) > 1000 and np.allclose(a.xyz, b.xyz, atol=1e-9)


def test_a_scene_is_loaded_once(monkeypatch):
    scene = Scene([Part.mesh(*square())])
    assert not scene.is_loaded
    heights(scene, [[0, 0, 1]])
    assert scene.is_loaded
    from vlscan import _vlscan

    monkeypatch.setattr(_vlscan.Scene, "load", None, raising=False)
    heights(scene, [[0, 0, 1]], seed=5, physics="refined")
    scene.unload()
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
    assert points.png()[:4] == b"\x89PNG" and "<canvas" in points.html("class")
    assert "<img" in points._repr_html_() and "primitives" in scene._repr_html_()
    points.save_preview(tmp_path / "a.png")
    points.save_preview(tmp_path / "a.html", "class")
    assert (tmp_path / "a.png").stat().st_size > 1000 and (tmp_path / "a.html").stat().st_size > 10_000
    with pytest.raises(ValueError, match="height, class"):
        points.png("colour")
