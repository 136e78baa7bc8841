"""Settings: what they refuse and how they say so, changes, plain values and back."""

import json
import pickle
from typing import Literal

import numpy as np
import pytest
from pydantic import ValidationError

from cl import InputError
from psfs.common.config import Config, fields_below, part, setting
from psfs.silhouettes.config import RimConfig
from psfs.voxels.config import ReconstructionConfig


class Inner(Config):
    reach: float = setting(2.0, "Reach.", "by hand", "px", above=0, most=10)
    n: int = setting(3, "Number.", least=1, below=9)
    kind: Literal["near", "far"] = setting("near", "Kind.")
    lags: tuple[int, ...] = setting((1, 2), "Lags.")
    gap: float | None = setting(None, "Gap.", least=0)
    scale: float = setting(1.0, "Scale.")


class Outer(Config):
    inner: Inner = part(Inner, reach=5.0)
    on: bool = setting(True, "Whether.")


def test_a_config_survives_json_and_pickle() -> None:
    config = ReconstructionConfig()
    config = config.replace(silhouette=config.silhouette.replace(rim=RimConfig(on=False)))
    plain = json.loads(json.dumps(config.to_dict()))
    assert ReconstructionConfig.from_dict(plain) == config
    assert ReconstructionConfig.from_dict({}) == ReconstructionConfig() != config
    assert pickle.loads(pickle.dumps(config)) == config


def test_a_table_keeps_what_it_does_not_state() -> None:
    """Even where the outer settings have defaults of their own for the inner ones."""
    found = Outer.from_dict({"inner": {"n": 5, "lags": [3]}})
    assert found.inner == Inner(reach=5.0, n=5, lags=(3,))
    assert found.overlay({"inner": {"reach": 1}}).inner == Inner(reach=1.0, n=5, lags=(3,))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"inner": {"reach": 0}}, r"inner\.reach is 0; expected a number above 0, up to 10 px"),
        ({"inner": {"reach": 1e-13}}, r"inner\.reach is 1e-13; expected a number above 0"),
        ({"inner": {"reach": "far"}}, r"inner\.reach is 'far'; expected a number above 0"),
        ({"inner": {"reach": float("nan")}}, r"inner\.reach is nan; expected a number above 0"),
        ({"inner": {"reach": True}}, r"inner\.reach is True; expected a number above 0"),
        ({"inner": {"n": 2.5}}, r"inner\.n is 2\.5; expected a whole number from 1 on, below 9"),
        ({"inner": {"kind": "x"}}, r"inner\.kind is 'x'; expected near, far"),
        ({"inner": {"lags": 3}}, r"inner\.lags is 3; expected a list"),
        ({"inner": {"lags": [1, "a"]}}, r"inner\.lags\[1\] is 'a'; expected a valid integer"),
        ({"inner": {"gap": -1}}, r"inner\.gap is -1; expected a number from 0 on"),
        ({"inner": {"scale": 2e9}}, r"inner\.scale is 2000000000\.0; expected a number"),
        ({"inner": 3}, r"inner is 3; expected settings with names"),
        ({"inner": {"m": 3}}, r"inner\.m: no such setting; expected some of reach, n, kind"),
        ({"on": 1}, r"on is 1; expected true or false"),
        ({"off": 1}, r"off: no such setting; expected some of inner, on"),
    ],
)
def test_what_is_wrong_is_refused_by_name(values: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=f"^table\\.{message}"):
        Outer.from_dict(values, "table")


def test_numbers_of_numpy_are_taken() -> None:
    found = Inner(n=np.int64(4), reach=np.float32(0.5), lags=[1])  # type: ignore[arg-type]
    assert found == Inner(n=4, reach=0.5, lags=(1,)) and type(found.n) is int


def test_settings_cannot_be_changed() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        Inner().n = 4  # type: ignore[misc]
    assert Inner().replace(n=4).n == 4
    with pytest.raises(InputError, match="n is 9"):
        Inner().replace(n=9)


def test_single_settings_are_found_by_their_names() -> None:
    paths = [".".join(path) for path, _ in fields_below(Outer)]
    assert paths[:2] == ["inner.reach", "inner.n"] and paths[-1] == "on" and len(paths) == 7
