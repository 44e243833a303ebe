"""The options of a run. `vlscan man --python` writes this file from the options of the command line: do not edit it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from typing import Literal, TypedDict

from ._typing import PathLike, Vector


class RunOptions(TypedDict, total=False):
    """Options of :meth:`vlscan.Survey.run`: those of the command line with underscores. ``None`` is an option not given."""

    format: Literal["xyz", "csv", "bin", "las", "laz", "copc", "ply", "ply-ascii", "raycloud", "pcd", "e57", "mcap", "arrow", "parquet", "geoparquet"] | None
    """Format of the points where the extension does not determine it."""

    output: PathLike | None
    """Write as HELIOS++ does: DIR/SURVEY/TIME/leg000_points.xyz and so on. [default without -o: output]"""

    columns: str | Iterable[str] | None
    """Columns of csv, arrow, parquet and geoparquet, and of xyz (which then gets a header), such as X,Y,Z,Intensity,GpsTime. With Red, Green or Blue, las, laz, ply, pcd, e57 and mcap have colours, too. docs/outputs.md lists all columns, as does the message for an unknown name."""

    frame_s: float | None
    """Duration of the frames of mcap. [default: a revolution of a spinning scanner, 0.1 for others]"""

    world_frame: str | None
    """Coordinate frame of mcap in which the scanner moves. [default: map]"""

    sensor_frame: str | None
    """Coordinate frame of the scanner in mcap. [default: lidar]"""

    tile: float | None
    """Divide the points of a folder (-o DIR) into square tiles with this edge length in metres, tile_X_Y, instead of legs."""

    las_at_most: int | str | None
    """Stream LAS to a pipe without a temporary file, with N as the number of points in its header (250k, 1G). Most readers accept fewer points; more are an error."""

    wave_packets: Literal["inside", "beside"] | None
    """Write waveforms as packets that the points of LAS and LAZ refer to (LAS 1.4, point format 9), inside that file or beside it as .wdp."""

    crs: int | PathLike | None
    """Coordinate reference system of the scene: EPSG:25832, WKT, or a file that holds either."""

    las_scale: float | None
    """Resolution of LAS coordinates in metres. [default: 0.0001, coarser if the scene is too wide for it]"""

    las_extra: Literal["all", "helios", "none"] | None
    """Extra bytes of the points of LAS and LAZ: all, the four of HELIOS++, or none, for programs that reject them. [default: all]"""

    force: bool | None
    """Replace existing files once the new ones are complete."""

    labels: bool | None
    """Also write part, primitive and true range to las, laz and ply; csv, arrow, parquet and geoparquet always have them."""

    true_positions: bool | None
    """Also write positions without navigation errors (TrueX, TrueY, TrueZ) to las and laz; for csv, arrow and parquet use --columns."""

    height_above_ground: bool | None
    """Write the height above ground (HeightAboveGround), also to las, laz and ply. Ground is every surface whose material is ground (helios_isGround), or the lowest surfaces if the scene has no such material."""

    per_object: bool | None
    """Divide the points of a folder (-o DIR) by the object that was hit, object_N, instead of legs."""

    subrays: bool | None
    """Write what each subray hit instead of points, at its position on the surface, with the number of the return that it contributes to (0 = none): for leaf area and machine learning. --columns selects Subray, SurfaceX, NormalX, FootprintFraction and so on, with or without this option."""

    misses: bool | None
    """Also write pulses without echoes: 0 returns, at the beam's origin, with the beam's direction."""

    split_by_channel: bool | None
    """One point file per device of a multi-channel scanner."""

    las_output: bool | None
    """With --output: LAS 1.4 instead of text."""

    las10: bool | None
    """LAS 1.0 instead of 1.4; with --output also instead of text."""

    zip_output: bool | None
    """Waveforms and pulses as compressed text (.bin); with --output also LAZ instead of LAS, and compressed text instead of text."""

    trajectory_format: Literal["text", "helios", "sbet", "terrascan"] | None
    """Layout of the trajectory. [default: detected from its content]"""

    trajectory_columns: str | Sequence[str] | None
    """Columns of text: names in order (time, x, y, z, roll, pitch, yaw, lat, lon, qx, qy, qz, qw; others are skipped) or name=number, from 1; a name may have a unit: roll[rad]. [default: the heading, else time,x,y,z,roll,pitch,yaw]"""

    trajectory_separator: str | None
    """Character between columns of text. [default: detected from the first line]"""

    trajectory_angles: Literal["deg", "rad"] | None
    """Unit of angles in text whose column names have no unit. [default: deg]"""

    trajectory_rotation: Literal["heading", "yaw", "ros", "helios", "canonical", "camera"] | None
    """Meaning of the angles of text, or axes of its quaternions and matrices. [default: ros for quaternions and matrices, helios for files as HELIOS++ reads and writes them, else heading]"""

    utm_zone: str | None
    """UTM zone to which latitudes and longitudes are projected, such as 32N. [default: that of --crs, else that of the first pose]"""

    height_offset: float | None
    """Added to all heights of the trajectory, in metres, for example to convert ellipsoidal heights to those of the scene."""

    lever_arm: str | Vector | None
    """Lever arm: position of the scanner's platform frame relative to the recorded position, in metres to the right, forward and up of the recorded body. It rotates with the attitude, not with the boresight."""

    boresight: str | Vector | None
    """Boresight: rotation of the scanner's platform frame in the recorded body: roll (right side down), pitch (nose up) and heading (clockwise from above) in degrees, roll innermost. A point is at position + attitude (lever arm + boresight (point in the frame of the platform's scanner))."""

    max_gap: float | None
    """Do not fire between poses that are farther apart than this, in seconds."""

    latency: float | None
    """How long, in seconds, points of a live trajectory may wait to be computed in larger batches. [default: 0.25]"""

    navigation_error: Mapping[str, float | Sequence[float]] | Sequence[Mapping[str, float | Sequence[float]]] | None
    """Add navigation errors: the reported pose, with which points are georeferenced, differs from the true one. A key of [navigation_errors] of pipeline files with one number or three, such as position_m=0.02,0.02,0.05, attitude_deg=0.004, boresight_deg=0,0.01,0; may be given more than once."""

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
    """Number of threads; 0 = all, the default. Does not change the points."""

    chunk_size: int | None
    """Pulses per chunk. [default: 1024]"""

    warehouse_factor: int | None
    """Chunks per worker that may wait in the queue. [default: 4]"""

    schedule: Literal["warehouse", "dynamic", "static", "single"] | None
    """How pulses are handed out to the threads; the points are the same. [default: warehouse]"""

    idle_threshold: float | None
    """Dynamic chunks: idle times shorter than this are ignored, in milliseconds. [default: 0.1]"""

    max_memory: int | str | None
    """Reject scenes that need more memory than this, e.g. 4G. [default: the memory of the machine]"""

    scene_memory: int | str | None
    """Load the parts of the scene when rays come near, and drop them when they need more memory than this together with their trees, e.g. 2G; does not change the points. [default: the scene is loaded whole]"""

    leg_barrier: bool | None
    """Begin a leg only when the previous one is finished, as in the paper; slower."""

    physics: Literal["helios", "refined"] | None
    """Reproduce HELIOS++, or correct its known weaknesses. [default: helios for XML surveys, refined for pipeline files]"""

    correct: str | Sequence[str] | None
    """Switch single corrections on (sum-equal-ranges) or off (no-sum-equal-ranges). They are listed at the end of --help."""

    max_order: int | None
    """Maximum number of mirrors, panes and surfaces of water on the way of light, 0 to 64; with 0 they are opaque. [default: 4]"""

    echo_width: bool | None
    """Fit a Gaussian to every echo and report its width; echoes narrower than 0.1 ns are dropped."""

    waveform_noise: bool | None
    """Add noise to the written waveforms."""

    fixed_incidence: bool | None
    """Treat every surface as hit at right angles."""

    legacy_energy: bool | None
    """Compute echo strengths with the older energy model."""

    tree: Literal["median", "sah", "axis-sah", "fsah", "bvh"] | None
    """Acceleration structure for tracing; does not change the points. [default: bvh]"""

    tree_jobs: int | None
    """Threads that build the tree; 0 = as --threads, the default."""

    instances: Literal["auto", "always", "never"] | None
    """Share triangles among parts of the same mesh file; does not change the points. [default: auto]"""

    trajectory_out: PathLike | None
    """Write the platform's poses as often as the survey's trajectoryTimeInterval_s asks for (CSV, as --trajectory reads it)."""
