"""Reads a recording with the `mcap` package, which shares no code with ours.

Usage: mcap_reader.py RECORDING.mcap TABLE.csv

The frames of the recording must be the rows of the table, to the bit, and every message must have
the fields that its JSON schema in the file asks for. Prints what was read; exits with 1 otherwise.
"""

import csv
import json
import sys
from collections import Counter

from mcap.reader import make_reader


def main(recording: str, table: str) -> None:
    with open(table, newline="") as file:
        rows = [[float(field) for field in row] for row in csv.reader(file)]
    topics: Counter[str] = Counter()
    frames = []
    with open(recording, "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            assert schema is not None and schema.encoding == "jsonschema", channel.topic
            value = json.loads(message.data)
            wanted = json.loads(schema.data)
            missing = set(wanted.get("required", [])) - value.keys()
            unknown = value.keys() - wanted["properties"].keys()
            assert not missing and not unknown, (channel.topic, missing, unknown)
            topics[channel.topic] += 1
            if channel.topic == "/eit/frame":
                frames.append(value["values"])
        summary = reader.get_summary()
    assert topics["/eit/session"] >= 1, topics
    assert frames == rows, f"{len(frames)} frames, {len(rows)} rows"
    index = "no index" if summary is None else f"{len(summary.chunk_indexes)} chunks indexed"
    print(f"{recording}: {dict(topics)}, {index}")


if __name__ == "__main__":
    main(*sys.argv[1:])
