"""The twins and the daemon that drives them, for programs that stand in for the operator."""

import json
import os
import subprocess
import sys
import time
import urllib.error
import urllib.request

# How long anything may take, s: a large camera's frames are long in rendering.
PATIENCE_S = float(os.environ.get("PATIENCE_S", "120"))


class Camera:
    """The twin: a line to it, a line from it."""

    def __init__(self, command):
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
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
    """The daemon, asked as the holder of the control lease."""

    key = ""

    def __init__(self, address):
        self.address = address

    def take_lease(self):
        self.key = self.ask("POST", "/lease", {"owner": "the twins' operator", "ttl_s": 3600})["key"]

    def ask(self, method, path, body=None):
        headers = {"content-type": "application/json", "plenalign-lease": self.key}
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(f"{self.address}/api/v1{path}", data, headers, method=method)
        try:
            with urllib.request.urlopen(request, timeout=60) as answer:
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


def state(daemon):
    return daemon.ask("GET", "/bench")["camera"]
