"""Holds a spinning sensor against its recording: python spinning.py VLSCAN RECORDING.parquet CALIBRATION.json OUT

VLSCAN is the program. The recording is a revolution: beam, column, range_mm, reflectivity, signal (see `vlscan fit --help`). It is
divided into bands of four beams, of which every second one is of either part, so that no plane is in both. One part gives noise and
detection; the sensor that was estimated is flown over the planes of the other part as a scene; what it records is fitted in the same way,
and scatter and dropouts are compared by class with those recorded at the same planes. Chance is the same comparison of the recorded
planes of both parts. Writes OUT/figures.md, OUT/figures.json and OUT/noise.png.
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from recordings import read_table, run_script


def run(*command):
    result = subprocess.run([str(part) for part in command], check=True, capture_output=True, text=True)
    print(result.stderr, end="", file=sys.stderr)
    return result.stdout


def fit(vlscan, recording, calibration, out, *options):
    text = run(vlscan, "fit", recording, "--calibration", calibration, "-o", out, "--json", "--force", *options)
    return json.loads(text)


def first(calibration, *names):
    """The first of these keys of a calibration file, at the top or in a section."""
    sections = [calibration] + [value for value in calibration.values() if isinstance(value, dict)]
    return next(section[name] for name in names for section in sections if name in section)


def beams(path):
    """Altitudes and azimuths of the beams (rad), distance of their origin from the axis (m), columns of a revolution."""
    calibration = json.loads(path.read_text())
    altitude = np.radians(first(calibration, "beam_altitude_angles", "beam_altitude_deg"))
    azimuth = np.radians(first(calibration, "beam_azimuth_angles", "beam_azimuth_deg"))
    origin = first(calibration, "lidar_origin_to_beam_origin_mm", "origin_to_beam_mm") / 1000
    return altitude, azimuth, origin, int(first(calibration, "lidar_mode", "mode").split("x")[0])


def directions(sensor):
    """Origins and directions of all beams by beam and column, by the formula of Ouster's manual, with y towards column 0."""
    altitude, azimuth, origin, columns = sensor
    encoder = -2 * np.pi * np.arange(columns) / columns + 0 * altitude[:, None]
    angle = encoder - azimuth[:, None]
    up = altitude[:, None] + 0 * encoder
    directions = np.stack([-np.sin(angle) * np.cos(up), np.cos(angle) * np.cos(up), np.sin(up)], -1)
    return origin * np.stack([-np.sin(encoder), np.cos(encoder), 0 * up], -1), directions


def simulate(vlscan, pipeline, sensor, work):
    """What the pipeline's sensor records: images of range (m, from the axis) and of amplitudes; the largest angle between a point and
    the beam of its pixel (degrees)."""
    points = work / "points.parquet"
    columns = "X,Y,Z,Amplitude,PulseNumber,Device,BeamOriginX,BeamOriginY,BeamOriginZ"
    run(vlscan, "run", pipeline, "-o", points, "--format", "parquet", "--columns", columns, "--force", "-q")
    table = pq.read_table(points)
    value = {name: table[name].to_numpy() for name in table.column_names}
    origins, beam_directions = directions(sensor)
    beam, column = value["Device"].astype(int), value["PulseNumber"].astype(int) - 1
    position = np.stack([value[name] for name in "XYZ"], 1)
    recorded_origin = np.stack([value["BeamOrigin" + name] for name in "XYZ"], 1)
    way = position - recorded_origin
    range_m = np.linalg.norm(way, axis=1)
    cosine = np.einsum("ij,ij->i", way / range_m[:, None], beam_directions[beam, column])
    pattern = np.degrees(np.arccos(np.minimum(cosine, 1))).max(), np.abs(recorded_origin - origins[beam, column]).max()
    ranges, amplitudes = np.zeros(origins.shape[:2]), np.zeros(origins.shape[:2])
    ranges[beam, column] = range_m + sensor[2]
    amplitudes[beam, column] = value["Amplitude"]
    return ranges, amplitudes, pattern


def images(table, shape):
    """The columns of a recording by beam and column."""
    found = {}
    for name in table.column_names:
        found[name] = np.zeros(shape)
        found[name][table["beam"].to_numpy(), table["column"].to_numpy()] = table[name].to_numpy()
    return found


def record(ranges, amplitudes, real, sensor, path):
    """Writes a simulated recording: strengths in the unit of the real ones, which they have in the median."""
    beam, column = np.indices(ranges.shape)
    data = {"beam": beam, "column": column, "range_mm": np.rint(ranges * 1000)}
    both = (ranges > 0) & (real["range_mm"] > 0) & (real["reflectivity"] > 3) & (real["reflectivity"] <= 100)
    way = np.where(ranges > 0, ranges - sensor[2], np.inf)
    true_way = real["range_mm"] / 1000 - sensor[2]
    strength = real["signal"] if "signal" in real else real["reflectivity"] / 100 / np.maximum(true_way, 0.1) ** 2
    simulated = amplitudes * np.median(strength[both] / amplitudes[both])
    white = np.median(strength[both] * true_way[both] ** 2 / real["reflectivity"][both]) if "signal" in real else 0.01
    reflectivity = np.where(ranges > 0, simulated * np.minimum(way, 1e6) ** 2 / white, 0)
    data["reflectivity"] = np.minimum(np.rint(reflectivity) if "signal" in real else reflectivity, 100)
    if "signal" in real:
        data["signal"] = simulated
    pq.write_table(pa.table({name: np.asarray(column, float).ravel() for name, column in data.items()}), path)


