"""Readings of chapter 5's learning (sections 2.3.4, 2.3.5 and 5.4); rows of *Differences*.

What the text leaves open is taken from the author's published code, and from what he and
Duan et al. are known to have run.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from thesis_lib.claims import Claim, Difference, Tables
from thesis_lib.edition.saved import saved
from thesis_lib.policies.factory import recurrent_units
from thesis_lib.training.curves import compared

CLAIMS: tuple[Claim, ...] = ()


def measured(net: str, variant: str, root: Path | None = None) -> str:
    """What an option changes in the mean return over the learning curve, as a sentence.

    Parameters
    ----------
    net
        Name of the network; its runs are the committed result ``options/NET/curves``.
    variant
        The option, such as ``bootstrap=True``.
    root
        The checkout; default the one this library runs from.
    """
    return _told(f"options/{net}/curves", "variant", variant, root)


def _told(name: str, column: str, changed: str, root: Path | None = None) -> str:
    """One comparison of a committed sweep, as a sentence."""
    try:
        result = saved(name, root)
    except FileNotFoundError:
        return "Not measured yet."
    table = compared(result.table, column)
    found = table[table.changed == changed]
    if found.empty:
        return "Not measured yet."
    row, budget = found.iloc[0], result.provenance["config"]
    many = f", {row.p_holm:.2g} after Holm for the {len(table)} options tried"
    return (
        f"Measured with `{changed}` for the {row.architecture.upper()} on {row.task}: over "
        f"{budget['iterations']} iterations of {budget['batch_steps']:,} steps the mean return is "
        f"{_whole(row.mean_changed)} instead of {_whole(row.mean_reference)}, a difference of "
        f"{_whole(row.difference)} (95% interval {_whole(row.low)} to {_whole(row.high)}, "
        f"{row.n} seeds in pairs; t-test p = {row.p_difference:.2g}"
        f"{many if len(table) > 1 else ''})."
    )


def _whole(value: float) -> str:
    return f"{value:.0f}".replace("-", "−")


def _with_measurement(sentence: str, net: str, variant: str) -> Callable[[Tables], str]:
    """An effect: what is known, then what was measured."""
    return lambda tables: f"{sentence} {measured(net, variant)}"


DIFFERENCES = (
    Difference(
        "5.4-batch",
        "5.4",
        "Steps of an iteration",
        "Not stated.",
        "50,000, in episodes of at most 500 steps, which Duan et al. used. The returns of table "
        "5.2 fit episodes of that length: the swimmer earns about half of what it earns in tests "
        "of 1000 steps.",
        "`TrainConfig(batch_steps=, horizon=)`",
        "The default of the author's library is 5000 steps, whose gradients are about three times "
        "as noisy. Smaller batches also put fewer steps into the same number of iterations.",
    ),
    Difference(
        "5.4-batch-rule",
        "Algorithms 5 and 6",
        "Which episodes make a batch",
        '"Collect a set of trajectories".',
        "Whole episodes, in the order in which they start, until their lengths add up to the steps "
        "asked for; what was begun after the last of them is thrown away. Many worlds then give "
        "the batch that a single world sampled by the author's rule would give.",
        "`thesis_lib.optimisation.collect`",
        "Taking the episodes that finish first, as parallel samplers do, prefers short ones, which "
        "on the hopper and the walker are the bad ones.",
    ),
    Difference(
        "5.4-iterations",
        "5.4",
        "Number of iterations",
        "1000 (Swimmer 500); table 5.2 averages the first 500.",
        "500 by default, what table 5.2 needs; a run can be made longer afterwards.",
        "`TrainConfig(iterations=)`",
        "The tests of tables 5.3 and C.1 to C.3 followed 1000 iterations (Swimmer 500).",
    ),
    Difference(
        "5.4-best-policy",
        "5.4",
        "Which policy is tested",
        '"The best learned policy for each architecture"; best by what measure, and whether over '
        "runs or over iterations, is not said.",
        "The policy after the last iteration of a run; its checkpoint is the one that is kept.",
        "`thesis evaluate CHECKPOINT`",
        "Choosing the best of several runs raises the returns of tests, most for the networks "
        "whose runs differ most.",
    ),
    Difference(
        "2.3.4-discount",
        "2.3.4",
        "Discount and advantage estimate",
        "gamma and the estimate of equation 2.12; the number is not stated for chapter 5.",
        "gamma is 0.99 (Duan et al.); the estimate is equation 2.12, the case lambda = 1 of "
        "generalised advantage estimation and the default of the author's library.",
        "`TrainConfig(discount=, trace=)`",
        _with_measurement(
            "A lambda below 1 trades variance for the bias of a linear baseline.",
            "dtrnn",
            "trace=0.97",
        ),
    ),
    Difference(
        "2.3.4-bootstrap",
        "2.3.4",
        "Episodes cut by the time limit",
        "Not stated.",
        "What follows the last step counts as 0, as in the author's code, even where only the "
        "limit ended the episode; crediting the cut with the baseline is an option.",
        "`TrainConfig(bootstrap=)`",
        _with_measurement(
            "Returns near the limit look smaller than they are. The baseline has the time among "
            "its features and takes up most of it.",
            "dtrnn",
            "bootstrap=True",
        ),
    ),
    Difference(
        "2.3.4-baseline",
        "2.3.4",
        "The baseline",
        "Any function of the state, fitted by regression.",
        "Linear in the observation the policy sees (clipped to ±10), its squares, three powers of "
        "the time and 1, with a ridge of 1e-5: Duan et al.'s, and the author's code's.",
        "`LinearBaseline(ridge=)`, `TrainConfig(baseline='linear' | 'network')`",
        "A recurrent network's baseline does not see what the network remembers, nor the sensors "
        "that the network is spared on the hopper and the swimmer.",
    ),
    Difference(
        "2.3.4-standardised",
        "2.3.4",
        "Scale of the advantages",
        "As in equation 2.12.",
        "Shifted and scaled to mean 0 and standard deviation 1 over the batch, as in the author's "
        "code.",
        "`Learner(standardise=)`",
        "Nothing for the length of a TRPO step, which the divergence decides; for algorithm 5 it "
        "makes one learning rate fit tasks with rewards of different sizes.",
    ),
    Difference(
        "2.3.5-averages",
        "2.3.5",
        "What averages are over",
        "Sums over the steps of a trajectory, averaged over trajectories (equations 2.13 and "
        "2.14).",
        "Averages over all steps of the batch for the surrogate, the divergence and the Fisher "
        "matrix, as in the author's code. Algorithm 5 by itself follows equation 2.13.",
        "`VPG(average='trajectories' | 'steps')`",
        "Nothing for TRPO's direction. The bound holds for a step's mean divergence, not for that "
        "of a whole trajectory, which is hundreds of times larger.",
    ),
    Difference(
        "2.3.5-damping",
        "2.3.5",
        "Conjugate gradient",
        "Conjugate gradient with Hessian-vector products.",
        "10 steps, exact products, and 1e-5 times the identity added to the Fisher matrix: the "
        "defaults of the author's library. Its finite-difference products, which the LSTM's runs "
        "must have used, are not offered.",
        "`TrainConfig(cg_iterations=, damping=)`",
        _with_measurement(
            "10 steps leave a residual, which every learning curve records (column `residual`); "
            "the line search makes the step safe all the same.",
            "dtrnn",
            "damping=0.1",
        ),
    ),
    Difference(
        "5.4-kl-with-clamp",
        "5.2.2",
        "The clamp on time constants and the line search",
        "Time constants are raised to the simulation step after the update.",
        "The same, inside the line search: each candidate is raised before its surrogate and its "
        "divergence are measured, as the author's code does by clamping whenever parameters are "
        "set.",
        "`CTRNN.project_`",
        "The bound on the divergence holds for the network as it is after the clamp.",
    ),
    Difference(
        "5.4-deviation-floor",
        "5.4",
        "Smallest standard deviation",
        "Not stated.",
        "1e-6 for feedforward networks and none for recurrent ones, as in the author's code; the "
        "standard deviation starts at 1 and does not depend on the state.",
        "`make_policy(..., min_log_std=)`, `TrainConfig(initial_log_std=)`",
        "With step sizes of 0.3 to 0.5 the deviation of a recurrent network may collapse; every "
        "learning curve records the entropy.",
    ),
    Difference(
        "5.4-dffwd-layers",
        "5.4",
        "Transfer functions of DFFWD",
        "The network of Duan et al. (100, 50 and 25 units).",
        "tanh on all three layers, as in the code that Duan et al. published.",
        "`FeedforwardPolicy(activation=)`",
        "Duan et al.'s text has tanh on the first two layers only. A linear third layer could do "
        "nothing that the linear output cannot do by itself.",
    ),
    Difference(
        "5.4-initial-weights",
        "5.4",
        "Initial weights",
        "Not stated.",
        "Glorot-uniform ones for feedforward networks, the output layer's too, as in the author's "
        "code. Orthogonal ones, and a smaller output layer for any network, are options.",
        "`TrainConfig(initialisation='glorot' | 'orthogonal', head_scale=)`",
        _with_measurement(
            "With an output layer of full size the first policies act on the state before anything "
            "is learned, with means about as large as their noise; a small one starts all of them "
            "from noise around 0.",
            "dffwd",
            "head_scale=0.01",
        ),
    ),
    Difference(
        "5.4-esn-size",
        "5.4",
        "Units of the ant's echo state network",
        "3 dim(o) dim(a) + 4 dim(a)², and 3328 for the ant in section 5.5.",
        f"The formula, which gives {recurrent_units('esn', 125, 8)} for 125 observations and 8 "
        "actions. On the hopper and the swimmer dim(o) counts the sensors of the subset.",
        "`TrainConfig(units=)`",
        f"{recurrent_units('esn', 128, 8)} would need 128 observations.",
    ),
    Difference(
        "5.4-number-type",
        "5.4",
        "Number type",
        "Not stated.",
        "Networks in float32; physics, returns, baseline and conjugate gradient in float64. "
        "float64 throughout is an option.",
        "`TrainConfig(precision='float32' | 'float64')`",
        lambda tables: (
            "Runs that differ in their last digits soon differ visibly, much as two seeds do. "
            + _told("precision/curves", "precision", "float32")
        ),
    ),
    Difference(
        "5.4-runs-alone",
        "5.4",
        "Random numbers",
        "Randomised runs.",
        "Iteration i of a run draws everything from the seed and i alone, each world from a stream "
        "of its own.",
        "`TrainConfig(seed=)`",
        "A run repeats to the bit on the same machine with the same number of threads, also after "
        "it was killed. The author's parallel sampler did not repeat.",
    ),
)
