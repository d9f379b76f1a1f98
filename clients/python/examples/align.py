"""Aligns the bench and plots the spacing of every iteration: align.py [--server URL] [--plot spacing.png].

The simulated bench's operator does by himself what is asked for; on a bench of hardware you are asked to confirm.
"""

from __future__ import annotations

import argparse
import sys

import plenalign
from plenalign.models import Iteration, JobResource, JointAlignmentJob, OperatorStep, Stage


def main() -> int:
    """Aligns and plots."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--server", help="address of the daemon; the one on this machine unless given")
    parser.add_argument("--ca", help="PEM file of the authority that vouches for the daemon")
    parser.add_argument("--plot", default="spacing.png", help="where the plot is written, as PNG, PDF or SVG")
    parser.add_argument("--report", help="where the report is written: .html, .csv or .json")
    given = parser.parse_args()
    try:
        with plenalign.Client(given.server, ca=given.ca) as client:
            return align(client, given.plot, given.report)
    except plenalign.PlenalignError as error:
        print(f"align: {error}", file=sys.stderr)
        return 1


def align(client: plenalign.Client, plot_path: str, report_path: str | None) -> int:
    """Runs a joint alignment with its progress on standard error."""
    simulated = client.health().simulated
    if simulated:
        print("the bench is SIMULATED", file=sys.stderr)
    if hindrances := client.hindrances():
        print(f"align: the bench is not ready: {'; '.join(hindrances)}", file=sys.stderr)
        return 1

    def show(job: JobResource) -> None:
        measure = job.progress.measure
        figures = f"  {measure.name} {measure.value:.4f} ± {measure.sigma:.4f}" if measure else ""
        print(f"{job.stage.value:12} {job.progress.doing}{figures}", file=sys.stderr)

    def ask(step: OperatorStep) -> bool:
        if simulated or not sys.stdin.isatty():
            print(f"waiting for the operator: {step.instruction}", file=sys.stderr)
            return False
        input(f"{step.instruction}: Enter when it is done ")
        return True

    with client.lease(note="examples/align.py") as lease:
        job = lease.start(JointAlignmentJob(note="by the Python example"))
        handed_on = f"{client.address.base}/#/alignment/{job.id}/{job.confirm_key}"
        print(f"whoever has this link can confirm what is asked: {handed_on}", file=sys.stderr)
        # An interrupt here cancels the job.
        ended = job.wait(on_change=show, on_step=ask, check=False)
    plot(ended.iterations, plot_path, f"{'SIMULATED, ' if simulated else ''}{ended.state.value}")
    print(f"{ended.state.value}: {ended.reason or ''}")
    if ended.report and ended.report.e_mm is not None and ended.report.delta_v_mm is not None:
        print(f"Δv = {ended.report.delta_v_mm:.4f} mm, e = {ended.report.e_mm:.4f} mm; plotted into {plot_path}")
    if report_path:
        print(f"the report is {job.save(report_path)}")
    return 0 if ended.state in plenalign.GOOD else 1


def plot(iterations: list[Iteration], path: str, title: str) -> None:
    """Draws the spacing measured at every iteration, and the one wanted."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, panels = pyplot.subplots(1, 2, figsize=(10, 4), layout="constrained")
    for axes, stage, name in ((panels[0], Stage.AIR, "in air"), (panels[1], Stage.SHELL, "in the shell, in water")):
        here = [each for each in iterations if each.stage is stage]
        numbers = list(range(1, len(here) + 1))
        measured = [each.spacing.spacing_px for each in here]
        sigma = [2 * each.spacing.spacing_sigma_px for each in here]
        axes.errorbar(numbers, measured, yerr=sigma, fmt="o-", capsize=3, label="measured, ± 2σ")
        axes.step(numbers, [each.spacing_target_px for each in here], "k--", where="mid", label="wanted")
        axes.set_title(name)
        axes.set_xlabel("iteration")
        axes.set_ylabel("spacing [px]")
        axes.set_xticks(numbers)
        axes.legend()
    figure.suptitle(f"Joint alignment: {title}")
    figure.savefig(path)
    pyplot.close(figure)


if __name__ == "__main__":
    sys.exit(main())
