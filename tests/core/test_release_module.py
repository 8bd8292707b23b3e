"""The compiled module: code that lost its instructions, its size, and its frames on the stack.

A module has no names of its functions, so that calls are counted in all of it.
"""

import platform
import re
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from softpinch import _core

MODULE = Path(_core.__file__)
# The largest numbers that are allowed: 5 % more than was measured when they were written here, so
# that nothing grows unnoticed. The aims: calls in cold places only (sines of huge angles, powers),
# frames of 128 KB, a module of 6 MB. A mend lowers the limit.
LIMITS = {
    # Of checks before a run, messages at its end, evaluations from outside and starts of
    # derivatives: none is in a step, and none at an event.
    "calls of fma": 1_480,
    # Calls of functions that add or multiply lanes once, where the lanes' instructions were lost.
    "calls of one lane operation": 0,
    # 104 KiB, in whole pages: that of equal steps in eight lanes.
    "largest frame, KB": 111.8,
    "size, MB": 6.0,
}
# The fma of Rust's library where the processor has the instruction.
HARDWARE_FMA = "vfmadd213sd %xmm2,%xmm1,%xmm0"
LANES = re.compile(r"v(add|sub|mul|div|sqrt|fn?m(add|sub)\d+)pd ")
TARGET = re.compile(r"# ([0-9a-f]+)")
SUBTRACTED = re.compile(r"sub +\$0x([0-9a-f]{1,7}),%(r11|rsp)$")


def instructions() -> Iterator[tuple[str, str]]:
    """Address and text of each instruction of the module."""
    command = ["objdump", "-d", "--no-show-raw-insn", str(MODULE)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as listing:
        assert listing.stdout is not None
        for line in listing.stdout:
            address, tab, text = line.partition(":\t")
            if tab:
                yield address.strip(), text.rstrip()


def addresses_of_fma() -> set[str]:
    """The addresses of `fma` and of the module's pointer to it; none if nothing calls it.

    It jumps through a pointer of its own to what the processor has, which its first call stores.
    """
    hardware, stored, own_pointer, start, last = None, False, None, "", "ret"
    starts: dict[str, str] = {}
    for (address, text), (_, after) in pairwise(instructions()):
        if last in ("int3", "ret", "ud2") and text != "int3":
            start = address
        found = TARGET.search(text)
        if text == HARDWARE_FMA and after == "ret":
            hardware = address
        elif found and found[1] == hardware:
            stored = True
        elif found and stored and text.startswith("mov    %rax,"):
            own_pointer, stored = found[1], False
        elif found and text.startswith("mov ") and after in ("call   *%rax", "jmp    *%rax"):
            starts[found[1]] = start
        last = text
    if hardware is None:
        return set()
    assert own_pointer in starts, "fma has another form now: find its calls in another way"
    entry = starts[own_pointer]
    command = ["objdump", "-R", str(MODULE)]
    listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    kept = re.search(rf"^0*(\w+) R_X86_64_RELATIVE +\*ABS\*\+0x0*{entry}$", listed, re.MULTILINE)
    return {entry, *(kept.groups() if kept else ())}


def measured() -> dict[str, float]:
    """The quantities of `LIMITS`."""
    fma = addresses_of_fma()
    # Registers and places on the stack that hold the address of `fma`.
    holding: set[str] = set()
    calls_of_fma = frame = 0
    # Addresses of functions that are one operation on lanes, and how often each address is called.
    one_operation: set[str] = set()
    calls: Counter[str] = Counter()
    begun, length, operations, last = "", 0, 0, "ret"
    for address, text in instructions():
        if last in ("int3", "ret", "ud2"):
            begun, length, operations = address, 0, 0
        length, operations = length + 1, operations + bool(LANES.match(text))
        if text == "ret" and operations == 1 and length <= 6:
            one_operation.add(begun)
        name, _, operands = text.partition(" ")
        pointed = TARGET.search(text)
        source, _, target = operands.partition("#")[0].strip().rpartition(",")
        if name == "call":
            called = pointed[1] if pointed else target.split(" ")[0]
            calls[called] += 1
            calls_of_fma += called in fma or called.removeprefix("*") in holding
        elif name == "mov" and (source in holding or (pointed and pointed[1] in fma)):
            holding.add(target)
        elif name not in ("cmp", "test", "push", "pop"):
            holding.discard(target)
        if subtracted := SUBTRACTED.match(text):
            frame = max(frame, int(subtracted[1], 16))
        last = text
    return {
        "calls of fma": calls_of_fma,
        "calls of one lane operation": sum(calls[address] for address in one_operation),
        "largest frame, KB": frame / 1e3,
        "size, MB": MODULE.stat().st_size / 1e6,
    }


@pytest.mark.skipif(
    (sys.platform, platform.machine()) != ("linux", "x86_64"),
    reason="it reads x86-64 only",
)
@pytest.mark.skipif(not shutil.which("objdump"), reason="needs objdump, of the package binutils")
def test_the_release_module_gets_no_worse() -> None:
    found = measured()
    worse = {name: found[name] for name, limit in LIMITS.items() if found[name] > limit}
    assert not worse, "is the module a release build, and are the processor's instructions used?"
    better = {name: found[name] for name, limit in LIMITS.items() if found[name] < limit / 2}
    assert not better, "the limits can be lowered"
