"""Robust least squares: wrong measurements, covariance, elimination, differences."""

from collections.abc import Sequence

import numpy as np
import pytest

from psfs.common.least_squares import (
    Parameters,
    Residuals,
    Slope,
    Solution,
    differentiate,
    estimate_noise,
    prior,
    solve,
)


def line_problem(
    rng: np.random.Generator, wrong: int, noise: float = 0.2
) -> tuple[np.ndarray, np.ndarray]:
    x = rng.uniform(-1, 1, 200)
    y = 1.5 * x - 0.5 + noise * rng.normal(size=200)
    y[:wrong] += rng.uniform(5, 20, wrong)
    return x, y


def fit_line(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    rows = np.zeros(len(x), int)

    def evaluate(parameters: Parameters) -> Sequence[Residuals]:
        ((a, b),) = parameters["line"]
        slope = np.column_stack([x, np.ones(len(x))])[:, None]
        return [Residuals(a * x + b - y, [Slope("line", rows, slope)])]

    found = solve(evaluate, {"line": np.zeros((1, 2))})
    return found.parameters["line"][0], found.covariance("line")


@pytest.mark.parametrize("wrong", [0, 40])
def test_covariance_tells_the_error(wrong: int) -> None:
    rng, squares = np.random.default_rng(1), []
    for _ in range(30):
        line, covariance = fit_line(*line_problem(rng, wrong))
        away = line - [1.5, -0.5]
        squares.append(away @ np.linalg.solve(covariance, away))
    assert 0.8 < np.mean(squares) < 3.2  # two values: 2; wrong ones make the noise larger


def points_problem(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Positions of six stations on a line, each of which measures its distances from 40 points."""
    stations, points = rng.normal(size=(6, 2)) * 3, rng.normal(size=(40, 2))
    views, rows = np.divmod(np.arange(240), 40)
    apart = points[rows] - stations[views] + 0.01 * rng.normal(size=(240, 2))
    return {"stations": stations, "points": points, "views": views, "rows": rows, "apart": apart}


@pytest.mark.parametrize("eliminate", [(), ("points",)])
def test_blocks_of_points(eliminate: Sequence[str]) -> None:
    problem = points_problem(np.random.default_rng(2))
    views, rows = problem["views"], problem["rows"]

    def measure(stations: np.ndarray, points: np.ndarray) -> np.ndarray:
        return points - stations - problem["apart"]

    def evaluate(parameters: Parameters) -> Sequence[Residuals]:
        values = parameters["stations"][views], parameters["points"][rows]
        by_station, by_point = differentiate(measure, *values)
        slopes = [Slope("stations", views, by_station), Slope("points", rows, by_point)]
        return [Residuals(measure(*values), slopes)]

    free = np.ones((6, 2), bool)
    free[0] = False
    start = {"stations": np.zeros((6, 2)), "points": np.zeros((40, 2))}
    start["stations"][0] = problem["stations"][0]
    found = solve(evaluate, start, eliminate=eliminate, free={"stations": free})
    away = found.parameters["stations"] - problem["stations"]
    sigmas = found.sigmas("stations")
    assert np.allclose(away[0], 0) and np.allclose(sigmas[0], 0)
    assert np.allclose(sigmas[1:], 0.01 * np.sqrt(2 / 40), rtol=0.25)
    assert np.all(np.abs(away[1:]) < 5 * sigmas[1:])
    # Of a point: six measurements and the stations' own error.
    assert np.allclose(np.sqrt(np.diag(found.covariance("points", [3]))), 0.0055, rtol=0.4)


def test_prior_holds_what_is_not_measured() -> None:
    def evaluate(parameters: Parameters) -> Sequence[Residuals]:
        values = parameters["values"]
        slopes = [Slope("values", np.zeros(4, int), np.tile([[[1.0, 0, 0]]], (4, 1, 1)))]
        seen = Residuals(values[0, 0] - np.ones(4), slopes, sigma=0.1)
        return [seen, prior("values", values, np.array([[10.0, 0.5, np.inf]]), 2.0)]

    found = solve(evaluate, {"values": np.zeros((1, 3))})
    assert np.allclose(found.parameters["values"], [[1.0, 2.0, 0.0]], atol=1e-3)
    assert np.allclose(found.sigmas("values")[0, :2], [0.05, 0.5], rtol=1e-3)


def test_noise_of_groups() -> None:
    rng = np.random.default_rng(3)
    groups = np.repeat([0, 1], 500)
    values = rng.normal(size=(1000, 2)) * np.where(groups, 3.0, 0.5)[:, None]
    found = estimate_noise(values, groups)
    assert found[0] == pytest.approx(0.5, rel=0.1) and found[-1] == pytest.approx(3, rel=0.1)
    assert estimate_noise(values[:4], groups[:4], least=9.0)[0] == 9.0


def test_measurements_of_the_same_items_are_multiplied_as_full_matrices() -> None:
    """In any other order they are sparse rows, with the same result."""
    random = np.random.default_rng(5)
    items, slopes = np.repeat(np.arange(4), 50), random.normal(size=(200, 2, 3))
    values = slopes @ [1.0, -2.0, 0.5] + random.normal(0, 0.01, (200, 2))
    values[7] = np.nan

    def fit(order: np.ndarray) -> Solution:
        def evaluate(at: Parameters) -> list[Residuals]:
            which = items[order]
            shown = np.einsum("mrs,ms->mr", slopes[order], at["own"][which] + at["all"][0])
            by = [Slope("own", which, slopes[order]), Slope("all", 0 * which, slopes[order])]
            return [Residuals(shown - values[order], by), prior("own", at["own"], 0.1)]

        start = {"own": np.zeros((4, 3)), "all": np.zeros((1, 3))}
        return solve(
            evaluate, start, eliminate=["own"], free={"own": np.arange(3) != np.ones((4, 1))}
        )

    together, apart = fit(np.arange(200)), fit(np.argsort(np.arange(200) % 50, kind="stable"))
    np.testing.assert_allclose(together.parameters["all"], [[1, -2, 0.5]], atol=0.01)
    for name, found in together.parameters.items():
        np.testing.assert_allclose(found, apart.parameters[name], atol=1e-9)
        np.testing.assert_allclose(
            together.covariance(name), apart.covariance(name), rtol=1e-6, atol=1e-12
        )
