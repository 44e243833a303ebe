"""Simulations: a survey that is run in a thread of its own."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from vlscan import Batches, Points, Result, Survey
from vlscan.places import place_of, working_folder

from .output import COLUMNS, Output

if TYPE_CHECKING:
    from vlscan_helios.v3 import Leg, ScenePart
    from vlscan_helios.v3 import Survey as Model

    from .views import Playback

#: Condition that callbacks can hold and notify while a program waits for points.
PYHELIOS_SIMULATION_BUILD_CONDITION_VARIABLE = threading.Condition()

# Points of a batch without a callback: a paused simulation goes on for up to a few of these.
_BATCH_ROWS = 100_000

# Functions of the playback that a simulation has, too: a copy of ``simulation.sim`` is a simulation.
_OF_PLAYBACK = ("getLeg", "getNumLegs", "newLeg", "removeLeg", "getScene", "getScanner", "getPlatform", "getSurveyPath")


@dataclass
class Recipe:
    """Values that a builder has collected."""

    survey: str
    assets: list[str] = field(default_factory=list)
    options: dict[str, Any] = field(default_factory=dict)
    has_files: bool = True
    callback: Callable[[Output], object] | None = None
    callback_rows: int = 0
    #: Transforms of parts in their order: the id of a part, or an empty one for all; what is done to them.
    filters: list[tuple[str, Callable[[ScenePart], object]]] = field(default_factory=list)
    #: Working directory in which the survey was named.
    folder: str = field(default_factory=working_folder)


class Simulation:
    """A simulation that can be started once.

    Parameters
    ----------
    recipe : Recipe
        Survey, options and callback of the simulation.
    """

    def __init__(self, recipe: Recipe, *others: object, **named: object) -> None:
        if others or named or not isinstance(recipe, Recipe):
            raise TypeError("simulations are made by a builder: SimulationBuilder(surveyPath, assetsDir, outputDir).build()")
        self._recipe = recipe
        self._model: Model | None = None
        self._as_read: tuple[Leg, ...] = ()
        self._playback: Playback | None = None
        self._thread: threading.Thread | None = None
        self._batches: Batches | None = None
        self._done, self._is_stopped, self._resumed = threading.Event(), threading.Event(), threading.Event()
        self._resumed.set()
        self._parts: list[Points] = []
        self._result: Result | None = None
        self._failure: BaseException | None = None
        if recipe.filters:
            self._apply_filters(self._read())

    @property
    def sim(self) -> Playback:
        """The survey with its legs, scanner and platform, which can be changed before the start."""
        if self._playback is None:
            from .views import Playback

            self._playback = Playback(self._read(), lambda: self._thread is not None, self._recipe.survey, self._as_read)
            self._playback.simulation = self
        return self._playback

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            if name in _OF_PLAYBACK:
                return getattr(self.sim, name)
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    def getSurvey(self) -> Any:
        """Return the survey, as ``sim.getSurvey()`` does."""
        return self.sim.getSurvey()

    def _assets(self) -> ExitStack:
        """Register the asset folders as long as the stack is open."""
        from vlscan_helios.v3 import add_asset_directory

        stack = ExitStack()
        for folder in self._recipe.assets:
            stack.enter_context(add_asset_directory(folder))
        return stack

    def _read(self) -> Model:
        if self._model is None:
            from vlscan_helios.v3 import Survey as Model

            with self._assets():
                self._model = Model.from_xml(place_of(self._recipe.survey, self._recipe.folder))
                self._as_read = self._model.legs
        return self._model

    def _apply_filters(self, model: Model) -> None:
        parts = model.scene.scene_parts
        for id, apply in self._recipe.filters:
            chosen = [part for part in parts if id in ("", part.id)]
            if not chosen:
                known = ", ".join(part.id for part in parts)
                raise ValueError(f"no part of the scene has the id {id!r}; there are {known}")
            for part in chosen:
                apply(part)

    def start(self) -> None:
        """Start the simulation in a thread of its own."""
        if self._thread is not None:
            raise RuntimeError("the simulation has been started already")
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            if self._model is None:
                self._measure(Survey.open(place_of(self._recipe.survey, self._recipe.folder)), self._recipe.options)
                return
            with self._assets():
                beside = [path for path in ("assets", os.path.dirname(self._recipe.survey)) if path]
                options = {**self._recipe.options, "assets": [*self._recipe.options.get("assets", ()), *beside]}
                self._measure(self._model.engine(), options)
        except BaseException as failure:
            self._failure = failure
        finally:
            self._done.set()

    def _measure(self, survey: Survey, options: dict[str, Any]) -> None:
        callback, rows = self._recipe.callback, self._recipe.callback_rows or _BATCH_ROWS
        self._batches = survey.run_batches(rows, batch_columns=COLUMNS, **options)
        with self._batches as batches:
            for points in batches:
                self._resumed.wait()
                if self._is_stopped.is_set():
                    break
                self._parts.append(points)
                if callback is not None:
                    callback(Output(self._parts))
            self._result = batches.result if batches.is_complete else None
        if callback is not None and self._result is not None:
            callback(self._output())

    def _output(self) -> Output:
        result = self._result
        if result is None:
            return Output(self._parts)
        folder = result.directories[0] if result.directories else ""
        return Output(self._parts, result.trajectory, result.files, folder, result.seconds)

    def pause(self) -> None:
        """Take no more points, also before the start; the simulation waits after a few batches, and :meth:`resume` lets it go on."""
        self._resumed.clear()

    def resume(self) -> None:
        """Go on after :meth:`pause`."""
        self._resumed.set()

    def stop(self) -> None:
        """End the simulation; :meth:`join` then returns the points so far."""
        self._is_stopped.set()
        self._resumed.set()
        if self._batches is not None:
            self._batches.close()

    def isStarted(self) -> bool:
        """Return whether it has been started."""
        return self._thread is not None

    def isRunning(self) -> bool:
        """Return whether it runs: it has been started, has not ended and is not paused."""
        return self._thread is not None and not self._done.is_set() and self._resumed.is_set()

    def isPaused(self) -> bool:
        """Return whether it waits to be resumed."""
        return self._thread is not None and not self._done.is_set() and not self._resumed.is_set()

    def isStopped(self) -> bool:
        """Return whether it was ended by :meth:`stop`."""
        return self._is_stopped.is_set()

    def isFinished(self) -> bool:
        """Return whether it has ended."""
        return self._done.is_set()

    def copy(self) -> Simulation:
        """Return a simulation of the same survey, with its changes, that has not been started."""
        twin = Simulation(replace(self._recipe, filters=[]))
        twin._recipe = self._recipe
        if self._model is not None:
            twin._model = self._model.clone()
            # Legs of the file keep their templates.
            pairs = zip(self._model.legs, twin._model.legs, strict=True)
            twin._as_read = tuple(own for leg, own in pairs if any(leg is read for read in self._as_read))
        return twin

    def __repr__(self) -> str:
        states = (
            ("stopped", self.isStopped()),
            ("finished", self.isFinished()),
            ("paused", self.isPaused()),
            ("running", self.isRunning()),
        )
        state = next((name for name, holds in states if holds), "not started")
        return f"<Simulation of {self._recipe.survey!r}: {state}>"

    def join(self) -> Output:
        """Wait for the end, raise what went wrong, and return the output. Ctrl-C ends the simulation."""
        if self._thread is None:
            raise RuntimeError("the simulation has not been started")
        try:
            # With a timeout, so that Ctrl-C is handled.
            while not self._done.wait(0.1):
                pass
        except KeyboardInterrupt:
            self.stop()
            self._done.wait()
            raise
        # The thread has nothing left to do but to end.
        self._thread.join()
        if self._failure is not None:
            raise self._failure
        if self._result is None and not self._is_stopped.is_set():
            raise RuntimeError("the simulation has no output")
        return self._output()


def folders(paths: str | os.PathLike[str] | Iterable[str | os.PathLike[str]]) -> Sequence[str]:
    """Return folders as a list; one may stand alone."""
    if not isinstance(paths, (str, os.PathLike, Iterable)):
        raise TypeError(f"expected a folder, or several, found {paths!r}")
    found = [paths] if isinstance(paths, (str, os.PathLike)) else list(paths)
    for path in found:
        if not isinstance(path, (str, os.PathLike)):
            raise TypeError(f"assetsDir has {path!r}, expected folders")
    return [os.fspath(path) for path in found]
