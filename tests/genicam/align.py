"""A joint alignment by a daemon whose bench is hardware: its camera is `plenalign sim-camera`, its stage `plenalign
sim-stage`, and the operator is this program, which sets the twins up and judges the end by their truth.

align.py ADDRESS COMMAND...: the daemon's address, and the command that starts the camera
"""

import json
import subprocess
import sys
import time
import urllib.error
import urllib.request

ADDRESS, CAMERA = sys.argv[1], sys.argv[2:]
PATIENCE_S = 120
# How far off the sharp image may be, mm of image distance; and the spacing, px.
FOCUS_MM, SPACING_PX = 0.010, 0.03


class Camera:
    """The twin: a line to it, a line from it."""

    def __init__(self):
        self.process = subprocess.Popen(CAMERA, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        json.loads(self.process.stdout.readline())

    def tell(self, order):
        self.process.stdin.write(json.dumps(order) + "\n")
        self.process.stdin.flush()
        answer = json.loads(self.process.stdout.readline())
        if isinstance(answer, dict) and "error" in answer:
            sys.exit(f"the camera refused {order}: {answer}")
        return answer

    def end(self):
        self.process.kill()
        self.process.wait()


class Daemon:
    key = ""

    def ask(self, method, path, body=None):
        headers = {"content-type": "application/json", "plenalign-lease": self.key}
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(f"{ADDRESS}/api/v1{path}", data, headers, method=method)
        try:
            with urllib.request.urlopen(request, timeout=20) as answer:
                return json.loads(answer.read())
        except urllib.error.HTTPError as error:
            sys.exit(f"{method} {path}: {error.code} {error.read().decode()}")


def until(what, holds):
    end = time.monotonic() + PATIENCE_S
    while True:
        now = holds()
        if now:
            return now
        if time.monotonic() > end:
            sys.exit(f"not within {PATIENCE_S} s: {what}")
        time.sleep(0.05)


def setup(step):
    """What a step asks for, by the numbers that the page shows large."""
    words = "".join(letter if letter.isdigit() or letter == "." else " " for letter in step["value"] or "").split()
    numbers = [float(word) for word in words if any(letter.isdigit() for letter in word)]
    name = step["name"]
    if name == "white_frame":
        return {"type": "diffuser"}
    if name == "triple_board_in_air":
        return {"type": "boards_in_air", "distances_mm": numbers}
    if name == "board_in_air":
        return {"type": "boards_in_air", "distances_mm": 3 * numbers}
    if name == "aperture":
        return {"type": "aperture", "diameter_mm": numbers[0], "ring_f_number": numbers[1]}
    if name == "shell_and_water":
        return {"type": "board_in_water", "distance_mm": numbers[0]}
    sys.exit(f"this operator cannot do: {step}")


class Alignment:
    """A job, and its operator; the camera is restarted once on the way."""

    def __init__(self, daemon, camera):
        self.daemon, self.camera = daemon, camera
        self.path = "/jobs/" + daemon.ask("POST", "/jobs", {"kind": "joint_alignment"})["id"]
        self.confirmed, self.said, self.restarted = 0, 0, False

    def converged(self):
        """Does what is asked for; the job, once it has converged."""
        job = self.daemon.ask("GET", self.path)
        for line in job["log"][self.said :]:
            print(f"  {line['message']}", flush=True)
        self.said = len(job["log"])
        step = job["operator_step"]
        if job["state"] == "waiting_for_operator":
            if step and step["number"] > self.confirmed:
                self.camera.tell({"setup": setup(step)})
                self.confirmed = step["number"]
                self.daemon.ask("POST", f"{self.path}/confirm", {"step": self.confirmed})
        elif job["state"] == "running" and len(job["iterations"]) >= 2 and not self.restarted:
            self.restarted = True
            self.camera.tell({"restart_s": 1})
            away = until("the camera is missed", lambda: not (now := state(self.daemon))["online"] and now)
            print(f"  the camera was without power: {away['fault']}", flush=True)
        elif job["state"] == "converged":
            assert self.restarted
            return job
        elif job["state"] not in ("pending", "running"):
            sys.exit(f"the job ended: {job['state']}: {job['reason']}")
        return None


def state(daemon):
    return daemon.ask("GET", "/bench")["camera"]


def judge(job, truth, camera):
    report = job["report"]
    print(f"  {truth}")
    assert job["simulated"] is False
    assert abs(report["spacing_px"] - report["spacing_target_px"]) < SPACING_PX, report
    assert abs(truth["focus_error_mm"]) < FOCUS_MM, truth
    assert truth["touched_shell"] is False and truth["shell_on"] is True, truth
    budget = report["budget"]
    for name in ("delta_v", "e"):
        off = abs(budget[f"{name}_mm"] - truth[f"{name}_mm"])
        assert off < 3 * budget[f"{name}_sigma_mm"], (name, off, budget)
    print(
        f"- aligned: spacing {report['spacing_px']:.4f} px for {report['spacing_target_px']:.4f}, "
        f"truly {1000 * truth['focus_error_mm']:+.1f} um from focus; {camera['frames_lost']} frames lost, "
        f"{camera['frames_damaged']} damaged"
    )


def main():
    daemon, camera = Daemon(), Camera()
    try:
        until("the camera is there", lambda: state(daemon)["online"])
        daemon.key = daemon.ask("POST", "/lease", {"owner": "the twins' operator", "ttl_s": 600})["key"]
        job = until("the job converges", Alignment(daemon, camera).converged)
        judge(job, camera.tell("truth"), state(daemon))
    finally:
        camera.end()


main()
