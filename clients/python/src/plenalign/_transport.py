"""Requests and answers: one at a time, within a time, each failure with its own exception."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import TracebackType
from typing import TypeVar
from urllib.parse import quote

import httpx
import msgspec

from ._operations import Operation
from .address import Address
from .errors import (
    ConnectionLostError,
    NotReachedError,
    OutcomeUnknownError,
    PlenalignError,
    UnexpectedAnswerError,
    problem_error,
)

T = TypeVar("T")

ANSWER_S = 10.0
"""Longest wait for an answer, unless it is told otherwise."""
LONG_S = 60.0
"""The same for what the daemon has to work at, or to wait for."""
CONNECT_S = 5.0
LIMIT_BYTES = 512 * 1024 * 1024
"""Longest answer that is taken."""


class Answer:
    """A whole answer."""

    def __init__(self, status: int, headers: httpx.Headers, body: bytes, base: str) -> None:
        self.status, self.headers, self.body, self._base = status, headers, body, base

    def as_(self, kind: type[T]) -> T:
        """The answer's JSON as this kind of thing."""
        return decode(self.body, kind, self._base)

    def text(self) -> str:
        """The answer as text."""
        try:
            return self.body.decode()
        except UnicodeDecodeError as error:
            raise UnexpectedAnswerError(f"what {self._base} sends is no text: {error}") from None


def decode(body: bytes | str, kind: type[T], base: str) -> T:
    """JSON as this kind of thing."""
    try:
        return msgspec.json.decode(body, type=kind)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise UnexpectedAnswerError(
            f"what answers at {base} is not a version of plenalign that this package understands: {error}"
        ) from None


