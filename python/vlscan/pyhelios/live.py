"""Not part of vlscan: the error of its import says what to use."""

raise ImportError("pyhelios.live is not part of vlscan; SimulationBuilder.setCallback() gets points while they are measured")
