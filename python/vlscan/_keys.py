"""The keys of tables of pipeline files that are keywords of :class:`vlscan.Leg` and :class:`vlscan.Scanner`, with their types."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from functools import cache
from typing import Any, TypedDict

from numpy.typing import NDArray

from . import _vlscan
from ._typing import PathLike


class LegSettings(TypedDict, total=False):
    """Settings of the scanner: ``[settings]`` of pipeline files."""

    pulse_freq_hz: float
    """Pulses per second. Default: the scanner's first frequency."""

    pulse_times: PathLike
    """File of the times at which pulses leave, in place of ``pulse_freq_hz``: one per line, s from the start of the leg, ascending.
    After the last one the leg goes on without pulses. Platforms that stand, fly straight or follow a trajectory."""

    pulse_intervals_us: Sequence[float] | NDArray[Any]
    """Intervals between pulses in µs that repeat, in place of ``pulse_freq_hz``: ``[0.54, 0.66, 0.84]``."""

    scan_freq_hz: float
    """Lines (``rotating``) or periods (``oscillating``) per second. Default: 0."""

    scan_angle_deg: float
    """Half opening angle of the swath, degrees. Default: the scanner's maximum."""

    vertical_angle_min_deg: float
    """Lowest deflection angle that fires, degrees. Default: from ``scan_angle_deg``."""

    vertical_angle_max_deg: float
    """Highest deflection angle that fires, degrees. Default: from ``scan_angle_deg``."""

    head_rate_deg_per_s: float
    """Speed of the head, degrees per second, signed. Default: 0."""

    head_start_deg: float
    """Angle at which the head starts, degrees. Default: 0."""

    head_stop_deg: float
    """Angle at which the head stops, degrees. Default: 0."""

    vertical_resolution_deg: float
    """Spacing of lines along the mirror's sweep, degrees: with the horizontal one it replaces scan frequency and head speed
    (``rotating`` only)."""

    horizontal_resolution_deg: float
    """Spacing of lines along the head's rotation, degrees."""

    beam_divergence_rad: float
    """Beam divergence of the first channel, rad. Default: the scanner's."""

    trajectory_interval_s: float
    """Spacing of trajectory samples, s; 0 writes none, the default."""

    max_duration_s: float
    """Ends the leg after that time, s. Default: no limit."""

    warmup_s: float
    """The optics move that long before the first pulse, s. Default: 0."""

    weather: Mapping[str, object]
    """Fog, rain, snow and dust between the instrument and the surfaces: ``{ mor_m = 100, rain_mm_h = 10 }``; a table of a leg
    changes the keys that it names; refined physics. Default: none of them."""


