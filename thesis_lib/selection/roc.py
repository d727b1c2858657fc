r"""Points in ROC space (section 4.3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def rates(support: ArrayLike, truth: ArrayLike) -> tuple[float, float]:
    """False and true positive rate of a selection.

    Parameters
    ----------
    support
        Which features were kept, shape ``(..., F)``; leading axes are runs.
    truth
        Which features are domain relevant, shape ``(F,)``.

    Returns
    -------
    tuple of float
        Share of the irrelevant features kept and share of the relevant features kept,
        over all runs; NaN where there is no such feature.

    Notes
    -----
    Source: section 4.3, figure 4.3 (right).
    """
    kept = np.asarray(support, dtype=bool)
    relevant = np.asarray(truth, dtype=bool)
    if relevant.ndim != 1 or kept.shape[-1:] != relevant.shape:
        raise ValueError(
            f"support has shape {kept.shape} and truth {relevant.shape}, but truth is one bool a "
            "feature and support has the features on its last axis."
        )
    false = float(kept[..., ~relevant].mean()) if not relevant.all() else float("nan")
    true = float(kept[..., relevant].mean()) if relevant.any() else float("nan")
    return false, true
