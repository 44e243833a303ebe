"""Compares small-footprint waveforms with simulated ones: python wave_packets.py VLSCAN PAIRS.parquet OUT

PAIRS has a row for each pulse, with two lists of samples: tx, the outgoing pulse as digitised, and rx, the received waveform. --step is the
time between samples (1 ns), --divergence the beam's (full angle, rad), --range the distance (m). Pulses with one echo count. The widening
of the narrowest echoes of the even rows is taken as that of the receiver; the odd rows with the narrowest echoes are simulated over a level
plane with their own outgoing pulses, alone and behind the receiver. Writes OUT/figures.md.
"""

import argparse
import shutil
import sys
from pathlib import Path

import numpy as np
import waveforms
from recordings import read_table, run_script
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks
from waveforms import FWHM, convolved, difference, gaussian_width, simulate, widening

COMPARED = 40  # pairs that are simulated
NARROW = 5  # per cent of the pairs whose widening is taken as the receiver's
EDGE = 8  # samples at either end of a waveform, which show its noise


def read(path, step):
    """Pairs of one echo at 1 ns, without their offsets."""
    table = read_table(path, ["tx", "rx"]).select(["tx", "rx"]).to_pydict()
    found, left_out = [], 0
    for number, waves in enumerate(zip(table["tx"], table["rx"])):
        tx, rx = (np.array(wave or [], float) for wave in waves)
        if min(len(tx), len(rx)) < 3 * EDGE or not np.isfinite(np.r_[tx, rx]).all():
            left_out += 1
            continue
        at_ns = lambda wave: np.interp(np.arange(0, (len(wave) - 1) * step + 1e-9), np.arange(len(wave)) * step, wave)
        tx, rx = (at_ns(wave - np.median(np.r_[wave[:EDGE], wave[-EDGE:]])) for wave in (tx, rx))
        noise = 1.4826 * np.median(np.abs(np.r_[rx[:EDGE], rx[-EDGE:]])) + 1e-3 * rx.max()
        modes, _ = find_peaks(gaussian_filter1d(np.pad(rx, EDGE), 1), height=5 * noise, prominence=3 * noise)
        try:
            pulse, width = gaussian_width(tx)[1], gaussian_width(rx)[1]
        except RuntimeError:  # no Gaussian fits
            modes = []
        if len(modes) != 1:
            left_out += 1
            continue
        found.append({"number": number, "tx": tx, "rx": rx, "pulse": pulse, "width": width})
    return found, left_out


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program")
    parser.add_argument("pairs", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--step", type=float, default=1.0)
    parser.add_argument("--divergence", type=float, default=0.0005)
    parser.add_argument("--range", type=float, default=1000.0)
    args = parser.parse_args()
    program = shutil.which(args.program) or parser.error(f"{args.program}: no such program")
    args.out.mkdir(parents=True, exist_ok=True)
    waveforms.HEIGHT, waveforms.FOOTPRINT = args.range, args.divergence * args.range
    pairs, left_out = read(args.pairs, args.step)
    even, odd = ([pair for pair in pairs if pair["number"] % 2 == half] for half in (0, 1))
    if min(len(even), len(odd)) < 20:
        sys.exit(f"{args.pairs}: {len(pairs)} pairs with one echo, and at least 40 are needed")
    receiver, chance = (np.sqrt(max(np.percentile(widening(half), NARROW), 0)) for half in (even, odd))
    narrow = sorted(odd, key=lambda pair: pair["width"] ** 2 - pair["pulse"] ** 2)[:COMPARED]
    table = []
    for pair, other in zip(narrow, narrow[1:] + narrow[:1]):
        waves = [simulate(Path(program).absolute(), pulse, 0.0, args.out) for pulse in (pair["tx"], convolved(pair["tx"], receiver))]
        widths = [FWHM * pair["pulse"], FWHM * pair["width"], *(FWHM * gaussian_width(wave)[1] for wave in waves)]
        table.append(widths + [100 * difference(pair["rx"], wave)[0] for wave in (*waves, other["rx"])])
    lines = [
        f"{len(pairs)} pairs with one echo, {left_out} left out. Receiver (narrowest {NARROW} % of the even pairs): {FWHM * receiver:.2f} ns FWHM; of the odd pairs {FWHM * chance:.2f} ns.",
        "",
        f"| odd pairs with the narrowest echoes, {len(table)} | outgoing, FWHM, ns | received | simulated with the outgoing pulse | behind the receiver | difference of shapes, % of the peak: pulse alone | behind the receiver | chance |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, share in (("10 %", 10), ("median", 50), ("90 %", 90)):
        lines.append(f"| {name} | " + " | ".join(f"{value:.2f}" for value in np.percentile(table, share, axis=0)) + " |")
    (args.out / "figures.md").write_text("\n".join(lines) + "\n")
    print("\n".join(lines))


if __name__ == "__main__":
    run_script(main)
