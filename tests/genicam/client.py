"""What a daemon shows of Aravis's camera: its frames, sample for sample, its state, and what it counts.

client.py ADDRESS online | fault WORDS | frames COUNT | counted | devices
"""

import concurrent.futures
import json
import struct
import sys
import time
import urllib.error
import urllib.request
import zlib

ADDRESS = sys.argv[1]
PATIENCE_S = 30


def get(path):
    with urllib.request.urlopen(ADDRESS + path, timeout=10) as answer:
        return answer.headers, answer.read()


def camera():
    return json.loads(get("/api/v1/bench")[1])["camera"]


def until(what, holds):
    end = time.monotonic() + PATIENCE_S
    while True:
        now = camera()
        if holds(now):
            return now
        if time.monotonic() > end:
            sys.exit(f"the camera is not {what}: {now}")
        time.sleep(0.05)


def rows(png):
    """The rows of a PNG of 8 bits of grey."""
    assert png[:8] == b"\x89PNG\r\n\x1a\n"
    at, data, width, height = 8, b"", 0, 0
    while at < len(png):
        length, kind = struct.unpack(">I4s", png[at : at + 8])
        body = png[at + 8 : at + 8 + length]
        if kind == b"IHDR":
            width, height, depth, colour = struct.unpack(">IIBB", body[:10])
            assert (depth, colour) == (8, 0), (depth, colour)
        elif kind == b"IDAT":
            data += body
        at += 12 + length
    data = zlib.decompress(data)
    before = bytes(width)
    for y in range(height):
        line = data[y * (width + 1) : (y + 1) * (width + 1)]
        method, now = line[0], bytearray(line[1:])
        for x in range(width):
            left, up, corner = (now[x - 1] if x else 0), before[x], (before[x - 1] if x else 0)
            if method == 1:
                now[x] = (now[x] + left) & 255
            elif method == 2:
                now[x] = (now[x] + up) & 255
            elif method == 3:
                now[x] = (now[x] + (left + up) // 2) & 255
            elif method == 4:
                guess = left + up - corner
                near = min((left, up, corner), key=lambda of: abs(guess - of))
                now[x] = (now[x] + near) & 255
        before = bytes(now)
        yield before


RAMP = bytes(of % 255 for of in range(255 * 3))


def check_whole(png):
    """Aravis's picture is a ramp along the diagonal, modulo 255, and starts one higher with each frame. A packet that did not
    come leaves zeros in it."""
    lines = list(rows(png))
    assert (len(lines[0]), len(lines)) == (256, 200), (len(lines[0]), len(lines))
    first = lines[0][0]
    for y, line in enumerate(lines):
        at = (first + y) % 255
        assert line == RAMP[at : at + len(line)], f"row {y} of a frame is not whole"
    return first


def frames(count):
    """So many frames, each looked at."""
    end = time.monotonic() + PATIENCE_S
    seen = {}
    while len(seen) < count:
        assert time.monotonic() < end, f"{len(seen)} frames in {PATIENCE_S} s"
        try:
            headers, png = get("/api/v1/frame.png")
        except urllib.error.HTTPError as error:
            # Between two frames of which the one before is too old.
            assert error.code == 503, error.code
            continue
        seq = int(headers["plenalign-frame-seq"])
        # Aravis's camera has no clock that can be read: times are assumed, and said to be.
        assert headers["plenalign-exposure-assumed"] == "true", dict(headers)
        assert headers["plenalign-simulated"] == "false", dict(headers)
        if seq not in seen:
            seen[seq] = check_whole(png)
    assert len(set(seen.values())) == count, "the same picture again and again"
    return len(seen)


def counted():
    now = until("losing frames", lambda state: state["frames_damaged"] > 0)
    assert now["frames_lost"] >= now["frames_damaged"], now
    metrics = get("/metrics")[1].decode()
    told = [line.split()[1] for line in metrics.splitlines() if line.startswith("plenalign_frames_damaged_total")]
    assert told and float(told[0]) > 0, told
    return now["frames_damaged"]


def devices():
    """Two cameras are listed with their formats, however many ask at once: the daemon's own, and one that it has no part in."""
    with concurrent.futures.ThreadPoolExecutor(8) as threads:
        answers = list(threads.map(lambda _: json.loads(get("/api/v1/devices")[1]), range(8)))
    answers.append(json.loads(get("/api/v1/devices")[1]))
    for found in answers:
        cameras = {camera["path"]: camera for camera in found["cameras"]}
        assert len(cameras) == len(found["cameras"]), found
        own, other = cameras["10.9.0.2"], cameras["10.7.0.2"]
        assert own["names"][0] == "serial:PLN-1" and own["unusable"] is None and "Mono16" in own["formats"], own
        assert other["names"][0] == "serial:PLN-3" and other["unusable"] is None, other
        assert other["formats"] == OFFERED, other
        assert len(found["notes"]) == 1 and '"no-such-cable"' in found["notes"][0], found


# What of the other camera's formats is read.
OFFERED = ["Mono8", "Mono12Packed", "Mono12p"]


def main():
    what, more = sys.argv[2], sys.argv[3:]
    if what == "online":
        state = until("online", lambda state: state["online"])
        assert state["driver"] == "genicam" and "Aravis Fake (PLN-1" in state["identity"], state
    elif what == "fault":
        until(f"faulty with {more[0]!r}", lambda state: not state["online"] and more[0] in (state["fault"] or ""))
    elif what == "frames":
        print(frames(float(more[0])))
    elif what == "counted":
        print(counted())
    elif what == "devices":
        devices()
    else:
        sys.exit(f"{what}?")


main()
