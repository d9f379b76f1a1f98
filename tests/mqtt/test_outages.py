"""Brokers that come and go, and daemons that do."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from functools import partial

from broker import Broker
from daemon import Daemon, wait_for
from subscriber import Subscriber


def test_a_broker_that_dies_is_found_again_and_told_all_that_it_missed(
    new_broker: Callable[..., Broker], new_daemon: Callable[..., Daemon], new_subscriber: Callable[..., Subscriber]
) -> None:
    # No broker at the start is nothing unusual.
    daemon = new_daemon().start()
    wait_for("a failure", lambda: daemon.metric('plenalign_mqtt_failures_total{reason="unreachable"}'))
    assert not daemon.is_connected()
    broker = new_broker().start()
    daemon.wait_connected()
    watching = new_subscriber()
    first = watching.wait("a birth", lambda: watching.of("NBIRTH"))[-1]
    broker.kill()
    daemon.wait_connected(connected=False)
    # The bench is none the worse for it.
    daemon.ask("/readyz")
    job = daemon.run_job(kind="homing")
    assert job["state"] == "succeeded"
    wait_for("events wait", lambda: daemon.metric("plenalign_mqtt_waiting_events"))
    broker.start()
    births = watching.wait("another birth", lambda: watching.of("NBIRTH")[1:])
    assert births[-1]["session"] != first["session"] and births[-1]["boot_id"] == first["boot_id"]
    # Who was away for a moment may miss what is not retained; a subscriber whom the broker knows does not.
    daemon.wait_connected()
    told = len(job["log"]) + 3
    published = 'plenalign_mqtt_published_total{kind="event"}'
    wait_for("the broker has all of it", lambda: daemon.metric(published) >= told)
    assert daemon.metric("plenalign_mqtt_waiting_events") == 0
    assert watching.is_there()
    watching.wait("the state anew", lambda: [a for a in watching.of("ALERT") if a["session"] == births[-1]["session"]])


def test_events_of_an_outage_reach_a_subscriber_in_order(
    broker: Broker,
    new_daemon: Callable[..., Daemon],
    new_subscriber: Callable[..., Subscriber],
    frozen: Callable[..., None],
) -> None:
    daemon, watching = new_daemon().start(), new_subscriber()
    daemon.wait_connected()
    # A broker that stands still takes connections and answers nothing.
    frozen(broker)
    job = daemon.start_job(kind="homing")
    asked = time.monotonic()
    daemon.ask("/api/v1/stop", {}, method="POST")
    assert time.monotonic() - asked < 1.0
    wait_for("the job's end", lambda: daemon.job(job["id"])["ended_at"])
    daemon.wait_connected(connected=False)
    assert daemon.metric('plenalign_mqtt_failures_total{reason="timeout"}') >= 1
    broker.signal(signal.SIGCONT)
    story = watching.wait_story(job["id"])
    assert (story[0]["event"], story[-1]["state"]) == ("started", "cancelled")
    watching.wait("it is there", watching.is_there)


def test_a_daemon_that_is_killed_leaves_its_last_will(
    broker: Broker, new_daemon: Callable[..., Daemon], new_subscriber: Callable[..., Subscriber]
) -> None:
    daemon, watching = new_daemon().start(), new_subscriber()
    birth = watching.wait("a birth", lambda: watching.of("NBIRTH"))[-1]
    daemon.kill()
    death = watching.wait("a death", lambda: watching.of("NDEATH"))[-1]
    assert (death["session"], death["reason"]) == (birth["session"], "the connection was lost")
    late = new_subscriber()
    late.wait("what is retained", lambda: late.of("NBIRTH") and late.of("NDEATH"))
    assert not late.is_there()
    daemon.start()
    for subscriber in (watching, late, new_subscriber()):
        subscriber.wait("the bench is there again", subscriber.is_there)


def test_an_old_will_cannot_end_a_new_birth(
    broker: Broker,
    new_daemon: Callable[..., Daemon],
    new_subscriber: Callable[..., Subscriber],
    frozen: Callable[..., None],
) -> None:
    watching = new_subscriber()
    address = 'broker = "mqtt://127.0.0.1:1883"\nclient_id = "{}"'
    old = new_daemon(address.format("old")).start()
    first = watching.wait("a birth", lambda: watching.of("NBIRTH"))[-1]
    # It falls silent; the broker takes a while to see that, and another has come by then.
    frozen(old)
    new_daemon(address.format("new")).start()
    second = watching.wait("another birth", lambda: watching.of("NBIRTH")[1:])[-1]
    death = watching.wait("the old one's will", lambda: watching.of("NDEATH"))[-1]
    assert death["session"] == first["session"] != second["session"]
    for subscriber in (watching, new_subscriber()):
        subscriber.wait("the old one's death", partial(subscriber.of, "NDEATH"))
        subscriber.wait("the bench is there", subscriber.is_there)
    old.signal(signal.SIGCONT)
    old.kill()


def test_an_orderly_end_says_so_and_comes_last(
    broker: Broker, new_daemon: Callable[..., Daemon], new_subscriber: Callable[..., Subscriber]
) -> None:
    daemon, watching = new_daemon().start(), new_subscriber()
    birth = watching.wait("a birth", lambda: watching.of("NBIRTH"))[-1]
    job = daemon.start_job(kind="joint_alignment")
    watching.wait("the job runs", lambda: len(watching.story(job["id"])) > 3)
    assert daemon.end() < 5.0
    deaths = watching.wait("a death", lambda: watching.of("NDEATH"))
    assert (deaths[-1]["session"], deaths[-1]["reason"]) == (birth["session"], "the program ended")
    story = watching.wait_story(job["id"])
    assert (story[-1]["state"], story[-1]["reason"]) == ("cancelled", "the program ended")
    time.sleep(0.5)
    assert len(watching.of("NDEATH")) == 1, "the will was published, too"
    assert watching.messages[-1].kind == "NDEATH"
    assert not watching.is_there()
    assert "were still to be published" not in daemon.log()


def test_the_end_does_not_wait_for_a_broker_that_stands_still(
    broker: Broker, new_daemon: Callable[..., Daemon], frozen: Callable[..., None]
) -> None:
    daemon = new_daemon().start()
    daemon.wait_connected()
    frozen(broker)
    daemon.start_job(kind="homing")
    assert daemon.end() < 5.0
    assert "did not answer in time" in daemon.log()
    assert "were still to be published" in daemon.log()
