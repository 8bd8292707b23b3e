"""A study in a folder: Parquet parts that any tool reads, a manifest in TOML, kept paths, a lock.

`Study` reads one, `driver.keep` begins or continues one. The folder itself is the index: a part
says in its footer which study and which runs it holds, and a missing part is missing runs. Every
number is compared with its checksum when it is read. docs/scale-out.md has the promises.
"""

from .study import Study

__all__ = ["Study"]
