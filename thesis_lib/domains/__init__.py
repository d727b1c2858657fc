"""The domains of chapters 3 and 4 and appendix A, each a :class:`Domain`."""

from thesis_lib.domains.cliff import continuing_cliff, episodic_cliff
from thesis_lib.domains.domain import Domain

__all__ = ["Domain", "continuing_cliff", "episodic_cliff"]
