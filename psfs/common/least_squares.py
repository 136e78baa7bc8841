"""Robust nonlinear least squares over named blocks of parameters.

Parameters are arrays (items, size) by name: `{"cameras": (V, 8), "points": (P, 3)}`. A function
returns `Residuals`: measurements with their slopes by the items on which each depends, priors among
them. `solve` minimises the sum of their robust squares with the Levenberg-Marquardt method and
sparse normal equations, from which blocks of many items are eliminated (Schur complement; Triggs et
al., Bundle Adjustment, 2000). The noise of measurements is estimated from the residuals, so the
covariance of the parameters has the unit of the parameters without further scaling.

    def evaluate(parameters):
        errors, by_camera, by_point = reproject(parameters["cameras"], parameters["points"])
        slopes = [Slope("cameras", views, by_camera), Slope("points", rows, by_point)]
        return [Residuals(errors, slopes), prior("cameras", parameters["cameras"], spread)]

    found = solve(evaluate, {"cameras": cameras, "points": points}, eliminate=["points"])
    found.parameters["cameras"], found.sigmas("cameras")
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy

#: Values by name, (items, size) each.
Parameters = Mapping[str, np.ndarray]
#: Distance, in standard deviations, at which the weight of a measurement is a quarter: Geman and
#: McClure's estimator then has 95 % of the precision of least squares if noise is normal.
REACH = 2.5
#: Fewest measurements whose noise is estimated apart.
LEAST_GROUP = 10
#: Fewest numbers that depend on the same items, on average, whose derivatives are full matrices.
_LEAST_RUN = 16
#: A step is the last if parameters move by less than this share of their standard deviations.
_SETTLED = 1e-2
#: Damping of the first step, as a share of the diagonal.
_DAMPING = 1e-4


@dataclass(frozen=True, eq=False)
class Slope:
    """Derivatives of measurements by a block of parameters.

    name: of the block. items: (M,) int, the item of the block on which each measurement depends.
    values: (M, R, size).
    """

    name: str
    items: np.ndarray
    values: np.ndarray


@dataclass(frozen=True, eq=False)
class Residuals:
    """M measurements of R numbers each, and what they depend on.

    values: (M,) or (M, R), found less expected; NaN where there is none, infinite where parameters
    cannot be. sigma: their standard deviation, a number or (M,); None: estimated from the residuals
    by the median, but at least `least`. weights: (M,) how many independent measurements each is; 1
    by default. robust: whether measurements may be wrong. through: if numbers (M,) depend on the
    parameters by way of the coordinates of L items alone, as points by those of the part that they
    touch, `slopes` is one, by these coordinates, and `through` holds theirs (L, size of
    coordinates, size) by each block.
    """

    values: np.ndarray
    slopes: Sequence[Slope]
    sigma: np.ndarray | float | None = None
    weights: np.ndarray | float = 1.0
    robust: bool = True
    least: float = 1e-9
    through: Sequence[Slope] = ()

    @property
    def rows(self) -> np.ndarray:
        """The residuals (M, R), NaN as 0."""
        return np.nan_to_num(_as_rows(self.values))

    @property
    def known(self) -> np.ndarray:
        """Which measurements (M,) there are."""
        return np.all(np.isfinite(_as_rows(self.values)), axis=1)

    def noise(self) -> np.ndarray:
        """Return the standard deviation (M,) of each number."""
        if self.sigma is not None:
            return np.broadcast_to(np.asarray(self.sigma, float), len(self.values))
        return estimate_noise(self.values, least=self.least)


def _as_rows(values: np.ndarray) -> np.ndarray:
    """Return values (M,) or (M, R) as (M, R)."""
    return values[:, None] if values.ndim == 1 else values


def estimate_noise(
    values: np.ndarray, groups: np.ndarray | None = None, least: float = 0.0
) -> np.ndarray:
    """Return the standard deviation (M,) of the numbers of residuals (M,) or (M, R): that of normal
    noise with their median size, of each group by itself; small groups have the noise of all."""
    rows = _as_rows(values)
    size = np.linalg.norm(rows, axis=1)
    known = np.isfinite(size)
    normal = float(np.sqrt(scipy.special.chdtri(rows.shape[1], 0.5)))
    usual = np.median(size[known]) if known.any() else 0.0
    noise = np.full(len(size), usual)
    if groups is not None:
        for number in np.unique(groups):
            mine = known & (groups == number)
            if np.count_nonzero(mine) >= LEAST_GROUP:
                noise[groups == number] = np.median(size[mine])
    return np.maximum(noise / normal, least)


def robust_weights(values: np.ndarray, noise: np.ndarray | float) -> np.ndarray:
    """Return the weights (M,), from 0 to 1, of residuals (M,) or (M, R) with a standard deviation
    `noise` of each number (Geman & McClure 1987)."""
    rows = _as_rows(values)
    square = np.square(rows).sum(axis=1) / rows.shape[1]
    return np.nan_to_num(1 / (1 + square / np.square(REACH * np.asarray(noise))) ** 2)


def _find_runs(slopes: Sequence[Slope]) -> np.ndarray:
    """Return where runs (N,) of measurements begin that depend on the same items."""
    items = np.stack([slope.items for slope in slopes])
    changes = (items[:, 1:] != items[:, :-1]).any(axis=0)
    return np.flatnonzero(np.append(items.shape[1] > 0, changes))


def multiply_alike(key: np.ndarray, rows: np.ndarray, count: int) -> np.ndarray:
    """Return the products (count, W, W) of the transposed rows (K, W) with themselves, of those of
    each `key` (K,) from 0 on."""
    order = np.argsort(key, kind="stable")
    rows, ends = rows[order], list(np.searchsorted(key[order], np.arange(count + 1)))
    products = np.empty((count, *2 * rows.shape[1:]))
    for product, first, last in zip(products, ends, ends[1:], strict=False):
        np.matmul(rows[first:last].T, rows[first:last], out=product)
    return products


def prior(
    name: str, values: np.ndarray, sigma: np.ndarray | float, mean: np.ndarray | float = 0.0
) -> Residuals:
    """Return the residuals of values (items, size) of a block, normal around `mean` with standard
    deviations `sigma`; infinite ones are free."""
    share = 1 / np.broadcast_to(np.asarray(sigma, float), values.shape)
    slopes = share[:, :, None] * np.eye(values.shape[1])
    slope = Slope(name, np.arange(len(values)), slopes)
    return Residuals((values - mean) * share, [slope], sigma=1.0, robust=False)


def differentiate(
    function: Callable[..., np.ndarray], *arguments: np.ndarray, step: float = 1e-6
) -> list[np.ndarray]:
    """Return the derivatives (M, R, size) of a function's values (M, R) by each of its arguments
    (M, size), by differences. Row m of the values depends on row m of the arguments alone."""
    derivatives = []
    for at, argument in enumerate(arguments):
        columns = []
        for moved in step * np.eye(argument.shape[1]):
            sides = [
                function(*arguments[:at], argument + sign * moved, *arguments[at + 1 :])
                for sign in (1, -1)
            ]
            columns.append((sides[0] - sides[1]) / (2 * step))
        derivatives.append(np.stack(columns, axis=-1))
    return derivatives


def add_step(parameters: Parameters, step: Parameters) -> Parameters:
    """Return the parameters moved by a step."""
    return {name: values + step[name] for name, values in parameters.items()}


@dataclass(frozen=True, eq=False)
class Solution:
    """Parameters of the least robust sum of squares.

    parameters: by name. residuals: the last evaluation. cost: sum of robust squares, in variances
    of the noise.
    """

    parameters: Parameters
    residuals: Sequence[Residuals]
    cost: float
    _layout: _Layout = field(repr=False)
    _factor: _Factor = field(repr=False)

    def covariance(self, name: str, items: Sequence[int] | None = None) -> np.ndarray:
        """Return the covariance (N, N) of a block's values, item by item; of some items only, if
        these are stated. Parameters that are held have none, 0."""
        columns = self._layout.columns(name, items)
        right = np.zeros((self._layout.size, len(columns)))
        inside = np.flatnonzero(columns >= 0)
        right[columns[inside], inside] = 1.0
        solved = self._factor.solve(right)
        return np.where((columns >= 0)[:, None], solved[columns], 0.0)

    def sigmas(self, name: str) -> np.ndarray:
        """Return the standard deviations (items, size) of a block's values."""
        variances = np.diag(self.covariance(name))
        return np.sqrt(np.maximum(variances, 0.0)).reshape(self.parameters[name].shape)


