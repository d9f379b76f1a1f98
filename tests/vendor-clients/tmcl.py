"""PyTrinamic, Trinamic's own library, against the twin, over the pseudo-terminal."""

import sys

from pytrinamic.connections import ConnectionManager
from pytrinamic.modules import TMCM6214
from pytrinamic.tmcl import TMCLCommand, TMCLReplyStatusError
from waiting import until

SCALE = 400


def main(port: str) -> None:
    with ConnectionManager(f"--interface serial_tmcl --port {port} --data-rate 9600").connect() as interface:
        assert "6214" in interface.get_version_string(), interface.get_version_string()
        module = TMCM6214(interface)
        motor = module.motors[0]

        # A reference search to the left switch.
        motor.set_axis_parameter(motor.AP.ReferenceSearchMode, 1)
        interface.reference_search(0, 0, 1)
        until("found", lambda: interface.reference_search(2, 0, 1) == 0)
        assert motor.actual_position == 0, motor.actual_position

        motor.linear_ramp.max_velocity = 10 * SCALE
        motor.linear_ramp.max_acceleration = 200 * SCALE
        motor.move_to(2 * SCALE)
        assert motor.actual_velocity > 0 or not motor.get_position_reached()
        until("there", motor.get_position_reached)
        assert motor.actual_position == 2 * SCALE, motor.actual_position
        motor.move_by(-SCALE // 2)
        until("there", motor.get_position_reached)
        assert motor.actual_position == 3 * SCALE // 2, motor.actual_position

        # A stop in mid-move.
        motor.move_to(5 * SCALE, velocity=SCALE)
        until("on its way", lambda: motor.actual_position > 1.7 * SCALE)
        motor.stop()
        until("at rest", lambda: motor.actual_velocity == 0)
        at = motor.actual_position
        assert motor.actual_velocity == 0 and 1.6 * SCALE < at < 4 * SCALE, at
        # Limit switches: open, and in force.
        assert motor.get_axis_parameter(motor.AP.RightEndstop) == 0
        assert motor.get_axis_parameter(motor.AP.RightLimitSwitchDisable) == 0

        # A reference search towards the end that is not home: it ends at that end's switch, 9 mm from the other, and the
        # module never goes far.
        motor.set_axis_parameter(motor.AP.ReferenceSearchMode, 65)
        before = motor.actual_position
        interface.reference_search(0, 0, 1)

        def found() -> bool:
            far = abs(motor.actual_position - before)
            searches = interface.reference_search(2, 0, 1) != 0
            assert not searches or far < 9 * SCALE, f"it searches on, {far / SCALE} mm so far"
            return not searches

        until("found", found)
        assert motor.actual_position == 0, motor.actual_position
        motor.move_to(-5 * SCALE, velocity=10 * SCALE)
        until("there", motor.get_position_reached)

        for what, command, kind in [("a parameter not there", TMCLCommand.GAP, 254), ("a command not there", 99, 0)]:
            try:
                interface.send(command, kind, 0, 0)
            except TMCLReplyStatusError as refused:
                assert refused.status_code in (2, 3), refused
            else:
                raise AssertionError(f"{what} was taken")
    print("pytrinamic: connected, homed to either end, moved, stopped, read limit switches, was refused rightly")


main(sys.argv[1])
