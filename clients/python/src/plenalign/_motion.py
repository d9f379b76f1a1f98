"""Waiting for an axis that moves, which is stopped where nobody waits any more."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress

from . import _operations as op
from ._transport import Transport
from ._user import this_user
from .errors import MotionError, NotReachedError, PlenalignError, ProblemError
from .models import AxisName, AxisView, BenchView, StopReport

_LOOK_S = 0.05
_STOP_ANSWER_S = 3.0
_STOP_TRIES = 3


def stop(transport: Transport, owner: str | None = None) -> StopReport:
    """Stops the bench, as `owner` where no token says who. Asked again where no answer comes: that moves nothing."""
    query = {"owner": owner or this_user()}
    tries = _STOP_TRIES
    while True:
        try:
            limit = min(_STOP_ANSWER_S, transport.timeout_s)
            return transport.ask(op.STOP, query=query, timeout_s=limit).as_(StopReport)
        except ConnectionError:
            tries -= 1
            if tries == 0:
                raise


def wait_for_rest(
    transport: Transport, axis: AxisName, begin: Callable[[], BenchView] | None, timeout_s: float | None
) -> AxisView:
    """Begins a motion and waits until it is over, at most so long; without a time, says only how it began."""
    begun = begin is None
    try:
        bench = begin() if begin is not None else transport.ask(op.GET_BENCH).as_(BenchView)
        begun = True
        if timeout_s is None:
            return of(bench, axis)
        deadline = time.monotonic() + timeout_s
        while (view := of(bench, axis)).moving:
            if time.monotonic() > deadline:
                raise MotionError(f"{axis.value} still moves after {timeout_s} s, and was stopped", view)
            time.sleep(_LOOK_S)
            bench = transport.ask(op.GET_BENCH).as_(BenchView)
    except PlenalignError as error:
        # What was refused, or never sent, has begun nothing.
        nothing = not begun and isinstance(error, (ProblemError, NotReachedError))
        if not nothing:
            with suppress(PlenalignError):
                stop(transport)
        raise
    except BaseException:
        with suppress(PlenalignError):
            stop(transport)
        raise
    if view.failure is not None:
        raise MotionError(f"{axis.value}: {view.failure}", view)
    return view


def of(bench: BenchView, axis: AxisName) -> AxisView:
    """One of the bench's axes."""
    return next(view for view in bench.axes if view.axis == axis)
