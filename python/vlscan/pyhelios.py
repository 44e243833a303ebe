"""Another name of :mod:`vlscan_helios.v2`, the ``SimulationBuilder`` of HELIOS++ 2."""

from vlscan_helios.v2 import Output, Simulation, SimulationBuilder

__all__ = ["Output", "Simulation", "SimulationBuilder"]
