"""Holds a simulated photon-counting receiver against recorded photons: python photons.py VLSCAN FOLDER OUT

FOLDER holds *_photons.parquet, *_segments.parquet and *_background.parquet of a beam of ICESat-2 ATL03. The segments (20 m) with even
numbers are fitted: photons per shot, dead time of a pixel, spread of the surface, and the tail of the light below it, as a pulse with
an exponential tail. The segments with odd numbers are compared with simulated shots over a rough plane, of the pulse alone and with its
tail. Chance is the comparison of the even with the odd ones. Writes OUT/figures.md.
"""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
from recordings import read_table, run_script

COLUMNS = {
    "photons": "h_ph pce_mframe_cnt ph_id_pulse ph_id_channel dist_ph_along delta_time",
    "segments": "ph_index_beg segment_ph_cnt segment_length tx_pulse_width_lower",
    "background": "delta_time bckgrd_rate",
}
LIGHT = 0.299792458  # m/ns
CHANNELS_PER_TIMER = 60  # of a weak beam, channels 57 to 60 and 117 to 120 are two timers of the same four pixels
FOOTPRINT = 11.0  # diameter at 1/e², m (Magruder et al. 2020)
SPACING = 0.7  # of shots along the track, m
NEAR = 1.0  # photons so close to the surface are of its echo, m
TAIL = 0.5  # photons farther below it are of the tail, m
WINDOW = 15.0  # others are counted so far from it, m
SHOTS = 4000  # that are simulated
HEIGHT = 490e3  # of the instrument, m
REFLECTANCE = 0.3  # any: the photons of an echo are fitted
# Standard deviation of a raised cosine over its full width at half maximum, and quartiles of a normal distribution.
COSINE = 2 * np.sqrt(1 / 12 - 0.5 / np.pi**2)
QUARTILES = 1.3489795


def table(folder, kind):
    paths = list(Path(folder).glob(f"*_{kind}.parquet"))
    if len(paths) != 1:
        sys.exit(f"{folder} has {len(paths)} files *_{kind}.parquet, expected one: a beam of ICESat-2 ATL03")
    (path,) = paths
    return {name: np.array(column) for name, column in read_table(path, COLUMNS[kind].split()).to_pydict().items()}


