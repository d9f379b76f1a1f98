"""One table of ratios of everything that `make bench` has timed, with the machine it was timed on.

Every criterion benchmark has its median, the target where it has one, and how many plain sums of the same frame it took:
the plain sum is the limit that the machine's memory sets. The encoder in Rust stands beside libjpeg-turbo, and OpenCV with
NumPy beside this program, by time and by error.

    table.py [--criterion DIR] [--since FILE] [--comparison FILE] [--pace FILE] [--page FILE] [--partial] OUT

Reads criterion's results below DIR (target/criterion), only those newer than FILE where one is given, so that a benchmark
that is no longer there does not linger; the figures that benches/compare/opencv.py left; and those of benches/pace/main.rs.
Writes the table to OUT, prints it, and puts it between the two marks of the page. Needs nothing but Python: criterion's
results are JSON, and there is nothing to build.
"""

import argparse
import json
import math
import os
import platform
import re
import subprocess
import sys
import time
from pathlib import Path

# What a benchmark is to stay below, by its full name, and why. A name that no benchmark has is an error: a benchmark that
# is renamed takes its target along.
TARGETS_MS = {
    # A camera's frame rate, live: 30 a second of 12 megapixels, and a small part of the time between two of 1160².
    "live/measure 4096x3072": 33.0,
    "live/measure 1160x1160": 4.0,
    # The first grid of a large frame: hardly a pause.
    "grid/find white square 4096x3072": 400.0,
    "grid/find white hexagonal 4096x3072": 400.0,
    "grid/find textured square 4096x3072": 400.0,
    "grid/find textured hexagonal 4096x3072": 400.0,
    # Pictures to be watched: 15 a second, and a large one within a second.
    "views/central view and depth 1160x1160": 1000.0 / 15.0,
    "views/central view and depth 4096x3072": 1000.0,
    # What a simulated camera takes: about a second for a full frame, 15 a second for the preview.
    "frame 1160x1160/water, 64 rays": 1000.0,
    "frame 1160x1160/preview, 4 rays, moving, exposed": 1000.0 / 15.0,
}
# What is compared with the usual tools, in which unit, and how many times as fast or accurate it is to be: the geometric
# mean over the frames. One measurement has to be both faster and more accurate: the live one.
FIGURES = {
    "grid_ms": ("grid, time", "ms", None),
    "grid_error_px": ("grid, error", "px", None),
    "spacing_ms": ("spacing, time", "ms", None),
    "spacing_error_px": ("spacing, error", "px", 5.0),
    "live_ms": ("spacing live, time", "ms", 20.0),
    "live_error_px": ("spacing live, error", "px", 5.0),
}
# Criterion's names of the encoders: the one that is timed beside the other.
ENCODERS = ("libjpeg-turbo", "jpeg-encoder")
PLAIN_SUM = "plain sum"
# Below this an error is none, and a ratio to it means nothing.
LEAST = 1e-9

BEGIN = "<!-- The table of `make bench` begins: written by benches/table.py, not by hand. -->"
END = "<!-- The table of `make bench` ends. -->"

HEADINGS = ["benchmark", "here", "target", "of the target", "plain sums", "beside", "theirs", "theirs / here"]


class Wrong(Exception):
    """What there is cannot be made into the table."""


def criterion_medians(folder, since):
    """Median times (ms) by full name, in criterion's order of names."""
    medians = {}
    for path in sorted(folder.glob("**/new/estimates.json")):
        if since is not None and path.stat().st_mtime < since:
            continue
        try:
            name = json.loads((path.parent / "benchmark.json").read_text())
            estimates = json.loads(path.read_text())
            full = f"{name['group_id']}/{name['function_id']}"
            medians[full] = estimates["median"]["point_estimate"] / 1e6
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise Wrong(f"{path}: not as criterion writes it: {error!r}") from error
    if not medians:
        newer = "" if since is None else " that is newer than this run"
        raise Wrong(f"{folder}: there is no result of criterion{newer}; run `cargo bench` first")
    return medians


