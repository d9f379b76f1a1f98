"""The example, as a user runs it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy
import plenalign
from PIL import Image

from bench import ROOT, Daemon

EXAMPLE = ROOT / "clients" / "python" / "examples" / "align.py"


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PLENALIGN_TOKEN": "", "MPLBACKEND": "Agg"}
    command = [sys.executable, str(EXAMPLE), *arguments]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=280, check=False)


def test_it_aligns_the_simulated_bench_and_plots(daemon: Daemon, client: plenalign.Client, tmp_path: Path) -> None:
    plot, report = tmp_path / "spacing.png", tmp_path / "report.html"
    done = run("--server", daemon.address, "--plot", str(plot), "--report", str(report))
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("converged: ")
    assert "SIMULATED" in done.stderr
    newest = next(client.jobs(kind=["joint_alignment"]))
    assert newest.state.value == "converged"
    assert str(newest.id) in report.read_text()
    assert client.lease_holder() is None
    with Image.open(plot) as picture:
        pixels = numpy.asarray(picture.convert("RGB"))
    assert min(pixels.shape[:2]) >= 400
    # Both panels hold the line's colour, matplotlib's first.
    blue = (pixels == (31, 119, 180)).all(axis=2)
    half = blue.shape[1] // 2
    assert blue[:, :half].sum() > 200
    assert blue[:, half:].sum() > 200


def test_it_says_why_it_cannot(tmp_path: Path) -> None:
    done = run("--server", "http://127.0.0.1:9", "--plot", str(tmp_path / "none.png"))
    assert done.returncode == 1
    assert "plenalign serve" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "none.png").exists()