class Photons:
    """Heights over the surface (m), pixels and shots of photons, number of shots that were fired, and of pixels."""

    def __init__(self, height, pixel, shot, fired, pixels):
        self.height, self.pixel, self.shot, self.fired, self.pixels = height, pixel, shot, fired, pixels

    def of_surface(self):
        near = np.abs(self.height) < NEAR
        return Photons(self.height[near], self.pixel[near], self.shot[near], self.fired, self.pixels)

    def level(self):
        """Photons of the surface per shot, and standard deviation of their heights by the quartiles, m."""
        near = self.of_surface()
        return len(near.shot) / self.fired, np.subtract(*np.percentile(near.height, [75, 25])) / QUARTILES

    def counts(self):
        """Share of the shots with 0, 1, 2 … photons of the surface."""
        _, lit = np.unique(self.of_surface().shot, return_counts=True)
        counts = np.bincount(lit, minlength=12)[:12].astype(float)
        counts[0] = self.fired - len(lit)
        return counts / self.fired

    def tail(self):
        """Photons below the surface without those of background light, per photon within TAIL of it; their mean depth beyond TAIL, m."""
        below, above = (sign * self.height[(sign * self.height > TAIL) & (sign * self.height < WINDOW)] - TAIL for sign in (-1, 1))
        excess = len(below) - len(above)
        return excess / (np.abs(self.height) < TAIL).sum(), (below.sum() - above.sum()) / max(excess, 1)

    def own_pixel(self):
        """Of the photons of the tail the share that follow one of the echo in their pixel, and that share of the pixels in shots with photons."""
        far = (self.height < -NEAR) & (self.height > -WINDOW)
        near = np.abs(self.height) < NEAR
        key = self.shot.astype(np.int64) * 1000 + self.pixel.astype(np.int64)
        lit = np.unique(key[near])
        return np.isin(key[far], lit).mean(), len(lit) / (self.pixels * len(np.unique(self.shot)))

    def pairs(self):
        """Distances of all pairs of photons of a shot, and whether both are of one pixel."""
        found = []
        near = self.of_surface()
        order = np.argsort(near.shot, kind="stable")
        for group in np.split(order, np.flatnonzero(np.diff(near.shot[order])) + 1):
            for i, a in enumerate(group):
                found += [(abs(near.height[a] - near.height[b]), near.pixel[a] == near.pixel[b]) for b in group[:i]]
        distance, same = np.array(found).reshape(-1, 2).T
        return distance, same > 0.5

    def figures(self, dead):
        """Name, value and format of all figures."""
        near, (distance, same) = self.of_surface(), self.pairs()
        counts = self.counts()
        quartiles = np.subtract(*np.percentile(near.height, [75, 25]))
        rows = [("photons of the surface per shot", len(near.shot) / self.fired, "{:.3f}")]
        rows.append(("variance of their number", float(np.dot(counts, np.arange(12) ** 2) - np.dot(counts, np.arange(12)) ** 2), "{:.2f}"))
        rows += [(f"shots with {n} photons, %", 100 * counts[n], "{:.1f}") for n in range(6)]
        rows.append(("quartiles of heights, m", quartiles, "{:.3f}"))
        rows.append(("5 % to 95 % of heights, m", np.subtract(*np.percentile(near.height, [95, 5])), "{:.3f}"))
        rows.append(("pairs of one pixel, % of all", 100 * same.mean(), "{:.1f}"))
        rows.append((f"of these closer than {dead:.2f} m, %", 100 * (distance[same] < dead).mean(), "{:.1f}"))
        rows.append((f"pairs of two pixels closer than {dead:.2f} m, %", 100 * (distance[~same] < dead).mean(), "{:.1f}"))
        rows.append(("median distance of these pairs, m", np.median(distance[~same]), "{:.3f}"))
        far = (np.abs(self.height) >= NEAR) & (np.abs(self.height) < WINDOW)
        above, below = (far & (self.height > 0)).sum(), (far & (self.height < 0)).sum()
        rows.append((f"photons {NEAR:.0f} to {WINDOW:.0f} m above the surface, per 1000 shots", 1000 * above / self.fired, "{:.1f}"))
        rows.append((f"photons {NEAR:.0f} to {WINDOW:.0f} m below it, per 1000 shots", 1000 * below / self.fired, "{:.1f}"))
        return rows


def recorded(folder):
    """Photons of the even and the odd segments, mean width of the pulses (ns) and rate of background (Hz)."""
    photons, segments = table(folder, "photons"), table(folder, "segments")
    background = table(folder, "background")
    number = np.zeros(len(photons["h_ph"]), int)
    for i, (begin, count) in enumerate(zip(segments["ph_index_beg"], segments["segment_ph_cnt"])):
        first = begin - segments["ph_index_beg"][0]
        number[first : first + count] = i
    shot = photons["pce_mframe_cnt"].astype(np.int64) * 1000 + photons["ph_id_pulse"]
    height = np.zeros(len(number))
    for i in np.unique(number):
        own = number == i
        way, h = photons["dist_ph_along"][own], photons["h_ph"][own]
        # A line through the surface of the segment, by the photons that are near it.
        near = np.abs(h - np.median(h)) < 2 * NEAR
        for _ in range(5):
            line = np.polyfit(way[near], h[near], 1)
            residual = h - np.polyval(line, way)
            near = np.abs(residual) < 3 * max(np.subtract(*np.percentile(residual[near], [75, 25])) / QUARTILES, 0.05)
        height[own] = residual
    pixel = photons["ph_id_channel"] % CHANNELS_PER_TIMER
    halves = []
    for half in range(2):
        own = number % 2 == half
        fired = round(segments["segment_length"][half::2].sum() / SPACING)
        halves.append(Photons(height[own], pixel[own], shot[own], fired, len(np.unique(pixel))))
    time = photons["delta_time"]
    during = (background["delta_time"] >= time.min()) & (background["delta_time"] <= time.max())
    if not during.any():
        sys.exit(f"{folder}: the background was not counted while the photons were recorded")
    rate = np.median(background["bckgrd_rate"][during])
    return halves, segments["tx_pulse_width_lower"].mean() * 1e9, rate