def figure(value, unit):
    """A figure with its unit, in four digits."""
    if not math.isfinite(value):
        return "none"
    if unit == "ms":
        for limit, scale, of in [(1e-3, 1e6, "ns"), (1.0, 1e3, "µs"), (1e3, 1.0, "ms"), (math.inf, 1e-3, "s")]:
            if value < limit:
                return f"{digits(value * scale)} {of}"
    return f"{digits(value)} {unit}".strip()


def digits(value):
    """A number in three digits or more, without an exponent."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    return f"{value:.{max(0, 2 - math.floor(math.log10(abs(value))))}f}"


def against(value, target):
    """How much of a target in time is used, and whether that is too much."""
    share = f"{100.0 * value / target:.0f} %"
    return share if value <= target else f"**{share}: missed**"


def criterion_rows(medians):
    """A row for every benchmark."""
    rows = []
    for full, median in medians.items():
        group, _, name = full.partition("/")
        size = re.search(r"\d+x\d+", name) or re.search(r"\d+x\d+", group)
        cells = {"benchmark": f"{group}: {name}", "here": figure(median, "ms")}
        target = TARGETS_MS.get(full)
        if target is not None:
            cells["target"] = f"≤ {figure(target, 'ms')}"
            cells["of the target"] = against(median, target)
        plain = medians.get(f"{group}/{PLAIN_SUM} {size.group()}") if size else None
        if plain is not None:
            cells["plain sums"] = digits(median / plain)
        ours, theirs = ENCODERS
        if name.startswith(f"{ours} "):
            other = medians.get(f"{group}/{name.replace(ours, theirs, 1)}")
            if other is not None:
                cells |= beside("the encoder in Rust", other, median, "ms")
        rows.append(cells)
    return rows


def beside(who, theirs, ours, unit):
    """The cells of a comparison."""
    ratio = theirs / max(ours, LEAST)
    # Where one of them found nothing there is no ratio.
    return {"beside": who, "theirs": figure(theirs, unit), "theirs / here": digits(ratio) if math.isfinite(ratio) else ""}


def pace_rows(lines):
    """Rows of the daemon and one client, end to end."""
    rows = []
    for line in lines:
        least, found, wanted, unit = line["at_least"], line["found"], line["wanted"], line["unit"]
        reached = found >= wanted if least else found <= wanted
        share = f"{100.0 * found / wanted:.0f} %"
        rows.append(
            {
                "benchmark": f"daemon {line['camera']}: {line['what']}",
                "here": f"{digits(found)} {unit}",
                "target": f"{'≥' if least else '≤'} {wanted:g} {unit}",
                "of the target": share if reached else f"**{share}: missed**",
            }
        )
    return rows


def comparison_rows(comparison):
    """Rows of this program beside the usual tools, frame by frame, and the geometric mean of each ratio."""
    tools = comparison["tools"]
    rows, ratios = [], {key: [] for key in FIGURES}
    for frame in comparison["frames"]:
        for key, (what, unit, _) in FIGURES.items():
            if key not in frame["ours"]:
                continue
            ours, theirs = frame["ours"][key], frame["theirs"][key]
            cells = {"benchmark": f"compare: {what}, {frame['name']}", "here": figure(ours, unit)}
            rows.append(cells | beside(tools, theirs, ours, unit))
            ratio = theirs / max(ours, LEAST)
            if math.isfinite(ratio):
                ratios[key].append(math.log(max(ratio, LEAST)))
    for key, (what, _, least) in FIGURES.items():
        if not ratios[key]:
            continue
        mean = math.exp(sum(ratios[key]) / len(ratios[key]))
        cells = {"benchmark": f"compare: {what}, geometric mean", "beside": tools, "theirs / here": digits(mean)}
        if least is not None:
            share = f"{digits(mean / least)} ×"
            cells["target"] = f"≥ {least:.0f} ×"
            cells["of the target"] = share if mean >= least else f"**{share}: missed**"
        rows.append(cells)
    return rows


def first_line(command):
    """What a command says first; `unknown` where there is no such command."""
    try:
        said = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    lines = said.stdout.splitlines()
    return lines[0].strip() if lines else ""


def field(path, name):
    """The value of the first line `name: value` of a file."""
    try:
        text = Path(path).read_text()
    except OSError:
        return None
    found = re.search(rf"^{re.escape(name)}\s*:\s*(.+)$", text, re.MULTILINE)
    return found.group(1).strip() if found else None


def head(comparison, load):
    """The machine, the date, the compiler and the commit, line by line."""
    memory = field("/proc/meminfo", "MemTotal")
    memory = f"{int(memory.split()[0]) / 2**20:.1f} GiB" if memory else "unknown"
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    changed = first_line(["git", "status", "--porcelain", "--untracked-files=no"]) not in ("", "unknown")
    name, model = os.environ.get("BENCH_MACHINE"), field("/proc/cpuinfo", "model name") or platform.machine()
    lines = [
        ("machine", f"{f'{name}: ' if name else ''}{model}, {cores} cores, {memory} of memory"),
        ("system", f"{platform.system()} {platform.release()}"),
        ("date", time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime())),
        ("compiler", first_line(["rustc", "--version"])),
        ("commit", first_line(["git", "rev-parse", "--short=12", "HEAD"]) + (", with changes" if changed else "")),
    ]
    if load:
        lines.append(("load before", f"{load} (average number of running tasks, of 1, 5 and 15 minutes)"))
    if comparison is not None:
        lines.append(("compared with", ", ".join(comparison["versions"])))
    return [f"- {name}: {value}" for name, value in lines]


def table(rows):
    """Rows as Markdown."""
    cells = [HEADINGS] + [[row.get(heading, "").replace("|", "\\|") for heading in HEADINGS] for row in rows]
    widths = [max(len(line[k]) for line in cells) for k in range(len(HEADINGS))]
    # Names to the left, figures to the right.
    left = {HEADINGS.index("benchmark"), HEADINGS.index("beside")}
    lines = [
        "| " + " | ".join(c.ljust(w) if k in left else c.rjust(w) for k, (c, w) in enumerate(zip(line, widths))) + " |"
        for line in cells
    ]
    rule = ["-" * w if k in left else "-" * (w - 1) + ":" for k, w in enumerate(widths)]
    lines.insert(1, "| " + " | ".join(rule) + " |")
    return lines


def put_into(page, text):
    """Replaces what stands between the page's marks."""
    before, begin, rest = page.read_text().partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise Wrong(f"{page}: has no place for the table: the lines\n{BEGIN}\n{END}")
    partial = page.with_name(page.name + ".partial")
    partial.write_text(f"{before}{BEGIN}\n\n{text}\n{END}{after}")
    partial.replace(page)


