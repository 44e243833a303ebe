"""The names of HELIOS++ 3: scenes, parts, materials."""

import gc
import pickle
import shutil

import numpy as np
import pytest

import vlscan
from conftest import FIXTURES

pytest.importorskip("pint")
pytest.importorskip("pydantic")

from test_helios import plane, static_survey

from vlscan import helios


@pytest.fixture(autouse=True)
def _fresh():
    helios.set_rng_seed(1)
    with helios.add_asset_directory(FIXTURES / "room"):
        yield


def test_parts_are_transformed_in_order():
    part = plane(1.0).scale(2).translate([10, 0, 0]).rotate(axis=[0, 0, 1], angle="90 deg")
    low, high = part.bbox.bounds
    assert np.allclose(low, [-2, 8, 0]) and np.allclose(high, [2, 12, 0]) and np.allclose(part.bbox.centroid, [0, 10, 0])
    turned = plane(1.0).rotate(from_axis=[0, 0, 1], to_axis=[1, 0, 0], rotation_center=[0, 0, 5])
    assert np.allclose(turned.bbox.bounds, [[-5, -1, 4], [-5, 1, 6]])
    half = plane(1.0).rotate([0, 0, 0, 1]).translate(("50 cm", 0, np.float64(1)))
    assert np.allclose(half.bbox.bounds, [[-0.5, -1, 1], [1.5, 1, 1]])
    for wrong in ({}, {"axis": [0, 0, 1]}, {"quaternion": [1, 0, 0]}, {"axis": [0, 0, 1], "angle": 1, "to_axis": [1, 0, 0]}):
        with pytest.raises(ValueError):
            plane().rotate(**wrong)
    for wrong in (0, -1, "big"):
        with pytest.raises(ValueError):
            plane().scale(wrong)


def test_parts_have_vertices_and_triangles_where_they_stand():
    geometry = plane(1.0).translate([10, 0, 0]).geometry()
    assert geometry.vertices[geometry.triangles].shape == (2, 3, 3)
    assert np.allclose(geometry.vertices.min(axis=0), [9, -1, 0]) and np.allclose(geometry.vertices.max(axis=0), [11, 1, 0])


def test_materials_can_be_changed():
    part = helios.ScenePart.from_obj(FIXTURES / "forest/beech.obj")
    assert part.materials and set(part.materials) == set(part.materials.keys()) == {name for name, _ in part.materials.items()}
    name = next(iter(part.materials))
    part.materials[name].classification = 77
    scene = helios.StaticScene(scene_parts=[part])
    assert 77 in {kind for _, kind in scene.engine().materials.values()}
    part.materials[name] = helios.Material(name=name, reflectance=0.25, classification=78)
    assert (0.25, 78) in scene.engine().materials.values()
    with pytest.raises(KeyError, match="there is no material 'turnip'"):
        part.materials["turnip"]
    with pytest.raises(ValueError, match="expected a Material"):
        part.materials[name] = 3
    other = plane().update_material(helios.Material(name="roof", reflectance=0.9, classification=6), indices=[1])
    assert set(other.materials) == {"default", "roof"} and other.materials["roof"].classification == 6
    points, _ = static_survey(other).run()
    assert set(points["classification"]) <= {0, 6} and 6 in points["classification"]
    whole = plane().update_material(helios.Material(name="soil", classification=2))
    assert list(whole.materials) == ["soil"]
    whole.materials["soil"].classification = 11
    assert set(static_survey(whole).run()[0]["classification"]) == {11}
    whole.clone().materials["soil"].classification = 12
    assert set(static_survey(whole).run()[0]["classification"]) == {11}
    whole.materials["soil"] = helios.Material(name="soil", classification=13)
    assert set(static_survey(whole.clone()).run()[0]["classification"]) == {13}
    vertices, quads = [[-9, -9, 0], [0, -9, 0], [9, -9, 0], [9, 9, 0], [0, 9, 0], [-9, 9, 0]], [[0, 1, 4, 5], [1, 2, 3, 4]]
    for chosen in ({"indices": [1]}, {"indices": np.array([False, True])}, {"range_start": 1, "range_stop": 2}):
        field = helios.ScenePart.from_mesh(vertices, quads)
        field.update_material(helios.Material(name="a", reflectance=0.9, classification=6), **chosen)
        points, _ = static_survey(field).run()
        assert ((points["classification"] == 6) == (points["position"][:, 0] > 0)).mean() > 0.99 and len(points) > 1000
    for wrong in ({"indices": [-1]}, {"indices": [2]}, {"indices": [True]}, {"range_stop": 3}, {"range_start": 1}):
        with pytest.raises(ValueError, match="expected|needs"):
            helios.ScenePart.from_mesh(vertices, quads).update_material(helios.Material(name="a"), **wrong)
    # As a fraction, which the default physics of the engine takes; surveys of this package take 50 with that of HELIOS++.
    assert helios.StaticScene(scene_parts=[plane()]).engine().materials == {"default": (0.5, 0)}
    with pytest.warns(vlscan.VlscanWarning, match="'bright' is 1.5"):
        helios.Material(name="bright", reflectance=1.5)


