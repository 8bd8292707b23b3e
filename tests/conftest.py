"""Settings of Hypothesis, and fixtures that several rooms share.

Everyone runs the same examples; `make hunt` draws new ones from a seed that it prints.
"""

import compileall
import gc
import os
import shutil
import signal
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeAlias

# Before NumPy is loaded. Its matrices are small here: more threads only wait for each other, and
# take the cores from other workers.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers

from softpinch import _core

HERE = Path(__file__).parent

# Hypothesis also draws numbers that it reads in the modules that are loaded, which depend on the
# tests that a worker happened to run before. No setting turns that off.
if hasattr(providers, "_get_local_constants"):
    providers._get_local_constants = lambda: providers._local_constants

settings.register_profile(
    "house",
    deadline=None,
    max_examples=30,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    # Hypothesis changes its defaults where a variable such as CI is set.
    database=None,
    print_blob=False,
)
# Without a database, a seed alone decides which examples are drawn.
settings.register_profile(
    "hunt", settings.get_profile("house"), derandomize=False, database=None, print_blob=True
)
settings.load_profile("house")

# A shell starts its background jobs with SIGINT ignored, and what they start inherits that.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# pytest keeps the tests whose assertions it has rewritten, whatever PYTHONDONTWRITEBYTECODE says:
# to do that again takes each worker 7 s.
sys.dont_write_bytecode = False

# Processes that tests start find what tests share.
os.environ["PYTHONPATH"] = os.pathsep.join(
    [str(HERE), str(HERE / "support"), *filter(None, [os.environ.get("PYTHONPATH")])]
)


def pytest_configure(config: pytest.Config) -> None:
    """Compiles what processes that tests start import, and keeps what tests import.

    Where PYTHONDONTWRITEBYTECODE is set, each of some hundred would do so for itself, in 0.2 s.
    """
    # What tests import stays: to search it for memory to free takes 0.3 s each time.
    gc.disable()
    if not hasattr(config, "workerinput"):
        for folder in (HERE.parent / "python", HERE / "support", HERE.parent / "benchmarks"):
            compileall.compile_dir(folder, quiet=2)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with the longest tests come first: at the end, one would keep a worker alone."""
    first = ("test_site.py", "test_benchmarks.py", "test_jax.py", "test_docs.py")
    items.sort(key=lambda item: item.path.name not in first)


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Figures are saved coarsely, but in the tests of figures."""
    if find_spec("matplotlib"):
        import rough_figures

        rough_figures.use("plot" not in item.path.parts)


Hide: TypeAlias = Callable[[str], None]


@pytest.fixture
def without(monkeypatch: pytest.MonkeyPatch) -> Hide:
    """Makes a package one that is not installed, until the test ends."""
    hidden: set[str] = set()

    class Missing:
        def find_spec(self, name: str, *_: object) -> None:
            if name in hidden:
                raise ModuleNotFoundError(f"No module named {name!r}", name=name)

    monkeypatch.setattr(sys, "meta_path", [Missing(), *sys.meta_path])

    def hide(package: str) -> None:
        hidden.add(package)
        for module in [name for name in sys.modules if name.partition(".")[0] == package]:
            monkeypatch.delitem(sys.modules, module)

    return hide


@pytest.fixture(params=_core.SIMD_LEVELS)
def simd_level(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """The test runs at each level of instructions that the processor has."""
    monkeypatch.setenv("SOFTPINCH_SIMD", request.param)
    try:
        return _core.simd_level()
    except ValueError:
        pytest.skip(f"this processor has no {request.param}")


@pytest.fixture
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """A study's folder has a part for every piece that was computed."""
    monkeypatch.setattr("softpinch.store.folder.GATHER_SECONDS", 0.0)


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of `stores.tiny`, in three parts; to be left as it is."""
    import stores

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("softpinch.store.folder.GATHER_SECONDS", 0.0)
        path = tmp_path_factory.mktemp("finished") / "study"
        stores.tiny(path)
        assert len(stores.parts(path)) == 3
        return path


@pytest.fixture
def study(finished: Path, tmp_path: Path) -> Path:
    """The same, to damage."""
    return Path(shutil.copytree(finished, tmp_path / "study"))


@pytest.fixture(scope="session")
def in_parts(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A study of `stores.compute`, in parts, some of later runs than the next."""
    import stores

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("softpinch.store.folder.GATHER_SECONDS", 0.0)
        path = tmp_path_factory.mktemp("study") / "ours"
        stores.compute("ours", only=range(700, 2100, 3), store=path)
        study = stores.compute("ours", store=path)
        return study
