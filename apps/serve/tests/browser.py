"""The pages as people use them in Chromium: from an upload to the points, turned around, downloaded, compared, and computed again in a
shell by the command that the page shows. Once with a mouse, once with keys alone on a phone's screen. Each page on the way is inspected
(`inspection`), by the script VLSCAN_AXE.

    VLSCAN_AXE=axe.min.js python browser.py target/debug/vlscan-serve target/debug/vlscan
"""

import json
import pathlib
import random
import re
import shutil
import struct
import subprocess
import sys
import tempfile
import urllib.request

import imagecodecs
import numpy
import requests
from chromium import Browser
from inspection import Inspection

FIXTURES = pathlib.Path(__file__).resolve().parents[3] / "fixtures"
INSTRUMENT = "data/scanners_als.xml#riegl_vux-1uav"
CLOUD = "document.querySelector('#cloud')?.dataset"


def main() -> None:
    program, vlscan = sys.argv[1:]
    vlscan = pathlib.Path(vlscan).resolve()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        folder = pathlib.Path(folder)
        command = [program, "--listen", "127.0.0.1:0", "--program", vlscan, "--data", folder / "data"]
        service = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        try:
            url = next(word for line in service.stderr for word in line.split() if word.startswith("http://")).rstrip("/")
            with Browser(folder) as browser:
                inspection = Inspection(browser)
                with_a_mouse(browser, url, folder, vlscan, inspection)
                other_pages(browser, url, inspection)
                inspection.end()
                with_keys(browser, url)
                assert not browser.problems, browser.problems
                damaged(browser, url)
        finally:
            service.terminate()
        assert service.wait(timeout=30) == 0


def with_a_mouse(browser: Browser, url: str, folder: pathlib.Path, vlscan: pathlib.Path, inspection: Inspection) -> None:
    an_example(browser, url, inspection)
    browser.go(f"{url}/")
    inspection.page("home")
    browser.attach("input[name=file]", sorted((FIXTURES / "terrain").iterdir()))
    browser.run("document.querySelector('input[name=name]').value = 'terrain'")
    browser.leads(lambda: browser.click("form[action='/uploads'] button"), "/uploads/terrain")
    inspection.page("upload")
    browser.leads(lambda: browser.click("a[href*='kind=airborne'][href*='scene.xml']"), "/new")
    browser.choose("scanner", INSTRUMENT)

    # An area of four corners, of which the last one is taken back and set elsewhere.
    browser.wait("document.querySelector('.sheet img')?.naturalWidth > 0 && !document.querySelector('.sheet').hidden")
    for corner in [(0.4, 0.4), (0.6, 0.4), (0.6, 0.6), (0.9, 0.9)]:
        browser.click(".sheet", corner)
    browser.run("[...document.querySelectorAll('.map button')].find((one) => one.textContent.includes('last')).click()")
    browser.click(".sheet", (0.4, 0.6))
    area = browser.run("document.querySelector('textarea[name=area]').value")
    corners = [[float(number) for number in pair.split()] for pair in re.fullmatch(r"POLYGON \(\((.*)\)\)", area)[1].split(", ")]
    assert len(corners) == 5 and corners[0] == corners[-1], area
    (left, top), _, (right, bottom) = corners[:3]
    assert right > left and top > bottom, area
    # The same as text, whose last corner is not repeated.
    typed = f"POLYGON (({area[10:area.rindex(',')]}))"
    show = "(() => {{ const field = document.querySelector('textarea[name=area]'); field.value = {!r};" \
        " field.dispatchEvent(new Event('input')); return document.querySelector('.sheet polygon').points.length; }})()"
    assert browser.run(show.format(typed)) == 4 and browser.run(show.format(area)) == 4, typed
    inspection.page("area")
    failed_plan(browser, inspection)
    browser.leads(lambda: browser.click("section.card button[type=submit]"), "/jobs/")
    browser.wait("document.querySelector('.picture')?.complete && document.querySelector('.picture').naturalWidth > 0")
    inspection.page("plan")
    browser.leads(lambda: browser.click("button[value='dry-run']"), "/jobs/")
    browser.wait("document.querySelector('.figures')?.innerText.includes('Points per m²')")
    inspection.page("forecast")
    browser.leads(lambda: browser.click("button[value=run]"), "/jobs/")

    points = drawn(browser)
    assert points > 1000, points
    inspection.page("points")
    drawn(browser)
    first = shown(browser)
    browser.choose("colouring", "class")
    browser.wait("document.querySelector('.legend').innerText.includes('Ground')")
    by_class = shown(browser)
    assert (by_class != first).any(axis=2).mean() > 0.02, "the colours have not changed"
    browser.drag("#cloud canvas", 150, 60)
    turned = shown(browser)
    assert (turned != by_class).any(axis=2).mean() > 0.02, "the cloud has not turned"
    browser.choose("section", "x")
    cut = shown(browser)
    assert 0 < coverage(cut) < 0.7 * coverage(turned), (coverage(cut), coverage(turned))
    browser.picture("section")

    job = browser.run("location.pathname")
    computed_again(browser, url, folder, vlscan)
    cloud = f"{job.removeprefix('/')}/points.copc.laz"
    browser.go(f"{url}/compare?first={cloud}")
    assert browser.run("document.querySelector('select[name=first]').value") == cloud
    inspection.page("compare")
    browser.run(
        "(() => { const list = document.querySelector('select[name=second]'); list.append(new Option('same', document.querySelector("
        "'select[name=first]').value)); list.selectedIndex = list.options.length - 1; })()"
    )
    browser.leads(lambda: browser.click("main button[type=submit]"), "/jobs/")
    browser.wait("document.querySelector('iframe')?.src.endsWith('report.html')")
    inspection.page("compared")
    tripods(browser, url, inspection)


