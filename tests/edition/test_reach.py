"""What code rests on: what it reaches counts, wherever it stands, and nothing else."""

import pytest

from thesis_lib.chapter3 import table_3_1
from thesis_lib.chapter5 import calibration, figure_5_4, gain_trained, options
from thesis_lib.edition import reach
from thesis_lib.edition.ledger import effect_of

MAIN = """
from thesis_lib import tools
from thesis_lib.parts import twice

A = 1


class Config:
    n: int = 3

    def size(self) -> int:
        return tools.scaled(self.n)


@entered("name", seconds=3)
def start(config: Config):
    return twice(config.size() + A)


def judge():
    return 2
"""
TREE = {
    "main": MAIN,
    "tools": "def scaled(n):\n    return 10 * n\n\n\ndef other():\n    return 0\n",
    "parts/__init__": "from thesis_lib.parts.inner import twice\n",
    "parts/inner": "def twice(n):\n    return 2 * n\n",
}


@pytest.fixture
def digest(tmp_path):
    """Digest of ``start`` with some files of the tree put in place of others."""
    made = iter(range(100))

    def of(name="start", **changed):
        """By the last part of the module's name; ``init`` for the package's own."""
        root = tmp_path / str(next(made))
        for module, source in TREE.items():
            file = root / "thesis_lib" / f"{module}.py"
            source = changed.get(module.rpartition("/")[2].strip("_"), source)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(source, encoding="utf-8")
        return reach.digest([("thesis_lib.main", name)], root=root)

    return of


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("A = 1", "A = 2"),
        ("n: int = 3", "n: int = 4"),
        ("tools.scaled(self.n)", "tools.scaled(self.n) + 1"),
    ],
)
def test_a_change_of_what_is_reached_counts(digest, old, new):
    assert digest() != digest(main=MAIN.replace(old, new))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("return 2\n", "return 3\n"),  # another function
        ("def start(config: Config):", 'def start(config: Config):\n    """Words."""  # and more'),
        ("A = 1", "A = 1\n\nB = 2"),
    ],
)
def test_what_is_not_reached_and_what_decides_nothing_do_not_count(digest, old, new):
    assert digest() == digest(main=MAIN.replace(old, new))


def test_it_is_followed_into_other_modules_and_through_packages(digest):
    assert digest() != digest(tools=TREE["tools"].replace("10", "11"))
    assert digest() == digest(tools=TREE["tools"].replace("return 0", "return 1"))
    assert digest() != digest(inner=TREE["parts/inner"].replace("2", "3"))
    assert digest("judge") == digest("judge", tools="", inner="")


def test_a_module_handed_on_counts_whole(digest):
    whole = MAIN.replace("tools.scaled(self.n)", "getattr(tools, 'scaled')(self.n)")
    other = TREE["tools"].replace("return 0", "return 1")
    assert digest(main=whole) != digest(main=whole, tools=other)


def test_a_definition_that_is_moved_changes_nothing(digest):
    moved = MAIN.replace("A = 1\n", "").replace("twice\n", "A, twice\n", 1)
    assert digest() == digest(main=moved, init="from thesis_lib.tools import A, twice\n",
                              tools=TREE["tools"] + "A = 1\n" + TREE["parts/inner"])  # fmt: skip


def test_what_enters_a_function_in_the_lists_does_not_count(digest):
    entered = "from thesis_lib.edition.experiment import entered\n" + MAIN
    assert digest(main=entered) == digest(main=entered.replace("seconds=3", "seconds=4"))
    assert digest() != digest(main=MAIN.replace("seconds=3", "seconds=4"))


def test_an_entry_of_table_3_1_rests_on_its_learner_its_domain_and_the_printed_numbers():
    start = reach.place(table_3_1.entries)
    assert start == ("thesis_lib.chapter3.table_3_1", "entries")
    code, files = reach.reached([start])
    defined = {line.partition("name='")[2].partition("'")[0] for line in code}
    assert {"learn", "cliff_task", "q_tilde", "GeneticAlgorithm", "load"} <= defined
    assert not {"ordered", "sarsa_beats_q_learning", "fstek", "train"} & defined
    assert "table-3.1.csv" in {file.name for file in files}


