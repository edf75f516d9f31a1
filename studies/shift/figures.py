"""One scene under each disturbance."""

from matplotlib.figure import Figure

from pipeline.report.drawing import draw_images
from pipeline.report.study import Study

# disturbance -> title of its image; the strongest form of each is drawn
SHOWN = {"none": "as it is", "texture": "another table top", "noise": "sensor noise", "blur": "blur"}
SHOWN |= {"arm": "an arm in view", "clutter": "added items"}


def same_scene(study: Study) -> Figure:
    """Draw the first scene as it is and disturbed."""
    strongest = {name.partition(" ")[0]: image for name, image in study.arrays("examples.npz").items()}
    shown = {title: strongest[kind] for kind, title in SHOWN.items() if kind in strongest}
    return draw_images({"": list(shown.values())}, list(shown))
