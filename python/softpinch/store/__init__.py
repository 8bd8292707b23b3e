"""Studies kept in a folder: Parquet parts, a manifest in TOML, recorded trajectories, a lock.

`study` has `Study`, which reads a folder; `driver` begins or continues a study. `folder` finds and
adds parts, `part` converts rows to Parquet and back, `table` reads and writes checked files,
`manifest` describes how the rows were computed, `paths` stores trajectories, `arrays` stores the
arrays given in `vary`, and `lock` admits one writer at a time. docs/scale-out.md has the promises.
"""

from .study import Study

__all__ = ["Study"]