READING = {
    "thesis_lib/main.py": "from thesis_lib.chapter5.runs import read_runs\n"
    "from thesis_lib.edition.saved import saved\n\n\n"
    "def study():\n    return read_runs()\n\n\n"
    "def by_name(config):\n    return saved(config.name)\n",
    "thesis_lib/chapter5/runs.py": "def read_runs():\n    return 1\n",
    "thesis_lib/edition/saved.py": "def saved(name):\n    return name\n",
}


@pytest.mark.parametrize(
    ("start", "file", "counts"),
    [
        ("study", "study/breadth/curves.csv", True),
        ("study", "study/breadth/tests.parquet", True),
        ("study", "options/esn/curves.csv", False),
        ("by_name", "options/esn/curves.csv", True),
        ("by_name", "options/esn/curves.json", True),
        ("by_name", "options/gru/curves.csv", False),
        ("by_name", "study/breadth/curves.csv", False),
        ("by_name", "claims/verdicts.csv", False),  # else a verdict would rest on verdicts
    ],
)
def test_committed_runs_count_for_what_reads_them(tmp_path, start, file, counts):
    for name, source in READING.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(source, encoding="utf-8")
    read = tmp_path / "results" / file
    read.parent.mkdir(parents=True)
    found = []
    for content in ("1", "2"):
        read.write_text(content, encoding="utf-8")
        config = "Config(name='options/esn/curves')"
        found.append(reach.digest([("thesis_lib.main", start)], config, root=tmp_path))
    assert (found[0] != found[1]) is counts


@pytest.mark.parametrize(
    ("criterion", "folder"),
    [
        (figure_5_4.cheetah_robust, "study"),
        (options.clamp_is_best, "options"),
        (calibration.text_subset_learns, "calibration"),
        (gain_trained.low_pass_after_training, "trained"),
    ],
)
def test_a_verdict_of_chapter_5_rests_on_the_runs_it_read(criterion, folder):
    starts = [reach.place(x) for x in (criterion, *criterion.experiments)]
    configs = [repr(e.config("book")) for e in criterion.experiments]
    _, files = reach.reached(starts, "".join(configs))
    read = [file.relative_to(reach.ROOT).parts for file in files]
    assert {parts[1] for parts in read if parts[0] == "results"} == {folder}


JUDGING = """
from thesis_lib import tools

LEAST = 0.8


def judge(table):
    own = table[table.domain == "triangle"]
    share = tools.share(own.value > LEAST)
    return share, f"The share is {share:g}.", "as the thesis says"
"""


@pytest.fixture
def judging(tmp_path):
    """Digest of a criterion of the edition, some of its text put in place of other."""
    made = iter(range(100))

    def of(old="", new="", library="def share(x):\n    return x.mean()\n"):
        package = tmp_path / str(next(made)) / "thesis_lib"
        (package / "chapter9").mkdir(parents=True)
        (package / "tools.py").write_text(library, encoding="utf-8")
        file = package / "chapter9" / "result.py"
        file.write_text(JUDGING.replace(old, new) if old else JUDGING, encoding="utf-8")
        place = ("thesis_lib.chapter9.result", "judge")
        return reach.digest_of_judging([place], root=package.parent)

    return of


@pytest.mark.parametrize(
    ("old", "new"), [("LEAST = 0.8", "LEAST = 0.7"), ("> LEAST", ">= LEAST"), ("triangle", "cliff")]
)
def test_a_change_of_what_judges_is_another_criterion(judging, old, new):
    assert judging(old, new) != judging()


def test_a_sentence_and_the_library_are_not_the_criterion(judging):
    assert judging("The share is", "It is") == judging()
    assert judging("as the thesis says", "and more") == judging()
    assert judging(library="def share(x):\n    return x.sum() / len(x)\n") == judging()


def test_what_no_module_holds_is_refused():
    with pytest.raises(LookupError, match="no module of thesis_lib holds"):
        reach.place(effect_of("x")(str))
