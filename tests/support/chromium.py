"""Chromium for tests and benchmarks, started in one way, and measurements of its pages."""

import os
import shutil
from pathlib import Path

from playwright.sync_api import Browser, CDPSession, Page, Playwright, ViewportSize

EXECUTABLE = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
MISSING = "Chromium is not there: apt install chromium, or name one by CHROMIUM=/usr/bin/…"
DESK: ViewportSize = {"width": 1280, "height": 900}
PHONE: ViewportSize = {"width": 390, "height": 844}
# Containers have no sandbox for root and no graphics card; WebGL is rendered in software.
_ARGUMENTS = [
    "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--no-first-run",
]  # fmt: skip
_LOW_PRIORITY = Path(__file__).with_name("chromium_low_priority")


def launch(playwright: Playwright) -> Browser:
    """Start Chromium. Raises FileNotFoundError if it is not installed."""
    if EXECUTABLE is None:
        raise FileNotFoundError(MISSING)
    low_priority = os.geteuid() == 0 and shutil.which("setpriv") is not None
    return playwright.chromium.launch(
        executable_path=_LOW_PRIORITY if low_priority else EXECUTABLE,
        args=_ARGUMENTS,
        env={**os.environ, "CHROMIUM": EXECUTABLE},
    )


class MainThread:
    """The main thread of a page, by the DevTools protocol."""

    def __init__(self, page: Page) -> None:
        self._session: CDPSession = page.context.new_cdp_session(page)
        self._session.send("Performance.enable", {"timeDomain": "threadTicks"})

    def busy_s(self) -> float:
        """Return the processor time of tasks so far, without other programs on the machine."""
        metrics = self._session.send("Performance.getMetrics")["metrics"]
        return float(next(each["value"] for each in metrics if each["name"] == "TaskDuration"))
