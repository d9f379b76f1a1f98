"""Runs the commands of Markdown pages, page by page, each page's in one shell and in a folder of its own.

A block of `sh` is run. What it prints is compared with the block of `text` right after it; without one it has to print
nothing. In that block `…` stands for anything within its line, and alone on a line for any number of lines.

In a comment on the line before a block:

    <!-- not run: REASON -->     of a block of sh: it is not run
    <!-- in this form: REASON -->   of a block of text: each of its lines comes, in this order, with other numbers, and with
                                    other lines between; here what is said on standard error counts, too
    <!-- file: NAME -->          of any other block: it is written to that file
    <!-- run with: ARGUMENTS --> of a block of sh: each `plenalign` in it gets these, too (a smaller sensor, for one)

and anywhere, for what a page takes for granted:

    <!-- setup
    COMMANDS
    -->

SHOW=1 shows what each block prints. Beside the commands of a page, `tests/docs/after/PAGE.sh` looks in its folder at what they have left.
"""

import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

# Pages whose commands are run: no other page's are, so that nothing is run that was not meant to be.
PAGES = [
    "CONTRIBUTING.md",
    "SECURITY.md",
    "docs/align.md",
    "docs/api.md",
    "docs/connect.md",
    "docs/curl.md",
    "docs/getting-started.md",
    "docs/operations.md",
    "docs/views.md",
    "docs/write-a-driver.md",
]
# A page's commands may take so long, s.
ALLOWED_S = 300
# Pages at once: most of their time they wait for axes.
AT_ONCE = 4
FENCE = re.compile(r"^```(\S*)\s*$")
MARK = re.compile(r"^<!-- (not run|in this form|file|run with): (.+) -->$")
NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")


class Wrong(Exception):
    """A page that cannot be run as it stands."""


@dataclass
class Block:
    """Commands of a page, and what they print."""

    line: int
    commands: str
    printed: list[str] = field(default_factory=list)
    in_this_form: bool = False


@dataclass
class Page:
    """What a page has to be run."""

    name: str
    steps: list[Block]
    not_run: int


def read(path: Path, name: str) -> Page:
    """Reads a page."""
    page = Page(name, [], 0)
    mark: tuple[str, str] | None = None
    kind: str | None = None
    setup: list[str] | None = None
    lines: list[str] = []
    begin = 0
    # The block of sh that a block of text may still belong to.
    asked: Block | None = None
    for number, line in enumerate(path.read_text().splitlines(), 1):
        if setup is not None:
            if line == "-->":
                page.steps.append(Block(number, "\n".join(setup)))
                setup = None
            else:
                setup.append(line)
            continue
        fence = FENCE.match(line)
        if kind is None and line == "<!-- setup":
            setup = []
        elif kind is None and fence:
            kind, lines, begin = fence[1], [], number
        elif kind is None:
            if found := MARK.match(line):
                mark = (found[1], found[2])
            elif mark and line:
                raise Wrong(f"{name}:{number}: `{mark[0]}` has to stand right before its block")
            elif line:
                asked = None
        elif line == "```":
            asked = take(page, begin, kind, lines, mark, asked)
            kind, mark = None, None
        else:
            lines.append(line)
    if kind is not None or setup is not None:
        raise Wrong(f"{name}: a block has no end")
    return page


def take(page: Page, line: int, kind: str, lines: list[str], mark: tuple[str, str] | None, asked: Block | None) -> Block | None:
    """Takes in a block; gives the one that a block of text may follow."""
    what, word = mark or (None, "")
    if what == "not run":
        page.not_run += 1
        return None
    if what == "file":
        end = f"END-OF-{random.randrange(10**9)}"
        text = "\n".join([f"cat >'{word}' <<'{end}'", *lines, end])
        page.steps.append(Block(line, text))
        return None
    if kind == "sh":
        commands = "\n".join(lines)
        if what == "run with":
            commands = f"export DOCS_WITH='{word}'\n{commands}\nunset DOCS_WITH"
        block = Block(line, commands)
        page.steps.append(block)
        return block
    if kind == "text" and asked:
        asked.printed, asked.in_this_form = lines, what == "in this form"
    return None


def pattern(lines: list[str]) -> re.Pattern[str]:
    """What a block of text stands for."""
    parts = []
    for line in lines:
        if line == "…":
            parts.append(r"(?:.*\n)*")
        else:
            parts.append(re.escape(line).replace("…", ".*") + r"\n")
    return re.compile("".join(parts))


def prints(block: Block, got: str) -> bool:
    """Whether a block has printed what its page says."""
    if not block.in_this_form:
        return pattern(block.printed).fullmatch(got) is not None
    # Columns are as wide as their numbers.
    form = [" ".join(NUMBER.sub("0", line).split()) for line in got.splitlines()]
    for line in block.printed:
        wanted = " ".join(NUMBER.sub("0", line).split())
        while form and not form[0].startswith(wanted):
            form.pop(0)
        if not form:
            return False
        form.pop(0)
    return True


