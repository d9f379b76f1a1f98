"""Daemons of a test's own, each with a folder, a configuration and a port of its own."""

from __future__ import annotations

import json
import os
import signal
import sqlite3
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = ROOT / "target" / "debug" / "plenalign"

# Quick axes: what a test waits for is not their way.
SMALL = """
[server]
requests_per_s = 100000
{server}
[sensor]
width_px = 560
height_px = 560
[bench.focus]
speed_mm_per_s = 20
acceleration_mm_per_s2 = 200
[bench.e]
speed_mm_per_s = 20
acceleration_mm_per_s2 = 200
[bench.camera]
timeout_ms = 10000
[bench.simulation]
rays = 4
{simulation}
"""


def wait_for(what: str, condition: Callable[[], Any], allowed_s: float = 60.0) -> Any:
    """Returns what a condition comes to once that is true."""
    until = time.monotonic() + allowed_s
    while not (value := condition()):
        assert time.monotonic() < until, f"{what}: not within {allowed_s} s"
        time.sleep(0.05)
    return value


class Daemon:
    """The real program over the simulated bench, with a sensor small enough to render in a blink."""

    def __init__(
        self, folder: Path, *, server: str = "", simulation: str = "", arguments: tuple[str, ...] = ()
    ) -> None:
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        self.config = folder / "plenalign.toml"
        self.config.write_text(SMALL.format(server=server, simulation=simulation))
        self.arguments = arguments
        self.listen = "127.0.0.1:0"
        self.address = ""
        self.token: str | None = None
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def environment(self) -> dict[str, str]:
        return {**os.environ, "PLENALIGN_STATE_DIR": str(self.folder / "state")}

    def run(self, *arguments: str) -> str:
        """What another command of the program says."""
        done = subprocess.run(
            [PROGRAM, *arguments], env=self.environment, capture_output=True, text=True, timeout=60, check=False
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    def create_token(self, name: str, scope: str) -> str:
        secret: str = json.loads(self.run("token", "create", "--name", name, "--scope", scope, "--json"))["secret"]
        return secret

    def start(self) -> Daemon:
        """Starts it, at the same port as before where it ran before, and waits until it serves."""
        said, log = self.folder / "said", self.folder / "log"
        with said.open("wb") as out, log.open("ab") as error:
            command = [
                str(PROGRAM),
                "serve",
                "--config",
                str(self.config),
                "--simulated",
                "--json",
                "--listen",
                self.listen,
            ]
            self._process = subprocess.Popen(
                [*command, *self.arguments], env=self.environment, stdout=out, stderr=error, stdin=subprocess.DEVNULL
            )
        process = self._process
        wait_for("it says something, or ends", lambda: said.read_text().strip() or process.poll() is not None)
        assert said.read_text().strip(), log.read_text()
        self.address = json.loads(said.read_text().splitlines()[0])["address"].rstrip("/")
        self.listen = self.address.split("//")[1]
        if self.address.startswith("http://"):
            wait_for("the daemon is ready", self._is_ready)
        return self

    def _is_ready(self) -> bool:
        try:
            with urllib.request.urlopen(self.address + "/readyz", timeout=5):
                return True
        except urllib.error.HTTPError:
            return False

    def end(self, how: int = signal.SIGTERM) -> None:
        """Ends it, and waits until it has."""
        process, self._process = self._process, None
        if process is not None and process.poll() is None:
            process.send_signal(how)
            try:
                process.wait(timeout=20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
                raise

    def signal(self, which: int) -> None:
        """Sends it a signal, such as one that has it stand still."""
        assert self._process is not None
        self._process.send_signal(which)

    def kept(self, key: str) -> list[str]:
        """What the history keeps under a key."""
        with closing(sqlite3.connect(f"file:{self.folder}/state/history.db?mode=ro", uri=True)) as history:
            return [value for (value,) in history.execute("SELECT value FROM kept WHERE key = ?", (key,))]

    def raw(self, path: str) -> Any:
        """The JSON at a path, by a client that is not ours."""
        headers = {"authorization": f"Bearer {self.token}"} if self.token else {}
        request = urllib.request.Request(self.address + path, headers=headers)
        with urllib.request.urlopen(request, timeout=30) as answer:
            return json.load(answer)
