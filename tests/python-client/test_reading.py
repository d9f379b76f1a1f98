"""What can be read, and that nothing of it is lost on the way."""

from __future__ import annotations

from typing import Any, cast

import msgspec
import plenalign
import pytest
from plenalign import configuration, models
from plenalign.models import AxisName, DraftRequest, Faults

from bench import Daemon, wait_for


def test_health_and_readiness(client: plenalign.Client) -> None:
    health = client.health()
    assert health.status == "ok"
    assert health.simulated
    assert client.hindrances() == []


def test_hindrances_are_named(client: plenalign.Client) -> None:
    client.set_faults(Faults(camera=models.CameraFaults(unplugged=True)))
    hindrances = wait_for("a hindrance", client.hindrances)
    assert any("camera" in each for each in hindrances), hindrances
    client.set_faults()


def test_the_bench(client: plenalign.Client) -> None:
    bench = client.bench()
    assert [axis.axis for axis in bench.axes] == [AxisName.FOCUS, AxisName.E]
    assert bench.simulated
    assert bench.stop.latched is False


def test_metrics_and_devices(client: plenalign.Client) -> None:
    assert "plenalign_" in client.metrics()
    assert isinstance(client.devices().serial_ports, list)


def test_the_design_and_a_draft(client: plenalign.Client) -> None:
    design = client.design()
    drafted = client.draft_design(DraftRequest(shell=configuration.ShellConfig(outer_radius_mm=70.0)))
    assert design.joint.delta_v_mm != drafted.design.joint.delta_v_mm
    assert {state.state for state in drafted.states} == set(models.DraftStateName)
    assert client.draft_design(DraftRequest()).design.joint == design.joint
    plan = client.plan(DraftRequest())
    assert plan.possible and plan.obstacles == [] and plan.delta_v_mm == design.joint.delta_v_mm
    assert next(step.name for step in plan.operator_steps) == "white_frame"


def test_an_impossible_draft_says_what_is_wrong(client: plenalign.Client) -> None:
    with pytest.raises(plenalign.ProblemError) as refused:
        client.draft_design(DraftRequest(shell=configuration.ShellConfig(inner_radius_mm=90.0, outer_radius_mm=70.0)))
    assert refused.value.kind == "design-impossible"
    assert "shell.outer_radius_mm" in str(refused.value) or "shell.inner_radius_mm" in str(refused.value)


def wait_kept(client: plenalign.Client, measured: models.SingleMeasurement) -> models.SingleMeasurement:
    """The newest measurement once it is this one."""

    def newest() -> models.SingleMeasurement | None:
        found = next(client.measurements(page=1), None)
        return found if found is not None and found.frame_seq == measured.frame_seq else None

    return cast(models.SingleMeasurement, wait_for("it is kept", newest))


def test_a_measurement_of_one_frame(measurable: plenalign.Client) -> None:
    measured = measurable.measure()
    assert measured.simulated
    assert not measured.spans_motion
    assert measured.spacing.spacing_px > 0
    # It is answered before it is on the disk.
    assert wait_kept(measurable, measured) == measured


def test_pages_are_followed(measurable: plenalign.Client) -> None:
    for _ in range(3):
        measured = measurable.measure()
    wait_kept(measurable, measured)
    in_pages = [each.frame_seq for each, _ in zip(measurable.measurements(page=1), range(3), strict=False)]
    at_once = [each.frame_seq for each, _ in zip(measurable.measurements(page=500), range(3), strict=False)]
    assert in_pages == at_once


def test_the_schema_of_the_configuration(client: plenalign.Client) -> None:
    assert "bench" in client.settings.schema()["properties"]


READ = {
    "/healthz": models.Health,
    "/api/v1/bench": models.BenchView,
    "/api/v1/config": models.ConfigView,
    "/api/v1/design": models.DesignView,
    "/api/v1/devices": models.DevicesFound,
    "/api/v1/jobs": models.JobList,
    "/api/v1/lease": models.LeaseState,
    "/api/v1/measurements": models.MeasurementList,
    "/api/v1/session": models.SessionView,
    "/api/v1/simulation/faults": models.Faults,
    "/api/v1/stop": models.StopView,
    "/api/v1/view?lenses=true": models.ViewReport,
    "/api/v1/jobs/{id}": models.JobResource,
    "/api/v1/jobs/{id}/iterations": models.JobIterations,
    "/api/v1/jobs/{id}/log": models.JobLog,
    "/api/v1/jobs/{id}/measurements": models.JobMeasurements,
    "/api/v1/jobs/{id}/moves": models.JobMoves,
    "/api/v1/jobs/{id}/export.json": models.JobExport,
}


def lost(sent: Any, kept: Any, where: str = "") -> list[str]:
    """What the daemon sent and the structure does not have; that something is null may be left out."""
    if isinstance(sent, dict) and isinstance(kept, dict):
        return [
            each
            for key, value in sent.items()
            for each in (
                lost(value, kept[key], f"{where}.{key}")
                if key in kept
                else ([] if value is None else [f"{where}.{key}"])
            )
        ]
    if isinstance(sent, list) and isinstance(kept, list) and len(sent) == len(kept):
        return [each for pair in zip(sent, kept, strict=True) for each in lost(*pair, f"{where}[]")]
    if isinstance(sent, str) and isinstance(kept, str) and sent.endswith("Z"):
        # Moments: the daemon has nanoseconds, Python microseconds.
        return [] if sent[:19] == kept[:19] else [f"{where}: {sent} became {kept}"]
    return [] if sent == kept else [f"{where}: {sent} became {kept}"]


@pytest.mark.parametrize("path", READ)
def test_nothing_that_is_sent_is_lost(path: str, daemon: Daemon, homed: plenalign.Client) -> None:
    newest = next(homed.jobs(kind=["homing"]))
    sent = daemon.raw(path.format(id=newest.id))
    kept = msgspec.to_builtins(msgspec.convert(sent, READ[path]))
    # What stands at its default is not written again.
    assert lost(sent, kept) == []


def test_a_field_that_is_not_known_is_ignored() -> None:
    assert msgspec.json.decode(b'{"latched": true, "more": 1}', type=models.StopView).latched


def test_numbers_that_are_none_are_not_sent(client: plenalign.Client) -> None:
    with pytest.raises(ValueError, match="finite"):
        client.draft_design(DraftRequest(shell=configuration.ShellConfig(outer_radius_mm=float("nan"))))


def test_a_wrong_path_is_not_found(client: plenalign.Client) -> None:
    with pytest.raises(plenalign.NotFoundError) as refused:
        client.job("0199f0f2-5d2a-7c3e-9a53-5f0f6c1f6a11")
    assert refused.value.status == 404
    assert refused.value.detail
    with pytest.raises(plenalign.ProblemError):
        client.job("../stop")
    assert client.stop_state().latched is False
