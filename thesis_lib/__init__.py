"""The living edition of M. Snel, *Generalization Strategies in Reinforcement Learning* (2018).

The package is laid out as the thesis is: :mod:`thesis_lib.mdp` (chapter 2),
:mod:`thesis_lib.domains` and :mod:`thesis_lib.potentials` (chapter 3),
:mod:`thesis_lib.relevance` and :mod:`thesis_lib.selection` (chapter 4),
:mod:`thesis_lib.locomotion`, :mod:`thesis_lib.policies` and
:mod:`thesis_lib.optimisation` (chapter 5).  Imports run one way, from those to
:mod:`thesis_lib.edition` and on to the chapters, the book and the command line.

Importing the package enters its environments in Gymnasium's registry, see
:mod:`thesis_lib.registration`.
"""

import time

__version__ = "0.1.0"

IMPORTED = time.time()
"""When this process began to load the library: what changes later is not what it runs."""

from thesis_lib.registration import register  # noqa: E402  (the clock starts first)

register()