BAND = 4  # beams: those of the patches in which planes are looked for


def part_of(table, number, path):
    """Writes the recording with the bands of one part only; other pixels have no echo."""
    is_other = table["beam"].to_numpy().astype(int) // BAND % 2 != number
    data = {name: table[name].to_numpy().copy() for name in table.column_names}
    data["range_mm"] = np.where(is_other, 0, data["range_mm"])
    pq.write_table(pa.table(data), path)
    return path


def row(real, simulated, fitted):
    """A line of the table: the classes of the planes that were not fitted, of the simulated ones, and of the fitted planes."""
    scatter = real["scatter_m"][1]
    other_planes = f"{fitted['scatter_m'][1] / scatter - 1:+.0%}" if fitted else "–"
    mm = lambda value: f"{1000 * value:.1f}"
    lost = lambda figures: f"{100 * figures['dropouts'][1]:.2f}" if figures else "–"
    # A class may have too few simulated echoes.
    other, difference, verdict = "–", "–", "–"
    if simulated:
        ratio = simulated["scatter_m"][1] / scatter
        other, difference, verdict = mm(ratio * scatter), f"{ratio - 1:+.0%}", "yes" if abs(ratio - 1) <= 0.2 else "no"
    low, high = real["limits"]
    return (
        f"| {real['by']} {low:g}–{high:g} | {real['echoes'][1]} | {mm(scatter)} | {other} | {difference} | "
        f"{other_planes} | {verdict} | {lost(real)} | {lost(simulated)} | {lost(fitted)} |"
    )


def picture(real, simulated, fitted, product, path):
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 2, figsize=(8, 3), dpi=80, layout="constrained")
    for axis, by, unit in zip(axes, ("distance", "incidence"), ("m", "°")):
        for figures, half, label, style in (
            (real, 1, "recorded", "ko-"),
            (fitted, 1, "recorded, planes that were fitted", "k.:"),
            (simulated, 1, "simulated", "C1s-"),
        ):
            classes = [c for c in figures["classes"] if c["by"] == by]
            middle = [np.mean(c["limits"]) if by == "incidence" else np.sqrt(max(c["limits"][0], 0.5) * c["limits"][1]) for c in classes]
            axis.plot(middle, [1000 * c["scatter_m"][half] for c in classes], style, label=label, markersize=4)
        axis.set(xlabel=f"{by}, {unit}", ylabel="scatter of ranges, mm", yscale="log")
        axis.set_xscale("log" if by == "distance" else "linear")
        axis.grid(alpha=0.3)
    axes[0].legend(fontsize=7)
    figure.suptitle(f"{product}: ranges around planes", fontsize=9)
    figure.savefig(path)


def main():
    vlscan, recording, calibration, out = (Path(argument) for argument in sys.argv[1:5])
    out.mkdir(parents=True, exist_ok=True)
    sensor = beams(calibration)
    table = read_table(recording, ["beam", "column", "range_mm", "reflectivity"])
    parts = [part_of(table, number, out / f"part_{number}.parquet") for number in (0, 1)]
    fitted = fit(vlscan, parts[0], calibration, out / "sensor.toml", "--planes", out / "fitted_planes.obj")
    real = fit(vlscan, parts[1], calibration, out / "other.toml", "--planes", out / "planes.obj")
    # The fitted sensor before the planes that it was not fitted to.
    text = (out / "sensor.toml").read_text()
    if "fitted_planes.obj" not in text:
        sys.exit(f"{out / 'sensor.toml'} does not name its planes")
    if "\n# range_noise" in text:
        sys.exit(f"the noise of {recording} is no sensor's: is {calibration} the calibration of the sensor that recorded it?")
    (out / "sensor.toml").write_text(text.replace("fitted_planes.obj", "planes.obj"))
    shape = directions(sensor)[0].shape[:2]
    ranges, amplitudes, pattern = simulate(vlscan, out / "sensor.toml", sensor, out)
    record(ranges, amplitudes, images(table, shape), sensor, out / "simulated.parquet")
    simulated = fit(vlscan, out / "simulated.parquet", calibration, out / "again.toml")
    by_class = lambda figures: {(c["by"], *c["limits"]): c for c in figures["classes"]}
    of_simulated, of_fitted = by_class(simulated), by_class(fitted)
    lines = [
        f"{real['product']}: {fitted['planes']} planes fitted, {real['planes']} compared; directions of beams and columns within {pattern[0]:.1e}°, origins within "
        f"{1000 * pattern[1]:.1e} mm of the calibration",
        "",
        "| class | echoes | scatter, mm | simulated | difference | chance | within 20 % | dropouts, % | simulated | fitted planes |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    lines += [row(c, of_simulated.get((c["by"], *c["limits"])), of_fitted.get((c["by"], *c["limits"]))) for c in real["classes"]]
    (out / "figures.md").write_text("\n".join(lines) + "\n")
    (out / "figures.json").write_text(json.dumps({"real": real, "simulated": simulated, "fitted": fitted}, indent=1))
    picture(real, simulated, fitted, real["product"], out / "noise.png")
    print("\n".join(lines))


if __name__ == "__main__":
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    run_script(main)