def solve(
    evaluate: Callable[[Parameters], Sequence[Residuals]],
    start: Parameters,
    *,
    steps: int = 50,
    eliminate: Sequence[str] = (),
    free: Mapping[str, np.ndarray] | None = None,
    update: Callable[[Parameters, Parameters], Parameters] = add_step,
) -> Solution:
    """Minimise the sum of robust squares of the residuals that `evaluate` returns.

    steps: the most Levenberg-Marquardt steps. eliminate: names of blocks with many items that
    depend on few others, as points do. free: masks (items, size) of the values that are estimated;
    all by default. update: moves parameters by a step, for those that do not add up.
    """
    layout = _Layout(start, free or {}, eliminate)
    damping, parameters, residuals = _DAMPING, start, evaluate(start)
    noises = [block.noise() for block in residuals]
    normal, gradient = layout.linearise(residuals, noises)
    for _ in range(steps):
        change = -_Factor(normal, layout, damping).solve(gradient[:, None])[:, 0]
        trial = update(parameters, layout.split(change))
        tried = evaluate(trial)
        settled = -float(gradient @ change) < _SETTLED**2
        if _cost(tried, noises) <= _cost(residuals, noises):
            parameters, residuals, damping = trial, tried, damping / 10
            noises = [block.noise() for block in residuals]
            normal, gradient = layout.linearise(residuals, noises)
        else:
            damping = max(10 * damping, 10 * _DAMPING)
        if settled:
            break
    cost = _cost(residuals, noises)
    return Solution(parameters, residuals, cost, layout, _Factor(normal, layout, 0.0))


