#!/usr/bin/env python3
"""The notices of what the program contains of others: crates and the page's modules, with the licence files they ship.

Printed as one text; texts that several share are printed once."""

import json
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
NAMES = ("license", "licence", "copying", "notice", "copyright")


def crates():
    """Name, version, licence and folder of every crate in the program."""
    arguments = ["cargo", "metadata", "--format-version", "1", "--locked", "--filter-platform"]
    host = subprocess.run(["rustc", "-vV"], check=True, capture_output=True, text=True).stdout
    arguments.append(next(line.split()[1] for line in host.splitlines() if line.startswith("host:")))
    told = json.loads(subprocess.run(arguments, check=True, capture_output=True, cwd=ROOT).stdout)
    packages = {package["id"]: package for package in told["packages"]}
    nodes = {node["id"]: node for node in told["resolve"]["nodes"]}
    reached, waiting = set(), [told["resolve"]["root"]]
    while waiting:
        name = waiting.pop()
        if name in reached:
            continue
        reached.add(name)
        for dependency in nodes[name]["deps"]:
            # What only builds or tests the program is not in it.
            if any(kind["kind"] is None for kind in dependency["dep_kinds"]):
                waiting.append(dependency["pkg"])
    for package in (packages[name] for name in reached):
        if package["source"] is not None:
            folder = pathlib.Path(package["manifest_path"]).parent
            yield package["name"], package["version"], package["license"] or "see its licence file", folder


def modules():
    """The same of what the page is built from and carries along."""
    sources = [file.read_text() for file in (ROOT / "web/src").rglob("*.ts*")]
    imported = re.findall(r'\b(?:from|import)\s*\(?"(@[\w.-]+/[\w.-]+|[\w-][\w.-]*)', "\n".join(sources))
    for name in sorted(set(imported)):
        folder = ROOT / "web/node_modules" / name
        if not folder.is_dir():
            sys.exit(f"third-party: {folder} is missing: `make web` first")
        told = json.loads((folder / "package.json").read_text())
        yield name, told["version"], told.get("license", "see its licence file"), folder


def texts(folder):
    """What a folder ships of licences."""
    for file in sorted(folder.iterdir()):
        if file.is_file() and any(name in file.name.lower() for name in NAMES):
            yield file.read_text(errors="replace").strip()


def main():
    shared, contained = {}, sorted([*crates(), *modules()])
    print("Plenalign contains the following, each under its own licence. The texts follow the list.\n")
    for name, version, licence, folder in contained:
        print(f"{name} {version}: {licence}")
        for text in texts(folder):
            shared.setdefault(text, []).append(f"{name} {version}")
    for text, of in shared.items():
        print(f"\n{'-' * 80}\n{', '.join(of)}\n\n{text}")


if __name__ == "__main__":
    main()
