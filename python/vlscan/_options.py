"""The options of a run. `vlscan man --python` writes this file from the options of the command line: do not edit it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Literal, TypedDict

from ._typing import PathLike, Vector


class RunOptions(TypedDict, total=False):
    """Options of :meth:`vlscan.Survey.run`: those of the command line with underscores. ``None`` is an option not given."""

    format: Literal["xyz", "csv", "bin", "las", "laz", "copc", "ply", "ply-ascii", "raycloud", "pcd", "e57", "mcap", "arrow", "parquet", "geoparquet"] | None
    """Format of the points, where no extension tells it."""

    columns: str | Sequence[str] | None
    """Columns of csv, arrow, parquet and geoparquet, and of xyz, which gets a header then: X,Y,Z,Intensity,GpsTime and so on. An unknown name lists them all."""

    frame_s: float | None
    """Duration of the frames of mcap. [default: a revolution of a spinning scanner, 0.1 for others]"""

    tile: float | None
    """Divide the points of a folder (-o DIR) among square tiles of this edge length in metres, tile_X_Y, instead of legs."""

    las_at_most: int | str | None
    """Stream LAS to a pipe without a temporary file, with N as the number of points in its header (250k, 1G). Most readers accept fewer points; more are an error."""

    wave_packets: Literal["inside", "beside"] | None
    """Write waveforms as packets that the points of LAS and LAZ refer to (LAS 1.4, point format 9), inside that file or beside it as .wdp."""

    crs: int | PathLike | None
    """Coordinate reference system of the scene: EPSG:25832, WKT, or a file that holds either."""

    las_scale: float | None
    """Resolution of LAS coordinates in metres. [default: 0.0001, coarser where the scene is too wide for it]"""

    las_extra: Literal["all", "helios", "none"] | None
    """Extra bytes of the points of LAS and LAZ: all, the four of HELIOS++, or none, for programs that refuse them. [default: all]"""

    force: bool | None
    """Replace files that exist, once their successors are complete."""

    labels: bool | None
    """Write part, primitive and true range into las, laz and ply, too; csv, arrow, parquet and geoparquet have them anyway."""

    true_positions: bool | None
    """Write positions without errors of navigation (TrueX, TrueY, TrueZ) into las and laz, too; the columns of csv, arrow and parquet are chosen with --columns."""

    height_above_ground: bool | None
    """Write the height above the ground (HeightAboveGround), into las, laz and ply as well. The ground is the surfaces whose material is ground (helios_isGround), or the lowest ones of a scene without such a material."""

    per_object: bool | None
    """Divide the points of a folder (-o DIR) among the objects that were hit, object_N, instead of legs."""

    subrays: bool | None
    """Write what each subray met instead of points, at its place on the surface, with the number of the return that it is part of (0 = none): for leaf area and machine learning. The columns Subray, SurfaceX, NormalX, FootprintFraction and their like are chosen with --columns, with and without this."""

    misses: bool | None
    """Write pulses without echoes, too: 0 returns, at the beam's origin, with the beam's direction."""

    split_by_channel: bool | None
    """One point file per device of a multi-channel scanner."""

    las_output: bool | None
    """With --output: LAS 1.4 instead of text."""

    las10: bool | None
    """LAS 1.0 instead of 1.4; with --output also instead of text."""

    zip_output: bool | None
    """Waveforms and pulses as compressed text (.bin); with --output also LAZ instead of LAS, and compressed text instead of text."""

    trajectory_format: Literal["text", "helios", "sbet", "terrascan"] | None
    """Layout of the trajectory. [default: found out from its content]"""

    trajectory_columns: str | Sequence[str] | None
    """Columns of text: names in their order (time, x, y, z, roll, pitch, yaw, lat, lon; others are passed over) or name=number from 1; a unit may stand behind a name: roll[rad]. [default: the first line, else time,x,y,z,roll,pitch,yaw]"""

    trajectory_separator: str | None
    """Character between columns of text. [default: found out from the first line]"""

    trajectory_angles: Literal["deg", "rad"] | None
    """Unit of angles in text behind whose names none stands. [default: deg]"""

    trajectory_rotation: Literal["heading", "yaw", "ros", "helios", "canonical"] | None
    """Meaning of the angles of text. [default: helios for files as HELIOS++ reads and writes them, else heading]"""

    utm_zone: str | None
    """UTM zone to which latitudes and longitudes are projected, such as 32N. [default: that of --crs, else that of the first pose]"""

    height_offset: float | None
    """Added to all heights of the trajectory, in metres: from those above the ellipsoid to those of the scene."""

    lever_arm: str | Vector | None
    """Lever arm: where the scanner's platform frame is as seen from what was recorded, in metres to the right, forward and up of the recorded body. It turns with the attitude, not with the boresight."""

    boresight: str | Vector | None
    """Boresight: how the scanner's platform frame is turned in the recorded body: roll (right side down), pitch (nose up) and heading (clockwise from above) in degrees, roll innermost. A point is at position + attitude (lever arm + boresight (point as the platform's scanner sees it))."""

    max_gap: float | None
    """Fire nothing between poses that are more seconds apart than this."""

    latency: float | None
    """How long, in seconds, points of a live trajectory may wait for others to be computed together. [default: 0.25]"""

    navigation_error: Mapping[str, float | Sequence[float]] | Sequence[Mapping[str, float | Sequence[float]]] | None
    """Let what is reported of the platform's pose differ from what was flown, so that points move: a key of [navigation_errors] in pipeline files and one number or three, such as position_m=0.02,0.02,0.05, attitude_deg=0.004, boresight_deg=0,0.01,0; may be given more than once."""

    no_platform_noise: bool | None
    """Ignore the platform's position and attitude noise."""

    no_leg_noise: bool | None
    """Ignore the survey's random leg offsets."""

    assets: PathLike | Sequence[PathLike] | None
    """Folder to look for scenes, scanners, platforms, geometry and spectra in; may be given more than once."""

    drop_polygons: bool | None
    """Leave out OBJ faces with more than four corners, as HELIOS++ does."""

    strict: bool | None
    """Treat every warning about the input as an error."""

    seed: int | float | str | None
    """Seed of all noise: an integer, a decimal number or \"YYYY-MM-DD hh:mm:ss\". [default: the survey's, else 0]"""

    gps_start: float | str | datetime | None
    """Start of the GPS clock: \"YYYY-MM-DD hh:mm:ss\" (UTC), POSIX seconds, or \"now\". [default: 2024-01-01 00:00:00]"""

    threads: int | None
    """Threads that compute; 0 or nothing = all. The points are the same for any number."""

    chunk_size: int | None
    """Pulses per chunk. [default: 1024]"""

    warehouse_factor: int | None
    """Chunks per worker that may wait. [default: 4]"""

    schedule: Literal["warehouse", "dynamic", "static", "single"] | None
    """How pulses are handed out to the threads; the points are the same. [default: warehouse]"""

    idle_threshold: float | None
    """Dynamic chunks: idle times shorter than this mean nothing, in milliseconds. [default: 0.1]"""

    max_memory: int | str | None
    """Refuse scenes that need more memory than this, e.g. 4G. [default: the memory of the machine]"""

    leg_barrier: bool | None
    """Begin a leg only when everything of the one before is done, as in the paper; slower."""

    physics: Literal["helios", "refined"] | None
    """Reproduce HELIOS++, or switch its known weaknesses off. [default: helios for XML surveys, refined for pipeline files]"""

    correct: str | Sequence[str] | None
    """Switch single corrections on, by name with hyphens, e.g. sum-equal-ranges; a name after no- switches one off. They are listed at the end of --help."""

    echo_width: bool | None
    """Fit a Gaussian to every echo and report its width; echoes narrower than 0.1 ns are dropped."""

    waveform_noise: bool | None
    """Add noise to the written waveforms."""

    fixed_incidence: bool | None
    """Take every surface as hit at right angles."""

    legacy_energy: bool | None
    """Echo strengths by the older energy model."""

    tree: Literal["median", "sah", "axis-sah", "fsah", "bvh"] | None
    """The tree that traces the rays; the points are the same. [default: bvh]"""

    tree_jobs: int | None
    """Threads that build the tree; 0 or nothing = as --threads."""

    instances: Literal["auto", "always", "never"] | None
    """Whether parts of one mesh file share it; the points are the same. [default: auto]"""

    trajectory_out: PathLike | None
    """Write the platform's poses as often as the survey's trajectoryTimeInterval_s asks for (CSV, as --trajectory reads it)."""
