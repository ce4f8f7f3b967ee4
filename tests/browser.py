"""A headless Chromium in tests, driven through its DevTools protocol over two pipes."""

import base64
import itertools
import json
import os
import select
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), ""
)
needs_chromium = pytest.mark.skipif(not CHROMIUM, reason="no Chromium here")

FLAGS = (
    "--headless=new", "--remote-debugging-pipe", "--no-sandbox", "--disable-gpu", "--no-first-run",
    "--disable-dev-shm-usage", "--disable-background-networking", "--disable-extensions",
    "--disable-component-update",
)  # fmt: skip
START = """
import fcntl, os, sys
told, says = (fcntl.fcntl(int(number), fcntl.F_DUPFD, 10) for number in sys.argv[1:3])
os.dup2(told, 3)
os.dup2(says, 4)
os.execv(sys.argv[3], sys.argv[3:])
"""
"""Chromium reads what it is told from descriptor 3, and answers on 4."""
PATIENCE = 60.0
"""Seconds for one answer."""


class Browser:
    """A browser with one page, to be used in ``with``.

    ``console`` has errors and warnings of the page, ``requests`` the addresses that it asked for.
    """

    def __init__(self, folder: Path):
        self._folder = folder
        self._numbers = itertools.count(1)
        self._rest = b""
        self.console: list[str] = []
        self.requests: list[str] = []

    def __enter__(self):
        reported, self._asks = os.pipe()
        self._answers, says = os.pipe()
        words = [sys.executable, "-c", START, str(reported), str(says), CHROMIUM, *FLAGS]
        self._process = subprocess.Popen(
            [*words, f"--user-data-dir={self._folder}"], pass_fds=(reported, says),
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        os.close(reported)
        os.close(says)
        target = self.ask("Target.createTarget", url="about:blank", session=None)["targetId"]
        self._session = self.ask(
            "Target.attachToTarget", targetId=target, flatten=True, session=None
        )["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.ask(f"{domain}.enable")
        return self

    def __exit__(self, *_):
        os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        os.close(self._asks)
        os.close(self._answers)

    def ask(self, method, *, session="", **given):
        """The answer to one call of the protocol."""
        number = next(self._numbers)
        call = {"id": number, "method": method, "params": given}
        if session is not None:
            call["sessionId"] = self._session
        content = json.dumps(call).encode() + b"\0"
        while content:
            content = content[os.write(self._asks, content) :]
        end = time.monotonic() + PATIENCE
        while (answer := self._next(end)).get("id") != number:
            self._note(answer)
        assert "error" not in answer, answer
        return answer["result"]

    def _next(self, end):
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._answers], [], [], max(0.0, end - time.monotonic()))
            assert ready, "no answer"
            part = os.read(self._answers, 1 << 20)
            assert part, "the browser is gone"
            self._rest += part
        first, _, self._rest = self._rest.partition(b"\0")
        return json.loads(first)

    def _note(self, event):
        given, kind = event.get("params", {}), event.get("method")
        if kind == "Runtime.consoleAPICalled" and given["type"] in ("error", "warning", "assert"):
            self.console.append(json.dumps(given["args"]))
        elif kind == "Runtime.exceptionThrown":
            self.console.append(json.dumps(given["exceptionDetails"]))
        elif kind == "Log.entryAdded" and given["entry"]["level"] in ("error", "warning"):
            self.console.append(given["entry"]["text"])
        elif kind == "Network.requestWillBeSent":
            self.requests.append(given["request"]["url"])

    def run(self, script):
        """The value of an expression on the page; promises are awaited."""
        answer = self.ask(
            "Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def wait_for(self, script):
        """Until an expression is true."""
        end = time.monotonic() + PATIENCE
        while not self.run(f"Boolean({script})"):
            assert time.monotonic() < end, script
            time.sleep(0.02)

    def open(self, file):
        """Open a file from the disk."""
        self.ask("Page.navigate", url=Path(file).resolve().as_uri())
        self.wait_for("document.readyState === 'complete' && location.protocol === 'file:'")

    def resize(self, width, height=900, mobile=False):
        self.ask(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=height, deviceScaleFactor=1, mobile=mobile,
        )  # fmt: skip

    def screenshot(self, file, whole=True):
        image = self.ask("Page.captureScreenshot", captureBeyondViewport=whole)
        Path(file).write_bytes(base64.b64decode(image["data"]))

    def pdf(self):
        """The page as it is printed, on A4."""
        printed = self.ask("Page.printToPDF", preferCSSPageSize=True, printBackground=False)
        return base64.b64decode(printed["data"])
