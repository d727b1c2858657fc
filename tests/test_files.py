"""Files written aside, and a lock that goes with its holder."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from thesis_lib.files import alone, write_json

HOLDER = """
import sys, time
from pathlib import Path
from thesis_lib.files import alone
with alone(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.fixture(params=["a folder", "a file"])
def held(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[Path, subprocess.Popen]]:
    """What another process holds, and that process."""
    path = tmp_path if request.param == "a folder" else tmp_path / "lock"
    command = [sys.executable, "-c", HOLDER, str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        yield path, holder
        holder.kill()


def test_what_another_holds_is_refused_and_free_once_that_is_killed(
    held: tuple[Path, subprocess.Popen],
) -> None:
    path, holder = held

    def refuse() -> None:
        raise ValueError("it is taken")

    start = time.monotonic()
    with pytest.raises(ValueError, match="it is taken"), alone(path, refuse, patience=0.3):
        pass
    assert 0.3 <= time.monotonic() - start < 5
    told = []

    def tell() -> None:
        told.append("waiting")
        holder.send_signal(signal.SIGKILL)

    with alone(path, tell):
        assert told == ["waiting"]
    with alone(path, refuse):  # it was let go
        pass


def test_a_lock_is_let_go_after_an_error(tmp_path: Path) -> None:
    with pytest.raises(KeyError), alone(tmp_path / "lock"):
        raise KeyError
    with alone(tmp_path / "lock", pytest.fail):
        pass


def test_json_has_numbers_of_numpy_and_a_failure_keeps_the_old(tmp_path: Path) -> None:
    file = tmp_path / "record.json"
    write_json(file, {"n": np.int64(3), "x": np.array([0.5]), "where": Path("a")})
    assert json.loads(file.read_text()) == {"n": 3, "x": [0.5], "where": "a"}
    with pytest.raises(TypeError, match="object cannot be written as JSON"):
        write_json(file, object())
    assert json.loads(file.read_text())["n"] == 3
    assert [f.name for f in tmp_path.iterdir()] == ["record.json"]
