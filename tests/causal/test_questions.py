"""A question changes what it names, keeps the rules of scenes, and says why it cannot be asked."""

from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from omegaconf import OmegaConf
from pydantic import TypeAdapter

from pipeline.causal.questions import Question, Scenes, change, draw_additions
from pipeline.runtime.places import CONF
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import SYMBOLS, LayoutRules, Layouts, allowed, random_layouts
from tests.factories import composed

GLASS, BOWL = SYMBOLS.index("glass"), SYMBOLS.index("bowl")
FILES = sorted((CONF / "questions").glob("*.yaml"))


def question(**values) -> Question:
    return TypeAdapter(Question).validate_python(values)


@pytest.fixture(scope="module")
def scenes() -> Scenes:
    cfg = composed("profile=smoke")
    catalogue, rules = read_catalogue(Path(cfg.paths.data)), LayoutRules.of(cfg.scenes.layout)
    pool = catalogue.pool("unseen")
    layouts = random_layouts(np.random.default_rng(0), 40, catalogue.footprints, pool, rules)
    return Scenes(layouts, catalogue.footprints, pool, rules, list(catalogue.textures["name"]))


def ask(scenes: Scenes, **values) -> tuple[Layouts, np.ndarray]:
    """Return the layouts that the question sets, and the scenes in which it is asked."""
    placements, asked = change("q", question(**values), scenes, {}, np.random.default_rng(1))
    return placements[0]["O"], asked


def differing(a: Layouts, b: Layouts) -> np.ndarray:
    """Return the slots, (scene, slot), whose item differs in any way."""
    same = (a.item == b.item) & (a.centre == b.centre).all(-1) & (a.angle == b.angle) & (a.scale == b.scale)
    return ~same & (a.present | b.present)


def test_every_file_of_conf_questions_is_a_question_that_can_be_asked(scenes: Scenes):
    additions = draw_additions(np.random.default_rng(0), scenes, 1)
    for path in FILES:
        settings = TypeAdapter(Question).validate_python(OmegaConf.to_container(OmegaConf.load(path)))
        assert change(path.stem, settings, scenes, additions, np.random.default_rng(0))[1].sum() >= 2, path
    assert {OmegaConf.load(path).kind for path in FILES} == {
        get_args(c.model_fields["kind"].annotation)[0] for c in get_args(get_args(Question)[0])
    }


def test_one_item_is_moved_by_the_distance_and_no_other_item(scenes: Scenes):
    layouts, asked = ask(scenes, kind="move", symbol="glass", distance=0.07)
    scene, slot = np.nonzero(differing(scenes.layouts, layouts))
    np.testing.assert_array_equal(scene, np.flatnonzero(asked))
    assert (layouts.symbol[scene, slot] == GLASS).all() and asked.sum() > 10
    step = layouts.centre[scene, slot] - scenes.layouts.centre[scene, slot]
    np.testing.assert_allclose(np.linalg.norm(step, axis=-1), 0.07)
    assert allowed(layouts[scene], slot, scenes.rules).all()


def test_a_swapped_item_stands_where_the_other_stood(scenes: Scenes):
    layouts, asked = ask(scenes, kind="swap", symbol="glass", to="bowl")
    scene, slot = np.nonzero(differing(scenes.layouts, layouts))
    np.testing.assert_array_equal(scene, np.flatnonzero(asked))
    assert (scenes.layouts.symbol[scene, slot] == GLASS).all() and (layouts.symbol[scene, slot] == BOWL).all()
    np.testing.assert_array_equal(layouts.centre[scene, slot], scenes.layouts.centre[scene, slot])
    assert set(layouts.item[scene, slot]) <= set(scenes.pool) and allowed(layouts[scene], slot, scenes.rules).all()
