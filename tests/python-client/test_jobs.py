"""Jobs: started once, waited for, confirmed, cancelled, and what is kept of them."""

from __future__ import annotations

import csv
import json
import pickle
import signal
from collections.abc import Callable
from datetime import datetime, timedelta, timezone
from pathlib import Path

import plenalign
import pytest
from plenalign.models import (
    FocusSweepJob,
    FocusSweepOutcome,
    HomingJob,
    HomingOutcome,
    JobKind,
    JobResource,
    JobState,
    JointAlignmentJob,
    OperatorStep,
    SpacingWatchJob,
    SpacingWatchOutcome,
    Stage,
    StepState,
    Verdict,
)

from bench import Daemon, wait_for


def test_homing_and_what_is_kept_of_it(client: plenalign.Client, tmp_path: Path) -> None:
    seen: list[JobState] = []
    with client.lease("ada") as lease:
        lease.set_shell("off")
        job = lease.start(HomingJob(note="both"))
        ended = job.wait(on_change=lambda each: seen.append(each.state), timeout_s=120)
    assert ended.state is JobState.SUCCEEDED
    assert job.is_over
    assert seen[-1] is JobState.SUCCEEDED
    assert isinstance(ended.outcome, HomingOutcome)
    assert ended.outcome.focus_mm is not None
    assert ended.request == HomingJob(note="both")
    assert ended.owner == "ada"
    assert {move.axis for move in job.moves()} == {"focus", "e"}
    assert [line.message for line in job.log()] == [line.message for line in ended.log]
    assert job.iterations() == []
    exported = job.export()
    assert exported.job.id == job.id
    assert exported.simulated
    assert json.loads(job.save(tmp_path / "job.json").read_text())["job"]["id"] == str(job.id)
    assert "SIMULATED" in job.save(tmp_path / "job.html").read_text()
    with pytest.raises(ValueError, match=r"\.html, \.csv, \.json"):
        job.save(tmp_path / "job.pdf")
    with pytest.raises(OSError):
        job.save(tmp_path / "nowhere" / "job.json")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["job.html", "job.json"]
    assert client.job(job.id).resource == client.job(str(job.id)).resource


def test_a_watch_of_the_spacing(homed: plenalign.Client, tmp_path: Path) -> None:
    with homed.lease() as lease:
        job = lease.start(SpacingWatchJob(duration_s=2.0, interval_s=0.5))
        ended = job.wait(timeout_s=120)
    assert isinstance(ended.outcome, SpacingWatchOutcome)
    assert ended.outcome.measured == len(job.iterations()) == len(job.measurements())
    newest = job.measurements()[-1]
    assert homed.measurement().frame_seq == newest.frame_seq
    recent = homed.recent()
    assert [then.at for then in recent.clarities][-1] == newest.captured_at <= recent.now
    assert recent.spacings
    assert recent.positions[-1].focus_mm == pytest.approx(newest.focus_mm)
    lines = [line for line in job.save(tmp_path / "watch.csv").read_text().splitlines() if not line.startswith("#")]
    assert len(list(csv.DictReader(lines))) == ended.outcome.measured


def test_a_sweep_is_cancelled(homed: plenalign.Client) -> None:
    with homed.lease() as lease:
        job = lease.start(FocusSweepJob(axis=plenalign.models.AxisName.FOCUS, from_mm=-0.5, to_mm=0.5, steps=100))
        wait_for("it measures", lambda: job.refresh().iterations or job.is_over)
        assert job.cancel().state in (JobState.CANCELLING, JobState.CANCELLED)
        with pytest.raises(plenalign.JobEndedError) as ended:
            job.wait(timeout_s=60)
        assert ended.value.job.state is JobState.CANCELLED
        assert job.cancel().state is JobState.CANCELLED
        again = pickle.loads(pickle.dumps(ended.value))
        assert (again.job, str(again)) == (ended.value.job, str(ended.value))


