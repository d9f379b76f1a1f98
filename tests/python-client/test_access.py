"""Tokens, scopes, the audit log, the configuration, TLS."""

from __future__ import annotations

import hashlib
import ssl
import urllib.request
from collections.abc import Callable
from datetime import datetime, timedelta, timezone

import plenalign
import pytest
from plenalign.configuration import (
    AssemblyConfig,
    AxisConfig,
    BenchConfig,
    CameraConfig,
    Config,
    SensorConfig,
    SimulationConfig,
)
from plenalign.models import Scope

from bench import Daemon, wait_for


def test_a_stranger_is_told_what_is_missing(guarded: Daemon) -> None:
    with plenalign.Client(guarded.address) as stranger:
        assert stranger.health().status == "ok"
        with pytest.raises(plenalign.UnauthorisedError) as refused:
            stranger.bench()
        assert refused.value.status == 401
    with (
        plenalign.Client(guarded.address, token="plenalign_wrong") as wrong,
        pytest.raises(plenalign.UnauthorisedError),
    ):
        wrong.bench()


def test_the_environment_has_the_token(guarded: Daemon, monkeypatch: pytest.MonkeyPatch) -> None:
    assert guarded.token is not None
    monkeypatch.setenv("PLENALIGN_TOKEN", guarded.token + "\n")
    monkeypatch.setenv("PLENALIGN_SERVER", guarded.address + "/")
    with plenalign.Client() as client:
        who = client.access.who_am_i()
        assert (who.name, who.scope, who.demanded) == ("tests", Scope.ADMIN, True)
        for shown in (repr(client), repr(client.address), str(vars(client))):
            assert guarded.token not in shown


def test_tokens_are_made_and_revoked(guarded: Daemon, admin: plenalign.Client) -> None:
    ends = datetime.now(timezone.utc) + timedelta(days=1)
    made = admin.access.create_token("Ana", Scope.VIEW, expires_at=ends)
    assert made.expires_at is not None
    assert abs(made.expires_at - ends) < timedelta(milliseconds=1)
    assert made.id in {token.id for token in admin.access.tokens()}
    with plenalign.Client(guarded.address, token=made.secret) as viewer:
        viewer.bench()
        with pytest.raises(plenalign.ForbiddenError) as refused:
            viewer.lease("Ana")
        assert refused.value.status == 403
        with pytest.raises(plenalign.ForbiddenError):
            next(viewer.access.audit())
        # Who may look may stop.
        viewer.stop()
        admin.reset_stop("a test goes on")
        with pytest.raises(plenalign.ProblemError) as taken:
            admin.access.create_token("Ana", "view")
        assert taken.value.kind == "taken"
        admin.access.revoke_token(made.id)
        with pytest.raises(plenalign.UnauthorisedError) as ended:
            viewer.bench()
        told = ended.value.members["ended"]
        assert (told["how"], told["name"]) == ("revoked", "Ana")
    with pytest.raises(plenalign.NotFoundError):
        admin.access.revoke_token(made)
    with pytest.raises(ValueError, match="time zone"):
        admin.access.create_token("Bob", "view", expires_at=datetime(2027, 1, 1))


def test_the_audit_log_says_who(admin: plenalign.Client) -> None:
    with admin.lease("auditor", note="for the log"):
        pass
    # It is answered before it is on the disk.
    wait_for("it is kept", lambda: next(admin.access.audit(page=1)).what == "lease.release")
    found = [entry for entry, _ in zip(admin.access.audit(page=2), range(20), strict=False)]
    assert [entry.what for entry in found[:2]] == ["lease.release", "lease.take"]
    assert found[1].who == "tests"
    assert found[1].from_ == "127.0.0.1"
    assert found[1].detail["note"] == "for the log"
    assert found[0].at >= found[1].at


def test_a_ticket_opens_a_path_once(guarded: Daemon, admin: plenalign.Client) -> None:
    ticket = admin.access.ticket("/api/v1/stop")
    with urllib.request.urlopen(guarded.address + ticket.href, timeout=10) as answer:
        assert b"latched" in answer.read()
    with pytest.raises(urllib.error.HTTPError):
        urllib.request.urlopen(guarded.address + ticket.href, timeout=10)
    with pytest.raises(plenalign.InvalidError):
        admin.access.ticket("/etc/passwd")


