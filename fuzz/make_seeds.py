#!/usr/bin/env python3
"""make_seeds.py VLSCAN: writes small valid files for every fuzz target to seeds/, with the program and struct alone."""
import os, re, struct, subprocess, sys, tempfile
from pathlib import Path

vlscan = os.path.abspath(sys.argv[1])
here = Path(__file__).parent
seeds = here / "seeds"
root = here.parent


def seed(target, name, data):
    folder = seeds / target
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_bytes(data.encode() if isinstance(data, str) else data)


def small_survey():
    """The files of the small survey, as targets.rs holds them."""
    text = (here / "targets.rs").read_text()
    text = text[text.index("const FILES"):]
    pair = re.compile(r'\(\s*"([\w.]+)",\s*"((?:[^"\\]|\\.|\\\n)*)",?\s*\)', re.S)
    for name, content in pair.findall(text):
        content = re.sub(r"\\\n\s*", "", content)
        yield name, content.replace('\\"', '"').replace("\\n", "\n")


work = Path(tempfile.mkdtemp())
files = dict(small_survey())
for name, content in files.items():
    (work / name).write_text(content)


def run(*words, **kw):
    return subprocess.run([vlscan, *words, "-q"], cwd=work, check=True, stdout=subprocess.PIPE, **kw).stdout


for target, name in [("survey", "survey.xml"), ("survey_read", "survey.xml"), ("scanner_xml", "own.xml"), ("platform_xml", "platforms.xml"),
                     ("scene_xml", "scene.xml"), ("obj", "mesh.obj"), ("mtl", "mesh.mtl"), ("instances", "trees.csv")]:
    seed(target, name, files[name])
for name in ["rotating.xml", "moving.xml"]:
    source = root / "fixtures" / {"rotating.xml": "forest/survey.xml", "moving.xml": "moving/survey.xml"}[name]
    seed("survey_read", name, source.read_bytes())
seed("scene_xml", "moving.xml", (root / "fixtures/moving/scene.xml").read_bytes())
seed("scanner_xml", "forest.xml", (root / "fixtures/forest/scanners.xml").read_bytes())
for path in sorted((root / "pipelines").glob("*.toml")):
    seed("pipeline", path.name, path.read_bytes())

# Outputs of the small survey are the seeds of the readers.
outputs = ["p.xyz", "p.csv", "p.las", "p.laz", "p.ply", "p.arrow", "p.parquet", "p.bin"]
run("run", "survey.xml", "--waveforms", *[word for name in outputs for word in ("-o", name)])
for name in outputs[:-1]:
    seed("preview_" + name[2:], name, (work / name).read_bytes())
seed("unzip", "p.bin", (work / "p.bin").read_bytes())
for path in work.glob("*fullwave*"):
    if path.suffix == ".txt":
        seed("preview_waveform", "w.txt", b"".join(path.read_bytes().splitlines(True)[:40]))
run("run", "survey.xml", "-o", "w.las", "--wave-packets", "inside")
seed("preview_packets", "w.las", (work / "w.las").read_bytes())
pulses = run("pulses", "survey.xml")
seed("pulses_text", "pulses.csv", b"".join(pulses.splitlines(True)[:60]))
seed("pulses_arrow", "pulses.arrow", run("pulses", "survey.xml", "--format", "arrow"))

# Clouds as scenes.
cloud = "".join(f"{x * 0.5} {y * 0.5} {x * 0.1} 0 0 1\n" for x in range(6) for y in range(6))
seed("cloud_xyz", "cloud.xyz", cloud)
for name in ["las", "laz", "ply"]:
    seed("cloud_" + name, "cloud." + name, (work / f"p.{name}").read_bytes())