def failed_plan(browser: Browser, inspection: Inspection) -> None:
    """A flight that is too high fails; its button flies at a height from which the instrument detects the ground."""
    form = browser.run("location.href")
    area = browser.run("document.querySelector('textarea[name=area]').value")
    browser.run("document.querySelector('section.card [name=height]').value = '5000'")
    browser.leads(lambda: browser.click("section.card button[type=submit]"), "/jobs/")
    browser.wait("document.querySelector('section.card .problem')?.textContent.includes('5000 m away')")
    inspection.page("failed plan")
    browser.leads(lambda: browser.click("main .views button[type=submit]"), "/jobs/")
    browser.wait("document.querySelector('button[value=run]')")
    # Back to the form, as it was filled in.
    browser.go(form)
    browser.choose("scanner", INSTRUMENT)
    browser.run(
        f"(() => {{ const field = document.querySelector('textarea[name=area]'); field.value = {json.dumps(area)};"
        " field.dispatchEvent(new Event('input')); })()"
    )


def other_pages(browser: Browser, url: str, inspection: Inspection) -> None:
    """Pages beside the way."""
    for kind in ("mobile", "trajectory", "survey", "stand"):
        browser.go(f"{url}/new?kind={kind}&scene=terrain/scene.xml")
        inspection.page(f"new {kind}")
    for path in ("instruments", "jobs?f=html", "api?f=html"):
        browser.go(f"{url}/{path}")
        inspection.page(path.partition("?")[0])


def an_example(browser: Browser, url: str, inspection: Inspection) -> None:
    """From the empty page to the points by one click."""
    browser.go(f"{url}/")
    inspection.page("empty")
    browser.leads(lambda: browser.click("button[value=terrain]"), "/jobs/")
    browser.wait("document.querySelector('#cloud')")
    assert drawn(browser) > 1000
    ticks = browser.run("[...document.querySelectorAll('.ticks span')].map((one) => parseFloat(one.textContent))")
    assert len(ticks) == 5 and ticks == sorted(ticks), ticks
    assert browser.run("/^[125]0* (m|cm)$/.test(document.querySelector('.ruler').textContent.trim())"), "the scale bar has a round length"
    # The page scrolls past points that nobody has clicked.
    x, y = browser.place("#cloud canvas")
    before = browser.run("[scrollY, document.documentElement.scrollHeight - innerHeight]")
    browser.call("Input.dispatchMouseEvent", type="mouseWheel", x=x, y=y, deltaX=0, deltaY=200)
    if before[0] < before[1]:
        browser.wait(f"scrollY > {before[0]}")
    browser.picture("example")


