"""Pages written from data: Scoreboard, Differences, map, films, Environments, Status."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from thesis_lib.book.charts import charts
from thesis_lib.book.environments import environments_markdown
from thesis_lib.book.execution import Run
from thesis_lib.book.films import film_markdown, films_markdown, listed
from thesis_lib.book.findings import findings
from thesis_lib.book.ledger import (
    by_place,
    differences_markdown,
    findings_markdown,
    more_markdown,
    questions,
    questions_markdown,
    quoted,
    scoreboard_markdown,
    squares_markdown,
)
from thesis_lib.book.mutants import mutants_markdown, short_commit
from thesis_lib.book.tables import table_markdown
from thesis_lib.book.thesis_items import ITEMS, items_markdown, read_items
from thesis_lib.edition import deepest
from thesis_lib.edition.chapters import differences, find
from thesis_lib.edition.roots import code_of_table
from thesis_lib.edition.saved import saved
from thesis_lib.edition.scoreboard import judge_all


def generated(
    root: Path, results: Path, runs: Mapping[str, Run], *, draft: bool = False
) -> dict[str, str]:
    """Every generated file by name, as MyST Markdown.

    Parameters
    ----------
    root
        The checkout.
    results
        Tables that the ledger judges.
    runs
        Runs of the notebooks by name.
    draft
        Whether a claim whose table is missing is shown as not run; else it is an error.
    """
    judged = judge_all(results, draft=draft)
    return {
        "findings.md": findings_markdown(judged),
        "scoreboard.md": scoreboard_markdown(judged),
        "scoreboard_more.md": more_markdown(judged),
        "questions.md": questions_markdown(questions(), judged),
        "squares.md": squares_markdown(questions(), judged),
        "ledger.json": quoted(judged),
        "differences.json": by_place(differences()),
        "differences.md": differences_markdown(differences(), results),
        "map.md": items_markdown(read_items(root / ITEMS), judged),
        "films.md": films_markdown(listed(root)),
        "front.md": film_markdown(listed(root)[0], moving=True),
        **charts(),
        **findings(results, draft=draft),
        "environments.md": environments_markdown(),
        "status.md": status_markdown([runs[name] for name in sorted(runs)]),
        "deepest.md": deepest_markdown(deepest.records()),
        "drills.md": drills_markdown(saved("drills/drills").table),
        "mutants.md": mutants_markdown(saved("mutants/mutants").table),
    }


def status_markdown(runs: Sequence[Run]) -> str:
    """Body of the page *Status*: how each notebook was run, and with what.

    Parameters
    ----------
    runs
        In the order of the table's rows.
    """
    if not runs:
        return "No notebook was executed for this build.\n"
    executed, used = [], dict[str, set[str]]()
    for m in (run.manifest for run in runs):
        chosen, made = m["parameters"], (short_commit(m["commit"]), m["digest"][:8])
        asked = (f"{{doc}}`../notebooks/{m['name']}`", chosen["budget"], chosen["seed"])
        executed.append((*asked, _duration(m["seconds"]), _day(m["started"]), *made))
        for name, version in {"Python": m["python"], **m["versions"]}.items():
            used.setdefault(name, set()).add(version)
    machines = sorted({str(run.manifest["machine"]) for run in runs})
    lines = [
        *table_markdown(
            "How each notebook of this build was executed",
            "tbl-status-runs",
            ("notebook", "budget", "seed", "duration", "run on", "commit", "digest"),
            executed,
            right=("seed", "duration"),
        ),
        f"Days are in UTC; machine: {'; '.join(machines)}.",
        "A commit with a plus sign had uncommitted changes.",
        "",
        *table_markdown(
            "Versions of the software that computed the results",
            "tbl-status-versions",
            ("software", "version"),
            ((name, ", ".join(sorted(versions))) for name, versions in used.items()),
        ),
    ]
    return "\n".join(lines)


def deepest_markdown(records: Sequence[Mapping[str, Any]]) -> str:
    """The tables at the thesis's budget that are committed, on the page *Status*.

    Parameters
    ----------
    records
        Their provenance.
    """
    rows = []
    for record in records:
        experiment = find(record["id"])
        since = "not recorded"
        if made_by := record.get("code"):
            code = code_of_table(experiment, experiment.config("thesis"))
            since = "as it was" if code == made_by else "changed"
        made = _duration(record["cpu_seconds"]), _day(record["started"])
        rows.append((experiment.item, *made, short_commit(record["commit"]), since))
    heads = ("table", "processor time", "made on", "commit", "its code since then")
    title = "Committed tables at the thesis's budget"
    return "\n".join(table_markdown(title, "tbl-status-deepest", heads, rows, heads[1:2]))


def drills_markdown(drills: pd.DataFrame) -> str:
    """The table of fault drills on the page *Status*.

    Parameters
    ----------
    drills
        What ``benchmarks/drills.py`` wrote: command, drill, good, of, commit, day.
    """
    heads = ("command", "drill", "as it should be", "commit", "day")
    rows = (
        (f"`{d.command}`", d.drill, f"{d.good} of {d.of}", short_commit(d.commit), _day(d.day))
        for d in drills.itertuples()
    )
    title = "What is left after faults: how often everything was as it should be"
    return "\n".join(table_markdown(title, "tbl-status-drills", heads, rows, heads[2:3]))


def _day(when: str) -> str:
    """The day of a time in UTC."""
    return f"[{when[:10]}]{{.day}}"


def _duration(seconds: float) -> str:
    """A duration for people: ``42 s`` or ``3:05 min``."""
    whole = round(seconds)
    return f"{whole} s" if whole < 60 else f"{whole // 60}:{whole % 60:02d} min"