def _cost(residuals: Sequence[Residuals], noises: Sequence[np.ndarray]) -> float:
    """Return the sum of the robust squares; infinite for parameters that cannot be."""
    total = 0.0
    for block, noise in zip(residuals, noises, strict=True):
        rows = _as_rows(block.values)
        square = np.nan_to_num(np.square(rows).sum(axis=1) / noise**2, posinf=np.inf)
        if block.robust:
            square = square / (1 + square / (REACH**2 * rows.shape[1]))
        total += float((square * block.weights).sum())
    return total if np.isfinite(total) else np.inf


class _Layout:
    """Where each value of each block stands among all free values, the eliminated ones last."""

    def __init__(
        self, start: Parameters, free: Mapping[str, np.ndarray], eliminate: Sequence[str]
    ) -> None:
        self._places: dict[str, np.ndarray] = {}
        self.size = self.kept = 0
        for name in sorted(start, key=lambda block: block in eliminate):
            mask = np.asarray(free.get(name, np.ones(start[name].shape, bool)))
            places = np.full(mask.shape, -1)
            places[mask] = self.size + np.arange(mask.sum())
            self._places[name] = places
            self.size += int(mask.sum())
            if name not in eliminate:
                self.kept = self.size

    def columns(self, name: str, items: Sequence[int] | None) -> np.ndarray:
        """Return the columns (N,) of a block's values, -1 where they are held."""
        places = self._places[name]
        return (places if items is None else places[list(items)]).ravel()

    def split(self, change: np.ndarray) -> dict[str, np.ndarray]:
        """Return the changes of all blocks, 0 where values are held."""
        padded = np.append(change, 0.0)
        return {name: padded[places] for name, places in self._places.items()}

    def linearise(
        self, residuals: Sequence[Residuals], noises: Sequence[np.ndarray]
    ) -> tuple[scipy.sparse.csc_matrix, np.ndarray]:
        """Return the normal matrix and the gradient of all free values."""
        normal, gradient = scipy.sparse.csc_matrix((self.size, self.size)), np.zeros(self.size)
        for block, noise in zip(residuals, noises, strict=True):
            share = block.known * np.asarray(block.weights, float) / noise**2
            if block.robust:
                share = share * robust_weights(block.rows, noise)
            roots, run = np.sqrt(share)[:, None], _find_runs(block.slopes)
            if block.through:
                squares, pull = self._multiply_through(block, roots)
            elif len(run) * _LEAST_RUN < block.rows.size:
                squares, pull = self._multiply_runs(block, roots, run)
            else:
                rows = self._rows(block, roots)
                squares, pull = (rows.T @ rows).tocsc(), rows.T @ (roots * block.rows).ravel()
            normal, gradient = normal + squares, gradient + pull
        return normal, gradient

    def _multiply_runs(
        self, of: Residuals, roots: np.ndarray, run: np.ndarray
    ) -> tuple[scipy.sparse.csc_matrix, np.ndarray]:
        """Return the normal matrix and the gradient of measurements in runs that begin at `run`
        (N,), see `_find_runs`: a product of full matrices each."""
        used = np.flatnonzero(roots)
        values = np.concatenate([slope.values[used] for slope in of.slopes], axis=2)
        values, right = np.nan_to_num(values) * roots[used, :, None], (roots * of.rows)[used]
        width, ends = values.shape[2], list(np.searchsorted(used, [*run, len(roots)]))
        blocks, pulls = np.empty((len(run), width, width)), np.empty((len(run), width))
        for block, pull, first, last in zip(blocks, pulls, ends, ends[1:], strict=False):
            rows = values[first:last].reshape(-1, width)
            np.matmul(rows.T, rows, out=block)
            np.matmul(right[first:last].ravel(), rows, out=pull)
        return self._gather(of.slopes, run, blocks, pulls)

    def _multiply_through(
        self, block: Residuals, roots: np.ndarray
    ) -> tuple[scipy.sparse.csc_matrix, np.ndarray]:
        """Return the normal matrix and the gradient of measurements that depend on the parameters
        by way of a few coordinates: these are multiplied first, the parameters' slopes after."""
        used, (slope,) = np.flatnonzero(roots), block.slopes
        rows = np.concatenate([slope.values[used, 0], block.rows[used]], axis=1) * roots[used]
        items, key = np.unique(slope.items[used], return_inverse=True)
        products = multiply_alike(key, rows, len(items))
        through = [Slope(by.name, by.items[items], by.values[items]) for by in block.through]
        values, run = np.concatenate([by.values for by in through], axis=2), _find_runs(through)
        turned = values.swapaxes(1, 2) @ products[:, :-1]
        blocks = np.add.reduceat(turned[..., :-1] @ values, run)
        return self._gather(through, run, blocks, np.add.reduceat(turned[..., -1], run))

    def _gather(
        self, slopes: Sequence[Slope], run: np.ndarray, blocks: np.ndarray, pulls: np.ndarray
    ) -> tuple[scipy.sparse.csc_matrix, np.ndarray]:
        """Return the normal matrix and the gradient that the blocks (N, W, W) and the pulls (N, W)
        of runs of measurements add up to."""
        columns, gradient = self._columns(slopes, run), np.zeros(self.size + 1)
        np.add.at(gradient, columns, pulls)
        both = np.broadcast_arrays(columns[:, :, None], columns[:, None], blocks)
        row, column, entries = (each.ravel() for each in both)
        free = (row >= 0) & (column >= 0)
        shape = self.size, self.size
        matrix = scipy.sparse.csc_matrix((entries[free], (row[free], column[free])), shape=shape)
        return matrix, gradient[:-1]

    def _columns(
        self, slopes: Sequence[Slope], rows: np.ndarray | slice = slice(None)
    ) -> np.ndarray:
        """Return the columns (M, W) of the Jacobian that some rows of slopes belong to; -1 for
        parameters that are held."""
        return np.concatenate(
            [self._places[slope.name][slope.items[rows]] for slope in slopes], axis=1
        )

    def _rows(self, block: Residuals, roots: np.ndarray) -> scipy.sparse.csr_matrix:
        """Return the weighted rows (M R, size) of the Jacobian."""
        count, width = block.rows.shape
        values = np.concatenate([slope.values for slope in block.slopes], axis=2)
        row, column, entries = np.broadcast_arrays(
            np.arange(count * width).reshape(count, width, 1),
            self._columns(block.slopes)[:, None],
            np.nan_to_num(values) * roots[..., None],
        )
        filled = (column >= 0) & (entries != 0)
        at = row[filled], column[filled]
        return scipy.sparse.csr_matrix((entries[filled], at), shape=(count * width, self.size))


