"""Tables at the thesis's budget, committed where the book's budget is less.

They are made by ``thesis run ID --budget thesis --out results/thesis``, and say by which code.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from thesis_lib.checkout import repository_root
from thesis_lib.checks import as_json
from thesis_lib.edition.experiment import load


def committed() -> Path:
    """Where they lie."""
    return repository_root() / "results" / "thesis"


def records() -> list[dict[str, Any]]:
    """Their provenance, by id."""
    files = sorted(committed().glob("*.json"))
    return [json.loads(file.read_text(encoding="utf-8")) for file in files]


def deepest(
    table: pd.DataFrame, provenance: Mapping[str, Any]
) -> tuple[pd.DataFrame, Mapping[str, Any]]:
    """The committed table of an experiment, where one made at the book budget has fewer runs.

    Parameters
    ----------
    table, provenance
        Of a run at any budget; given back where there is none deeper.
    """
    identifier, folder = provenance["id"], committed()
    if provenance["budget"] != "book" or not (folder / f"{identifier}.json").is_file():
        return table, provenance
    found = load(identifier, folder)
    config = json.loads(json.dumps(provenance["config"], default=as_json))
    return (table, provenance) if found[1]["config"] == config else found
