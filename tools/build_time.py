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
    "cargo", "build", "--release", "--locked", "--package", "softpinch-py",
    "--features", "pyo3/extension-module", "--message-format", "json",
)  # fmt: skip
OURS = ("softpinch", "softpinch-py")


def main() -> int:
    """Prints seconds since the start, and the module's size."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "CARGO_TARGET_DIR": folder}
        begun = last = time.monotonic()
        module: Path | None = None
        with subprocess.Popen(
            COMMAND, cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        ) as process:
            assert process.stdout is not None
            for line in process.stdout:
                message = json.loads(line)
                if message["reason"] != "compiler-artifact":
                    continue
                now = time.monotonic()
                name = message["package_id"].rpartition("#")[2].partition("@")[0]
                if "/rust/softpinch" in message["manifest_path"]:
                    name = Path(message["manifest_path"]).parent.name
                if name in OURS:
                    print(f"{name:14s} done after {now - begun:6.1f} s, {now - last:6.1f} s after the stage before")
                    module = Path(message["filenames"][0])
                    last = now
                elif not any(name == own for own in OURS):
                    last = now
            if process.wait():
                print("the build failed", file=sys.stderr)
                return 1
        print(f"in all         {time.monotonic() - begun:6.1f} s on {os.cpu_count()} cores")
        if module is not None:
            subprocess.run(["strip", module], check=False)
            print(f"module         {module.stat().st_size / 1e6:6.2f} MB, stripped")
    return 0


if __name__ == "__main__":
    sys.exit(main())
