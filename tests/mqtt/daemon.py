"""A daemon with a simulated bench, started and ended by a test."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import time
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

PROGRAM = Path(__file__).parents[2] / "target/debug/plenalign"

# What a test waits for is not their way.
QUICK_AXES = "".join(
    f"[bench.{axis}]\nspeed_mm_per_s = 20\nacceleration_mm_per_s2 = 200\n" for axis in ("focus", "e")
)


def wait_for(what: str, condition: Any, allowed_s: float = 30.0) -> Any:
    """Returns what a condition comes to once that is true."""
    until = time.monotonic() + allowed_s
    while not (value := condition()):
        assert time.monotonic() < until, f"{what}: not within {allowed_s} s"
        time.sleep(0.05)
    return value


class Daemon:
    """A daemon that publishes over MQTT as `bench`."""

    def __init__(self, folder: Path, mqtt: str, bench: str = "wet", tls: str = "", simulation: str = "") -> None:
        folder.mkdir()
        self.folder, self.bench = folder, bench
        (folder / "plenalign.toml").write_text(
            f'[mqtt]\nbench = "{bench}"\ngroup = "hall"\nkeep_alive_s = 5.0\nmeasurements_per_s = 4.0\n{mqtt}\n'
            f"{tls}\n[sensor]\nwidth_px = 400\nheight_px = 400\n{QUICK_AXES}[bench.camera]\ntimeout_ms = 10000\n"
            f"[bench.simulation]\nrays = 4\n{simulation}\n"
        )
        self._process: subprocess.Popen[str] | None = None
        self.address = ""

    def start(self, *arguments: str) -> Daemon:
        """Starts it, and returns once its bench can be worked with."""
        with (self.folder / "log").open("a") as log:
            self._process = subprocess.Popen(
                [PROGRAM, "serve", "--config", self.folder / "plenalign.toml", "--simulated", "--json",
                 "--listen", "127.0.0.1:0", *arguments],
                env={**os.environ, "PLENALIGN_STATE_DIR": str(self.folder), "RUST_LOG": "info", "NO_COLOR": "1"},
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
            )  # fmt: skip
        assert self._process.stdout is not None
        said = self._process.stdout.readline()
        assert said, self.log()
        self.address = json.loads(said)["address"].rstrip("/")
        wait_for("the daemon is ready", lambda: self.ask("/readyz", may_fail=True))
        return self

    def refuses_to_start(self) -> str:
        """What it says where it does not start."""
        command = [
            PROGRAM,
            "serve",
            "--config",
            self.folder / "plenalign.toml",
            "--simulated",
            "--listen",
            "127.0.0.1:0",
        ]
        environment = {**os.environ, "PLENALIGN_STATE_DIR": str(self.folder)}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=30)
        assert done.returncode != 0
        return done.stderr

    def log(self) -> str:
        return (self.folder / "log").read_text()

    def ask(self, path: str, body: Any = None, key: str = "", method: str = "", may_fail: bool = False) -> Any:
        """What is at a path: from JSON, or as text."""
        headers = (
            {"content-type": "application/json", "plenalign-lease": key}
            if key
            else {"content-type": "application/json"}
        )
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self.address + path, data, headers, method=method or None)
        try:
            with urllib.request.urlopen(request, timeout=20) as answer:
                text = answer.read().decode()
        except (urllib.error.HTTPError, OSError) as error:
            if may_fail:
                return None
            detail = error.read().decode() if isinstance(error, urllib.error.HTTPError) else ""
            raise AssertionError(f"{path}: {error}: {detail}") from error
        return text if path == "/metrics" else json.loads(text or "null")

    def lease(self) -> str:
        return self.ask("/api/v1/lease", {"owner": "ada"})["key"]

    def start_job(self, **request: Any) -> dict[str, Any]:
        key = self.lease()
        job = self.ask("/api/v1/jobs", request, key)
        self.ask("/api/v1/lease", key=key, method="DELETE")
        return job

    def job(self, job: str) -> dict[str, Any]:
        return self.ask(f"/api/v1/jobs/{job}")

    def run_job(self, **request: Any) -> dict[str, Any]:
        """Runs a job to its end, and returns it."""
        job = self.start_job(**request)["id"]
        wait_for("the job has ended", lambda: self.job(job)["ended_at"], 120)
        return self.job(job)

    def metric(self, name: str) -> float:
        """A metric with its labels, as it is written; 0 while nothing has been counted."""
        found = re.search(rf"^{re.escape(name)} (\S+)$", self.ask("/metrics"), re.MULTILINE)
        return float(found[1]) if found else 0.0

    def is_connected(self) -> bool:
        return self.metric("plenalign_mqtt_connected") == 1

    def wait_connected(self, connected: bool = True) -> None:
        wait_for(f"connected is {connected}", lambda: self.is_connected() == connected)

    def signal(self, number: signal.Signals) -> None:
        assert self._process is not None
        self._process.send_signal(number)

    def end(self) -> float:
        """Ends it in good order, and returns how long that took, s."""
        assert self._process is not None
        from_ = time.monotonic()
        self._process.terminate()
        self._process.wait(timeout=10)
        self._process = None
        return time.monotonic() - from_

    def kill(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None
