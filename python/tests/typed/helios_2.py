"""A script for HELIOS++ 2 that type checkers accept; it is checked, not run."""

from vlscan_helios import v2 as pyhelios

pyhelios.loggingQuiet()
pyhelios.setDefaultRandomnessGeneratorSeed("43")
builder = pyhelios.SimulationBuilder("survey.xml", ["assets/"], "output/")
builder.setNumThreads(0).setLasOutput(True).setZipOutput(True).setCallbackFrequency(10)


def callback(output: pyhelios.Output) -> None:
    print(len(output.measurements))


builder.setCallback(callback)
simulation = builder.build()
survey = simulation.sim.getSurvey()
leg = survey.getLeg(0)
leg.getScannerSettings().setPulseFreq(100_000)
leg.scannerSettings.scanAngle = 0.2
print(simulation.sim.getScene().getPrimitive(0).getVertex(0).getPosition().x)
print(survey.getScanner().averagePower, survey.getScanner().getDetector().accuracy)
simulation.start()
output = simulation.join()
measurements, trajectory = pyhelios.outputToNumpy(output)
print(measurements[:, :3].mean(), output.filepath)
