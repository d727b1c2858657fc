"""The helpers of notebooks of the old form."""

import builtins
import importlib.util
from typing import Any

import numpy as np
import pytest

from thesis_lib.book import notebook as nb


def test_glue_stores_plain_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    stored: dict[str, Any] = {}
    monkeypatch.setattr("myst_nb.glue", lambda name, value, display: stored.update({name: value}))
    nb.glue("x", np.float64(0.5))
    nb.glue("n", np.int64(3))
    assert stored == {"x": 0.5, "n": 3}
    assert [type(value) for value in stored.values()] == [float, int]


def test_glue_without_myst_nb_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "myst_nb" else find(name)
    )
    real = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name.startswith("myst_nb"):
            raise ModuleNotFoundError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    nb.glue("error", 0.25)
    assert capsys.readouterr().out == (
        "error = 0.25  (myst_nb is not installed: the prose shows this in the book)\n"
    )