def small(**simulation: object) -> Config:
    quick = AxisConfig(speed_mm_per_s=20.0, acceleration_mm_per_s2=200.0)
    return Config(
        sensor=SensorConfig(width_px=560, height_px=560),
        bench=BenchConfig(
            focus=quick,
            e=quick,
            camera=CameraConfig(timeout_ms=10000),
            simulation=SimulationConfig(rays=4, **simulation),  # type: ignore[arg-type]
        ),
    )


def test_the_configuration_is_written_and_comes_into_force(new_daemon: Callable[..., Daemon]) -> None:
    daemon = new_daemon()
    daemon.config.write_text(daemon.config.read_text().replace("requests_per_s = 100000", "").replace("[server]", ""))
    daemon.start()
    with plenalign.Client(daemon.address) as client:
        first = client.settings.read()
        assert first.view.file == str(daemon.config)
        assert first.view.config["sensor"]["width_px"] == 560
        assert client.settings.check(small(seed=5)).valid
        written = client.settings.write(small(seed=5), first)
        assert written.changed == ["bench.simulation.seed"]
        assert written.restart_required
        # Whoever read before does not overwrite it.
        with pytest.raises(plenalign.ConfigChangedError) as changed:
            client.settings.write(small(seed=6), first)
        assert changed.value.members["etag"] == client.settings.read().etag
        daemon.end()
        daemon.start()
        assert client.settings.read().view.config["bench"]["simulation"]["seed"] == 5


def test_a_wrong_configuration_is_told_key_by_key(client: plenalign.Client) -> None:
    wrong = Config(assembly=AssemblyConfig(e_tolerance_mm=-1.0))
    check = client.settings.check(wrong)
    assert not check.valid
    assert [problem.key for problem in check.problems] == ["assembly.e_tolerance_mm"]
    with pytest.raises(plenalign.InvalidError) as refused:
        client.settings.write(wrong, client.settings.read())
    assert "assembly.e_tolerance_mm" in str(refused.value)
    unknown = client.settings.check({"sensr": {}})
    assert not unknown.valid


def test_tls(new_daemon: Callable[..., Daemon]) -> None:
    daemon = new_daemon()
    daemon.run("tls", "init", "localhost", "127.0.0.1")
    folder = daemon.folder / "state" / "tls"
    certificate = next(path for path in folder.glob("*.pem") if "ca" not in path.stem)
    key = next(path for path in folder.glob("*.key") if "ca" not in path.stem)
    text = daemon.config.read_text().replace(
        "[sensor]", f'[server.tls]\ncertificate = "{certificate}"\nkey = "{key}"\n[sensor]'
    )
    daemon.config.write_text(text)
    token = daemon.create_token("tests", "admin")
    daemon.start()
    assert daemon.address.startswith("https://")
    end = "-----END CERTIFICATE-----"
    der = ssl.PEM_cert_to_DER_cert(certificate.read_text().split(end)[0] + end + "\n")
    fingerprint = hashlib.sha256(der).hexdigest()
    with plenalign.Client(daemon.address, token=token, ca=folder / "ca.pem") as client:
        assert client.bench().simulated
        with client.watch() as watch:
            assert isinstance(next(watch), plenalign.models.SnapshotMessage)
    colons = ":".join(fingerprint[i : i + 2] for i in range(0, 64, 2)).upper()
    with plenalign.Client(daemon.address, token=token, fingerprint=colons) as client:
        assert client.access.who_am_i().name == "tests"
        with client.watch() as watch:
            assert isinstance(next(watch), plenalign.models.SnapshotMessage)
    other = "0" * 64
    for given in (None, other):
        with plenalign.Client(daemon.address, token=token, fingerprint=given) as client:
            with pytest.raises(plenalign.NotReachedError, match="not vouched for"):
                client.health()
            with pytest.raises(plenalign.NotReachedError):
                client.watch().__enter__()
    plain = daemon.address.replace("https", "http")
    with plenalign.Client(plain) as client:
        with pytest.raises(plenalign.UnexpectedAnswerError, match="https://"):
            client.health()
        with pytest.raises(plenalign.ProblemError) as refused:
            client.stop()
        assert refused.value.kind == "tls-required"
