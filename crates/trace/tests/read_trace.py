#!/usr/bin/env python3
"""Reads a trace with the `mcap` packages of PyPI, which share no code with its writer, and checks it.

    pip install mcap mcap-protobuf-support
    python read_trace.py FILE [--expect-samples N] [--expect-steps N]

Decodes every message of every channel by the schema in the file, checks the schemas' names, that times do not run
backwards within a topic, and that message counts agree with the statistics; prints a table. Exit code 1 on any
finding, 2 when the file cannot be read.
"""

import argparse
import math
import struct
import sys
from collections import defaultdict

from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

SCHEMAS = {
    "/tf": "foxglove.FrameTransforms",
    "/tool/pose": "foxglove.PoseInFrame",
    "/tool/shape": "foxglove.SceneUpdate",
    "/haptic/sample": "palpate.HapticSample",
    "/sim/step": "palpate.Step",
    "/factor/event": "palpate.Factor",
    "/tissue/surface": "foxglove.SceneUpdate",
    "/tissue/nodes": "foxglove.PointCloud",
    "/log": "foxglove.Log",
}


class Findings(list):
    def check(self, condition, text):
        if not condition:
            self.append(text)


def check_timestamp(findings, topic, log_time, stamp):
    ns = stamp.seconds * 1_000_000_000 + stamp.nanos
    findings.check(ns == log_time, f"{topic}: timestamp {ns} differs from log time {log_time}")


def check_sample(findings, sample, start_ns, log_time, previous):
    findings.check(start_ns + sample.time_ns == log_time, f"tick {sample.tick}: time_ns and log time differ")
    for name in ("device_position", "tool_position", "force", "torque"):
        vector = getattr(sample, name)
        finite = all(math.isfinite(x) for x in (vector.x, vector.y, vector.z))
        findings.check(finite, f"tick {sample.tick}: {name} is not finite")
    q = sample.tool_orientation
    norm = math.sqrt(q.x**2 + q.y**2 + q.z**2 + q.w**2)
    findings.check(abs(norm - 1) < 1e-6, f"tick {sample.tick}: the tool's quaternion has norm {norm}")
    if previous is not None:
        findings.check(sample.tick > previous, f"tick {sample.tick} follows tick {previous}")


def check_surface(findings, update, log_time):
    findings.check(len(update.entities) > 0, "/tissue/surface: no entity")
    for entity in update.entities:
        check_timestamp(findings, "/tissue/surface", log_time, entity.timestamp)
        for triangles in entity.triangles:
            points, indices = len(triangles.points), list(triangles.indices)
            findings.check(len(indices) % 3 == 0, f"{entity.id}: {len(indices)} indices")
            findings.check(all(i < points for i in indices), f"{entity.id}: index beyond {points} points")
            finite = all(math.isfinite(c) for p in triangles.points for c in (p.x, p.y, p.z))
            findings.check(finite, f"{entity.id}: a vertex is not finite")


def check_nodes(findings, cloud, log_time):
    check_timestamp(findings, "/tissue/nodes", log_time, cloud.timestamp)
    names = [field.name for field in cloud.fields]
    findings.check(names == ["x", "y", "z", "displacement"], f"/tissue/nodes: fields {names}")
    findings.check(len(cloud.data) % cloud.point_stride == 0, "/tissue/nodes: ragged data")
    for point in struct.iter_unpack("<4f", cloud.data):
        findings.check(point[3] >= 0, f"/tissue/nodes: displacement {point[3]}")


