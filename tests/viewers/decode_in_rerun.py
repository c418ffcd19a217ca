# pyright: basic, reportMissingImports=false
"""Read a log with rerun-sdk's own MCAP reader and print what it saw, as decode_log.mjs does.

python decode_in_rerun.py LOG.mcap
"""

import json
import sys

from rerun.chunk import McapReader

topics = {}
for chunk in McapReader(sys.argv[1], recover=True).stream():
    batch = chunk.to_record_batch()
    (column,) = [name for name in batch.schema.names if name.endswith(":message")] or [None]
    if column is None:
        continue
    times = batch.column("message_log_time").cast("int64").to_pylist()
    entry = topics.setdefault(chunk.entity_path, {"messages": 0, "log_times": [], "fields": {}})
    entry["messages"] += len(times)
    entry["log_times"] = [*entry["log_times"][:1], *(str(t) for t in (times[0], times[-1]))]
    entry["log_times"] = [entry["log_times"][0], entry["log_times"][-1]]
    bodies = batch.column(column).flatten()
    for field in bodies.type:
        values = entry["fields"].setdefault(field.name, [])
        values.extend(bodies.field(field.name).to_pylist())
json.dump({"topics": topics}, sys.stdout)
