"""Not part of vlscan: the error of its import says what to use."""

raise ImportError(
    "pyhelios.util.flight_planner is not part of vlscan; vlscan.plan_airborne() and plan_terrestrial() plan surveys (docs/planning.md)"
)
