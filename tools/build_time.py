"""Builds the module from nothing, in a folder of its own, and prints when each stage was done.

make build-time
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# The package, of which the module is the last stage, as maturin builds it.
COMMAND = (
    "cargo", "build", "--release", "--locked", "--package", "softpinch-module",
    "--message-format", "json",
)  # fmt: skip


def main() -> None:
    """Prints seconds since the start, and the module's size."""
    begun = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "CARGO_TARGET_DIR": folder}
        with subprocess.Popen(
            COMMAND, cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        ) as process:
            assert process.stdout is not None
            files: list[str] = []
            for line in process.stdout:
                message = json.loads(line)
                if message["reason"] != "compiler-artifact":
                    continue
                files = message["filenames"]
                # The package's own crates; dozens of others come before and beside them.
                if Path(message["manifest_path"]).is_relative_to(ROOT):
                    crate = Path(message["manifest_path"]).parent.name
                    print(f"{crate:14s} done after {time.monotonic() - begun:6.1f} s", flush=True)
        if process.returncode:
            sys.exit("the build failed: `make build` says why")
        print(f"in all         {time.monotonic() - begun:16.1f} s on {os.cpu_count()} cores")
        subprocess.run(["strip", files[0]], check=True)
        print(f"module         {Path(files[0]).stat().st_size / 1e6:16.2f} MB, stripped")


if __name__ == "__main__":
    main()
