"""Experiments, their budgets, provenance and files."""

import dataclasses
import json
import os
import re
import threading
import time
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd
import pytest

from thesis_lib.checks import plain
from thesis_lib.edition import experiment as base
from thesis_lib.edition.chapters import experiments


@dataclass(frozen=True)
class Config:
    n: int = 3


def noise(config: Config, context: base.Context) -> pd.DataFrame:
    values = context.map(
        lambda seed: float(np.random.default_rng(seed).normal()), context.seeds(config.n)
    )
    return pd.DataFrame({"run": range(config.n), "value": values})


EXPERIMENT = base.Experiment(
    id="toy",
    item="Toy",
    title="Noise.",
    function=noise,
    budgets={"smoke": Config(2), "book": Config(5), "thesis": Config(7)},
    columns={"run": "index", "value": "a normal number"},
    seconds=0,
)


def test_same_seed_same_table_whatever_the_number_of_workers():
    tables = [EXPERIMENT.run("thesis", seed=4, workers=w).table for w in (1, 2, 3)]
    pd.testing.assert_frame_equal(tables[0], tables[1])
    pd.testing.assert_frame_equal(tables[0], tables[2])
    assert not EXPERIMENT.run("thesis", seed=5).table.equals(tables[0])


def test_seeds_are_independent_of_how_many_are_asked_for():
    context = base.Context(seed=3)
    few = [s.generate_state(1)[0] for s in context.seeds(2)]
    many = [s.generate_state(1)[0] for s in context.seeds(9)]
    assert few == many[:2]
    assert context.seeds(1, 1)[0].generate_state(1)[0] != few[0]


def test_save_and_load_round_trip(tmp_path):
    result = EXPERIMENT.run("smoke", seed=1)
    path = result.save(tmp_path / "new")
    table, provenance = base.load("toy", tmp_path / "new")
    pd.testing.assert_frame_equal(table, result.table)
    assert path.name == "toy.csv"
    assert provenance["config"] == {"n": 2}
    assert provenance["seed"] == 1
    assert provenance["budget"] == "smoke"
    assert {"versions", "commit", "wall_seconds", "python"} <= set(provenance)
    assert sorted(p.name for p in (tmp_path / "new").iterdir()) == ["toy.csv", "toy.json"]


def test_a_large_table_is_parquet_and_replaces_the_small_one(tmp_path):
    EXPERIMENT.run("smoke").save(tmp_path)
    big = EXPERIMENT.run(config=Config(base.ROWS_IN_CSV + 1))
    assert big.save(tmp_path).suffix == ".parquet"
    table, provenance = base.load("toy", tmp_path)
    assert len(table) == base.ROWS_IN_CSV + 1
    assert provenance["budget"] == "custom"
    assert not (tmp_path / "toy.csv").exists()


def test_a_write_that_fails_leaves_the_old_file_and_no_half_one(tmp_path):
    target = tmp_path / "file.txt"
    target.write_text("old")

    def interrupted():
        with base.replacing(target) as temporary:
            temporary.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_two_at_once_leave_the_table_of_one_with_its_own_record(tmp_path, monkeypatch):
    results = [EXPERIMENT.run("smoke", seed=seed) for seed in (1, 2)]
    write_json, at_the_record = base.write_json, threading.Event()

    def slowly(path, value):
        at_the_record.set()
        time.sleep(0.5 * (value["seed"] == 1))
        write_json(path, value)

    monkeypatch.setattr(base, "write_json", slowly)
    first = threading.Thread(target=results[0].save, args=(tmp_path,))
    first.start()
    assert at_the_record.wait(60)
    results[1].save(tmp_path)
    first.join()
    table, provenance = base.load("toy", tmp_path)
    pd.testing.assert_frame_equal(table, results[provenance["seed"] - 1].table)


def test_columns_must_be_documented():
    undocumented = base.Experiment(
        **{**{f: getattr(EXPERIMENT, f) for f in EXPERIMENT.__dataclass_fields__}, "columns": {}}
    )
    with pytest.raises(RuntimeError, match="documents"):
        undocumented.run("smoke")


@dataclass(frozen=True)
class Draw:
    """One draw."""

    run: int
    """Its number."""
    value: float
    """A normal number,
    of mean 0."""


