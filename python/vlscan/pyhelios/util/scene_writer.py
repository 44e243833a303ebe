"""Not part of vlscan: the error of its import says what to use."""

raise ImportError(
    "pyhelios.util.scene_writer is not part of vlscan; vlscan.Part and vlscan.Scene make scenes of files and arrays (docs/python.md)"
)
