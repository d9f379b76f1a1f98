"""Mosquitto, started and ended by a test."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
from pathlib import Path

from daemon import wait_for


class Broker:
    """A Mosquitto of its own, which keeps nothing on disk."""

    def __init__(self, folder: Path, port: int = 1883, settings: str = "allow_anonymous true") -> None:
        self.port = port
        self.folder = folder
        self.settings = settings
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> Broker:
        """Starts it, and returns once it takes connections."""
        config = self.folder / f"mosquitto-{self.port}.conf"
        # Started as root, it would become another user, who can read nothing here.
        config.write_text(f"user root\nlistener {self.port} 127.0.0.1\n{self.settings}\n")
        with (self.folder / f"mosquitto-{self.port}.log").open("ab") as log:
            self._process = subprocess.Popen(
                [os.environ["MOSQUITTO"], "-v", "-c", config],
                env={**os.environ, "LD_LIBRARY_PATH": os.environ["MOSQUITTO_LIBRARIES"]},
                stdout=log,
                stderr=log,
            )
        wait_for("it takes connections", self._takes_connections)
        return self

    def _takes_connections(self) -> bool:
        assert self._process is not None
        assert self._process.poll() is None, self.log()
        try:
            socket.create_connection(("127.0.0.1", self.port)).close()
        except OSError:
            return False
        return True

    def log(self) -> str:
        return (self.folder / f"mosquitto-{self.port}.log").read_text()

    def signal(self, number: signal.Signals) -> None:
        assert self._process is not None
        self._process.send_signal(number)

    def kill(self) -> None:
        """Ends it at once, with all that it kept."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None


def hash_passwords(file: Path) -> None:
    """Has a file of USER:PASSWORD lines hold hashes, as Mosquitto wants them."""
    libraries = os.environ["MOSQUITTO_LIBRARIES"]
    command = [os.environ["MOSQUITTO_PASSWD"], "-U", file]
    subprocess.run(command, check=True, env={**os.environ, "LD_LIBRARY_PATH": libraries})
