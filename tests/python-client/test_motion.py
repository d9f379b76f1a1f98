"""What moves: by hand, within limits, and not on after an interrupt."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable

import plenalign
import pytest
from plenalign.models import AxisName, CameraFaults, FaultEvent, FaultPlan, Faults, ShellState, Side, StopDelivery

from bench import Daemon, wait_for


def position(client: plenalign.Client, axis: str) -> float:
    found = next(each.position_mm for each in client.bench().axes if each.axis == axis)
    assert found is not None
    return found


def rests(client: plenalign.Client) -> bool:
    """Whether what moves comes to rest, and stays there for as long as ten frames take."""
    wait_for("nothing moves", lambda: not any(axis.moving for axis in client.bench().axes))
    before = [axis.position_mm for axis in client.bench().axes]
    for _ in range(10):
        client.images.snapshot()
    return before == [axis.position_mm for axis in client.bench().axes]


def test_a_move_is_waited_for(homed: plenalign.Client) -> None:
    with homed.lease() as lease:
        here = position(homed, "focus")
        there = here + 0.5 if here < 1.0 else here - 0.5
        view = lease.move("focus", there)
        assert view.axis is AxisName.FOCUS
        assert not view.moving
        assert view.position_mm == pytest.approx(there, abs=0.01)
        began = lease.move(AxisName.FOCUS, here, wait=False)
        assert began.position_mm is None or abs(began.position_mm - here) > 0.1
        wait_for("it is there", lambda: not homed.bench().axes[0].moving)


def test_homing(client: plenalign.Client) -> None:
    with client.lease() as lease:
        assert lease.set_shell(ShellState.OFF).shell is ShellState.OFF
        assert lease.home("focus").homed
        assert lease.home("e").homed
        lease.set_shell("on")
        wall = client.bench().e_wall_mm
        with pytest.raises(plenalign.OutOfReachError) as refused:
            lease.move("e", wall - 0.1)
        assert refused.value.kind == "wall"
        assert refused.value.members["wall_mm"] == wall
        lease.set_shell("off")


def test_a_jog_moves_and_ends(homed: plenalign.Client) -> None:
    with homed.lease() as lease:
        lease.move("focus", 0.0)
        view = lease.jog("focus", Side.HIGH, 0.6, speed_mm_per_s=0.5)
        assert view.position_mm is not None
        assert 0.1 < view.position_mm < 0.6
        assert not view.moving
        back = lease.jog("focus", "low", 0.3, speed_mm_per_s=0.5)
        assert back.position_mm is not None
        assert back.position_mm < view.position_mm


def test_beyond_the_travel_is_refused_with_its_limits(homed: plenalign.Client) -> None:
    with homed.lease() as lease, pytest.raises(plenalign.OutOfReachError) as refused:
        lease.move("focus", 900.0)
    problem = refused.value
    assert (problem.kind, problem.status) == ("limit", 409)
    assert problem.members["axis"] == "focus"
    assert problem.members["low_mm"] < problem.members["high_mm"]
    assert problem.title in str(problem)
    assert problem.detail in str(problem)
    again = pickle.loads(pickle.dumps(problem))
    assert (type(again), again.members, str(again)) == (type(problem), problem.members, str(problem))


@pytest.mark.parametrize(
    ("wrong", "word"),
    [
        (lambda lease: lease.move("zoom", 1.0), "focus, e"),
        (lambda lease: lease.move("focus", float("nan")), "finite"),
        (lambda lease: lease.jog("focus", "up", 1.0), "up"),
        (lambda lease: lease.jog("focus", "high", float("inf")), "finite"),
        (lambda lease: lease.jog("focus", "high", 1.0, speed_mm_per_s=float("nan")), "finite"),
        (lambda lease: lease.set_shell("half"), "half"),
    ],
)
def test_wrong_arguments_are_told_before_anything_is_sent(homed: plenalign.Client, wrong: object, word: str) -> None:
    before = [axis.position_mm for axis in homed.bench().axes]
    with homed.lease() as lease, pytest.raises(ValueError, match=word):
        wrong(lease)  # type: ignore[operator]
    assert before == [axis.position_mm for axis in homed.bench().axes]


def test_the_stop_needs_no_lease_and_keeps_everything_still(homed: plenalign.Client) -> None:
    with homed.lease() as lease:
        report = homed.stop()
        assert report.focus is StopDelivery.CONFIRMED
        stopped = homed.stop_state()
        assert stopped.latched
        assert "@" in (stopped.by or "")
        with pytest.raises(plenalign.StoppedError) as refused:
            lease.move("focus", 0.2)
        assert refused.value.detail
        assert not homed.reset_stop("a test goes on").latched
        lease.move("focus", 0.2)


def test_a_stop_ends_a_move_that_is_waited_for(homed: plenalign.Client) -> None:
    with homed.lease() as lease:
        lease.move("e", position(homed, "e"))
        high = homed.bench().axes[1].high_limit_mm
        target = high - 0.1 if position(homed, "e") < high - 20 else high - 30
        lease.move("e", target, wait=False)
        homed.stop()
        homed.reset_stop("a test goes on")
        assert rests(homed)
        assert abs(position(homed, "e") - target) > 0.5


# Started in the background, as a build server may start these tests, a program ignores interrupts.
INTERRUPTED = """
import signal, sys, plenalign
signal.signal(signal.SIGINT, signal.default_int_handler)
client = plenalign.Client(sys.argv[1])
with client.lease("a program that is interrupted", ttl_s=5.0) as lease:
    print("begun", flush=True)
    {what}
