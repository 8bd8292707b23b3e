"""Choice of step and method: reference solutions, stability, and error against run time.

`advisor` finds the cheapest settings that meet a tolerance, reported as `advice`. `precision` (with
`precision_runs`, `measurements`) measures error against run time, `gains` the effect of alpha and
beta. `stability` (with `bisection`) finds the longest stable step; `stability_maps` (with the other
`stability_*` modules) maps how runs end. `reference` solves an independent statement of the
equations (`null_space`, `driven`, `integrate`) with SciPy.
"""
