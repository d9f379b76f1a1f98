"""A job: what it does, what it asks of the operator, and what is kept of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TypeAlias
from uuid import UUID

from . import _operations as op
from ._files import Path_, write
from ._transport import LONG_S, Transport
from ._user import this_user
from .errors import (
    ConnectionLostError,
    JobEndedError,
    JobNotOverError,
    NotReachedError,
    PlenalignError,
    ProblemError,
    TooManyRequestsError,
    UnavailableError,
)
from .models import (
    ConfirmKeyGrant,
    ConfirmRequest,
    Iteration,
    JobExport,
    JobIterations,
    JobLog,
    JobMeasurements,
    JobMoves,
    JobResource,
    JobState,
    LogLine,
    MeasurementView,
    Move,
    OperatorStep,
    RepeatRequest,
)

CONFIRM_HEADER = "Plenalign-Confirm"
GOOD = frozenset({JobState.CONVERGED, JobState.SUCCEEDED})
"""Where a job ends that did what was wanted."""
FINAL = GOOD | {JobState.NOT_CONVERGED, JobState.CANCELLED, JobState.FAILED, JobState.INTERRUPTED}
"""Where a job ends."""

OnChange: TypeAlias = Callable[[JobResource], None]
OnStep: TypeAlias = Callable[[OperatorStep], "bool | None"]


class Job:
    """A job of this run of the daemon or of an earlier one."""

    def __init__(
        self,
        transport: Transport,
        resource: JobResource,
        *,
        confirm_key: str | None = None,
        shown: Mapping[str, str] | None = None,
    ) -> None:
        self._transport = transport
        self._resource = resource
        self._confirm_key = confirm_key
        # The lease of whoever started it here.
        self._lease_shown = dict(shown or {})

    def __repr__(self) -> str:
        """Which, and how it was when it was last looked at."""
        return f"Job({self.id}, {self._resource.kind.value}, {self._resource.state.value})"

    @property
    def id(self) -> UUID:
        """Its id."""
        return self._resource.id

    @property
    def resource(self) -> JobResource:
        """The job as it was when it was last looked at."""
        return self._resource

    @property
    def state(self) -> JobState:
        """Where it was in its life when it was last looked at."""
        return self._resource.state

    @property
    def confirm_key(self) -> str | None:
        """What confirms what it asks, and does nothing else, until it is over: to be handed on, or kept from others.

        Known where the job was started here, handed on by `Client.job`, or made by `renew_confirm_key`.
        """
        return self._confirm_key

    @property
    def is_over(self) -> bool:
        """Whether it was over when it was last looked at."""
        return self.state in FINAL

    def refresh(self) -> JobResource:
        """Looks at the job anew."""
        self._resource = self._transport.ask(op.GET_JOB, path=self._path).as_(JobResource)
        return self._resource

    def confirm(self, step: OperatorStep | int | None = None) -> JobResource:
        """Confirms that the operator has done what the job asks: this step, or the one that was last seen.

        It takes the job's confirm key, or the lease that it was started with; `ConfirmKeyError` without.
        """
        step = self._resource.operator_step if step is None else step
        if step is None:
            raise ValueError(f"the job {self.id} asked nothing of the operator when it was last looked at")
        body = ConfirmRequest(step=step if isinstance(step, int) else step.number)
        return self._answer(op.CONFIRM_STEP, body)

    def repeat(self, step: int) -> JobResource:
        """Asks for an earlier step again, in place of confirming the one that the job waits for.

        It is one of `repeatable` of that one: the job asks for it, measures anew what depends on it, and goes on.
        It takes what `confirm` takes.
        """
        return self._answer(op.REPEAT_STEP, RepeatRequest(step=step))

    def _answer(self, operation: op.Operation, body: ConfirmRequest | RepeatRequest) -> JobResource:
        shown = dict(self._lease_shown)
        if self._confirm_key is not None:
            shown[CONFIRM_HEADER] = self._confirm_key
        answer = self._transport.ask(operation, path=self._path, headers=shown, body=body)
        self._resource = answer.as_(JobResource)
        return self._resource

    def renew_confirm_key(self) -> str:
        """Makes another confirm key, where one is lost; the one before is dead, and the job goes on.

        For administrators, and for whoever started the job here.
        """
        answer = self._transport.ask(op.RENEW_CONFIRM_KEY, path=self._path, headers=self._lease_shown)
        self._confirm_key = answer.as_(ConfirmKeyGrant).confirm_key
        return self._confirm_key

    def cancel(self, *, owner: str | None = None) -> JobResource:
        """Cancels the job, which returns at once: `wait` for its end. May be repeated.

        Who did is shown to everybody: the token's name, or where there is no token `owner`, which is user and machine
        unless given.
        """
        query = {"owner": owner or this_user()}
        self._resource = self._transport.ask(op.CANCEL_JOB, path=self._path, query=query).as_(JobResource)
        return self._resource

    def wait(
        self,
        *,
        on_step: OnStep | None = None,
        on_change: OnChange | None = None,
        timeout_s: float | None = None,
        patience_s: float = 30.0,
        poll_s: float = 0.25,
        check: bool = True,
        cancel_on_interrupt: bool = True,
    ) -> JobResource:
        """Waits for the job's end and gives the job.

        `on_step` is called once for each thing that the job asks of the operator; where it returns true, that is
        confirmed, and otherwise somebody else has to, on the page for example. `on_change` is called with every new
        state. A daemon that cannot be reached is asked again for `patience_s`. Unless `check` is false, a job that did
        not do what was wanted raises `JobEndedError`. An interrupt, or a failure of one of the two calls, cancels the
        job, unless `cancel_on_interrupt` is false.
        """
        try:
            return self._wait(on_step, on_change, timeout_s, patience_s, max(poll_s, 0.02), check)
        except PlenalignError:
            raise
        except BaseException:
            if cancel_on_interrupt and not self.is_over:
                with suppress(PlenalignError):
                    self.cancel()
            raise

    def _wait(
        self,
        on_step: OnStep | None,
        on_change: OnChange | None,
        timeout_s: float | None,
        patience_s: float,
        poll_s: float,
        check: bool,
    ) -> JobResource:
        started = heard = time.monotonic()
        generation = -1
        asked: set[int] = set()
        while True:
            pause = poll_s
            try:
                resource = self.refresh()
            except (NotReachedError, ConnectionLostError, TooManyRequestsError, UnavailableError) as error:
                if time.monotonic() - heard > patience_s:
                    raise
                pause = max(poll_s, getattr(error, "retry_after_s", None) or 0.0)
            else:
                if resource.generation != generation:
                    generation = resource.generation
                    if on_change is not None:
                        on_change(resource)
                if resource.state in FINAL:
                    if check and resource.state not in GOOD:
                        raise JobEndedError(resource)
                    return resource
                step = resource.operator_step
                waits = resource.state is JobState.WAITING_FOR_OPERATOR
                if waits and step is not None and step.number not in asked and on_step is not None:
                    asked.add(step.number)
                    if on_step(step):
                        self._confirm_once(step)
                heard = time.monotonic()
            if timeout_s is not None and time.monotonic() - started > timeout_s:
                waiting = self._resource.operator_step
                why = f"it waits for: {waiting.instruction}" if waiting else self._resource.progress.doing
                raise JobNotOverError(f"the job {self.id} is not over after {timeout_s} s; {why}")
            time.sleep(pause)

    def _confirm_once(self, step: OperatorStep) -> None:
        """Confirms a step, unless somebody else has done so meanwhile."""
        try:
            self.confirm(step)
        except ProblemError as error:
            if error.kind != "job-state":
                raise

    def iterations(self) -> list[Iteration]:
        """Where the axes were, what was measured, what was decided."""
        return self._transport.ask(op.GET_JOB_ITERATIONS, path=self._path).as_(JobIterations).iterations

    def log(self) -> list[LogLine]:
        """What it logged."""
        return self._transport.ask(op.GET_JOB_LOG, path=self._path).as_(JobLog).lines

    def measurements(self) -> list[MeasurementView]:
        """What it measured."""
        return self._transport.ask(op.GET_JOB_MEASUREMENTS, path=self._path).as_(JobMeasurements).measurements

    def moves(self) -> list[Move]:
        """What it moved."""
        return self._transport.ask(op.GET_JOB_MOVES, path=self._path).as_(JobMoves).moves

    def export(self) -> JobExport:
        """Everything that is kept of it."""
        return self._transport.ask(op.EXPORT_JOB_JSON, path=self._path, timeout_s=LONG_S).as_(JobExport)

    def save(self, path: Path_) -> Path:
        """Downloads the report to print (`.html`), the iterations (`.csv`), everything (`.json`), or the recording.

        A recording (`.mcap`) is there where one was made.
        """
        target = Path(path)
        kinds = {
            ".html": op.GET_JOB_REPORT,
            ".csv": op.EXPORT_JOB_CSV,
            ".json": op.EXPORT_JOB_JSON,
            ".mcap": op.GET_JOB_RECORDING,
        }
        operation = kinds.get(target.suffix.lower())
        if operation is None:
            raise ValueError(f"{target.name!r} ends in none of {', '.join(kinds)}")
        write(target, self._transport.ask(operation, path=self._path, timeout_s=LONG_S).body)
        return target

    @property
    def _path(self) -> dict[str, object]:
        return {"id": self.id}
