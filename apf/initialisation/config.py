"""Settings of the automatic start."""

from __future__ import annotations

from functools import partial
from typing import ClassVar

from pydantic import Field

from apf.filters.config import FilterConfig
from psfs.common.config import Config, natural, positive


class StartConfig(Config):
    """The frames of an automatic start and its searches."""

    SOURCE: ClassVar = "tuned"

    n_frames: int = natural(20, "Most frames that the body is fitted to.")
    duration: float = positive(
        1.0,
        "Time over which these frames are spread; as long as a stride, so that the legs separate.",
        unit="s",
    )
    n_searched: int = natural(
        4, "Number of these frames that are searched over all headings, first and last among them."
    )
    n_headings: int = natural(8, "Number of headings from which the search begins, evenly around.")
    n_kept: int = natural(3, "Number of best headings that are followed through the frames.")
    #: A visual hull of few cameras is thicker than the person, so that a wrongly turned or bent
    #: body fills it as well. Silhouettes and edges therefore have more weight than in tracking.
    filter: FilterConfig = Field(
        default_factory=partial(
            FilterConfig.create,
            surface_weight=1.0,
            silhouette_recall_weight=2.0,
            contour_weight=4.0,
            part_colour_weight=0.0,  # the colours of the parts are not estimated yet
        )
    )
