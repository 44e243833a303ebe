"""A script over `vlscan` that type checkers accept; it is checked, not run."""

import numpy as np
from numpy.typing import NDArray

import vlscan

wall = vlscan.Part.mesh([[-9, 5, 0], [9, 5, 0], [9, 5, 4], [-9, 5, 4]], [[0, 1, 2, 3]], id="wall")
scene = vlscan.Scene([wall])
geometry = scene.geometry("wall")
corners = geometry.vertices[geometry.triangles]
centres: NDArray[np.float64] = corners.mean(axis=1)
hits = scene.cast((0, 0, 1), [[0, 1, 0]])
leg = vlscan.Leg((0, 0, 1.7), scan_freq_hz=20, head_rate_deg_per_s=50, head_start_deg=-2, head_stop_deg=2)
survey = vlscan.Survey(scene, "riegl_vz400", [leg])
with survey.run_batches(1000, batch_columns=["X", "Y"], to="a.laz", seed=1) as batches:
    for batch in batches:
        x = batch["X"].max()
        print(f"{x:.2f}")
print(batches.result.files)
for batch in vlscan.run_batches("survey.xml", batch_columns="X"):
    batch.write("a.laz", force=True)
contents = vlscan.Survey.open("survey.xml").contents()
if contents.references is not None:
    print(contents.references.scanner, contents.references.scene.upper())
template = contents.legs[0].templates.get("scanner")
if template is not None:
    print(template.id, template.leg.settings["pulse_freq_hz"])
device: vlscan.DeviceFigures = vlscan.scanner_figures("riegl_vz400").device
print(device.wavelength_nm, device.range_max_m)
vlscan.Survey.from_document("<document/>", path="a.xml")
points = vlscan.Points.of({"X": [0.0], "Y": [0.0], "Z": [0.0]})
points.write("x.laz")
result = survey.run(to=["a.laz", "b.ply"], seed=1, threads=2)
result.points[result.points["Z"] > 0].write("b.laz")
ground: vlscan.Points = result.points[result.points["Classification"] == 2]
low = result.points[(result.points["Z"] < 1) & (result.points["Intensity"] != 0)]
low.write("low.laz")
heights: NDArray[np.float64] = low["Z"] - low["Z"].min()
result = vlscan.run("survey.xml", columns=vlscan.columns(), seed=1)
opened = vlscan.Survey.open("survey.xml")
if opened.scene is not None:
    print(opened.scene.bounds)
survey.scene, survey.scanner, survey.platform = wall, {"catalogue": "vlp16"}, "linear_path"
leg.position = np.array([1, 2, 3])
leg.position[2] += 1
survey.legs = (leg,)
survey.legs.append(leg)
survey.settings = None
survey.settings["pulse_freq_hz"] = 100_000
vlscan.Survey.from_document("<document/>", trajectories={"flight": np.zeros((3, 7))}).run(seed=1)
try:
    survey.run()
except vlscan.InputError as error:
    print([problem.kind == "not_found" for problem in error.problems])
view = vlscan.preview("survey.xml")
print(view is None, heights.max())
