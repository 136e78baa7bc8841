"""Every registered term, those of other installed packages among them."""

from __future__ import annotations

import pytest
from helpers.terms import assert_parity

from apf.filters.config import FilterConfig
from apf.filters.term_weights import parse_weights
from apf.likelihood.terms import TERMS, TermSpec
from cl import Device

ROWS = [
    pytest.param(term, id=term.name, marks=pytest.mark.parity(*term.parity.kernels))
    for term in TERMS.values()
]


@pytest.mark.parametrize("name", ["song31", "stick"])
@pytest.mark.parametrize("n", [1, 37, 300])
@pytest.mark.parametrize("spec", ROWS)
def test_kernels_agree_with_the_twin(device: Device, spec: TermSpec, n: int, name: str) -> None:
    assert_parity(device, spec, name, n)


@pytest.mark.parametrize("spec", TERMS.values(), ids=TERMS)
def test_a_term_has_settings_and_is_chosen_by_its_name(spec: TermSpec) -> None:
    default = spec.settings()
    weight = parse_weights(f"edge,{spec.name}")[f"{spec.name}_weight"]
    assert weight == (default.weight or spec.chosen_weight) > 0
    config = FilterConfig.create(**{f"{spec.name}_weight": weight}).likelihood
    assert spec.name in config.terms and config.term_settings(spec.name).weight == weight
    own = spec.launcher.startswith("apf.")
    assert own or default.weight == 0, "an installed package must not change tracks"
