"""A page opened in headless Chromium, spoken to over its debugging pipe: what it drew, fetched and complained of."""

from __future__ import annotations

import base64
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from select import select
from typing import Any

import pytest

__all__ = ["LAPTOP", "PHONE", "Browser", "Tab", "browser", "needs_chromium"]

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)

needs_chromium = pytest.mark.skipif(
    CHROMIUM is None, reason="there is no Chromium to look with; on Debian or Ubuntu: apt-get install chromium"
)

LAPTOP, PHONE = (1366, 768), (390, 844)
"""Width and height [px] at which pages are looked at."""

FLAGS = (
    "--headless=new --no-sandbox --disable-gpu --use-angle=swiftshader --enable-unsafe-swiftshader --disable-quic "
    "--no-first-run --disable-background-networking --disable-component-update --disable-sync --hide-scrollbars "
    "--remote-debugging-pipe"
)

TURN_INTO = """
import fcntl, os, sys
pipes = [fcntl.fcntl(int(each), fcntl.F_DUPFD, 10) for each in sys.argv[1:3]]
for number, pipe in zip((3, 4), pipes):
    os.dup2(pipe, number)
os.execv(sys.argv[3], sys.argv[3:])
"""
"""A program that becomes Chromium with its protocol on file 3 to read from and file 4 to write to."""

PATIENCE = 120.0
"""Longest wait for an answer [s]: three-dimensional pictures are drawn without a graphics card, on a machine that may
be doing other things."""


@dataclass
class Tab:
    """An open page.

    Attributes:
        owner: The browser.
        session: Name of the connection.
        said: What it wrote on its console and the errors that nothing caught.
        asked: Addresses that it fetched from.
    """

    owner: Browser
    session: str
    said: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)

    def run(self, script: str) -> Any:
        """The value of a script, a promise's when it is there."""
        found = self.send("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def wait(self, script: str) -> None:
        """Until a script is true."""
        end = time.monotonic() + PATIENCE
        while not self.run(f"Boolean({script})"):
            assert time.monotonic() < end, f"{script} never became true; the page said {self.said}"
            time.sleep(0.1)

    def click(self, x: float, y: float, to: tuple[float, float] | None = None) -> None:
        """Press the mouse at a place and let it go there or, dragged, at another."""
        where = {"button": "left", "clickCount": 1}
        self.send("Input.dispatchMouseEvent", type="mousePressed", x=x, y=y, **where)
        if to is not None:
            for part in (0.5, 1.0):
                place = {"x": x + part * (to[0] - x), "y": y + part * (to[1] - y)}
                self.send("Input.dispatchMouseEvent", type="mouseMoved", buttons=1, **place, **where)
        x, y = to or (x, y)
        self.send("Input.dispatchMouseEvent", type="mouseReleased", x=x, y=y, **where)

    def picture(self, path: Path | str, *, top: float = 0.0, height: float | None = None) -> Path:
        """A PNG of what is seen, or of so much of the page [px] from a place on."""
        part: dict[str, Any] = {}
        if height is not None:
            clip = {"x": 0, "y": top, "width": self.run("innerWidth"), "height": height, "scale": 1}
            part = {"captureBeyondViewport": True, "clip": clip}
        found = self.send("Page.captureScreenshot", format="png", **part)
        Path(path).write_bytes(base64.b64decode(found["data"]))
        return Path(path)

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """One command of the protocol."""
        return self.owner.send(method, session=self.session, **parameters)

    def hear(self, method: str, parameters: dict[str, Any]) -> None:
        """Keep what the page says and asks for."""
        if method == "Runtime.consoleAPICalled":
            words = (str(each.get("value", each.get("description", ""))) for each in parameters["args"])
            self.said.append(" ".join(words))
        elif method == "Runtime.exceptionThrown":
            details = parameters["exceptionDetails"]
            self.said.append(details.get("exception", {}).get("description", details["text"]))
        elif method == "Log.entryAdded":
            self.said.append(parameters["entry"]["text"])
        elif method == "Network.requestWillBeSent":
            self.asked.append(parameters["request"]["url"])


class Browser:
    """A running Chromium.

    Args:
        folder: For its profile.
    """

    def __init__(self, folder: str) -> None:
        to_read, self._to = os.pipe()
        self._from, to_write = os.pipe()
        command = [sys.executable, "-c", TURN_INTO, str(to_read), str(to_write), str(CHROMIUM), *FLAGS.split()]
        silent = subprocess.DEVNULL
        self._process = subprocess.Popen(
            [*command, f"--user-data-dir={folder}"], pass_fds=(to_read, to_write), stdout=silent, stderr=silent
        )
        os.close(to_read)
        os.close(to_write)
        self._buffer = b""
        self._number = 0
        self._tabs: dict[str, Tab] = {}

    def open(self, path: Path | str, *, size: tuple[int, int] = LAPTOP, dark: bool = False, mark: str = "") -> Tab:
        """A file as a page, loaded.

        Args:
            path: The file.
            size: Width and height [px]; below 600 px of width it is a phone with a touch screen.
            dark: Whether dark colours are preferred.
            mark: What follows # in its address.
        """
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        session = self.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        tab = self._tabs[session] = Tab(self, session)
        for domain in ("Page", "Runtime", "Log", "Network"):
            tab.send(f"{domain}.enable")
        width, height = size
        phone = width < 600
        tab.send("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=phone)
        tab.send("Emulation.setTouchEmulationEnabled", enabled=phone)
        tab.send(
            "Emulation.setEmulatedMedia",
            features=[{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}],
        )
        tab.send("Page.navigate", url=Path(path).resolve().as_uri() + (f"#{mark}" if mark else ""))
        tab.wait('document.readyState === "complete" && location.href !== "about:blank"')
        return tab

    def send(self, method: str, session: str = "", **parameters: Any) -> dict[str, Any]:
        """One command of the protocol; what is heard before its answer goes to the tabs."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        os.write(self._to, json.dumps(message | ({"sessionId": session} if session else {})).encode() + b"\0")
        end = time.monotonic() + PATIENCE
        while True:
            answer = self._next(end - time.monotonic())
            if answer.get("id") == self._number:
                assert "error" not in answer, f"{method}: {answer['error']}"
                return answer["result"]
            tab = self._tabs.get(answer.get("sessionId", ""))
            if tab is not None and "method" in answer:
                tab.hear(answer["method"], answer["params"])

    def _next(self, patience: float) -> dict[str, Any]:
        while b"\0" not in self._buffer:
            ready, _, _ = select([self._from], [], [], max(patience, 0.0))
            assert ready, "Chromium does not answer"
            part = os.read(self._from, 1 << 20)
            assert part, "Chromium has ended"
            self._buffer += part
        line, _, self._buffer = self._buffer.partition(b"\0")
        return json.loads(line)

    def close(self) -> None:
        """End it."""
        try:
            self.send("Browser.close")
        except (AssertionError, OSError):
            self._process.kill()
        os.close(self._to)
        os.close(self._from)
        self._process.wait(PATIENCE)


@contextmanager
def browser() -> Iterator[Browser]:
    """A Chromium of its own, with a fresh profile."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        running = Browser(folder)
        try:
            yield running
        finally:
            running.close()