def test_a_function_from_config_to_rows_is_an_experiment():
    @base.experiment("toy", item="Toy", smoke=Config(1), book=Config(4), seconds=2)
    def draws(config: Config, context: base.Context) -> list[Draw]:
        """Noise, again.

        More words.
        """
        return [Draw(i, 0.5) for i in range(config.n)]

    assert draws.title == "Noise, again."
    assert draws.columns == {"run": "Its number", "value": "A normal number, of mean 0"}
    assert draws.config("thesis") == Config(4)
    table = draws.run("book").table
    expected = pd.DataFrame({"run": range(4), "value": 0.5})
    pd.testing.assert_frame_equal(table, expected)


def test_a_function_may_return_a_table_whose_columns_are_told_elsewhere():
    columns = {"run": "Its number"}

    @base.experiment("toy", item="T", smoke=Config(1), book=Config(4), seconds=2, columns=columns)
    def runs(config: Config, context: base.Context) -> pd.DataFrame:
        """Numbers."""
        return pd.DataFrame({"run": range(config.n)})

    assert runs.columns == columns
    assert runs.run("book").table.run.tolist() == [0, 1, 2, 3]


def test_without_rows_the_columns_are_there():
    assert list(base.table_of(Draw, []).columns) == ["run", "value"]


def test_a_field_without_words_is_named():
    @dataclass(frozen=True)
    class Bare:
        value: float

    with pytest.raises(ValueError, match=r"Bare\.value is not documented"):
        base.columns_of(Bare)


def test_unknown_budget_names_the_allowed_ones():
    with pytest.raises(ValueError, match="'fast' does not exist: choose one of smoke, book, thes"):
        EXPERIMENT.run("fast")


@pytest.mark.parametrize("seed", [-1, 1.5, True, "3"])
def test_bad_seed(seed):
    with pytest.raises(ValueError, match="must be an integer of at least 0"):
        EXPERIMENT.run("smoke", seed=seed)


def test_workers_must_be_positive():
    with pytest.raises(ValueError, match="workers is 0"):
        EXPERIMENT.run("smoke", workers=0)


