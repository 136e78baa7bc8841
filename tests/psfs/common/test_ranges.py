"""Settings that must lie in a range."""

from __future__ import annotations

import numpy as np
import pytest

from cl import InputError
from psfs.common.ranges import check_range


@pytest.mark.parametrize("value", [0.5, np.float32(0.5), np.int64(1), 1])
def test_numbers_in_range(value: float) -> None:
    check_range("x", value, 0, 2)
    check_range("x", value, value, value, ends=True)
    check_range("x", value, 0)


@pytest.mark.parametrize("value", [0, 2, -1, float("nan"), float("inf"), True, "1", None])
def test_others_are_refused(value: object) -> None:
    with pytest.raises(InputError, match=r"^x is .*; expected a number between 0 and 2$"):
        check_range("x", value, 0, 2)


def test_what_is_expected() -> None:
    for high, ends, expected in (
        (np.inf, False, "above 0"),
        (np.inf, True, "from 0 on"),
        (2, True, "from 0 to 2"),
    ):
        for value in (-1, float("inf")):
            with pytest.raises(InputError, match=f"expected a number {expected}"):
                check_range("x", value, 0, high, ends)
