"""Configs made of smaller ones, to plain values and back."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from cl import InputError
from psfs.reconstructor import ReconstructionConfig
from psfs.silhouettes.config import RimConfig


def test_a_config_survives_json() -> None:
    config = ReconstructionConfig()
    config = replace(config, silhouette=replace(config.silhouette, rim=RimConfig(cost=5.0)))
    plain = json.loads(json.dumps(config.to_dict()))
    assert ReconstructionConfig.from_dict(plain) == config
    assert ReconstructionConfig.from_dict({}) == ReconstructionConfig()


def test_what_is_wrong_is_refused() -> None:
    with pytest.raises(InputError, match="silhouettes: no such setting"):
        ReconstructionConfig.from_dict({"silhouettes": {}})
    with pytest.raises(InputError, match="rim's share is 3"):
        ReconstructionConfig.from_dict({"silhouette": {"rim": {"share": 3}}})
    with pytest.raises(InputError, match=r"silhouette\.rim\.share is 'all'; expected a number"):
        ReconstructionConfig.from_dict({"silhouette": {"rim": {"share": "all"}}})
    with pytest.raises(InputError, match=r"silhouette\.rim is 3; expected settings"):
        ReconstructionConfig.from_dict({"silhouette": {"rim": 3}})