def run(page: Page, root: Path) -> str:
    """Runs a page and says how it went; raises what is wrong with it."""
    with tempfile.TemporaryDirectory(prefix="plenalign-docs-") as made:
        folder = Path(made)
        work, said, programs = folder / "work", folder / "said", folder / "bin"
        for each in (work, said, programs):
            each.mkdir()
        for there in ("deploy", "docs", "clients", "proto"):
            (work / there).symlink_to(root / there)
        program = programs / "plenalign"
        program.write_text(f'#!/bin/sh\nexec "{root}/target/debug/plenalign" "$@" $DOCS_WITH\n')
        program.chmod(0o755)
        script = []
        for number, block in enumerate(page.steps):
            script += [f"exec >'{said}/{number}'", f"echo '== {page.name}:{block.line}' >&2"]
            script += ["exec 9>&2 2>&1", block.commands, "exec 2>&9 9>&-"] if block.in_this_form else [block.commands]
        (folder / "page.sh").write_text("\n".join(script) + "\n")
        environment = {name: value for name, value in os.environ.items() if not name.startswith(("PLENALIGN_", "DOCS_"))}
        environment |= {
            "PATH": f"{programs}:{environment['PATH']}",
            "HOME": str(folder),
            "PLENALIGN_STATE_DIR": str(folder / "state"),
            "LISTEN": f"127.0.0.1:{random.randrange(20_000, 30_000)}",
            "NO_COLOR": "1",
        }
        begun = time.monotonic()
        with (folder / "errors").open("wb") as errors:
            shell = subprocess.Popen(
                ["bash", "-euo", "pipefail", folder / "page.sh"],
                cwd=work, env=environment, stdin=subprocess.DEVNULL, stderr=errors, start_new_session=True,
            )  # fmt: skip
            try:
                status = shell.wait(ALLOWED_S)
            except subprocess.TimeoutExpired:
                status = None
            finally:
                # Daemons of a page that has failed are in its shell's group.
                try:
                    os.killpg(shell.pid, signal.SIGKILL)
                except ProcessLookupError:
                    pass
                shell.wait()
        heard = (folder / "errors").read_text(errors="replace")
        ended = "is not over" if status is None else f"ended with {status}"
        for number, block in enumerate(page.steps):
            out = said / str(number)
            if not out.exists():
                raise Wrong(f"{page.name}:{block.line}: never begun; the page {ended}:\n{tail(heard, work)}")
            got = out.read_text(errors="replace")
            if os.environ.get("SHOW"):
                print(f"{page.name}:{block.line}\n{indented(got)}")
            last = number + 1 == len(page.steps) or not (said / str(number + 1)).exists()
            if not prints(block, got) or (last and status != 0):
                wanted = "\n".join(block.printed) or "(nothing)"
                raise Wrong(
                    f"{page.name}:{block.line}: should print\n{indented(wanted)}\nand printed\n{indented(got)}\n"
                    f"the page {ended}:\n{tail(heard, work)}"
                )
        after = root / "tests/docs/after" / f"{Path(page.name).stem}.sh"
        if after.exists():
            looked = subprocess.run(["bash", "-euo", "pipefail", after], cwd=work, capture_output=True, text=True, check=False)
            if looked.returncode != 0:
                raise Wrong(f"{page.name}: {after.name} finds it wrong:\n{looked.stdout}{looked.stderr}")
        return f"{time.monotonic() - begun:5.0f} s  {page.name}: {len(page.steps)} blocks ran, {page.not_run} marked as not run"


def indented(text: str) -> str:
    """Text set in."""
    return "\n".join("    " + line for line in text.rstrip("\n").split("\n"))


def tail(heard: str, work: Path) -> str:
    """The end of what was said on standard error, and of the daemon's log."""
    log = work / "serve.log"
    logged = log.read_text(errors="replace") if log.exists() else ""
    return indented("\n".join((heard.splitlines() + logged.splitlines())[-30:]))


def main() -> int:
    """Runs the pages named, or all."""
    root, names = Path(sys.argv[1]), sys.argv[2:] or PAGES
    failed = False
    try:
        pages = [page for name in names if (page := read(root / name, name)).steps or page.not_run]
    except Wrong as wrong:
        print(f"docs: {wrong}", file=sys.stderr)
        return 1
    with ThreadPoolExecutor(AT_ONCE) as pool:
        for page, going in [(page, pool.submit(run, page, root)) for page in pages if page.steps]:
            try:
                print(f"docs: {going.result()}", flush=True)
            except Wrong as wrong:
                failed = True
                print(f"docs: {wrong}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
