"""`reproduce`: simulations, verdicts, tables and figures in one call."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ..support import checks
from ..support.extras import require
from ..support.files import FORMATS
from ..support.table import Table
from . import energy_minimum, report
from .experiment import Progress, Runs, quietly, simulate_all
from .finding import Finding
from .verdict import find


@dataclass(frozen=True, kw_only=True)
class Reproduction:
    """The result of `reproduce`.

    Attributes:
        runs: All runs.
        tables: Name of each CSV file, without suffix -> its table.
        findings: Verdicts on the paper's claims, and findings beyond the paper.
        files: The written files.
    """

    runs: Runs
    tables: Mapping[str, Table]
    findings: tuple[Finding, ...]
    files: tuple[Path, ...]

    def show(self) -> None:
        """Prints tables and verdicts; needs the extra `cli`."""
        report.show(self.runs, self.tables, self.findings, self.files)


def reproduce(
    out: str | Path, format: str = "png", dt: float = 1e-4, progress: Progress = quietly
) -> Reproduction:
    """Repeats the paper's simulations, and writes figures and tables.

    Args:
        out: The folder for the files, made if it is missing.
        format: File format of the figures: "png", "pdf" or "svg".
        dt: Longest step, s.
        progress: Called with a description of the current work and the completed share (0 to 1).

    Returns:
        The runs, tables, findings and written files.
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
        "energy_minimum": energy_minimum.table(runs.rests),
        "contact": report.contact_table(runs),
        "verdict": report.verdict_table(findings),
    }
    files = [table.save(out / f"{name}.csv") for name, table in tables.items()]
    files += draw(runs, out, format, progress)
    progress("done", 1.0)
    return Reproduction(runs=runs, tables=tables, findings=findings, files=tuple(files))
