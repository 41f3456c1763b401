"""A page in headless Chromium, driven over the DevTools protocol through a pipe: no driver, port or package is needed.

Protocol: https://chromedevtools.github.io/devtools-protocol
"""

import base64
import json
import os
import select
import shutil
import subprocess
import time

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
REQUIRED = os.environ.get("HEXAKIN_BROWSER") == "required"
"""Whether a test fails, instead of being skipped, if there is no browser."""
OPTIONS = (
    "--headless=new",
    "--no-sandbox",  # a container's root has none; the pages are our own
    "--disable-dev-shm-usage",  # a container's /dev/shm is small
    "--remote-debugging-pipe",
    "--disable-background-networking",
    "--no-first-run",
    "--host-resolver-rules=MAP * ~NOTFOUND",  # as without a network
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",  # WebGL without a graphics card
)


def find():
    """Path of a browser, or None."""
    if os.name != "posix":  # a pipe is handed over by the numbers of its ends
        return None
    return next(filter(None, map(shutil.which, NAMES)), None)


class Browser:
    """One tab. ``complaints`` are errors of its console and requests that failed, ``requests`` what was asked for."""

    def __init__(self, profile):
        import fcntl  # on POSIX systems alone

        to_browser, self._write = os.pipe()
        self._read, from_browser = os.pipe()

        def as_three_and_four():  # where Chromium expects the pipes' ends
            ends = [fcntl.fcntl(end, fcntl.F_DUPFD, 10) for end in (to_browser, from_browser)]
            os.dup2(ends[0], 3)
            os.dup2(ends[1], 4)

        self._process = subprocess.Popen(
            [find(), *OPTIONS, f"--user-data-dir={profile}"],
            preexec_fn=as_three_and_four,
            close_fds=False,  # Python's own are not inherited anyway; 3 and 4 shall be
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_browser)
        os.close(from_browser)
        self._buffer, self._sent, self._session = b"", 0, None
        self.complaints, self.requests, self._happened = [], [], []
        target = self("Target.createTarget", url="about:blank")["targetId"]
        self._session = self("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self(f"{domain}.enable")

    def __call__(self, method, **parameters):
        """Give a command and return its result."""
        self._sent += 1
        message = {"id": self._sent, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._sent:
                assert "error" not in answer, f"{method}: {answer['error']}"
                return answer["result"]

    def _next(self, seconds=600.0):
        """Return the next message, having noted what it says; a busy machine may need minutes for one."""
        end = time.monotonic() + seconds
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._read], [], [], max(0.0, end - time.monotonic()))
            part = os.read(self._read, 1 << 20) if ready else b""
            assert part, f"Chromium says nothing for {seconds:.0f} s" if not ready else "Chromium has ended"
            self._buffer += part
        line, _, self._buffer = self._buffer.partition(b"\0")
        message = json.loads(line)
        kind, about = message.get("method"), message.get("params", {})
        if kind == "Runtime.exceptionThrown":
            self.complaints.append(about["exceptionDetails"])
        elif kind == "Runtime.consoleAPICalled" and about["type"] in ("error", "assert"):
            self.complaints.append([argument.get("value") for argument in about["args"]])
        elif kind == "Log.entryAdded" and about["entry"]["level"] == "error":
            self.complaints.append(about["entry"])
        elif kind == "Network.loadingFailed":
            self.complaints.append(about)
        elif kind == "Network.requestWillBeSent":
            self.requests.append(about["request"]["url"])
        self._happened.append(kind)
        return message

    def open(self, path, width=1280, height=800):
        """Load a file and wait until everything in it is there."""
        self.complaints, self.requests, self._happened = [], [], []
        self("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self("Page.navigate", url=path.resolve().as_uri())
        while "Page.loadEventFired" not in self._happened:
            self._next()

    def value(self, expression):
        """Value of a JavaScript expression, awaited."""
        result = self("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in result, result["exceptionDetails"]
        return result["result"].get("value")

    def screenshot(self, whole=False):
        """PNG file of what is to be seen, or of the whole page."""
        return base64.b64decode(self("Page.captureScreenshot", format="png", captureBeyondViewport=whole)["data"])

    def close(self):
        """End the browser."""
        os.close(self._write)
        try:
            self._process.wait(10.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._read)
