"""The results store as chapter 5 reads it."""

import dataclasses
import json
from itertools import product

import numpy as np
import pandas as pd
import pytest

from thesis_lib import published
from thesis_lib.chapter5 import (
    cell_table,
    cells,
    judging,
    printed_length,
    table_5_2,
    training_length,
)
from thesis_lib.chapter5.cells import NETS, ROBOTS
from thesis_lib.chapter5.contrasts import Config, chosen
from thesis_lib.chapter5.returns import table_5_3, table_c_1
from thesis_lib.chapter5.runs import read_runs
from thesis_lib.edition.ledger import Verdict
from thesis_lib.edition.words import number
from thesis_lib.published import TASKS
from thesis_lib.robustness import CONDITIONS
from thesis_lib.training import curves
from thesis_lib.training.config import TrainConfig
from thesis_lib.training.plan import cost
from thesis_lib.training.suite import SuiteConfig, evaluate_all, write
from thesis_lib.training.sweep import sweep

COLUMNS = ["claim", "verdict", "evidence"]
RUN = {"task": "Hopper", "terrain": "flat", "architecture": "gru", "variant": "default"}


def layer(folder, name, seeds, iterations, batch, returns=1.0, **cell):
    """Write one layer; ``iterations`` may be given seed by seed."""
    each = iterations if isinstance(iterations, list) else [iterations] * seeds
    rows = [
        RUN | cell | {"seed": s, "iteration": i, "steps": i * batch + 7, "mean_return": returns * i}
        for s, last in enumerate(each)
        for i in range(1, last + 1)
    ]
    path = folder / name
    path.mkdir(parents=True)
    pd.DataFrame(rows).to_csv(path / "curves.csv", index=False)
    return path


def test_a_store_that_does_not_exist_holds_no_runs(tmp_path):
    runs = read_runs(tmp_path / "none")
    assert runs.curves.empty
    assert runs.deepest().empty
    assert runs.learning().empty
    assert runs.returns().empty


def test_the_deepest_budget_with_enough_seeds_counts(tmp_path):
    layer(tmp_path, "breadth", 3, 4, 20_000)
    layer(tmp_path, "depth", 3, 10, 50_000)
    found = read_runs(tmp_path).deepest()
    assert found[["layer", "iterations", "batch_steps", "seeds"]].values.tolist() == [
        ["depth", 10, 50_000, 3]
    ]


def test_deep_runs_of_few_seeds_wait_for_more(tmp_path):
    layer(tmp_path, "breadth", 3, 4, 20_000)
    layer(tmp_path, "depth", 2, 10, 50_000)
    runs = read_runs(tmp_path)
    assert runs.deepest().layer.tolist() == ["breadth"]
    assert runs.depths().layer.tolist() == ["breadth", "depth"]


def test_every_run_of_the_printed_length_stands_beside_shorter_ones(tmp_path):
    cell = {"task": "HalfCheetah", "architecture": "ctrnn"}
    layer(tmp_path, "breadth", 3, 150, 20_000, **cell)
    layer(tmp_path, "depth", 2, 500, 50_000, returns=2.0, **cell)
    layer(tmp_path, "nearly", 5, 499, 50_000, **cell | {"architecture": "gru"})
    table = printed_length.curves.run("book", config=Config(store=str(tmp_path))).table
    assert table.groupby("seed").size().to_dict() == {0: 50, 1: 50}
    first, seventh = table.iloc[0], table.iloc[6]
    # Iterations 1 to 10 of 50,000 steps return 2, 4, .. 20, and 1 to 25 of 20,000 return 1 .. 25.
    assert (first.iteration, first.steps, first.mean_return) == (5.5, 500_007, 11.0)
    assert (first.shorter, first.shorter_seeds) == (13.0, 3)
    assert np.isnan(seventh.shorter)
    row = printed_length.shown(table).iloc[0]
    assert (row.printed, row.ours, row["ours at the end"]) == ("1534 (167)", "501, 501", "991, 991")
    both = pd.concat([table, table.assign(trained_on="hill", printed=1094.0)])
    (panel,) = printed_length.draw(both).axes
    means = [float(line.get_ydata()[0]) for line in panel.lines if len(line.get_ydata()) == 1]
    dashed = [float(line.get_ydata()[0]) for line in panel.lines if line.get_linestyle() == "--"]
    assert means == [501.0] * 4
    assert dashed == pytest.approx([1534.0, 1094.0], abs=1)
    printed_length.draw(table.iloc[:0])