# Trajectories: a short straight flight.
rows = [(t, -3 + t, 1.0, 5.0, 0.0, 0.0, 90.0) for t in (i * 0.25 for i in range(13))]
seed("poses_text", "poses.csv", "time,x,y,z,roll,pitch,yaw\n" + "".join(",".join(map(str, row)) + "\n" for row in rows))
sbet = b"".join(struct.pack("<17d", 500.0 + t, 0.85 + 1e-7 * t, 0.15, z, 3, 0, 0, 0, 0, yaw / 57.3, *[0.0] * 7) for t, x, y, z, _, _, yaw in rows)
seed("poses_sbet", "poses.sbet", sbet)
header = b"TSCANTRJ" + struct.pack("<7i", 20010715, 3000, len(rows), 64, 1, 0, 0)
seed("poses_trj", "poses.trj", header.ljust(3000, b"\0") + b"".join(struct.pack("<7d", t, x, y, z, yaw, 0, 0).ljust(64, b"\0") for t, x, y, z, _, _, yaw in rows))
(work / "poses.csv").write_bytes((seeds / "poses_text/poses.csv").read_bytes())
try:
    seed("poses_arrow", "poses.arrow", run("trajectory", "survey.xml", "--trajectory", "poses.csv", "--format", "arrow"))
except subprocess.CalledProcessError:
    print("no Arrow trajectories", file=sys.stderr)

# A raster of 4 x 4 heights: little-endian TIFF, one strip of float32.
heights = struct.pack("<16f", *[0.1 * i for i in range(16)])
tags = [(256, 3, 1, 4), (257, 3, 1, 4), (258, 3, 1, 32), (259, 3, 1, 1), (262, 3, 1, 1), (273, 4, 1, 0), (277, 3, 1, 1), (278, 3, 1, 4),
        (279, 4, 1, 64), (339, 3, 1, 3), (33550, 12, 3, 0), (33922, 12, 6, 0)]
data_at = 8 + 2 + 12 * len(tags) + 4
extra = struct.pack("<3d", 1, 1, 0) + struct.pack("<6d", 0, 0, 0, -2, 2, 0)
at = {273: data_at, 33550: data_at + 64, 33922: data_at + 64 + 24}
entries = b"".join(struct.pack("<HHII", tag, kind, count, at.get(tag, value)) for tag, kind, count, value in tags)
seed("raster", "ground.tif", b"II*\0" + struct.pack("<IH", 8, len(tags)) + entries + b"\0\0\0\0" + heights + extra)

seed("voxels", "crown.vox", "VOXEL SPACE\n#min_corner: -2 -2 0\n#max_corner: 2 2 4\n#split: 2 1 2\n#res: 2.0 #max_pad: 5.0\n"
     "i j k PadBVTotal a b c d e f g h n transmittance m l\n0 0 0 1.25 54.25 0.5 0.5 0.5 1.25 0.5 12.5 7 60 0.75 0.5 0.25\n"
     "1 0 1 1.25 54.25 0.5 0.5 0.5 1.25 0.5 12.5 7 60 0.75 0.5 0.25\n")
seed("spectrum", "moss.txt", "".join(f"{0.4 + 0.1 * i:.2f} {5 + i}\n" for i in range(12)))
for number, text in enumerate(["0.5*t", "sin(2*pi*t)+1", "t^2-3.5*sqrt(abs(t))", "-(t+1)/(t-1)", "exp(cos(t))"]):
    seed("formula", str(number), text)
for number, text in enumerate(["7", "-1", "2026-11-22 10:00:00", "1e3"]):
    seed("seed", str(number), text)
commands = ["run\0survey.xml\0-o\0x.laz\0--physics\0refined", "scene\0make\0forest\0-n\x0010k", "trace\0-\0--scanner\0vz400", "preview\0p.las\0-o\0p.png"]
for number, text in enumerate(commands):
    seed("command_line", str(number), text)
seed("packed", "empty", b"")
seed("packed", "patches", struct.pack("<8B", 200, 0, 0, 1, 100, 4, 0, 128))
seed("flight", "usual", bytes(range(0, 7)) * 12)
seed("flight", "other", bytes((37 * i) % 251 for i in range(90)))