class Transport:
    """Sends requests. Nothing is sent twice."""

    def __init__(self, address: Address, timeout_s: float) -> None:
        if not (math.isfinite(timeout_s) and timeout_s > 0):
            raise ValueError(f"timeout_s is {timeout_s}; a number of seconds above 0 is needed")
        self.address = address
        self.timeout_s = timeout_s
        self._client = httpx.Client(
            base_url=address.base,
            headers={**address.headers, "user-agent": "plenalign-python"},
            verify=address.tls or False,
            # A bench is on the machine or the network beside it, and its daemon refuses what a proxy forwards.
            trust_env=False,
            limits=httpx.Limits(max_keepalive_connections=4, keepalive_expiry=4.0),
        )

    def __enter__(self) -> Transport:
        return self

    def __exit__(self, _t: type[BaseException] | None, _e: BaseException | None, _b: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Lets the connections go."""
        self._client.close()

    def ask(
        self,
        operation: Operation,
        *,
        path: Mapping[str, object] | None = None,
        query: Mapping[str, object] | None = None,
        headers: Mapping[str, str] | None = None,
        body: object = None,
        timeout_s: float | None = None,
    ) -> Answer:
        """Sends a request and reads the whole answer; a refusal is raised."""
        limit = self.timeout_s if timeout_s is None else timeout_s
        with self.open(operation, path=path, query=query, headers=headers, body=body, timeout_s=limit) as response:
            return self._read(operation, response, time.monotonic() + limit)

    @contextmanager
    def open(
        self,
        operation: Operation,
        *,
        path: Mapping[str, object] | None = None,
        query: Mapping[str, object] | None = None,
        headers: Mapping[str, str] | None = None,
        body: object = None,
        timeout_s: float | None = None,
    ) -> Iterator[httpx.Response]:
        """Sends a request and gives the answer to be read; a refusal is raised."""
        limit = self.timeout_s if timeout_s is None else timeout_s
        given = {name: text(value) for name, value in (query or {}).items() if value is not None}
        for name in given:
            if name not in operation.query:
                raise TypeError(f"{operation.path} takes no {name}")
        sent = dict(headers or {})
        content = None
        if body is not None:
            content = _json(body)
            sent["content-type"] = "application/json"
        url = operation.path
        for name, value in (path or {}).items():
            url = url.replace(f"{{{name}}}", _segment(value))
        timeout = httpx.Timeout(limit, connect=min(CONNECT_S, limit), pool=min(CONNECT_S, limit))
        try:
            with self._client.stream(
                operation.method, url, params=given, headers=sent, content=content, timeout=timeout
            ) as response:
                if response.status_code >= 300 and response.status_code != 304:
                    raise self._refusal(response, self._read(operation, response, time.monotonic() + limit).body)
                yield response
        except httpx.HTTPError as error:
            raise self._failure(operation, error) from error

    def _read(self, operation: Operation, response: httpx.Response, deadline: float) -> Answer:
        body = bytearray()
        for piece in response.iter_bytes():
            body += piece
            if len(body) > LIMIT_BYTES:
                raise UnexpectedAnswerError(f"the answer from {self.address.base} does not end")
            if time.monotonic() > deadline:
                raise self._late(operation, "the answer trickles")
        return Answer(response.status_code, response.headers, bytes(body), self.address.base)

    def _refusal(self, response: httpx.Response, body: bytes) -> PlenalignError:
        base = self.address.base
        if response.is_redirect:
            where = response.headers.get("location", "elsewhere")
            return UnexpectedAnswerError(f"{base} sends on to {where}: give that address")
        try:
            problem = json.loads(body)
            if isinstance(problem, dict) and isinstance(problem.get("type"), str):
                return problem_error({"status": response.status_code, **problem}, _seconds(response))
        except (ValueError, RecursionError):
            pass
        said = f"{response.status_code} {response.reason_phrase}"
        return UnexpectedAnswerError(f"what answers at {base} with {said} is no plenalign, or a proxy before it")

    def _failure(self, operation: Operation, error: httpx.HTTPError) -> PlenalignError:
        base = self.address.base
        if isinstance(error, (httpx.ConnectError, httpx.ConnectTimeout, httpx.PoolTimeout)):
            if "CERTIFICATE_VERIFY_FAILED" in str(error) or "fingerprint" in str(error):
                right = "give ca=, the ca.pem that `plenalign tls init` made there, or the right fingerprint="
                return NotReachedError(f"the certificate at {base} is not vouched for ({error}): {right}")
            right = "start `plenalign serve` there, or give another address"
            return NotReachedError(f"no daemon answers at {base} ({error or 'no answer in time'}): {right}")
        if isinstance(error, httpx.TimeoutException):
            return self._late(operation, "no answer in time")
        return self._late(operation, f"the connection broke: {error}")

    def _late(self, operation: Operation, why: str) -> PlenalignError:
        what = f"{operation.method} {operation.path} at {self.address.base}"
        if operation.method == "GET":
            return ConnectionLostError(f"{what}: {why}")
        return OutcomeUnknownError(f"{what}: {why}; it may have been obeyed: look at the bench before repeating it")


def _json(body: object) -> bytes:
    # JSON has no NaN, and a number that became `null` on its way would be taken for one not given.
    try:
        return json.dumps(msgspec.to_builtins(body), allow_nan=False).encode()
    except ValueError as error:
        raise ValueError(f"{type(body).__name__} holds a number that is not finite: {error}") from None


def _segment(value: object) -> str:
    """One part of a path, whatever it holds."""
    return quote(text(value), safe="")


def text(value: object) -> str:
    """A parameter as it is sent."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (list, tuple, set, frozenset)):
        return ",".join(text(each) for each in value)
    enumerated = getattr(value, "value", None)
    if enumerated is not None:
        return str(enumerated)
    stamped = getattr(value, "isoformat", None)
    return str(stamped()) if stamped is not None else str(value)


def _seconds(response: httpx.Response) -> float | None:
    try:
        return float(response.headers["retry-after"])
    except (KeyError, ValueError):
        return None


__all__ = ["ANSWER_S", "LONG_S", "Answer", "Transport", "decode"]