def perturbed(folder, iterations, batch, kept, few=""):
    """Write a layer of half-cheetahs whose three policies keep .9, 1 and 1.1 times ``kept``.

    ``kept`` has the shares under noise and over the switch by net; of the net ``few`` there are
    two policies.
    """
    runs = [
        RUN | {"task": "HalfCheetah", "architecture": net.lower(), "seed": seed}
        for net in NETS
        for seed in range(2 if net == few else 3)
    ]
    curve = [
        run | {"iteration": i, "steps": i * batch, "mean_return": 1.0}
        for run in runs
        for i in (1, iterations)
    ]
    tests = [
        run | {"condition": condition, "test": 0, "policy": "last", "return": 1000 * share}
        for run in runs
        for condition, share in zip(
            ("base", "noise", "switch"),
            (1, *((0.9 + 0.1 * run["seed"]) * x for x in kept[run["architecture"].upper()])),
            strict=True,
        )
    ]
    folder.mkdir()
    pd.DataFrame(curve).to_csv(folder / "curves.csv", index=False)
    pd.DataFrame(tests).to_csv(folder / "tests.csv", index=False)


def test_what_is_kept_is_held_against_the_length_of_training(tmp_path):
    """Nets keep .84 to .9 after the short training; after the long one half the printed share."""
    base, noise, switch = (
        published.load(name).set_index(["trained_on", "task", "architecture"]).value
        for name in ("table-c.1", "table-c.2", "table-c.3")
    )
    at = {net: ("flat", "half_cheetah", net) for net in NETS}
    half = {net: [t[at[net]] / base[at[net]] / 2 for t in (noise, switch)] for net in NETS}
    early = {net: (0.9 - 0.01 * i,) * 2 for i, net in enumerate(NETS)}
    for name, few in (("whole", ""), ("lacking", "GRU")):
        (tmp_path / name).mkdir()
        perturbed(tmp_path / name / "short", 150, 20_000, early)
        perturbed(tmp_path / name / "long", 500, 50_000, half, few)
    lacking, table = (
        training_length.kept_by_length.run(config=Config(store=str(tmp_path / name))).table
        for name in ("lacking", "whole")
    )
    assert lacking.empty
    assert training_length.reading(lacking).startswith("No row")
    assert len(table) == 7 * 2 * 2
    own = table[table.architecture == "FFWD"].set_index(["perturbation", "steps"])
    # Tables C.1 to C.3: the FFWD earns 3692.0, 1725.1 and 1639.7.
    assert own.printed["noise"].iloc[0] == pytest.approx(1725.1 / 3692.0)
    assert own.kept["noise", 25_000_000] == pytest.approx(1725.1 / 3692.0 / 2)
    assert own.kept["switch", 25_000_000] == pytest.approx(1639.7 / 3692.0 / 2)
    assert own.kept["noise", 3_000_000] == pytest.approx(0.86)
    # Three seeds at .9, 1 and 1.1 times: a standard error of .1 / sqrt(3), and t(2) = 4.303.
    assert own.ci95["noise", 3_000_000] == pytest.approx(0.86 * 4.303 * 0.1 / 3**0.5, rel=1e-3)
    assert training_length.where(table) == "HalfCheetah, flat"
    told = training_length.reading(table)
    assert told.count("7 of 7 nets keep less") == 2
    assert "sign test p = 0.016" in told  # 2 / 2**7
    assert "printed shares is 1.00 (p = 0) after the longer training" in told
    assert training_length.losers(table) == (
        "of the nets that learned on flat ground (HalfCheetah) 7 of 7 keep less under noise after "
        "25 million steps than after 3 million, and 7 of 7 over the switch"
    )
    assert training_length.losers(lacking).startswith("no row")
    drawn = [line for ax in training_length.draw(table).axes for line in ax.lines]
    ffwd = [line.get_ydata() for line in drawn if line.get_label() == "FFWD"]
    assert ffwd == [pytest.approx([0.86, 1725.1 / 3692.0 / 2]),
                    pytest.approx([0.86, 1639.7 / 3692.0 / 2])]  # fmt: skip
    training_length.draw(lacking)
    shown = training_length.shown(table).set_index("net")
    assert shown.loc["FFWD", "noise, printed"] == "0.47"
    assert shown.loc["FFWD", "noise, 3 million"] == "0.86 ± 0.21"


