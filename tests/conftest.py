"""What the whole suite shares: a cache of its own, no windows, options and settings.

In every test NumPy answers, and kernels do what takes it `LARGE` seconds in one call, whatever was
called before or is in the cache; a fixture `use` has one of both answer everything. No process
compiles in the background, neither for tests nor for the processes that they start. What decides
outside of tests is tested in test_choice.py.

``pytest --wicked=KIND`` runs the tests with one wrong mask or rule of Catmull-Clark, which must
turn them red (test_wicked.py). ``pytest --cages=N`` judges the accuracy on N random cages,
``pytest --tagged=N`` tries every property of creases on N random tagged ones.
``pytest --hypothesis-profile=search`` tries new examples instead of the same ones every time.
``pytest --shuffle=SEED`` runs the files, and the tests of each, in another order. Tests that are
marked as long come first in any order, so that none of them is waited for at the end.
"""

import copy
import gc
import os
import random
import signal
import tempfile
from collections.abc import Callable, Iterator
from fractions import Fraction
from typing import Any

import pytest
import zoo
from hypothesis import settings

from limitsurf import _kernels, tables
from limitsurf._kernels import background
from limitsurf.rules import Sharpness

LARGE = 0.2  # as 100,000 positions

settings.register_profile("search", deadline=None)
settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.load_profile("repeatable")


def _vertex(valence: int, stolen: Fraction) -> tuple[Fraction, Fraction, Fraction]:
    """The vertex mask with some of the vertex's weight given to its neighbours."""
    share = Fraction(1, valence * valence)
    return 1 - 2 * valence * share - stolen, share + stolen / valence, share


# One wrong mask each. All sum to one, so the surfaces are affine invariant.
WICKED: dict[str, dict[str, Any]] = {
    "all": {"vertex": lambda N: _vertex(N, Fraction(1, 8))},
    "edge": {"edge": (Fraction(0), Fraction(1, 2))},  # the mean of the two face points
    "extraordinary": {"vertex": lambda N: _vertex(N, Fraction(N != 4, 8))},
    "ngon": {
        "face": lambda n: (
            (Fraction(2, n + 1), *[Fraction(1, n + 1)] * (n - 1))
            if n != 4
            else (Fraction(1, 4),) * 4
        )
    },
    "curve": {"boundary_vertex": (Fraction(2, 3), Fraction(1, 6))},  # that of the limit
    "triangle": {"smooth_triangle": Fraction(12, 25)},
}


def _wrong_chaikin() -> None:
    """Its two shares the other way round."""
    shares = [Fraction(1, 4), Fraction(3, 4)]
    tables.chaikin_weights = lambda number: number.array(shares)


def _wrong_edge_blend() -> None:
    """Sharpness below one taken for its square."""
    true = Sharpness.edge_masks.func
    Sharpness.edge_masks = property(lambda self: true(self) ** 2)


def _wrong_vertex_blend() -> None:
    """No blending: a vertex that is to be smooth is so at once."""

    def masks(self: Sharpness) -> tuple[Any, ...]:
        smooth, corner, along = true(self)
        return smooth + corner * (smooth > 0), corner * (smooth == 0), along

    true = Sharpness.vertex_masks.func
    Sharpness.vertex_masks = property(masks)


# One wrong rule each.
WICKED_RULES = {
    "chaikin": _wrong_chaikin,
    "edge_blend": _wrong_edge_blend,
    "vertex_blend": _wrong_vertex_blend,
}


class Alike:
    """Every test, doctests included, starts from the same state, whichever ran before it."""

    @pytest.fixture(autouse=True)
    def engine_by_size(self) -> Iterator[None]:
        """Kernels answer large calls only: what a test chooses ends with it."""
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(_kernels, "available", set())
            patch.setattr(_kernels, "_pays", lambda _, cost: cost >= LARGE and _kernels.load())
            yield

    @pytest.fixture
    def use(self, engine_by_size: None, monkeypatch: pytest.MonkeyPatch) -> Callable[[bool], None]:
        """Have kernels, or NumPy, answer everything from now on."""

        def choose(kernels: bool) -> None:
            loaded = kernels and _kernels.load()
            monkeypatch.setattr(_kernels, "_pays", lambda *_: loaded)
            monkeypatch.setattr(_kernels, "available", set(_kernels.KINDS if loaded else ()))

        return choose

    @pytest.fixture(autouse=True)
    def default_signals(self) -> Iterator[None]:
        """A suite in the background ignores some signals; tests and their children do not."""
        before = {}
        if hasattr(signal, "SIGHUP"):
            defaults = {
                signal.SIGINT: signal.default_int_handler,
                signal.SIGHUP: signal.SIG_DFL,
                signal.SIGTERM: signal.SIG_DFL,
            }
            before = {number: signal.signal(number, way) for number, way in defaults.items()}
        yield
        for number, way in before.items():
            signal.signal(number, way)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--wicked", choices=[*WICKED, *WICKED_RULES], help="test a wrong mask or rule")
    parser.addoption("--cages", type=int, default=62, help="random cages to judge accuracy on")
    parser.addoption("--tagged", type=int, default=zoo.EXAMPLES, help="random tagged cages")
    parser.addoption("--shuffle", metavar="SEED", help="run files and their tests in another order")


def pytest_configure(config: pytest.Config) -> None:
    """Give all processes of the run one empty table cache; the user's own is left alone."""
    os.environ["PYVISTA_OFF_SCREEN"] = "true"
    config.pluginmanager.register(Alike())  # fixtures of a conftest.py are for its folder alone
    zoo.EXAMPLES = config.getoption("tagged")
    if not hasattr(config, "workerinput"):  # workers inherit the environment of the controller
        cache = tempfile.TemporaryDirectory(prefix="limitsurf-tests-")
        config.add_cleanup(cache.cleanup)
        os.environ["LIMITSURF_CACHE_DIR"] = cache.name
        os.environ[background.VARIABLE] = "0"
        # processors are busy: threads of linear algebra would wait for each other
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    wicked = config.getoption("wicked")
    if wicked in WICKED:
        # a copy is not checked as a new Scheme is: some of these masks it would refuse
        scheme = copy.copy(tables.SCHEMES["catmull-clark"])
        for mask, wrong in WICKED[wicked].items():
            object.__setattr__(scheme, mask, wrong)
        tables.SCHEMES._known["catmull-clark"] = scheme
    elif wicked:
        WICKED_RULES[wicked]()


def pytest_collection_finish() -> None:
    """Look for garbage among what tests make, not again and again among all that was collected."""
    gc.collect()
    gc.freeze()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Shuffle files, and tests within each, alike in all processes; long tests come first."""
    if seed := config.getoption("shuffle"):
        chance = random.Random(seed)
        places = sorted({item.path for item in items})
        chance.shuffle(places)
        order = {path: place for place, path in enumerate(places)}
        chance.shuffle(items)
        items.sort(key=lambda item: order[item.path])
    items.sort(key=lambda item: item.get_closest_marker("long") is None)
