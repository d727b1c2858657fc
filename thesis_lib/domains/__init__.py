"""The domains of chapters 3 and 4 and appendix A, each a :class:`Domain`."""

from thesis_lib.domains.appendix_a import figure_a1, figure_a2, figure_a3
from thesis_lib.domains.cliff import continuing_cliff, episodic_cliff
from thesis_lib.domains.domain import Domain
from thesis_lib.domains.stock import StockMDP, stock
from thesis_lib.domains.triangle import triangle

__all__ = [
    "Domain",
    "StockMDP",
    "continuing_cliff",
    "episodic_cliff",
    "figure_a1",
    "figure_a2",
    "figure_a3",
    "stock",
    "triangle",
]
