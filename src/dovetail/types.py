"""Names for the array shapes that cross module borders (all float64)."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Vec3: TypeAlias = Array
Vec4: TypeAlias = Array
Vec6: TypeAlias = Array
Vec7: TypeAlias = Array
Mat33: TypeAlias = Array

JOINTS = tuple(f"A{i}" for i in range(1, 8))
"""Joint names, base to flange."""
