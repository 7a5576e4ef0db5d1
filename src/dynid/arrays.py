"""What arrays hold, for signatures; their shapes stand in the words of each function."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
#: Places in other arrays.
Ints = NDArray[np.intp]
#: Which entries of another array.
Mask = NDArray[np.bool_]
