"""The camera's exposure and gain, and how its newest frame is exposed."""

from __future__ import annotations

import json
from collections.abc import Iterator

import plenalign
import pytest
from plenalign.models import CameraFaults, ControlName, ControlUnit, Faults, LightView, PictureFault

from bench import Daemon


def values(light: LightView) -> dict[ControlName, float | None]:
    return {control.name: control.value for control in light.controls}


@pytest.fixture
def plain(client: plenalign.Client) -> Iterator[plenalign.Client]:
    """A client whose camera is set as it was afterwards."""
    before = values(client.light())
    yield client
    client.set_faults()
    with client.lease("a test") as lease:
        for name, value in before.items():
            assert value is not None
            lease.set_camera(name, value)


def test_exposure_and_gain_are_read_set_and_refused(plain: plenalign.Client) -> None:
    exposure, gain = plain.light().controls
    assert (exposure.name, exposure.unit, exposure.locked) == (ControlName.EXPOSURE, ControlUnit.MS, None)
    with plain.lease("a test") as lease:
        assert values(lease.set_camera("exposure", 12.34))[ControlName.EXPOSURE] == 12.3
        assert values(lease.set_camera(ControlName.GAIN, gain.maximum))[ControlName.GAIN] == gain.maximum
        with pytest.raises(plenalign.ProblemError) as refused:
            lease.set_camera("exposure", exposure.maximum + 1.0)
        assert refused.value.kind == "control-range"
        assert refused.value.members["maximum"] == exposure.maximum
        for control, value in (("focus", 1.0), ("gain", float("nan"))):
            with pytest.raises(ValueError):
                lease.set_camera(control, value)
    with pytest.raises(plenalign.LeaseLostError):
        lease.set_camera("gain", 1.0)


def test_the_command_line_does_the_same(daemon: Daemon, plain: plenalign.Client) -> None:
    command = ("camera", "exposure", "--server", daemon.address)
    said = json.loads(daemon.run(*command, "--exposure", "5", "--gain", "2", "--histogram", "--json"))
    assert [control["value"] for control in said["controls"]] == [5.0, 2.0]
    assert sum(said["histogram"]["counts"]) == 560 * 560
    assert values(plain.light()) == {ControlName.EXPOSURE: 5.0, ControlName.GAIN: 2.0}
    assert "% of white" in daemon.run(*command, "--auto")
    assert plain.lease_holder() is None


def test_the_exposure_is_found_and_the_histogram_says_so(plain: plenalign.Client) -> None:
    with plain.lease("a test") as lease:
        lease.set_camera("exposure", plain.light().controls[0].maximum)
        found = lease.auto_expose()
        assert found.changed
        assert 0.7 <= found.bright_level <= 0.9
        assert found.clipped_share < 0.002
        plain.set_faults(Faults(camera=CameraFaults(picture=PictureFault.DARK)))
        with pytest.raises(plenalign.ProblemError) as refused:
            lease.auto_expose()
        assert refused.value.kind == "not-exposed"
        assert values(plain.light()) == {control.name: control.value for control in found.controls}
    histogram = plain.histogram(ranges=16)
    assert len(histogram.counts) == 16
    assert sum(histogram.counts) == 560 * 560
    assert histogram.bits == 8
    assert histogram.simulated
