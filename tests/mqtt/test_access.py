"""Who is let in, and whom the daemon believes."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from broker import Broker, hash_passwords
from daemon import Daemon, wait_for
from subscriber import Subscriber

TLS = 'broker = "mqtts://127.0.0.1:8883"'


class Authority:
    """An authority that vouches for certificates, made by OpenSSL."""

    def __init__(self, folder: Path, name: str) -> None:
        self.folder, self.name = folder, name
        self.certificate, key = folder / f"{name}.pem", folder / f"{name}.key"
        self._openssl("req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "2",
                      "-subj", f"/CN={name}", "-keyout", key, "-out", self.certificate)  # fmt: skip

    def vouch(self, name: str, alternative: str) -> tuple[Path, Path]:
        """Certificate and key of somebody."""
        certificate, key, asked = (self.folder / f"{self.name}-{name}.{end}" for end in ("pem", "key", "csr"))
        extension = self.folder / f"{self.name}-{name}.ext"
        extension.write_text(f"subjectAltName={alternative}\nbasicConstraints=CA:FALSE\n")
        self._openssl("req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-subj", f"/CN={name}",
                      "-keyout", key, "-out", asked)  # fmt: skip
        self._openssl("x509", "-req", "-in", asked, "-CA", self.certificate, "-CAkey", self.folder / f"{self.name}.key",
                      "-CAcreateserial", "-days", "2", "-extfile", extension, "-out", certificate)  # fmt: skip
        return certificate, key

    @staticmethod
    def _openssl(*arguments: object) -> None:
        done = subprocess.run(["openssl", *map(str, arguments)], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr


def _says(daemon: Daemon, words: str) -> bool:
    return words in daemon.log()


def _listener(authority: Authority, name: str = "broker", alternative: str = "IP:127.0.0.1", more: str = "") -> str:
    certificate, key = authority.vouch(name, alternative)
    return f"allow_anonymous true\ncafile {authority.certificate}\ncertfile {certificate}\nkeyfile {key}\n{more}"


def test_only_a_broker_that_the_own_authority_vouches_for_is_believed(
    tmp_path: Path, new_broker: Callable[..., Broker], new_daemon: Callable[..., Daemon]
) -> None:
    good, other = Authority(tmp_path, "good"), Authority(tmp_path, "other")
    new_broker(port=8883, settings=_listener(good)).start()
    new_broker(port=8884, settings=_listener(good, "elsewhere", "DNS:elsewhere.lab")).start()
    new_broker(port=1883).start()
    believing = new_daemon(TLS, tls=f'[mqtt.tls]\nca = "{good.certificate}"').start()
    believing.wait_connected()
    for broker, authority, words in [
        (TLS, other, "mqtt.tls.ca"),
        ('broker = "mqtts://127.0.0.1:8884"', good, "the name, or the address, that mqtt.broker has"),
        ('broker = "mqtts://127.0.0.1:1883"', good, "TLS"),
    ]:
        doubting = new_daemon(broker, tls=f'[mqtt.tls]\nca = "{authority.certificate}"').start()
        wait_for("a word of it", partial(_says, doubting, words))
        assert not doubting.is_connected()
        if authority is other or "8884" in broker:
            assert doubting.metric('plenalign_mqtt_failures_total{reason="tls"}') >= 1
        doubting.kill()


def test_a_broker_that_wants_a_certificate_is_shown_one(
    tmp_path: Path, new_broker: Callable[..., Broker], new_daemon: Callable[..., Daemon]
) -> None:
    authority = Authority(tmp_path, "good")
    new_broker(port=8883, settings=_listener(authority, more="require_certificate true\n")).start()
    certificate, key = authority.vouch("wet", "DNS:wet")
    shown = f'[mqtt.tls]\nca = "{authority.certificate}"\n'
    without = new_daemon(TLS, tls=shown).start()
    wait_for("a failure", lambda: "no connection to the MQTT broker" in without.log())
    assert not without.is_connected()
    without.kill()
    new_daemon(TLS, tls=f'{shown}certificate = "{certificate}"\nkey = "{key}"').start().wait_connected()


def test_a_wrong_password_is_explained_and_mended_without_a_new_start(
    tmp_path: Path, new_broker: Callable[..., Broker], new_daemon: Callable[..., Daemon]
) -> None:
    passwords, secret = tmp_path / "passwords", tmp_path / "secret"
    passwords.write_text("ada:right and long\n")
    hash_passwords(passwords)
    new_broker(settings=f"password_file {passwords}").start()
    secret.write_text("wrong and long\n")
    daemon = new_daemon(f'broker = "mqtt://127.0.0.1:1883"\nuser = "ada"\npassword_file = "{secret}"').start()
    wait_for("a word of it", lambda: "user name or password is wrong" in daemon.log())
    assert daemon.metric('plenalign_mqtt_failures_total{reason="refused"}') >= 1
    secret.write_text("right and long\n")
    daemon.wait_connected()
    config = daemon.ask("/api/v1/config")
    for text in (str(config), daemon.log()):
        assert "and long" not in text and str(secret) not in text
    nobody = new_daemon(bench="dry").start()
    wait_for("a word of it", lambda: "lets in nobody without a user name" in nobody.log())


def test_what_a_broker_refuses_is_counted_and_does_not_come_back(
    tmp_path: Path,
    new_broker: Callable[..., Broker],
    new_daemon: Callable[..., Daemon],
    new_subscriber: Callable[..., Subscriber],
) -> None:
    allowed = tmp_path / "acl"
    allowed.write_text("".join(f"topic readwrite plenalign/hall/{kind}/#\n" for kind in ("NBIRTH", "NDEATH", "DDATA")))
    new_broker(settings=f"allow_anonymous true\nacl_file {allowed}").start()
    daemon = new_daemon().start()
    daemon.wait_connected()
    job = daemon.run_job(kind="homing")
    refused = wait_for("refusals", lambda: daemon.metric('plenalign_mqtt_dropped_total{reason="refused"}'))
    # Six alerts, and the job's events.
    assert refused >= 6
    wait_for("all of them", lambda: daemon.metric("plenalign_mqtt_waiting_events") == 0)
    assert "the MQTT broker refuses a message" in daemon.log()
    assert daemon.is_connected() and job["state"] == "succeeded"


def test_with_the_documented_access_list_a_bench_writes_its_own_topics_alone(
    tmp_path: Path,
    new_broker: Callable[..., Broker],
    new_daemon: Callable[..., Daemon],
    new_subscriber: Callable[..., Subscriber],
) -> None:
    documented = (Path(__file__).parents[2] / "docs/mqtt.md").read_text().split("```text\n")[1].split("```")[0]
    (tmp_path / "acl").write_text(documented)
    passwords, secret = tmp_path / "passwords", tmp_path / "secret"
    passwords.write_text("wet:long secret\nada:long secret\n")
    hash_passwords(passwords)
    secret.write_text("long secret\n")
    new_broker(settings=f"password_file {passwords}\nacl_file {tmp_path / 'acl'}").start()
    access = f'broker = "mqtt://127.0.0.1:1883"\nuser = "wet"\npassword_file = "{secret}"'
    own, other = new_daemon(access).start(), new_daemon(access, bench="dry").start()
    watching = new_subscriber(username="ada", password="long secret")
    own.wait_connected()
    job = own.run_job(kind="homing")
    assert watching.wait_story(job["id"])
    watching.wait(
        "everything", lambda: watching.is_there() and len(watching.of("ALERT")) >= 6 and watching.of("DDATA", "focus")
    )
    assert own.metric('plenalign_mqtt_dropped_total{reason="refused"}') == 0
    assert not other.is_connected()
    assert not [message for message in watching.messages if message.bench == "dry"]


def test_what_is_longer_than_the_broker_takes_is_left_out(
    new_broker: Callable[..., Broker], new_daemon: Callable[..., Daemon], new_subscriber: Callable[..., Subscriber]
) -> None:
    broker = new_broker().start()
    daemon, watching = new_daemon().start(), new_subscriber()
    daemon.wait_connected()
    daemon.run_job(kind="homing")
    watching.wait("the birth", watching.is_there)
    birth = max(message.size for message in watching.messages if message.kind == "NBIRTH")
    broker.kill()
    daemon.wait_connected(connected=False)
    limited = new_broker(settings=f"allow_anonymous true\nmax_packet_size {birth - 100}").start()
    wait_for("it is counted", lambda: daemon.metric('plenalign_mqtt_dropped_total{reason="too_long"}'))
    assert "longer than the MQTT broker takes" in daemon.log()
    # Without its birth the bench is not there, and says so; everything else goes on.
    assert not daemon.is_connected()
    late = new_subscriber()
    late.wait("the state", lambda: late.of("DDATA", "state"))
    assert not late.is_there()
    limited.kill()


@pytest.mark.parametrize(
    ("mqtt", "tls", "words"),
    [
        ('broker = "mqtt://broker.lab"\nuser = "ada"\npassword_file = "{secret}"', "", "use mqtts://"),
        ('broker = "mqtt://127.0.0.1"\nuser = "ada"\npassword_file = "/nonexistent"', "", "mqtt.password_file"),
        (TLS, '[mqtt.tls]\nca = "/nonexistent.pem"', "mqtt.tls.ca"),
        ('broker = "127.0.0.1:1883"', "", "mqtts://broker.lab:8883"),
    ],
)
def test_what_cannot_be_is_said_at_the_start(
    tmp_path: Path, new_daemon: Callable[..., Daemon], mqtt: str, tls: str, words: str
) -> None:
    (tmp_path / "secret").write_text("a secret\n")
    said = new_daemon(mqtt.format(secret=tmp_path / "secret"), tls=tls).refuses_to_start()
    assert words in said and "a secret" not in said
