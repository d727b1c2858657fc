r"""Feature selection with k-relevance (chapter 4, sections 4.2 and 4.3)."""

from thesis_lib.selection.base import BackwardElimination, Check, Round, Selector
from thesis_lib.selection.baselines import (
    ExactRelevance,
    FixedFeatures,
    NoSelection,
    RandomSelection,
)
from thesis_lib.selection.fitting import (
    ExponentialFit,
    fit_exponential,
    fit_inverse,
    fstek_threshold,
    triangle_alpha,
)
from thesis_lib.selection.flips import SignFlips
from thesis_lib.selection.fstek import FSTEK, IBKR, bkr, fr
from thesis_lib.selection.functions import FunctionSelector, LinearF, NetworkF
from thesis_lib.selection.jackknife import JackknifeF, f_threshold
from thesis_lib.selection.prediction import LeaveOneTaskOut, Shrinkage, left_out
from thesis_lib.selection.roc import rates
from thesis_lib.selection.task import TaskRelevance, task_explained, unseen_share

__all__ = [
    "FSTEK",
    "IBKR",
    "BackwardElimination",
    "Check",
    "ExactRelevance",
    "ExponentialFit",
    "FixedFeatures",
    "FunctionSelector",
    "JackknifeF",
    "LeaveOneTaskOut",
    "LinearF",
    "NetworkF",
    "NoSelection",
    "RandomSelection",
    "Round",
    "Selector",
    "Shrinkage",
    "SignFlips",
    "TaskRelevance",
    "bkr",
    "f_threshold",
    "fit_exponential",
    "fit_inverse",
    "fr",
    "fstek_threshold",
    "left_out",
    "rates",
    "task_explained",
    "triangle_alpha",
    "unseen_share",
]
