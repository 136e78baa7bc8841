"""How large a search a frame's time allows."""

import pytest

from apf.filters.method import Method
from apf.live.config import LiveConfig
from apf.live.session import Governor, list_sizes, resize_search

SIZES = LiveConfig()


def count_evaluations(method: Method) -> int:
    """Return how many poses the search of one frame evaluates."""
    return method.filter.search.n_particles * method.filter.search.n_layers


def test_a_search_of_any_size() -> None:
    method = Method.create("pso", "sp")
    for count in (SIZES.fewest, 900, 3000, SIZES.most):
        chosen = resize_search(method, count)
        assert abs(count_evaluations(chosen) - count) < 0.15 * count
        assert 6 <= chosen.filter.search.n_layers <= 15
    assert resize_search(Method.create("sir", "sp"), 2000).filter.search.n_layers == 1
    assert (
        resize_search(method, 3000).filter.search.n_layers
        > resize_search(method, 900).filter.search.n_layers
    )


def test_sizes_to_choose_from() -> None:
    counts = [count_evaluations(method) for method in list_sizes(Method())]
    assert counts == sorted(counts)
    assert counts[0] == pytest.approx(SIZES.fewest, rel=0.1) and counts[-1] == pytest.approx(
        SIZES.most, 0.1
    )
    trunk = [m.filter.search.trunk_layers / m.filter.search.n_layers for m in list_sizes(Method())]
    assert all(0.25 < share < 0.4 for share in trunk)


COSTS = [0.01, 0.02, 0.03, 0.04]


def test_the_search_takes_what_processing_leaves() -> None:
    assert Governor(0.06, COSTS, 0.02).chosen == 2  # 0.85 * 0.06 - 0.02
    assert Governor(0.06, COSTS, 0.02, overlaps=True).chosen == 3
    assert Governor(0.03, COSTS, 0.025).chosen == 0  # there is nothing smaller
    # Without a rate to be kept it may take as long as the processing.
    assert Governor(0.03, COSTS, 0.025, generous=True).chosen == 1
    assert Governor(1.0, COSTS, 0.02, generous=True).chosen == 3


def test_a_search_that_takes_too_long_shrinks_and_grows_again() -> None:
    governor = Governor(0.05, COSTS, 0.01)

    def chosen_after(slower: float, processing: float = 0.01) -> int:
        """The search chosen after many frames that took so many times their cost."""
        for _ in range(40):
            governor.update(processing, slower * COSTS[governor.chosen])
        return governor.chosen

    assert governor.chosen == 2
    assert chosen_after(1.1) == 2
    assert chosen_after(2.0) == 0  # as on a busy machine
    assert chosen_after(1.0) == 1
    assert chosen_after(0.9, processing=0.0) == 2
    # One size is never left.
    single = Governor(0.05, COSTS[-1:], 0.01)
    assert not any(single.update(0.01, seconds) for seconds in (5.0, 1e-6) for _ in range(30))
