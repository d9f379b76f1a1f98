"""Reads a recording with nothing but what it holds: every topic, its schemas, its figures against the job's own."""

import json
import sys

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

SCHEMAS = {
    "/job/start": "plenalign.v1.JobStart",
    "/job/frame": "plenalign.v1.FrameInfo",
    "/camera/raw": "foxglove.RawImage",
    "/camera/view": "foxglove.CompressedImage",
    "/camera/annotations": "foxglove.ImageAnnotations",
    "/bench/transform": "foxglove.FrameTransform",
    "/bench/pose": "foxglove.PoseInFrame",
    "/log": "foxglove.Log",
    "/job/measurement": "plenalign.v1.Measurement",
    "/meter/reading": "plenalign.v1.MeterReading",
    "/job/decision": "plenalign.v1.Decision",
    "/job/answer": "plenalign.v1.Answer",
    "/job/end": "plenalign.v1.JobEnd",
}


def main(path: str, report: str, bits: int) -> None:
    with open(report, encoding="utf-8") as file:
        job = json.load(file)
    read: dict[str, list] = {topic: [] for topic in SCHEMAS}
    times = []
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        header, summary = reader.get_header(), reader.get_summary()
        assert header.profile == "plenalign" and header.library.startswith("plenalign "), header
        metadata = {one.name: one.metadata for one in reader.iter_metadata()}["plenalign"]
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            assert schema.encoding == channel.message_encoding == "protobuf"
            assert schema.name == SCHEMAS[channel.topic], channel.topic
            read[channel.topic].append(decoded)
            times.append(message.log_time)
    missing = [topic for topic, messages in read.items() if not messages]
    assert not missing, f"nothing on {missing}"
    counted = {summary.channels[id].topic: count for id, count in summary.statistics.channel_message_counts.items()}
    assert counted == {topic: len(messages) for topic, messages in read.items()}, counted
    assert times == sorted(times), "messages are in the order in which they were made"

    assert metadata["simulated"] == "true" and metadata["bench"] == "SIMULATED" and metadata["seed"] == "7", metadata
    assert metadata["job"] == job["job"] and metadata["version"], metadata
    assert "[server" not in metadata["configuration"] and "width_px = 560" in metadata["configuration"]

    iterations, decisions = job["iterations"], read["/job/decision"]
    assert len(decisions) == len(iterations) > 5, (len(decisions), len(iterations))
    for decision, iteration in zip(decisions, iterations):
        assert decision.number == iteration["number"] and decision.decision == iteration["decision"]
        assert decision.spacing.spacing_px == iteration["spacing"]["spacing_px"], decision
    assert decisions[-1].spacing.spacing_px == job["spacing_px"]
    assert len(read["/job/measurement"]) == len(read["/camera/annotations"]) >= len(decisions)

    readings = read["/meter/reading"]
    measured = [reading for reading in readings if reading.state == "measured"]
    assert measured and all(5 < reading.spacing.spacing_px < 60 for reading in measured), len(readings)
    assert all(reading.HasField("spacing") != bool(reading.why) for reading in readings)

    frames, infos = read["/camera/raw"], read["/job/frame"]
    assert len(frames) == len(infos) >= len(decisions)
    size = 1 if bits == 8 else 2
    for frame, info in zip(frames, infos):
        assert (frame.width, frame.height, frame.step) == (560, 560, 560 * size)
        assert frame.encoding == ("mono8" if bits == 8 else "mono16") and info.bits == bits
        assert len(frame.data) == 560 * 560 * size
        if size == 2:
            brightest = max(memoryview(frame.data).cast("H"))
            assert 255 < brightest < 1 << bits, brightest
    assert all(picture.data.startswith(b"\xff\xd8") for picture in read["/camera/view"])

    # Frames of reference hang together, and the camera ends where the job's report has it.
    parents = {transform.child_frame_id: transform.parent_frame_id for transform in read["/bench/transform"]}
    assert parents == {"camera": "bench", "mla": "camera"}, parents
    end_mm = -1000 * read["/bench/pose"][-1].pose.position.z
    assert abs(end_mm - job["e_readback_mm"]) < 1e-6, end_mm
    lines = [line.message for line in read["/log"]]
    assert "SIMULATED bench: no real device is driven" in lines
    [end] = read["/job/end"]
    assert end.state == job["outcome"] == "converged" and end.reason == job["reason"]
    print(f"mcap: {sum(counted.values())} messages on {len(counted)} topics, {len(frames)} frames of {bits} bits")


main(sys.argv[1], sys.argv[2], int(sys.argv[3]))
