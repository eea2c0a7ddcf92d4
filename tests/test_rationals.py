"""Rationals as digits against Python's own Fractions."""

import random
from fractions import Fraction as F

import numpy as np
import pytest

from limitsurf._kernels.rationals import Objects, integers, rationals

KINDS = {
    "doubles": lambda g: g.random() * 10,
    "integers": lambda g: float(g.randrange(10)),
    "far_apart": lambda g: g.choice([5e-324, 1e-300, 2.0**-1022, 1e-17, 1.0, 9.99999]),
    "halves": lambda g: g.randrange(64) / 8,
    "fractions": lambda g: F(g.randrange(50), g.randrange(1, 30)),
    "primes": lambda g: F(g.randrange(50), g.choice([2**61 - 1, 2**89 - 1, 7])),
}


def agree(found, expected):
    assert found.fractions().tolist() == expected
    assert found.positive.tolist() == [x > 0 for x in expected]
    # Python's division of integers rounds correctly
    assert found.floats().tolist() == [x.numerator / x.denominator for x in expected]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("as_objects", [False, True])
def test_arithmetic(kind, as_objects):
    g = random.Random(kind)
    for n in (0, 1, 2, 7, 30):
        numbers = [KINDS[kind](g) for _ in range(n)]
        x = rationals(np.array(numbers, dtype=object if "f" in kind[:1] + kind[-3:] else None))
        exact = list(map(F, numbers))
        if as_objects:
            x = Objects(x.fractions())
        agree(x, exact)
        places, factors = (np.array([g.randrange(m) for _ in range(n)], int) for m in (3, 2**30))
        sums = [
            sum((a for a, k in zip(exact, places, strict=True) if k == j), F(0)) for j in (0, 1, 2)
        ]
        agree(x.summed(places, 3), sums)
        agree(x.times(factors), [a * int(m) for a, m in zip(exact, factors, strict=True)])
        long = np.array([g.randrange(2**80) for _ in range(n)], dtype=object)
        agree(x.times(long), [a * m for a, m in zip(exact, long, strict=True)])
        agree(x.over(factors + 1), [a / (int(m) + 1) for a, m in zip(exact, factors, strict=True)])
        for divisor in (12, 30030**3, 2**89 - 1):
            agree(x.per(divisor), [a / divisor for a in exact])
            agree(x.per(divisor) + x, [a / divisor + a for a in exact])
        one = integers(np.ones(n, dtype=int))
        agree(x - one, [max(a - 1, F(0)) for a in exact])
        agree(one - x, [max(1 - a, F(0)) for a in exact])
        agree(x.spread(2 * np.arange(n), 2 * n).take(2 * np.arange(n)), exact)
        codes = x.codes().tolist()
        assert [[a == b for a in codes] for b in codes] == [[a == b for a in exact] for b in exact]


def test_ties_are_rounded_to_even_and_what_is_beside_them_to_the_nearest():
    ulp = F(1, 2**52)
    for exact in (
        1 + ulp / 2,
        1 + 3 * ulp / 2,
        1 + ulp / 2 + F(1, 2**200),
        1 + ulp / 2 - F(1, 3**99),
    ):
        agree(rationals(np.array([exact], dtype=object)), [exact])


def test_denominators_without_a_short_common_multiple_stay_fractions():
    g = random.Random(1)
    exact = [F(1, g.randrange(2**60)) for _ in range(100)]
    x = rationals(np.array(exact, dtype=object))
    assert isinstance(x, Objects)
    agree(x, exact)
    agree(rationals(np.array([0.5])) + x.take(np.array([3])), [exact[3] + F(1, 2)])
    agree(rationals(np.array([0.5])) - x.take(np.array([3])), [F(1, 2) - exact[3]])
