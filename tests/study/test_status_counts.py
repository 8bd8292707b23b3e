"""The statuses are counted in one place: the table of results shows what `counts` has."""

from collections import Counter

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import softpinch as sp
from softpinch.study.results_tables import status_counts, statuses

NAMES = st.sampled_from(["separated", "completed", "crushed", "lost"])
PARTS = st.lists(st.lists(st.tuples(NAMES, st.booleans()), min_size=1, max_size=6), max_size=4)


@given(PARTS)
def test_the_table_has_the_counts_in_their_order(parts: list[list[tuple[str, bool]]]) -> None:
    arrays = [
        (np.array([name for name, _ in part]), np.array([held for _, held in part]))
        for part in parts
    ]
    runs = [run for part in parts for run in part]
    counts = status_counts(names for names, _ in arrays)
    assert counts == Counter(name for name, _ in runs)
    assert list(counts) == sorted(counts, key=lambda name: (-counts[name], name))
    # A generator can be read once only, as the parts of a store are.
    table = statuses(each for each in arrays) if runs else None
    if table is not None:
        *rows, held = [row[:3] for row in table.rows]
        assert [row[:2] for row in rows] == list(counts.items())
        assert all(row[2] == row[1] / len(runs) for row in (*rows, held))
        assert held[:2] == ("holds", sum(one for _, one in runs))


def test_an_ensemble_counts_so() -> None:
    blows = [sp.Impulse(time=0.001, impulse=(20.0, 0.0))]
    scene = sp.Scene(disturbances=blows, duration=0.05)
    vary = {"disturbances.0.impulse.0": [20.0, 0.0]}
    found = sp.monte_carlo(scene, vary=vary, progress=False)
    first = found.status.tolist()
    assert first[0] != "completed" and first[1] == "completed"
    assert list(found.counts().items()) == [("completed", 1), (first[0], 1)]
    assert [row[:2] for row in next(iter(found._tables())).rows[:2]] == [*found.counts().items()]
