"""Claims of chapter 4, and where this edition differs from it."""

from thesis_lib.claims import Claim, Difference

CLAIMS: tuple[Claim, ...] = ()
DIFFERENCES: tuple[Difference, ...] = ()
