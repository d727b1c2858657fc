"""Verdicts that a change of code leaves as they were.

A change of code ages every verdict whose evidence runs it, and most changes move no number: a
better name, two functions made one, an argument refused that nobody gave.  ``thesis claims
--confirm`` judges aged claims on one root only, which their code draws and not who gives the
command.  Where the verdict and each number that decided it come out as they were, the other roots
are taken to stand as well, and *Status* tells how many claims those are.  Where one does not, or
where the criterion is another in more than its sentences, the claim is to be judged anew on all
its roots.  Evidence that is exact is judged anew at once, which is no more work.

Where the criterion is another and the evidence the same, ``thesis claims --seeds 10 --reuse`` asks
this of tables: of each experiment one is made anew, on a root that its code draws, and where it is
as it was to the bit the others are judged as they are.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from thesis_lib.checks import ForeseenError
from thesis_lib.edition import roots
from thesis_lib.edition.experiment import read_csv
from thesis_lib.edition.ledger import Claim
from thesis_lib.files import write_json


@dataclass(frozen=True)
class Aged:
    """What became of an aged claim: ``""`` where its verdict stands, else why it does not."""

    claim: Claim
    why: str = ""


def aged(claims: Sequence[Claim], file: Path) -> list[Claim]:
    """The claims of a table of verdicts that other code judged.

    Raises
    ------
    ForeseenError
        When there is no table.
    """
    if not file.is_file():
        raise ForeseenError(
            f"there are no verdicts to confirm, for {str(file)!r} does not exist: give the folder "
            "that has them with --out (the book's are in results/claims), or judge the claims "
            "with --seeds 10."
        )
    known = roots.read(file)
    return [
        c for c in claims
        if c.id in known and known[c.id].code != roots.code_of_claim(c, known[c.id].budget)
    ]  # fmt: skip


def confirm(
    claims: Sequence[Claim],
    file: Path,
    *,
    budget: str,
    workers: int = 1,
    work: Path | None = None,
    say: Callable[[str], None] = print,
) -> list[Aged]:
    """Judge aged claims on one root, and let verdicts stand that come out as they were.

    Parameters
    ----------
    claims
        Of :func:`aged`.
    file
        The table of verdicts, which is changed.
    budget, workers, work, say
        As of :func:`thesis_lib.edition.roots.judge_over`.

    Returns
    -------
    list of Aged
        A claim each, in the order given.
    """
    rows = dict(list(read_csv(file).groupby("claim", sort=False)))
    why = {c.id: _not_to_be_confirmed(c, rows[c.id], budget) for c in claims}
    whole = [c for c in claims if not why[c.id]]
    if whole:
        # Exact evidence has root 0 alone, and is made on whichever root the others ask for.
        last = [int(rows[c.id]["root"].max()) for c in whole]
        root = _root(whole, budget, most=min(filter(None, last), default=1))
        judged = roots.judge_over(
            whole, 10, budget=budget, workers=workers, only=root, work=work, say=say
        )
        exact = [j for j in judged if 0 in j.findings]
        roots.save(exact, budget, file)
        drawn = [j for j in judged if 0 not in j.findings]
        why |= {j.claim.id: _differs(j, rows[j.claim.id], root) for j in drawn}
        _let_stand([j for j in drawn if not why[j.claim.id]], root, file)
    return [Aged(c, why[c.id]) for c in claims]


def reuse(
    claims: Sequence[Claim],
    roots_wanted: int,
    *,
    budget: str,
    workers: int = 1,
    work: Path | None = None,
    say: Callable[[str], None] = print,
) -> list[str]:
    """Let tables of earlier code stand where one, made anew, is as it was to the bit.

    Parameters
    ----------
    claims
        Whose evidence.
    roots_wanted
        Of which roots, from 1 on.
    budget, workers, work, say
        As of :func:`thesis_lib.edition.roots.judge_over`.

    Returns
    -------
    list of str
        Experiments whose tables stand.
    """
    folder = roots.tables_folder(work)
    tried: list[tuple[list[roots.Job], roots.Job, bytes]] = []
    for name in dict.fromkeys(e for claim in claims for e in claim.experiments):
        experiment = roots.experiments()[name]
        code = roots.code_of_table(experiment, roots.read_config(experiment, budget))
        jobs = [roots.Job(name, root, budget, folder, code) for root in range(1, roots_wanted + 1)]
        made_by = {job: record.get("code") for job in jobs if (record := job.recorded())}
        earlier = Counter(made_by.values()).most_common(1)
        if not earlier or earlier[0][0] == code or earlier[0][1] < 2:
            continue
        old = [job for job, by in made_by.items() if by == earlier[0][0]]
        again = old[_drawn(code, len(old))]
        tried.append((old, again, again.table.read_bytes()))
    roots.make([again for _, again, _ in tried], workers, say)
    stand = []
    for old, again, before in tried:
        if again.table.read_bytes() == before:
            stand.append(again.experiment)
            for job in old:
                record = {**(job.recorded() or {}), "code": job.code, "confirmed": again.root}
                write_json(job.record, record)
    return stand


def _not_to_be_confirmed(claim: Claim, own: pd.DataFrame, budget: str) -> str:
    """Why one root is not enough for a claim."""
    if own.budget.iloc[0] not in (budget, "exact"):
        return f"its evidence is of the {own.budget.iloc[0]} budget"
    exact = bool((own["root"] == 0).all())
    if not exact and own.criterion.iloc[0] != roots.code_of_criterion(claim):
        return "its criterion is another"
    return ""


def _root(claims: Sequence[Claim], budget: str, most: int) -> int:
    """A root from 1 to ``most`` that the code of all claims draws."""
    codes = "".join(roots.code_of_claim(c, budget) for c in claims)
    return 1 + _drawn(codes, most)


def _drawn(code: str, most: int) -> int:
    """A number from 0 to below ``most`` that code draws, and not who gives the command."""
    return int(hashlib.sha256(code.encode()).hexdigest(), 16) % most


def _differs(judged: roots.Judged, own: pd.DataFrame, root: int) -> str:
    """How a finding differs from that of earlier code on the same root; empty if it does not."""
    found = judged.findings[root]
    before = own[own["root"] == root]
    if before.empty:
        return "its evidence was exact, and is drawn now"
    verdict, numbers = str(before.verdict.iloc[0]), str(before.numbers.iloc[0])
    if verdict != found.verdict:
        return f"on root {root} it was {verdict}, and is {found.verdict}"
    now = roots.rounded(found.numbers)
    return "" if numbers == now else f"on root {root} its numbers were {numbers}, and are {now}"


def _let_stand(judged: Sequence[roots.Judged], root: int, file: Path) -> None:
    """Write to a table of verdicts which code found the same on a root."""
    codes = {j.claim.id: j.code for j in judged}

    def stand(table: pd.DataFrame) -> pd.DataFrame:
        own = table.claim.isin(codes)
        table.loc[own, "code"] = table.claim[own].map(codes)
        table.loc[own, "confirmed"] = root
        return table

    roots.rewrite(file, stand)
