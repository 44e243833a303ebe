"""The names of HELIOS++ 3: hooks and progress bars."""

import sys

import numpy as np
import pytest

from conftest import FIXTURES

pytest.importorskip("pint")
pytest.importorskip("pydantic")

from vlscan.helios.callbacks import HookEndOfLegPolicy, HookPayload, HookPoint, SurveyHook, build_progressbar_callbacks

from vlscan import helios


@pytest.fixture(autouse=True)
def _seed():
    helios.set_rng_seed(1)


@pytest.fixture
def survey():
    """Two strips of 0.73 s each, with legs between and behind that do not fire."""
    return helios.Survey.from_xml(FIXTURES / "forest/survey.xml")


def run(survey, *hooks, **parameters):
    return survey.run(callbacks=hooks, **parameters)


def test_legs_begin_and_end_in_order(survey):
    seen = []
    hooks = [
        SurveyHook(point=point, callback=lambda context: seen.append((context.point, context.leg_index)))
        for point in (HookPoint.LEG_START, HookPoint.LEG_END)
    ]
    points, trajectory = run(survey, *hooks)
    assert seen == [(point, leg) for leg in range(4) for point in ("leg_start", "leg_end")]
    plain, poses = survey.run()
    assert points.tobytes() == plain.tobytes() and trajectory.tobytes() == poses.tobytes()


def test_payloads(survey):
    since, every, none = [], [], []
    points, _ = run(
        survey,
        SurveyHook(point="leg_end", callback=since.append, payload=HookPayload.SINCE_LAST, barrier=True),
        SurveyHook(point="leg_end", callback=every.append, payload="all_points"),
        SurveyHook(point="leg_end", callback=none.append),
    )
    assert np.concatenate([context.measurements for context in since]).tobytes() == points.tobytes()
    assert [len(context.measurements) for context in every] == [context.num_points for context in every]
    assert every[-1].measurements.tobytes() == points.tobytes() and len(since[1].measurements) == 0
    assert all(context.measurements is None and context.num_legs == 4 for context in none)
    assert since[2].measurements["point_source_id"].min() == 3


def test_simulated_time(survey):
    once, periodic, before = [], [], []
    start = survey.gps_start()
    points, _ = run(
        survey,
        SurveyHook(point="sim_time_once", sim_time="250 ms", callback=once.append, payload="all_points"),
        SurveyHook(point="sim_time_periodic", period=0.5, callback=periodic.append, payload="since_last"),
        SurveyHook(point="sim_time_once", sim_time=1e6, callback=before.append),
    )
    assert [context.sim_time for context in once] == [0.25] and not before
    assert once[0].measurements["gps_time"].max() < start + 0.25 <= points["gps_time"][len(once[0].measurements)]
    assert [context.sim_time for context in periodic] == [0.5, 1.0, 1.5]
    for index, context in enumerate(periodic):
        times = context.measurements["gps_time"] - start
        assert len(times) and times.min() >= 0.5 * index and times.max() < 0.5 * (index + 1)


def test_the_end_of_a_leg(survey):
    def times(policy):
        seen = []
        run(survey, SurveyHook(point="sim_time_periodic", period=0.5, callback=seen.append, end_of_leg_policy=policy, payload="since_last"))
        return seen

    plain, flushed, reset = times(HookEndOfLegPolicy.NONE), times(HookEndOfLegPolicy.FLUSH), times(HookEndOfLegPolicy.FLUSH_AND_RESET)
    assert len(plain) == 3 and len(flushed) == 3 + 4 and len(reset) >= 5
    assert sum(len(context.measurements) for context in flushed) == len(survey.run()[0])
    assert [context.sim_time for context in reset] != [context.sim_time for context in flushed]


def test_hooks_of_runs_to_files(survey, tmp_path):
    for form in ("las", "xyz"):
        seen = []
        folder = run(survey, SurveyHook(point="leg_end", callback=seen.append, payload="since_last"), format=form, output_dir=tmp_path)
        assert list(folder.glob(f"*_points.{form}")) and sum(len(context.measurements) for context in seen) == len(survey.run()[0])
        beams = np.concatenate([context.measurements["beam_direction"] for context in seen])
        assert np.allclose(np.linalg.norm(beams, axis=1), 1)
    laspy = pytest.importorskip("laspy")
    las, _ = run(survey, SurveyHook(point="leg_end", callback=seen.append), format="laspy")
    plain, _ = survey.run(format="laspy")
    assert isinstance(las, laspy.LasData) and las.points.array.tobytes() == plain.points.array.tobytes()


def test_an_exception_of_a_hook_ends_the_run(survey):
    def fail(context):
        raise KeyError("stop")

    with pytest.raises(KeyError, match="stop"):
        run(survey, SurveyHook(point="leg_start", callback=fail))


def test_hooks_need_their_times():
    for wrong in (
        {"point": "sim_time_once"},
        {"point": "sim_time_periodic"},
        {"point": "sim_time_periodic", "period": 0},
        {"point": "leg_end", "period": 1},
        {"point": "leg_end", "end_of_leg_policy": "flush"},
        {"point": "leg_middle"},
        {"point": "leg_end", "payload": "some"},
        {"point": "leg_end", "colour": 1},
    ):
        with pytest.raises(ValueError):
            SurveyHook(callback=print, **wrong)
    with pytest.raises(ValueError):
        SurveyHook(point="leg_end", callback=3)


@pytest.mark.parametrize("strategy", ["legs", "time", "legs+time", "per_leg_time"])
def test_progress_bars(survey, strategy, monkeypatch, capfd):
    pytest.importorskip("tqdm")
    plain = survey.run(progressbar=strategy)[0]
    assert not capfd.readouterr().err, "nobody looks"
    assert build_progressbar_callbacks(strategy, 4) == ((), None)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    assert survey.run(progressbar=strategy)[0].tobytes() == plain.tobytes()
    shown = capfd.readouterr().err
    assert ("legs: 100%" in shown) == strategy.startswith("legs") and ("leg 3 of 4" in shown) == (strategy == "per_leg_time")
    assert ("s simulated" in shown) == (strategy != "legs")
    assert survey.run(progressbar="none")[0].tobytes() == plain.tobytes() and not capfd.readouterr().err
