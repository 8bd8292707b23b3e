"""Where the paper's eight operations settle, as docs/model.md has it.

tests/core/test_trajectories.py computes these numbers with the oracle.
"""

# At the end of each operation: x, y in mm, theta in degrees, d_n1 and d_n2 in mm.
SETTLED = [
    (0.000, 74.020, 0.000, 7.936, 7.936),
    (-19.770, 71.893, -9.427, 6.242, 6.340),
    (9.960, 73.896, 5.879, 7.245, 7.194),
    (19.737, 72.182, 10.547, 6.414, 6.316),
    (15.855, 73.089, 8.586, 6.499, 6.427),
    (-15.806, 73.367, -7.766, 6.381, 6.455),
    (25.892, 71.029, 13.657, 6.222, 6.068),
    (-0.001, 75.692, 0.271, 6.624, 6.625),
]
# Number of the operation -> the least normal force of a tip along it, N.
LEAST_FORCE = {1: 38, 2: -36, 3: -55, 5: 26, 7: -111, 8: -38}
