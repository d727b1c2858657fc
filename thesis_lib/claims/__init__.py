"""The ledger of the chapters that have not moved into :mod:`thesis_lib.edition`'s form yet."""

from thesis_lib.edition.ledger import Claim, Difference, Finding, Tables, Verdict, verdicts

__all__ = ["Claim", "Difference", "Finding", "Tables", "Verdict", "verdicts"]
