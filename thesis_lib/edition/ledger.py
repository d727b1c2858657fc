"""The ledger: claim, evidence, criterion, verdict.

A claim paraphrases a statement of the thesis; its words stand in its chapter's ``claims.toml``.
Its criterion, written before looking and mended where a review found it wanting, is a function of
the tables that are its evidence, beside the experiment that makes them, so that it can be asked of
the tables of any seed.  The verdict is computed and never typed.

The pages *Scoreboard* and *Differences from the thesis* are written from here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import Any, ClassVar, Literal

import pandas as pd

from thesis_lib.edition.deepest import deepest
from thesis_lib.edition.experiment import Experiment, load
from thesis_lib.edition.words import plain

Tables = Mapping[str, pd.DataFrame]
"""Tables of experiments by id."""


class Verdict(StrEnum):
    """What the evidence says of a claim."""

    REPRODUCED = "reproduced"
    DIRECTION = "direction only"
    NOT_REPRODUCED = "not reproduced"
    REFUTED = "refuted"
    NOT_TESTABLE = "not testable"
    INCONCLUSIVE = "inconclusive at this budget"
    NOT_RUN = "not run"

    @property
    def slug(self) -> str:
        """Its name as a class of ``book.css``."""
        return self.replace(" ", "-")

    @property
    def badge(self) -> str:
        """Its words in its colour, as MyST Markdown."""
        return f"[{self}]{{.verdict .{self.slug}}}"


MEANING = {
    Verdict.REPRODUCED: "the criterion holds",
    Verdict.DIRECTION: "the sign or order agrees, the size or significance does not",
    Verdict.NOT_REPRODUCED: "our runs do not show it",
    Verdict.REFUTED: "a proof, an exact computation or a significant result says the opposite",
    Verdict.NOT_TESTABLE: "it lacks what a test needs: details, a lost figure, a robot at scale",
    Verdict.INCONCLUSIVE: "too few or too short runs to tell, or no verdict in eight of ten draws",
    Verdict.NOT_RUN: "the evidence has not been computed yet",
}

WEAKEST_FIRST = (
    Verdict.REFUTED,
    Verdict.NOT_REPRODUCED,
    Verdict.NOT_TESTABLE,
    Verdict.NOT_RUN,
    Verdict.INCONCLUSIVE,
    Verdict.DIRECTION,
    Verdict.REPRODUCED,
)
"""What denies a claim of several parts counts before what cannot tell, and that before the rest."""


@dataclass(frozen=True)
class Finding:
    """A verdict with the computed sentences that support it.

    Attributes
    ----------
    verdict
        What the tables say.
    evidence
        Sentences made of the same numbers.
    numbers
        The numbers that decided, by name.
    """

    verdict: Verdict
    evidence: str
    numbers: Mapping[str, float] = field(default_factory=dict)


NO_MEANING = Finding(
    Verdict.INCONCLUSIVE,
    "The evidence was made at the smoke budget, whose values carry no meaning.",
)


@dataclass(frozen=True)
class Claim:
    """A statement of the thesis and how it is judged.

    Attributes
    ----------
    id
        Short and stable, such as ``3.4.1-sarsa-beats-q``.
    section
        Where the thesis says it, such as ``3.4.1`` or ``Table 3.1``.
    statement
        A short paraphrase.
    experiments
        Ids of the experiments whose tables are the evidence.
    criterion
        What must hold, in words.
    judge
        Computes the finding from the tables, by experiment id.
    headline
        Whether the landing page tells it.
    kind
        ``evidence``, or ``identity``: a proof or arithmetic, which no experiment can deny and
        which is not counted as evidence.
    ours
        Whether the thesis only implies it, and the words are ours.
    rests_on
        Ids of claims, of any chapter, that this one repeats or sums up; they judge it, and it is
        not counted again.
    at
        Label of the section of our book where it is tested.
    figure
        Label of the figure or table there that shows it.
    criteria
        The functions that judge: its own, or those of the claims it rests on.
    was, because
        A verdict it had before its criterion or its evidence was mended, and what that was.
    """

    id: str
    section: str
    statement: str
    experiments: tuple[str, ...]
    criterion: str
    judge: Callable[[Tables], Finding]
    headline: bool = False
    kind: Literal["evidence", "identity"] = "evidence"
    ours: bool = False
    rests_on: tuple[str, ...] = ()
    at: str = ""
    figure: str = ""
    criteria: tuple[Criterion, ...] = ()
    was: str = ""
    because: str = ""

    def __post_init__(self) -> None:
        if self.was:
            Verdict(self.was)
        if bool(self.was) != bool(self.because):
            raise ValueError(f"claim {self.id!r} must have both a `was` and a `because`, or none.")

    def resting_on(self, parts: Sequence[Claim]) -> Claim:
        """The claim judged by those it rests on, given in order, and tested where the first is.

        One passes its finding on, and its figure; of several the claim is as good as the weakest.
        """
        experiments = tuple(dict.fromkeys(e for part in parts for e in part.experiments))

        def judge(tables: Tables) -> Finding:
            found = [part.judge(tables) for part in parts]
            if len(found) == 1:
                return found[0]
            weakest = min((f.verdict for f in found), key=WEAKEST_FIRST.index)
            each = "; ".join(
                f"{part.statement.removesuffix('.')}: {f.verdict}"
                for part, f in zip(parts, found, strict=True)
            )
            return Finding(weakest, f"{each}.")

        criteria = tuple(c for part in parts for c in part.criteria)
        return replace(
            self,
            experiments=experiments,
            judge=judge,
            criteria=criteria,
            at=self.at or parts[0].at,
            figure=self.figure or (parts[0].figure if len(parts) == 1 else ""),
        )


@dataclass(frozen=True)
class Difference:
    """A point where the text is silent, ambiguous or at odds with what fits its numbers.

    Attributes
    ----------
    id, section, at
        As for a claim.
    topic
        A few words.
    thesis
        What the text says.
    ours
        What we do.
    option
        The named option that chooses, as code.
    effect
        A sentence, or a function of tables that writes one, on what the choice changes.
    experiments
        The tables ``effect`` needs.
    """

    id: str
    section: str
    topic: str
    thesis: str
    ours: str
    option: str
    effect: str | Callable[[Tables], str]
    experiments: tuple[str, ...] = ()
    at: str = ""


@dataclass(frozen=True)
class _OfTables:
    """A function of the tables of some experiments, about one row of the ledger.

    Called, it takes the tables in order; :meth:`of` finds them by experiment id.
    """

    subject: str
    experiments: tuple[Experiment[Any], ...]
    function: Callable[..., Any]

    def __call__(self, *tables: pd.DataFrame) -> Any:
        return self.function(*tables)

    def of(self, tables: Tables) -> Any:
        """Its value on tables by experiment id."""
        return self.function(*(tables[e.id] for e in self.experiments))

    @property
    def needs(self) -> tuple[str, ...]:
        """Ids of the experiments."""
        return tuple(e.id for e in self.experiments)


class Criterion(_OfTables):
    """Judges a claim: its value is a :class:`Finding`."""


class Effect(_OfTables):
    """Tells what a difference from the thesis changes: its value is a sentence."""


def criterion(
    claim: str, *experiments: Experiment[Any]
) -> Callable[[Callable[..., Finding]], Criterion]:
    """Make a function of the tables of some experiments the criterion of a claim."""
    return lambda function: Criterion(claim, experiments, function)


def effect_of(
    difference: str, *experiments: Experiment[Any]
) -> Callable[[Callable[..., str]], Effect]:
    """Make a function of the tables of some experiments tell what a difference changes."""
    return lambda function: Effect(difference, experiments, function)


@dataclass(frozen=True)
class OverRoots:
    """How often each verdict on a claim came out (:mod:`thesis_lib.edition.roots`).

    Attributes
    ----------
    counts
        Roots by verdict, the most frequent first.
    budget
        Of the evidence.
    code
        Digest of what made and judged it.
    exact
        Whether nothing was drawn, so that it was judged once.
    confirmed
        The one root on which later code, then that of ``code``, found the same
        (:mod:`thesis_lib.edition.confirm`); 0 where ``code`` judged all of them.
    """

    counts: Mapping[Verdict, int]
    budget: str
    code: str
    exact: bool
    confirmed: int = 0

    HOLDS: ClassVar[float] = 0.8
    """Share of the roots in which a verdict must come out to be the claim's."""

    @property
    def of(self) -> int:
        """Number of roots."""
        return sum(self.counts.values())

    @property
    def held(self) -> int:
        """In how many roots the verdict came out; 0 where none came out in enough."""
        most = max(self.counts.values())
        return most if most >= self.HOLDS * self.of else 0

    @property
    def verdict(self) -> Verdict:
        """The verdict that holds in enough roots, else inconclusive."""
        return next(iter(self.counts)) if self.held else Verdict.INCONCLUSIVE

    @property
    def frequency(self) -> str:
        """``10 of 10``; ``reproduced in 6, refuted in 4 of 10``; ``exact``."""
        if self.exact:
            return "exact"
        if self.held:
            return f"{self.held} of {self.of}"
        each = ", ".join(f"{verdict} in {n}" for verdict, n in self.counts.items())
        return f"{each} of {self.of}"


