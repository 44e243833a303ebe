"""The Python interface of HELIOS++ 2: ``import vlscan.pyhelios as pyhelios``.

Simulations are made by :class:`SimulationBuilder` and run in a thread of their own; what they write is what
``vlscan run SURVEY --output OUT`` writes. Surveys, legs and settings (:attr:`Simulation.sim`) and filters of parts are those of
:mod:`vlscan_helios.v3`, which needs pint and pydantic: ``pip install 'vlscan[helios]'``; all else needs NumPy alone.
"""

from __future__ import annotations

from vlscan._vlscan import version

from .builder import SimulationBuilder
from .functions import (
    cartesianToSpherical,
    default_rand_generator_seed,
    loggingDefault,
    loggingQuiet,
    loggingSilent,
    loggingTime,
    loggingVerbose,
    loggingVerbose2,
    setDefaultRandomnessGeneratorSeed,
    sphericalToCartesian,
)
from .output import Measurement, Output, Trajectory, outputToNumpy
from .simulation import PYHELIOS_SIMULATION_BUILD_CONDITION_VARIABLE, Simulation

__version__ = version()

__all__ = [
    "PYHELIOS_SIMULATION_BUILD_CONDITION_VARIABLE",
    "Measurement",
    "Output",
    "Simulation",
    "SimulationBuilder",
    "Trajectory",
    "cartesianToSpherical",
    "default_rand_generator_seed",
    "loggingDefault",
    "loggingQuiet",
    "loggingSilent",
    "loggingTime",
    "loggingVerbose",
    "loggingVerbose2",
    "outputToNumpy",
    "setDefaultRandomnessGeneratorSeed",
    "sphericalToCartesian",
]