def write_pulse(path, width, share, depth):
    """A raised cosine of that full width at half maximum (ns), and a tail of a share of its energy that falls to 1/e over that depth (m)."""
    time = np.arange(-width, 2 * WINDOW / LIGHT, 0.1)
    pulse = np.where(np.abs(time) < width, 0.5 + 0.5 * np.cos(np.pi * time / width), 0)
    decay = 2 * depth / LIGHT
    # The tail begins with the light: the pulse is convolved with it.
    tail = np.convolve(pulse, np.exp(-np.arange(0, 10 * decay, 0.1) / decay))[: len(time)] * 0.1 / decay
    power = pulse * (1 - share) + tail * share
    path.write_text("".join(f"{t - time[0]:.1f} {p:.6f}\n" for t, p in zip(np.r_[time, time[-1] + 0.1], np.r_[power, 0])))


def simulated(vlscan, out, mean, dead_ns, roughness, width, background, shots, pixels, tail=None):
    """Photons of simulated shots over a plane with that standard deviation of heights, m; `tail`: share and depth (m) of the pulse's."""
    pulse = f"pulse_fwhm_ns = {width}"
    if tail:
        write_pulse(out / "pulse.txt", width, *tail)
        pulse = 'pulse_shape = "pulse.txt"'
    random = np.random.default_rng(1)
    steps = np.arange(-12, 12.01, 0.5)
    heights = random.normal(0, roughness, (len(steps), len(steps)))
    lines = ["mtllib ice.mtl", "usemtl ice"]
    lines += [f"v {x} {y} {heights[i, j]:.4f}" for i, x in enumerate(steps) for j, y in enumerate(steps)]
    n = len(steps)
    for i in range(n - 1):
        for j in range(n - 1):
            a, b = i * n + j + 1, (i + 1) * n + j + 1
            lines += [f"f {a} {b} {b + 1}", f"f {a} {b + 1} {a + 1}"]
    (out / "ice.obj").write_text("\n".join(lines) + "\n")
    (out / "ice.mtl").write_text(f"newmtl ice\nhelios_reflectance {REFLECTANCE}\n")
    # The target of one photoelectron in each pixel: a reflectance, or if it is above 1 a white target that is as bright from nearer.
    reflectance = REFLECTANCE * pixels / mean
    target = HEIGHT / np.sqrt(max(reflectance, 1)), min(reflectance, 1)
    channels = "\n".join(f'[[scanner.channel]]\nid = "{pixel}"' for pixel in range(pixels))
    (out / "shots.toml").write_text(
        f"""scene = "ice.obj"
[platform]
kind = "static"
mount = {{ rotate_deg = [{{ x = -90 }}] }}
[scanner]
id = "counter"
optics = "conic"
pulse_freqs_hz = [10000]
wavelength_nm = 532
beam_divergence_rad = {FOOTPRINT / HEIGHT}
{pulse}
pulse_energy_uj = 27
receiver_diameter_m = 0.8
visibility_km = 1e6
range_min_m = {HEIGHT - WINDOW}
range_max_m = {HEIGHT + WINDOW}
detector = "photons"
# {pixels} pixels; together an echo of {mean:.3f} photoelectrons, and {background:.0f} of background a second
threshold_photons = 1
max_range = {{ range_m = {target[0]}, reflectance = {target[1]} }}
dead_time_ns = {dead_ns}
background_w = {background / pixels * 1.602176634e-19 / 0.1}
responsivity_a_per_w = 0.1
{channels}
[settings]
max_duration_s = {shots / 10000}
[waveform]
bin_ns = 0.1
quality = 6
[[leg]]
position_m = [0, 0, {HEIGHT}]
[[output]]
path = "shots.csv"
"""
    )
    command = [vlscan, "run", "shots.toml", "--force", "-q", "--columns", "PulseNumber,Range,Device"]
    subprocess.run([str(part) for part in command], check=True, cwd=out)
    shot, distance, pixel = np.loadtxt(out / "shots.csv", delimiter=",", skiprows=1, ndmin=2).T
    height = HEIGHT - distance
    return Photons(height - np.median(height), pixel, shot, shots, pixels)


