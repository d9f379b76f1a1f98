"""Watching the bench asynchronously: `async with watch(...) as messages: async for message in messages`."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator
from contextlib import suppress
from types import TracebackType

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidStatus

from ._following import CONNECT_S, LONGEST_MESSAGE, SILENCE_S, Following, Message, cut_off, refused
from .address import Address
from .errors import ConnectionLostError, NotReachedError, PlenalignError, UnavailableError
from .models import PicturesRequest, ReadingsRequest
from .watch import AGAIN_S


def watch(
    server: str | None = None,
    *,
    token: str | None = None,
    ca: str | os.PathLike[str] | None = None,
    fingerprint: str | None = None,
    insecure: bool = False,
    pictures: PicturesRequest | None = None,
    readings: ReadingsRequest | None = None,
    reconnect_s: float = 30.0,
) -> AsyncWatch:
    """What `plenalign.Watch` is, for an event loop; the first five arguments are those of `Address`."""
    address = Address(server, token=token, ca=ca, fingerprint=fingerprint, insecure=insecure)
    return AsyncWatch(address, pictures=pictures, readings=readings, reconnect_s=reconnect_s)


class AsyncWatch:
    """Messages from the daemon, to be iterated over asynchronously; see `plenalign.Watch`."""

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

    async def __aenter__(self) -> AsyncWatch:
        if self._socket is None:
            await self._connect()
        return self

    async def __aexit__(
        self, _t: type[BaseException] | None, _e: BaseException | None, _b: TracebackType | None
    ) -> None:
        await self.close()

    def __aiter__(self) -> AsyncIterator[Message]:
        return self

    async def __anext__(self) -> Message:
        while not self._closed:
            try:
                socket = self._socket or await self._connect()
                received = await asyncio.wait_for(socket.recv(), SILENCE_S)
                message, back = self._following.read(received)
                for text in back:
                    await socket.send(text)
                if message is not None:
                    return message
            # Before Python 3.11 a time that is over is no OSError.
            except (ConnectionClosed, OSError, asyncio.TimeoutError) as error:
                if isinstance(error, PlenalignError):
                    raise
                await self._again(error)
        raise StopAsyncIteration

    async def close(self) -> None:
        """Ends the watching. May be repeated."""
        self._closed = True
        await self._drop()

    async def _drop(self) -> None:
        socket, self._socket = self._socket, None
        if socket is not None:
            with suppress(OSError):
                await socket.close()

    async def _connect(self) -> ClientConnection:
        try:
            self._socket = await connect(
                self._following.url,
                ssl=self._address.tls,
                additional_headers=self._address.headers,
                open_timeout=CONNECT_S,
                close_timeout=1.0,
                max_size=LONGEST_MESSAGE,
                compression=None,
                proxy=None,
            )
            for text in self._following.greetings():
                await self._socket.send(text)
            return self._socket
        except InvalidStatus as error:
            raise refused(error.response.status_code, bytes(error.response.body or b""), self._address.base) from None
        except (InvalidHandshake, OSError, EOFError, asyncio.TimeoutError) as error:
            raise NotReachedError(f"no daemon answers at {self._address.socket}: {error or 'no answer'}") from error

    async def _again(self, error: Exception) -> None:
        """Connects anew, for as long as it may take."""
        await self._drop()
        if isinstance(error, ConnectionClosed) and error.rcvd and cut_off(error.rcvd.code, error.rcvd.reason):
            raise ConnectionLostError(f"the daemon has ended the watching: {error.rcvd.reason}") from error
        loop = asyncio.get_running_loop()
        until = loop.time() + self._reconnect_s
        while not self._closed:
            try:
                await self._connect()
                return
            except (NotReachedError, UnavailableError) as failure:
                if loop.time() + AGAIN_S > until:
                    why = f"{error or 'nothing was heard'}; then {failure}"
                    raise ConnectionLostError(f"the connection to {self._address.base} broke: {why}") from error
            await asyncio.sleep(AGAIN_S)
