"""Arguments that must lie in a range."""

from __future__ import annotations

import numpy as np
import pytest

from cl import InputError
from psfs.common.ranges import check_number


@pytest.mark.parametrize("value", [0.5, np.float32(0.5), np.int64(1), 1, 0, 2])
def test_numbers_in_range(value: float) -> None:
    check_number("x", value, 0, 2)
    check_number("x", value, 0)


@pytest.mark.parametrize("value", [2.1, -1, float("nan"), float("inf"), True, "1", None])
def test_others_are_refused(value: object) -> None:
    with pytest.raises(InputError, match=r"^x is .*; expected a number from 0 to 2$"):
        check_number("x", value, 0, 2)