"""


def interrupt(
    daemon: Daemon, what: str, under_way: Callable[[], bool], how: int = signal.SIGINT
) -> subprocess.CompletedProcess[str]:
    """Runs this in a program of its own, and sends that a signal once it is under way."""
    command = [sys.executable, "-c", INTERRUPTED.format(what=what), daemon.address]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ, "PLENALIGN_TOKEN": ""}
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "begun\n"
        wait_for("it is under way", under_way)
        process.send_signal(how)
        said, wrong = process.communicate(timeout=30)
        return subprocess.CompletedProcess(command, process.returncode, said, wrong)


def test_an_interrupt_ends_a_jog(daemon: Daemon, homed: plenalign.Client) -> None:
    with homed.lease() as lease:
        lease.move("focus", 0.0)
    jog = 'lease.jog("focus", "high", 60.0, speed_mm_per_s=0.5)'
    ended = interrupt(daemon, jog, lambda: position(homed, "focus") > 0.2)
    assert "KeyboardInterrupt" in ended.stderr
    at_once = position(homed, "focus")
    assert rests(homed)
    assert 0.1 < position(homed, "focus") < 1.5
    assert position(homed, "focus") == pytest.approx(at_once, abs=0.02)
    assert not homed.stop_state().latched
    assert homed.lease_holder() is None


def test_a_killed_program_leaves_no_jog_behind(daemon: Daemon, homed: plenalign.Client) -> None:
    with homed.lease() as lease:
        lease.move("focus", 0.0)
    jog = 'lease.jog("focus", "high", 60.0, speed_mm_per_s=0.5)'
    interrupt(daemon, jog, lambda: position(homed, "focus") > 0.2, signal.SIGKILL)
    assert rests(homed)
    assert 0.1 < position(homed, "focus") < 1.5


def test_an_interrupt_of_a_move_stops_the_bench(daemon: Daemon, homed: plenalign.Client) -> None:
    with homed.lease() as lease:
        begins = lease.move("e", homed.bench().e_wall_mm + 2.0).position_mm
    assert begins is not None
    there = homed.bench().axes[1].high_limit_mm - 1.0
    ended = interrupt(daemon, f'lease.move("e", {there})', lambda: position(homed, "e") > begins + 0.5)
    assert "KeyboardInterrupt" in ended.stderr
    assert homed.stop_state().latched
    assert rests(homed)
    assert position(homed, "e") < there - 1.0


def test_a_move_that_takes_too_long_is_stopped(homed: plenalign.Client) -> None:
    with homed.lease() as lease:
        here = position(homed, "e")
        axis = homed.bench().axes[1]
        low, high = axis.low_limit_mm + 1.0, axis.high_limit_mm - 1.0
        there = high if high - here > here - low else low
        with pytest.raises(plenalign.MotionError, match="stopped") as late:
            lease.move("e", there, timeout_s=0.2)
        assert late.value.axis.axis is AxisName.E
        assert homed.stop_state().latched


def test_a_motion_that_fails_is_told(homed: plenalign.Client) -> None:
    with homed.lease() as lease:
        lease.move("focus", 0.0)
        homed.set_faults(Faults(focus=plenalign.models.AxisFaults(limit_switch=True)))
        with pytest.raises((plenalign.MotionError, plenalign.ProblemError)) as failed:
            lease.move("focus", 1.0)
        assert "focus" in str(failed.value)
        homed.set_faults()
        homed.reset_stop("a test goes on")
        lease.set_shell("off")
        lease.home("focus")


def test_faults_are_set_and_cleared(client: plenalign.Client) -> None:
    wanted = Faults(camera=CameraFaults(frozen=True), e=plenalign.models.AxisFaults(slip_share=0.25))
    client.set_faults(wanted)
    now = client.faults()
    assert (now.camera.frozen, now.e.slip_share) == (True, 0.25)  # type: ignore[union-attr]
    good = client.set_faults()
    assert (good.camera.frozen, good.e.slip_share) == (False, 0.0)  # type: ignore[union-attr]
    with pytest.raises(plenalign.InvalidError) as refused:
        client.set_faults(Faults(e=plenalign.models.AxisFaults(slip_share=7.0)))
    assert "slip_share" in str(refused.value)


def test_a_plan_of_faults_comes_into_force_and_ends(client: plenalign.Client) -> None:
    dark = Faults(camera=CameraFaults(picture=plenalign.models.PictureFault.DARK))
    late = Faults(e=plenalign.models.AxisFaults(slip_share=0.25))
    plan = FaultPlan(events=[FaultEvent(at_s=0.0, faults=dark), FaultEvent(at_s=3600.0, lasts_s=5.0, faults=late)])
    in_force = client.run_fault_plan(plan)
    assert in_force.plan is not None and in_force.elapsed_s is not None
    assert [event.at_s for event in in_force.plan.events] == [0.0, 3600.0]
    now = client.faults()
    assert now.camera.picture == plenalign.models.PictureFault.DARK  # type: ignore[union-attr]
    with pytest.raises(plenalign.InvalidError) as refused:
        client.run_fault_plan(FaultPlan(events=[FaultEvent(at_s=-1.0, faults=dark)]))
    assert "at_s" in str(refused.value)
    client.end_fault_plan()
    ended = client.fault_plan()
    assert (ended.plan, ended.elapsed_s) == (None, None)