def fitted(vlscan, out, even, dead, width, background, tail):
    """The simulation that has as many photons of the surface per shot, and their spread: photons that arrive, roughness (m), photons."""
    wanted, spread = even.level()
    mean, roughness = wanted, np.sqrt(max(spread**2 - (width * COSINE * LIGHT / 2) ** 2, 0.05**2))
    # Of the photons of a pixel the first one is seen: fewer than arrive, and closer together.
    for _ in range(5):
        model = simulated(vlscan, out, mean, 2 * dead / LIGHT, roughness, width, background, SHOTS, even.pixels, tail)
        level, seen = model.level()
        mean *= wanted / level
        roughness = np.sqrt(max(roughness**2 + spread**2 - seen**2, 0))
    return mean, roughness, model


def main(vlscan, folder, out):
    out = Path(out)
    program = shutil.which(vlscan)
    if program is None:
        sys.exit(f"{vlscan}: no such program")
    vlscan = Path(program).absolute()
    out.mkdir(parents=True, exist_ok=True)
    (even, odd), width, background = recorded(folder)
    distance, same = even.pairs()
    if not same.any() or len(even.of_surface().shot) < 100 or odd.of_surface().fired == 0:
        sys.exit(f"{folder}: {len(even.of_surface().shot)} photons of the surface, {same.sum()} pairs of one pixel: too few to estimate a receiver")
    # Light that comes back from within crowns is no echo of one surface.
    far = np.mean(np.abs(even.height) > NEAR)
    if far > 0.5:
        print(f"{far:.0%} of the photons are more than {NEAR:.0f} m from the surface, of background or of crowns: a rough plane has none of the latter")
    dead = distance[same].min()
    wanted, _ = even.level()
    alone = fitted(vlscan, out, even, dead, width, background, None)
    # The tail that makes as many photons below the surface as were recorded, as deep.
    (share, depth), found = even.tail(), (0.03, 2.0)
    tail = found
    for _ in range(5):
        with_tail = fitted(vlscan, out, even, dead, width, background, tail)
        seen, seen_depth = with_tail[2].tail()
        found = tail
        tail = (min(tail[0] * share / seen, 0.9), tail[1] * depth / seen_depth)
    for name, (mean, roughness, _) in (("pulse alone", alone), (f"tail of {100 * found[0]:.1f} % with {2 * found[1] / LIGHT:.1f} ns", with_tail)):
        print(f"even segments, {name}: {wanted:.3f} photons per shot of {mean:.3f} that arrive, dead time {2 * dead / LIGHT:.2f} ns, "
              f"surface {roughness:.3f} m, pulse {width:.2f} ns, background {background:.0f} Hz")
    for name, half in (("even", even), ("odd", odd)):
        print("{} segments: {:.0%} of the photons below the surface follow one of their pixel; {:.0%} of the pixels have one".format(name, *half.own_pixel()))
    rows = zip(odd.figures(dead), alone[2].figures(dead), with_tail[2].figures(dead), even.figures(dead))
    lines = ["| odd segments | recorded | pulse alone | with its tail | chance (even segments) |", "|---|---|---|---|---|"]
    for (name, value, form), (_, other, _), (_, tailed, _), (_, chance, _) in rows:
        lines.append(f"| {name} | {form.format(value)} | {form.format(other)} | {form.format(tailed)} | {form.format(chance)} |")
    (out / "figures.md").write_text("\n".join(lines) + "\n")
    print("\n".join(lines))


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    run_script(lambda: main(*sys.argv[1:]))