def test_a_sweep_comes_to_an_outcome(homed: plenalign.Client) -> None:
    with homed.lease() as lease:
        sweep = FocusSweepJob(axis=plenalign.models.AxisName.FOCUS, from_mm=0.0, to_mm=0.4, steps=3)
        ended = lease.start(sweep).wait(timeout_s=120, check=False)
    assert ended.state in plenalign.GOOD, ended.reason
    assert isinstance(ended.outcome, FocusSweepOutcome)
    assert ended.outcome.positions == 3


def test_a_bench_does_one_job_at_a_time(homed: plenalign.Client) -> None:
    with homed.lease() as lease:
        job = lease.start(SpacingWatchJob(duration_s=60.0))
        with pytest.raises(plenalign.BusyError) as refused:
            lease.start(HomingJob())
        assert refused.value.members["job"] == str(job.id)
        with pytest.raises(plenalign.BusyError):
            lease.move("focus", 0.0)
        with pytest.raises(plenalign.JobNotOverError, match="not over after"):
            job.wait(timeout_s=0.5)
        assert job.refresh().state not in plenalign.FINAL
        job.cancel()
        job.wait(check=False, timeout_s=30)


def test_the_same_key_is_the_same_job(homed: plenalign.Client) -> None:
    with homed.lease() as lease:
        watch = SpacingWatchJob(duration_s=1.0)
        first = lease.start(watch, idempotency_key="once")
        second = lease.start(watch, idempotency_key="once")
        assert first.id == second.id
        with pytest.raises(plenalign.InvalidError) as refused:
            lease.start(HomingJob(), idempotency_key="once")
        assert refused.value.kind == "idempotency-key-reused"
        first.wait(timeout_s=60)
        other = lease.start(watch)
        assert other.id != first.id
        other.wait(timeout_s=60)


def test_a_wrong_request_names_its_field(homed: plenalign.Client) -> None:
    with homed.lease() as lease, pytest.raises(plenalign.InvalidError) as refused:
        lease.start(SpacingWatchJob(duration_s=0.0))
    assert refused.value.members["field"] == "duration_s"
    assert "1 to 86400" in refused.value.detail


def test_an_exception_on_the_way_cancels_the_job(homed: plenalign.Client) -> None:
    def fail(_job: JobResource) -> None:
        raise ZeroDivisionError

    with homed.lease() as lease:
        job = lease.start(SpacingWatchJob(duration_s=60.0))
        with pytest.raises(ZeroDivisionError):
            job.wait(on_change=fail)
        assert job.wait(check=False, timeout_s=30).state is JobState.CANCELLED


def test_the_history_is_searched(homed: plenalign.Client) -> None:
    start = datetime.now(timezone.utc)
    with homed.lease() as lease:
        ids = [lease.start(SpacingWatchJob(duration_s=1.0)).wait(timeout_s=60).id for _ in range(3)]
    assert [job.id for job in homed.jobs(since=start, page=1)] == ids[::-1]
    kinds = {job.kind for job in homed.jobs(kind=[JobKind.SPACING_WATCH], state=["succeeded"])}
    assert kinds == {JobKind.SPACING_WATCH}
    assert [job.id for job in homed.jobs(text=str(ids[1]))] == [ids[1]]
    assert list(homed.jobs(since=start + timedelta(days=1))) == []
    assert list(homed.jobs(until=start - timedelta(days=1))) == []
    with pytest.raises(ValueError, match="time zone"):
        list(homed.jobs(since=datetime(2026, 1, 1)))
    with pytest.raises(ValueError, match="paused"):
        list(homed.jobs(state=["paused"]))


