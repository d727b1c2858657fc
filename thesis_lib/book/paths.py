"""Where the book's sources lie and where its build goes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from thesis_lib.checkout import repository_root


@dataclass(frozen=True)
class Paths:
    """Folders of one checkout at one budget; everything built lies under ``_build``.

    Attributes
    ----------
    root
        The checkout.
    budget
        Builds at different budgets do not touch each other.
    draft
        Whether only some notebooks are brought up to date; a draft leaves the book alone.
    """

    root: Path
    budget: str
    draft: bool = False

    @classmethod
    def of(cls, budget: str, root: Path | None = None, *, draft: bool = False) -> Paths:
        """Paths of this checkout.

        Raises
        ------
        ValueError
            If there is no book there, as when the library was installed without its checkout.
        """
        root = repository_root() if root is None else root
        if not (root / "_config.yml").exists():
            raise ValueError(
                f"there is no book in {str(root)!r}: run this in a checkout of the repository, "
                "where _config.yml lies."
            )
        return cls(root, budget, draft)

    @property
    def notebooks(self) -> Path:
        """Notebook sources."""
        return self.root / "notebooks"

    @property
    def build(self) -> Path:
        """Everything that is built."""
        return self.root / "_build"

    @property
    def executed(self) -> Path:
        """One folder a notebook: outputs, tables, manifest."""
        return self.build / "executed" / self.budget

    @property
    def results(self) -> Path:
        """Tables the ledger judges."""
        return self.build / "results" / self.budget

    @property
    def source(self) -> Path:
        """The staged book, as Sphinx reads it."""
        return self.build / "src" / self._edition

    @property
    def doctrees(self) -> Path:
        """Sphinx's own cache."""
        return self.build / "doctrees" / self._edition

    @property
    def html(self) -> Path:
        """The built book; the shipped one has the plain name."""
        return self.build / ("html" if self._edition == "book" else f"html-{self._edition}")

    @property
    def reports(self) -> Path:
        """Logs and partial outputs of notebooks that failed."""
        return self.build / "reports" / self.budget

    @property
    def _edition(self) -> str:
        return "draft" if self.draft else self.budget
