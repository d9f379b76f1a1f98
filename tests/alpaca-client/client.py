"""The Alpaca facade by ASCOM's alpyca: client.py ADDRESS ALPACA all|ids|second|halt|vanish"""

import calendar
import json
import os
import subprocess
import sys
import time
import urllib.request
from datetime import UTC, datetime, timedelta

import requests
from alpaca import discovery, management
from alpaca.camera import Camera, CameraStates, ImageArrayElementTypes, SensorType
from alpaca.device import Device
from alpaca.exceptions import (
    ActionNotImplementedException,
    InvalidOperationException,
    InvalidValueException,
    NotConnectedException,
    NotImplementedException,
)
from alpaca.focuser import Focuser

ADDRESS, ALPACA, WHICH = sys.argv[1:]
SIZE = 400
# As run.sh has it: short enough to be waited for, longer than a loaded machine keeps a client from asking.
LEASE_TTL_S = 4


def rest(method, path, body=None):
    data = None if body is None else json.dumps(body).encode()
    headers = {"Authorization": f"Bearer {os.environ['PLENALIGN_TOKEN']}", "Content-Type": "application/json"}
    request = urllib.request.Request(ADDRESS + path, data, headers, method=method)
    with urllib.request.urlopen(request) as answer:
        return json.loads(answer.read() or b"null")


def lease():
    return rest("GET", "/api/v1/lease")["lease"]


def position_mm(axis):
    return rest("GET", "/api/v1/bench")["axes"][axis]["position_mm"]


def refused(error, what, *words):
    """That `what` fails so, and says these words of it."""
    try:
        found = what()
    except error as told:
        for word in words:
            assert word in str(told), told
        return
    raise AssertionError(f"it was not refused: {found!r}")


def another(which):
    """What another client, a process of its own, says. Meanwhile this one goes on asking, as a client with the lease does."""
    child = subprocess.Popen([sys.executable, __file__, ADDRESS, ALPACA, which], stdout=subprocess.PIPE, text=True)
    held = [focuser for focuser in FOCUSERS if focuser.Connected]

    def ended():
        return all(focuser.Connected for focuser in held) and child.poll() is not None

    wait(ended, f"{which!r} does not end")
    assert child.returncode == 0, f"{which!r} ended with {child.returncode}"
    return child.stdout.read()


def wait(done, what, allowed=60):
    until = time.monotonic() + allowed
    while not done():
        assert time.monotonic() < until, what
        time.sleep(0.05)


def frames(count):
    """Waits for so many frames, in which whatever moves does."""
    headers = {"Authorization": f"Bearer {os.environ['PLENALIGN_TOKEN']}"}
    for _ in range(count):
        urllib.request.urlopen(urllib.request.Request(ADDRESS + "/api/v1/snapshot.jpg", headers=headers)).close()


def connect(device):
    device.Connect()
    wait(lambda: not device.Connecting, "it does not connect")
    assert device.Connected


FOCUSERS = [Focuser(ALPACA, 0), Focuser(ALPACA, 1)]
CAMERA = Camera(ALPACA, 0)


def it_is_found_and_says_what_it_has():
    found = discovery.search_ipv4(numquery=1, timeout=2)
    assert ALPACA in found, found
    assert management.apiversions(ALPACA) == [1]
    assert "SIMULATED" in management.description(ALPACA)["ServerName"]
    devices = management.configureddevices(ALPACA)
    assert [(d["DeviceType"], d["DeviceNumber"]) for d in devices] == [("Focuser", 0), ("Focuser", 1), ("Camera", 0)]
    assert len({d["UniqueID"] for d in devices}) == 3
    for device, listed in zip([*FOCUSERS, CAMERA], devices):
        assert device.Name == listed["DeviceName"] and "SIMULATED" in device.Name, device.Name
        assert device.InterfaceVersion == 4 and device.DriverVersion.count(".") == 1
        assert "Plenalign" in device.DriverInfo[0] and len(device.Description) <= 64
    assert FOCUSERS[0].SupportedActions == ["Home"] and CAMERA.SupportedActions == []


def to_connect_takes_the_lease_and_another_is_refused():
    for focuser in FOCUSERS:
        refused(NotConnectedException, lambda: focuser.Position, "set Connected to True")
        refused(NotConnectedException, lambda: focuser.Move(10))
    assert lease() is None
    for focuser in FOCUSERS:
        connect(focuser)
    held = lease()
    assert held["owner"] == f"alpaca:{Device._client_id}", held
    said = another("second")
    assert f"InvalidOperationException: alpaca:{Device._client_id} has the control lease" in said, said
    assert lease()["id"] == held["id"]