def test_an_operator_is_asked(new_daemon: Callable[..., Daemon], tmp_path: Path) -> None:
    daemon = new_daemon(simulation="operator_confirms = false").start()
    asked: list[OperatorStep] = []
    again: list[OperatorStep] = []

    def on_step(step: OperatorStep) -> bool:
        if step.repeatable and not again:
            # The white frame once more, in place of putting up the board.
            again.append(step)
            job.repeat(step.repeatable[0])
            return False
        asked.append(step)
        return True

    with plenalign.Client(daemon.address) as client, client.lease("ada") as lease:
        job = lease.start(JointAlignmentJob())
        # As long as homing takes on a busy machine.
        wait_for("it asks", lambda: client.job(job.id).state is JobState.WAITING_FOR_OPERATOR)
        with pytest.raises(plenalign.JobNotOverError, match="waits for"):
            job.wait(timeout_s=0.5)
        assert job.state is JobState.WAITING_FOR_OPERATOR
        first = job.resource.operator_step
        assert first is not None
        with pytest.raises(plenalign.ProblemError) as refused:
            job.confirm(first.number + 7)
        assert refused.value.kind == "job-state"
        # Who has neither its key nor its lease confirms nothing; with the key handed on, and no other, one does.
        other = client.job(job.id)
        with pytest.raises(plenalign.ConfirmKeyError) as keyless:
            other.confirm(first)
        assert keyless.value.kind == "confirm-key-required"
        assert job.confirm_key is not None
        lost = job.confirm_key
        handed = client.job(job.id, confirm_key=job.renew_confirm_key())
        with pytest.raises(plenalign.ConfirmKeyError):
            client.job(job.id, confirm_key=lost).confirm(first)
        handed.confirm(first)
        asked.append(first)
        ended = job.wait(on_step=on_step, timeout_s=240)
        assert ended.state is JobState.CONVERGED
        assert asked[0] == first
        numbers = [step.number for step in asked]
        assert numbers == sorted(set(numbers))
        assert len(numbers) >= 3
        assert all(step.instruction for step in asked)
        report = ended.report
        assert report is not None
        assert report.delta_v_mm is not None
        assert report.delta_v_sigma_mm is not None
        assert abs(report.delta_v_mm - report.delta_v_target_mm) < 3 * report.delta_v_sigma_mm
        assert report.delta_v_air_mm is not None
        assert abs(report.delta_v_air_mm - report.delta_v_air_target_mm) < 0.1
        assert report.budget is not None
        assert report.budget.in_focus is Verdict.WITHIN
        assert report.e_mm is not None
        assert report.e_tolerance is not None
        assert report.e_tolerance.low_mm is not None
        assert report.e_tolerance.high_mm is not None
        assert {each.stage for each in ended.iterations} == {Stage.AIR, Stage.SHELL}
        exported = job.export()
        assert again[0].repeatable == [first.number]
        assert [step.number for step in exported.operator_steps] == sorted([*numbers, again[0].number])
        assert all(step.confirmed_at or step.number == again[0].number for step in exported.operator_steps)
        assert [step.repeats for step in exported.operator_steps[:3]] == [None, None, first.number]
        assert isinstance(ended.steps, list)
        assert [step.state for step in ended.steps][:3] == [StepState.DONE, StepState.REPEATED, StepState.REPEATED]
        assert {picture.name for picture in exported.pictures} == {"before", "after"}
        with pytest.raises(plenalign.ProblemError):
            job.confirm(numbers[-1])
        page = job.save(tmp_path / "report.html").read_text()
        assert "SIMULATED" in page
        assert str(job.id) in page


def test_a_daemon_that_dies_interrupts_its_job(new_daemon: Callable[..., Daemon]) -> None:
    daemon = new_daemon().start()
    with plenalign.Client(daemon.address) as client:
        lease = client.lease("ada", ttl_s=60.0)
        job = lease.start(SpacingWatchJob(duration_s=300.0))
        wait_for("it measures", lambda: job.refresh().iterations)
        daemon.end(signal.SIGKILL)
        with pytest.raises(plenalign.NotReachedError, match="plenalign serve"):
            job.wait(patience_s=1.0)
        daemon.start()
        with pytest.raises(plenalign.JobEndedError) as ended:
            job.wait(patience_s=30.0)
        assert ended.value.job.state is JobState.INTERRUPTED
        assert client.job(job.id).state is JobState.INTERRUPTED
        lease.release()
