"""What can go wrong, each with what would be right."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

if TYPE_CHECKING:
    from .models import AxisView, JobSnapshot

__all__ = [
    "AddressError",
    "BusyError",
    "ConfigChangedError",
    "ConfirmKeyError",
    "ConnectionLostError",
    "ForbiddenError",
    "InvalidError",
    "JobEndedError",
    "JobNotOverError",
    "LeaseHeldError",
    "LeaseLostError",
    "MotionError",
    "NotFoundError",
    "NotReachedError",
    "OutOfReachError",
    "OutcomeUnknownError",
    "PlenalignError",
    "ProblemError",
    "StoppedError",
    "TooManyRequestsError",
    "UnauthorisedError",
    "UnavailableError",
    "UnexpectedAnswerError",
]

PREFIX = "urn:plenalign:problem:"


class PlenalignError(Exception):
    """Anything that this package raises of its own."""


class AddressError(PlenalignError, ValueError):
    """The server's address, token, authority or fingerprint cannot be used."""


class NotReachedError(PlenalignError, ConnectionError):
    """No connection could be made: nothing was asked, and nothing has happened."""


class ConnectionLostError(PlenalignError, ConnectionError):
    """A connection broke, or an answer was late, while something was only read or watched."""


class OutcomeUnknownError(PlenalignError, ConnectionError):
    """A command was sent and no answer came: it may have been obeyed. Look at the bench before repeating it."""

    idempotency_key: str | None = None
    """For a job: started with this key again, it is the same job and not another."""


class UnexpectedAnswerError(PlenalignError):
    """What answers is no Plenalign, or not a version that this package understands."""


class ProblemError(PlenalignError):
    """The daemon refused: what was wrong, and what would be right (RFC 9457)."""

    kinds: ClassVar[tuple[str, ...]] = ()
    """The kinds of problem that a subclass stands for."""

    def __init__(self, problem: dict[str, Any], retry_after_s: float | None = None) -> None:
        self.type: str = str(problem.get("type", "about:blank"))
        """What kind of problem, as a URN."""
        self.kind = self.type.removeprefix(PREFIX)
        """The kind's short name, such as `limit`."""
        self.title: str = str(problem.get("title", "The daemon refused"))
        """The kind in words."""
        self.status: int = int(problem.get("status", 0))
        """The HTTP status."""
        self.detail: str = str(problem.get("detail", ""))
        """What was wrong here, and what would be right."""
        standard = ("type", "title", "status", "detail")
        self.members: dict[str, Any] = {name: value for name, value in problem.items() if name not in standard}
        """What the kind has beside these, such as `low_mm` and `high_mm` of a limit."""
        self.retry_after_s = retry_after_s
        """When it makes sense to try again, s; none where the daemon does not say."""
        more = "".join(f"; {each['key']}: {each['message']}" for each in self._problems())
        field = self.members.get("field")
        where = f"{field}: " if isinstance(field, str) and field not in self.detail else ""
        super().__init__(f"{self.title}: {where}{self.detail}{more}" if self.detail else self.title)

    def _problems(self) -> list[dict[str, Any]]:
        """What is wrong with a configuration or a design, key by key."""
        listed = self.members.get("problems")
        if not isinstance(listed, list):
            return []
        return [each for each in listed if isinstance(each, dict) and "key" in each and "message" in each]

    def __reduce__(self) -> tuple[type[ProblemError], tuple[dict[str, Any], float | None]]:
        """So that it can be handed from one process to another."""
        problem = {"type": self.type, "title": self.title, "status": self.status, "detail": self.detail}
        return type(self), ({**problem, **self.members}, self.retry_after_s)


class UnauthorisedError(ProblemError):
    """The token is missing, wrong, revoked or expired; `members["ended"]` is how and when one ended that was good."""

    kinds = ("unauthorised",)


class ForbiddenError(ProblemError):
    """The token is good, and its scope too small; or the daemon refuses this to everybody."""

    kinds = ("scope", "config-locked", "cross-origin", "untrusted-proxy")


class NotFoundError(ProblemError):
    """Nothing has this name."""

    kinds = ("not-found", "no-measurement")


class InvalidError(ProblemError):
    """The request does not say what it must; `members["field"]` is where."""

    kinds = ("invalid", "malformed", "config-invalid", "idempotency-key-reused")


class StoppedError(ProblemError):
    """The stop is latched: nothing moves until it is reset; or it has ended a jog, which its reset does not resume."""

    kinds = ("stopped", "press-ended")


class ConfirmKeyError(ProblemError):
    """What a job asks is confirmed with its confirm key or its lease; neither was shown, or a wrong one."""

    kinds = ("confirm-key-required", "confirm-key-wrong")


class BusyError(ProblemError):
    """A job holds the bench, or an axis moves."""

    kinds = ("busy", "moving")


class LeaseHeldError(ProblemError):
    """Another has the control lease; `members["owner"]` is who."""

    kinds = ("lease-held",)


class LeaseLostError(ProblemError):
    """The control lease is no longer in force: it ran out, or another has taken over."""

    kinds = ("lease-lost", "lease-required")


class OutOfReachError(ProblemError):
    """The move would go beyond the axis's travel, the e wall, the greatest step or speed."""

    kinds = (
        "limit",
        "wall",
        "step",
        "speed",
        "not-homed",
        "homing-towards-shell",
        "contradiction",
        "switch-pressed",
        "leaving-towards-shell",
    )


class ConfigChangedError(ProblemError):
    """The configuration file has changed since it was read."""

    kinds = ("config-changed",)


class TooManyRequestsError(ProblemError):
    """More requests than the daemon allows; `retry_after_s` is when to go on."""

    kinds = ("too-many-requests",)


class UnavailableError(ProblemError):
    """Something that the daemon needs is not there just now: a device, a frame, the disk."""


class MotionError(PlenalignError):
    """A motion by hand did not end as commanded."""

    def __init__(self, detail: str, axis: AxisView) -> None:
        self.axis = axis
        """The axis as it stands."""
        super().__init__(detail)

    def __reduce__(self) -> tuple[type[MotionError], tuple[str, AxisView]]:
        """So that it can be handed from one process to another."""
        return type(self), (str(self), self.axis)


class JobNotOverError(PlenalignError, TimeoutError):
    """A job was not over when the time was; it goes on."""


class JobEndedError(PlenalignError):
    """A job ended otherwise than was wanted: it failed, did not converge, was cancelled or interrupted."""

    def __init__(self, job: JobSnapshot) -> None:
        self.job = job
        """The job as it ended."""
        super().__init__(f"the job {job.id} is {job.state.value}: {job.reason or 'no reason is given'}")

    def __reduce__(self) -> tuple[type[JobEndedError], tuple[JobSnapshot]]:
        """So that it can be handed from one process to another."""
        return type(self), (self.job,)


_KINDS = {kind: of for of in ProblemError.__subclasses__() for kind in of.kinds}


def problem_error(problem: dict[str, Any], retry_after_s: float | None = None) -> ProblemError:
    """The exception that a problem is."""
    kind = str(problem.get("type", "")).removeprefix(PREFIX)
    of = _KINDS.get(kind)
    if of is None:
        of = UnavailableError if problem.get("status") == 503 else ProblemError
    return of(problem, retry_after_s)
