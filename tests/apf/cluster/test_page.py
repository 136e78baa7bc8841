"""The page and the table of a folder of takes."""

import csv
import re
from dataclasses import asdict
from html import unescape
from pathlib import Path

from apf.cli.batch import describe_done
from apf.cli.batch_take import TakeDone
from apf.cluster.record import TakeRecord
from apf.cluster.table import TakeRow, write_index


def read_page(path: Path) -> tuple[list[list[str]], list[str]]:
    """Return the cells' sorting values by row, and links and pictures."""
    text = path.read_text()
    rows = [re.findall(r'data-value="([^"]*)"', row) for row in text.split("<tr")]
    return [list(map(unescape, row)) for row in rows], re.findall(r'(?:href|src)="([^"]*)"', text)


def test_all_takes_of_a_folder_are_shown(tmp_path: Path) -> None:
    """Also those of earlier calls; names are text, whatever they look like."""
    odd = "walk <b>&1 #2"
    for name in (odd, "jump"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "thumbnail.jpg").write_bytes(b"")
        (tmp_path / name / "report.html").write_text("")
        row = TakeRow(name, quality="good", frames=7, lost_frames=2, limbs="left arm", took=1.5)
        TakeRecord("0", {}, {}, {}, rows=(asdict(row) | {"of a later version": 1},)).write(
            tmp_path / name
        )
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "run.log").write_text("")
    others = {name: TakeRow(name, status="waiting") for name in ("jump", "sit")}
    others["run"] = TakeRow("run", status="failed", error="cam01 has <no> frames")
    write_index(tmp_path, others)
    rows, links = read_page(tmp_path / "index.html")
    found = {row[0]: row for row in rows if row}
    assert set(found) == {odd, "jump", "run", "sit"}
    assert found["jump"][1:3] == ["done", "good"] and found["sit"][1] == "waiting"
    assert found["run"][1] == "failed"
    assert "walk%20%3Cb%3E%261%20%232/report.html" in links and "logs/run.log" in links
    with (tmp_path / "takes.csv").open() as file:
        table = {row["name"]: row for row in csv.DictReader(file)}
    assert table["run"]["error"] == "cam01 has <no> frames" and table[odd]["limbs"] == "left arm"
    assert list(table) == sorted(table)


def test_people_of_a_take_are_rows_of_one_take(tmp_path: Path) -> None:
    rows = tuple(TakeRow(f"duo/person{k}", frames=7, took=1.5) for k in (1, 2))
    for folder in ("duo", "duo/person1", "duo/person2"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "report.html").write_text("")
    TakeRecord("0", {}, {}, {}, rows=tuple(map(asdict, rows))).write(tmp_path / "duo")
    write_index(tmp_path, {})
    assert "<p>1 done." in (tmp_path / "index.html").read_text()
    _, links = read_page(tmp_path / "index.html")
    assert links.count("duo/report.html") == 2 and "duo/person2/report.html" in links
    assert describe_done(TakeDone(rows, kept=False)) == "2 people, 7 frames tracked in 1.5 s"
