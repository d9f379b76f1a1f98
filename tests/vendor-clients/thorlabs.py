"""Two clients of Thorlabs' APT protocol that others wrote, against the twins of a BSC203 and a KDC101, over the
pseudo-terminal: thorlabs-apt-device, which listens to states that are said again and again, and pylablib, which asks."""

import sys
import time
import warnings

from pylablib.devices import Thorlabs
from thorlabs_apt_device.devices.aptdevice import APTDevice
from thorlabs_apt_device.devices.bsc import BSC
from thorlabs_apt_device.devices.kdc101 import KDC101
from waiting import until

RACK = sys.argv[1] == "rack"
# Units a millimetre; of both axes as the configuration has them.
SCALE = 409600 if RACK else 34304


# A pseudo-terminal has no RTS to be cycled.
Thorlabs.kinesis.BasicKinesisDevice._cycle_rts = staticmethod(lambda instr: None)


def with_pylablib(port: str) -> None:
    stage = Thorlabs.KinesisMotor(("serial", port), scale=SCALE, is_rack_system=RACK)
    try:
        info = stage.get_device_info()
        assert info.model_no == ("BSC203" if RACK else "KDC101"), info
        assert info.fw_ver == "2.1.9" and info.nchannels == (3 if RACK else 1), info
        if RACK:
            # It counts bays from 0.
            assert stage._find_bays() == [0, 1], stage._find_bays()
        status = stage.get_status()
        assert "enabled" in status and "homed" not in status and "connected" in status, status

        # How it homes, and its limits.
        homing = stage.get_homing_parameters()
        assert (homing.home_direction, homing.limit_switch) == ("reverse", "reverse"), homing
        limits = stage.get_limit_switch_parameters()
        assert (limits.hw_kind_cw, limits.sw_kind) == ("make", "stop_imm"), limits
        assert limits.sw_position_ccw < limits.sw_position_cw, limits
        low, high = limits.sw_position_ccw, limits.sw_position_cw

        stage.home(timeout=30)
        until("at rest", lambda: not stage.is_moving())
        assert stage.is_homed() and stage.get_position() == 0, stage.get_position()

        # What it is told of speed comes back in the units that the client knows for this model, and it goes as fast.
        set_to = stage.setup_velocity(acceleration=20, max_velocity=4)
        assert abs(set_to.max_velocity - 4) < 0.01 and abs(set_to.acceleration - 20) < 0.05, set_to
        began = time.monotonic()
        stage.move_to(2)
        assert stage.is_moving()
        stage.wait_move(timeout=10)
        took = time.monotonic() - began
        # 2 mm at 4 mm/s, and 0.2 s of ramps.
        assert 0.65 < took < 1.2, took
        assert abs(stage.get_position() - 2) < 1e-4, stage.get_position()
        stage.move_by(-0.5)
        stage.wait_move(timeout=10)
        assert abs(stage.get_position() - 1.5) < 1e-4, stage.get_position()

        # A stop along the ramp and one at once, in mid-move; a move that another one pre-empts.
        for immediate in (False, True):
            stage.setup_velocity(max_velocity=1)
            stage.move_to(high - 0.1)
            until("on its way", lambda: stage.get_position() > 1.7)
            stage.stop(immediate=immediate)
            at = stage.get_position()
            assert not stage.is_moving() and 1.6 < at < high - 1, at
            stage.setup_velocity(max_velocity=10)
            stage.move_to(1.5)
            stage.wait_move(timeout=10)
        stage.move_to(high - 0.1)
        until("on its way", lambda: stage.get_position() > 1.55)
        stage.move_to(0.5)
        stage.wait_move(timeout=10)
        assert abs(stage.get_position() - 0.5) < 1e-4, stage.get_position()
        ended = stage.check_background_comm(0x0464)
        assert ended[0] >= 2, f"the ends of moves were not told: {ended}"

        # A jog that is stopped, one of a step, and a move beyond the limit in numbers, which ends there.
        stage.setup_jog(mode="step", step_size=0.25, max_velocity=5, acceleration=50)
        before = stage.get_position()
        stage.jog("+", kind="builtin")
        until("at rest", lambda: not stage.is_moving())
        assert abs(abs(stage.get_position() - before) - 0.25) < 1e-3, stage.get_position()
        stage.setup_velocity(max_velocity=1)
        began = stage.get_position()
        stage.jog("-", kind="continuous")
        until("beyond a step", lambda: abs(stage.get_position() - began) > 0.26)
        assert stage.is_moving()
        stage.stop()
        assert not stage.is_moving()
        stage.setup_velocity(max_velocity=20)
        stage.move_to(high + 5)
        stage.wait_move(timeout=10)
        assert abs(stage.get_position() - high) < 1e-3, (stage.get_position(), low, high)
        assert {"sw_bk_lim", "sw_fw_lim"} & set(stage.get_status()), stage.get_status()
        stage.move_to(1)
        stage.wait_move(timeout=10)

        if not RACK:
            stage._enable_channel(False)
            assert "enabled" not in stage.get_status()
            stage.send_comm(0x0210, 1, 1)
            assert "enabled" in stage.get_status()
    finally:
        stage.close()


def with_apt_device(port: str) -> None:
    # Which states it listens to, and how it keeps the unit saying them, is its own affair.
    device: APTDevice = BSC(serial_port=port, x=2, home=False) if RACK else KDC101(serial_port=port, home=False)
    try:
        status = device.status_[0][0]
        until("heard", lambda: status["msg"] != "" and device.homeparams_[0][0]["home_velocity"] > 0)
        assert status["channel_enabled"] and status["motor_connected"] and status["homed"], status
        assert device.velparams_[0][0]["max_velocity"] > 0 and device.jogparams_[0][0]["step_size"] > 0
        device.set_enabled(True)
        device.home()
        until("homing", lambda: status["homing"])
        assert not status["homed"], status
        until("homed", lambda: status["homed"])
        assert status["position"] == 0 and not status["homing"], status

        device.move_absolute(3 * SCALE)
        until("moving", lambda: status["moving_forward"] or status["moving_reverse"])
        until("there", lambda: status["position"] == 3 * SCALE and not status["moving_forward"])
        device.move_relative(-SCALE)
        until("back", lambda: status["position"] == 2 * SCALE and not status["moving_reverse"])

        device.move_velocity("forward")
        until("moving", lambda: status["moving_forward"])
        device.stop()
        until("stopped", lambda: not status["moving_forward"])
        at = status["position"]
        time.sleep(0.3)
        assert status["position"] == at > 2 * SCALE, (status["position"], at)

        # It goes on saying how it is for longer than it would unheard.
        if not RACK:
            device.move_absolute(SCALE)
            time.sleep(6.5)
            assert status["position"] == SCALE, status
        device.move_absolute(0)
        until("at 0", lambda: status["position"] == 0)
    finally:
        device.close()
        device._thread.join()


warnings.simplefilter("ignore")
with_pylablib(sys.argv[2])
with_apt_device(sys.argv[2])
print(
    f"pylablib, thorlabs-apt-device on a {'BSC203' if RACK else 'KDC101'}: connected, identified, homed, moved, stopped, "
    "pre-empted, jogged, limited, listened"
)
