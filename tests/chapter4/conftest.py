"""The smoke tables of chapter 4, each made once."""

from collections.abc import Iterator, Mapping

import pandas as pd
import pytest

from thesis_lib import chapter4
from thesis_lib.edition.chapters import read_chapter
from thesis_lib.edition.experiment import Experiment


class Smoke(Mapping[str, pd.DataFrame]):
    """Tables at the smoke budget with seed 5, by experiment id, made when first asked for."""

    def __init__(self) -> None:
        self._experiments: dict[str, Experiment] = {
            e.id: e for e in read_chapter(chapter4).experiments
        }
        self._made: dict[str, pd.DataFrame] = {}

    def __getitem__(self, identifier: str) -> pd.DataFrame:
        if identifier not in self._made:
            self._made[identifier] = self._experiments[identifier].run("smoke", seed=5).table
        return self._made[identifier]

    def __iter__(self) -> Iterator[str]:
        return iter(self._experiments)

    def __len__(self) -> int:
        return len(self._experiments)


@pytest.fixture(scope="session")
def smoke() -> Smoke:
    return Smoke()