def main(arguments):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--criterion", type=Path, default=Path("target/criterion"), metavar="DIR")
    parser.add_argument("--since", type=Path, metavar="FILE", help="made when the run began; may hold the load then")
    parser.add_argument("--comparison", type=Path, metavar="FILE", help="the figures of benches/compare/opencv.py")
    parser.add_argument("--pace", type=Path, metavar="FILE", help="the figures of benches/pace/main.rs")
    parser.add_argument("--page", type=Path, metavar="FILE", help="the page to put the table into")
    parser.add_argument("--partial", action="store_true", help="not every benchmark was run: a target may have none")
    parser.add_argument("out", type=Path, metavar="OUT")
    given = parser.parse_args(arguments)
    try:
        since = given.since.stat().st_mtime if given.since else None
        load = given.since.read_text().strip() if given.since else ""
        medians = criterion_medians(given.criterion, since)
        nowhere = [name for name in TARGETS_MS if name not in medians]
        if nowhere and not given.partial:
            raise Wrong(f"there is a target, but no benchmark was run, of: {'; '.join(nowhere)}")
        comparison = json.loads(given.comparison.read_text()) if given.comparison else None
        pace = json.loads(given.pace.read_text()) if given.pace else []
        rows = criterion_rows(medians) + pace_rows(pace)
        rows += comparison_rows(comparison) if comparison is not None else []
        text = "\n".join([*head(comparison, load), "", *table(rows)]) + "\n"
        given.out.parent.mkdir(parents=True, exist_ok=True)
        given.out.write_text(text)
        print(text, end="")
        if given.page:
            put_into(given.page, text)
    except (Wrong, OSError, ValueError) as error:
        print(f"table: {error}", file=sys.stderr)
        return 1
    except KeyError as error:
        print(f"table: {given.comparison}: has no {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
