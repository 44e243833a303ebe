"""Pages on a wide and a narrow screen: the rules of accessibility hold (axe-core), and nothing is wider than the screen."""

import os
import pathlib

from chromium import Browser

# Width and height of the screens, pixels, and whether the browser is that of a phone.
SCREENS = [(1200, 900, False), (390, 844, True)]


class Inspection:
    """Inspects pages; the violations are collected. VLSCAN_AXE is the file axe.min.js of the package axe-core."""

    def __init__(self, browser: Browser):
        self.browser = browser
        self.axe = pathlib.Path(os.environ["VLSCAN_AXE"]).read_text()
        self.pages = []
        self.found = []

    def page(self, name: str) -> None:
        """Inspects the page that is shown."""
        self.pages.append(name)
        for width, height, is_phone in SCREENS:
            self.browser.resize(width, height, phone=is_phone)
            self.browser.run("new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(resolve)))")
            self.browser.whole_picture(f"{name}-{width}")
            self.found += [f"{name} ({width} px): {violation}" for violation in self.browser.violations(self.axe)]
            self.found += [f"{name} ({width} px): {element} is wider than the screen" for element in self.too_wide(width)]
        self.browser.resize(*SCREENS[0][:2])

    def too_wide(self, width: int) -> list[str]:
        """Elements that make the page wider than the screen, and are not scrolled by themselves."""
        return self.browser.run(
            f"""(() => {{
                const isScrolled = (one) => {{
                    for (let up = one.parentElement; up && up !== document.body; up = up.parentElement)
                        if (['auto', 'scroll', 'hidden'].includes(getComputedStyle(up).overflowX)) return true;
                    return false;
                }};
                if (document.documentElement.scrollWidth <= {width}) return [];
                const all = [...document.querySelectorAll('body *')];
                const wide = all.filter((one) => one.getBoundingClientRect().right > {width} + 1 && !isScrolled(one));
                return ['the page: ' + document.documentElement.scrollWidth + ' px', ...wide.slice(0, 5).map((one) => one.outerHTML.slice(0, 200))];
            }})()"""
        )

    def end(self) -> None:
        """Fails if there is a violation, or if hardly a page was inspected."""
        assert len(self.pages) >= 12, self.pages
        assert not self.found, "\n".join(self.found)