def test_materials_of_files():
    first = helios.Material.from_file(FIXTURES / "forest/forest.mtl")
    named = helios.Material.from_file(FIXTURES / "forest/forest.mtl", first.name)
    assert first == named and first.diffuse_components.shape == (4,) and first != helios.Material(name=first.name)
    with pytest.raises(ValueError, match="there are"):
        helios.Material.from_file(FIXTURES / "forest/forest.mtl", "turnip")
    shiny = helios.Material(name="shiny", specularity=0.25).engine()
    assert shiny.diffuse == (0.75, 0.75, 0.75) and shiny.specular == (0.25, 0.25, 0.25)


def test_scenes(tmp_path):
    scene = helios.StaticScene.from_xml("scene.xml")
    assert scene.bbox.bounds[0][0] < scene.bbox.centroid[0] and helios.utils.is_xml_loaded(scene) and scene.is_as_read
    built = helios.StaticScene(scene_parts=[plane()])
    assert not helios.utils.is_finalized(built)
    built.add_scene_part(plane(1.0, z=4.0))
    assert len(built.scene_parts) == 2 and built.bbox.bounds[1][2] == 4 and built.engine() is built.engine()
    assert helios.utils.is_finalized(built) and built.clone() == built
    for name in ("a.vlscene", "a.scene"):
        built.to_binary(tmp_path / name, 9)
        assert np.allclose(helios.StaticScene.from_binary(tmp_path / name).bbox.bounds, built.bbox.bounds)
    packed = helios.StaticScene.from_binary(tmp_path / "a.scene")
    with pytest.raises(NotImplementedError, match="cannot be extended"):
        packed.add_scene_part(plane())
    assert np.allclose(packed.bbox.bounds, built.bbox.bounds)
    packed.scene_parts = (plane(),)
    with pytest.raises(NotImplementedError, match="cannot be extended"):
        packed.bbox
    assert len(helios.ScenePart.from_objs(str(FIXTURES / "forest/*.obj"))) == 4
    with pytest.raises(FileNotFoundError, match="matches"):
        helios.ScenePart.from_objs("*.turnip")


@pytest.mark.parametrize("folder", ["room", "forest", "voxels", "terrain", "street"])
def test_parts_of_scene_files_are_those_of_the_engine(folder):
    path = FIXTURES / folder / "scene.xml"
    with helios.add_asset_directory(FIXTURES / folder):
        whole = helios.StaticScene.from_xml(path)
        built = helios.StaticScene(scene_parts=whole.scene_parts)
        assert built.engine() is not whole.engine() and built.engine().primitives == whole.engine().primitives
        assert np.allclose(built.bbox.bounds, whole.bbox.bounds) and built.engine().parts == whole.engine().parts
        assert built.engine().materials == whole.engine().materials


def test_a_part_of_a_scene_file(tmp_path, monkeypatch):
    part = helios.ScenePart.from_xml("scene.xml", 1)
    assert part.bbox.bounds[0][2] < part.bbox.bounds[1][2] and helios.utils.is_xml_loaded(part)
    with pytest.raises(ValueError, match="0 parts with the id 77"):
        helios.ScenePart.from_xml("scene.xml", 77)
    monkeypatch.setattr(helios.utils, "_asset_directories", [])
    with helios.add_asset_directory(FIXTURES / "moving"):
        moving = helios.StaticScene.from_xml(FIXTURES / "moving/scene.xml")
        assert moving.bbox.bounds[1][2] > 0
        assert helios.Survey.from_xml(FIXTURES / "moving/survey.xml").run()[0].size > 100
        moving.add_scene_part(plane())
        with pytest.raises(NotImplementedError, match="belongs to its scene"):
            moving.bbox
    filters = """<document><scene id="s"><part id="3">
        <filter type="objloader"><param key="filepath" value="shelf.obj"/></filter>
        <filter type="rotate"><param type="rotation" key="rotation"><rot axis="z" angle_deg="90"/>
        <rot axis="x" angle_deg="90"/></param></filter><filter type="scale"><param type="double" key="scale" value="2"/></filter>
        <filter type="translate"><param type="vec3" key="offset" value="1;2;3"/></filter></part></scene></document>"""
    shutil.copy(FIXTURES / "room/shelf.obj", tmp_path)
    (tmp_path / "scene.xml").write_text(filters)
    with helios.add_asset_directory(tmp_path):
        whole = helios.StaticScene.from_xml(tmp_path / "scene.xml")
        assert np.allclose(whole.bbox.bounds, helios.StaticScene(scene_parts=whole.scene_parts).bbox.bounds)


