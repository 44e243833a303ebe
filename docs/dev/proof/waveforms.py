"""Holds received waveforms against transmitted ones: python waveforms.py VLSCAN SHOTS.parquet OUT

SHOTS are shots of GEDI L1B: beam, delta_time, tx, rx (1 ns), noise_mean, noise_stddev, latitude and longitude, elevations of the first
and the last bin. Ground echoes with one mode are compared with the transmitted pulse and the slope along the track. The widening of the
narrowest echoes of the shots with even numbers is taken as that of the receiver; the shots with odd numbers that have the narrowest
echoes are simulated over a plane of their slope, with the transmitted pulse alone and with the receiver. Writes OUT/figures.md and
OUT/shot.png.
"""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
from recordings import read_table, run_script
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import curve_fit
from scipy.signal import find_peaks

COLUMNS = (
    "beam delta_time tx rx noise_mean noise_stddev latitude_bin0 longitude_bin0 elevation_bin0 elevation_lastbin".split()
)
LIGHT = 0.299792458  # m/ns
FWHM = np.sqrt(8 * np.log(2))
FOOTPRINT = 25.0  # diameter at 1/e², m
HEIGHT = 420e3  # of the instrument, m
NEAR = 60  # samples on either side of a mode that are fitted
COMPARED = 8  # shots that are simulated
NARROW = 5  # per cent of the shots whose widening is taken as the receiver's


def gaussian_width(wave):
    """Centre and standard deviation of a Gaussian at the largest mode, ns."""
    top = int(np.argmax(gaussian_filter1d(wave, 3)))
    near = np.arange(max(top - NEAR, 0), min(top + NEAR, len(wave)))
    model = lambda x, height, centre, width: height * np.exp(-0.5 * ((x - centre) / width) ** 2)
    (_, centre, width), _ = curve_fit(model, near, wave[near], [wave[top], top, 8])
    return centre, abs(width)


def read(path):
    """Shots with one mode: widths of pulses and echoes (σ, ns), ground height (m), slope along the track."""
    shots = read_table(path, COLUMNS).to_pydict()
    found, empty = [], 0
    for i in range(len(shots["beam"])):
        rx = np.array(shots["rx"][i] or [], float) - (shots["noise_mean"][i] or 0)
        tx = np.array(shots["tx"][i] or [], float)
        # Shots without an echo, through clouds say, or without a transmitted pulse.
        if len(rx) < 2 * NEAR or len(tx) < NEAR or not np.isfinite(np.r_[rx, tx]).all() or rx.max() < 4 * (shots["noise_stddev"][i] or np.inf):
            empty += 1
            continue
        tx = tx - np.median(np.r_[tx[:20], tx[-20:]])
        noise = shots["noise_stddev"][i]
        smooth = gaussian_filter1d(rx, 4)
        modes, _ = find_peaks(smooth, height=2 * noise, prominence=noise)
        centre, width = gaussian_width(rx)
        first, last = shots["elevation_bin0"][i], shots["elevation_lastbin"][i]
        found.append(
            {
                "beam": shots["beam"][i], "number": i, "time": shots["delta_time"][i], "rx": rx, "tx": tx, "noise": noise,
                "modes": len(modes), "centre": centre, "width": width, "pulse": gaussian_width(tx)[1],
                "ground": first + (last - first) * centre / (len(rx) - 1),
                "place": np.array([np.radians(shots["longitude_bin0"][i]) * np.cos(np.radians(shots["latitude_bin0"][i])), np.radians(shots["latitude_bin0"][i])]) * 6.371e6,
                "slope": np.nan,
            }
        )
    for beam in {shot["beam"] for shot in found}:
        line = sorted((shot for shot in found if shot["beam"] == beam), key=lambda shot: shot["time"])
        for before, shot, after in zip(line, line[1:], line[2:]):
            way = np.linalg.norm(after["place"] - before["place"])
            if way < 150:
                shot["slope"] = (after["ground"] - before["ground"]) / way
    if empty:
        print(f"{empty} of {len(shots['beam'])} shots have no echo or no transmitted pulse; they are left out")
    return [shot for shot in found if shot["modes"] == 1 and np.isfinite(shot["slope"])]


def widening(shots):
    """Excess of the echo over the pulse, σ² in ns²."""
    return np.array([shot["width"] ** 2 - shot["pulse"] ** 2 for shot in shots])


def of_slope(slope):
    """Widening by a slope over the footprint, σ in ns."""
    return 2 * FOOTPRINT / 4 / LIGHT * abs(slope)


def simulate(vlscan, pulse, slope, out):
    """Width (σ, ns) and waveform of the echo of a plane with that slope, of a pulse with these samples at 1 ns."""
    floor = pulse.max() * 0.01
    first, last = np.flatnonzero(pulse > floor)[[0, -1]]
    samples = np.maximum(pulse[first : last + 1], 0)
    (out / "pulse.txt").write_text("".join(f"{k} {power}\n" for k, power in enumerate(np.r_[0, samples, 0])))
    corners = [(x, y) for x, y in ((-200, -200), (200, -200), (200, 200), (-200, 200))]
    lines = [f"v {x} {y} {slope * y}" for x, y in corners]
    (out / "ground.mtl").write_text("newmtl ground\nhelios_reflectance 0.3\n")
    (out / "ground.obj").write_text("mtllib ground.mtl\nusemtl ground\n" + "\n".join(lines) + "\nf 1 2 3 4\n")
    (out / "shot.toml").write_text(
        f"""scene = "ground.obj"
[platform]
kind = "static"
mount = {{ rotate_deg = [{{ x = -90 }}] }}
[scanner]
id = "gedi"
optics = "conic"
pulse_freqs_hz = [242]
wavelength_nm = 1064
beam_divergence_rad = {FOOTPRINT / HEIGHT}
pulse_shape = "pulse.txt"
pulse_energy_uj = 10000
receiver_diameter_m = 0.8
visibility_km = 1e6
received_energy_min_w = 1e-12
[settings]
max_duration_s = 0.001
[waveform]
bin_ns = 1
window_ns = 20
quality = 12
[[leg]]
position_m = [0, 0, {HEIGHT}]
[[output]]
path = "shot.xyz"
"""
    )
    command = [vlscan, "run", "shot.toml", "--waveforms", "--force", "-q"]
    subprocess.run([str(part) for part in command], check=True, cwd=out)
    # Number, origin, direction, first and last time, time of the pulse, samples.
    line = (out / "shot_fullwave.txt").read_text().split("\n")[0].split()
    return np.array(line[10:], float)


