"""PIPython, PI's own library, against the twin, over the pseudo-terminal."""

import sys

from pipython import GCSDevice, GCSError, gcserror, pitools
from pipython.pidevice.interfaces.piserial import PISerial
from waiting import until


def wait(device, axis: str) -> None:
    until("at rest", lambda: not any(device.IsMoving(axis).values()))


def refused(call, code: int, what: str) -> None:
    try:
        call()
    except GCSError as error:
        assert error == code, f"{what}: {error}"
    else:
        raise AssertionError(f"{what} was taken")


def main(port: str) -> None:
    with PISerial(port, 115200) as gateway:
        device = GCSDevice(gateway=gateway)
        identity = device.qIDN()
        assert "Physik Instrumente" in identity and "C-863" in identity, identity
        assert device.axes == ["1", "2"], device.axes
        assert device.IsControllerReady()

        # Before homing: servo off, not referenced.
        assert not device.qFRF("1")["1"] and not device.qSVO("1")["1"]
        refused(lambda: device.MOV("1", 1.0), gcserror.E5_PI_CNTR_MOVE_WITHOUT_REF_OR_NO_SERVO, "a move unreferenced")
        device.SVO("1", True)
        device.FNL("1")
        wait(device, "1")
        assert device.qFRF("1")["1"]
        low, high = device.qTMN("1")["1"], device.qTMX("1")["1"]
        assert (low, high) == (0.0, 5.0), (low, high)

        device.VEL("1", 10.0)
        device.MOV("1", 2.5)
        assert device.IsMoving("1")["1"]
        wait(device, "1")
        assert device.qONT("1")["1"] and abs(device.qPOS("1")["1"] - 2.5) < 1e-3
        device.MVR("1", -1.0)
        wait(device, "1")
        assert abs(device.qPOS("1")["1"] - 1.5) < 1e-3

        refused(lambda: device.MOV("1", high + 0.1), gcserror.E7_PI_CNTR_POS_OUT_OF_LIMITS, "a move beyond the limit")
        refused(lambda: device.send("XYZ"), gcserror.E2_PI_CNTR_UNKNOWN_COMMAND, "an unknown command")
        refused(lambda: device.send("MOV 9 1"), gcserror.E15_PI_CNTR_INVALID_AXIS_IDENTIFIER, "an axis not there")

        # A stop in mid-move: #24, and the error it leaves behind.
        device.VEL("1", 1.0)
        device.MOV("1", 4.5)
        until("on its way", lambda: device.qPOS("1")["1"] > 1.7)
        refused(device.StopAll, gcserror.E10_PI_CNTR_STOP, "a stop without its error")
        at = device.qPOS("1")["1"]
        assert not device.IsMoving("1")["1"] and 1.6 < at < 3.5, at
        # Where it was stopped is its target from then on, however it was.
        for name, stop in {"#24": device.StopAll, "STP": device.STP, "HLT": device.HLT}.items():
            began = device.qPOS("1")["1"]
            device.MOV("1", 4.5 if began < 2.5 else 0.5)
            until("on its way", lambda: abs(device.qPOS("1")["1"] - began) > 0.1)
            refused(stop, gcserror.E10_PI_CNTR_STOP, f"{name} without its error")
            wait(device, "1")
            at, target = device.qPOS("1")["1"], device.qMOV("1")["1"]
            assert abs(at - target) < 1e-3 and device.qONT("1")["1"], f"after {name} at {at} on the way to {target}"

        # A start anew, and everything that PI's own start-up does: limits, references, servos.
        device.RBT()
        assert not any(device.qFRF().values()) and not any(device.qSVO().values())
        assert "V1.2.5.3" in device.qVER(), device.qVER()
        assert device.qSPA("1", 0x3C)["1"][0x3C] == "M-404.42S", device.qSPA("1", 0x3C)
        device.SPA("1", 0x49, 12.5)
        assert device.qVEL("1")["1"] == device.qSPA("1", 0x49)["1"][0x49] == 12.5
        refused(lambda: device.SPA("1", 0x7F, 1), gcserror.E54_PI_CNTR_UNKNOWN_PARAMETER, "a parameter not there")
        pitools.startup(device, stages=["M-404.42S", "M-404.42S"], refmodes=["FNL", "FPL"])
        assert all(device.qFRF().values()) and all(device.qSVO().values()) and all(device.qRON().values())
        pitools.moveandwait(device, "1", 2.0)
        assert device.qONT("1")["1"] and abs(device.qPOS("1")["1"] - 2.0) < 1e-3
        # An answer of several lines.
        assert set(device.qPOS()) == {"1", "2"}
    print("pipython: connected, homed, moved, stopped, started up anew, read limits, was refused rightly")


main(sys.argv[1])
