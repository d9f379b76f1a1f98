"""What is published, as the contract has it."""

from __future__ import annotations

from collections.abc import Callable

from broker import Broker
from daemon import Daemon, wait_for
from subscriber import CONTRACT, Subscriber

ALERTS = CONTRACT["components"]["messages"]["alert"]["payload"]["allOf"][1]["properties"]["alert"]["enum"]


def test_who_subscribes_late_knows_all_that_holds(
    broker: Broker, new_daemon: Callable[..., Daemon], new_subscriber: Callable[..., Subscriber]
) -> None:
    daemon = new_daemon().start()
    daemon.wait_connected()
    late = new_subscriber()
    late.wait(
        "everything retained", lambda: late.is_there() and late.of("DDATA", "state") and len(late.of("ALERT")) >= 6
    )
    birth, health = late.of("NBIRTH")[-1], daemon.ask("/healthz")
    assert (birth["version"], birth["boot_id"], birth["simulated"]) == (health["version"], health["boot_id"], True)
    assert (birth["group"], birth["name"], birth["seq"]) == ("hall", "wet", 0)
    assert not late.of("NDEATH")
    assert sorted(alert["alert"] for alert in late.of("ALERT")) == sorted(ALERTS)
    assert not any(alert["active"] for alert in late.of("ALERT"))
    state = late.of("DDATA", "state")[-1]["state"]
    assert state["ready"] and not state["stop"]["latched"] and state["camera"]["online"]
    # What goes wrong is told, and what is mended.
    daemon.ask("/api/v1/stop", {}, method="POST")

    def latched() -> list[bool]:
        return [alert["active"] for alert in late.of("ALERT", "stop_latched")]

    late.wait("the stop's alert", lambda: latched()[-1])
    late.wait("the stop in the state", lambda: late.of("DDATA", "state")[-1]["state"]["stop"]["latched"])
    daemon.ask("/api/v1/stop", {"why": "it was told"}, method="DELETE")
    late.wait("the alert's end", lambda: not latched()[-1])
    key = daemon.lease()
    late.wait("the lease", lambda: (late.of("DDATA", "state")[-1]["state"]["lease"] or {}).get("owner") == "ada")
    faults = daemon.ask("/api/v1/simulation/faults")
    unplugged = {**faults, "camera": {**faults["camera"], "unplugged": True}}
    daemon.ask("/api/v1/simulation/faults", unplugged, key, "PUT")
    alert = late.wait("the camera's alert", lambda: [a for a in late.of("ALERT", "camera_offline") if a["active"]])
    assert alert[-1]["detail"]
    late.wait("not ready", lambda: not late.of("DDATA", "state")[-1]["state"]["ready"])


def test_a_jobs_whole_story_arrives_in_order(
    broker: Broker, new_daemon: Callable[..., Daemon], new_subscriber: Callable[..., Subscriber]
) -> None:
    daemon, watching = new_daemon().start(), new_subscriber()
    daemon.wait_connected()
    job = daemon.run_job(kind="joint_alignment", note="a test")
    story = watching.wait_story(job["id"])
    assert [event["event"] for event in story[:2]] == ["started", "state"]
    assert (story[0]["owner"], story[0]["request"]) == (job["owner"], job["request"])

    def told(event: str) -> list[dict[str, object]]:
        return [said for said in story if said["event"] == event]

    assert [said["iteration"] for said in told("iteration")] == job["iterations"]
    assert job["iterations"]
    assert [(said["at"], said["message"]) for said in told("log")] == [
        (line["at"], line["message"]) for line in job["log"]
    ]
    assert "running" in [said["state"] for said in told("state")]
    ended = story[-1]
    assert (ended["state"], ended["reason"], ended["report"]) == (job["state"], job["reason"], job["report"])
    assert ended["iterations"] == len(job["iterations"])
    # None was lost on the way: every message has the next number. What was said and said anew before the subscriber came it
    # cannot have heard.
    first, session = story[0]["seq"], watching.of("NBIRTH")[-1]["session"]
    heard = (m.payload["seq"] for m in watching.messages if m.payload["session"] == session)
    numbers = sorted(seq for seq in heard if seq >= first)
    assert numbers == list(range(first, first + len(numbers)))
    assert watching.of("DDATA", "measurement")
    assert watching.of("DDATA", "focus") and watching.of("DDATA", "e")
    # The broker hands an event on before it tells the daemon that it has it.
    published = 'plenalign_mqtt_published_total{kind="event"}'
    wait_for("the broker has said so of all", lambda: daemon.metric(published) >= len(story))
    assert daemon.metric(published) == len(story)
    assert daemon.metric("plenalign_mqtt_waiting_events") == 0
    # A job that is no alignment has an outcome.
    watch = daemon.run_job(kind="spacing_watch", duration_s=2.0)
    ended = watching.wait_story(watch["id"])[-1]
    assert ended["outcome"] == watch["outcome"] and ended["report"] is None
    seen = {"birth", "state", "measurement", "axis", "alert", "started", "job_state", "log", "iteration", "ended"}
    assert watching.schemas_seen == seen


def test_what_the_operator_is_asked_is_told(
    broker: Broker, new_daemon: Callable[..., Daemon], new_subscriber: Callable[..., Subscriber]
) -> None:
    daemon, watching = new_daemon(simulation="operator_confirms = false").start(), new_subscriber()
    daemon.wait_connected()
    job = daemon.start_job(kind="joint_alignment")

    def asked() -> list[dict[str, object]]:
        return [event for event in watching.story(job["id"]) if event["event"] == "operator_step"]

    step = watching.wait("a question", asked)[-1]["operator_step"]
    assert step == daemon.job(job["id"])["operator_step"]
    states = [event["state"] for event in watching.story(job["id"]) if event["event"] == "state"]
    assert "waiting_for_operator" in states


def test_two_benches_at_one_broker_are_told_apart(
    broker: Broker, new_daemon: Callable[..., Daemon], new_subscriber: Callable[..., Subscriber]
) -> None:
    watching = new_subscriber()
    wet, dry = new_daemon().start(), new_daemon(bench="dry").start()
    watching.wait("both", lambda: watching.is_there("wet") and watching.is_there("dry"))
    job = dry.run_job(kind="homing")
    watching.wait(
        "the job's end",
        lambda: watching.story(job["id"], "dry")[-1:] and watching.story(job["id"], "dry")[-1]["event"] == "ended",
    )
    assert not watching.story(job["id"], "wet")
    # A third with the name of one that is there takes its place, and the log says what is wrong.
    twin = new_daemon(bench="dry").start()
    watching.wait("a twin", lambda: len({birth["boot_id"] for birth in watching.of("NBIRTH", bench="dry")}) == 2)
    watching.wait("a word of it", lambda: "mqtt.client_id" in dry.log())
    # Mosquitto 2.0.11 says no more than that.
    lost = [dry.metric(f'plenalign_mqtt_failures_total{{reason="{why}"}}') for why in ("taken_over", "lost")]
    assert sum(lost) >= 1
    twin.kill()
    assert wet.is_connected()