class _Factor:
    """Solves the normal equations, damped by a share of their diagonal. Values of which nothing is
    known stay."""

    def __init__(self, normal: scipy.sparse.csc_matrix, layout: _Layout, damping: float) -> None:
        diagonal = normal.diagonal()
        ridge = np.where(diagonal > 0, (damping + 1e-12) * diagonal, 1.0)
        normal = (normal + scipy.sparse.diags(ridge)).tocsc()
        self._kept = kept = layout.kept
        self._last: Any = None
        matrix = normal[:kept, :kept].toarray()
        if kept < layout.size:
            self._mixed = normal[:kept, kept:].tocsr()
            self._last = scipy.sparse.linalg.splu(
                normal[kept:, kept:].tocsc(), permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0, options={"SymmetricMode": True},
            )  # fmt: skip
            matrix -= self._mixed @ self._last.solve(self._mixed.T.toarray())
        # Scaled to a diagonal of ones: parameters have units of their own.
        self._scale = 1 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        scaled = matrix * np.outer(self._scale, self._scale)
        values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
        self._inverse = (vectors / np.maximum(values, 1e-13)) @ vectors.T

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Return the solution (size, N) of the right sides (size, N)."""
        first, scale = right[: self._kept], self._scale[:, None]
        if self._last is None:
            return scale * (self._inverse @ (scale * first))
        eliminated = self._last.solve(np.ascontiguousarray(right[self._kept :]))
        first = scale * (self._inverse @ (scale * (first - self._mixed @ eliminated)))
        rest = eliminated - self._last.solve(self._mixed.T @ first)
        return np.concatenate([first, rest])
