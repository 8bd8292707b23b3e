"""One change of one place of the core, and the tests that should notice it."""

from dataclasses import dataclass

# In the place of a test's name: the core's own tests.
CARGO = "cargo test"


@dataclass(frozen=True)
class Mutant:
    """One change of one place, and the tests (pytest's -k) that should turn red."""

    file: str
    right: str
    wrong: str
    test: str
