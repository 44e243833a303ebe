"""The package: the command, lists, documents."""

import subprocess
import sys
import typing
from pathlib import Path

import pytest

import vlscan
from conftest import FIXTURES, ROOT
from vlscan import Leg, Part, Scanner, Survey, _toml


def test_the_command_is_the_program(command, room, tmp_path):
    assert command("--version").stdout.decode().split() == ["vlscan", vlscan.__version__]
    assert command("run", "nowhere.xml").returncode == 2
    done = command("run", room, "-o", "-", "--format", "xyz", "-q")
    assert done.returncode == 0 and len(done.stdout.splitlines()) > 10_000
    script = subprocess.run([Path(sys.executable).with_name("vlscan"), "--version"], capture_output=True, check=True)
    assert script.stdout == command("--version").stdout


def test_a_closed_pipe_ends_the_command(room):
    line = f'"{sys.executable}" -m vlscan run {room} -o - --format xyz -q | head -3'
    done = subprocess.run(["bash", "-o", "pipefail", "-c", line], capture_output=True, check=False)
    assert (done.returncode, done.stderr, len(done.stdout.splitlines())) == (0, b"", 3)


def test_importing_the_package_imports_no_numpy():
    text = "import sys, vlscan, vlscan.__main__; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", text], check=False).returncode == 0


def test_spectra_are_those_of_materials():
    spectra = vlscan.spectra()
    assert {"broadleaf", "needle", "bark", "soil", "water"} <= set(spectra)
    for name, spectrum in spectra.items():
        assert len(spectrum.wavelengths_nm) == len(spectrum.reflectances) == len(spectrum.transmittances) >= 2, name
        assert spectrum.wavelengths_nm == sorted(spectrum.wavelengths_nm) and all(0 < share < 1 for share in spectrum.reflectances), name
    leaf = spectra["broadleaf"]
    reflectance = leaf.reflectances[leaf.wavelengths_nm.index(1064)]

    scanner = Scanner("riegl_vz400", wavelength_nm=1064)

    def amplitudes(**material):
        wall = Part.mesh([[-9, 3, -9], [9, 3, -9], [9, 3, 9], [-9, 3, 9]], [[0, 1, 2, 3]], vlscan.Material("m", **material))
        return vlscan.trace(wall, (0, 0, 0), (0.1, 1, 0), scanner=scanner, seed=1).points["Amplitude"].tolist()

    assert amplitudes(spectrum="broadleaf") == pytest.approx(amplitudes(reflectance=reflectance)) != []


def test_an_id_of_several_scanners_is_an_error_with_their_references():
    both = ["data/scanners_als.xml#livox_mid-70", "data/scanners_tls.xml#livox_mid-70"]
    for call in (
        Scanner,
        vlscan.scanner_figures,
        lambda name: vlscan.trace(FIXTURES / "room/scene.xml", (0, 0, 2), (0, 0, -1), scanner=name),
    ):
        with pytest.raises(vlscan.InputError, match="2 scanners of the catalogue have the id 'livox_mid-70'") as error:
            call("livox_mid-70")
        assert error.value.problems[0].help == f"write one of them in full: {' or '.join(both)}"
    assert [name for name in vlscan.scanners() if "mid-70" in name] == both
    assert [Scanner(name).keys["catalogue"] for name in both] == both
    with pytest.raises(vlscan.InputError, match="did you mean 'livox_mid-70'"):
        Scanner("livox_mid70")


def test_lists():
    assert vlscan.scanners()["riegl_vz400"] == "RIEGL VZ-400" and "sr22" in vlscan.platforms()
    assert vlscan.columns()["X"].unit == "m" and vlscan.options()["seed"].has_value
    assert set(vlscan.__all__) <= set(dir(vlscan)) and all(hasattr(vlscan, name) for name in vlscan.__all__)
    for listing in (vlscan.options, vlscan.columns, vlscan.scanners):
        listing().clear()
        assert listing()
    with pytest.raises(AttributeError):
        vlscan.nothing


def test_the_types_of_options_are_those_of_the_program():
    assert set(vlscan.RunOptions.__annotations__) == set(vlscan.options())
    assert typing.get_type_hints(vlscan.RunOptions)["misses"] == bool | None


def test_documents_are_toml():
    tomllib = pytest.importorskip("tomllib")
    survey = Survey(None, vlscan.Scanner("riegl_vz400", accuracy_m=0.5), [Leg((1, 2, 3), scan_freq_hz=1e-3)])
    keys = tomllib.loads(survey.document())
    assert keys["scanner"]["accuracy_m"] == 0.5 and keys["leg"][0]["settings"] == {"scan_freq_hz": 0.001}
    odd = {"a": [1, 2.5, True, 'é"\n', "🌲 \x7f \t C:\\a"], "t": {"x y": 1e30, "none": None}, "l": [{"b": float("inf")}]}
    assert tomllib.loads(_toml.document(odd)) == {"a": odd["a"], "t": {"x y": 1e30}, "l": odd["l"]}
    with pytest.raises(TypeError):
        _toml.document({"a": object()})


def test_the_distribution_for_helios_needs_this_version():
    text = (ROOT / "python/vlscan-helios/pyproject.toml").read_text()
    assert f'version = "{vlscan.__version__}"' in text and f'"vlscan=={vlscan.__version__}"' in text
