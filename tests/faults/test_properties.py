"""Readers given generated files: they give what was written, or one clear error."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from helpers import bodies, footage
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from apf.body.toml import load_body, save_body
from apf.formats.pose import read_pose
from apf.formats.trc import read_trc
from cl import InputError
from psfs.cameras.calibration import read_calibration
from psfs.common.names import LONGEST_NAME, check_name, escape_unprintable
from psfs.footage.settings import SequenceSettings

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

QUICK = settings(
    max_examples=60,
    deadline=None,
    database=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
NUMBER = st.one_of(
    st.floats(), st.integers(), st.booleans(), st.text(max_size=5), st.just(10**400), st.none()
)
VALUE = st.recursive(NUMBER, lambda inner: st.lists(inner, max_size=4), max_leaves=12)


def plain(value: Any) -> Any:
    """What TOML can hold."""
    if isinstance(value, list):
        return [plain(entry) for entry in value if entry is not None]
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) >= 2**63:
        return float("inf")
    return 0 if value is None else value


def clear(read: Any, *arguments: Any) -> Any:
    """Return what a reader returns, or None where it raises one clear line."""
    try:
        return read(*arguments)
    except InputError as error:
        assert str(error) and "\n" not in escape_unprintable(str(error))
        return None


@QUICK
@given(
    key=st.sampled_from(["matrix", "size", "rotation", "translation", "distortions", "name"]),
    value=VALUE,
)
def test_calibrations(tmp_path: Path, key: str, value: Any) -> None:
    path = tmp_path / "calibration.toml"
    tables = footage.tables(footage.rig(2))
    tables["cam01"][key] = plain(value)
    path.write_text(tomli_w.dumps(tables))
    rig = clear(read_calibration, path)
    if rig is not None:
        for camera in rig:
            assert np.isfinite(camera.packed()).all()
            check_name(camera.name, "it")


@QUICK
@given(values=st.dictionaries(st.sampled_from([*SequenceSettings.model_fields, "x"]), VALUE))
def test_settings(values: dict) -> None:
    clear(SequenceSettings.from_dict, values)


@QUICK
@given(
    place=st.sampled_from([
        ("name",), ("edges",), ("bone", 1, "offset"), ("bone", 1, "rest"), ("bone", 1, "parent"),
        ("bone", 1, "axes", 0, "sigma"), ("bone", 1, "axes", 0, "limits"), ("cone", 0, "radii"),
        ("cone", 0, "end"), ("cone", 0, "scale"), ("joint", 0, "position"), ("joint", 0, "bone"),
    ]),
    value=VALUE,
)  # fmt: skip
def test_bodies(tmp_path: Path, place: tuple, value: Any) -> None:
    path = tmp_path / "body.toml"
    entry = table = tomllib.loads(bodies.STICK)
    for step in place[:-1]:
        if isinstance(entry, dict):
            assume(step in entry)
        entry = entry[step]
    entry[place[-1]] = plain(value)
    path.write_text(tomli_w.dumps(table))
    body = clear(load_body, path)
    if body is not None:
        assert np.isfinite(body.sigma).all() and np.isfinite(body.rest_pose).all()
        save_body(tmp_path / "copy.toml", body)
        assert load_body(tmp_path / "copy.toml").dof_names == body.dof_names


WORDS = st.lists(
    st.one_of(st.floats().map(str), st.sampled_from(["cam01", "1", "3", "x", "nan", "\t", "\n"])),
    max_size=60,
).map(" ".join)


@QUICK
@given(text=WORDS)
def test_texts_of_numbers(tmp_path: Path, text: str) -> None:
    for name in ("a.cal", "a_par.txt", "a.txt"):
        (tmp_path / name).write_text(text)
        clear(read_calibration, tmp_path / name, None, (64, 48))
    pose = clear(read_pose, tmp_path / "a.txt", bodies.named("stick"))
    assert pose is None or np.isfinite(pose).all()
    (tmp_path / "a.trc").write_text(f"PathFileType\t4\n{text}")
    clear(read_trc, tmp_path / "a.trc")


@settings(QUICK, max_examples=200)
@given(name=st.text(max_size=120))
def test_names(name: str) -> None:
    """A name that passes is a file's inside a folder, and prints as it is."""
    if clear(check_name, name, "a camera") is not None:
        assert 0 < len(name) <= LONGEST_NAME and escape_unprintable(name) == name
        assert Path("folder", name).parent == Path("folder") and name not in ("", ".", "..")


@settings(QUICK, max_examples=200)
@given(text=st.text())
def test_what_is_printed_is_one_line(text: str) -> None:
    assert escape_unprintable(text).isprintable()