def test_what_is_left_to_run_is_told_with_its_cost(tmp_path):
    cell = {"task": "HalfCheetah", "architecture": "ctrnn"}
    layer(tmp_path, "depth", 3, 500, 50_000, **cell)
    told = cell_table.left_to_run(table_5_2.entries.run(config=Config(store=str(tmp_path))).table)
    assert "Nothing has been run on " in told
    assert "HalfCheetah hill" in told
    assert "HalfCheetah flat" not in told
    every = sum(
        cost(TrainConfig(task=robot, terrain=ground, architecture=net.lower()))
        for robot, ground, net in product(TASKS, ("flat", "hill"), NETS)
    )
    # 69 of 70 cells; the one that was run takes 20 microseconds a step, by the plan's own rates.
    hours = 3 * (every - 500 * 50_000 * 20e-6) / 3600
    assert "Of 70 cells 69 have not been run at the printed length with 3 seeds" in told
    assert f"about {number(hours)} processor hours" in told


def test_how_long_the_runs_of_each_cell_are_is_told_cell_by_cell(tmp_path):
    cell = {"task": "HalfCheetah", "architecture": "ctrnn"}
    layer(tmp_path, "depth", 3, 500, 50_000, **cell)
    layer(tmp_path, "breadth", 4, 150, 20_000, **cell | {"architecture": "gru"})
    table = table_5_2.entries.run(config=Config(store=str(tmp_path))).table
    row = cell_table.budgets(table).set_index("robot").loc["HalfCheetah"]
    assert (row.CTRNN, row.GRU, row.LSTM) == ("**25 (3)**", "3 (4)", None)
    # Nets of one row that have not run as long are named.
    told = cell_table.run_length(table)
    assert "500 iterations of 50,000 steps" in told
    assert "HalfCheetah flat CTRNN" in told or "HalfCheetah flat GRU" in told


def test_runs_of_some_robots_nets_and_seeds(tmp_path):
    for net in ("gru", "dtrnn"):
        layer(tmp_path, net, 4, 2, 1000, architecture=net)
    config = Config(store=str(tmp_path), tasks="Hopper", architectures="GRU", seeds="0 3")
    found = config.runs().curves
    assert (set(found.architecture), set(found.seed)) == ({"gru"}, {0, 3})
    assert Config(store=str(tmp_path), tasks="Ant").runs().curves.empty


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"tasks": "hopper"}, "tasks has 'hopper', but it must name some of Ant, HalfCheetah"),
        ({"architectures": ["dtrnn", "rnn"]}, "architectures has 'rnn'.*ctrnn, dtrnn"),
        ({"seeds": "1 -2"}, "seeds has '-2'.*at least 0"),
        ({"seeds": 0.5}, "seeds has '0.5'"),
        ({"store": "/nowhere/at/all"}, "no such folder: give one in which `thesis sweep`"),
    ],
)
def test_a_notebooks_parameters_are_refused_in_one_sentence(given, message):
    with pytest.raises(ValueError, match=message) as refused:
        chosen(**given)
    assert "\n" not in str(refused.value)


def test_a_notebooks_parameters_are_text_or_lists(tmp_path):
    asked = chosen(["Hopper", "Ant"], "gru", 3, str(tmp_path))
    assert asked == {
        **{"tasks": "Hopper Ant", "architectures": "gru", "seeds": "3"},
        "store": str(tmp_path.resolve()),
    }
    assert chosen() == {"tasks": "", "architectures": "", "seeds": "", "store": ""}


