"""Claims of appendix_a, and where this edition differs from it."""

from thesis_lib.claims import Claim, Difference

CLAIMS: tuple[Claim, ...] = ()
DIFFERENCES: tuple[Difference, ...] = ()
