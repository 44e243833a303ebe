"""A script for HELIOS++ 3 that type checkers accept; it is checked, not run."""

import numpy as np

import vlscan_helios.v3 as helios
from vlscan_helios.v3 import units

helios.add_asset_directory("assets")
part = helios.ScenePart.from_obj("a.obj", up_axis="y")
part.translate([0, 0, 1]).rotate(axis=[0, 0, 1], angle="45 deg").scale(2)
part.translate(np.array([0, 0, 1]))
print(part.geometry().vertices.shape, part.bbox.bounds[0])
scene = helios.StaticScene(scene_parts=[part])
scene2 = helios.StaticScene([part])
survey = helios.Survey(scanner=helios.scanner_from_name("riegl_vz_400"), platform=helios.platform_from_name("tripod"), scene=scene)
survey.add_leg(
    scanner_settings=helios.ScannerSettings(pulse_frequency="100 kHz", scan_frequency=120 * units.Hz, head_rotation="10 deg/s"),
    platform_settings=helios.StaticPlatformSettings(x=1, y=2.5, force_on_ground=True),
    rotation_stop_angle="360 deg",
)
points, trajectory = survey.run(format=helios.OutputFormat.NPY, num_threads=2)
print(points["position"].mean())


def callback(context: helios.HookContext) -> None:
    print(context.total_points)


survey.run(callbacks=[helios.SurveyHook(point=helios.HookPoint.LEG_END, callback=callback)])
other = helios.Survey.from_xml("survey.xml")
for leg in other.legs:
    leg.scanner_settings.pulse_frequency = 1000
other.name = "x"
helios.set_rng_seed(1)
for values in helios.combine_parameters(x=[1, 2], y="{x}"):
    print(values)
