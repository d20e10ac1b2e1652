"""The collision check agrees with an independent one, for some of the motions of ``make check-collisions``."""

import math

import pytest

from bench.collisions import ARMS, Scene, Trial
from linked_fleet_gateway.extensions.world.messages import CollisionFound, Free

SEED, COUNT = 5, 6


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene()


@pytest.mark.test_all
@pytest.mark.parametrize("name", ARMS)
def test_no_contact_is_passed_and_nothing_is_refused_without_one(scene: Scene, name: str) -> None:
    trial = Trial(scene, name, SEED)
    for _ in range(COUNT):
        trial.motion()
    assert (trial.verdicts.passed, trial.verdicts.needless, trial.verdicts.unable) == ([], [], 0)


def test_figure_5b_is_free_in_the_demo_and_a_colliding_target_is_refused(scene: Scene) -> None:
    home = scene.home["baxter"]
    assert isinstance(scene.check("baxter", home, {"right_s1": math.radians(43.6)}), Free)
    met = scene.check("baxter", home, {"right_s1": math.radians(43.6), "right_s0": math.radians(90)})
    assert isinstance(met, CollisionFound)


def test_the_second_opinion_sees_a_contact_that_is_there(scene: Scene) -> None:
    """Two checks that never find anything would agree as well."""
    trial = Trial(scene, "ur5", SEED)
    home = scene.home["ur5"]
    contact = trial._contact(home, {"elbow_joint": 3.1}, set(), 0.0, -0.001)
    assert contact is not None and isinstance(scene.check("ur5", home, {"elbow_joint": 3.1}), CollisionFound)
