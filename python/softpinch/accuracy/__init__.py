"""Which step and method to take: references, stability, and error against time.

The reference solution is SciPy's on equations that are typed in once more; nothing of the core's
mechanics. Stability is predicted from eigenvalues and measured; `advise` says what to take.
"""
