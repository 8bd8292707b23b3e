"""Many runs of one scene: what varies, how it is drawn, who computes it, and what came of it.

Draws depend on seed and run alone, so that any run can be computed anywhere and again. Rows come
back in blocks from threads or from workers of an executor. Nothing here writes to a folder.
"""
