"""The daemon's configuration, read and written as a whole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from . import _operations as op
from ._transport import Transport
from .configuration import Config
from .errors import UnexpectedAnswerError
from .models import ConfigCheck, ConfigRequest, ConfigTried, ConfigView, ConfigWritten


@dataclass(frozen=True)
class Configuration:
    """The configuration and the state of its file."""

    view: ConfigView
    """What is in force, what the file holds, what is locked."""
    etag: str
    """Names the state of the file, for whoever writes it."""


class Settings:
    """Reads and writes the configuration."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def read(self) -> Configuration:
        """The configuration in force and where it came from."""
        answer = self._transport.ask(op.GET_CONFIG)
        etag = answer.headers.get("etag")
        if etag is None:
            raise UnexpectedAnswerError("the configuration came without its ETag, as if through a proxy that drops it")
        return Configuration(answer.as_(ConfigView), etag)

    def schema(self) -> dict[str, Any]:
        """The JSON Schema of the configuration."""
        return self._transport.ask(op.GET_CONFIG_SCHEMA).as_(dict[str, Any])

    def check(self, config: Config | dict[str, Any]) -> ConfigCheck:
        """What is wrong with a configuration, which is not written."""
        return self._transport.ask(op.VALIDATE_CONFIG, body=ConfigTried(config=config)).as_(ConfigCheck)

    def write(self, config: Config, read: Configuration) -> ConfigWritten:
        """Writes the whole configuration, a key that is left out with its default, in place of the one that was read.

        Where the file has changed since, `ConfigChangedError` is raised and nothing written. It takes effect when the
        daemon starts again.
        """
        headers = {"If-Match": read.etag}
        return self._transport.ask(op.PUT_CONFIG, headers=headers, body=ConfigRequest(config=config)).as_(ConfigWritten)
