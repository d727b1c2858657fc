"""What a user has set in NumPy, PyTorch or the system for other work changes no result."""

import hashlib
import locale
import random
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from threadpoolctl import threadpool_limits

from tests.surroundings import python
from thesis_lib.chapter3 import figure_3_3
from thesis_lib.surroundings import own_settings
from thesis_lib.training.config import TrainConfig
from thesis_lib.training.evaluation import EvaluateConfig, evaluate
from thesis_lib.training.run import TIMING_COLUMNS
from thesis_lib.training.train import train

RUN = TrainConfig(
    task="HalfCheetah", architecture="gru", iterations=1, batch_steps=200, horizon=100, seed=3
)


def results() -> list[bytes]:
    """A table, a policy, its curve and a test, as they are written."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        result = figure_3_3.by_alpha.run("smoke", seed=1)
        run = train(RUN, folder / "run")
        tested = evaluate(run, EvaluateConfig(runs=2, steps=30))
        curve = pd.read_csv(folder / "run" / "curve.csv", dtype=str)
        return [
            result.save(folder).read_bytes(),
            run.policy.parameter_vector().numpy().tobytes(),
            curve.drop(columns=list(TIMING_COLUMNS)).to_csv().encode(),
            tested["return"].to_numpy().tobytes(),
        ]


@pytest.fixture(scope="module")
def usual() -> list[bytes]:
    return results()


@contextmanager
def back(set_to: Callable[[object], object], value: object, before: object) -> Iterator[None]:
    set_to(value)
    try:
        yield
    finally:
        set_to(before)


def numpys_own(stack: ExitStack) -> None:
    stack.enter_context(np.errstate(all="raise"))
    stack.enter_context(np.printoptions(legacy="1.13", precision=2))
    np.random.seed(7)  # noqa: NPY002 - the global generator is what is tested


def torchs_own(stack: ExitStack) -> None:
    for set_to, value, before in (
        (torch.set_default_dtype, torch.float64, torch.get_default_dtype()),
        (torch.set_num_threads, 3, torch.get_num_threads()),
        (torch.set_float32_matmul_precision, "medium", torch.get_float32_matmul_precision()),
        (torch.use_deterministic_algorithms, True, torch.are_deterministic_algorithms_enabled()),
    ):
        stack.enter_context(back(set_to, value, before))
    torch.manual_seed(7)


def a_device(stack: ExitStack) -> None:
    # Any but the CPU; this one needs no hardware.
    stack.enter_context(back(torch.set_default_device, "meta", None))


def the_rest(stack: ExitStack) -> None:
    stack.enter_context(warnings.catch_warnings())
    warnings.simplefilter("error")
    stack.enter_context(pd.option_context("display.precision", 2))
    before = locale.setlocale(locale.LC_ALL)
    stack.callback(locale.setlocale, locale.LC_ALL, before)
    for name in ("de_DE.UTF-8", "C"):
        try:
            locale.setlocale(locale.LC_ALL, name)
            break
        except locale.Error:
            continue
    random.seed(7)


@pytest.mark.parametrize(
    "setting",
    [
        numpys_own,
        torchs_own,
        a_device,
        the_rest,
        lambda stack: stack.enter_context(torch.no_grad()),
        lambda stack: stack.enter_context(torch.inference_mode()),
        lambda stack: stack.enter_context(threadpool_limits(2)),
    ],
    ids=["numpy", "torch", "device", "the rest", "no_grad", "inference_mode", "threads"],
)
def test_what_a_program_around_it_has_set(
    setting: Callable[[ExitStack], object], usual: list[bytes]
) -> None:
    with ExitStack() as stack:
        setting(stack)
        assert results() == usual


def test_they_come_back() -> None:
    before = torch.get_num_threads()
    with np.errstate(all="raise"), torch.inference_mode(), threadpool_limits(2):
        torch.set_num_threads(2)
        try:
            with own_settings():
                assert torch.get_num_threads() == 1
                assert torch.is_grad_enabled()
                assert np.geterr()["under"] == "ignore"
            assert torch.get_num_threads() == 2
            assert torch.is_inference_mode_enabled()
            assert np.geterr()["under"] == "raise"
        finally:
            torch.set_num_threads(before)


def test_what_the_system_has_set(usual: list[bytes]) -> None:
    """Variables that count from the start of a process: threads, language, hashes, time zone."""
    foreign = {
        **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "3"),
        "NUMBA_NUM_THREADS": "1",
        "LC_ALL": "C",
        "LANG": "de_DE",
        "PYTHONUTF8": "0",
        "PYTHONHASHSEED": "7",
        "PYTHONOPTIMIZE": "1",
        "TZ": "Asia/Kolkata",
        "MKL_CBWR": None,
    }
    code = (
        "import hashlib, tests.test_surroundings as own\n"
        "print([hashlib.sha256(part).hexdigest() for part in own.results()])"
    )
    done = python("-c", code, env=foreign)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == str([hashlib.sha256(part).hexdigest() for part in usual])
