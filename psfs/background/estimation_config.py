"""Settings of the background's estimation from pictures of the empty scene or from the take."""

from __future__ import annotations

from typing import ClassVar

from psfs.common.config import Config, setting


class BackgroundModelConfig(Config):
    """Settings of the background's estimation from pictures of the empty scene, see
    `psfs.background.gaussian`."""

    SOURCE: ClassVar = "by hand"

    std_floor: float = setting(
        2.0,
        "Least standard deviation that is learnt: a noiseless background must not make "
        "N(I; mu, sigma) explode.",
        unit="grey levels",
        above=0,
    )
    prior_std: float = setting(
        6.0,
        "Standard deviation that is believed in before any frame is seen.",
        unit="grey levels",
        above=0,
    )
    prior_frames: float = setting(
        2.0,
        "Weight of `prior_std`. A single picture as background thus gets 4.9 grey levels.",
        unit="frames",
        least=0,
    )
    clip: float = setting(
        3.0,
        "Distance from the mean beyond which a value is left out of it.",
        "the usual 3 sigma",
        "standard deviations",
        above=0,
    )
    samples: int = setting(
        25,
        "Number of frames that a background is learnt from when the scene is never empty.",
        "by hand: enough for a median",
        "frames",
        least=1,
    )
    mixture_samples: int = setting(
        50,
        "Number of frames that mixtures of Gaussians are learnt from when the scene is never "
        "empty.",
        unit="frames",
        least=1,
    )
    mixture_rate: float = setting(
        0.0005,
        "Share of a frame in a mixture that goes on learning, alpha of Rymut 2016 eq. (2.5). "
        "OpenCV takes for scene what is a tenth of the mixture, so somebody may stand still for "
        "210 frames.",
        "by hand; Rymut does not state his",
        least=0,
        most=1,
    )


class TakeConfig(Config):
    """Settings of the background's estimation from a take with people in it, see
    `psfs.background.take`."""

    SOURCE: ClassVar = (
        "by hand, on synth_box_4cam, synth_pickup_6cam, synth_walk_4cam without their plates"
    )

    longest_side: int = setting(
        320,
        "Longest side of the small pictures that people are looked for in.",
        unit="px",
        least=32,
    )
    moving: float = setting(
        18.0,
        "Change of a pixel over the take from which on something moved there.",
        unit="grey levels",
        above=0,
    )
    gap: int = setting(9, "Width of gaps between what moved that are closed.", unit="px", least=1)
    least_area: float = setting(40.0, "Area below which what moved is noise.", unit="px^2", least=0)
    around: int = setting(
        30,
        "Distance from what moved of the pixels that say how the background looks.",
        unit="px",
        least=1,
    )
    unlike: float = setting(
        14.0,
        "Difference from the background around from which on a pixel looks like somebody at first.",
        unit="grey levels",
        least=0,
    )
    cuts: int = setting(4, "Number of iterations of GrabCut.", least=1)
    voxels: int = setting(
        60_000, "Number of voxels of the coarse hull, at most.", unit="voxels", least=1000
    )
    explained: float = setting(
        0.62,
        "Share of the silhouettes before the medians that all cameras' hull must explain, else "
        "somebody is looked for in the medians.",
        "between people who walk about (0.78) and who stay in a place (0.39, 0.46)",
        least=0,
        most=1,
    )
    judged: int = setting(4, "Number of samples of which one is judged so.", least=1)
    denials: int = setting(
        1,
        "Number of cameras, of more than three, that may deny a voxel: their background may hold "
        "somebody.",
        least=0,
    )
    margin: int = setting(1, "Distance by which the hull's picture is grown.", unit="px", least=0)
    somebody: float = setting(
        5.0,
        "Distance from the background from which on a pixel is somebody.",
        unit="standard deviations",
        above=0,
    )
    shadow_width: float = setting(
        0.06, "Standard deviation of the light factor around 1 of what is background.", above=0
    )
    rounds: int = setting(
        3, "Number of times that hull and background are made of each other, at most.", least=1
    )
    rest: float = setting(
        0.002,
        "Share of the pixels that change sides below which nothing more is learnt.",
        least=0,
        most=1,
    )
    least_free: int = setting(
        3, "Number of frames that must show a pixel of the background.", unit="frames", least=1
    )
    free_share: float = setting(
        0.1, "Share of the frames that must show a pixel of the background.", least=0, most=1
    )
    hidden_prior: float = setting(
        1.0,
        "Log odds of somebody where the background is never seen and its median looks like "
        "somebody.",
        unit="nats",
        least=0,
    )