def test_each_source_is_told_beside_the_verdict():
    good = judging.Evidence(Verdict.REPRODUCED, "5 of 7 (one: Our Hopper).")
    bad = judging.Evidence(Verdict.REFUTED, "2 of 7.", units=3, tasks=4)
    found = [judging.weigh(good, bad), judging.weigh(good, None), judging.weigh(None, good)]
    rows = judging.side_by_side(
        pd.DataFrame([("c", str(f.verdict), f.evidence) for f in found], columns=COLUMNS)
    )
    assert rows.columns.tolist() == ["claim", "verdict", "printed", "ours", "why"]
    # Four of five robots tell nothing.
    assert rows.printed.fillna("").tolist() == ["reproduced", "reproduced", ""]
    assert rows.ours.fillna("").tolist() == ["inconclusive at this budget", "", "reproduced"]
    assert rows.why.tolist() == [f.evidence for f in found]


def test_misprints_are_told_once_a_table():
    config = Config(store="/nowhere")
    tables = {n: e.run(config=config).table for n, e in (("5.3", table_5_3), ("C.1", table_c_1))}
    found = cell_table.misprints(tables)
    assert found.table.tolist() == ["5.3", "C.1", "C.1"]
    assert found.entry.tolist()[0] == "Hopper flat, CTRNN"
    assert found.printed.tolist()[0] == "2351.4"
    assert "all 10 of DFFWD" in found.entry.tolist()
    assert found["what is known"].str.contains("Table C.1 prints 2331.4").any()


def test_without_enough_seeds_anywhere_the_deepest_counts(tmp_path):
    layer(tmp_path, "breadth", 2, 4, 20_000)
    layer(tmp_path, "depth", 1, 10, 50_000)
    assert read_runs(tmp_path).deepest().layer.tolist() == ["depth"]


def test_grounds_are_compared_at_a_budget_that_both_have(tmp_path):
    layer(tmp_path, "breadth", 3, 4, 20_000)
    layer(tmp_path / "breadth", "hills", 3, 4, 20_000, terrain="hill")
    layer(tmp_path, "depth", 3, 10, 50_000)
    runs = read_runs(tmp_path)
    assert runs.deepest().layer.tolist() == ["depth", "breadth"]
    assert runs.deepest(across=["terrain"]).layer.tolist() == ["breadth", "breadth"]


def test_a_budget_of_one_ground_counts_where_the_other_has_none(tmp_path):
    layer(tmp_path, "breadth", 3, 4, 20_000)
    layer(tmp_path, "depth", 3, 10, 50_000)
    assert read_runs(tmp_path).deepest(across=["terrain"]).layer.tolist() == ["depth"]


def test_a_study_may_ask_for_more_seeds(tmp_path):
    layer(tmp_path, "breadth", 5, 4, 20_000)
    layer(tmp_path, "depth", 3, 10, 50_000)
    runs = read_runs(tmp_path)
    assert runs.deepest(enough=5).layer.tolist() == ["breadth"]
    assert runs.deepest(enough=6).layer.tolist() == ["depth"]


def test_unfinished_runs_are_left_out(tmp_path):
    layer(tmp_path, "depth", 4, [10, 10, 10, 6], 50_000)
    runs = read_runs(tmp_path)
    assert runs.deepest().seeds.tolist() == [3]
    assert sorted(runs.learning().seed) == [0, 1, 2]


def test_learning_is_the_mean_over_all_iterations(tmp_path):
    layer(tmp_path, "depth", 3, 10, 50_000)
    found = read_runs(tmp_path).learning()
    assert found.mean_return.tolist() == [5.5] * 3  # of 1 to 10
    assert found.last_return.tolist() == [8.0] * 3  # of 6 to 10


def test_returns_are_means_over_test_runs_at_that_budget(tmp_path):
    path = layer(tmp_path, "depth", 3, 10, 50_000)
    other = layer(tmp_path, "breadth", 3, 2, 20_000)
    tests = [
        RUN | {"seed": s, "condition": "noise", "test": r, "return": 10.0 * s + r}
        for s in range(3)
        for r in range(3)
    ]
    pd.DataFrame(tests).to_parquet(path / "tests.parquet")
    pd.DataFrame(tests).assign(**{"return": -1.0}).to_parquet(other / "tests.parquet")
    found = read_runs(tmp_path).returns()
    assert found["return"].tolist() == [1.0, 11.0, 21.0]
    assert set(found.correlation) == {0.0}
    assert set(found.intervention) == {"none"}
    assert set(found.iterations) == {10}


