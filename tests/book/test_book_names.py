"""Names of the package that prose mentions."""

import pytest

from thesis_lib.book.names import exists


@pytest.mark.parametrize(
    ("name", "known"),
    [
        ("thesis_lib", True),
        ("thesis_lib.mdp.model", True),
        ("thesis_lib.mdp.model.TabularMDP", True),
        ("thesis_lib.edition.page.Page.run", True),
        ("thesis_lib.edition.page.Page.budget", True),  # a field without a default
        ("thesis_lib.edition.page.Page.budget.upper", False),
        ("thesis_lib.mdp.model.NoSuchThing", False),
        ("thesis_lib.no_such_module", False),
        ("numpy.array", False),
    ],
)
def test_exists(name: str, known: bool) -> None:
    assert exists(name) is known
