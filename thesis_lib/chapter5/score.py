"""The tests of sections 5.3 and 5.4: the robustness score and the perturbations."""

from __future__ import annotations

import dataclasses
import inspect
import re

import pandas as pd

from thesis_lib import published
from thesis_lib.edition.criteria import exact
from thesis_lib.edition.ledger import Finding, criterion, effect_of
from thesis_lib.robustness import score
from thesis_lib.training.disturbances import known_perturbations


@criterion("5.3-score-range")
def score_range() -> Finding:
    """A controller that runs backwards under the perturbation, and one that does so always."""
    turned, backward = score(100, -50, best=100), score(-50, -50, best=100)
    evidence = (
        "Returns can be negative. With a best return of 100, base return 100 and perturbed return "
        f"-50 score {turned:.2f}, and -50 twice scores {backward:.2f}; for returns from 0 to the "
        "best the score is indeed in [0, 1]."
    )
    inside = min(turned, backward) >= 0 and max(turned, backward) <= 1
    return exact(bool(inside), evidence)


@criterion("5.3-score-one")
def score_of_the_best() -> Finding:
    """The score is 1 exactly when both returns are the best."""
    both = score(100, 100, best=100)
    least_loss = [score(b, p, best=100) for b, p in ((99.9, 100), (100, 99.9), (99.9, 99.9))]
    return exact(
        bool(both == 1 and max(least_loss) < 1),
        "With base and perturbed return both the best on the pair the score is "
        f"{both:.3g}; a thousandth less in either or both gives at most {max(least_loss):.4f}.",
    )


@criterion("5.3-score-others")
def score_depends_on_others() -> Finding:
    """One controller, two competitors."""
    alone, beside = score(80, 60, best=80), score(80, 60, best=200)
    return exact(
        alone != beside,
        f"Returns of 80 and 60 score {alone:.2f} if 80 is the best return and {beside:.2f} if "
        "another controller reaches 200.",
    )


@criterion("5.3-self-scoring")
def self_scoring() -> Finding:
    """A poor but steady controller, scored by its own best return and by another's."""
    own, other = score(1, 1, best=1), score(1, 1, best=1000)
    return exact(
        bool(own == 1 and other < 0.01),
        f"Returns of 1 and 1 score {own:.3g} by the controller's own best and {other:.3g} beside a "
        "best of 1000.",
    )


@criterion("5.3-slowing")
def slowing_beats_turning() -> Finding:
    """Half speed, standing or turning aside, and going back, after a good base run."""
    slow, aside, back = (score(100, p, best=100) for p in (50, 0, -50))
    return exact(
        bool(slow > aside > back),
        f"After a base return of 100, half the speed on the hills scores {slow:.2f}, moving at "
        f"right angles {aside:.2f} and moving back {back:.2f}.",
    )


@effect_of("5.1-regular-test")
def swimmer_after_hills() -> str:
    """Printed returns of swimmers trained on hills, in the regular test and after the switch."""
    spans = []
    for name in ("table-c.1", "table-c.3"):
        printed = published.load(name)
        own = printed[(printed.task == "swimmer") & (printed.trained_on == "hill")].value
        spans.append(f"{own.min():.0f} to {own.max():.0f}")
    return (
        f"The printed swimmers trained on hills earn {spans[0]} in this test and {spans[1]} where "
        "hills come after the switch."
    )


OF_THE_THESIS = ("WhiteNoise", "TerrainSwitch", "SensorSubset")
"""Its two tests, and the sensors it takes from some networks."""


def perturbation_table() -> pd.DataFrame:
    """Every perturbation with the first sentence of its description, the thesis's first."""
    kinds = known_perturbations()
    order = [*OF_THE_THESIS, *(name for name in kinds if name not in OF_THE_THESIS)]
    return pd.DataFrame(
        {
            "object": name,
            "what it does": re.sub(
                r":\w+:(?=`)", "", str(inspect.getdoc(kinds[name])).split("\n\n")[0]
            ),
            "settings": ", ".join(f.name for f in dataclasses.fields(kinds[name])),  # type: ignore[arg-type]
        }
        for name in order
    )
