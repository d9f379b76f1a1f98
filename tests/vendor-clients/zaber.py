"""zaber-motion, Zaber's own library, against the twin, over the pseudo-terminal."""

import sys
import threading

from waiting import until
from zaber_motion import CommandFailedException, MovementInterruptedException
from zaber_motion.ascii import Connection

SCALE = 400.0


def interrupted_by(axis, command) -> None:
    """A move that is waited for ends as interrupted when `command` comes in its midst."""
    ended = []

    def move() -> None:
        try:
            axis.move_absolute(SCALE * (4 if axis.get_position() < 2 * SCALE else 0), velocity=2 * SCALE * 1.6384)
        except MovementInterruptedException as interrupted:
            ended.append(interrupted)

    began = axis.get_position()
    mover = threading.Thread(target=move)
    mover.start()
    until("on its way", lambda: abs(axis.get_position() - began) > 0.2 * SCALE)
    command()
    mover.join(20)
    assert not mover.is_alive() and len(ended) == 1, f"the move was not interrupted: {ended}"
    # The flag goes with the next motion that begins at rest, and not before.
    assert "NI" in axis.warnings.get_flags() and "NI" in axis.warnings.clear_flags()
    assert "NI" in axis.warnings.get_flags()
    until("at rest", lambda: not axis.is_busy())
    axis.move_relative(10)
    assert "NI" not in axis.warnings.get_flags(), axis.warnings.get_flags()


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
        until("on its way", lambda: other.get_position() < -0.3 * SCALE)
        assert other.is_busy()
        other.stop()
        at = other.get_position()
        assert not other.is_busy() and -3 * SCALE < at < -0.2 * SCALE, at

        # What ends a move that is waited for: a stop, and other commands of motion.
        interrupted_by(axis, axis.stop)
        interrupted_by(axis, lambda: axis.generic_command("move rel 40"))
        interrupted_by(axis, lambda: axis.generic_command("move vel 400") and axis.stop())

        # Alerts, once they are on: one at the end of every motion.
        alerts = []
        connection.alert.subscribe(alerts.append)
        axis.move_absolute(SCALE)
        assert not alerts, alerts
        connection.enable_alerts()
        assert device.settings.get("comm.alert") == 1
        axis.move_absolute(2 * SCALE)
        until("alerted", lambda: alerts)
        assert [(a.axis_number, a.status, a.warning_flag) for a in alerts] == [(1, "IDLE", "--")], alerts
        connection.disable_alerts()

        axis.driver_disable()
        assert "FO" in axis.warnings.get_flags()
        axis.driver_enable()
        assert axis.generic_command("tools echo a b").data == "a b"
    print("zaber-motion: connected, homed, moved, stopped, was interrupted, alerted, read limits, refused")


main(sys.argv[1])
