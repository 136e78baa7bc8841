"""The terms of the likelihood by name, and the settings of a filter that weigh them."""

from __future__ import annotations

from apf.filters.config import FilterConfig
from apf.likelihood.config import LikelihoodConfig
from apf.likelihood.terms import TERMS as REGISTERED
from cl import InputError


def _usual_terms() -> dict[str, str]:
    """Return the settings that weigh the terms which are on by default, by the term's name."""
    default = LikelihoodConfig()
    return {
        "edge": "edge_weight",
        "silhouette": "silhouette_weight",
        "surface": "surface_weight",
        "overlap": "overlap_weight",
        "posture": "posture_prior_weight",
        **{name: f"{name}_weight" for name in default.terms},
        "pictures": "foreground_join",
    }


def _other_terms() -> dict[str, tuple[str, float]]:
    """Return those of the other terms, with the weight that they have when they are chosen by name.
    Silhouette recall weighs as in the limb search; keypoints by hand."""
    usual = LikelihoodConfig().terms
    others = {t.name: (f"{t.name}_weight", t.chosen_weight) for t in REGISTERED.values()}
    return {
        "silhouette_recall": ("silhouette_recall_weight", 2.0),
        **{name: weighed for name, weighed in others.items() if name not in usual},
        "keypoints": ("keypoints_weight", 4.0),
    }


#: Terms that compare nothing with observations, and those that need pictures.
_PRIORS = ("overlap", "posture", "pictures")
_OF_PICTURES = ("contour", "part_colour")
_USUAL_TERMS, _OTHER_TERMS = _usual_terms(), _other_terms()
#: The default weight of keypoints where another option than their weight turns them on.
KEYPOINTS_ON = dict([_OTHER_TERMS["keypoints"]])
USUAL_TERMS = tuple(_USUAL_TERMS)
TERMS = (*USUAL_TERMS, *_OTHER_TERMS)


def list_comparing_weights(pictures: bool = True) -> dict[str, str]:
    """Return the terms that compare the body with observations, by the settings that weigh them;
    without pictures only those that need none."""
    weighed = {term: name for term, (name, _) in _OTHER_TERMS.items()} | _USUAL_TERMS
    left_out = _PRIORS if pictures else (*_PRIORS, *_OF_PICTURES)
    return {name: term for term, name in weighed.items() if term not in left_out}


def parse_weights(text: str) -> dict[str, float]:
    """Return the settings of a FilterConfig for `edge,silhouette=2`: these terms with their default
    weights or the stated ones, all others 0, in the limb search, too.

    Raises InputError for unknown terms and bad weights.
    """
    defaults = FilterConfig().settings
    usual = {term: (name, defaults[name]) for term, name in _USUAL_TERMS.items()} | _OTHER_TERMS
    weights = {name: type(weight)(0) for name, weight in usual.values()}
    weights["limb_search_least_recall"] = 0.0
    for entry in text.split(","):
        term, _, value = entry.partition("=")
        if term not in TERMS:
            raise InputError(f"likelihood {text!r}: no term {term!r}; expected {', '.join(TERMS)}")
        name, weight = usual[term]
        try:
            weights[name] = type(weight)(float(value or weight))
        except ValueError:
            raise InputError(f"likelihood {text!r}: {value!r} is no weight of {term}") from None
    return weights
