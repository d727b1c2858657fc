"""The shapes of criteria: each can hold, fail and say so."""

import pytest

from thesis_lib.edition.criteria import (
    Pair,
    differ_but_one,
    equivalent,
    near_printed,
    no_greater,
    ordered,
    positive,
    share_at_least,
    within,
)
from thesis_lib.edition.ledger import Verdict
from thesis_lib.edition.words import number, plain, plus_minus, probability, several, span
from thesis_lib.stats import Summary


def pair(first, second, sd=1.0, n=100):
    return Pair(Summary(first, sd, n), Summary(second, sd, n), ("one", "other"), "here")


@pytest.mark.parametrize(
    ("pairs", "verdict", "told"),
    [
        ([pair(3, 1), pair(2, 0)], Verdict.REPRODUCED, "Both comparisons are significantly so"),
        ([pair(3, 1), pair(0, 2)], Verdict.REFUTED, "1 is significantly the other way"),
        ([pair(3, 1), pair(1.01, 1)], Verdict.DIRECTION, "but only 1 is significantly so"),
        ([pair(1.1, 1)] * 3, Verdict.DIRECTION, "All 3 comparisons are the way stated, but none"),
        ([pair(1.1, 1)], Verdict.DIRECTION, "The one comparison is the way stated, but is not"),
        ([pair(3, 1), pair(0.99, 1)], Verdict.INCONCLUSIVE, "Of 2 comparisons 1 is the way"),
        ([pair(1, 1)], Verdict.INCONCLUSIVE, "The one comparison is not the way stated"),
    ],
)
def test_ordered(pairs, verdict, told):
    found = ordered(pairs)
    assert found.verdict is verdict
    assert told in found.evidence
    assert "here: one " in found.evidence


def test_ordered_corrects_for_many_comparisons():
    # Difference .3 of standard error .1414: p = .035, which two comparisons make .07.
    assert ordered([pair(1.3, 1)]).verdict is Verdict.REPRODUCED
    assert ordered([pair(1.3, 1), pair(1.3, 1)]).verdict is Verdict.DIRECTION


def test_every_pair_keeps_its_number():
    def of(second, where="", by=1.0):
        own = pair(by, 0)
        return Pair(own.first, own.second, ("one", second), where)

    same_place = ordered([of("two", "here"), of("three", "here", 2.0)])
    assert same_place.numbers == {"here: one over two": 1.0, "here: one over three": 2.0}
    no_place = ordered([of("two"), of("three", by=2.0)])
    assert no_place.numbers == {"one over two": 1.0, "one over three": 2.0}
    assert ordered([of("two", "here"), of("two", "there")]).numbers.keys() == {"here", "there"}


def test_equivalent():
    assert equivalent([pair(10, 10)], 0.1).verdict is Verdict.REPRODUCED
    assert equivalent([pair(12, 10)], 0.1).verdict is Verdict.REFUTED
    assert equivalent([pair(12, 10)], 0.1, refutable=False).verdict is Verdict.INCONCLUSIVE
    assert equivalent([pair(10, 10, sd=20, n=5)], 0.1).verdict is Verdict.INCONCLUSIVE


def test_evidence_counts_as_a_person_would():
    one = equivalent([pair(10, 10)], 0.1).evidence
    assert one.startswith(
        "The one comparison is equivalent within 10% (two one-sided tests) and is not"
    )
    three = no_greater([pair(9, 10)] * 2 + [pair(12, 10)], 0.1).evidence
    assert three.startswith("Of 3 comparisons 2 are shown to be greater by at most 10%")
    assert "and 1 is significantly greater" in three
    assert "in both." in share_at_least({"a": True, "b": True}, 0.5, "Held").evidence
    assert "in none of 2." in share_at_least({"a": False, "b": False}, 0.5, "Held").evidence


def test_equivalence_tells_its_power():
    # Standard error 1 and a margin of 1: z = 1 - 1.645 < 0, so it can never be found.
    assert equivalent([pair(10, 10, sd=7.071, n=100)], 0.1).numbers["power"] == 0.0
    assert equivalent([pair(10, 10)], 0.1).numbers["power"] > 0.99


@pytest.mark.parametrize(
    ("first", "verdict"),
    [(10.0, Verdict.REPRODUCED), (9.0, Verdict.REPRODUCED), (10.9, Verdict.REFUTED)],
)
def test_no_greater(first, verdict):
    assert no_greater([pair(first, 10.0)], 0.1).verdict is verdict


def test_no_greater_counts_the_choices_there_were():
    # Difference .3 of standard error .1414: p = .035.
    assert no_greater([pair(10.3, 10)], 0.1).verdict is Verdict.REFUTED
    assert no_greater([pair(10.3, 10)], 0.1, choices=2).verdict is Verdict.REPRODUCED


def test_no_greater_needs_enough_runs_and_tells_its_power():
    assert no_greater([pair(10, 10, sd=20, n=5)], 0.1).verdict is Verdict.INCONCLUSIVE
    # Standard error 1 and a margin of 1, at which a one-sided test of 5% needs 1.65 of them (t):
    # below -.65, .26.
    evidence = no_greater([pair(10, 10, sd=7.071, n=100)], 0.1).evidence
    assert "without any difference each would be shown in at least 26% of samples)" in evidence


