"""Every number that the thesis's tables print, as data.

One CSV file a table, one row a cell of it.  Nothing is corrected: a cell that the
thesis contradicts elsewhere, or that our text of it may have misread, says so in
``note``.  What our text of the thesis lost, the bold type of Table 5.2, is not here.

>>> from thesis_lib.published import load
>>> load("table-3.1").query("algorithm == 'sarsa' and sensor").value.tolist()
[nan, -3.96, -3.67, -3.37]
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from types import MappingProxyType

import pandas as pd

from thesis_lib.checks import one_of

TABLES: Mapping[str, str] = MappingProxyType(
    {
        "table-3.1": "Total reward on the cliff domain, by potential, algorithm and sensor",
        "table-5.1": "Step sizes delta_KL; in the caption the ESN's spectral radius and density",
        "table-5.2": "Mean return per learning iteration, up to the 500th",
        "table-5.3": "1000-step return of the fixed weights, unperturbed",
        "table-5.6": "Interval of the improvement ratio by hill training (captioned Figure 5.6)",
        "table-c.1": "1000-step return of the fixed weights, unperturbed (Table 5.3 once more)",
        "table-c.2": "1000-step return of the fixed weights under sensor noise",
        "table-c.3": "1000-step return of the fixed weights under the switch to hills",
    }
)
"""The tables held here and what each one prints.

:meta hide-value:
"""

TASKS: Mapping[str, str] = MappingProxyType(
    {
        "Ant": "ant",
        "HalfCheetah": "half_cheetah",
        "Hopper": "hopper",
        "Swimmer": "swimmer",
        "Walker2d": "walker",
    }
)
"""What the column ``task`` calls each robot.

:meta hide-value:
"""

_NUMBERS = ("value", "standard_error", "ci95", "low", "high")


def load(table: str) -> pd.DataFrame:
    """Load the numbers that one table of the thesis prints.

    Parameters
    ----------
    table
        Id of the table, one of :data:`TABLES`, such as ``"table-3.1"``.

    Returns
    -------
    pandas.DataFrame
        One row a printed cell, in the order of the thesis.  Columns:

        - ``table``, ``panel``, ``row``, ``column``: where the cell stands, labels as
          printed (``panel`` is empty where the table has one part only, and
          ``"caption"`` for a number that only the caption gives);
        - keys to join on: ``potential``, ``algorithm``, ``sensor`` (Table 3.1); ``task``,
          ``architecture``, ``quantity`` (5.1); ``task``, ``trained_on``, ``architecture``
          (5.2, 5.3, C.1 to C.3); ``perturbation``, ``architecture`` (5.6);
        - ``value``: the number, in ``unit``; NaN where only an interval is printed or
          the cell is empty;
        - ``standard_error``; ``ci95``, the half-width of a 95% interval; ``low`` and
          ``high``, the ends of a 95% interval: whichever is printed, else NaN;
        - ``unit``, and ``note``: known contradictions and doubtful readings.

    Raises
    ------
    ValueError
        When there is no such table.
    """
    one_of("published table", table, TABLES)
    with (files(__name__) / f"{table}.csv").open(encoding="utf-8") as file:
        frame = pd.read_csv(
            file,
            dtype=dict.fromkeys(_NUMBERS, float),
            keep_default_na=False,
            na_values={number: [""] for number in _NUMBERS},
        )
    if "sensor" in frame:
        frame["sensor"] = frame["sensor"].astype(bool)
    return frame
