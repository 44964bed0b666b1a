"""Names for the types of arrays that all modules use."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Rows: TypeAlias = NDArray[np.int64]  # indices
Mask: TypeAlias = NDArray[np.bool_]
