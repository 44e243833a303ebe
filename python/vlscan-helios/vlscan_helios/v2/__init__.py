"""The Python interface of HELIOS++ 2: ``import vlscan.pyhelios as pyhelios``.

Simulations are made by :class:`SimulationBuilder` and run in a thread of their own; what they write is what
``vlscan run SURVEY --output OUT`` writes. Surveys, legs and settings (:attr:`Simulation.sim`) and filters of parts are those of
:mod:`vlscan_helios.v3`.
"""

from __future__ import annotations

from vlscan import __version__ as __version__

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
