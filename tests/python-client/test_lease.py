"""The lease: kept by its thread, lost with an exception, given back."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable
from datetime import timedelta

import plenalign
import pytest

from bench import Daemon, wait_for


def test_it_is_renewed_beyond_its_time_to_live(client: plenalign.Client) -> None:
    with client.lease("ada", note="long work", ttl_s=2.0) as lease:
        first = lease.view.expires_at
        assert first is not None
        twice_over = first + timedelta(seconds=4)
        wait_for("it is renewed", lambda: lease.view.expires_at and lease.view.expires_at > twice_over)
        lease.check()
        holder = client.lease_holder()
        assert holder is not None
        assert (holder.owner, holder.note, holder.id) == ("ada", "long work", lease.view.id)
        assert lease.view.expires_at is not None
        assert lease.view.expires_at > first
        assert lease.renew().owner == "ada"
    assert client.lease_holder() is None


def test_it_names_user_and_machine_unless_told_otherwise(client: plenalign.Client) -> None:
    with client.lease() as lease:
        assert "@" in lease.view.owner


def test_its_key_is_not_shown_by_accident(client: plenalign.Client) -> None:
    with client.lease("ada") as lease:
        assert lease.key not in repr(lease)
        assert "ada" in repr(lease)


def test_another_is_told_who_has_it(client: plenalign.Client) -> None:
    with client.lease("ada", note="first light"), pytest.raises(plenalign.LeaseHeldError) as refused:
        client.lease("bob")
    assert refused.value.members["owner"] == "ada"
    assert "first light" in str(refused.value.members["note"])


def test_a_wrong_request_says_what_would_be_right(client: plenalign.Client) -> None:
    with pytest.raises(plenalign.InvalidError, match="2 to 3600"):
        client.lease("ada", ttl_s=1.0)
    with pytest.raises(plenalign.InvalidError, match="owner"):
        client.lease("\n")


def test_a_takeover_is_an_exception_for_who_had_it(client: plenalign.Client) -> None:
    heard: list[plenalign.LeaseLostError] = []
    told = threading.Event()

    def on_lost(error: plenalign.LeaseLostError) -> None:
        heard.append(error)
        told.set()

    with pytest.raises(plenalign.LeaseLostError) as lost, client.lease("ada", ttl_s=2.0, on_lost=on_lost) as lease:
        with client.lease("bob", take_over=True):
            assert told.wait(5.0)
            assert lease.lost
            for use in (lease.check, lambda: lease.move("focus", 0.0), lambda: lease.jog("focus", "high", 1.0)):
                with pytest.raises(plenalign.LeaseLostError):
                    use()
            holder = client.lease_holder()
            assert holder is not None
            assert holder.owner == "bob"
    assert lost.value is heard[0]
    assert lost.value.kind == "lease-lost"


def test_what_went_wrong_in_the_block_is_what_is_raised(client: plenalign.Client) -> None:
    with pytest.raises(ZeroDivisionError), client.lease("ada", ttl_s=2.0) as lease:
        with client.lease("bob", take_over=True):
            wait_for("it is lost", lambda: lease.lost)
        raise ZeroDivisionError
    assert client.lease_holder() is None


def test_given_back_it_is_good_for_nothing(client: plenalign.Client) -> None:
    lease = client.lease("ada")
    lease.release()
    lease.release()
    assert client.lease_holder() is None
    with pytest.raises(plenalign.LeaseLostError, match="given back"):
        lease.move("focus", 0.0)


def test_no_thread_is_left_behind(client: plenalign.Client) -> None:
    before = set(threading.enumerate())
    for _ in range(5):
        with client.lease("ada"):
            assert set(threading.enumerate()) - before
    assert set(threading.enumerate()) <= before


def test_it_outlives_a_short_silence_of_the_daemon(new_daemon: Callable[..., Daemon]) -> None:
    daemon = new_daemon().start()
    with plenalign.Client(daemon.address, timeout_s=2.0) as client, client.lease("ada", ttl_s=6.0) as lease:
        before = lease.view.expires_at
        assert before is not None
        daemon.signal(signal.SIGSTOP)
        time.sleep(3.5)
        daemon.signal(signal.SIGCONT)
        wait_for("it is renewed", lambda: lease.view.expires_at and lease.view.expires_at > before)
        lease.check()


def test_a_daemon_that_is_gone_loses_it(new_daemon: Callable[..., Daemon]) -> None:
    daemon = new_daemon().start()
    with plenalign.Client(daemon.address, timeout_s=2.0) as client:
        with (
            pytest.raises(plenalign.LeaseLostError, match="could not be reached"),
            client.lease("ada", ttl_s=2.0) as lease,
        ):
            daemon.end(signal.SIGKILL)
            wait_for("it is lost", lambda: lease.lost)


def test_it_survives_the_daemons_restart(new_daemon: Callable[..., Daemon]) -> None:
    daemon = new_daemon().start()
    with plenalign.Client(daemon.address, timeout_s=2.0) as client, client.lease("ada", ttl_s=20.0) as lease:
        # The daemon does not wait for the disk.
        wait_for("it is kept", lambda: any("ada" in value for value in daemon.kept("lease")))
        daemon.end(signal.SIGKILL)
        daemon.start()
        assert lease.renew().owner == "ada"
