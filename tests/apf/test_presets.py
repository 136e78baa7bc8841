"""Presets: every file is one of settings that there are, and what a paper does not have is off."""

from pathlib import Path

import pytest
from helpers.commands import fail, state_track

from apf.body.toml import load_body
from apf.filters.config import FilterConfig
from apf.filters.method import Method
from apf.filters.term_weights import parse_weights
from apf.presets import PRESETS, Preset, preset
from apf.request import TrackRequest
from cl import InputError


def parsed(*flags: str) -> TrackRequest:
    """The request of `apf track walk -o out FLAGS`."""
    return TrackRequest.from_stated(state_track("walk", "-o", "out", *flags))


def method_of(*flags: str) -> Method:
    return parsed(*flags).method


@pytest.mark.parametrize("name", PRESETS)
def test_the_command_takes_what_the_library_has(name: str) -> None:
    found, args = preset(name), parsed("--preset", name)
    assert method_of("--preset", name) == found.method
    assert args.reconstruction == found.reconstruction and args.all_cameras
    assert (args.body, args.capture.background) == (found.body, found.background)
    assert load_body(found.body or "").n_dof == 31
    assert not found.method.recover and not found.method.filter.searches_limbs
    for path in PRESETS[name]:  # a comment before every setting, or the one of its kind
        text = path.read_text()
        assert "#" in text.splitlines()[0] and "eq." in text.lower()


def test_song_is_what_the_paper_has() -> None:
    settings = preset("song").method.filter.settings
    terms = {k: v for k, v in settings.items() if k.endswith("_weight") or k == "least_recall"}
    assert {k for k, v in terms.items() if v} == {"edge_weight", "silhouette_weight"}
    assert terms["edge_weight"] == terms["silhouette_weight"] == 1.0  # eq. (16)
    off = ("refinement_steps", "limb_search_reach", "trunk_layers", "velocity")
    assert not any(settings[name] for name in off) and not settings["foreground_join"]
    assert (settings["n_particles"], settings["n_layers"]) == (200, 10)
    named = FilterConfig.create(**parse_weights("edge=1,silhouette"))
    assert named.likelihood == preset("song").method.filter.likelihood
    silhouette = preset("song").reconstruction.silhouette
    assert not silhouette.floor.on and not silhouette.rim.on and silhouette.smoothing.reach == 0


def test_rymut_sums_distances_along_edges_and_the_impulse_is_an_option() -> None:
    near = preset("rymut").method.features.proximity
    assert (near.function, near.metric) == ("proportional", "chessboard")
    assert (near.nearest, near.farthest, near.span) == (10.0, 100.0, 0.25)  # figure 4.12
    impulse = method_of("--preset", "rymut", "--proximity", "impulse").features.proximity
    assert impulse == near.replace(function="impulse")


def test_flags_and_config_beat_a_preset(tmp_path: Path) -> None:
    file = tmp_path / "own.toml"
    file.write_text('voxel-size = 0.03\nbody = "rymut31"\n[method.filter.search]\nnoise = 0.7\n')
    method = method_of("--preset", "song", "--config", str(file), "--layers", "4")
    assert method.filter.settings["noise"] == 0.7 and method.filter.settings["n_layers"] == 4
    assert method.filter.settings["trunk_layers"] == 0  # the preset's
    args = parsed("--preset", "song", "--config", str(file), "--body", "song31")
    assert args.body == "song31" and args.voxel_size == 0.03 and args.all_cameras
    file.write_text('preset = "kwolek"\n')
    assert method_of("--config", str(file)) == preset("kwolek").method
    other = method_of("--preset", "song", "--method", "sir", "--particles", "900")
    assert other.search == "sir" and other.filter.settings["surface_weight"] == 0


def test_unknown_presets(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="preset 'deutscher'; expected kwolek, rymut, song"):
        preset("deutscher")
    file = tmp_path / "own.toml"
    file.write_text('preset = "deutscher"\n')
    said = fail("apf", "track", "walk", "-o", tmp_path / "out", "--config", file)
    assert "expected one of kwolek, rymut, song" in said
    assert Preset().method == Method()


def test_a_body_is_not_the_folder_of_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "dog").mkdir()
    (tmp_path / "cat.toml").touch()
    assert parsed("--body", "dog").body == "dog"
    assert parsed("--body", "cat.toml").body == str(tmp_path / "cat.toml")