@pytest.mark.parametrize(
    ("contrasts", "verdict"),
    [
        ({"a": (3.0, 1.0), "b": (4.0, 1.0)}, Verdict.REPRODUCED),
        ({"a": (3.0, 1.0), "b": (0.5, 1.0)}, Verdict.DIRECTION),
        ({"a": (3.0, 1.0), "b": (-0.5, 1.0)}, Verdict.INCONCLUSIVE),
        ({"a": (3.0, 1.0), "b": (-4.0, 1.0)}, Verdict.REFUTED),
        ({"a": (2.0, 1.0)}, Verdict.REPRODUCED),  # p = .046
        ({"a": (2.0, 1.0), "b": (2.0, 1.0)}, Verdict.DIRECTION),  # twice that
    ],
)
def test_positive(contrasts, verdict):
    assert positive(contrasts, "Gains").verdict is verdict


@pytest.mark.parametrize(
    ("apart", "alike", "verdict"),
    [
        (pair(15, 10), pair(10, 10), Verdict.REPRODUCED),
        (pair(10, 10), pair(10, 10), Verdict.REFUTED),  # one said to differ is alike
        (pair(15, 10), pair(12, 10), Verdict.REFUTED),  # the one said to be alike differs
        (pair(15, 10), pair(10, 10, sd=20, n=5), Verdict.INCONCLUSIVE),
    ],
)
def test_differ_but_one(apart, alike, verdict):
    assert differ_but_one([apart], alike).verdict is verdict


def test_near_printed_by_hand():
    # Gaps of 1 and 2 over a common error of 5 = hypot(3, 4).
    found = near_printed([1, 2], [3, 3], [0, 0], [4, 4])
    assert found.verdict is Verdict.REPRODUCED
    assert found.numbers["chi_square"] == pytest.approx((1 + 4) / 25)
    assert near_printed([100], [3], [0], [4]).verdict is Verdict.NOT_REPRODUCED
    # Chi-square 6.25 twice over: 12.5 on 2 degrees of freedom (p = .002), as on 1 (p = .0004).
    fitted = near_printed([12.5, 12.5], [3, 3], [0, 0], [4, 4], fitted=1)
    assert fitted.numbers["p"] == pytest.approx(0.000407, abs=1e-6)


def test_within():
    assert within({"a": 1.0, "b": 2.0}, 0, 2, "Exact").verdict is Verdict.REPRODUCED
    found = within({"a": 1.0, "b": 2.5}, 0, 2, "Exact")
    assert found.verdict is Verdict.NOT_REPRODUCED
    assert found.evidence == "Exact: 1 (a) and 2.5 (b); 1 is between 0 and 2."


def test_share_at_least():
    held = {"a": True, "b": False, "c": False}
    assert share_at_least(held, 1 / 3, "It holds").verdict is Verdict.REPRODUCED
    found = share_at_least(held, 0.5, "It holds")
    assert found.verdict is Verdict.NOT_REPRODUCED
    assert found.evidence == "It holds in 1 of 3 (a)."
    assert share_at_least(held, 0.5, "It holds", direction=True).verdict is Verdict.DIRECTION
    none = share_at_least(dict.fromkeys(held, False), 0.5, "It holds", direction=True)
    assert none.verdict is Verdict.NOT_REPRODUCED
    assert none.evidence == "It holds in none of 3."


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (number(-4.5512, 0.043), "−4.551"),
        (number(18840.3), "18,800"),
        (number(18840.3, 120.0), "18,840"),
        (number(0.000012), "0.000012"),
        (number(1.0, 0.1, sign=True), "+1.00"),
        (number(-0.001, 0.5), "0.00"),
        (plus_minus(1.234, 0.056), "1.234 ± 0.056"),
        (span(-1.234, 3.2), "−1.2 to 3.2"),
        (probability(0.00012), "p < 0.001"),
        (probability(0.0345), "p = 0.035"),
        (probability(0.2), "p = 0.20"),
        (several(["a"]), "a"),
        (several(["a", "b", "c"]), "a, b and c"),
    ],
)
def test_numbers_in_words(text, expected):
    assert text == expected


@pytest.mark.parametrize(
    ("machine", "person"),
    [
        (
            "differ by 2.5e-13 or 3e+04, at most 1e-09, 0e+00",
            "2.5 × 10⁻¹³ or 3 × 10⁴, at most 10⁻⁹, 0",
        ),
        (
            "commit 26e5f1, feature s1e1, `--step 1e-5`",
            "commit 26e5f1, feature s1e1, `--step 1e-5`",
        ),
        ("after_next, $a_b$, {math}`x_yes` and Q_d", "after next, $a_b$, {math}`x_yes` and Q_d"),
        ("k^2 |rho_k - rho_inf| from -0.00 to -0.01", "k² |ρₖ − ρ∞| from 0.00 to −0.01"),
        ("gamma 0.9 at alpha = .1, 2026-11-29 (-3)", "γ 0.9 at α = .1, 2026-11-29 (−3)"),
        ("max(delta, epsilon), kappa = .8; by-alpha, `mu`", "max(δ, ε), κ = .8; by-alpha, `mu`"),
        ("(k-1)/(k+1), b - U on 4 x 4", "(k − 1)/(k + 1), b − U on 4 × 4"),
        ("-0.00000175 of 10.000001 and 0.001", "−1.75 × 10⁻⁶ of 10.000001 and 0.001"),
        ("with the 1 tasks as the unit p = nan.", "with the one task as the unit p not defined."),
    ],
)
def test_what_a_program_writes_becomes_what_a_person_would(machine, person):
    assert plain(machine).removeprefix("differ by ") == person
