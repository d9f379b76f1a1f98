"""The client: what can be read, measured, stopped, and the way to what moves."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from datetime import datetime
from types import TracebackType
from typing import Any
from uuid import UUID

from . import _operations as op
from ._motion import stop
from ._transport import ANSWER_S, LONG_S, Transport
from ._user import this_user
from .access import Access
from .address import Address
from .errors import LeaseLostError, ProblemError
from .images import Images
from .job import Job
from .lease import Lease
from .models import (
    BenchView,
    DesignView,
    DevicesFound,
    DraftRequest,
    DraftView,
    FaultPlan,
    Faults,
    Health,
    HistogramView,
    JobItem,
    JobKind,
    JobList,
    JobResource,
    JobState,
    LeaseAsked,
    LeaseGrant,
    LeaseState,
    LeaseView,
    LightView,
    MeasurementAsked,
    MeasurementList,
    MeasurementView,
    PicturesRequest,
    PlanInForce,
    PlanView,
    ReadingsRequest,
    RecentView,
    ResetRequest,
    SingleMeasurement,
    StopReport,
    StopView,
)
from .settings import Settings
from .watch import Watch


class Client:
    """A Plenalign daemon.

    The arguments but `timeout_s`, the longest wait for an ordinary answer, are those of `Address`. It may be used by
    several threads, and is closed at the end of a `with` block. Nothing is sent twice but the stop, so that no failure
    of the network moves a motor again.
    """

    def __init__(
        self,
        server: str | None = None,
        *,
        token: str | None = None,
        ca: str | os.PathLike[str] | None = None,
        fingerprint: str | None = None,
        insecure: bool = False,
        timeout_s: float = ANSWER_S,
    ) -> None:
        self.address = Address(server, token=token, ca=ca, fingerprint=fingerprint, insecure=insecure)
        self._transport = Transport(self.address, timeout_s)
        self.images = Images(self._transport)
        """Frames, views and the live picture."""
        self.settings = Settings(self._transport)
        """The daemon's configuration."""
        self.access = Access(self._transport)
        """Tokens and the audit log."""

    def __repr__(self) -> str:
        """Without the token."""
        return f"Client({self.address.base!r})"

    def __enter__(self) -> Client:
        return self

    def __exit__(self, _t: type[BaseException] | None, _e: BaseException | None, _b: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Lets the connections go."""
        self._transport.close()

    # How the daemon is.

    def health(self) -> Health:
        """That the daemon answers, its version, and whether its bench is simulated."""
        return self._transport.ask(op.GET_HEALTH).as_(Health)

    def hindrances(self) -> list[str]:
        """What keeps the bench from being worked with; nothing where it is ready."""
        try:
            self._transport.ask(op.GET_READINESS)
        except ProblemError as problem:
            if problem.kind != "not-ready":
                raise
            return [str(each) for each in problem.members.get("hindrances", [problem.detail])]
        return []

    def metrics(self) -> str:
        """What the daemon counts and times, as Prometheus reads it."""
        return self._transport.ask(op.GET_METRICS).text()

    def contract(self) -> dict[str, Any]:
        """The daemon's own OpenAPI document."""
        return self._transport.ask(op.GET_OPENAPI).as_(dict[str, Any])

    def devices(self) -> DevicesFound:
        """The cameras and serial ports connected to the daemon's machine."""
        return self._transport.ask(op.GET_DEVICES, timeout_s=LONG_S).as_(DevicesFound)

    def bench(self) -> BenchView:
        """The state of the whole bench."""
        return self._transport.ask(op.GET_BENCH).as_(BenchView)

    def watch(
        self,
        *,
        pictures: PicturesRequest | None = None,
        readings: ReadingsRequest | None = None,
        reconnect_s: float = 30.0,
    ) -> Watch:
        """Everything that changes, as it changes; `Watch` says more. `plenalign.aio.watch` does so asynchronously."""
        return Watch(self.address, pictures=pictures, readings=readings, reconnect_s=reconnect_s)

    # The stop.

    def stop(self, *, owner: str | None = None) -> StopReport:
        """Stops every axis at once and latches: nothing moves until `reset_stop`. Needs no lease.

        Who did is shown to everybody: the token's name, or where there is no token `owner`, which is user and machine
        unless given.

        It is a software stop, not a safety function.
        """
        return stop(self._transport, owner)

    def stop_state(self) -> StopView:
        """Whether the stop is latched."""
        return self._transport.ask(op.GET_STOP).as_(StopView)

    def reset_stop(self, why: str, *, owner: str | None = None) -> StopView:
        """Resets the stop; nothing moves by it, and nothing goes on that was held meanwhile.

        `why` is shown to everybody, and so is who: the token's name, or where there is no token `owner`, which is user
        and machine unless given.
        """
        body = ResetRequest(why=why, owner=owner or this_user())
        return self._transport.ask(op.RESET_STOP, body=body).as_(StopView)

    # The lease, through which everything moves.

    def lease(
        self,
        owner: str | None = None,
        *,
        note: str | None = None,
        ttl_s: float | None = None,
        take_over: bool = False,
        on_lost: Callable[[LeaseLostError], None] | None = None,
    ) -> Lease:
        """Takes the control lease, for a `with` block.

        Where another has it, `LeaseHeldError` says who; `take_over` takes it all the same, for which a job under way is
        cancelled and the axes stopped. `owner` is who one is, user and machine unless given. `on_lost` is called, on
        another thread, when it is lost.
        """
        asked = LeaseAsked(owner=owner or this_user(), note=note, ttl_s=ttl_s)
        if take_over:
            grant = self._transport.ask(op.TAKE_OVER_LEASE, body=asked, timeout_s=LONG_S).as_(LeaseGrant)
        else:
            grant = self._transport.ask(op.TAKE_LEASE, body=asked).as_(LeaseGrant)
        return Lease(self._transport, grant, on_lost)

    def lease_holder(self) -> LeaseView | None:
        """Who has the control lease."""
        return self._transport.ask(op.GET_LEASE).as_(LeaseState).lease

    # Jobs and measurements.

    def jobs(
        self,
        *,
        state: Iterable[JobState | str] = (),
        kind: Iterable[JobKind | str] = (),
        since: datetime | None = None,
        until: datetime | None = None,
        text: str | None = None,
        page: int = 50,
    ) -> Iterator[JobItem]:
        """The jobs of this run of the daemon and of earlier ones, newest first.

        Only those of these states and kinds, created within these times, with these words in id, reason or log.
        """
        for moment in (since, until):
            if moment is not None and moment.tzinfo is None:
                raise ValueError(f"{moment} has no time zone: datetime(…, tzinfo=timezone.utc)")
        query = {
            "limit": page,
            "state": [JobState(each) for each in state] or None,
            "kind": [JobKind(each) for each in kind] or None,
            "since": since,
            "until": until,
            "q": text,
        }
        cursor: str | None = None
        while True:
            listed = self._transport.ask(op.LIST_JOBS, query={**query, "cursor": cursor}).as_(JobList)
            yield from listed.jobs
            cursor = listed.next
            if cursor is None:
                return

    def job(self, id: UUID | str, *, confirm_key: str | None = None) -> Job:
        """One job. `confirm_key` is what whoever started it has handed on, for what it asks to be confirmed."""
        resource = self._transport.ask(op.GET_JOB, path={"id": id}).as_(JobResource)
        return Job(self._transport, resource, confirm_key=confirm_key)

    def measurement(self) -> MeasurementView:
        """The newest measurement of the live picture or of a job; `NotFoundError` before there is one."""
        return self._transport.ask(op.GET_MEASUREMENT).as_(MeasurementView)

    def recent(self) -> RecentView:
        """The last two minutes: positions, spacings and clarity, as far as somebody looked; oldest first."""
        return self._transport.ask(op.GET_RECENT).as_(RecentView)

    def measure(self, *, settled: bool = True, max_age_ms: int | None = None) -> SingleMeasurement:
        """Measures one frame, and moves nothing.

        The frame's exposure begins after the request, or so long before it as `max_age_ms` allows. Unless `settled` is
        false, one that spans motion of an axis is refused.
        """
        asked = MeasurementAsked(settled=settled, max_age_ms=max_age_ms)
        return self._transport.ask(op.MEASURE, body=asked, timeout_s=LONG_S).as_(SingleMeasurement)

    def measurements(self, *, page: int = 100) -> Iterator[SingleMeasurement]:
        """What was measured outside jobs, newest first."""
        cursor: str | None = None
        while True:
            query = {"limit": page, "cursor": cursor}
            listed = self._transport.ask(op.LIST_MEASUREMENTS, query=query).as_(MeasurementList)
            yield from listed.measurements
            cursor = listed.next
            if cursor is None:
                return

    # The camera.

    def light(self) -> LightView:
        """The camera's exposure and gain, with limits and units; `Lease.set_camera` sets them."""
        return self._transport.ask(op.GET_CAMERA_CONTROLS).as_(LightView)

    def histogram(self, *, ranges: int | None = None) -> HistogramView:
        """How many pixels of the newest frame have which grey level, in so many ranges, 256 unless given."""
        return self._transport.ask(op.GET_HISTOGRAM, query={"ranges": ranges}, timeout_s=LONG_S).as_(HistogramView)

    # The design.

    def design(self) -> DesignView:
        """Everything that the configured design comes to."""
        return self._transport.ask(op.GET_DESIGN, timeout_s=LONG_S).as_(DesignView)

    def draft_design(self, draft: DraftRequest) -> DraftView:
        """What a camera comes to that differs from the configured one."""
        return self._transport.ask(op.DRAFT_DESIGN, body=draft, timeout_s=LONG_S).as_(DraftView)

    def plan(self, draft: DraftRequest) -> PlanView:
        """How a camera would be aligned that differs from the configured one, and what stands in the way."""
        return self._transport.ask(op.PLAN_ALIGNMENT, body=draft, timeout_s=LONG_S).as_(PlanView)

    # The simulated bench.

    def faults(self) -> Faults:
        """What goes wrong with the simulated bench at present."""
        return self._transport.ask(op.GET_FAULTS).as_(Faults)

    def set_faults(self, faults: Faults | None = None) -> Faults:
        """Has these things, and nothing else, go wrong with the simulated bench; without any, everything goes right."""
        return self._transport.ask(op.PUT_FAULTS, body=faults or Faults()).as_(Faults)

    def fault_plan(self) -> PlanInForce:
        """The plan of faults in force, and for how long it has been."""
        return self._transport.ask(op.GET_FAULT_PLAN).as_(PlanInForce)

    def run_fault_plan(self, plan: FaultPlan) -> PlanInForce:
        """Has things go wrong with the simulated bench by themselves, when the plan says so, counted from now."""
        return self._transport.ask(op.PUT_FAULT_PLAN, body=plan).as_(PlanInForce)

    def end_fault_plan(self) -> None:
        """Ends the plan of faults: everything goes right."""
        self._transport.ask(op.DELETE_FAULT_PLAN)