def test_missing_result_names_the_command(tmp_path):
    with pytest.raises(FileNotFoundError, match="thesis run toy"):
        base.load("toy", tmp_path)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_directory_without_permission(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(ValueError, match="cannot be written to"):
        base.writable_directory(tmp_path / "x")


def test_directory_that_is_a_file(tmp_path):
    (tmp_path / "f").write_text("")
    with pytest.raises(ValueError, match="cannot be written to"):
        base.writable_directory(tmp_path / "f")


def test_provenance_is_plain_json(tmp_path):
    EXPERIMENT.run("smoke").save(tmp_path)
    json.loads((tmp_path / "toy.json").read_text())


def test_results_directory_follows_the_environment(monkeypatch, tmp_path):
    monkeypatch.setenv("THESIS_RESULTS", str(tmp_path))
    assert base.results_directory("book") == tmp_path
    monkeypatch.delenv("THESIS_RESULTS")
    assert base.results_directory("book").parts[-3:] == ("_build", "results", "book")


def test_text_that_looks_missing_stays_text(tmp_path):
    table = pd.DataFrame(
        {"name": ["none", "None", "NA", "nan", None], "x": [0.1, 1e-300, 2, 3, np.nan]}
    )
    table.to_csv(tmp_path / "t.csv", index=False)
    read = base.read_csv(tmp_path / "t.csv")
    assert read.name.tolist()[:4] == ["none", "None", "NA", "nan"]
    assert read.name.isna().tolist() == [False] * 4 + [True]
    assert read.x.tolist()[:4] == [0.1, 1e-300, 2, 3]
    assert np.isnan(read.x[4])


def in_numpy(value: Any) -> Any:
    """The same settings as a user of NumPy may write them."""
    if dataclasses.is_dataclass(value):
        names = [f.name for f in dataclasses.fields(value)]
        return dataclasses.replace(value, **{n: in_numpy(getattr(value, n)) for n in names})
    if isinstance(value, tuple):
        return np.array(value)
    return value if value is None else np.array(value)[()]


def test_settings_in_numpy_are_the_same_settings():
    for entry in experiments().values():
        for config in entry.budgets.values():
            assert plain(in_numpy(config)) == config, entry.id
            written = [json.dumps(dataclasses.asdict(c)) for c in (plain(in_numpy(config)), config)]
            assert written[0] == written[1], entry.id


@dataclass(frozen=True)
class Rich:
    n: int = 2
    inner: Config = Config()
    levels: tuple[float, ...] = (0.5, 1.0)
    way: Literal["up", "down"] = "up"
    most: float | Literal["all"] = "all"
    flag: bool = False


RICH = dataclasses.replace(
    EXPERIMENT,
    function=lambda config, context: noise(Config(config.n), context),
    budgets={name: Rich() for name in ("smoke", "book", "thesis")},
)


def test_a_run_of_settings_in_numpy_is_that_of_its_budget(tmp_path):
    given = in_numpy(Rich())
    result = RICH.run("smoke", config=given, seed=np.int64(3), workers=np.int64(2))
    assert isinstance(given.levels, np.ndarray)  # the user's own is left alone
    assert result.provenance["budget"] == "smoke"
    result.save(tmp_path)
    _, record = base.load("toy", tmp_path)
    assert record["config"] == json.loads(json.dumps(dataclasses.asdict(Rich())))
    assert (record["seed"], record["workers"]) == (3, 2)
    other = RICH.run("smoke", config=Rich(levels=np.linspace(0, 1, 3), most=np.float32(0.5)))
    assert other.provenance["budget"] == "custom"
    assert other.provenance["config"]["levels"] == (0.0, 0.5, 1.0)
    assert other.provenance["config"]["most"] == 0.5


@pytest.mark.parametrize(
    ("config", "message"),
    [
        (Rich(n=np.float64(2.5)), r"n is 2.5, but it must be a whole number"),
        (Rich(n=True), "n is True, but it must be a whole number"),
        (Rich(flag=1), "flag is 1, but it must be True or False"),
        (Rich(inner=Config("3")), "n is '3', but it must be a whole number"),
        (Rich(levels=0.5), "levels is 0.5, but it must be several values"),
        (Rich(levels=np.array(0.5)), "levels is array.*, but it must be several values"),
        (Rich(levels=np.array([0.5, np.nan])), "levels is nan, but it must be a finite number"),
        (Rich(way=np.array(["up", "down"])), "way array.* does not exist: choose one of up, down"),
        (Rich(most="some"), "most is 'some', but it must be a finite number"),
        (Config(2), "config is Config.*, but toy takes a Rich of tests"),
        ({"n": 2}, "config is {'n': 2}, but toy takes a Rich of tests"),
    ],
)
def test_settings_that_are_not_what_they_should_be(config, message):
    with pytest.raises(ValueError, match=message) as caught:
        RICH.run("smoke", config=config)
    assert "\n" not in str(caught.value)


@dataclass(frozen=True)
class Inner:
    runs: int = 2


@dataclass(frozen=True)
class Counts:
    runs: int = 2
    extra: int = 5
    rates: tuple[float, ...] = (0.1,)
    sizes: tuple[tuple[int, int], ...] = ((1, 2),)
    inner: Inner = Inner()


COUNTING = base.Experiment(
    id="counting",
    item="Counting",
    title="Nothing.",
    function=lambda config, context: pd.DataFrame({"n": []}),
    budgets=dict.fromkeys(base.BUDGETS, Counts()) | {"smoke": Counts(extra=0)},
    columns={"n": "none"},
    seconds=0,
)


@pytest.mark.parametrize(
    ("config", "message"),
    [
        (Counts(runs=0), "runs is 0, but it must be at least 1."),
        (Counts(runs=-3), "runs is -3, but it must be at least 1."),
        (Counts(extra=-1), "extra is -1, but it must be at least 0."),
        (Counts(rates=()), "rates is empty, but it must have at least one value."),
        (Counts(sizes=((1, 0),)), "sizes is ((1, 0),), but it must be at least 1."),
        (Counts(inner=Inner(runs=0)), "runs is 0, but it must be at least 1."),
    ],
)
def test_counts_of_nothing(config, message):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        COUNTING.run(config=config)
    COUNTING.run(config=Counts(extra=0))


def test_no_budget_counts_nothing():
    for experiment in experiments().values():
        for config in experiment.budgets.values():
            base._check_counts(config, list(experiment.budgets.values()))
