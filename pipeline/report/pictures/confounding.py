"""Pictures of the confounded world and of what the models made of it."""

from functools import partial

from pipeline.report.figures import confounding
from pipeline.report.pictures.picture import Drawn, Picture, picture
from pipeline.report.results import Results
from pipeline.report.wording import counted, listed, percent, variant_phrase

SHOWN = 3  # scenes of each world


def confounded_worlds(drawn: Drawn) -> Picture:
    """Scenes of the confounded world and of its control."""
    caption = (
        "Training scenes in which one cause lays plates and glasses side by side, or neither (above), and of a control "
        "in which each comes on its own (below); the items are the same."
    )
    alt = "Above, tables on which plates stand beside glasses; below, tables on which they stand anywhere."
    worlds = {name: drawn.worlds[name] for name in ("confounded", "control")}
    return picture("confounded", caption, alt, partial(confounding.draw_worlds, worlds, SHOWN))


def association(results: Results, drawn: Drawn) -> Picture:
    """Association and intervention, side by side."""
    found = results.confounding
    users = list(found["association"]["confounded"])
    parts = [f"{variant_phrase(v)} {t['right']} of {t['cells']}" for v, t in found["verdicts"].items()]
    plates = [percent(found["association"]["confounded"][u]["plate"]["difference"], 0) for u in users]
    alt = (
        f"Passing near a plate goes with {listed(plates)} more invalid paths ({listed(users)} user) in the confounded "
        f"world. Verdicts after interventions that are right: {listed(parts)}."
    )
    caption = (
        "First panel: how much more often demonstrations that pass near a symbol (within "
        f"{100 * found['near_m']:g} cm) are invalid, in ordinary training scenes and in confounded ones (95 % "
        "intervals by the jackknife over all seeds' "
        "scenes). Second panel: what one more item does to mean validity, by models "
        f"fitted to the confounded world, asked in ordinary scenes, with the truth as upright bars "
        f"({counted(found['seeds'], 'seed')})."
    )
    effects = {v: found["interventions"][v] for v in results.variants if v in found["interventions"]}
    wide, narrow = (
        partial(confounding.draw, found["association"], effects, users, drawn.smallest, columns) for columns in (2, 1)
    )
    return picture("association", caption, alt, wide, narrow)
