"""Arrays given to C: whatever their layout, size and whether they may be written, C sees their own values."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest

from hdplan.distance.compiled.c_library import Record, address, c_functions, call

SOURCE = """
double total(long long n, const double* x) { long long i; double s = 0.0; for (i = 0; i < n; ++i) s += x[i]; return s; }
"""


@pytest.mark.parametrize("writeable", [True, False])
@pytest.mark.parametrize(
    "pick", [np.s_[:], np.s_[3:], np.s_[::2], np.s_[::-1], np.s_[:, 1:], np.s_[:0], np.s_[:, :, 0]]
)
def test_any_array_reaches_c_as_it_is(pick: object, writeable: bool) -> None:
    table = np.random.default_rng(0).normal(size=(7, 4, 3))[pick]  # type: ignore[index]
    table.setflags(write=writeable)
    whole = np.ascontiguousarray(table)
    assert address(whole) == whole.__array_interface__["data"][0]
    record = Record(table, 3)
    np.testing.assert_array_equal(record.fields[0], table)
    assert not record.fields[0].flags.writeable
    struct = np.frombuffer((ctypes.c_longlong * 2).from_address(record.address), np.int64)
    assert struct.tolist() == [record.fields[0].__array_interface__["data"][0], 3]
    library = c_functions("total", SOURCE)
    if library is not None:
        assert call(library.total, table.size, table) == pytest.approx(table.sum(), abs=1e-12)
        assert table.flags.writeable == writeable
