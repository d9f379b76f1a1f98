"""Watching the bench: everything as it is, then everything that changes."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import suppress
from types import TracebackType

from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from ._following import CONNECT_S, LONGEST_MESSAGE, SILENCE_S, Following, Message, cut_off, refused
from .address import Address
from .errors import ConnectionLostError, NotReachedError, PlenalignError, UnavailableError
from .models import PicturesRequest, ReadingsRequest

AGAIN_S = 0.5
"""Between two attempts to connect anew."""


class Watch:
    """Messages from the daemon, to be iterated over, in a `with` block.

    First a `SnapshotMessage` with everything, then a message for each change and a `TickMessage` every second.
    When the connection breaks, a new one goes on where the old one ended; where the daemon no longer has what was
    missed, or was started anew, a `GapMessage` and a new snapshot come. After `reconnect_s` without a connection
    `ConnectionLostError` is raised.

    With `pictures`, live pictures come, too, as `Picture`, of the part of the frame that its `viewport` says or else of
    the whole of it, and with its `overlay` the `SpacingMap` of each measurement;
    with `readings` the spacing in each frame that the camera takes, as `Reading`.
    """

    def __init__(
        self,
        address: Address,
        *,
        pictures: PicturesRequest | None = None,
        readings: ReadingsRequest | None = None,
        reconnect_s: float = 30.0,
    ) -> None:
        self._address = address
        self._reconnect_s = reconnect_s
        self._following = Following(address, pictures, readings)
        self._socket: ClientConnection | None = None
        self._closed = False

    def __enter__(self) -> Watch:
        if self._socket is None:
            self._connect()
        return self

    def __exit__(self, _t: type[BaseException] | None, _e: BaseException | None, _b: TracebackType | None) -> None:
        self.close()

    def __iter__(self) -> Iterator[Message]:
        return self

    def __next__(self) -> Message:
        while not self._closed:
            try:
                socket = self._socket or self._connect()
                message, back = self._following.read(socket.recv(timeout=SILENCE_S))
                for text in back:
                    socket.send(text)
                if message is not None:
                    return message
            except (ConnectionClosed, OSError) as error:
                # A time that is over is an OSError, too; what this package raises of its own is not to be tried again.
                if isinstance(error, PlenalignError):
                    raise
                self._again(error)
        raise StopIteration

    def close(self) -> None:
        """Ends the watching. May be repeated, and be called by another thread."""
        self._closed = True
        self._drop()

    def _drop(self) -> None:
        socket, self._socket = self._socket, None
        if socket is not None:
            with suppress(OSError):
                socket.close()

    def _connect(self) -> ClientConnection:
        try:
            # Entered, and left by being closed: it lives longer than a block.
            self._socket = connect(
                self._following.url,
                ssl=self._address.tls,
                additional_headers=self._address.headers,
                open_timeout=CONNECT_S,
                close_timeout=1.0,
                max_size=LONGEST_MESSAGE,
                compression=None,
                proxy=None,
            ).__enter__()
            for text in self._following.greetings():
                self._socket.send(text)
            return self._socket
        except InvalidStatus as error:
            raise refused(error.response.status_code, bytes(error.response.body or b""), self._address.base) from None
        except (InvalidHandshake, OSError, EOFError) as error:
            raise NotReachedError(f"no daemon answers at {self._address.socket}: {error or 'no answer'}") from error

    def _again(self, error: Exception) -> None:
        """Connects anew, for as long as it may take."""
        self._drop()
        if isinstance(error, ConnectionClosed) and error.rcvd and cut_off(error.rcvd.code, error.rcvd.reason):
            raise ConnectionLostError(f"the daemon has ended the watching: {error.rcvd.reason}") from error
        until = time.monotonic() + self._reconnect_s
        while not self._closed:
            try:
                self._connect()
                return
            except (NotReachedError, UnavailableError) as failure:
                if time.monotonic() + AGAIN_S > until:
                    why = f"{error or 'nothing was heard'}; then {failure}"
                    raise ConnectionLostError(f"the connection to {self._address.base} broke: {why}") from error
            time.sleep(AGAIN_S)
