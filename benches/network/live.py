"""Reads what a daemon measures of a network camera that stands still, and says how fast, how late and at what cost.

live.py ADDRESS PROCESS MTU SECONDS COMMAND...: the daemon's address and process; what the network carries, bytes; for how
long; and the command that starts the camera
"""

import collections
import os
import pathlib
import sys
import time

import plenalign
from plenalign.models import ReadingsRequest
from twins import Camera, Daemon, setup, state, until

# Readings that come before the camera has its pace are not counted.
FIRST = 30
# So many frames are rendered, and sent in turn: two that follow each other differ, as a camera's do.
REPEATED = 5
TICKS_A_SECOND = os.sysconf("SC_CLK_TCK")


def processor_s(process):
    """What a process has had of the processor, s, by the names of its threads."""
    spent = collections.Counter()
    for task in pathlib.Path(f"/proc/{process}/task").iterdir():
        name, rest = (task / "stat").read_text().split("(", 1)[1].rsplit(")", 1)
        fields = rest.split()
        kind = name.split("-")[0] if name.startswith("meter-") else name
        spent[kind] += (int(fields[11]) + int(fields[12])) / TICKS_A_SECOND
    return spent


def watched(daemon, camera):
    """Has a white frame taken and a flat board before the camera, as who watches the spacing has."""
    daemon.ask("PUT", "/shell", {"state": "off"})
    for kind in ({"kind": "homing"}, {"kind": "spacing_watch", "duration_s": 1.0}):
        path, confirmed = "/jobs/" + daemon.ask("POST", "/jobs", kind)["id"], [0]

        def ended(path=path, confirmed=confirmed):
            job = daemon.ask("GET", path)
            step = job["operator_step"]
            if job["state"] == "waiting_for_operator" and step and step["number"] > confirmed[0]:
                if step["name"] in SET_UP:
                    camera.tell({"setup": setup(step)})
                confirmed[0] = step["number"]
                daemon.ask("POST", f"{path}/confirm", {"step": confirmed[0]})
            elif job["state"] in ("failed", "cancelled", "interrupted", "refused"):
                sys.exit(f"the job ended: {job['state']}: {job['reason']}")
            return job["state"] in ("succeeded", "converged")

        until(f"{kind} ends", ended)


SET_UP = ("white_frame", "triple_board_in_air", "board_in_air", "aperture", "shell_and_water")


def percentile(values, share):
    return sorted(values)[min(int(len(values) * share), len(values) - 1)]


def read(address, seconds, processes, lost):
    """Ages of the readings, ms, why how many have no spacing, how many frames were lost, for how long, and what each process had
    of the processor."""
    ages, refused, count, begin, before = [], collections.Counter(), 0, None, None
    with plenalign.Client(address) as client, client.watch(readings=ReadingsRequest(on=True)) as messages:
        for message in messages:
            if not isinstance(message, plenalign.Reading):
                continue
            now = time.monotonic()
            count += 1
            if count == FIRST:
                begin, before = now, ([processor_s(process) for process in processes], lost())
            elif count > FIRST:
                ages.append(1e3 * now - 1e-3 * message.captured_monotonic_us)
                if message.spacing_px is None:
                    refused[message.why] += 1
                if now - begin > seconds:
                    spent = [processor_s(process) - was for process, was in zip(processes, before[0], strict=True)]
                    return ages, refused, lost() - before[1], now - begin, spent
    sys.exit("the readings ended")


def main():
    address, process, mtu, seconds = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4])
    daemon, camera = Daemon(address), Camera(sys.argv[5:])
    try:
        until("the camera is there", lambda: state(daemon)["online"])
        daemon.take_lease()
        watched(daemon, camera)
        camera.tell({"repeat": REPEATED})
        ages, refused, lost, took, (own, theirs) = read(
            address, seconds, [process, camera.process.pid], lambda: state(daemon)["frames_lost"]
        )
        if refused:
            print(f"{refused.total()} of {len(ages)} readings have no spacing: {refused.most_common(1)[0][0]}", file=sys.stderr)
        measured = len(ages) - refused.total()
        share = {name: 100 * s / took for name, s in own.most_common() if s / took > 0.01}
        print(
            f"MTU {mtu}: {len(ages) / took:.1f} readings/s, {measured / took:.1f} of them with a spacing; age at the client "
            f"{percentile(ages, 0.5):.0f} ms in the median, {percentile(ages, 0.95):.0f} ms p95; {lost} frames lost; daemon "
            f"{100 * own.total() / took:.0f} % of a processor ("
            + ", ".join(f"{name} {percent:.0f}" for name, percent in share.items())
            + f"), camera {100 * theirs.total() / took:.0f} %",
            flush=True,
        )
    finally:
        camera.end()


main()
