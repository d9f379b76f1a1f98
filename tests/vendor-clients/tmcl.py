"""PyTrinamic, Trinamic's own library, against the twin, over the pseudo-terminal."""

import sys
import time

from pytrinamic.connections import ConnectionManager
from pytrinamic.modules import TMCM6214
from pytrinamic.tmcl import TMCLCommand, TMCLReplyStatusError

SCALE = 400


def main(port: str) -> None:
    with ConnectionManager(f"--interface serial_tmcl --port {port} --data-rate 9600").connect() as interface:
        assert "6214" in interface.get_version_string(), interface.get_version_string()
        module = TMCM6214(interface)
        motor = module.motors[0]

        # A reference search to the left switch.
        motor.set_axis_parameter(motor.AP.ReferenceSearchMode, 1)
        interface.reference_search(0, 0, 1)
        deadline = time.monotonic() + 30
        while interface.reference_search(2, 0, 1) != 0:
            assert time.monotonic() < deadline, "it searches for ever"
            time.sleep(0.05)
        assert motor.actual_position == 0, motor.actual_position

        motor.linear_ramp.max_velocity = 10 * SCALE
        motor.linear_ramp.max_acceleration = 200 * SCALE
        motor.move_to(2 * SCALE)
        assert motor.actual_velocity > 0 or not motor.get_position_reached()
        while not motor.get_position_reached():
            assert time.monotonic() < deadline, "it never arrives"
            time.sleep(0.02)
        assert motor.actual_position == 2 * SCALE, motor.actual_position
        motor.move_by(-SCALE // 2)
        while not motor.get_position_reached():
            time.sleep(0.02)
        assert motor.actual_position == 3 * SCALE // 2, motor.actual_position

        # A stop in mid-move.
        motor.move_to(5 * SCALE, velocity=SCALE)
        time.sleep(0.5)
        motor.stop()
        time.sleep(0.2)
        at = motor.actual_position
        assert motor.actual_velocity == 0 and 1.6 * SCALE < at < 4 * SCALE, at
        # Limit switches: open, and in force.
        assert motor.get_axis_parameter(motor.AP.RightEndstop) == 0
        assert motor.get_axis_parameter(motor.AP.RightLimitSwitchDisable) == 0

        # A reference search towards the end that is not home: it ends at that end's switch, 9 mm from the other, and the
        # module never goes far.
        motor.set_axis_parameter(motor.AP.ReferenceSearchMode, 65)
        before, farthest = motor.actual_position, 0
        interface.reference_search(0, 0, 1)
        while interface.reference_search(2, 0, 1) != 0:
            farthest = max(farthest, abs(motor.actual_position - before))
            assert time.monotonic() < deadline and farthest < 9 * SCALE, f"it searches on, {farthest / SCALE} mm so far"
            time.sleep(0.02)
        assert motor.actual_position == 0, motor.actual_position
        motor.move_to(-5 * SCALE, velocity=10 * SCALE)
        while not motor.get_position_reached():
            assert time.monotonic() < deadline, "it never arrives"
            time.sleep(0.02)

        for what, command, kind in [("a parameter not there", TMCLCommand.GAP, 254), ("a command not there", 99, 0)]:
            try:
                interface.send(command, kind, 0, 0)
            except TMCLReplyStatusError as refused:
                assert refused.status_code in (2, 3), refused
            else:
                raise AssertionError(f"{what} was taken")
    print("pytrinamic: connected, homed to either end, moved, stopped, read limit switches, was refused rightly")


main(sys.argv[1])