def axes_are_homed_and_go_where_they_are_told_within_a_step():
    for axis, focuser in enumerate(FOCUSERS):
        assert focuser.Absolute and focuser.StepSize == 1.0 and not focuser.TempCompAvailable and not focuser.TempComp
        refused(NotImplementedException, lambda: focuser.Temperature)
        refused(ActionNotImplementedException, lambda: focuser.Action("Dance"))
        focuser.Action("Home")
        assert focuser.IsMoving
        wait(lambda: not focuser.IsMoving, "it does not come home")
        low = (-2.0, -5.0)[axis]
        for wanted in ((2500, 1777), (33000, 34567))[axis]:
            focuser.Move(wanted)
            assert focuser.IsMoving
            wait(lambda: not focuser.IsMoving, "it does not arrive")
            assert abs(focuser.Position - wanted) <= 1, (focuser.Position, wanted)
            assert abs(position_mm(axis) - (low + wanted / 1000)) <= 1e-3, position_mm(axis)
            states = {state["Name"]: state["Value"] for state in focuser.DeviceState}
            assert states["IsMoving"] is False and states["Position"] == focuser.Position, states


def what_is_out_of_range_is_refused():
    for focuser, greatest in zip(FOCUSERS, (7000, 37000)):
        assert focuser.MaxStep == focuser.MaxIncrement == greatest
        before = focuser.Position
        for step in (-1, greatest + 1):
            refused(InvalidValueException, lambda: focuser.Move(step), f"not within 0 to MaxStep, {greatest}")
        assert not focuser.IsMoving and focuser.Position == before
    refused(InvalidValueException, lambda: FOCUSERS[1].Move(100), "the lens could touch the shell")


def a_move_is_halted_and_stays_so():
    focuser = FOCUSERS[0]
    before = focuser.Position
    for halt in (focuser.Halt, lambda: another("halt")):
        focuser.Move(6900 if before < 4000 else 500)
        wait(lambda: abs(focuser.Position - before) > 50, "it does not begin")
        assert focuser.IsMoving
        halt()
        assert not focuser.IsMoving
        at = focuser.Position
        assert abs(at - before) > 50 and 550 < at < 6850, (before, at)
        frames(15)
        assert focuser.Position == at
        before = at
    focuser.Move(3000)
    wait(lambda: not focuser.IsMoving, "it does not go on")
    assert abs(focuser.Position - 3000) <= 1


def a_latched_stop_refuses_motion_in_plain_words():
    rest("POST", "/api/v1/stop")
    refused(InvalidOperationException, lambda: FOCUSERS[0].Move(2000), "the stop is latched; reset it first")
    rest("DELETE", "/api/v1/stop", {"why": "the client has seen it"})
    FOCUSERS[0].Move(2000)
    wait(lambda: not FOCUSERS[0].IsMoving, "it does not go")


def the_lease_is_kept_by_asking_and_given_back():
    owner = lease()["owner"]
    first = lease()["expires_at"]

    def asks():
        assert not FOCUSERS[1].IsMoving
        return datetime.now(UTC) > datetime.fromisoformat(first)

    wait(asks, "its first term does not end")
    assert lease()["owner"] == owner
    FOCUSERS[0].Connected = False
    assert lease()["owner"] == owner
    FOCUSERS[1].Disconnect()
    wait(lambda: not FOCUSERS[1].Connecting, "it does not disconnect")
    assert not FOCUSERS[1].Connected and lease() is None
    did = {"lease.take", "lease.release", "axis.home", "axis.move", "axis.halt"}
    # What is done does not wait for its record.
    record = lambda: {entry["what"] for entry in rest("GET", "/api/v1/audit")["entries"] if entry["who"] == owner}
    wait(lambda: record() == did, "something is not in the audit log", 10)


def the_lease_of_a_client_that_vanishes_runs_out():
    owner = another("vanish").strip()
    assert owner.startswith("alpaca:"), owner
    wait(lambda: lease() is None, "the lease outlives its client", 30)

    def entry(what):
        found = [
            e for e in rest("GET", "/api/v1/audit")["entries"] if e["what"] == what and e["detail"]["owner"] == owner
        ]
        assert len(found) <= 1, found
        return found and found[0]

    # What is done does not wait for its record.
    wait(lambda: entry("lease.expire"), "that it ran out is not in the audit log", 10)
    assert not entry("lease.release")
    taken, expired = (datetime.fromisoformat(entry(what)["at"]) for what in ("lease.take", "lease.expire"))
    assert expired - taken >= timedelta(seconds=LEASE_TTL_S), (taken, expired)
    connect(FOCUSERS[0])
    FOCUSERS[0].Connected = False