def test_a_run_of_a_test_that_two_folders_hold_counts_once(tmp_path):
    made = layer(tmp_path, "a", 1, 2, 1000)
    test = RUN | {"seed": 0, "condition": "base"}
    for name, returns in (("", [1.0, 5.0]), ("more", [1.0, 5.0, 6.0])):
        (made / name).mkdir(exist_ok=True)
        rows = [test | {"test": i, "return": r} for i, r in enumerate(returns)]
        pd.DataFrame(rows).to_parquet(made / name / "tests.parquet")
    assert read_runs(tmp_path).returns()["return"].tolist() == [4.0]


def test_a_file_without_a_column_is_named(tmp_path):
    path = layer(tmp_path, "depth", 3, 2, 50_000)
    pd.read_csv(path / "curves.csv").drop(columns="seed").to_csv(path / "curves.csv")
    with pytest.raises(
        ValueError, match=r"curves\.csv of the layer 'depth' lacks the columns seed"
    ):
        read_runs(tmp_path)


@pytest.mark.parametrize(
    ("name", "value"),
    [("termination", "never"), ("difficulty", 0.5), ("noise", 0.5), ("steps", 20), ("seed", 1)],
)
def test_tests_under_other_conditions_do_not_mix(tmp_path, name, value):
    for folder in ("depth", "breadth"):
        layer(tmp_path, folder, 3, 4, 20_000)
    config = dataclasses.asdict(SuiteConfig())
    (tmp_path / "depth" / "tests.json").write_text(json.dumps({"config": config}))
    other = config | {name: value, "runs": 100, "memory": False}  # of these there are columns
    (tmp_path / "breadth" / "tests.json").write_text(json.dumps({"config": other}))
    with pytest.raises(ValueError, match=f"with {name} .* keep those of other conditions outside"):
        read_runs(tmp_path)
    (tmp_path / "breadth" / "tests.json").write_text(json.dumps({"config": config | {"runs": 9}}))
    assert len(read_runs(tmp_path).curves)


def test_nets_that_one_picture_compares_have_learned_for_as_long(tmp_path):
    """Two nets have deep runs and a third shallow ones alone: then the shallow ones count."""
    for name, nets, iterations in (("breadth", ("ffwd", "dffwd", "ffwd-400"), 4),
                                   ("depth", ("ffwd", "dffwd"), 10)):  # fmt: skip
        parts = [
            layer(tmp_path, f"{name}/{net}", 3, iterations, 20_000, architecture=net)
            for net in nets
        ]
        tests = [
            RUN | {"architecture": net, "seed": seed, "condition": condition, "test": 0}
            | {"return": float(iterations)}
            for net in nets for seed in range(3) for condition in CONDITIONS
        ]  # fmt: skip
        pd.DataFrame(tests).to_parquet(parts[0] / "tests.parquet")
    store, rng = read_runs(tmp_path), np.random.default_rng(0)
    nets = ("FFWD", "DFFWD", "FFWD-400")
    for across, expected in ((("terrain",), [10, 10, 4]), (("terrain", "architecture"), [4] * 3)):
        made = cells.from_tests(store, rng, 10, nets, across)
        assert made.mean[0, 0, ROBOTS.index("Hopper")].tolist() == expected


def test_the_store_is_what_a_sweep_and_its_tests_write(tmp_path):
    """Both write more files, and more columns, than are read; tests may have folders of theirs."""
    config = TrainConfig("HalfCheetah", architecture="ffwd", iterations=1, batch_steps=1000)
    sweep([config], tmp_path / "runs", workers=1)
    out = tmp_path / "store" / "layer"
    curves.write([config], tmp_path / "runs", out, command="")
    suite = SuiteConfig(conditions=("base",), runs=2, steps=5)
    tests = evaluate_all(out / "policies.pt", suite, workers=1)
    write(tests, out / "policies.pt", suite, out / "base", command="")
    runs = read_runs(tmp_path / "store")
    (curve,), (tested,) = runs.learning().to_dict("records"), runs.returns().to_dict("records")
    assert curve["batch_steps"] == 1000
    assert (tested["variant"], tested["intervention"]) == ("default", "none")
    assert tested["return"] == tests["return"].mean()