class ScannerKeys(TypedDict, total=False):
    """Keys of an instrument: ``[scanner]`` of pipeline files, without ``name``, which :class:`vlscan.Scanner` uses for the catalogue."""

    catalogue: str
    """The id of a scanner that ships (``vlscan catalogue``), for example ``riegl_vz400``, ``file.xml#id``, or the calibration file of
    an Ouster sensor (.json). Not in channels."""

    id: str
    """Name that outputs report. Default: that of the catalogue entry; channels are numbered from 0."""

    optics: str
    """Beam deflector: ``rotating`` (polygon mirror), ``oscillating``, ``conic``, ``line`` (fibres), ``risley`` (prisms) or ``pattern``
    (a table of directions; not in channels)."""

    pulse_freqs_hz: Sequence[float] | NDArray[Any]
    """Pulse frequencies in Hz; the first is the default of a leg. Not in channels."""

    scan_angle_max_deg: float
    """Largest mechanical half angle, degrees."""

    scan_angle_effective_max_deg: float
    """Largest usable half angle, degrees; ``rotating`` only. Default: the mechanical one."""

    facet_tilts_deg: Sequence[float] | NDArray[Any]
    """Angles in degrees by which the facets of the mirror turn the beam towards +x, along its axis, in the order in which they come
    into the beam: each line is a cone around the axis; ``rotating`` only. Default: all lines are plane."""

    scan_angle_along_max_deg: float
    """Largest half angle of an elliptic cone along the flight, degrees; ``conic`` only. Default: a circular cone."""

    scan_reverse: bool
    """The deflector turns, swings or steps the other way. Default: false."""

    scan_phase_deg: float
    """Place of the deflector in its revolution or period at the first pulse of a leg, where it restarts, degrees from 0 to 360 of a
    revolution (``conic``), a facet (``rotating``), a period (``oscillating``), a sequence of fibres (``line``) or a turn of the first
    prism (``risley``, a step before that pulse). Default: 0."""

    scan_axis_tilt_deg: Sequence[float] | NDArray[Any]
    """Tilt of the deflector's axis, degrees: angles about the emitter's x axis and then about its z axis by which the deflected beam is
    turned. Default: ``[0, 0]``."""

    scan_wander: PathLike | Mapping[str, object]
    """Deviation of the deflector from even motion, in the degrees of ``scan_phase_deg``: a file of two columns, seconds from the start
    of the leg and the angle, linear in between; or ``{ amplitude_deg = 0.2, freq_hz = 3, phase_deg = 0 }``, a sine. Not ``line``.
    Default: none."""

    mirror_motion: str
    """``even`` (the default) or ``sine``: motion of the mirror between its reversals; ``oscillating`` only."""

    turning_part: float
    """Share of the time of each sweep in which the mirror reverses, half of it at each end; ``oscillating`` with even motion only.
    Default: 50 pulses at each end."""

    scan_freq_min_hz: float
    """Lowest scan frequency, Hz. Default: 0."""

    scan_freq_max_hz: float
    """Highest scan frequency, Hz; 0 is no limit, the default."""

    scan_product_deg_hz: float
    """Upper limit of half angle (degrees) times scan frequency (Hz); ``oscillating`` only. Default: 1 000 000."""

    fibres: int
    """Number of fibres; ``line`` only. Default: 1."""

    prisms: Sequence[Mapping[str, object]]
    """Prisms in the order in which the beam meets them; ``risley`` only."""

    air_index: float
    """Refractive index of air; ``risley`` only. Default: 1."""

    incident_beam: Sequence[float] | NDArray[Any]
    """Direction of the beam that enters the prisms; ``risley`` only. Default: forward, 0 1 0."""

    pattern: PathLike | Sequence[Sequence[float]] | NDArray[Any]
    """Table of the directions of a ``pattern``, one row per pulse (.csv, .parquet, .npy): ``azimuth_deg`` and ``elevation_deg`` or
    ``zenith_deg``, by ``time_s`` or ``index`` if there is one, by ``channel`` if there are several, with ``origin_x_m``,
    ``origin_y_m``, ``origin_z_m`` and ``divergence_rad`` if they differ; or its rows, ``[[0, 10], [1, 10]]``. Times are those of the
    pulses unless ``pulse_freqs_hz`` is there. Not in channels."""

    pattern_repeat: bool
    """The ``pattern`` starts again after its last row. Default: true; else no more pulses leave in the leg."""

    pattern_azimuth: str
    """Sense of the azimuths of a ``pattern`` seen from above, ``clockwise`` or ``counterclockwise``, from the emitter's y axis. Default:
    ``clockwise``; ``counterclockwise`` in tables with ``zenith_deg``, as those of Livox."""

    head_axis: Sequence[float] | NDArray[Any]
    """Axis of the head's rotation. Default: up, 0 0 1."""

    head_rate_max_deg_per_s: float
    """Highest speed of the head, degrees per second. Default: 0, the head cannot turn."""

    beam_origin: Mapping[str, object]
    """Pose of the emitter on the head. Default: none."""

    firing_offset_us: float
    """Time from the start of a firing cycle, which is a pulse period, to the pulse of the channel, µs. Default: 0, all channels fire at
    once."""

    beam_divergence_rad: float
    """Beam divergence, rad, at 1/e²; of an elliptical beam the one along the emitter's x axis. Default: 0.0003."""

    beam_divergence_y_rad: float
    """Beam divergence along the emitter's z axis, rad; refined physics. Default: the beam is round."""

    beam_profile: str
    """``gaussian`` (the default) or ``top_hat``: even within the divergence; refined physics."""

    exit_aperture_m: float
    """Diameter of the beam where it leaves the instrument, m; refined physics. Default: 0, as small as diffraction allows."""

    pulse_length_ns: float
    """Pulse length, ns. Default: 4."""

    pulse_fwhm_ns: float
    """Full width of the pulse at half maximum, ns, instead of ``pulse_length_ns``, of which it is 0.485."""

    pulse_shape: PathLike
    """File of the pulse's power over time: two columns, ns and power in any unit; refined physics. Default: a raised cosine of the
    width at half maximum."""

    pulse_energy_uj: float
    """Energy of a pulse, µJ; refined physics. Default: by the average power."""

    wavelength_nm: float
    """Wavelength, nm. Default: 1064."""

    average_power_w: float
    """Average power, W. Default: 4."""

    beam_quality: float
    """Beam quality factor M². Default: 1."""

    optical_efficiency: float
    """Optical efficiency. Default: 0.99."""

    receiver_diameter_m: float
    """Receiver diameter, m. Default: 0.15."""

    overlap: Mapping[str, object]
    """Light of near targets that misses the detector: ``{ field_of_view_rad = 0.001, baseline_m = 0.05, focus_m = 50 }``; refined
    physics. Default: all light reaches it."""

    visibility_km: float
    """Atmospheric visibility, km. Default: 23."""

    accuracy_m: float
    """Standard deviation of the range noise, m. Default: 0."""

    range_min_m: float
    """Nearest range, m. Default: 0."""

    range_max_m: float
    """Farthest range, m. Default: unlimited."""

    max_returns: int
    """Maximum number of returns per pulse; 0 = unlimited, the default."""

    received_energy_min_w: float
    """Detection threshold, W. Default: 0.0001."""

    max_range: Mapping[str, object]
    """Target whose echo just reaches the threshold, instead of ``received_energy_min_w``: ``{ range_m = 600, reflectance = 0.9,
    pulse_freq_hz = 100000 }``; refined physics."""

    nep_w: float
    """Noise of detector and amplifier: standard deviation of a sample, W (noise equivalent power); refined physics. Default: no
    noise."""

    snr: Mapping[str, object]
    """The same noise by a target and the ratio of its echo's peak to it: ``{ range_m = 100, reflectance = 0.2, value = 20 }``; refined
    physics."""

    background_w: float
    """Mean power of background light on the detector, W, of which there is shot noise; refined physics. Default: 0."""

    responsivity_a_per_w: float
    """Photocurrent per optical power, A/W; makes shot noise of background light and echoes; refined physics. Default: no shot noise."""

    bandwidth_hz: float
    """Electrical bandwidth of the receiver, Hz; refined physics. Default: 0.44 over the pulse's width at half maximum."""

    saturation_w: float
    """Amplitude at which the receiver saturates, W; refined physics. Default: never."""

    range_walk_m: float
    """Range that an echo right at the threshold is measured too far, m; stronger ones in proportion to threshold over amplitude;
    refined physics. Default: 0."""

    digitiser_clock: bool
    """Samples lie on a grid of bins counted from the emission, instead of beginning with the first return; refined physics. Default:
    false."""

    detector: str
    """How the range of an echo is read from the waveform: ``peak`` (the default), ``centroid`` or ``gaussian`` (fit); or ``photons``:
    every photoelectron is a return of its own; refined physics."""

    range_noise: Mapping[str, object]
    """Standard deviation of the range by the strength of the echo, instead of ``accuracy_m``: ``{ constant_m = 0.005, shot_m = 0.02,
    amplifier_m = 0.01 }``; refined physics."""

    threshold_photons: int
    """Photoelectrons of an echo right at the threshold, a whole number: strengths have the Poisson statistics of photons, so that
    echoes near the threshold are detected now and then; refined physics. Default: strengths do not vary."""

    dropout_rate: float
    """Share of the echoes that are lost whatever their strength; refined physics. Default: 0."""

    dead_time_ns: float
    """Time after an echo during which the receiver detects no other one, ns; refined physics. Default: 0."""

    range_step_m: float
    """Ranges are reported in multiples of it, m; refined physics. Default: 0, any range."""

    receiver_fov_rad: float
    """Field of view of the receiver, full angle, rad: how much light that water has scattered forward it receives
    (``water_beam_attenuation``); refined physics. Default: all of it."""

    refraction_corrected: bool
    """Points below water are where the light was, bent and slowed down by the water's mean surface, instead of on the axis of the beam;
    refined physics. Default: false."""

    fmcw: Mapping[str, object]
    """Frequency-modulated continuous wave: ``{ bandwidth_hz = 1e9, chirp_s = 1e-5 }``; the range resolution is c over twice the
    bandwidth, velocities fold and strengths have speckle; refined physics. Default: pulses."""

    pixels: int
    """Pixels that share the light, each with a dead time; ``detector = "photons"``, refined physics. Default: 1."""

    photon_jitter_ns: float
    """Standard deviation of the times of photons, ns; ``detector = "photons"``, refined physics. Default: 0."""

    dark_counts_hz: float
    """Photoelectrons of a pixel per second without light; ``detector = "photons"``, refined physics. Default: 0."""

    afterpulse: Mapping[str, object]
    """Photoelectrons that earlier ones cause: ``{ probability = 0.01, delay_ns = 10 }``; ``detector = "photons"``, refined physics.
    Default: none."""

    range_error_m: str
    """Metres added to each range, a formula of the deflection angle THETA in radians. Default: none."""

    deflection_error_rad: str
    """Radians added to the deflection angle, a formula of THETA; ``rotating`` only. Default: none."""

    head_error_rad: str
    """Radians added to the head angle, a formula of THETA; ``rotating`` only. Default: none."""

    elevations_deg: Sequence[float] | NDArray[Any]
    """Elevations of the beams of channels, degrees, from channel 0 on, instead of ``[[scanner.channel]]`` tables. Not in channels."""

    azimuths_deg: Sequence[float] | NDArray[Any]
    """Azimuths of the beams of these channels, degrees, clockwise seen from above. Not in channels. Default: 0."""

    origin_radii_m: Sequence[float] | NDArray[Any]
    """Distance of the origin of these beams from that of the emitter, towards azimuth 0, m: one number in brackets, or one for each
    channel. Not in channels. Default: 0."""

    corrections: PathLike
    """File of the angles of these channels, instead of ``elevations_deg``: an angle correction file of Hesai (.csv: channel, elevation,
    azimuth, perhaps firing time) or the beam intrinsics of an Ouster sensor (.json). Not in channels."""

    firing_times: PathLike
    """File of the firing times of these channels, as those of Hesai (.csv: channel, fire time in µs). Not in channels."""

    channel: Sequence[Mapping[str, object]]
    """Channels that fire at the same time. Default: none, the scanner is one device."""


@cache
def known_keys(table: str) -> tuple[str, ...]:
    """Return the keys of a table of pipeline files.

    Parameters
    ----------
    table : str
        Its header: ``[settings]``, ``[scanner]`` and so on.

    Returns
    -------
    tuple of str
        The keys.
    """
    return tuple(dict(_vlscan.keys())[table])


def check_keys(what: str, names: Iterable[str], table: str) -> None:
    """Refuse keywords that are no keys of a table.

    Parameters
    ----------
    what : str
        Name of the class that takes them.
    names : iterable of str
        The keywords.
    table : str
        Header of the table.

    Raises
    ------
    TypeError
        An unknown keyword.
    """
    known = known_keys(table)
    for name in names:
        if name not in known:
            close = get_close_matches(name, known, 1)
            hint = f"did you mean {close[0]!r}?" if close else f"there are {', '.join(known)}"
            raise TypeError(f"{what} has no keyword {name!r}; {hint}")
