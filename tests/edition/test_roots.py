"""Verdicts over roots: counted, resumed, exact where nothing is drawn."""

import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from dataclasses import dataclass, replace

import pandas as pd
import pytest

from tests.surroundings import ROOT, python
from thesis_lib.book import ledger
from thesis_lib.edition import chapters, roots
from thesis_lib.edition import experiment as base
from thesis_lib.edition.ledger import Claim, Finding, Judgement, OverRoots, Verdict, select

REPRODUCED, REFUTED = Verdict.REPRODUCED, Verdict.REFUTED


@dataclass(frozen=True)
class Config:
    low: float = 0.0


def drawn(config, context):
    """The root itself, so that what a claim says of it is known."""
    return pd.DataFrame({"value": [float(context.seed) + config.low]})


def fixed(config, context):
    """Nothing drawn."""
    return pd.DataFrame({"value": [1.0]})


def toy(name, function):
    budgets = dict.fromkeys(base.BUDGETS, Config())
    return base.Experiment(name, name, "", function, budgets, {"value": ""}, 0.0)


def claim(name, experiment, least):
    def judge(tables):
        value = float(tables[experiment].value.iloc[0])
        verdict = REPRODUCED if value >= least else REFUTED
        return Finding(verdict, f"{value:g}", {"value": value})

    return Claim(name, "3.1", "It is so.", (experiment,), f"At least {least}.", judge)


CLAIMS = [claim("often", "drawn", 3), claim("seldom", "drawn", 6), claim("sure", "fixed", 1)]


@pytest.fixture(autouse=True)
def known(monkeypatch):
    """Two experiments, one of which draws."""
    made = {"drawn": toy("drawn", drawn), "fixed": toy("fixed", fixed)}
    monkeypatch.setattr(roots, "experiments", lambda: made)
    monkeypatch.setattr(roots, "place", lambda experiment: ("toys", experiment.id))
    return made


def judged(tmp_path, n=10, budget="book", lines=None):
    say = [].append if lines is None else lines.append
    return roots.judge_over(CLAIMS, n, budget=budget, work=tmp_path / "work", say=say)


def test_the_verdict_is_the_one_of_eight_roots_in_ten(tmp_path):
    """Roots 3 to 10 are at least 3; roots 6 to 10 are at least 6."""
    file = tmp_path / "out" / "verdicts.csv"
    found = roots.save(judged(tmp_path), "book", file)
    assert (found["often"].verdict, found["often"].frequency) == (REPRODUCED, "8 of 10")
    assert found["seldom"].verdict is Verdict.INCONCLUSIVE
    # Five and three of eight: neither can still come to eight of ten.
    assert found["seldom"].frequency == "refuted in 5, reproduced in 3 of 8"
    assert (found["sure"].verdict, found["sure"].frequency) == (REPRODUCED, "exact")
    assert roots.read(file) == found
    assert len(pd.read_csv(file)) == 10 + 8 + 1


def test_only_tables_that_are_missing_or_of_other_code_are_made(tmp_path, monkeypatch, known):
    lines = []
    judged(tmp_path, 3, lines=lines)
    assert [line.partition(":")[0] for line in lines] == [
        *("drawn, root 1", "fixed, root 1", "drawn, root 2", "drawn, root 3"),
    ]
    (tmp_path / "work" / "book" / "root-2" / "drawn.json").unlink()
    lines.clear()
    judged(tmp_path, 3, lines=lines)
    assert [line.partition(":")[0] for line in lines] == ["drawn, root 2"]
    monkeypatch.setattr(roots, "code_of_table", lambda experiment, config: "other")
    lines.clear()
    judged(tmp_path, 3, lines=lines)
    assert len(lines) == 4


def test_no_more_roots_are_made_than_can_change_the_verdict(tmp_path):
    """Always reproduced: decided by the eighth root, and its last two tables are not made."""
    lines = []
    always = [claim("always", "drawn", 0)]
    found = roots.judge_over(always, 10, budget="book", work=tmp_path, say=lines.append)
    assert list(found[0].findings) == list(range(1, 9))
    assert len(lines) == 8
    over = roots.save(found, "book", tmp_path / "verdicts.csv")["always"]
    assert (over.verdict, over.frequency) == (REPRODUCED, "8 of 8")


def test_claims_that_share_evidence_are_judged_together_the_cheapest_first(known):
    known["drawn"] = replace(known["drawn"], seconds=9.0)
    other = dict.fromkeys(base.BUDGETS, Config(1.0))
    known["fixed"] = replace(known["fixed"], budgets=other)
    often, seldom, sure = CLAIMS
    assert roots.parts([often, sure, seldom]) == [[sure], [often, seldom]]
    both = replace(sure, id="both", experiments=("drawn", "fixed"))
    assert roots.parts([often, sure, both]) == [[often, sure, both]]
    # What "fixed" takes, and no more, may wait for "drawn".
    enough = known["fixed"].seconds
    assert roots.parts([often, sure, seldom], enough) == [[sure], [often, seldom]]
    assert roots.parts([often, sure, seldom], enough + 1) == [[sure, often, seldom]]


