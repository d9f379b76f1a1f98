"""A joint alignment by a daemon whose bench is hardware: its camera is `plenalign sim-camera`, its stage `plenalign
sim-stage`, and the operator is this program, which sets the twins up and judges the end by their truth.

align.py ADDRESS COMMAND...: the daemon's address, and the command that starts the camera
"""

import sys

from twins import Camera, Daemon, setup, state, until

# How far off the sharp image may be, mm of image distance; and the spacing, px.
FOCUS_MM, SPACING_PX = 0.010, 0.03


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
    daemon, camera = Daemon(sys.argv[1]), Camera(sys.argv[2:])
    try:
        until("the camera is there", lambda: state(daemon)["online"])
        daemon.take_lease()
        job = until("the job converges", Alignment(daemon, camera).converged)
        judge(job, camera.tell("truth"), state(daemon))
    finally:
        camera.end()


main()
