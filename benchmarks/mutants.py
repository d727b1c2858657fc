"""Mutants of the library: each must be caught by a test, and move a verdict of the ledger.

    .venv/bin/python benchmarks/mutants.py                  # all, an hour on a quiet core
    .venv/bin/python benchmarks/mutants.py shaping-sign     # some
    .venv/bin/python benchmarks/mutants.py --out results/mutants

A mutant is one change of one line: a sign, gamma, epsilon, a weight, a level, a sensor, an
integrator, a mask.  It is made in a copy of the package, never in the checkout.  There a test of
the suite must fail, and a claim that is reproduced on root 1 by the library as it is must no
longer be; or the mutant says why no claim depends on it.  Evidence that stops with an error is no
verdict, and counted apart.  The command ends with 1 if a mutant survives a test, or moves no
verdict without a reason.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pandas as pd

from thesis_lib.book.mutants import code_of_mutant
from thesis_lib.checkout import environment, repository_root
from thesis_lib.edition import chapters, roots
from thesis_lib.edition.experiment import read_csv
from thesis_lib.files import replacing, writable_directory

ROOT = repository_root()


@dataclass(frozen=True)
class Mutant:
    """One change of the library.

    Attributes
    ----------
    name
        A few words.
    file
        Below ``thesis_lib``.
    before, after
        Text that occurs once in the file, and what it becomes.
    test
        A file of tests and which of them, as ``pytest -k`` reads it.
    claims
        Chapter of the ledger and ids of claims that should no longer be reproduced.
    budget
        Of their evidence; ``smoke`` where that is exact but for its size.
    reason
        Why no claim depends on it, where none does.
    """

    name: str
    file: str
    before: str
    after: str
    test: tuple[str, str]
    claims: tuple[str, ...] = ()
    budget: str = "book"
    reason: str = ""


LEARNING, CLIFF, EXACT = "mdp/learning.py", "domains/cliff.py", "relevance/exact.py"
ERROR = "delta = r + (discount * potential - phi[s, a]) + discount * value - q[s, a]"
TEST_LEARNING = "tests/mdp/test_learning.py"

MUTANTS = (
    Mutant(
        *("shaping-sign", LEARNING, ERROR, ERROR.replace("r + (", "r - (")),
        (TEST_LEARNING, "shaping_equals_initialisation"),
        ("chapter3", "3.1-equals-initialisation"),
    ),
    Mutant(
        *("learning-without-gamma", LEARNING, ERROR, ERROR.replace("discount * value", "value")),
        (TEST_LEARNING, "finds_the_optimum_of_the_chain"),
        ("chapter3", "3.4.2-early-boost"),
    ),
    Mutant(
        *("q-learning-follows-behaviour", LEARNING),
        *("return q[s, action], phi[s, action]", "return q[s, a], phi[s, a]"),
        (TEST_LEARNING, "q_learning_finds_the_optimum_of_the_chain"),
        ("chapter2", "2.3.3-q-learning-converges"),
    ),
    Mutant(
        *("sarsa-off-policy", LEARNING),
        *("        return q[s, a], phi[s, a]\n    A =", "        rule = Q_LEARNING\n    A ="),
        (TEST_LEARNING, "sarsa_finds_the_soft_optimum_of_the_chain"),
        ("chapter2", "2.3.3-sarsa-cannot-converge"),
    ),
    Mutant(
        *("half-of-epsilon", LEARNING),
        *("    if u >= epsilon:\n", "    if u >= epsilon / 2:\n"),
        (TEST_LEARNING, "frequency_of_exploration"),
        ("chapter3", "3.4.1-numbers"),
    ),
    Mutant(
        *("random-action-never-greedy", LEARNING),
        *("    if others:\n        best = values", "    if True:\n        best = values"),
        (TEST_LEARNING, "frequency_of_exploration"),
        ("chapter3", "3.4.1-numbers"),
    ),
    Mutant(
        *("half-of-a-soft-policy", "mdp/planning.py"),
        *("preferred = np.eye(A)[greedy]", "preferred, epsilon = np.eye(A)[greedy], epsilon / 2"),
        ("tests/mdp/test_planning.py", "soft_bellman_equation or beats_every"),
        ("chapter3", "3.4.2-huddle"),
    ),
    Mutant(
        *("half-of-greedy-exploration", "mdp/greedy.py"),
        *('epsilon = probability("epsilon", epsilon)', 'epsilon = probability("", epsilon) / 2'),
        ("tests/mdp/test_greedy.py", "all_actions"),
        reason="it enters one weighting of potentials and a reward that is told, not judged",
    ),
    Mutant(
        *("gamma-squared", "mdp/evaluation.py"),
        *("- mdp.discount * within", "- mdp.discount**2 * within"),
        ("tests/mdp/test_evaluation.py", "chain_by_hand"),
        ("chapter3", "3.4.2-huddle"),
    ),
    Mutant(
        *("weights-ignored", "potentials/averages.py"),
        *("mean = _weighted_mean(stacked, domain.posterior(weights))",
          "mean = _weighted_mean(stacked, domain.posterior())"),
        ("tests/potentials/test_averages.py", "weights_change_the_mean"),
        ("chapter3", "3.3.2-least-squares"),
    ),
    Mutant(
        *("soft-values-optimal", "potentials/averages.py"),
        *("planning.soft_policy_iteration(task, epsilon).q", "planning.solve(task).q"),
        ("tests/potentials/test_averages.py", "soft_values_by_hand"),
        ("chapter3", "3.4.1-potentials-help-q-learning"),
    ),
    Mutant(
        *("q-star-negative", "potentials/averages.py"),
        *("return cross_task_values(domain, optimal_solutions(domain), weights)",
          "return -cross_task_values(domain, optimal_solutions(domain), weights)"),
        ("tests/potentials/test_averages.py", "soft_values_are_lower"),
        ("chapter3", "3.6-lower", "3.3.5-conservative"),
    ),
    Mutant(
        *("blind-sensor", CLIFF),
        *("return near[0] if near and cell not in self.cliff else 0", "return 0"),
        ("tests/domains/test_cliff.py", "sensor"),
        ("chapter3", "3.4.1-sensor-helps-sarsa"),
    ),
    Mutant(
        *("falls-are-free", CLIFF),
        *("reward[s, a] = fall_reward + (step", "reward[s, a] = step + (step"),
        ("tests/domains/test_cliff.py", "fall or continuing_task_by_hand"),
        ("chapter2", "2.3.3-sarsa-online", "3.4.1-q-learning-walks-the-edge"),
    ),
    Mutant(
        *("falls-go-nowhere", CLIFF),
        *("target = start\n            elif", "target = s\n            elif"),
        ("tests/domains/test_cliff.py", "shortest_safe_path"),
        ("chapter3", "3.4.1-numbers"),
    ),
    Mutant(
        *("red-is-free", "domains/triangle.py"),
        *("reward[s - 1, a] -= red_penalty", "reward[s - 1, a] -= 0.0"),
        ("tests/domains/test_triangle.py", "every_transition_and_reward"),
        ("chapter4", "4.3-triangle-relevance"),
    ),
    Mutant(
        *("law-of-the-root-of-k", EXACT),
        *("out += met @ spread / lengths\n", "out += met @ spread / lengths**0.5\n"),
        ("tests/relevance/test_exact.py", "exact_formula_is_the_definition"),
        ("chapter4", "4.1.1-twelve", "4.1.1-plateau"),
    ),
    Mutant(
        *("combinations-as-sequences", EXACT),
        *("within * n / (n - 1) * (1.0 / lengths - 1.0 / n)", "within * (1.0 / lengths - 1.0 / n)"),
        ("tests/relevance/test_exact.py", "combinations_without_replacement"),
        ("chapter4", "4.5-alpha"),
        reason="FS-TEK and the jackknife test ratios in which a factor of the whole curve cancels",
    ),
    Mutant(
        *("features-kept-are-removed", "chapter4/runs.py"),
        *("np.flatnonzero(support).tolist()", "np.flatnonzero(~support).tolist()"),
        ("tests/chapter4/test_theory.py", "all_features_and_tasks"),
        ("chapter4", "4.3-triangle-improves"),
    ),
    Mutant(
        *("potential-with-the-wrong-sign", "chapter4/runs.py"),
        *("total_rewards(phi, self._rngs)", "total_rewards(-phi, self._rngs)"),
        ("tests/chapter4/test_theory.py", "optimal_values_draw"),
        ("chapter4", "4.3-triangle-improves"),
    ),
    Mutant(
        *("fs-tek-without-level", "selection/fstek.py"),
        *("outside = level if", "outside = 1e-3 if"),
        ("tests/selection/test_fstek.py", "larger_alpha"),
        ("chapter4", "4.2-threshold-conditions"),
    ),
    Mutant(
        *("error-unweighted", "relevance/abstraction.py"),
        *("np.bincount(y, weights * residual**2, n)", "np.bincount(y, residual**2, n)"),
        ("tests/relevance/test_abstraction.py", "definition_and_variance"),
        ("chapter4", "4.1-two-forms"),
    ),
    Mutant(
        *("score-rewards-change", "robustness.py"),
        *("return b * (1 - np.abs(p - b))", "return b * (1 + np.abs(p - b))"),
        ("tests/test_robustness.py", "score_by_hand"),
        ("chapter5", "5.3-slowing"),
    ),
    Mutant(
        *("retained-upside-down", "robustness.py"),
        *("np.divide(r[..., 1:, :, :], base,", "np.divide(base, r[..., 1:, :, :],"),
        ("tests/test_robustness.py", "retained"),
        ("chapter5", "table-5.6-retained"),
    ),
    Mutant(
        *("bound-upside-down", "potentials/theorem_1.py"),
        *("np.log(tolerance / d) / np.log(discount)", "np.log(d / tolerance) / np.log(discount)"),
        ("tests/potentials/test_theorem_1.py", "bound"),
        ("chapter3", "3.3.1-bound"),
        budget="smoke",
    ),
    Mutant(
        *("euler-half-a-step", "policies/vanilla.py"),
        *("return torch.lerp(state, slope, rate)", "return torch.lerp(state, slope, rate / 2)"),
        ("tests/policies/test_equations.py", "euler_with_the_step"),
        ("chapter5", "5.2.2-euler-is-dtrnn"),
    ),
    Mutant(
        *("baseline-added", "chapter2/estimators.py"),
        *('weighted(to_go(1.0) - value(1.0)),', 'weighted(to_go(1.0) + value(1.0)),'),
        ("tests/chapter2/test_estimators.py", "every_technique"),
        ("chapter2", "2.3.4-baseline"),
    ),
    Mutant(
        *("tie-goes-first", LEARNING),
        *("    least = best - tie\n", "    return action\n    least = best - tie\n"),
        (TEST_LEARNING, "ties_are_broken_evenly"),
        reason="ties last until a pair is first updated, which decides no claim",
    ),
)  # fmt: skip

JUDGE = """
import json, sys
from thesis_lib.edition.chapters import chapter
name, budget, *ids = sys.argv[1:]
found = chapter(name)
known, claims = {e.id: e for e in found.experiments}, {c.id: c for c in found.claims}
needed = {e for i in ids for e in claims[i].experiments}
tables = {e: known[e].run(budget, seed=1).table for e in needed}
print(json.dumps({i: str(claims[i].judge(tables).verdict) for i in ids}))
"""


@contextmanager
def copy(mutant: Mutant | None) -> Iterator[Path]:
    """A copy of package and tests, with the mutant in it."""
    with tempfile.TemporaryDirectory(prefix="mutant-") as made:
        folder = Path(made)
        for name in ("thesis_lib", "tests"):
            shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("*.pyc"))
        for name in ("pyproject.toml", "constraints.txt", "results"):
            (folder / name).symlink_to(ROOT / name)
        if mutant:
            file = folder / "thesis_lib" / mutant.file
            text = file.read_text(encoding="utf-8")
            if text.count(mutant.before) != 1:
                raise SystemExit(
                    f"{mutant.name}: its text occurs {text.count(mutant.before)} times."
                )
            file.write_text(text.replace(mutant.before, mutant.after), encoding="utf-8")
        yield folder


def python(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run Python on a copy, with the checkout's compiled loops where they are the same."""
    own = {"PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(ROOT / "_build" / "numba")}
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env={**os.environ, **own},
        capture_output=True,
        text=True,
    )


