"""What the tests share: brokers, daemons and subscribers that end with their test."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from broker import Broker
from daemon import Daemon
from subscriber import Subscriber

ADDRESS = 'broker = "mqtt://127.0.0.1:1883"'


@pytest.fixture
def new_broker(tmp_path: Path) -> Iterator[Callable[..., Broker]]:
    made: list[Broker] = []

    def new(**settings: object) -> Broker:
        made.append(Broker(tmp_path, **settings))  # type: ignore[arg-type]
        return made[-1]

    yield new
    for broker in made:
        broker.kill()


@pytest.fixture
def broker(new_broker: Callable[..., Broker]) -> Broker:
    return new_broker().start()


@pytest.fixture
def new_daemon(tmp_path: Path) -> Iterator[Callable[..., Daemon]]:
    made: list[Daemon] = []

    def new(mqtt: str = ADDRESS, **settings: str) -> Daemon:
        made.append(Daemon(tmp_path / f"daemon-{len(made)}", mqtt, **settings))
        return made[-1]

    yield new
    for daemon in made:
        daemon.kill()


@pytest.fixture
def new_subscriber() -> Iterator[Callable[..., Subscriber]]:
    made: list[Subscriber] = []

    def new(**settings: object) -> Subscriber:
        made.append(Subscriber(**settings))  # type: ignore[arg-type]
        return made[-1]

    yield new
    for subscriber in made:
        subscriber.close()


@pytest.fixture
def frozen() -> Iterator[Callable[[Broker | Daemon], None]]:
    """Has a process stand still, until the test's end at the latest."""
    stopped: list[Broker | Daemon] = []

    def freeze(what: Broker | Daemon) -> None:
        what.signal(signal.SIGSTOP)
        stopped.append(what)

    yield freeze
    for what in stopped:
        try:
            what.signal(signal.SIGCONT)
        except AssertionError:
            pass
