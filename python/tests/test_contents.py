"""Contents of files: legs, references and templates of surveys, figures of scanners, kinds of platforms."""

import pickle

import numpy as np
import pytest

import vlscan
from conftest import FIXTURES
from vlscan import Leg, Part, Survey


def made(**more):
    """Return a survey without a file."""
    ground = Part.mesh([[-20, -20, 0], [20, -20, 0], [20, 20, 0], [-20, 20, 0]], [[0, 1, 2, 3]])
    leg = Leg((0, 0, 2), scan_freq_hz=120, head_rate_deg_per_s=60, head_stop_deg=20)
    return Survey(ground, "riegl_vz400", [leg], **more)


def test_legs_of_a_file_are_read_and_changed():
    room = FIXTURES / "room/survey.xml"
    survey = Survey.open(room)
    assert "legs" not in repr(survey) and len(survey.legs) == 2 and "2 legs" in repr(survey)
    plain = Survey.open(room).run(seed=1).points
    assert survey.run(seed=1).points["GpsTime"].tobytes() == plain["GpsTime"].tobytes()
    survey.legs[1].active = False
    one = survey.run(seed=1).points
    assert set(one["PointSourceId"]) == {1}
    # Legs that are sent are flown with the kinematics of pipelines.
    first = plain[plain["PointSourceId"] == 1]
    assert abs(len(one) / len(first) - 1) < 0.03 and np.allclose(one.bounds, first.bounds, atol=0.1)
    found = survey.contents()
    assert (found.scanner, found.platform, [leg.active for leg in found.legs]) == ("tls_polygon", "tripod", [True, False])
    assert pickle.loads(pickle.dumps(survey)).legs[1].active is False and len(pickle.loads(pickle.dumps(Survey.open(room))).legs) == 2


def test_contents_tell_how_platforms_move_and_waveforms_are_read(tmp_path):
    room = Survey.open(FIXTURES / "room/survey.xml").contents()
    assert (room.platform, room.platform_kind) == ("tripod", "static") and [leg.flown_part for leg in room.legs] == [None, None]
    assert room.waveform == {"bin_ns": 0.25, "window_ns": 0.75, "quality": 3, "max_range_ns": 0}
    assert made(waveform={"bin_ns": 0.5}).contents().waveform["bin_ns"] == 0.5
    np.savetxt(tmp_path / "flight.csv", [[0, 0, 0, 0, 0, -10, 60], [5, 0, 0, 0, 0, 10, 60]], delimiter=",")
    place = (
        '<platformSettings trajectory="flight.csv" tIndex="0" rollIndex="1" pitchIndex="2" yawIndex="3" xIndex="4" yIndex="5" zIndex="6"'
    )
    leg = (
        f'<leg>{place} tStart="1" teleportToStart="true"/><scannerSettings pulseFreq_hz="83000" scanFreq_hz="50" scanAngle_deg="20"/></leg>'
    )
    head = '<survey scene="s" platform="interpolated" basePlatform="data/platforms.xml#sr22" scanner="data/scanners_als.xml#leica_als50">'
    scene = '<scene id="s"><part><filter type="objloader"><param key="filepath" value="ground.obj"/></filter></part></scene>'
    text = f"<document>{head}{leg}</survey>{scene}</document>"
    (tmp_path / "survey.xml").write_text(text)
    (tmp_path / "ground.obj").write_text("v -99 -99 0\nv 99 -99 0\nv 0 99 0\nf 1 2 3\n")
    flight = Survey.open(tmp_path / "survey.xml").contents()
    assert flight.platform_kind == "interpolated" and flight.legs[0].flown_part == (1, None, True)
    assert Survey.from_document(text).contents(assets=[tmp_path]).legs[0].flown_part.teleport
    changed = Survey.open(tmp_path / "survey.xml")
    changed.legs[0].active = False
    with pytest.raises(ValueError, match="hold more than Leg does"):
        changed.run()


def test_contents_of_xml_have_references_and_templates():
    forest = vlscan.Survey.open(FIXTURES / "forest/survey.xml").contents()
    references = forest.references
    assert references.scanner == f"{FIXTURES / 'forest/scanners.xml'}#als_polygon"
    assert references.platform.endswith("platforms.xml#plane") and references.scene.endswith("scene.xml#forest")
    assert (references.rotation_spec, references.has_waveform) == (None, False)
    leg = forest.legs[1]
    assert leg.templates["scanner"].id == "strip" and leg.templates["platform"].id == "cruise"
    strip, cruise = leg.templates["scanner"].leg, leg.templates["platform"].leg
    assert strip.active and not leg.active and strip.settings["pulse_freq_hz"] == leg.settings["pulse_freq_hz"] == 137_700
    assert strip.settings["beam_divergence_rad"] == 0.003 and cruise.speed_m_per_s == 60 and cruise.position == [0, 0, 301.5]
    room = vlscan.Survey.open(FIXTURES / "room/survey.xml").contents()
    assert list(room.legs[0].templates) == ["scanner"]
    assert made().contents().references is None