def test_a_table_of_cells_reads_as_the_thesis_prints_it():
    def cell(ground: str, net: str, leads: bool, ours: float, error: float, seeds: int) -> dict:
        return {
            **{"task": "Hopper", "trained_on": ground, "architecture": net},
            **{"printed": 96.4, "printed_error": 21.6, "leads": leads},
            **{"ours": ours, "error": error, "ours_leads": True},
            **{"seeds": seeds, "iterations": 150 * (seeds > 0), "batch_steps": 20_000},
        }

    nan = float("nan")
    table = pd.DataFrame(
        [
            cell("flat", "CTRNN", False, 1230.6, 7.0, 3),
            cell("flat", "LSTM", True, 5.0, nan, 1),
            cell("hill", "CTRNN", False, nan, nan, 0),
            cell("hill", "LSTM", False, nan, nan, 0),
        ]
    )
    made = cell_table.shown(table)
    assert made.robot.tolist() == ["Hopper", "ours, n = 1 to 3", "Hopper hill", "not run"]
    assert cell_table.run_length(table) == "150 iterations of 20,000 steps"
    assert cell_table.run_length(table[table.seeds == 0]) == "no iteration"
    longer = table.assign(seeds=3, iterations=[150, 150, 500, 500])
    assert cell_table.run_length(pd.concat([longer, longer[:2].assign(task="Ant")])) == (
        "150 iterations of 20,000 steps; on Hopper hill 500 iterations of 20,000 steps"
    )
    assert made.CTRNN[:3].tolist() == ["96 (22)", "1231 (7)", "96 (22)"]
    # Where all lead, nothing is bold.
    assert made.LSTM[:3].tolist() == ["**96 (22)**", "5", "96 (22)"]
    assert made[["CTRNN", "LSTM"]].iloc[3].isna().all()


NAN = float("nan")


def rows_of_ours(*rows: tuple[str, str, list[float]]) -> pd.DataFrame:
    """Cells of some rows: robot, ground, and means of ours by net; NaN where nothing has run."""
    return pd.DataFrame(
        {
            **{"task": robot, "trained_on": ground, "architecture": net},
            **{"printed": 2.0, "printed_error": 0.1, "leads": False},
            **{"ours": mean, "error": 0.1 if mean < 9 else NAN, "ours_leads": False},
            **{"seeds": 3, "iterations": 500, "batch_steps": 50_000, "printed_budget": mean != 4},
        }
        for robot, ground, means in rows
        for net, mean in zip(NETS, means, strict=False)
    )


def test_rows_that_have_been_run_whole_are_judged_and_the_rest_is_left_out():
    asked = rows_of_ours(
        ("Hopper", "flat", [4.0, 1.0]),
        ("Hopper", "hill", [3.0, 9.0]),  # one run of the second net: no standard error
        ("Ant", "flat", [3.0, 3.0]),
        ("Ant", "hill", [3.0, NAN]),
    )
    whole = cell_table.whole_rows(asked, "ours", 20)
    assert whole[["task", "trained_on"]].drop_duplicates().values.tolist() == [
        ["Hopper", "flat"],
        ["Hopper", "hill"],
        ["Ant", "flat"],
    ]
    several = cell_table.whole_rows(asked, "ours", 20, errors=True)
    assert several.index.tolist() == [0, 1, 4, 5]
    assert cell_table.whole_rows(asked, "ours", 20, errors=True, least=3).empty
    printed = cell_table.whole_rows(asked, "printed", 20, least=4)
    assert (
        printed[["value", "error", "units", "printed_budget"]].values.tolist()
        == [[2.0, 0.1, 20, True]] * 8
    )
    found = cell_table.whole(20, "task == 'Ant'")("ours", asked)
    assert found[["task", "value", "units"]].values.tolist() == [["Ant", 3.0, 3]] * 2


