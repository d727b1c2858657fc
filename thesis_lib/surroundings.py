"""Computing the same whatever a program around this library has set for work of its own."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import numpy as np
from threadpoolctl import threadpool_limits


@contextmanager
def own_settings() -> Iterator[None]:
    """Settings of NumPy and PyTorch under which all results are made; a user's come back after.

    Linear algebra gets one thread: the nets are small, so that more make them slower; and a sum's
    last digits depend on the number of threads, so that runs repeat exactly only on equal
    numbers.
    """
    with ExitStack() as settings:
        settings.enter_context(np.errstate(all="warn", under="ignore"))
        if (torch := sys.modules.get("torch")) is not None:
            settings.callback(torch.set_num_threads, torch.get_num_threads())
            torch.set_num_threads(1)
            settings.callback(
                torch.set_float32_matmul_precision, torch.get_float32_matmul_precision()
            )
            torch.set_float32_matmul_precision("highest")
            settings.enter_context(torch.inference_mode(False))
            settings.enter_context(torch.enable_grad())
            if torch.get_default_device().type != "cpu":  # the context slows each operation down
                settings.enter_context(torch.device("cpu"))
        settings.enter_context(threadpool_limits(1))
        yield