def test_a_document_finds_files_beside_its_name():
    file = FIXTURES / "room/survey.xml"
    survey = vlscan.Survey.from_document(file.read_text(), path=FIXTURES / "room/other.xml")
    assert survey.run(seed=1).point_count == vlscan.Survey.open(file).run(seed=1).point_count
    with pytest.raises(vlscan.InputError, match=r"other\.xml:1"):
        vlscan.Survey.from_document("<document>", path=FIXTURES / "room/other.xml").run()


def test_figures_of_the_device_are_those_of_surveys():
    device = vlscan.scanner_figures(f"{FIXTURES / 'room/scanners.xml'}#tls_polygon").device
    assert (device.divergence_rad, device.wavelength_nm, device.range_min_m, device.range_max_m) == (0.00035, 1550, 0.3, None)
    assert (device.scan_freq_min_hz, device.scan_freq_max_hz) == (4, 420)
    assert device.head_rate_max_deg_per_s == pytest.approx(3600) and device.scan_angle_max_deg == pytest.approx(52.5)


def test_a_survey_in_memory_may_be_xml():
    room = FIXTURES / "room"
    text = (room / "survey.xml").read_text().replace(' paths="beside"', "")
    points = Survey.from_document(text).run(seed=1, assets=[room]).points
    assert points["X"].tobytes() == Survey.open(room / "survey.xml").run(seed=1).points["X"].tobytes()
    with pytest.raises(vlscan.InputError, match="<python>"):
        Survey.from_document(text.replace("</document>", "")).run()


def test_legs_of_xml_name_trajectories_in_memory(tmp_path):
    rows = np.array([[0, -20, 0, 300, 0, 0, 90], [2, 0, 0, 300, 0, 0, 90], [4, 20, 0, 300, 0, 0, 90]], float)
    names = ["time", "x", "y", "z", "roll", "pitch", "yaw"]
    (tmp_path / "flight.csv").write_text("\n".join([",".join(names), *(",".join(map(repr, row)) for row in rows.tolist())]))
    (tmp_path / "ground.obj").write_text("v -99 -99 0\nv 99 -99 0\nv 0 99 0\nf 1 2 3\n")
    head = '<survey scene="s" platform="interpolated" basePlatform="data/platforms.xml#sr22" scanner="data/scanners_als.xml#leica_als50">'
    scene = '<scene id="s"><part><filter type="objloader"><param key="filepath" value="ground.obj"/></filter></part></scene>'
    settings = '<scannerSettings pulseFreq_hz="83000" scanFreq_hz="50" scanAngle_deg="20"/>'

    def points(file, **trajectories):
        leg = f'<leg><platformSettings trajectory="{file}" tStart="1" tEnd="2"/>{settings}</leg>'
        survey = Survey.from_document(f"<document>{head}{leg}</survey>{scene}</document>", path=tmp_path / "a.xml", **trajectories)
        return pickle.loads(pickle.dumps(survey)).run(seed=1).points

    expected = points("flight.csv")
    assert len(expected) > 1000
    for poses in (rows, dict(zip(names, rows.T, strict=True)), np.rec.fromarrays(rows.T[::-1], names=names[::-1])):
        found = points("&lt;poses&gt;", trajectories={"<poses>": poses})
        assert all(found[name].tobytes() == expected[name].tobytes() for name in expected)
    with pytest.warns(vlscan.VlscanWarning, match="no leg names it"):
        points("flight.csv", trajectories={"<poses>": rows})
    with pytest.raises(vlscan.InputError, match="<poses>"):
        points("&lt;poses&gt;", trajectories={"<poses>": rows[:1]})
    with pytest.raises(TypeError, match="tables by name"):
        points("flight.csv", trajectories=rows)


def test_platforms_tell_how_they_move():
    assert vlscan.platform_kind(f"{FIXTURES}/room/platforms.xml#tripod") == vlscan.platform_kind("tripod") == "static"
    with pytest.raises(vlscan.InputError, match="no platform|no <platform>"):
        vlscan.platform_kind("data/platforms.xml#turnip")


def test_the_document_of_a_file_has_no_legs():
    flight = Survey.open(FIXTURES / "terrain/survey.xml")
    assert flight.legs[0].settings["pulse_freq_hz"] > 0
    pipeline = Survey.from_document(flight.document())
    assert not pipeline.legs
    with pytest.raises(AttributeError, match="no attribute 'leg'"):
        flight.leg
