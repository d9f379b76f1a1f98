"""The control lease: whoever holds it may move the axes."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType
from uuid import uuid4

from . import _operations as op
from ._motion import wait_for_rest
from ._transport import LONG_S, Transport
from .errors import (
    LeaseLostError,
    OutcomeUnknownError,
    PlenalignError,
    ProblemError,
    TooManyRequestsError,
    UnavailableError,
    problem_error,
)
from .job import Job
from .models import (
    AutoExposureView,
    AxisName,
    AxisView,
    BenchView,
    ControlName,
    ControlRequest,
    JobCreated,
    JobRequest,
    JobResource,
    JogRequest,
    LeaseGrant,
    LeaseView,
    LeaveSwitchRequest,
    LightView,
    MoveRequest,
    ShellRequest,
    ShellState,
    Side,
)

HEADER = "Plenalign-Lease"
_JOG_AGAIN_S = 0.1
"""Between two requests of one jog: the axis moves for 0.3 s from each."""
_JOG_ANSWER_S = 2.0
_EXPOSING_S = 70.0
"""The daemon gives a search for the exposure up after a minute."""


class Lease:
    """The control lease, renewed by a thread until it is given back.

    Used in a `with` block, at whose end it is given back. Once it is lost, because another took it over or the daemon
    could not be reached for its time to live, everything here raises `LeaseLostError`, the end of the block included.
    """

    def __init__(
        self, transport: Transport, grant: LeaseGrant, on_lost: Callable[[LeaseLostError], None] | None = None
    ) -> None:
        self._transport = transport
        self._key = grant.key
        self._view = grant.lease
        self._on_lost = on_lost
        self._lost: LeaseLostError | None = None
        self._over = threading.Event()
        self._until = time.monotonic() + grant.lease.ttl_s
        self._thread = threading.Thread(target=self._renew, name="plenalign lease", daemon=True)
        self._thread.start()

    def __repr__(self) -> str:
        """Without the key."""
        return f"Lease({self._view.owner!r}, lost={self._lost is not None})"

    def __enter__(self) -> Lease:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        if kind is None:
            lost = self._lost
            self.release()
            if lost is not None:
                raise lost
            return
        # What went wrong is more than that the lease could not be given back: it runs out by itself.
        with suppress(PlenalignError):
            self.release()

    @property
    def view(self) -> LeaseView:
        """The lease as everybody sees it, as of its last renewal."""
        return self._view

    @property
    def lost(self) -> bool:
        """Whether it is lost."""
        return self._lost is not None

    @property
    def key(self) -> str:
        """What shows that one has it; to be kept from others."""
        return self._key

    def check(self) -> None:
        """Raises where the lease is lost."""
        if self._lost is not None:
            raise self._lost
        if self._over.is_set():
            raise _lost("the control lease was given back; take it anew")

    def release(self) -> None:
        """Gives the lease back; where a job holds it, at that job's end. May be repeated."""
        if self._over.is_set():
            return
        self._over.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout=self._transport.timeout_s + 1.0)
        if self._lost is None:
            self._transport.ask(op.RELEASE_LEASE, headers=self._shown())

    def start(self, job: JobRequest, *, idempotency_key: str | None = None) -> Job:
        """Starts a job, which holds the lease until its end.

        Where no answer comes, nothing is sent again; the exception's `idempotency_key` given here starts no other job.
        """
        self.check()
        key = idempotency_key or str(uuid4())
        headers = {**self._shown(), "Idempotency-Key": key}
        try:
            answer = self._transport.ask(op.CREATE_JOB, headers=headers, body=job)
        except OutcomeUnknownError as error:
            error.idempotency_key = key
            raise
        # Without the key, so that it is not printed with the job.
        resource, confirm_key = answer.as_(JobResource), answer.as_(JobCreated).confirm_key
        return Job(self._transport, resource, confirm_key=confirm_key, shown=self._shown())

    def move(
        self, axis: AxisName | str, position_mm: float, *, wait: bool = True, timeout_s: float = 300.0
    ) -> AxisView:
        """Moves an axis and, unless told otherwise, waits until it stands there.

        Leaving the wait, by an interrupt, a lost daemon or the time, stops the bench: `Client.reset_stop` lets it move
        again.
        """
        self.check()
        path = {"axis": _axis(axis)}
        body = MoveRequest(position_mm=_finite("position_mm", position_mm))
        return self._go(op.MOVE_AXIS, path, body, wait, timeout_s)

    def home(self, axis: AxisName | str, *, wait: bool = True, timeout_s: float = 300.0) -> AxisView:
        """Homes an axis and, unless told otherwise, waits for its end; leaving the wait stops the bench."""
        self.check()
        return self._go(op.HOME_AXIS, {"axis": _axis(axis)}, None, wait, timeout_s)

    def leave_switch(
        self, axis: AxisName | str, pressed: Side | str, *, wait: bool = True, timeout_s: float = 60.0
    ) -> AxisView:
        """Moves an axis off the limit switch that is pressed, by the end of travel where it is, 3 mm at most.

        Unless told otherwise it waits for the end; leaving the wait stops the bench.
        """
        self.check()
        body = LeaveSwitchRequest(pressed=Side(pressed))
        return self._go(op.LEAVE_SWITCH, {"axis": _axis(axis)}, body, wait, timeout_s)

    def _go(
        self, operation: op.Operation, path: dict[str, AxisName], body: object, wait: bool, timeout_s: float
    ) -> AxisView:
        def begin() -> BenchView:
            return self._transport.ask(operation, path=path, headers=self._shown(), body=body).as_(BenchView)

        return wait_for_rest(self._transport, path["axis"], begin, timeout_s if wait else None)

    def jog(
        self, axis: AxisName | str, towards: Side | str, duration_s: float, *, speed_mm_per_s: float | None = None
    ) -> AxisView:
        """Jogs an axis for so long, and says where it stands.

        The jog is asked for again and again, and ends 0.3 s after the last time at the latest, whatever happens here;
        an interrupt or any failure ends it at once.
        """
        self.check()
        name = _axis(axis)
        if speed_mm_per_s is not None:
            _finite("speed_mm_per_s", speed_mm_per_s)
        # By its name a stop ends it for good, also where it is reset before the next request.
        body = JogRequest(towards=Side(towards), speed_mm_per_s=speed_mm_per_s, press=str(uuid4()))
        until = time.monotonic() + _finite("duration_s", duration_s)
        limit = min(_JOG_ANSWER_S, self._transport.timeout_s)
        try:
            while (left := until - time.monotonic()) > 0:
                self.check()
                path = {"axis": name}
                self._transport.ask(op.JOG_AXIS, path=path, headers=self._shown(), body=body, timeout_s=limit)
                time.sleep(min(_JOG_AGAIN_S, max(left, 0.0)))
        except BaseException:
            self._end_jog_quietly(name)
            raise
        self._transport.ask(op.END_JOG, path={"axis": name}, timeout_s=limit)
        return wait_for_rest(self._transport, name, None, LONG_S)

    def _end_jog_quietly(self, name: AxisName) -> None:
        """Ends a jog where something else went wrong that is to be told."""
        # Where that fails it ends by itself, having been told no more than 0.3 s.
        with suppress(PlenalignError):
            self._transport.ask(op.END_JOG, path={"axis": name}, timeout_s=_JOG_ANSWER_S)

    def set_shell(self, state: ShellState | str) -> BenchView:
        """States whether the shell is on the camera."""
        self.check()
        body = ShellRequest(state=ShellState(state))
        return self._transport.ask(op.PUT_SHELL, headers=self._shown(), body=body).as_(BenchView)

    def set_camera(self, control: ControlName | str, value: float) -> LightView:
        """Sets the camera's exposure or gain, in the unit that `Client.light` says.

        It is set to the nearest value that the camera takes, which the answer has. A change drops the white frame: the
        next job takes one. Refused while a job runs.
        """
        self.check()
        path = {"control": ControlName(control)}
        body = ControlRequest(value=_finite("value", value))
        answer = self._transport.ask(
            op.SET_CAMERA_CONTROL, path=path, headers=self._shown(), body=body, timeout_s=LONG_S
        )
        return answer.as_(LightView)

    def auto_expose(self) -> AutoExposureView:
        """Finds the camera's exposure and gain for a white frame, in some seconds: put the diffuser on the lens first.

        Where there is too much light or too little, `ProblemError` of the kind `not-exposed` says so, and the camera is
        as it was.
        """
        self.check()
        return self._transport.ask(op.AUTO_EXPOSE, headers=self._shown(), timeout_s=_EXPOSING_S).as_(AutoExposureView)

    def renew(self) -> LeaseView:
        """Renews the lease now; the thread does it in time without being asked."""
        self.check()
        asked = time.monotonic()
        limit = min(self._transport.timeout_s, self._view.ttl_s / 3)
        view = self._transport.ask(op.RENEW_LEASE, headers=self._shown(), timeout_s=limit).as_(LeaseView)
        self._view, self._until = view, asked + view.ttl_s
        return view

    def _shown(self) -> dict[str, str]:
        return {HEADER: self._key}

    def _renew(self) -> None:
        wait = self._view.ttl_s / 3
        while not self._over.wait(wait):
            wait = self._view.ttl_s / 3
            try:
                self.renew()
            except LeaseLostError as error:
                return self._lose(error)
            except (TooManyRequestsError, UnavailableError, ConnectionError) as error:
                # It may be there again before the lease has run out.
                if time.monotonic() > self._until:
                    ttl_s = self._view.ttl_s
                    return self._lose(_lost(f"the daemon could not be reached for {ttl_s} s: {error}"))
                wait = min(wait, 0.5)
            except ProblemError as error:
                return self._lose(_lost(f"it could not be renewed: {error}"))
            except PlenalignError as error:
                return self._lose(_lost(f"it could not be renewed: {error}"))

    def _lose(self, error: LeaseLostError) -> None:
        if self._over.is_set():
            return
        self._lost = error
        if self._on_lost is not None:
            self._on_lost(error)


def _lost(detail: str) -> LeaseLostError:
    problem = {
        "type": "urn:plenalign:problem:lease-lost",
        "title": "The control lease shown is not in force",
        "status": 412,
        "detail": detail,
    }
    error = problem_error(problem)
    assert isinstance(error, LeaseLostError)  # noqa: S101
    return error


def _axis(axis: AxisName | str) -> AxisName:
    try:
        return AxisName(axis)
    except ValueError:
        raise ValueError(f"axis: {axis!r} is not one of {', '.join(each.value for each in AxisName)}") from None


def _finite(name: str, value: float) -> float:
    if not math.isfinite(value):
        raise ValueError(f"{name}: {value} is not a finite number")
    return value