def the_camera_takes_a_picture_without_the_lease():
    rest("POST", "/api/v1/lease", {"owner": "somebody else"})
    refused(NotConnectedException, lambda: CAMERA.CameraXSize)
    connect(CAMERA)
    assert lease()["owner"] == "somebody else"
    assert (CAMERA.CameraXSize, CAMERA.CameraYSize, CAMERA.NumX, CAMERA.NumY) == (SIZE,) * 4
    assert CAMERA.SensorType == SensorType.Monochrome and CAMERA.MaxADU == 255 and CAMERA.ReadoutModes == ["Raw"]
    for absent in ("CCDTemperature", "Gain", "Offset", "BayerOffsetX", "CoolerOn", "ElectronsPerADU"):
        refused(NotImplementedException, lambda: getattr(CAMERA, absent))
    refused(NotImplementedException, CAMERA.StopExposure)
    refused(InvalidOperationException, lambda: CAMERA.ImageArray)
    refused(InvalidValueException, lambda: CAMERA.StartExposure(60, True), "ExposureMax")
    begun = time.time()
    CAMERA.StartExposure(CAMERA.ExposureMax, True)
    wait(lambda: CAMERA.ImageReady, "no image comes")
    assert CAMERA.CameraState == CameraStates.cameraIdle and CAMERA.LastExposureDuration > 0
    started = time.strptime(CAMERA.LastExposureStartTime[:19], "%Y-%m-%dT%H:%M:%S")
    assert begun - 1 <= calendar.timegm(started) <= time.time()
    image = CAMERA.ImageArray
    info = CAMERA.ImageArrayInfo
    assert (info.Rank, info.Dimension1, info.Dimension2) == (2, SIZE, SIZE)
    assert info.ImageElementType == ImageArrayElementTypes.Int32.value
    assert info.TransmissionElementType == ImageArrayElementTypes.Byte.value
    assert len(image) == SIZE and {len(column) for column in image} == {SIZE}
    assert max(map(max, image)) - min(map(min, image)) > 50, "the picture is of nothing"
    plain = requests.get(
        f"http://{ALPACA}/api/v1/camera/0/imagearray", params={"ClientID": Device._client_id}, timeout=30
    )
    assert plain.headers["content-type"] == "application/json"
    assert plain.json()["Value"] == [list(column) for column in image]

    (CAMERA.StartX, CAMERA.StartY, CAMERA.NumX, CAMERA.NumY) = (10, 20, 30, 40)
    CAMERA.StartExposure(0.01, True)
    wait(lambda: CAMERA.ImageReady, "no image comes")
    assert [len(column) for column in CAMERA.ImageArray] == [40] * 30
    CAMERA.NumX = SIZE
    refused(InvalidValueException, lambda: CAMERA.StartExposure(0.01, True), "StartX = 10")
    CAMERA.Connected = False
    assert not CAMERA.Connected and lease()["owner"] == "somebody else"


ALL = (
    it_is_found_and_says_what_it_has,
    to_connect_takes_the_lease_and_another_is_refused,
    axes_are_homed_and_go_where_they_are_told_within_a_step,
    what_is_out_of_range_is_refused,
    a_move_is_halted_and_stays_so,
    a_latched_stop_refuses_motion_in_plain_words,
    the_lease_is_kept_by_asking_and_given_back,
    the_lease_of_a_client_that_vanishes_runs_out,
    the_camera_takes_a_picture_without_the_lease,
)

if WHICH == "all":
    for check in ALL:
        check()
        print(f"- alpyca: {check.__name__.replace('_', ' ')}", flush=True)
elif WHICH == "ids":
    print(json.dumps(management.configureddevices(ALPACA)))
elif WHICH == "second":
    try:
        FOCUSERS[0].Connected = True
    except Exception as told:
        print(f"{type(told).__name__}: {told}")
elif WHICH == "halt":
    FOCUSERS[0].Halt()
elif WHICH == "vanish":
    connect(FOCUSERS[0])
    print(f"alpaca:{Device._client_id}")
