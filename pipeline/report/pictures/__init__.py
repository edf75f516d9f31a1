"""The report's figures with their captions, and texts for those who cannot see them that state the finding."""

from pipeline.report.pictures import (
    acceptance,
    causes,
    confounding,
    counterfactuals,
    inside,
    knowledge,
    refutation,
    repairs,
    robustness,
    setting,
    users,
)
from pipeline.report.pictures.picture import Drawn, Picture
from pipeline.report.results import Results


def all_pictures(results: Results, summary, drawn: Drawn) -> dict[str, Picture]:
    """Every figure of the page by name; `summary` is accuracy against n (variant, split, n, mean, q1, q3)."""
    pictures = [
        setting.calibrated_world(results), setting.demonstrations(results, drawn),
        knowledge.accuracy_by_n(results, summary), knowledge.efficiency_curves(results),
        robustness.accuracy_disturbed(results), robustness.disturbed_scene(results, drawn),
        *(knowledge.belief_map(results, drawn, user) for user in results.users),
        *(repairs.repairs_of(results, drawn, variant) for variant in drawn.repairs),
        *([repairs.failures_of(results, drawn)] if drawn.failures else []),
        causes.causal_graph(results), causes.effects(results, drawn),
        causes.power_curves(results, drawn), causes.added_items(drawn),
        refutation.refuted_effects(results, drawn), refutation.placebo_patches(drawn),
        confounding.confounded_worlds(drawn), confounding.association(results, drawn),
        counterfactuals.blame(results), counterfactuals.examples(results, drawn),
        users.envelopes(results, list(drawn.repairs)), users.identified(results, list(drawn.repairs)),
        inside.reconstructions(drawn), inside.traversals(drawn),
        knowledge.reliability_diagram(results), acceptance.accepted(results), inside.learning_curves(results),
        *([inside.things_found(drawn)] if drawn.seen else []),
    ]  # fmt: skip
    return {p.name: p for p in pictures}
