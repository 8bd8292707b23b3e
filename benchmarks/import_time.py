"""Time of `import softpinch` beyond NumPy's own import, in fresh interpreters.

make bench-import
"""

import statistics
import subprocess
import sys

from command import parser
from machine import describe

REPEATS = 101
MODULES = ("numpy", "softpinch")
PROGRAM = (
    "import sys, time; start = time.perf_counter(); import {module}; "
    "print(time.perf_counter() - start, len(sys.modules))"
)


def imported(module: str) -> tuple[float, int]:
    """The import's wall time, s, in an interpreter of its own, and the modules loaded after it."""
    command = [sys.executable, "-c", PROGRAM.format(module=module)]
    time, modules = subprocess.run(
        command, capture_output=True, text=True, check=True
    ).stdout.split()
    return float(time), int(modules)


def main() -> None:
    repeats = 3 if parser(__doc__).parse_args().quick else REPEATS
    for module in MODULES:
        imported(module)  # leaves the bytecode, and the files in the system's cache
    # One after the other, so that what else the machine does falls on both.
    rows = [[imported(module) for module in MODULES] for _ in range(repeats)]
    numpy, softpinch = ([time for time, _ in column] for column in zip(*rows, strict=True))
    extra = [ours - base for ours, base in zip(softpinch, numpy, strict=True)]
    print(describe())
    print(f"\nwall time of an import, ms, of {repeats} interpreters: median (quartiles)")
    for name, times in (
        ("numpy", numpy),
        ("softpinch", softpinch),
        ("softpinch beyond numpy", extra),
    ):
        low, middle, high = (1e3 * quartile for quartile in statistics.quantiles(times, n=4))
        print(f"  {name:24s} {middle:6.1f}  ({low:.1f} to {high:.1f})")
    before, after = (modules for _, modules in rows[-1])
    print(f"modules loaded: {before} with numpy, {after} with softpinch")


if __name__ == "__main__":
    main()