def test_evidence_counts_robots_whose_rows_are_all_there():
    asked = rows_of_ours(
        ("Hopper", "flat", [4.0, 1.0]),
        ("Ant", "flat", [3.0, 3.0]),
        ("Ant", "hill", [3.0, NAN]),
    )
    rows = cell_table.whole_rows(asked, "ours", 5)
    found = judging.of_rows(rows, Verdict.REPRODUCED, "They do.")
    assert (found.tasks, found.of_tasks, found.units) == (1, 2, 3)
    assert not found.printed_budget  # of one cell
    rows = cell_table.whole_rows(asked, "printed", 5)
    printed = judging.of_rows(rows, Verdict.REPRODUCED, "It does.")
    assert (printed.tasks, printed.of_tasks, printed.units) == (2, 2, 5)
    assert printed.printed_budget
    made = judging.weigh(printed, found)
    assert made.verdict is Verdict.INCONCLUSIVE
    assert "(3 seeds or more, 1 of 2 robots, not all as long as the thesis's)" in made.evidence


def test_evidence_counts_robots_by_name_or_as_told():
    named = pd.DataFrame({"task": ["Ant", "all", "Hopper", "Ant"], "units": [3, 4, 5, 6]})
    named["printed_budget"] = [True, True, True, False]
    told = named.assign(robots=[5, 4, 5, 5])
    found, other = (judging.of_rows(r, Verdict.REPRODUCED, "So.") for r in (named, told))
    assert (found.tasks, found.of_tasks, found.units, found.printed_budget) == (2, 5, 3, False)
    assert other.tasks == 4


def test_a_judge_of_rows_is_not_asked_without_any():
    @judging.both("a-claim", rows=judging.of_source)
    def judge(rows):
        return Verdict.REPRODUCED, f"mean {rows.value.mean():g}."

    table = pd.DataFrame({"source": ["printed"] * 2, "value": [1.0, 2.0], "task": ["Ant"] * 2})
    table = table.assign(units=20, tasks=5, printed_budget=True)
    found = judge(table)
    assert found.verdict is Verdict.NOT_RUN
    assert found.evidence == (
        "The printed tables bear it out: mean 1.5. Ours have not all been run yet."
    )
    both = judge(pd.concat([table, table.assign(source="ours")]))
    assert both.verdict is Verdict.REPRODUCED


def test_a_claim_about_one_robot_needs_no_other():
    asked = rows_of_ours(("Hopper", "flat", [3.0, 1.0]))
    rows = cell_table.whole_rows(asked, "ours", 5)
    found = judging.of_rows(rows, Verdict.NOT_REPRODUCED, "They do not.")
    made = judging.weigh(None, found)
    assert made.verdict is Verdict.NOT_REPRODUCED
    assert "Our runs (3 seeds or more)" in made.evidence


def test_a_hopper_that_has_not_been_run_leaves_its_claim_open():
    """The other robots alone say nothing of which is hardest."""
    whole, begun = [1.0, 1.0, 1.0, 3.0, 3.0, 1.0, 1.0], [1.0] * 6 + [NAN]
    others = [(robot, "flat", whole) for robot in ("Ant", "Swimmer")]
    table = rows_of_ours(*others, ("Hopper", "flat", begun))
    assert table_5_2.hopper_hard(table).evidence.endswith("Ours have not all been run yet.")
    table = rows_of_ours(*others[:1], ("Hopper", "flat", whole), ("Swimmer", "flat", begun))
    found = table_5_2.hopper_hard(table)
    assert "(3 seeds or more, 2 of 3 robots)" in found.evidence
    assert "Ant 3.00, Hopper 3.00." in found.evidence
    table.loc[table.task == "Ant", "iterations"] = 150
    assert "on the flat: Hopper 3.00;" in table_5_2.hopper_hard(table).evidence
    # Budgets that differ from net to net alike are the same budget.
    table.loc[table.architecture == "ESN", "iterations"] = 100
    table.loc[(table.task == "Ant") & (table.architecture != "ESN"), "iterations"] = 500
    assert "Ant 3.00, Hopper 3.00." in table_5_2.hopper_hard(table).evidence
