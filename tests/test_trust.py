"""Nothing that is loaded from elsewhere runs code, as the page *What is trusted* says."""

import ast
import os
from pathlib import Path

import pytest
import torch

from tests.surroundings import ROOT
from thesis_lib.training.run import Training
from thesis_lib.training.trained import TrainedPolicies

FILES = sorted((ROOT / "thesis_lib").rglob("*.py"))
RUN_CODE = {"pickle", "cPickle", "dill", "cloudpickle", "joblib", "shelve", "marshal"}
SAFELY = {"torch.load": ("weights_only", True), "np.load": ("allow_pickle", False)}
NEVER = {"eval", "exec", "yaml.load", "pd.read_pickle", "os.system", "tarfile.open"}


@pytest.mark.parametrize("file", FILES, ids=lambda f: str(f.relative_to(ROOT)))
def test_no_reader_that_runs_code(file: Path) -> None:
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else [node.module]
            assert not RUN_CODE & {str(name).split(".")[0] for name in names}
        if isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            assert called not in NEVER, f"line {node.lineno}"
            if called in SAFELY:
                given = {k.arg: getattr(k.value, "value", None) for k in node.keywords}
                name, value = SAFELY[called]
                assert given.get(name) is value, f"line {node.lineno}"


class Evil:
    """What a pickle may hold: a call that is made when it is read."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[object, ...]:
        return os.mkdir, (str(self.mark),)


def test_a_checkpoint_that_carries_code_is_refused_and_the_code_is_not_run(tmp_path: Path) -> None:
    mark, file = tmp_path / "ran", tmp_path / "checkpoint.pt"
    torch.save({"format": Evil(mark)}, file)
    for load in (Training.load, TrainedPolicies):
        with pytest.raises(ValueError, match="checkpoint"):
            load(file).load("any")  # type: ignore[attr-defined]
    assert not mark.exists()
    torch.load(file, weights_only=False)  # the test's own trap works
    assert mark.exists()