@dataclass(frozen=True)
class Judgement:
    """A claim with its finding, the budget of its evidence, and its verdicts over roots if any."""

    claim: Claim
    finding: Finding
    budget: str
    over: OverRoots | None = None

    @property
    def verdict(self) -> Verdict:
        """That over roots, or else that of the finding."""
        return self.finding.verdict if self.over is None else self.over.verdict

    @property
    def here(self) -> Verdict | None:
        """That of the finding, on the tables shown, where it is another."""
        found = self.finding.verdict
        return None if found in (self.verdict, Verdict.NOT_RUN) else found

    def in_words(self) -> str:
        """The verdict with its frequency, and that of the finding where it is another."""
        if self.over is None or self.over.exact or self.verdict is Verdict.NOT_RUN:
            return str(self.verdict)
        here = f"; here {self.here}" if self.here else ""
        return f"{self.verdict} ({self.over.frequency}{here})"


SMOKE_TELLS_NOTHING = "Not shown at the smoke budget, whose values carry no meaning."


def judge(claim: Claim, results: Path | str) -> Judgement:
    """Judge one claim on saved results.

    Parameters
    ----------
    claim
        What to judge.
    results
        Directory of tables written by ``thesis run`` or by the book's build; one made at the
        book budget gives way to a committed one at the thesis's.

    Returns
    -------
    Judgement
        ``inconclusive`` when a table was made at the smoke budget, whose values carry no meaning.

    Raises
    ------
    FileNotFoundError
        When a table is missing, with the command that makes it.
    """
    tables, budgets = {}, set()
    for identifier in claim.experiments:
        tables[identifier], provenance = deepest(*load(identifier, results))
        budgets.add(provenance["budget"])
    budget = ", ".join(sorted(budgets)) or "exact"
    found = finding(claim, tables, "smoke" if "smoke" in budgets else budget)
    return Judgement(claim, found, budget)


def finding(claim: Claim, tables: Tables, budget: str) -> Finding:
    """Judge a claim on tables made at one budget; at ``smoke`` nothing is told."""
    if budget == "smoke":
        return NO_MEANING
    found = claim.judge(tables)
    return replace(found, evidence=plain(found.evidence))


def select(claims: Iterable[Claim], only: Iterable[str] = ()) -> list[Claim]:
    """Claims of the ids given, or whose id or section starts so; all without any.

    Raises
    ------
    ValueError
        For a text with which nothing starts.
    """
    listed, chosen = list(claims), dict[str, Claim]()
    for text in only:
        own = [c for c in listed if c.id == text]
        own = own or [c for c in listed if c.id.startswith(text) or c.section.startswith(text)]
        if not own:
            raise ValueError(f"no claim's id or section starts with {text!r}: see `thesis claims`.")
        chosen |= {claim.id: claim for claim in own}
    return list(chosen.values()) if only else listed