def tripods(browser: Browser, url: str, inspection: Inspection) -> None:
    """Places of a tripod, clicked on a map that is enlarged."""
    browser.go(f"{url}/new?kind=terrestrial&scene=terrain/scene.xml")
    browser.wait("document.querySelector('.sheet img')?.naturalWidth > 0 && !document.querySelector('.sheet').hidden")
    browser.click(".sheet", (0.4, 0.4))
    width = browser.run("document.querySelector('.sheet img').clientWidth")
    browser.run("[...document.querySelectorAll('.map button')].find((one) => one.textContent.includes('Enlarge')).click()")
    assert browser.run("document.querySelector('.sheet img').clientWidth") > 1.5 * width, "the map is not enlarged"
    browser.click(".sheet", (0.6, 0.6))
    places = browser.run("document.querySelector('textarea[name=at]').value")
    (left, top), (right, bottom) = ([float(number) for number in line.split(",")] for line in places.splitlines())
    assert right > left and top > bottom, places
    assert browser.run("[...document.querySelectorAll('.sheet .number')].map((one) => one.textContent).join()") == "1,2"
    inspection.page("tripods")


def computed_again(browser: Browser, url: str, folder: pathlib.Path, vlscan: pathlib.Path) -> None:
    """The download, and the command of the page in a folder that has the upload as a folder: both have the same bytes."""
    with urllib.request.urlopen(url + browser.run("document.querySelector('a[download]').pathname")) as answer:
        download = answer.read()
    command, document = browser.run("[...document.querySelectorAll('details pre code')].slice(0, 2).map((one) => one.textContent)")
    shell = folder / "shell"
    shell.mkdir()
    shutil.copytree(FIXTURES / "terrain", shell / "terrain")
    (shell / "job.toml").write_text(document)
    words = command.split()
    assert words[0] == "vlscan", command
    subprocess.run(" ".join([str(vlscan), *words[1:], "-q"]), shell=True, check=True, cwd=shell)
    assert (shell / "points.copc.laz").read_bytes() == download, "the command of the page makes other points"


def with_keys(browser: Browser, url: str) -> None:
    """From the first page to the points by Tab, Enter, arrows and letters, on a narrow screen."""
    browser.resize(360, 740, phone=True)
    browser.go(f"{url}/")
    browser.press("Tab")
    assert browser.run("document.activeElement.className") == "skip", "the first key leads to the content"
    wide = {}

    def reach(selector: str) -> None:
        for _ in range(60):
            if browser.run(f"document.activeElement.matches({selector!r})"):
                assert browser.run("getComputedStyle(document.activeElement).outlineStyle") != "none", f"{selector}: the focus is not seen"
                return
            browser.press("Tab")
        raise AssertionError(f"{selector} is not reached by Tab at {browser.run('location.href')}")

    def measure(name: str) -> None:
        browser.picture(f"phone-{name}")
        wide[name] = browser.run("document.documentElement.scrollWidth")

    def enter(to: str) -> None:
        browser.leads(lambda: browser.press("Enter"), to)

    measure("home")
    reach("a[href='/uploads/terrain']")
    enter("/uploads/terrain")
    measure("upload")
    reach("a[href*='kind=airborne'][href*='scene.xml']")
    enter("/new")
    reach("select[name=scanner]")
    for letter in "RIEGL VUX-1UAV":
        browser.press(letter)
    assert browser.run("document.activeElement.value") == INSTRUMENT, browser.run("document.activeElement.value")
    browser.wait("document.querySelector('.sheet img')?.naturalWidth > 0")
    reach(".sheet")
    for key in ["ArrowLeft", "ArrowUp", "ArrowRight", "ArrowDown"]:
        browser.press(key, times=2, shift=True)
        browser.press("Enter")
    assert browser.run("document.querySelector('textarea[name=area]').value").startswith("POLYGON (("), "the keys draw no area"
    assert "area is set" in browser.run("document.querySelector('.map [role=status]').textContent")
    measure("area")
    reach("section.card button[type=submit]")
    enter("/jobs/")
    browser.wait("document.querySelector('button[value=run]')")
    measure("plan")
    reach("button[value=run]")
    enter("/jobs/")
    drawn(browser)
    measure("points")
    reach("#cloud canvas")
    before = shown(browser)
    browser.press("ArrowLeft", times=3)
    browser.press("+", times=2)
    assert (shown(browser) != before).any(axis=2).mean() > 0.02, "the keys do not turn the cloud"
    assert all(width <= 360 for width in wide.values()), f"pages are wider than the screen: {wide}"


