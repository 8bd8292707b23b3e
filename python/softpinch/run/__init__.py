"""One run: its options, the run itself, and whether it can be believed.

`simulate` checks, calls the core and returns a `Run`. Beside it are the forces and energies of one
state, the invariants that a run keeps, its error estimate, and what a scene compiles to.
"""
