#!/usr/bin/env python3
"""Writes a history as the first version of the program kept it: the first step of the tables, as the program's source has
it, with a job in it.

    history.py FILE              writes one and prints the job's id
    history.py --version FOLDER  prints the version of the tables in a state folder, from a copy
    history.py --newest          prints the version that the program knows
"""

import json
import pathlib
import re
import shutil
import sqlite3
import sys
import tempfile
import uuid

SCHEMA = pathlib.Path(__file__).resolve().parents[2] / "crates/bench/src/store/schema.rs"
AT = "2025-03-01T10:00:00Z"
AT_NS = 1_740_823_200_000_000_000


def steps():
    found = re.search(r"const STEPS: &\[&str\] = &\[(.*?)\];", SCHEMA.read_text(), re.DOTALL)
    texts = re.findall(r'"(.*?)"', found[1], re.DOTALL) if found else []
    if len(texts) < 2 or "CREATE TABLE jobs" not in texts[0]:
        sys.exit(f"history: {SCHEMA} has not the steps that were looked for")
    return texts


def version(folder):
    with tempfile.TemporaryDirectory() as copy:
        for file in pathlib.Path(folder).glob("history.db*"):
            shutil.copy(file, copy)
        return sqlite3.connect(f"{copy}/history.db").execute("PRAGMA user_version").fetchone()[0]


def spacing():
    return {
        "spacing_px": 30.51, "spacing_sigma_px": 0.01, "tilt_x_px": 0.0, "tilt_y_px": 0.0, "curvature_px": 0.0,
        "pairs": 900, "frames": 4,
    }


def main():
    run, job = str(uuid.uuid4()), "01955000-0000-7000-8000-000000000001"
    document = {
        "id": job, "kind": "joint_alignment", "state": "converged", "stage": "shell", "simulated": True,
        "generation": 41, "created_at": AT, "ended_at": AT, "progress": {"step": 9, "of": 9, "doing": "done"},
        "operator_step": None, "iterations": [], "log": [], "reason": "the spacing meets its target, verified",
        "report": None,
    }
    iteration = {
        "number": 1, "stage": "air", "kind": "move", "axis": "focus", "focus_mm": 2.2, "e_mm": 30.0, "delta_v_mm": 2.2,
        "delta_v_sigma_mm": 0.001, "e_estimate_mm": None, "e_estimate_sigma_mm": None, "spacing": spacing(),
        "spacing_predicted_px": None, "spacing_target_px": 30.5, "decision": "within tolerance, verified", "at": AT,
    }
    database = sqlite3.connect(sys.argv[1])
    database.executescript(steps()[0])
    database.execute("PRAGMA user_version = 1")
    database.execute("INSERT INTO configurations VALUES ('0', '')")
    database.execute("INSERT INTO runs VALUES (?, 'another', '0.0.1', '0', ?, ?)", (run, AT_NS, AT_NS))
    database.execute(
        "INSERT INTO jobs VALUES (?, ?, 'joint_alignment', 'converged', 1, 41, ?, ?, ?, ?, ?, NULL, ?)",
        (job, run, AT_NS, AT_NS, AT_NS, document["reason"], json.dumps({"kind": "joint_alignment"}), json.dumps(document)),
    )
    database.execute("INSERT INTO iterations VALUES (?, 1, ?, ?)", (job, AT_NS, json.dumps(iteration)))
    database.execute("INSERT INTO log VALUES (?, 1, ?, 'begun')", (job, AT_NS))
    database.commit()
    database.close()
    print(job)


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["--newest"]:
            print(len(steps()))
        case ["--version", folder]:
            print(version(folder))
        case _:
            main()