def verdicts(folder: Path, chapter: str, ids: tuple[str, ...], budget: str) -> dict[str, str]:
    """Verdicts on root 1 in a copy; ``error`` where the evidence cannot be made."""
    done = python(folder, "-c", JUDGE, chapter, budget, *ids)
    if done.returncode:
        return dict.fromkeys(ids, "error: " + done.stderr.strip().rpartition("\n")[2][:80])
    found: dict[str, str] = json.loads(done.stdout.strip().rpartition("\n")[2])
    return found


@cache
def as_it_is(chapter: str, ids: tuple[str, ...], budget: str) -> dict[str, str]:
    """The same of the library as it is: as committed by this state of the code, else made."""
    table = read_csv(roots.committed())
    known = table[table["root"].isin((0, 1))].set_index("claim")
    claims = {claim.id: claim for claim in chapters.chapter(chapter).claims}
    found = {
        i: str(known.verdict[i])
        for i in ids
        if i in known.index and known.code[i] == roots.code_of_claim(claims[i], budget)
    }
    if missing := tuple(i for i in ids if i not in found):
        with copy(None) as folder:
            found |= verdicts(folder, chapter, missing, budget)
    return found


def drill(mutant: Mutant) -> dict[str, object]:
    """What a mutant does to its test and to its claims."""
    file, which = mutant.test
    moved, stopped, told = [], [], []
    # Before anything runs: what is changed meanwhile is not what was drilled.
    code = code_of_mutant(mutant.file, file, mutant.claims[1:], mutant.budget)
    with copy(mutant) as folder:
        tested = python(
            folder, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", file, "-k", which
        )
        if tested.returncode not in (0, 1):
            raise SystemExit(f"{mutant.name}: {file} -k {which!r} did not run.\n{tested.stdout}")
        if mutant.claims:
            chapter, *ids = mutant.claims
            now = verdicts(folder, chapter, tuple(ids), mutant.budget)
            was = as_it_is(chapter, tuple(ids), mutant.budget)
            told = [f"{i}: {was[i]} -> {now[i]}" for i in ids]
            lost = [i for i in ids if was[i] == "reproduced" != now[i]]
            stopped = [i for i in lost if now[i].startswith("error")]
            moved = [i for i in lost if i not in stopped]
    return {
        "mutant": mutant.name,
        "file": mutant.file,
        "test": f"{file} -k {which!r}",
        "caught": tested.returncode == 1,
        "moved": len(moved),
        "stopped": len(stopped),
        "verdicts": "; ".join(told),
        "reason": "" if moved else mutant.reason,
        "budget": mutant.budget,
        "code": code,
        "commit": environment()["commit"],
    }


