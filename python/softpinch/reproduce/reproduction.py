"""All of it in one call: runs, verdicts, tables and figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ..support import checks
from ..support.extras import require
from ..support.formats import FORMATS
from ..support.table import Table
from . import report
from .experiment import Progress, Runs, quietly, simulate_all
from .verdict import Finding, find


@dataclass(frozen=True, kw_only=True)
class Reproduction:
    """What `reproduce` found and left.

    Attributes:
        runs: Every run.
        tables: Name of each CSV file, without suffix -> its table.
        findings: The paper's claims and what it does not say.
        files: What was written.
    """

    runs: Runs
    tables: Mapping[str, Table]
    findings: tuple[Finding, ...]
    files: tuple[Path, ...]

    def show(self) -> None:
        """Prints tables and verdicts. Needs the extra `cli`."""
        report.show(self.runs, self.tables, self.findings, self.files)


def reproduce(
    out: str | Path, format: str = "png", dt: float = 1e-4, progress: Progress = quietly
) -> Reproduction:
    """Runs the paper's simulation and writes figures and tables.

    Args:
        out: The directory, made if it is not there.
        format: Of the figures: "png", "pdf" or "svg".
        dt: Longest step, s.
        progress: Told what is being done, and which share is done.

    Raises:
        ValueError: `format` or `dt` breaks its rule.
        TypeError: An argument is of the wrong kind.
        OSError: A file cannot be written.
        ImportError: matplotlib is not installed.
        KeyboardInterrupt: Ctrl-C during a run: a part of it is no reproduction.
    """
    out = checks.path("out", out, "the path of a folder")
    checks.choice("format", format, FORMATS)
    dt = checks.positive("dt", dt)
    checks.function("progress", progress)
    require("matplotlib", extra="plot", purpose="figures")
    out.mkdir(parents=True, exist_ok=True)
    from .figures import draw

    runs = simulate_all(dt, progress)
    findings = find(runs)
    tables = {
        "operations": report.operations_table(runs.operations),
        "disturbances": report.disturbances_table(runs.cases, runs.held),
        "tilt_coupling": report.coupling_table(runs),
        "verdict": report.verdict_table(findings),
    }
    files = [table.save(out / f"{name}.csv") for name, table in tables.items()]
    files += draw(runs, out, format, progress)
    progress("done", 1.0)
    return Reproduction(runs=runs, tables=tables, findings=findings, files=tuple(files))
