"""Numbers in a verdict: no more is claimed than was proven."""

from __future__ import annotations

import numpy as np

from hdplan.planner.certificate.verdict import at_most, proven_length, share_of_limit


def test_lengths_that_are_proven_are_rounded_down() -> None:
    found = [*(10 ** np.random.default_rng(38).uniform(-6.0, 2.0, 500)).tolist(), 0.014896, 0.9999, 0.99999999, 1.9999]
    for length in found:
        number, unit = proven_length(length).split()
        stated = float(number) * {"mm": 1e-3, "m": 1.0}[unit]
        assert stated <= length * (1.0 + 1e-12)  # the product is rounded
        assert stated > 0.99 * length
    assert proven_length(0.0) == "0 mm"


def test_bounds_that_are_proven_are_rounded_up() -> None:
    found = [*(10 ** np.random.default_rng(39).uniform(-6.0, 4.0, 500)).tolist(), 0.0999999, 99.96, 1.0001, -0.5]
    for bound in found:
        assert bound <= float(at_most(bound)) <= bound + 0.01 * abs(bound)
    assert (at_most(0.0), at_most(0.1), at_most(np.inf)) == ("0", "0.1", "inf")
    shares = np.random.default_rng(40).uniform(0.0, 1.2, 500).tolist()
    for share in shares:
        for decimals in (0, 1):
            stated = float(share_of_limit(share, decimals).rstrip("%"))
            assert 100.0 * share - 1e-6 <= stated <= 100.0 * share + 10.0**-decimals
    assert (share_of_limit(1.0 + 1e-9), share_of_limit(0.994), share_of_limit(np.inf)) == ("100%", "100%", "inf%")
