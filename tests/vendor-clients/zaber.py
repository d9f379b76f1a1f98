"""zaber-motion, Zaber's own library, against the twin, over the pseudo-terminal."""

import sys
import time

from zaber_motion import CommandFailedException
from zaber_motion.ascii import Connection

SCALE = 400.0


def main(port: str) -> None:
    with Connection.open_serial_port(port) as connection:
        # No database is asked: everything is in native units.
        devices = connection.detect_devices(identify_devices=False)
        assert [d.device_address for d in devices] == [1], devices
        device = devices[0]
        assert device.settings.get("device.id") == 50081
        assert device.settings.get("system.axiscount") == 2
        axis = device.get_axis(1)

        # Before homing: it says that it has no reference, and takes no absolute move.
        assert "WR" in axis.warnings.get_flags(), axis.warnings.get_flags()
        assert not axis.is_homed()
        try:
            axis.move_absolute(400)
        except CommandFailedException as refused:
            assert refused.details.response_data == "BADCOMMAND", refused
        else:
            raise AssertionError("a move without a reference was taken")

        axis.home()
        assert axis.get_position() == 0
        assert "WR" not in axis.warnings.get_flags()
        low, high = axis.settings.get("limit.min"), axis.settings.get("limit.max")
        assert (low, high) == (-2 * SCALE, 5 * SCALE), (low, high)

        axis.move_absolute(2 * SCALE)
        assert axis.get_position() == 2 * SCALE
        axis.move_relative(-0.5 * SCALE)
        assert axis.get_position() == 1.5 * SCALE
        assert axis.settings.get("maxspeed") == round(20 * SCALE * 1.6384)

        # Beyond the limit it is refused, in the protocol's words.
        try:
            axis.move_absolute(high + 1)
        except CommandFailedException as refused:
            assert refused.details.response_data == "BADDATA", refused
        else:
            raise AssertionError("a move beyond the limit was taken")
        try:
            device.get_axis(3).get_position()
        except CommandFailedException as refused:
            assert refused.details.response_data == "BADAXIS", refused
        else:
            raise AssertionError("an axis that is not there answered")

        # A stop in mid-move, on the other axis.
        other = device.get_axis(2)
        other.home()
        other.move_absolute(-20 * SCALE, wait_until_idle=False, velocity=2 * SCALE * 1.6384)
        time.sleep(0.5)
        assert other.is_busy()
        other.stop()
        at = other.get_position()
        assert not other.is_busy() and -3 * SCALE < at < -0.2 * SCALE, at

        axis.driver_disable()
        assert "FO" in axis.warnings.get_flags()
        axis.driver_enable()
        assert axis.generic_command("tools echo a b").data == "a b"
    print("zaber-motion: connected, homed, moved, stopped, read limits, was refused rightly")


main(sys.argv[1])
