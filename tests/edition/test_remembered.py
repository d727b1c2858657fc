"""Dear results are made once, and again when anything that decides them changes."""

from __future__ import annotations

import multiprocessing
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from thesis_lib.edition import remembered as module
from thesis_lib.edition.remembered import remembered


@dataclass(frozen=True)
class Made:
    """A number, a text and a table."""

    number: float
    text: str
    table: tuple[tuple[float, ...], ...]


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[float]:
    """What was really made; the code that makes it is in no chapter, so that its place is named."""
    monkeypatch.setattr(module, "cache_folders", lambda: iter([tmp_path]))
    monkeypatch.setattr(module, "place", lambda _: ("thesis_lib.chapter5.open_loop", "Gait"))
    return []


def maker(calls: list[float], note: Path | None = None):  # type: ignore[no-untyped-def]
    """As another process has it: nothing in memory."""

    @remembered(Made)
    def third(x: float, of: int = 3) -> Made:
        calls.append(x)
        if note is not None:
            with note.open("a", encoding="utf-8") as file:
                file.write("made\n")
        return Made(x / of, "π", ((0.1, x), (float("inf"),)))

    return third


def test_made_once_and_equal_to_the_last_bit(calls: list[float]) -> None:
    first = maker(calls)(1.0)
    assert maker(calls)(1.0) == first == Made(1 / 3, "π", ((0.1, 1.0), (float("inf"),)))
    assert calls == [1.0]
    maker(calls)(2.0)
    assert calls == [1.0, 2.0]


def test_an_argument_left_out_is_its_default(calls: list[float]) -> None:
    assert maker(calls)(1.0) == maker(calls)(1.0, 3)
    assert calls == [1.0]
    assert maker(calls)(1.0, 4).number == 1 / 4


@pytest.mark.parametrize("changed", ["code", "versions"])
def test_made_anew_by_other_code_or_versions(
    calls: list[float], changed: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    maker(calls)(1.0)
    if changed == "code":
        monkeypatch.setattr(module, "place", lambda _: ("thesis_lib.chapter5.open_loop", "Search"))
    else:
        monkeypatch.setattr(module, "environment", lambda: {"versions": {"mujoco": "another"}})
    maker(calls)(1.0)
    assert calls == [1.0, 1.0]


@pytest.mark.parametrize("damage", ["", "{}", '{"number": 1.0', '{"other": 1}'])
def test_a_damaged_file_is_made_anew(calls: list[float], damage: str, tmp_path: Path) -> None:
    made = maker(calls)(1.0)
    (file,) = tmp_path.rglob("*.json")
    file.write_text(damage, encoding="utf-8")
    assert maker(calls)(1.0) == maker(calls)(1.0) == made
    assert calls == [1.0, 1.0]


def test_without_a_folder_to_write_to_each_process_makes_it(
    calls: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "cache_folders", lambda: iter([Path("/proc/none")]))
    assert maker(calls)(1.0) == maker(calls)(1.0)
    assert calls == [1.0, 1.0]


@pytest.mark.skipif(sys.platform == "win32", reason="needs fork")
def test_two_processes_make_it_once(calls: list[float], tmp_path: Path) -> None:
    context, note = multiprocessing.get_context("fork"), tmp_path / "note"
    both = [context.Process(target=maker(calls, note), args=(1.0,)) for _ in range(2)]
    for process in both:
        process.start()
    for process in both:
        process.join()
    assert note.read_text(encoding="utf-8") == "made\n"