def check_message(findings, topic, message, log_time, start_ns, state):
    if topic == "/haptic/sample":
        check_sample(findings, message, start_ns, log_time, state.get("tick"))
        state["tick"] = message.tick
    elif topic in ("/sim/step", "/factor/event"):
        findings.check(start_ns + message.time_ns == log_time, f"{topic}: time_ns and log time differ")
        key = "step" if topic == "/sim/step" else "epoch"
        number, previous = getattr(message, key), state.get(key)
        findings.check(previous is None or number > previous, f"{key} {number} follows {previous}")
        state[key] = number
        # NaN where a step measured nothing; factors, and traces from before it was kept, have no such field.
        error = getattr(message, "force_error", math.nan)
        findings.check(not error < 0, f"{key} {number}: force error {error}")
    elif topic == "/tissue/surface":
        check_surface(findings, message, log_time)
    elif topic == "/tissue/nodes":
        check_nodes(findings, message, log_time)
    elif topic == "/tf":
        frames = {t.child_frame_id for t in message.transforms}
        findings.check(frames == {"tool", "device"}, f"/tf: frames {frames}")
    elif topic in ("/tool/pose", "/log"):
        check_timestamp(findings, topic, log_time, message.timestamp)
        if topic == "/log":
            findings.check(message.message != "", "/log: empty line")


def read(path, findings):
    counts, bounds, bytes_of, schema_of, state = defaultdict(int), {}, defaultdict(int), {}, {}
    with open(path, "rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
        attachments = [(a.name, a.media_type, len(a.data)) for a in reader.iter_attachments()]
        summary = reader.get_summary()
        findings.check("engine" in metadata, "no metadata record 'engine'")
        start_ns = int(metadata.get("engine", {}).get("start_unix_ns", 0))
        # In the order of the file: a reader that sorts would hide times that run backwards.
        for schema, channel, record, message in reader.iter_decoded_messages(log_time_order=False):
            topic = channel.topic
            expected = SCHEMAS.get(topic)
            findings.check(expected in (None, schema.name), f"{topic}: schema {schema.name}, not {expected}")
            findings.check(record.sequence == counts[topic], f"{topic}: sequence {record.sequence} at {counts[topic]}")
            first, last = bounds.get(topic, (record.log_time, record.log_time))
            findings.check(record.log_time >= last, f"{topic}: time runs back from {last} to {record.log_time}")
            findings.check(record.publish_time == record.log_time, f"{topic}: publish time differs from log time")
            bounds[topic] = (first, record.log_time)
            counts[topic] += 1
            bytes_of[topic] += len(record.data)
            schema_of[topic] = schema.name
            check_message(findings, topic, message, record.log_time, start_ns, state)
    if summary is not None and summary.statistics is not None:
        for number, count in summary.statistics.channel_message_counts.items():
            topic = summary.channels[number].topic
            findings.check(counts[topic] == count, f"{topic}: statistics say {count}, found {counts[topic]}")
    return counts, bounds, bytes_of, schema_of, metadata, attachments


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file")
    parser.add_argument("--expect-samples", type=int, metavar="N", help="number of haptic samples")
    parser.add_argument("--expect-steps", type=int, metavar="N", help="number of steps")
    arguments = parser.parse_args()

    findings = Findings()
    try:
        counts, bounds, bytes_of, schema_of, metadata, attachments = read(arguments.file, findings)
    except (OSError, McapError) as error:
        print(f"{arguments.file}: {type(error).__name__}: {error}", file=sys.stderr)
        return 2

    print(f"{'topic':<18} {'schema':<26} {'count':>8} {'kB':>10} {'from s':>9} {'to s':>9}")
    start_ns = int(metadata.get("engine", {}).get("start_unix_ns", 0))
    for topic in sorted(counts):
        first, last = ((t - start_ns) * 1e-9 for t in bounds[topic])
        size = bytes_of[topic] / 1e3
        print(f"{topic:<18} {schema_of[topic]:<26} {counts[topic]:>8} {size:>10.1f} {first:>9.3f} {last:>9.3f}")
    for name, entries in metadata.items():
        print(f"metadata {name}: " + ", ".join(f"{key}={value}" for key, value in sorted(entries.items())))
    for name, media_type, size in attachments:
        print(f"attachment {name} ({media_type}), {size} bytes")

    for topic, expected in (("/haptic/sample", arguments.expect_samples), ("/sim/step", arguments.expect_steps)):
        findings.check(expected in (None, counts[topic]), f"{topic}: {counts[topic]} messages, expected {expected}")
    for finding in findings[:20]:
        print(f"error: {finding}", file=sys.stderr)
    if len(findings) > 20:
        print(f"error: and {len(findings) - 20} more", file=sys.stderr)
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
