"""Lengths in a verdict: no more is claimed than was proven."""

from __future__ import annotations

import numpy as np

from hdplan.planner.certificate.verdict import proven_length


def test_lengths_that_are_proven_are_rounded_down() -> None:
    found = [*(10 ** np.random.default_rng(38).uniform(-6.0, 2.0, 500)).tolist(), 0.014896, 0.9999, 0.99999999, 1.9999]
    for length in found:
        number, unit = proven_length(length).split()
        said = float(number) * {"mm": 1e-3, "m": 1.0}[unit]
        assert said <= length * (1.0 + 1e-12)  # the product is rounded
        assert said > 0.99 * length
    assert proven_length(0.0) == "0 mm"