def test_what_no_claim_reads_is_left_out(tmp_path, known):
    known["drawn"] = replace(known["drawn"], claims_read={"low": 5.0})
    (first, *_) = judged(tmp_path, 1)
    assert first.findings[1].numbers == {"value": 6.0}


def test_verdicts_of_other_claims_stay(tmp_path):
    file = tmp_path / "verdicts.csv"
    every = judged(tmp_path, 2)
    roots.save(every, "book", file)
    roots.save(every[:1], "book", file)
    assert set(roots.read(file)) == {"often", "seldom", "sure"}
    assert len(pd.read_csv(file)) == 2 + 2 + 1


def test_two_at_once_lose_no_verdict(tmp_path, monkeypatch):
    file = tmp_path / "verdicts.csv"
    every, read = judged(tmp_path, 2), roots.read_csv
    roots.save(every[:1], "book", file)

    def slowly(file):
        found = read(file)
        time.sleep(0.3)
        return found

    with monkeypatch.context() as patched:
        patched.setattr(roots, "read_csv", slowly)
        hands = [threading.Thread(target=roots.save, args=([j], "book", file)) for j in every[1:]]
        for hand in hands:
            hand.start()
        for hand in hands:
            hand.join()
    assert set(roots.read(file)) == {"often", "seldom", "sure"}
    assert {path.name for path in tmp_path.iterdir()} == {"work", file.name}


def test_a_verdict_is_of_the_code_and_the_runs_as_they_were_before_its_tables(
    tmp_path, monkeypatch
):
    """A run that is committed meanwhile, and was not read, makes the verdict an earlier one."""
    now = ["before"]
    monkeypatch.setattr(roots, "code_of_claim", lambda claim, budget: now[0])
    found = roots.judge_over(
        CLAIMS, 2, budget="book", work=tmp_path, say=lambda line: now.__setitem__(0, "after")
    )
    over = roots.save(found, "book", tmp_path / "verdicts.csv")
    assert {one.code for one in over.values()} == {"before"}


def test_smoke_judges_nothing(tmp_path):
    found = roots.save(judged(tmp_path, 2, "smoke"), "smoke", tmp_path / "verdicts.csv")
    assert {over.verdict for over in found.values()} == {Verdict.INCONCLUSIVE}


@pytest.mark.parametrize(("n", "workers", "message"), [(0, 1, "seeds is 0"), (1, 0, "workers is")])
def test_at_least_one(tmp_path, n, workers, message):
    with pytest.raises(ValueError, match=message):
        roots.judge_over(CLAIMS, n, budget="book", workers=workers, work=tmp_path)


def test_a_config_counts():
    own = toy("drawn", drawn)
    first, same, other = (roots.code_of_table(own, Config(x)) for x in (0.0, 0.0, 1.0))
    assert first == same != other


def test_select_takes_an_id_before_what_starts_so():
    one, two = replace(CLAIMS[0], id="3.1-a"), replace(CLAIMS[0], id="3.1-a-b", section="4")
    assert select([one, two], ["3.1-a"]) == [one]
    assert select([one, two], ["3.1-"]) == [one, two]
    assert select([one, two]) == [one, two]
    with pytest.raises(ValueError, match="'5'"):
        select([one, two], ["5"])


def test_pages_tell_the_verdict_over_roots_and_the_one_here():
    over = OverRoots({REPRODUCED: 9, REFUTED: 1}, "book", "", False)
    here = Judgement(CLAIMS[0], Finding(REFUTED, "2"), "book", over)
    assert here.verdict is REPRODUCED
    assert here.in_words() == "reproduced (9 of 10; here refuted)"
    assert replace(here, finding=Finding(REPRODUCED, "4")).in_words() == "reproduced (9 of 10)"
    assert replace(here, over=None).in_words() == "refuted"
    none = OverRoots({Verdict.NOT_RUN: 8}, "book", "", False)
    assert replace(here, over=none).in_words() == "not run"
    row = _rows(here)
    assert "*Id*: `often`; " in row
    page = (ROOT / "book" / "scoreboard.md").read_text(encoding="utf-8")
    assert "`thesis claims ID --seeds 10`" in page
    assert "over draws are of earlier code or runs" in row
    proof = replace(CLAIMS[0], experiments=())
    assert "*Id*: `often`; the verdicts" in _rows(replace(here, claim=proof))
    now = replace(over, code=roots.code_of_claim(CLAIMS[0], "book"))
    assert "earlier code" not in _rows(replace(here, over=now))


