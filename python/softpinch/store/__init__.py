"""Studies kept in a folder: Parquet parts, a manifest in TOML, recorded trajectories, a lock.

`study` has `Study`, which reads a folder, and begins or continues a study in it. `folder` finds,
reads and adds parts and recorded runs, `manifest` describes how the rows were computed, and `files`
writes and reads files with their digests. docs/scale-out.md has the promises.
"""

from .study import Study

__all__ = ["Study"]
