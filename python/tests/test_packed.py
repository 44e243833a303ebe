"""Packed scenes: damaged ones are refused every time, and nothing that happens to a file reaches a scene that is open."""

import subprocess
import sys
import threading

import numpy as np
import pytest

import vlscan
from vlscan import Scene, Survey


@pytest.fixture
def packed(room, command, tmp_path):
    """The packed scene of the room."""
    path = tmp_path / "room.vlscene"
    done = command("scene", "pack", room, "-o", path)
    assert done.returncode == 0, done.stderr
    return path


def damaged(packed):
    """A copy with one changed bit."""
    data = bytearray(packed.read_bytes())
    data[len(data) // 2] ^= 16
    path = packed.with_name("damaged.vlscene")
    path.write_bytes(data)
    return path


def points(room, scene):
    return Survey.open(room, scene=scene).run(seed=1, threads=1).points.xyz


def test_a_damaged_scene_is_refused_every_time(room, packed):
    good, bad = Scene(packed), Scene(damaged(packed))
    expected = points(room, good)
    for _ in range(3):
        with pytest.raises(vlscan.InputError, match="damaged"):
            points(room, bad)
        assert np.array_equal(points(room, good), expected)


def test_a_damaged_scene_does_not_disturb_another_run(room, packed):
    good, found, stop = Scene(packed), [], threading.Event()
    expected = points(room, good)

    def run():
        while not stop.is_set():
            found.append(np.array_equal(points(room, good), expected))

    thread = threading.Thread(target=run)
    thread.start()
    try:
        for _ in range(20):
            with pytest.raises(vlscan.InputError, match="damaged"):
                points(room, Scene(damaged(packed)))
    finally:
        stop.set()
        thread.join()
    assert found
    assert all(found)


def test_an_open_scene_stays_what_it_is(room, packed):
    scene = Scene(packed).load()
    expected = points(room, scene)
    size = packed.stat().st_size
    with packed.open("r+b") as file:
        file.write(b"\xff" * size)
        file.truncate(size // 2)
    assert np.array_equal(points(room, scene), expected)


@pytest.mark.parametrize("when", ["before", "after_load", "after_run"])
def test_the_signal_handlers_are_those_of_the_program(room, packed, when):
    program = """
import faulthandler, sys, vlscan
when, scene, survey = sys.argv[1:]
if when == "before": faulthandler.enable()
scene = vlscan.Scene(scene).load()
survey = vlscan.Survey.open(survey, scene=scene)
if when == "after_load": faulthandler.enable()
count = len(survey.run(seed=1).points)
if when == "after_run": faulthandler.enable()
assert len(survey.run(seed=1).points) == count > 0
"""
    line = [sys.executable, "-c", program, when, str(packed), str(room)]
    done = subprocess.run(line, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
