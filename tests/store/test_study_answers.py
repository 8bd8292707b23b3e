"""A study in a folder answers every question as the ensemble does; any tool reads its parts."""

import json
import math
import pickle
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import duckdb
import numpy as np
import pandas as pd
import pyarrow.parquet as parquet
import pytest

import softpinch as sp
from softpinch import _core
from stores import RUNS, compute, in_memory, parts, require_same


def test_any_run_is_shown_again(in_parts: sp.Study) -> None:
    expected = in_memory("ours")
    for run in (0, 700, 701, 1023, 2099, RUNS - 1):
        assert in_parts.scene_of(run) == expected.scene_of(run)
        assert in_parts.has(run) and expected.has(run)
    replay = in_parts.replay(700, record="state")
    ours = [replay.q[-1].tobytes(), replay.p[-1].tobytes(), replay.status]
    theirs = in_parts["final_state"][700]
    assert ours == [theirs[:9].tobytes(), theirs[9:].tobytes(), in_parts.status[700]]
    for results in (in_parts, expected):
        for run in (RUNS, 2**63, 2**64, 10**30):
            assert not results.has(run)
            with pytest.raises(IndexError, match=f"run {run} is not among the {RUNS} runs"):
                results.replay(run)
        assert not results.has(-1)
        with pytest.raises(ValueError, match="run = -1"):
            results.scene_of(-1)


def test_failures_are_capsules_read_as_they_are_asked_for(in_parts: sp.Study) -> None:
    expected = in_memory("ours").failures()
    failures = in_parts.failures()
    assert isinstance(failures, Sequence) and len(failures) == len(expected) > 500
    assert list(failures) == expected
    assert failures[-1] == expected[-1] and failures[-len(expected)] == expected[0]
    assert failures[3:40:7] == expected[3:40:7] and failures[::-300] == expected[::-300]
    assert failures[np.int64(5)] == expected[5]
    for k in (len(expected), -len(expected) - 1):
        with pytest.raises(IndexError, match=f"failure {k} of {len(expected)}"):
            failures[k]
    assert failures[2].agrees(failures[2].replay())
    assert repr(failures).startswith(f"<{len(expected)} failures of <Study ")
    one = pickle.loads(pickle.dumps(failures[8]))
    assert one == expected[8] and sp.Capsule.from_toml(one.to_toml()) == expected[8]


def test_a_study_without_failures_has_none(tmp_path: Path) -> None:
    study = compute("nothing", 40, store=tmp_path)
    assert list(study.failures()) == [] and not study.failures()


STATISTICS: dict[str, Callable[[Any], Any]] = {
    "probability": lambda r: [r.probability(what) for what in ("completed", "pulling", "slipping")],
    "of booleans": lambda r: r.probability(r["grasped.mass"] > 0.1, 0.5),
    "of a function": lambda r: r.probability(lambda some: some["peak_rotation"] > 1e-3),
    "counts": lambda r: list(r.counts().items()),
    "mean": lambda r: [r.mean(n) for n in ("peak_rotation", "settling_time", "final_state.theta")],
    "of parts of paths": lambda r: r.mean("disturbances.1.force.1"),
    "quantile": lambda r: r.quantile("peak_torque", [0.0, 0.1, 0.5, 0.99, 1.0]).tolist(),
    "of a summary that is null": lambda r: r.quantile("settling_time", 0.3),
    "happened": lambda r: r.happened("crushed").tobytes(),
    "violations": lambda r: [v.tobytes() for v in r.violations.values()],
    "summaries": lambda r: [(n, v.tobytes()) for n, v in r.summaries.items()],
    "parameters": lambda r: [(n, v.tobytes()) for n, v in r.parameters.items()],
    "by name": lambda r: [r.run.tolist(), r.status.tolist(), r.message.tolist(), r.steps.tolist()],
    "times": lambda r: [r.end_time.tobytes(), r.failure_time.tobytes()],
    "facts": lambda r: [r.scene, r.seed, r.sampler, r.interruption, r.lost, r.requested],
    "sensitivity": lambda r: sp.sensitivity(r, "peak_rotation"),
    "provenance": lambda r: json.dumps(r.provenance(), sort_keys=True),
}


@pytest.mark.parametrize("name", STATISTICS)
def test_statistics_equal_those_of_the_ensemble(in_parts: sp.Study, name: str) -> None:
    ours, theirs = STATISTICS[name](in_parts), STATISTICS[name](in_memory("ours"))
    assert repr(ours) == repr(theirs)
    assert name == "provenance" or "nan" not in repr(theirs)