COLUMNS = {
    "mutant": "name of the change",
    "file": "below thesis_lib",
    "test": "what must fail, as pytest is told",
    "caught": "whether it did",
    "moved": "number of claims that were reproduced and have another verdict now",
    "stopped": "number of claims that were reproduced and whose evidence stops with an error now",
    "verdicts": "verdict on root 1 of the library as it is and of the mutant",
    "reason": "why no verdict moves, where none does",
    "budget": "of the evidence of its claims",
    "code": "digest of the module changed, the test and the claims; empty where not recorded",
    "commit": "of the library, with + where it had changes",
}


def _record(table: pd.DataFrame) -> dict[str, object]:
    """Provenance of the table."""
    return {
        "id": "mutants",
        "title": "Mutants of the library.",
        "command": "benchmarks/mutants.py --out results/mutants",
        "columns": COLUMNS,
        "rows": len(table),
        **environment(),
    }


def main() -> int:
    """Drill the mutants asked for, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("names", nargs="*", help="which; default all")
    parser.add_argument("--out", type=Path, help="folder for mutants.csv, where rows are replaced")
    asked = parser.parse_args()
    known = {mutant.name: mutant for mutant in MUTANTS}
    if unknown := [name for name in asked.names if name not in known]:
        parser.error(f"there is no mutant {unknown[0]!r}: choose among {', '.join(known)}.")
    good = True
    for name in asked.names or known:
        row = drill(known[name])
        good &= bool(row["caught"] and (row["moved"] or row["reason"]))
        print(f"{name}: {'caught' if row['caught'] else 'SURVIVES'}; {row['verdicts']}"
              f"{row['reason'] and ' (' + str(row['reason']) + ')'}", flush=True)  # fmt: skip
        if asked.out:
            file = writable_directory(asked.out) / "mutants.csv"
            table = pd.DataFrame([row])
            if file.exists():
                before = pd.read_csv(file, keep_default_na=False)
                table = pd.concat([before[before.mutant != name], table])
            with replacing(file) as temporary:
                table.to_csv(temporary, index=False)
            with replacing(file.with_suffix(".json")) as temporary:
                temporary.write_text(json.dumps(_record(table), indent=1) + "\n", encoding="utf-8")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
