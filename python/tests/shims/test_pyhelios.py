"""The ``SimulationBuilder`` of HELIOS++ 2."""

import re
import shutil
import signal
import subprocess
import sys
import time

import pytest

from conftest import FIXTURES
from vlscan import pyhelios


def test_it_needs_no_pint():
    text = "import sys; sys.modules['pint'] = None; from vlscan.pyhelios import SimulationBuilder"
    assert subprocess.run([sys.executable, "-c", text], check=False).returncode == 0


def test_the_simulation_builder_of_version_2(tmp_path):
    builder = pyhelios.SimulationBuilder(str(FIXTURES / "room/survey.xml"), [str(FIXTURES / "room")], str(tmp_path))
    builder.setNumThreads(2)
    builder.setLasOutput(True)
    builder.setZipOutput(True)
    builder.setSeed("7")
    simulation = builder.build()
    assert not simulation.isStarted()
    simulation.start()
    while simulation.isRunning():
        time.sleep(0.05)
    output = simulation.join()
    assert simulation.isFinished() and len(output.measurements) > 10_000
    assert any(path.endswith(".laz") for path in output.outpaths) and output.outpath.startswith(str(tmp_path))
    with pytest.raises(NotImplementedError):
        builder.setCallback(print)


def test_ctrl_c_ends_a_simulation_of_version_2(tmp_path):
    survey = (FIXTURES / "room/survey.xml").read_text()
    stop = re.search(r'headRotatePerSec_deg="[^"]*"', survey)
    (tmp_path / "survey.xml").write_text(survey.replace(stop[0], 'headRotatePerSec_deg="0.001"'))
    for file in (FIXTURES / "room").iterdir():
        if file.name != "survey.xml":
            shutil.copy(file, tmp_path)
    text = (
        "import sys, threading, time\n"
        "from vlscan import pyhelios\n"
        "simulation = pyhelios.SimulationBuilder(sys.argv[1] + '/survey.xml', [sys.argv[1]], sys.argv[1] + '/out').build()\n"
        "simulation.start()\n"
        "print('started', flush=True)\n"
        "try:\n"
        "    simulation.join()\n"
        "except KeyboardInterrupt:\n"
        "    print('interrupted', simulation.isRunning(), simulation.isFinished(), threading.active_count(), flush=True)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", text, tmp_path], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout.readline() == "started\n"
    time.sleep(1)
    process.send_signal(signal.SIGINT)
    rest, _ = process.communicate(timeout=60)
    assert process.returncode == 0 and rest.startswith("interrupted False True")
