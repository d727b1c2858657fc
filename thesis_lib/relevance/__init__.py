r"""Relevance and k-relevance of abstractions (chapter 4, sections 4.1 and appendix B)."""

from thesis_lib.relevance.abstraction import (
    abstract_q,
    abstraction_error,
    cross_task_q,
    relevance,
    relevance_by_variance,
)
from thesis_lib.relevance.cells import Cells, FeatureCells, ground, keep, partition, remove
from thesis_lib.relevance.estimators import (
    Estimate,
    estimate,
    finite_domain,
    law,
)
from thesis_lib.relevance.exact import (
    domain_relevance,
    k_relevance,
    rate,
    second_rate,
)
from thesis_lib.relevance.linear import (
    Basis,
    estimate_from,
    feature_basis,
    increment_covariance,
    linear_class,
    linear_k_relevance,
)
from thesis_lib.relevance.network import Networks, fit_networks
from thesis_lib.relevance.sequences import (
    brute_force_k_relevance,
    list_sequences,
    sample_combinations,
    sampled_k_relevance,
    sequence_covariance,
)
from thesis_lib.relevance.solutions import ACTION, Solutions, TaskTable

__all__ = [
    "ACTION",
    "Basis",
    "Cells",
    "Estimate",
    "FeatureCells",
    "Networks",
    "Solutions",
    "TaskTable",
    "abstract_q",
    "abstraction_error",
    "brute_force_k_relevance",
    "cross_task_q",
    "domain_relevance",
    "estimate",
    "estimate_from",
    "feature_basis",
    "finite_domain",
    "fit_networks",
    "ground",
    "increment_covariance",
    "k_relevance",
    "keep",
    "law",
    "linear_class",
    "linear_k_relevance",
    "list_sequences",
    "partition",
    "rate",
    "relevance",
    "relevance_by_variance",
    "remove",
    "sample_combinations",
    "sampled_k_relevance",
    "second_rate",
    "sequence_covariance",
]
