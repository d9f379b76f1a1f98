"""The daemons and clients that the tests share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import plenalign
import pytest

from bench import Daemon


@pytest.fixture(autouse=True)
def _no_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("PLENALIGN_TOKEN", "PLENALIGN_SERVER"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture(scope="session")
def daemon(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    """A daemon that demands no token, whose simulated operator confirms by himself."""
    daemon = Daemon(tmp_path_factory.mktemp("shared")).start()
    yield daemon
    daemon.end()


@pytest.fixture(scope="session")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    """A daemon that demands a token of everybody; `token` is an administrator's."""
    daemon = Daemon(tmp_path_factory.mktemp("guarded"), server='auth = "required"')
    daemon.token = daemon.create_token("tests", "admin")
    daemon.start()
    yield daemon
    daemon.end()


@pytest.fixture
def new_daemon(tmp_path: Path) -> Iterator[Callable[..., Daemon]]:
    """Makes daemons of the test's own."""
    made: list[Daemon] = []

    def new(**settings: object) -> Daemon:
        made.append(Daemon(tmp_path / f"daemon-{len(made)}", **settings))  # type: ignore[arg-type]
        return made[-1]

    yield new
    for daemon in made:
        daemon.end()


@pytest.fixture
def client(daemon: Daemon) -> Iterator[plenalign.Client]:
    """A client of the shared daemon, whose stop is reset and whose bench is free again afterwards."""
    with plenalign.Client(daemon.address) as client:
        yield client
        client.reset_stop("a test goes on")
        client.set_faults()
        with client.lease("tidying up", take_over=True):
            pass


@pytest.fixture
def homed(client: plenalign.Client) -> plenalign.Client:
    """The same, with both axes homed."""
    if not all(axis.homed for axis in client.bench().axes):
        with client.lease("a test") as lease:
            lease.set_shell("off")
            lease.start(plenalign.models.HomingJob()).wait(timeout_s=60)
    return client


@pytest.fixture
def measurable(homed: plenalign.Client) -> plenalign.Client:
    """The same, with a white frame, which only a job takes."""
    try:
        homed.measure()
    except plenalign.ProblemError as refused:
        assert refused.kind == "not-measurable"
        with homed.lease("a test") as lease:
            lease.start(plenalign.models.SpacingWatchJob(duration_s=1.0)).wait(timeout_s=60)
    return homed


@pytest.fixture
def admin(guarded: Daemon) -> Iterator[plenalign.Client]:
    """An administrator of the daemon that demands a token."""
    with plenalign.Client(guarded.address, token=guarded.token) as client:
        yield client
