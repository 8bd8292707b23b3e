"""Spans against Python's own sets."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from softpinch.study.rows import Spans

# Few enough numbers that intervals touch, lie in each other and leave gaps of one.
SETS = st.one_of(
    st.sets(st.integers(0, 40)),
    st.sets(st.integers(0, 2**40), max_size=10),
    # Long intervals between few numbers.
    st.lists(st.integers(0, 60), max_size=8).map(
        lambda cuts: {n for a, b in list(pairwise(sorted(cuts)))[::2] for n in range(a, b)}
    ),
)


def spans(numbers: set[int]) -> Spans:
    return Spans.of(np.array(sorted(numbers), np.uint64))


def members(of: Spans) -> set[int]:
    """By its edges, which must be apart and in order."""
    flat = of.edges.ravel()
    assert of.edges.dtype == np.int64 and of.edges.shape == (len(flat) // 2, 2)
    assert (flat[1:] > flat[:-1]).all()
    return {n for first, last in of.edges.tolist() for n in range(first, last)}


@given(SETS)
def test_of_numbers_and_back(numbers: set[int]) -> None:
    found = spans(numbers)
    assert members(found) == numbers
    assert found.count == len(numbers)
    back = found.numbers()
    assert back.dtype == np.uint64 and back.tolist() == sorted(numbers)


@given(st.integers(0, 50))
def test_upto(runs: int) -> None:
    assert members(Spans.upto(runs)) == set(range(runs))


@given(SETS, SETS)
def test_without_is_the_difference(some: set[int], others: set[int]) -> None:
    assert members(spans(some).without(spans(others))) == some - others


@given(SETS, st.integers(0, 60), st.integers(0, 60))
@example({4, 5, 6}, 5, 5)
def test_within_is_what_lies_between(numbers: set[int], first: int, last: int) -> None:
    first, last = sorted((first, last))
    assert members(spans(numbers).within(first, last)) == numbers & set(range(first, last))


@given(SETS, SETS)
def test_contains_says_which_are_in_the_set(numbers: set[int], asked: set[int]) -> None:
    found = spans(numbers).contains(np.array(sorted(asked), np.uint64))
    assert found.tolist() == [n in numbers for n in sorted(asked)]
    assert all(spans(numbers).has(n) == (n in numbers) for n in (*asked, -1, 2**63, 10**30))


@given(SETS, st.integers(1, 9))
def test_evenly_spaced_runs_include_both_ends(numbers: set[int], most: int) -> None:
    found = spans(numbers).evenly_spaced(most).tolist()
    assert found == sorted(set(found) & numbers) and len(found) == min(most, len(numbers))
    if 1 < most <= len(numbers):
        assert {min(numbers), max(numbers)} <= set(found)
        places = [sorted(numbers).index(n) for n in found]
        gaps = np.diff(places)
        assert gaps.max() - gaps.min() <= 1


@given(SETS, st.lists(st.integers(0, 3), min_size=45, max_size=45), st.randoms())
def test_joined_is_the_union_whatever_the_order(numbers, whose, random) -> None:  # type: ignore[no-untyped-def]
    owners = [{n for k, n in enumerate(sorted(numbers)) if whose[k % 45] == w} for w in range(4)]
    random.shuffle(owners)
    assert members(Spans.joined([spans(part).edges for part in owners])) == numbers


@given(SETS, SETS)
def test_joined_refuses_what_overlaps(some: set[int], others: set[int]) -> None:
    parts = [spans(some).edges, spans(others).edges]
    both = some & others
    if not both:
        assert members(Spans.joined(parts)) == some | others
        return
    with pytest.raises(ValueError, match=r"^run \d+ occurs twice$") as caught:
        Spans.joined(parts)
    assert int(str(caught.value).split()[1]) in both


@given(SETS, st.integers(1, 20))
def test_pieces_are_all_runs_cut_at_multiples(numbers: set[int], size: int) -> None:
    pieces = [piece.tolist() for piece in spans(numbers).aligned_chunks(lambda: size)]
    assert [n for piece in pieces for n in piece] == sorted(numbers)
    assert all(pieces)
    blocks = [{n // size for n in piece} for piece in pieces]
    assert all(len(block) == 1 for block in blocks)
    # One piece a block.
    assert len(set().union(*blocks)) == len(blocks)


@given(SETS, st.lists(st.integers(0, 5), min_size=1, max_size=9))
def test_pieces_lose_nothing_where_their_size_changes(numbers: set[int], sizes: list[int]) -> None:
    asked = iter(sizes)
    lengths = []

    def size() -> int:
        lengths.append(4 * 2 ** next(asked, 0))
        return lengths[-1]

    pieces = [piece.tolist() for piece in spans(numbers).aligned_chunks(size)]
    assert [n for piece in pieces for n in piece] == sorted(numbers)
    for piece, length in zip(pieces, lengths, strict=True):
        assert len({n // length for n in piece}) == 1
