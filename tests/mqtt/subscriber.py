"""Somebody who subscribes to all benches, and holds each message against the contract."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import paho.mqtt.client as mqtt
import yaml
from jsonschema import Draft202012Validator, FormatChecker
from paho.mqtt.properties import Properties
from paho.mqtt.subscribeoptions import SubscribeOptions
from referencing import Registry, Resource
from referencing.jsonschema import DRAFT202012

PROTO = Path(__file__).parents[2] / "proto"


def _contract() -> tuple[dict[str, Any], Registry]:
    contract = yaml.safe_load((PROTO / "asyncapi-mqtt.yaml").read_text())
    registry = Registry().with_resources(
        [
            ("asyncapi-mqtt.yaml", Resource(contract, DRAFT202012)),
            ("openapi.json", Resource(json.loads((PROTO / "openapi.json").read_text()), DRAFT202012)),
        ]
    )
    return contract, registry


CONTRACT, REGISTRY = _contract()


@dataclass(frozen=True)
class Message:
    """A message as it came."""

    kind: str
    bench: str
    part: str
    retained: bool
    payload: dict[str, Any]
    size: int


def _message_name(kind: str, part: str, payload: dict[str, Any]) -> str:
    """Name of the message within the contract."""
    if kind == "JOB":
        return {"state": "job_state"}.get(payload["event"], payload["event"])
    names = {"NBIRTH": "birth", "NDEATH": "death", "ALERT": "alert"}
    return names.get(kind) or {"focus": "axis", "e": "axis"}.get(part, part)


class Subscriber:
    """Hears everything below a prefix, from when it is made."""

    def __init__(self, port: int = 1883, prefix: str = "plenalign", **credentials: Any) -> None:
        self.messages: list[Message] = []
        self.wrong: list[str] = []
        self.schemas_seen: set[str] = set()
        self._prefix = prefix
        self._news = threading.Condition()
        self._subscribed = threading.Event()
        self._client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2, protocol=mqtt.MQTTv5)
        if credentials:
            self._client.username_pw_set(**credentials)
        self._client.on_connect = self._on_connect
        self._client.on_subscribe = lambda *_: self._subscribed.set()
        self._client.on_message = self._on_message
        self._client.reconnect_delay_set(1, 1)
        self._client.connect("127.0.0.1", port, keepalive=60, clean_start=True)
        self._client.loop_start()
        assert self._subscribed.wait(10), "the subscription is not acknowledged"

    def _on_connect(self, client: mqtt.Client, *_: Any) -> None:
        options = SubscribeOptions(qos=1, retainAsPublished=True)
        client.subscribe(f"{self._prefix}/#", options=options)

    def _on_message(self, _client: mqtt.Client, _data: Any, heard: mqtt.MQTTMessage) -> None:
        try:
            message = self._checked(heard)
        except Exception as error:
            self.wrong.append(f"{heard.topic}: {heard.payload!r}: {type(error).__name__}: {error}")
            return
        with self._news:
            self.messages.append(message)
            self._news.notify_all()

    def _checked(self, heard: mqtt.MQTTMessage) -> Message:
        group, kind, bench, *parts = heard.topic.removeprefix(f"{self._prefix}/").split("/")
        part = "/".join(parts)
        payload = json.loads(heard.payload)
        name = _message_name(kind, part, payload)
        declared = CONTRACT["components"]["messages"][name]
        where = f"asyncapi-mqtt.yaml#/components/messages/{name}/payload"
        validator = Draft202012Validator({"$ref": where}, registry=REGISTRY, format_checker=FormatChecker())
        errors = [
            f"{'/'.join(map(str, error.absolute_path))}: {error.message}" for error in validator.iter_errors(payload)
        ]
        assert not errors, errors
        binding = declared["bindings"]["mqtt"]
        assert heard.qos == binding["qos"], f"QoS {heard.qos}"
        assert heard.retain == binding["retain"], f"retain {heard.retain}"
        properties: Properties = heard.properties
        assert properties.ContentType == "application/json"
        assert properties.PayloadFormatIndicator == 1
        expiry = getattr(properties, "MessageExpiryInterval", None)
        allowed = binding.get("messageExpiryInterval")
        assert (expiry is None) == (allowed is None), f"expiry {expiry}"
        assert expiry is None or 0 < expiry <= allowed, f"expiry {expiry}"
        assert group == "hall"
        self.schemas_seen.add(name)
        return Message(kind, bench, part, bool(heard.retain), payload, len(heard.payload))

    def of(self, kind: str, part: str = "", bench: str = "wet") -> list[dict[str, Any]]:
        """Payloads of a kind so far, in order."""
        with self._news:
            return [m.payload for m in self.messages if (m.kind, m.bench) == (kind, bench) and part in ("", m.part)]

    def wait(self, what: str, condition: Callable[[], Any], allowed_s: float = 30.0) -> Any:
        """Returns what a condition comes to once that is true."""
        until = time.monotonic() + allowed_s
        with self._news:
            while not (value := condition()):
                assert not self.wrong, self.wrong
                assert time.monotonic() < until, f"{what}: not within {allowed_s} s"
                self._news.wait(0.1)
        return value

    def is_there(self, bench: str = "wet") -> bool:
        """Whether a bench is there, by the rule of the contract."""
        births, deaths = self.of("NBIRTH", bench=bench), self.of("NDEATH", bench=bench)
        return bool(births) and not (deaths and deaths[-1]["session"] == births[-1]["session"])

    def story(self, job: str, bench: str = "wet") -> list[dict[str, Any]]:
        """Events of a job, each once, in the order of their numbers."""
        events = {event["number"]: event for event in self.of("JOB", bench=bench) if event["job"] == job}
        return [events[number] for number in sorted(events)]

    def wait_story(self, job: str) -> list[dict[str, Any]]:
        """A job's whole story."""

        def whole() -> list[dict[str, Any]] | None:
            story = self.story(job)
            return story if story and story[-1]["event"] == "ended" else None

        story = self.wait("the story has its end", whole)
        assert [event["number"] for event in story] == list(range(1, len(story) + 1))
        return story

    def close(self) -> None:
        self._client.disconnect()
        self._client.loop_stop()
        assert not self.wrong, self.wrong
