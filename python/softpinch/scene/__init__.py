"""The description of a simulation: frozen records, validated once and compiled for the Rust core.

The public records are in `hand`, `schedule`, `disturbance`, `stabilization` and `scene` (which also
has `State`). `compilation` and `compiled` make the core's arrays for one run or many runs;
`template` is a scene with numbers that differ between runs. `paths` resolves dotted paths into a
scene, `units` has the unit of every field, and `usual` its usual range.
"""
