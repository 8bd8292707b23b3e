"""Studies kept in a folder: Parquet parts, a manifest in TOML, recorded trajectories, a lock.

docs/scale-out.md has the promises.
"""

from .study import Study

__all__ = ["Study"]
