"""The dashboards as Grafana takes them, and their expressions and the alerts' against what a daemon has.

dashboards.py PROMTOOL METRICS ROOT
"""

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

PROMTOOL, METRICS, ROOT = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
# What Grafana puts in the place of its variables.
VARIABLES = {"$__rate_interval": "1m", "$job": "plenalign", "$instance": "bench-1.lab:8443"}
# Labels that Prometheus itself adds, and that a bucket has.
ADDED = {"job", "instance", "le"}


def panels_of(board):
    """Every panel, those within rows too."""
    for panel in board["panels"]:
        yield panel
        yield from panel.get("panels", [])


def check_board(path):
    """Checks a dashboard's structure, and returns its expressions by where they are."""
    board = json.loads(path.read_text())
    assert board["schemaVersion"] >= 36, f"{path.name}: a schema before that of named data sources"
    assert board["uid"] and board["title"] and "id" not in board, f"{path.name}: no uid, or an id of another Grafana"
    variables = {variable["name"]: variable for variable in board["templating"]["list"]}
    assert variables["datasource"]["type"] == "datasource" and variables["datasource"]["query"] == "prometheus"
    assert {"job", "instance"} <= variables.keys(), f"{path.name}: no variable for job or instance"
    ids, expressions, taken = [], {}, set()
    for panel in panels_of(board):
        where = f"{path.name}: {panel['title']}"
        ids.append(panel["id"])
        place = panel["gridPos"]
        assert place["x"] + place["w"] <= 24, f"{where}: beyond the edge"
        for cell in (
            (x, y)
            for x in range(place["x"], place["x"] + place["w"])
            for y in range(place["y"], place["y"] + place["h"])
        ):
            assert cell not in taken, f"{where}: over another panel"
            taken.add(cell)
        if panel["type"] == "row":
            continue
        assert panel["targets"], f"{where}: shows nothing"
        assert len({target["refId"] for target in panel["targets"]}) == len(panel["targets"]), where
        for target in panel["targets"]:
            for source in (panel["datasource"], target["datasource"]):
                assert source == {"type": "prometheus", "uid": "${datasource}"}, f"{where}: a data source of its own"
            used = set(re.findall(r"\$\{?(\w+)", target["expr"])) - {"__rate_interval"}
            assert used <= variables.keys(), f"{where}: {used} is no variable"
            expressions[f"{where}, {target['refId']}"] = target["expr"]
    assert len(ids) == len(set(ids)), f"{path.name}: a panel's id is there twice"
    for name in ("job", "instance"):
        found = re.fullmatch(r"label_values\((.*), \w+\)", variables[name]["definition"])
        assert found, f"{path.name}: {name} has no values"
        expressions[f"{path.name}: ${name}"] = found[1]
    return expressions


def rules_of(path):
    """The expressions of a file of rules: each line from `expr:` to the next key."""
    text = path.read_text()
    found = re.findall(r"^ +expr: (?:>\n((?: {10,}.*\n)+)|(.*)\n)", text, re.MULTILINE)
    assert len(found) == text.count("expr:"), f"{path.name}: an expression was not found"
    return {f"{path.name}, rule {n}": " ".join((folded or line).split()) for n, (folded, line) in enumerate(found)}


def metrics_in_code():
    """Names under which the program counts."""
    text = (ROOT / "crates/bench/src/telemetry.rs").read_text()
    return set(re.findall(r'^const [A-Z_]+: &str = "(plenalign_\w+)";', text, re.MULTILINE))


def labels_seen():
    """Labels of each metric that the daemon has."""
    seen = {}
    for line in METRICS.read_text().splitlines():
        if found := re.match(r"(plenalign_\w+)(?:\{(.*)\})? ", line):
            labels = set(re.findall(r'(\w+)="', found[2] or ""))
            seen.setdefault(found[1], set()).update(labels)
    return seen


def main():
    """Checks everything; the first that is wrong ends the program."""
    expressions = {}
    boards = sorted((ROOT / "deploy/grafana").glob("*.json"))
    assert len(boards) >= 2, "the dashboards are not there"
    uids = [json.loads(board.read_text())["uid"] for board in boards]
    assert len(set(uids)) == len(uids), "two dashboards have one uid"
    for board in boards:
        expressions.update(check_board(board))
    expressions.update(rules_of(ROOT / "deploy/prometheus/rules.yml"))
    known, seen, used = metrics_in_code(), labels_seen(), set()
    assert len(known) > 30, "the metrics' names were not found"
    lines = ["groups:", "  - name: expressions", "    rules:"]
    for number, (where, expression) in enumerate(expressions.items()):
        for variable, value in VARIABLES.items():
            expression = expression.replace(variable, value)
        lines += [f"      - record: check_{number}", f"        expr: {json.dumps(expression)}"]
        for name, selector in re.findall(r"(?<![\w:])(plenalign_\w+)(?:\{([^}]*)\})?", expression):
            base = name if name in known else re.sub(r"_(bucket|sum|count)$", "", name)
            assert base in known, f"{where}: there is no metric {name}"
            used.add(base)
            labels = set(re.findall(r"(\w+)\s*[=!]", selector))
            if name in seen:
                assert labels - ADDED <= seen[name], f"{where}: {name} has no label {labels - ADDED - seen[name]}"
    with tempfile.NamedTemporaryFile("w", suffix=".yml") as file:
        file.write("\n".join(lines) + "\n")
        file.flush()
        done = subprocess.run([PROMTOOL, "check", "rules", file.name], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    # What nobody looks at is of no use: all but what is counted for other ends is on a dashboard or in an alert.
    unused = known - used - {"plenalign_picture_encoder_info"}
    assert not unused, f"neither on a dashboard nor in an alert: {sorted(unused)}"
    print(f"- {len(boards)} dashboards and the alerts: {len(expressions)} expressions, of {len(used)} metrics")


main()
