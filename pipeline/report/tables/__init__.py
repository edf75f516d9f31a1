"""The report's tables: the paper's two, with its numbers, the nulls and the truth beside ours, and the rest."""

from pipeline.report.results import Results
from pipeline.report.table import Table
from pipeline.report.tables import (
    ablation,
    acceptance,
    accuracy,
    causes,
    confounding,
    counterfactuals,
    misspecification,
    refutation,
    repair,
    robustness,
    summary,
    users,
)


def all_tables(results: Results) -> list[Table]:
    """Every table, in the order of the report."""
    makers = [
        summary.models, summary.world,
        accuracy.accuracy, accuracy.efficiency, accuracy.comparisons, accuracy.by_user, accuracy.calibration,
        acceptance.acceptance, robustness.robustness, robustness.accepted, robustness.strange,
        misspecification.misspecification, misspecification.credence, ablation.ablation,
        repair.backprop, repair.repair_detail, repair.searches, repair.thresholds,
        causes.interventions, causes.verdicts, causes.intervention_detail, causes.specifications,
        refutation.refuters, refutation.refuted,
        confounding.association, confounding.worlds,
        counterfactuals.blame, users.envelopes, users.planning, users.identification, causes.selftest,
    ]  # fmt: skip
    return [make(results) for make in makers]