def _rows(judged: Judgement) -> str:
    """The table of the scoreboard, without the counts above it."""
    return ledger.scoreboard_markdown([judged]).partition("::::{list-table}")[2]


def test_the_tally_counts_neither_identities_nor_claims_of_our_own():
    one = Judgement(CLAIMS[0], Finding(REPRODUCED, ""), "book")
    identity = replace(one, claim=replace(CLAIMS[0], kind="identity"))
    ours = replace(one, claim=replace(CLAIMS[0], ours=True))
    told = "\n".join(ledger._tally([one, one, identity, ours]))
    assert "| [reproduced]{.verdict .reproduced}: the criterion holds | 2 | 2 waiting |" in told
    assert "1 claims are proofs" in told


def test_inconclusive_roots_do_not_make_a_mixture_look_settled():
    mixed = OverRoots({REPRODUCED: 7, Verdict.INCONCLUSIVE: 3}, "book", "", False)
    assert (mixed.verdict, mixed.held) == (Verdict.INCONCLUSIVE, 0)
    assert mixed.frequency == "reproduced in 7, inconclusive at this budget in 3 of 10"


def test_a_script_without_a_guard_says_what_it_lacks(tmp_path):
    """Each process imports the script that starts it, which would start processes again."""
    script = tmp_path / "mine.py"
    script.write_text(
        "from pathlib import Path\n"
        "from thesis_lib.edition.roots import Job, make\n"
        f"make([Job('theorem-1', 1, 'smoke', Path({str(tmp_path)!r}), '')], 2, print)\n"
    )
    done = python(str(script))
    assert done.returncode == 1
    assert "the processes that are to work could not be started: a script" in done.stderr
    assert "ForeseenError: a process ended before" in done.stderr
    assert 'under `if __name__ == "__main__":`' in done.stderr.splitlines()[-1]


KILLED = """
import sys, time
from pathlib import Path
from types import SimpleNamespace
from thesis_lib import cli
from thesis_lib.edition import roots

HERE = Path(__file__).parent
toys = {name: SimpleNamespace(seconds=60.0) for name in ("first", "second")}
roots.experiments = lambda: toys
roots._settings = lambda experiment, budget: experiment

def work(jobs):
    if jobs[0].experiment == "second":
        (HERE / "working").touch()
        time.sleep(600)
    return []  # so that one of the two processes is idle

roots._do = work
jobs = [roots.Job(name, 1, "book", HERE, "") for name in ("first", "second")]
cli.Claims.__call__ = lambda self: roots.make(jobs, 2, print)
if __name__ == "__main__":
    sys.exit(cli.main(["claims"]))
(HERE / "starting").touch()
time.sleep(1)
"""


@pytest.mark.parametrize(
    ("moment", "number"),
    [("starting", signal.SIGINT), ("working", signal.SIGTERM), ("working", signal.SIGKILL)],
)
def test_a_command_that_is_stopped_takes_its_processes_with_it(tmp_path, moment, number):
    script = tmp_path / "killed.py"
    script.write_text(KILLED)
    process = subprocess.Popen(
        [sys.executable, str(script)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    try:
        deadline = time.monotonic() + 300
        while not (tmp_path / moment).exists():
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.05)
        time.sleep(0.5)  # so that the other process is idle
        if number == signal.SIGINT:
            os.killpg(process.pid, number)  # as a terminal does
        else:
            process.send_signal(number)
        _, error = process.communicate(timeout=40)  # returns when all its processes have ended
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)  # what is left, if any
    assert "Traceback" not in error
    assert process.returncode == (-number if number == signal.SIGKILL else 128 + number)
    if number != signal.SIGKILL:
        assert error == "thesis: interrupted; no file was left half written.\n"


def test_figures_of_one_protocol_are_made_by_one_process_in_turn(tmp_path, known):
    known.update(chapters.experiments())
    names = ("figure-4.7", "figure-3.3", "figure-4.8")
    jobs = [roots.Job(name, root, "book", tmp_path, "") for root in (1, 2) for name in names]
    told = [[(job.root, job.experiment) for job in turn] for turn in roots._in_turn(jobs)]
    assert told == [
        [(1, "figure-4.7"), (1, "figure-4.8")],
        [(1, "figure-3.3")],
        [(2, "figure-4.7"), (2, "figure-4.8")],
        [(2, "figure-3.3")],
    ]
    both = [claim("seen", "figure-4.7", 1), claim("placed", "figure-4.8", 1)]
    assert roots.parts([both[0], *CLAIMS, both[1]])[-1] == both