def damaged(browser: Browser, url: str) -> None:
    """COPCs that were uploaded: as it is one is shown at once; of a damaged one there is a message, and points only where those are damaged."""
    jobs = json.load(urllib.request.urlopen(f"{url}/jobs?processID=run"))["jobs"]
    with urllib.request.urlopen(f"{url}/jobs/{jobs[0]['jobID']}/results/points.copc.laz") as answer:
        whole = answer.read()
    (page,) = struct.unpack_from("<Q", whole, 375 + 54 + 40)

    def changed(at: int, kind: str, *values: float) -> bytes:
        copy = bytearray(whole)
        struct.pack_into(kind, copy, at, *values)
        return bytes(copy)

    flips = random.Random(3)
    noise = bytearray(whole)
    for _ in range(200):
        noise[flips.randrange(len(noise))] ^= 1 << flips.randrange(8)
    variants = {
        "whole": whole,
        "half": whole[: len(whole) // 2],
        "empty": b"",
        "text": b"no points\n" * 1000,
        "many": changed(page + 28, "<i", 2**31 - 1),
        "less": changed(page + 28, "<i", -5),
        "loop": changed(page + 16, "<Qii", page, 32, -1),
        "long": changed(page + 24, "<i", 2**31 - 1),
        "far": changed(page + 16, "<Q", 2**63),
        "pages": changed(375 + 54 + 48, "<Q", 2**40),
        "nowhere": changed(375 + 54 + 40, "<Q", 2**50),
        "sizes": changed(131, "<3d", float("nan"), float("inf"), 0.0),
        "noise": bytes(noise),
    }
    for name, content in variants.items():
        form = {"name": (None, name), "file": (f"{name}.copc.laz", content)}
        requests.post(f"{url}/uploads", files=form).raise_for_status()
        browser.go(f"{url}/uploads/{name}?points={name}.copc.laz")
        browser.wait(f"['complete', 'failed'].includes({CLOUD}.state)")
        said = browser.run("document.querySelector('.said').textContent")
        points = int(browser.run(f"{CLOUD}.points || 0"))
        failed = browser.run(f"{CLOUD}.state") == "failed"
        assert bool(said) == failed, (name, said)
        if name == "whole":
            assert points > 0 and not failed, (points, said)
        elif name != "noise":
            assert points == 0 and failed, (name, points, said)


def drawn(browser: Browser) -> int:
    """Waits until all points that the picture needs are drawn; their number."""
    browser.wait(f"{CLOUD} && {CLOUD}.state !== 'loading' && {CLOUD}.points !== undefined || {CLOUD}?.state === 'failed'")
    assert browser.run(f"{CLOUD}.state") == "complete", browser.run("document.querySelector('.said').textContent")
    assert coverage(shown(browser)) > 0.02, "no points are seen"
    return int(browser.run(f"{CLOUD}.points"))


def shown(browser: Browser) -> numpy.ndarray:
    """The pixels of the cloud once they are drawn."""
    browser.run("new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(() => resolve(1))))")
    browser.wait(f"{CLOUD}.state === 'complete'")
    return imagecodecs.png_decode(browser.picture("canvas", "#cloud canvas"))[..., :3]


def coverage(pixels: numpy.ndarray) -> float:
    """Share of the pixels that are not background."""
    background = pixels[5, 5].astype(int)
    return float((numpy.abs(pixels.astype(int) - background).max(axis=2) > 12).mean())


if __name__ == "__main__":
    main()
