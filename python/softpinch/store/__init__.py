"""A study in a folder: Parquet parts that any tool reads, a manifest in TOML, kept paths, a lock.

`driver.compute` begins or continues a study, `Study` reads one. The folder itself is the index: a
part says in its footer which study and which runs it holds, and a missing part is missing runs.
Every number is compared with its checksum when it is read. docs/scale-out.md has the promises.
"""
