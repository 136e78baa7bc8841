"""Draw a calibration: each camera's points and errors, and the rig from above and from the side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from psfs.calibration.calibrator import CalibrationResult
from psfs.calibration.report import CELLS, ViewReport
from psfs.calibration.scene import GOOD
from psfs.common.files import write_atomically

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_INK, _ALARM = "#30343B", "#B3261E"
_STYLE: Any = {
    "font.size": 9.5,
    "axes.edgecolor": "#999999",
    "text.color": _INK,
    "axes.labelcolor": _INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
}
#: Margins of a figure, in shares of its size.
_MARGINS: Any = {
    "left": 0.05, "right": 0.98, "bottom": 0.1, "top": 0.9, "wspace": 0.15, "hspace": 0.3
}  # fmt: skip
_WRAP = 62  # characters of a line of text


def write_view(path: Path, view: ViewReport, picture: np.ndarray | None) -> None:
    """Write a camera's page as a picture.

    It shows the points over `picture` (BGR), coloured by error, with cells without points hatched;
    the histogram of the errors; and the figures, with faults in red.
    """

    def draw(figure: Figure) -> None:
        grid = figure.add_gridspec(2, 2, width_ratios=[1.5, 1], height_ratios=[1, 1.25], **_MARGINS)
        _draw_coverage(figure, figure.add_subplot(grid[:, 0]), view, picture)
        _draw_histogram(figure.add_subplot(grid[0, 1]), view)
        _draw_text(figure.add_subplot(grid[1, 1]), view)

    _write(path, (12, 5.2), draw)


def write_rig(path: Path, result: CalibrationResult, views: list[ViewReport]) -> None:
    """Write the cameras and the target's positions from above and from the side, m."""

    def draw(figure: Figure) -> None:
        points = [result.scene.points(frame) for frame in result.scene.poses]
        cloud = np.concatenate(points)
        for axes, (a, b), title in zip(
            figure.subplots(1, 2, gridspec_kw=_MARGINS),
            ((0, 1), (0, 2)),
            ("from above", "from the side"),
            strict=True,
        ):
            axes.plot(cloud[:, a], cloud[:, b], ".", ms=2, color="#8FA7C4", alpha=0.5)
            for view in views:
                colour = _ALARM if view.faults else _INK
                centre, ahead = view.camera.centre, view.camera.R[2]
                axes.annotate(
                    "", centre[[a, b]] + 0.6 * ahead[[a, b]], centre[[a, b]],
                    arrowprops={"arrowstyle": "->", "color": colour},
                )  # fmt: skip
                axes.plot(*centre[[a, b]], "s", ms=6, color=colour)
                axes.annotate(view.camera.name, centre[[a, b]], (5, 5), textcoords="offset points")
            axes.plot([0, 0.5], [0, 0], color="#C0392B", lw=2)
            axes.plot([0, 0], [0, 0.5], color="#27AE60" if b == 1 else "#2962B3", lw=2)
            axes.margins(0.12)
            axes.set(aspect="equal", title=title, xlabel="X, m", ylabel=f"{'XYZ'[b]}, m")
            axes.grid(color="#EEEEEE")
        name = result.scene.target.name
        figure.suptitle(f"{len(views)} cameras; {name}; axes of 0.5 m at the origin")

    _write(path, (12, 5.6), draw)


def _write(path: Path, size: tuple[float, float], draw: Any) -> None:
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=size)  # a layout engine would draw everything three times
        FigureCanvasAgg(figure)
        draw(figure)
        with write_atomically(path) as temporary:
            figure.savefig(temporary, dpi=100)


def _draw_coverage(
    figure: Figure, axes: Axes, view: ViewReport, picture: np.ndarray | None
) -> None:
    from matplotlib.patches import Rectangle

    width, height = view.camera.size
    if picture is not None:
        pale = 255 - (255 - cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)) // 2
        axes.imshow(pale, extent=(-0.5, width - 0.5, height - 0.5, -0.5))
    step = width / CELLS[0], height / CELLS[1]
    for row, column in zip(*np.nonzero(~view.coverage.cells), strict=True):
        corner = column * step[0] - 0.5, row * step[1] - 0.5
        axes.add_patch(Rectangle(corner, *step, fill=False, hatch="///", ec="#707070", lw=0))
    order = np.argsort(view.errors)
    drawn = axes.scatter(
        view.pixels[order, 0], view.pixels[order, 1], c=view.errors[order], s=7, cmap="viridis_r",
        vmin=0, vmax=max(GOOD, float(np.percentile(view.errors, 95))),
    )  # fmt: skip
    figure.colorbar(drawn, ax=axes, label="reprojection error, px", shrink=0.8)
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal")
    covered = f"points in {100 * view.coverage.share:.0f} % of the picture (hatched: none)"
    axes.set_title(f"{view.camera.name}: {covered}", loc="left", fontweight="bold")


def _draw_histogram(axes: Axes, view: ViewReport) -> None:
    figures = view.figures()
    top = max(GOOD, 1.5 * figures["p95"])
    axes.hist(view.errors.clip(0, top), bins=40, range=(0, top), color="#6A8CB5")
    for name, style in (("median", "-"), ("p95", "--")):
        axes.axvline(figures[name], color=_INK, ls=style, lw=1)
    axes.set(xlabel="reprojection error, px", ylabel="points", xlim=(0, top))
    axes.set_title("median (line) and 95 % (dashes)", fontsize=9.5, loc="left")


def _draw_text(axes: Axes, view: ViewReport) -> None:
    import textwrap

    figures, camera, seen = view.figures(), view.camera, view.coverage
    lines = [
        f"error, px: mean {figures['mean']:.3f}, median {figures['median']:.3f}, "
        f"95 % {figures['p95']:.3f}",
        f"{seen.frames} frames, at most {seen.shared} shared with another camera, "
        f"{view.dropped} left out as false",
        f"focal length {camera.K[0, 0]:.1f}, {camera.K[1, 1]:.1f} px; centre "
        f"{camera.K[0, 2]:.1f}, {camera.K[1, 2]:.1f}",
        "distortion " + " ".join(f"{value:.4f}" for value in camera.distortion),
        "position, m: " + ", ".join(f"{value:.3f}" for value in camera.centre),
    ]
    axes.axis("off")
    text = "\n".join(textwrap.fill(line, _WRAP) for line in lines)
    axes.text(0, 1, text, va="top", transform=axes.transAxes, linespacing=1.4)
    faults = "\n".join(textwrap.fill(fault, _WRAP) for fault in view.faults)
    axes.text(0, 0.0, faults, va="bottom", transform=axes.transAxes, color=_ALARM, linespacing=1.3)