def test_points_become_voxels(tmp_path):
    rng = np.random.default_rng(3)
    rows = np.column_stack([rng.uniform(-2, 2, (500, 3)), np.tile([0, 0, 1], (500, 1))])
    np.savetxt(tmp_path / "cloud.xyz", rows, delimiter=",")
    parts = [
        helios.ScenePart.from_numpy_array(rows[:, :3], 0.5),
        helios.ScenePart.from_numpy_array(rows, "0.5", normals_file_columns=[3, 4, 5]),
        helios.ScenePart.from_xyz(tmp_path / "cloud.xyz", 0.5),
        helios.ScenePart.from_xyz(tmp_path / "cloud.xyz", 0.5, ",", 0.0, [0, 0, 1], estimate_normals=True),
        *helios.ScenePart.from_xyzs(str(tmp_path / "*.xyz"), 0.5, ","),
    ]
    for part in parts:
        assert np.allclose(part.bbox.bounds, [[-2] * 3, [2] * 3], atol=0.6)
        assert static_survey(plane(z=-5), part).run()[0].size > 1000
    # Copies have files of their own.
    moved = parts[0].translate([0, 0, 1])
    count, pickled = static_survey(plane(z=-5), moved).run()[0].size, pickle.dumps(moved)
    parts.clear()
    del moved
    gc.collect()
    part = pickle.loads(pickled)
    assert np.allclose(part.bbox.bounds, [[-2, -2, -1], [2, 2, 3]], atol=0.6)
    assert static_survey(plane(z=-5), pickle.loads(pickle.dumps(part))).run()[0].size == count > 100
    for wrong in (
        lambda: helios.ScenePart.from_numpy_array(rows, 0),
        lambda: helios.ScenePart.from_numpy_array(rows[:, :2], 1),
        lambda: helios.ScenePart.from_numpy_array(rows, 1, normals_file_columns=[4, 5, 6]),
        lambda: helios.ScenePart.from_xyz(tmp_path / "cloud.xyz", 1, ",", rgb_file_columns=[6, 7, 8]),
    ):
        with pytest.raises(ValueError):
            wrong()
    assert helios.utils.detect_separator(tmp_path / "cloud.xyz") == ","


def test_meshes_of_open3d():
    class Mesh:
        vertices, triangles = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0]]), np.array([[0, 1, 2]])

    class Cloud:
        points, normals = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0.0, 0, 1]] * 3)

    assert np.allclose(helios.ScenePart.from_open3d(Mesh(), up_axis="y").bbox.bounds, [[0, 0, 0], [1, 0, 2]])
    assert helios.ScenePart.from_open3d(Cloud(), voxel_size=0.5).bbox.bounds[1][0] >= 1
    with pytest.raises(TypeError, match="neither"):
        helios.ScenePart.from_open3d(3)
    with pytest.raises(TypeError):
        helios.ScenePart.from_open3d(Mesh(), upp="y")


def test_parts_stand_on_the_ground():
    ground = plane(30.0, z=2.0)
    ground.update_material(helios.Material(name="soil", is_ground=True))
    for strategy in (helios.ForceOnGroundStrategy.LEAST_COMPLEX, helios.ForceOnGroundStrategy.MOST_COMPLEX, 3, True):
        box = plane(1.0, z=9.0)
        box.force_on_ground = strategy
        scene = helios.StaticScene(scene_parts=[ground, box])
        assert scene.bbox.bounds[1][2] == pytest.approx(2.0), strategy
    with pytest.raises(ValueError):
        box.force_on_ground = -7
    place = helios.PlatformSettings(x=1, y=2)
    place.do_force_on_ground(scene)
    assert place.z == pytest.approx(2.0)
    place.x = 99
    with pytest.raises(ValueError, match="no ground"):
        place.do_force_on_ground(scene)
