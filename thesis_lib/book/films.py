"""The book's films of gaits: made once from committed policies, and shown with a still.

``python -m thesis_lib.book.films`` makes all that ``book/films.toml`` names, or those given.
"""

from __future__ import annotations

import dataclasses
import html
import sys
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

from thesis_lib.checkout import repository_root
from thesis_lib.files import replacing

if TYPE_CHECKING:
    from thesis_lib.training.trained import Trained

LISTED = Path("book", "films.toml")
"""What the films show, in the checkout."""

FOLDER = Path("book", "_static", "films")
"""Where they are: NAME.mp4, and its still NAME.jpg."""

WIDTH, HEIGHT = 640, 360
"""Pixels of a film of one robot; two beside each other have three quarters each."""

UNTRAINED = "untrained "
"""Before the name of a run, asks for its policy before training."""


@dataclass(frozen=True)
class Film:
    """A film.

    Attributes
    ----------
    name
        Of its files.
    robot
        Under whose heading it stands.
    caption
        A sentence.
    runs
        Runs of ``policies``, side by side; after :data:`UNTRAINED`, before training.
    run
        Which run of the test is shown.
    seconds
        Its length.
    noise, switch_at
        As of :class:`~thesis_lib.training.disturbances.Disturbances`.
    policies
        File of the runs, in the checkout.
    """

    name: str
    robot: str
    caption: str
    runs: tuple[str, ...]
    run: int = 0
    seconds: float = 10.0
    noise: float | None = None
    switch_at: str | None = None
    policies: str = "results/trained/policies.pt"


def listed(root: Path) -> list[Film]:
    """The films that ``book/films.toml`` names."""
    rows = tomllib.loads((root / LISTED).read_text(encoding="utf-8"))["film"]
    return [Film(**{**row, "runs": tuple(row["runs"])}) for row in rows]


def make(film: Film, root: Path) -> Path:
    """Draw a film and its still; the same policies give the same pictures."""
    import numpy as np
    from PIL import Image

    from thesis_lib.training.disturbances import Disturbances
    from thesis_lib.training.evaluation import EvaluateConfig
    from thesis_lib.training.film import pictures, write_film
    from thesis_lib.training.parts import make_run_task

    shrink = 1.0 if len(film.runs) == 1 else 0.75
    size = {"width": round(WIDTH * shrink), "height": round(HEIGHT * shrink)}
    panels, rate = [], 0
    for name in film.runs:
        trained = _policy(name, root / film.policies)
        steps = round(film.seconds / make_run_task(trained.config).robot.control_dt)
        config = EvaluateConfig(runs=film.run + 1, steps=steps, termination="never")
        config = config.disturbed(Disturbances(noise=film.noise, switch_at=film.switch_at, onset=0))
        drawn, rate = pictures(trained, config, run=film.run, **size)
        panels.append(np.stack(drawn))
    whole = np.concatenate(panels, axis=2)
    target = root / FOLDER / f"{film.name}.mp4"
    write_film(list(whole), rate, target)
    with replacing(target.with_suffix(".jpg")) as temporary:
        Image.fromarray(whole[len(whole) // 3]).save(temporary, format="JPEG", quality=80)
    return target


def _policy(name: str, policies: Path) -> Trained:
    """A committed policy, or the one that its training began with."""
    from thesis_lib.training.parts import make_run_policy
    from thesis_lib.training.trained import TrainedPolicies

    trained = TrainedPolicies(policies).load(name.removeprefix(UNTRAINED))
    if not name.startswith(UNTRAINED):
        return trained
    return dataclasses.replace(trained, policy=make_run_policy(trained.config), iteration=0)


def films_markdown(films: Iterable[Film]) -> str:
    """Body of the page *Films*, a heading a robot, as MyST Markdown."""
    parts = []
    for robot, own in groupby(films, key=lambda film: film.robot):
        parts += [f"## {robot}", *map(film_markdown, own)]
    return "\n\n".join(parts) + "\n"


def film_markdown(film: Film, *, moving: bool = False) -> str:
    """A film with controls and its still, for a page in ``book/``; a print shows the still.

    One that is ``moving`` plays by itself, unless its reader asked for stillness.
    """
    source, words = f"../_static/films/{film.name}", html.escape(film.caption)
    return f"""```{{raw}} html
<figure class="film{" moving" * moving}">
<video controls muted loop playsinline preload="none" poster="{source}.jpg" aria-label="{words}">
<source src="{source}.mp4" type="video/mp4">
</video>
<figcaption>{words}</figcaption>
</figure>
```"""


def main(names: Sequence[str]) -> None:
    """Make the films of these names, all without any; SystemExit tells of one there is not."""
    checkout = repository_root()
    films = {film.name: film for film in listed(checkout)}
    for name in names:
        if name not in films:
            sys.exit(f"there is no film {name!r}: choose among {', '.join(films)}.")
    for name in names or films:
        made = make(films[name], checkout)
        print(f"{made}: {made.stat().st_size / 1e3:.0f} kB", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
