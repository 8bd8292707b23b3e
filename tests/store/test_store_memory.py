"""With a store, memory does not grow with the runs."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

# What one process takes at most to compute a study, and then to ask it everything; and the size of
# its table. Parts and pieces are small, as those of a study that is far larger are beside it.
SCRIPT = """
import json, sys
import stores
from softpinch.study import compute
from softpinch.store import folder, study as stored

folder.GATHER_SECONDS, stored.MOST_BLOCKS, compute.MOST_BLOCKS = 0.0, 2, 4

def most():
    # Not getrusage: that begins with what the process had before it became this one.
    with open("/proc/self/status") as file:
        (line,) = [line for line in file if line.startswith("VmHWM")]
    return 1024 * int(line.split()[1])

study = stores.tiny(sys.argv[1], int(sys.argv[2]))
found = [most()]
study.mean("grasped.mass")
study.quantile("final_state.x", [0.1, 0.5])
study.counts()
study.probability("pulling")
study.probability(lambda some: some["grasped.mass"] > 0.1)
study.verify()
found.append(most())
table = sum(values.nbytes for values in study.to_dict().values())
print(json.dumps([*found, table]))
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs Linux's /proc")
def test_the_memory_of_writing_and_reading_does_not_grow(tmp_path: Path) -> None:
    # Arrow's own pool keeps some MB more or less from one process to the next.
    plain = {**os.environ, "ARROW_DEFAULT_MEMORY_POOL": "system"}
    found = []
    for runs in (20_000, 130_000):
        command = [sys.executable, "-c", SCRIPT, str(tmp_path / str(runs)), str(runs)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=300, env=plain)
        assert done.returncode == 0, done.stderr
        found.append(json.loads(done.stdout))
    written, read, table = (many - few for few, many in zip(*found, strict=True))
    # Some noise of allocators is left; a column of 8 bytes a run would be 0.9 MB, the table 33.
    assert table > 30e6
    assert written < table / 8
    assert read < table / 3
