"""Names of variants and colours of outcomes, the same in pages and recordings."""

VALID, INVALID = "#0072b2", "#d55e00"  # blue and vermilion of Okabe and Ito
START = "#f0e442"  # a path before its repair; not used by any variant
MAP = "cividis"  # colour map of P(valid), 0 dark to 1 light, perceptually uniform
LABELS = {
    "full": "Paper’s model",
    "ae": "Without the prior (β = 0)",
    "classifier": "Classifier alone",
    "irl_maxent": "IRL, maximum entropy",
    "irl_ranked": "IRL, ranked",
    "clearance": "Clearance model",
    "position_only": "Position only (image-blind)",
    "nearest_demonstration": "Nearest demonstration (image-blind)",
    "constant_detour": "Fixed detour (image-blind)",
    "random_path": "Random path (image-blind)",
    "paper": "The paper",
    "truth": "Truth",
    "blind": "Image-blind baseline",
    "clearance_margin": "Clearance, one rule",
    "ideal": "Knows the rules (truth)",
    "oracle": "Nearest valid path (truth)",
    "seen_scenes": "training scenes",
    "new_scenes": "new scenes",
    "new_items": "new scenes, unseen items",
    "few_routes_4cm": "few routes, 4 cm clear",
    "few_routes_8cm": "few routes, 8 cm clear",
    "random_routes": "any route",
}


def label(name: str) -> str:
    """Return the displayed name of a variant, baseline or split; unknown names are returned unchanged."""
    return LABELS.get(name, name)
