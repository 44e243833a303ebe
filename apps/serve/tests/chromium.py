"""Chromium, driven by its DevTools protocol: pages are loaded, read and used as people use them."""

import base64
import json
import os
import pathlib
import subprocess
import time
import urllib.request

from websockets.sync.client import connect

# Windows key codes of the keys that tests press.
KEYS = {
    "Tab": 9, "Enter": 13, " ": 32, "PageUp": 33, "Home": 36, "ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40,
    "Backspace": 8,
}


class Browser:
    """A browser with an empty profile and one page. With VLSCAN_SCREENSHOTS every picture is kept in that folder."""

    def __init__(self, folder, width=1200, height=900):
        profile = pathlib.Path(folder) / "profile"
        options = [
            "--headless=new", "--remote-debugging-port=0", f"--user-data-dir={profile}", "--no-sandbox", "--no-first-run",
            "--disable-background-networking", "--disable-dev-shm-usage", "--use-gl=angle", "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader", f"--window-size={width},{height}", "about:blank",
        ]
        self.process = subprocess.Popen(["chromium", *options], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        port = self._port(profile / "DevToolsActivePort")
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json") as answer:
            pages = json.load(answer)
        address = next(page["webSocketDebuggerUrl"] for page in pages if page["type"] == "page")
        self.socket = connect(address, max_size=None)
        self.number = 0
        self.problems = []
        for domain in ("Page", "Runtime", "Log", "DOM"):
            self.call(f"{domain}.enable")
        self.resize(width, height)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.socket.send(json.dumps({"id": 0, "method": "Browser.close"}))
        self.process.wait(timeout=30)

    @staticmethod
    def _port(path):
        for _ in range(600):
            if path.exists() and path.read_text().strip():
                return path.read_text().split()[0]
            time.sleep(0.05)
        raise AssertionError("chromium does not start")

    def call(self, method, **parameters):
        """Calls a method of the protocol; collects errors of scripts and violations of policies."""
        self.number += 1
        number = self.number
        self.socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            message = json.loads(self.socket.recv(timeout=120))
            if message.get("id") == number:
                assert "error" not in message, (method, message["error"])
                return message["result"]
            if message.get("method") == "Runtime.exceptionThrown":
                self.problems.append(json.dumps(message["params"]["exceptionDetails"])[:500])
            if message.get("method") == "Log.entryAdded" and message["params"]["entry"]["level"] == "error":
                self.problems.append(json.dumps(message["params"]["entry"])[:500])

    def resize(self, width, height, phone=False):
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=phone)

    def run(self, script):
        """The value of an expression of the page."""
        answer = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, (script, answer["exceptionDetails"])
        return answer["result"].get("value")

    def wait(self, script, seconds=60):
        """Waits until an expression is true; a page that is being loaded has none."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            try:
                value = self.run(f"!!({script})")
                if value:
                    return value
            except AssertionError:
                pass
            time.sleep(0.05)
        raise AssertionError(f"{script} is not true after {seconds} s at {self.run('location.href')}: {self.run('document.body.innerText')[:2000]}")

    def go(self, address):
        self.call("Page.navigate", url=address)
        self.wait(f"location.href.startsWith({json.dumps(address)}) && document.readyState === 'complete'")

    def leads(self, act, to):
        """Does something that leads to a page whose path begins like this."""
        self.run("document.body.dataset.old = 'yes'")
        act()
        self.wait(f"!document.body.dataset.old && document.readyState === 'complete' && location.pathname.startsWith({json.dumps(to)})")

    def place(self, selector, share=(0.5, 0.5)):
        """A place of an element in the window, pixels; the element is scrolled to if need be."""
        return self.run(
            f"(() => {{ const one = document.querySelector({json.dumps(selector)}); one.scrollIntoView({{ block: 'center' }});"
            f" const box = one.getBoundingClientRect();"
            f" return [box.left + box.width * {share[0]}, box.top + box.height * {share[1]}]; }})()"
        )

    def click(self, selector, share=(0.5, 0.5)):
        x, y = self.place(selector, share)
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)

    def drag(self, selector, right, down):
        x, y = self.place(selector)
        self.call("Input.dispatchMouseEvent", type="mousePressed", x=x, y=y, button="left", buttons=1, clickCount=1)
        for step in (0.5, 1):
            self.call("Input.dispatchMouseEvent", type="mouseMoved", x=x + step * right, y=y + step * down, button="left", buttons=1)
        self.call("Input.dispatchMouseEvent", type="mouseReleased", x=x + right, y=y + down, button="left", clickCount=1)

    def press(self, key, times=1, shift=False):
        text = {"text": "\r"} if key == "Enter" else {"text": key} if len(key) == 1 else {}
        code = KEYS.get(key) or ord(key.upper())
        for _ in range(times):
            held = {"key": key, "windowsVirtualKeyCode": code, "modifiers": 8 if shift else 0}
            self.call("Input.dispatchKeyEvent", type="keyDown", **held, **text)
            self.call("Input.dispatchKeyEvent", type="keyUp", **held)

    def type(self, text):
        self.call("Input.insertText", text=text)

    def choose(self, name, value):
        """Chooses a value of a list, as somebody does."""
        self.run(
            f"(() => {{ const list = document.querySelector('select[name={name}]'); list.value = {json.dumps(value)};"
            f" list.dispatchEvent(new Event('input', {{ bubbles: true }})); list.dispatchEvent(new Event('change', {{ bubbles: true }})); }})()"
        )
        assert self.run(f"document.querySelector('select[name={name}]').value") == value, (name, value)

    def attach(self, selector, paths):
        root = self.call("DOM.getDocument")["root"]["nodeId"]
        node = self.call("DOM.querySelector", nodeId=root, selector=selector)["nodeId"]
        self.call("DOM.setFileInputFiles", nodeId=node, files=[str(path) for path in paths])

    def violations(self, axe):
        """Violations of the rules of accessibility on the page, found by a script of axe-core: a line for each element."""
        if not self.run("typeof axe === 'object'"):
            self.run(f"{axe};0")
        # Reports are pages of their own, which do not run its script.
        found = self.run("axe.run(document, { iframes: false }).then((found) => found.violations.map((one) => [one.id, one.help, one.nodes.map((node) => node.html)]))")
        return [f"{rule}: {text}: {element[:300]}" for rule, text, elements in found for element in elements]

    def picture(self, name, selector=None):
        """The window as PNG, or the part of it that an element takes."""
        clip = {}
        if selector:
            x, y = self.place(selector, (0, 0))
            width, height = self.run(
                f"(() => {{ const box = document.querySelector({json.dumps(selector)}).getBoundingClientRect(); return [box.width, box.height]; }})()"
            )
            x, y = x + self.run("scrollX"), y + self.run("scrollY")
            clip = {"clip": {"x": x, "y": y, "width": width, "height": height, "scale": 1}}
        return self.keep(name, self.call("Page.captureScreenshot", format="png", **clip))

    def whole_picture(self, name):
        """The whole page as PNG, also what is below the window."""
        size = self.call("Page.getLayoutMetrics")["cssContentSize"]
        clip = {"x": 0, "y": 0, "width": size["width"], "height": size["height"], "scale": 1}
        return self.keep(name, self.call("Page.captureScreenshot", format="png", captureBeyondViewport=True, clip=clip))

    @staticmethod
    def keep(name, answer):
        """A picture that was taken; with VLSCAN_SCREENSHOTS it is kept in that folder."""
        taken = base64.b64decode(answer["data"])
        folder = os.environ.get("VLSCAN_SCREENSHOTS")
        if folder:
            pathlib.Path(folder).mkdir(parents=True, exist_ok=True)
            (pathlib.Path(folder) / f"{name}.png").write_bytes(taken)
        return taken