def convolved(pulse, width):
    """The pulse behind a receiver with a Gaussian response of that standard deviation, ns."""
    return gaussian_filter1d(np.pad(pulse, 60), width) if width > 0 else pulse


def difference(real, simulated):
    """Root mean square of the difference of two echoes over the peak, after shift and scale, within 60 ns of the peak."""
    top = gaussian_width(real)[0]
    at = gaussian_width(simulated)[0]
    time = np.arange(-60, 61)
    one = np.interp(top + time, np.arange(len(real)), real)
    other = np.interp(at + time, np.arange(len(simulated)), simulated, left=0, right=0)
    other *= (one @ other) / (other @ other)
    return np.sqrt(np.mean((one - other) ** 2)) / one.max(), time, one / one.max(), other / one.max()


def picture(shot, alone, behind, path):
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axis = pyplot.subplots(figsize=(6, 3), dpi=80, layout="constrained")
    _, time, real, other = difference(shot["rx"], behind)
    axis.plot(time, real, "k", label="received")
    axis.plot(time, difference(shot["rx"], alone)[3], "C0:", label="simulated, transmitted pulse")
    axis.plot(time, other, "C1--", label="simulated, behind the receiver")
    axis.set(xlabel="time, ns", ylabel="power over the peak", title=f"{shot['beam']}, shot {shot['number']}")
    axis.legend(fontsize=7)
    axis.grid(alpha=0.3)
    figure.savefig(path)


def main():
    program, path, out = shutil.which(sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[3])
    if program is None:
        sys.exit(f"{sys.argv[1]}: no such program")
    program = Path(program).absolute()
    out.mkdir(parents=True, exist_ok=True)
    shots = read(path)
    fitted = [shot for shot in shots if shot["number"] % 2 == 0]
    others = [shot for shot in shots if shot["number"] % 2 == 1]
    if min(len(fitted), len(others)) < COMPARED:
        sys.exit(f"{path}: {len(fitted)} even and {len(others)} odd shots with an echo of one mode and a slope, expected {COMPARED} of either")
    lines = ["| beam | shots | pulse, FWHM, ns | echo | widening, 5 % / median | slope along the track, rms | widening by it, ns |", "|---|---|---|---|---|---|---|"]
    root = lambda squares: np.sqrt(np.maximum(squares, 0))
    for beam in sorted({shot["beam"] for shot in shots}):
        of_beam = [shot for shot in shots if shot["beam"] == beam]
        value = lambda name: np.array([shot[name] for shot in of_beam])
        low, middle = FWHM * root(np.percentile(widening(of_beam), [NARROW, 50]))
        slope = np.sqrt(np.mean(value("slope") ** 2))
        lines.append(
            f"| {beam} | {len(of_beam)} | {FWHM * np.median(value('pulse')):.1f} | {FWHM * np.median(value('width')):.1f} | {low:.1f} / {middle:.1f} | {slope:.4f} | {FWHM * of_slope(slope):.1f} |"
        )
    receiver = root(np.percentile(widening(fitted), NARROW))
    chance = root(np.percentile(widening(others), NARROW))
    slopes, excess = np.abs([shot["slope"] for shot in shots]), widening(shots)
    correlation = np.corrcoef(np.argsort(np.argsort(slopes)), np.argsort(np.argsort(excess)))[0, 1]
    lines += [
        "",
        f"Receiver (narrowest {NARROW} % of the even shots): {FWHM * receiver:.2f} ns FWHM; of the odd shots {FWHM * chance:.2f} ns. Rank correlation of widening and slope along the track: {correlation:.2f} ({len(shots)} shots).",
        "",
        "| odd shots with the narrowest echoes | received, FWHM, ns | simulated with the transmitted pulse | behind the receiver | difference of shapes, % of the peak: pulse alone | behind the receiver | chance |",
        "|---|---|---|---|---|---|---|",
    ]
    smooth = sorted(others, key=lambda shot: shot["width"] ** 2 - shot["pulse"] ** 2)[:COMPARED]
    table = []
    for shot, other in zip(smooth, smooth[1:] + smooth[:1]):
        alone = simulate(program, shot["tx"], shot["slope"], out)
        behind = simulate(program, convolved(shot["tx"], receiver), shot["slope"], out)
        figures = [FWHM * shot["width"], FWHM * gaussian_width(alone)[1], FWHM * gaussian_width(behind)[1]]
        figures += [100 * difference(shot["rx"], wave)[0] for wave in (alone, behind, other["rx"])]
        table.append(figures)
        lines.append(f"| {shot['beam']}, {shot['number']} | " + " | ".join(f"{figure:.1f}" for figure in figures) + " |")
        if shot is smooth[0]:
            picture(shot, alone, behind, out / "shot.png")
    lines.append("| median | " + " | ".join(f"{figure:.1f}" for figure in np.median(table, axis=0)) + " |")
    (out / "figures.md").write_text("\n".join(lines) + "\n")
    print("\n".join(lines))


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    run_script(main)
