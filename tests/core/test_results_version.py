"""`RESULTS_VERSION` says which bits a build gives: the bits of a few runs are kept beside it."""

import json
import tomllib
from pathlib import Path

import pytest

import digests
from softpinch import _core

ROOT = Path(__file__).parents[2]


@pytest.mark.usefixtures("simd_level")
def test_bits_change_only_with_the_results_version() -> None:
    version, kept = digests.stored()
    assert version == _core.RESULTS_VERSION, (
        f"RESULTS_VERSION is {_core.RESULTS_VERSION}, and the stored digests are of version "
        f"{version}: write them again with `make digests`"
    )
    found = digests.compute()
    assert not digests.changed(kept, found), digests.ADVICE
    assert found.keys() == kept.keys(), "the cases changed: `make digests` stores those of today"


@pytest.mark.parametrize("raised", [0, 1])
def test_digests_of_other_bits_are_stored_only_with_another_version(
    raised: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    file = tmp_path / "digests.json"
    before = {"results_version": _core.RESULTS_VERSION, "digests": {"a run": "00", "another": "11"}}
    file.write_text(json.dumps(before))
    monkeypatch.setattr(digests, "STORED", file)
    monkeypatch.setattr(digests, "compute", lambda: {"a run": "01", "another": "11", "new": "22"})
    monkeypatch.setattr(_core, "RESULTS_VERSION", _core.RESULTS_VERSION + raised)
    assert digests.main() == 1 - raised
    if raised:
        assert digests.stored() == (_core.RESULTS_VERSION, digests.compute())
    else:
        said = capsys.readouterr().out
        assert "raise RESULTS_VERSION" in said and said.endswith("other bits of: a run\n")
        assert json.loads(file.read_text()) == before


def test_the_library_whose_power_sets_steps_is_pinned() -> None:
    asked = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["dependencies"]["libm"]
    locked = tomllib.loads((ROOT / "Cargo.lock").read_text())["package"]
    (version,) = (package["version"] for package in locked if package["name"] == "libm")
    assert asked == f"={version}"