@pytest.mark.parametrize(
    "ask",
    [
        lambda r: r["nonsense"],
        lambda r: r.probability("nonsense"),
        lambda r: r.mean("final_state"),
        lambda r: r.quantile("peak_rotation", 1.5),
        lambda r: r.probability(np.ones(3, bool)),
    ],
)
def test_errors_equal_those_of_the_ensemble(in_parts: sp.Study, ask: Callable[[Any], Any]) -> None:
    with pytest.raises((KeyError, ValueError)) as theirs:
        ask(in_memory("ours"))
    with pytest.raises(theirs.type) as ours:
        ask(in_parts)
    assert str(ours.value) == str(theirs.value)


def test_chunks_are_ensembles_of_all_rows(in_parts: sp.Study) -> None:
    chunks = list(in_parts.chunks())
    assert len(chunks) == len(parts(in_parts.path)) > 3
    assert all(isinstance(chunk, sp.Ensemble) for chunk in chunks)
    run = np.concatenate([chunk.run for chunk in chunks])
    assert sorted(run.tolist()) == list(range(RUNS)) and run.tolist() != list(range(RUNS))
    expected = in_memory("ours")
    for chunk in chunks:
        rows = chunk.run.astype(int)
        require_same(chunk.to_dict(), {n: v[rows] for n, v in expected.to_dict().items()})
        assert chunk.replay(int(chunk.run[0])).status == chunk.status[0]


def test_tables_of_other_libraries_are_the_ensembles(in_parts: sp.Study) -> None:
    ours, theirs = in_parts.to_pandas(), in_memory("ours").to_pandas()
    pd.testing.assert_frame_equal(ours, theirs, check_exact=True)
    assert ours.attrs == theirs.attrs
    assert in_parts.to_xarray().identical(in_memory("ours").to_xarray())


def require_table(frame: pd.DataFrame) -> None:
    """All columns, by their names and units; null is where there is no number."""
    ours = in_memory("ours")
    columns = ours._spec.schema.split(ours.to_dict())
    for name, column in columns.items():
        found = frame[name]
        if column.values.dtype.kind != "f":
            assert found.tolist() == column.values.tolist(), name
            continue
        missing = np.isnan(column.values)
        np.testing.assert_array_equal(found.isna(), missing, err_msg=name)
        np.testing.assert_array_equal(
            found[~missing].to_numpy(np.float64), column.values[~missing], err_msg=name
        )
    assert len(frame.columns) == len(columns)


def test_pandas_reads_the_parts(in_parts: sp.Study) -> None:
    require_table(pd.read_parquet(in_parts.path / "parts").sort_values("run"))


def test_duckdb_reads_the_parts(in_parts: sp.Study) -> None:
    files = f"'{in_parts.path}/parts/*.parquet'"
    with duckdb.connect() as db:
        require_table(db.sql(f"SELECT * FROM {files} ORDER BY run").df())
        counts = db.execute(
            f"SELECT count(first_separated), count(*) FILTER (first_folded IS NULL) FROM {files}"
        ).fetchone()
        mean = db.execute(
            f"""SELECT favg("disturbances.1.force.0") FROM {files} WHERE status = 'completed'"""
        ).fetchone()
    assert counts == (in_parts.happened("separated").sum(), RUNS)
    expected = in_memory("ours")
    kept = expected["disturbances.1.force"][expected.status == "completed", 0]
    assert mean == pytest.approx((math.fsum(kept) / len(kept),), rel=1e-12)


def test_the_manifest_says_what_wrote_it(in_parts: sp.Study) -> None:
    (maker,) = in_parts.made_by
    assert maker["softpinch"] == sp.__version__
    assert maker["results_version"] == _core.RESULTS_VERSION
    assert maker["simd"] == _core.simd_level() and maker["numpy"] == np.__version__


def test_rows_of_parts_are_in_order_and_their_metadata_name_them(in_parts: sp.Study) -> None:
    for path in parts(in_parts.path):
        run = pd.read_parquet(path)["run"].tolist()
        assert all(b > a for a, b in pairwise(run))
        facts = json.loads(parquet.read_metadata(path).metadata[b"softpinch"])
        assert run == [n for first, last in facts["runs"] for n in range(first, last)]
